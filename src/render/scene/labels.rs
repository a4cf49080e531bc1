//! Segments as written in JSON: looks of some, what holds for the others, and which are cut away.

use std::collections::HashMap;
use std::fmt;
use std::sync::Arc;

use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer};

use super::SceneError;
use super::transfer::{TransferFile, Windows, resolve_transfer};
use crate::classification::Classification;
use crate::labels::{Edges, Labels, Look};
use crate::mode::Mode;
use relief_base::OutOfRange;
use relief_volume::{LabelMap, TransferFunction};

/// How strongly segments are tinted where nothing is written.
const USUAL_TINT: f64 = 0.5;

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct LabelsFile {
    segments: Vec<SegmentFile>,
    others: OthersFile,
    tint: Option<f64>,
    edges: EdgesFile,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SegmentFile {
    label: LabelFile,
    #[serde(default = "yes")]
    visible: bool,
    transfer: Option<TransferFile>,
    tint_rgb: Option<[f64; 3]>,
    tint: Option<f64>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct OthersFile {
    visible: bool,
    transfer: Option<TransferFile>,
    tint: Option<f64>,
}

impl Default for OthersFile {
    fn default() -> Self {
        Self { visible: true, transfer: None, tint: None }
    }
}

fn yes() -> bool {
    true
}

#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
enum EdgesFile {
    #[default]
    Smooth,
    Voxels,
}

/// The segments that are cut away: some, or all except some.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct ClipLabelsFile {
    cut: Option<Vec<LabelFile>>,
    keep: Option<Vec<LabelFile>>,
}

impl ClipLabelsFile {
    /// The segments that are cut away or kept, each by its label or its name; `None` where both
    /// lists are empty.
    pub(super) fn of(cut: &[String], keep: &[String]) -> Option<Self> {
        let list = |words: &[String]| {
            let labels = words
                .iter()
                .map(|word| word.parse().map_or_else(|_| LabelFile::Name(word.clone()), LabelFile::Label));
            (!words.is_empty()).then(|| labels.collect())
        };
        (!(cut.is_empty() && keep.is_empty())).then(|| Self { cut: list(cut), keep: list(keep) })
    }
}

impl LabelsFile {
    pub(super) fn set_tint(&mut self, tint: f64) {
        self.tint = Some(tint);
    }
}

/// A segment by its label or its name.
#[derive(Clone, Debug)]
enum LabelFile {
    Label(u16),
    Name(String),
}

/// Written by hand, so that an error names the permitted values of a label.
impl<'de> Deserialize<'de> for LabelFile {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct LabelOrName;
        impl Visitor<'_> for LabelOrName {
            type Value = LabelFile;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a label from 0 to 65535 or a segment's name")
            }

            fn visit_u64<E: Error>(self, label: u64) -> Result<LabelFile, E> {
                let unexpected = || E::invalid_value(serde::de::Unexpected::Unsigned(label), &self);
                u16::try_from(label).map(LabelFile::Label).map_err(|_| unexpected())
            }

            // JSON may also write a whole number as `3.0`.
            fn visit_f64<E: Error>(self, label: f64) -> Result<LabelFile, E> {
                let is_label = label.fract() == 0.0 && (0.0..=f64::from(u16::MAX)).contains(&label);
                let unexpected = || E::invalid_value(serde::de::Unexpected::Float(label), &self);
                is_label.then_some(LabelFile::Label(label as u16)).ok_or_else(unexpected)
            }

            fn visit_str<E: Error>(self, name: &str) -> Result<LabelFile, E> {
                Ok(LabelFile::Name(name.to_owned()))
            }
        }
        deserializer.deserialize_any(LabelOrName)
    }
}

impl LabelFile {
    /// Its place among the looks; `None` for a label that the map does not have: that is no
    /// mistake, as one scene may be for many maps, and not everybody has a gallbladder.
    fn place(&self, map: &LabelMap, path: &str) -> Result<Option<usize>, OutOfRange> {
        let segments = map.segments();
        match self {
            Self::Label(0) => Ok(Some(0)),
            Self::Label(label) => {
                let found = segments.binary_search_by_key(label, |segment| segment.label);
                Ok(found.ok().map(|at| at + 1))
            }
            Self::Name(name) => {
                let mut found = (1..).zip(segments).filter(|(_, s)| s.name.as_ref() == Some(name));
                let shown: String = name.chars().take(60).collect();
                match (found.next(), found.next()) {
                    (Some((place, _)), None) => Ok(Some(place)),
                    (Some(_), Some(_)) => {
                        let allowed = "a name of one segment alone; these have labels";
                        Err(OutOfRange::new(path, format!("{shown:?}"), allowed))
                    }
                    (None, _) => Err(OutOfRange::new(path, format!("{shown:?}"), names(map))),
                }
            }
        }
    }
}

/// The names that a map has, for a refusal.
fn names(map: &LabelMap) -> String {
    let names: Vec<&str> = map.segments().iter().filter_map(|segment| segment.name.as_deref()).collect();
    match names.len() {
        0 => "a label: this map's segments have no names".to_owned(),
        1..=150 => format!("a label, or one of {}", names.join(", ")),
        count => format!("a label, or one of {count} names, such as {}", names[..20].join(", ")),
    }
}

/// The label settings of a scene.
pub(super) struct LabelSettings {
    pub(super) labels: Option<LabelsFile>,
    pub(super) clip: Option<ClipLabelsFile>,
}

/// The looks of a map's segments; `None` where they change nothing, and for a volume without a map.
/// Where nothing is written, segments are tinted if the mode and the transfer function can.
///
/// # Errors
/// When something is written and there is no map, or it is out of range.
pub(super) fn resolve_labels(
    written: LabelSettings,
    map: Option<&Arc<LabelMap>>,
    mode: Mode,
    classification: Classification,
    transfer: &TransferFunction,
) -> Result<Option<Arc<Labels>>, SceneError> {
    let path = match (&written.labels, &written.clip) {
        (Some(_), _) => Some("labels"),
        (None, Some(_)) => Some("clip.labels"),
        (None, None) => None,
    };
    let Some(map) = map else {
        let allowed = "nothing beside a volume without a label map";
        return path.map_or(Ok(None), |path| Err(OutOfRange::new(path, "there", allowed).into()));
    };
    let can = Labels::are_shown_by(mode)
        && classification == Classification::Sampled
        && transfer.gradient_opacity().is_none()
        && map.segments().len() <= Labels::MOST_SEGMENTS;
    if path.is_none() && !can {
        return Ok(None);
    }
    let windows = if matches!(mode, Mode::Slice(_)) { Windows::Opaque } else { Windows::Translucent };
    let mut looks = Looks { map, windows, looks: Vec::new(), transfers: Vec::new() };
    let file = written.labels.unwrap_or_default();
    let edges = file.edges;
    looks.resolve(file)?;
    looks.clip(&written.clip.unwrap_or_default())?;
    let Looks { looks, transfers, .. } = looks;
    let edges = match edges {
        EdgesFile::Smooth => Edges::Smooth,
        EdgesFile::Voxels => Edges::Voxels,
    };
    let labels = Labels { map: Arc::clone(map), looks, transfers, edges };
    // Labels that change nothing but cannot be shown are still refused, by the request's own
    // checks.
    Ok((!(can && labels.are_plain())).then(|| Arc::new(labels)))
}

struct Looks<'a> {
    map: &'a LabelMap,
    windows: Windows,
    looks: Vec<Look>,
    transfers: Vec<TransferFunction>,
}

impl Looks<'_> {
    fn resolve(&mut self, file: LabelsFile) -> Result<(), SceneError> {
        let LabelsFile { segments, others, tint, .. } = file;
        let tint = share("labels.tint", tint.unwrap_or(USUAL_TINT))?;
        let others_tint = share("labels.others.tint", others.tint.unwrap_or(tint))?;
        let transfer = self.transfer("labels.others", others.transfer)?;
        let other = |tint_rgb, tint| Look { visible: others.visible, transfer, tint_rgb, tint };
        let segments_of_map = self.map.segments().iter().map(|segment| other(segment.color(), others_tint));
        self.looks = std::iter::once(other([0.0; 3], 0.0)).chain(segments_of_map).collect();
        let mut written: HashMap<usize, usize> = HashMap::new();
        for (i, segment) in segments.into_iter().enumerate() {
            let path = format!("labels.segments[{i}]");
            let place = segment.label.place(self.map, &format!("{path}.label"))?;
            let look = self.look(&path, segment, place, tint)?;
            let Some(place) = place else { continue };
            if let Some(before) = written.insert(place, i) {
                let allowed = format!("each segment once; labels.segments[{before}] is the same");
                return Err(OutOfRange::new(format!("{path}.label"), "there again", allowed).into());
            }
            self.looks[place] = look;
        }
        Ok(())
    }

    /// The look of a segment as written; of one that the map does not have too, so that it is
    /// checked.
    fn look(
        &mut self,
        path: &str,
        file: SegmentFile,
        place: Option<usize>,
        usual_tint: f64,
    ) -> Result<Look, SceneError> {
        let SegmentFile { visible, transfer, tint_rgb, tint, .. } = file;
        let segment = place.and_then(|place| place.checked_sub(1)).map(|at| &self.map.segments()[at]);
        // Voxels without a segment have no colour of their own.
        let usual = if segment.is_some() || tint_rgb.is_some() { usual_tint } else { 0.0 };
        let tint = share(&format!("{path}.tint"), tint.unwrap_or(usual))?;
        for channel in tint_rgb.into_iter().flatten() {
            share(&format!("{path}.tint_rgb"), channel)?;
        }
        let own = segment.map_or([0.0; 3], relief_volume::Segment::color);
        let transfer = self.transfer(path, transfer)?;
        Ok(Look { visible, transfer, tint_rgb: tint_rgb.unwrap_or(own), tint })
    }

    /// The number of a transfer function, a new one for a new function; 0 where none is written.
    fn transfer(&mut self, path: &str, file: Option<TransferFile>) -> Result<usize, SceneError> {
        let Some(file) = file else { return Ok(0) };
        let (transfer, _) = resolve_transfer(Some(file), self.windows, None, self.map.grid().unit_mm())
            .map_err(|error| match error {
                SceneError::Range(error) => SceneError::Range(error.within(path)),
                syntax @ SceneError::Syntax { .. } => syntax,
            })?;
        if transfer.gradient_opacity().is_some() {
            let allowed = "nothing in the transfer function of a segment";
            let path = format!("{path}.transfer.gradient_opacity");
            return Err(OutOfRange::new(path, "there", allowed).into());
        }
        if let Some(known) = self.transfers.iter().position(|known| *known == transfer) {
            return Ok(known + 1);
        }
        self.transfers.push(transfer);
        Ok(self.transfers.len())
    }

    fn clip(&mut self, file: &ClipLabelsFile) -> Result<(), SceneError> {
        let places = |map: &LabelMap, key: &str, list: &[LabelFile]| {
            let path = |i| format!("clip.labels.{key}[{i}]");
            (0..).zip(list).map(|(i, label)| label.place(map, &path(i))).collect::<Result<Vec<_>, _>>()
        };
        match (&file.cut, &file.keep) {
            (Some(_), Some(_)) => {
                return Err(OutOfRange::new("clip.labels", "cut and keep", "one of cut and keep").into());
            }
            (Some(cut), None) => {
                for place in places(self.map, "cut", cut)?.into_iter().flatten() {
                    self.looks[place].visible = false;
                }
            }
            (None, Some(keep)) => {
                let kept = places(self.map, "keep", keep)?;
                for (place, look) in self.looks.iter_mut().enumerate() {
                    look.visible &= kept.contains(&Some(place));
                }
            }
            (None, None) => {}
        }
        Ok(())
    }
}

/// The JSON pointers of objects in the label settings.
pub(super) fn label_objects(scene: &serde_json::Value) -> impl Iterator<Item = String> {
    let length = |list: &str| scene.pointer(list).and_then(serde_json::Value::as_array).map_or(0, Vec::len);
    let segments = (0..length("/labels/segments")).map(|i| format!("/labels/segments/{i}"));
    let looks: Vec<String> = segments.chain(["/labels/others".to_owned()]).collect();
    let points = looks.iter().flat_map(|look| {
        let list = format!("{look}/transfer/points");
        (0..length(&list)).map(move |i| format!("{list}/{i}")).collect::<Vec<_>>()
    });
    let inner = ["", "/transfer", "/transfer/window", "/transfer/gradient_opacity"];
    let inner = looks.iter().flat_map(|look| inner.map(|part| format!("{look}{part}")));
    let whole = ["/labels", "/clip/labels"].map(str::to_owned);
    whole.into_iter().chain(inner).chain(points).collect::<Vec<_>>().into_iter()
}

fn share(path: &str, value: f64) -> Result<f64, OutOfRange> {
    if (0.0..=1.0).contains(&value) { Ok(value) } else { Err(OutOfRange::new(path, value, "0 to 1")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_may_have_a_point_and_no_fraction() {
        let read = |text: &str| serde_json::from_str::<LabelFile>(text);
        for (text, label) in [("0", 0), ("7.0", 7), ("65535.0", u16::MAX)] {
            assert!(matches!(read(text), Ok(LabelFile::Label(found)) if found == label), "{text}");
        }
        for text in ["7.5", "-1.0", "65536", "65536.0", "null"] {
            let refusal = read(text).unwrap_err().to_string();
            assert!(refusal.contains("a label from 0 to 65535 or a segment's name"), "{text}: {refusal}");
        }
    }
}
