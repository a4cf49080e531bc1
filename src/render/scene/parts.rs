//! The parts of a scene as written in JSON, and their resolved forms.

use serde::{Deserialize, Deserializer};

use super::labels::{ClipLabelsFile, label_objects};
use super::overlays::OverlaysFile;
use super::{SceneError, SyntaxError};
use crate::mode::Mode;
use crate::request::{Clip, ClipPlane, ClipSphere, DepthRule, Shading};
use relief_base::{OutOfRange, Point, Vector};
use relief_display::{DisplaySettings, FrameContent, ScreenPlane};
use relief_volume::{Camera, Preset, PresetMode, Projection};

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DepthFile {
    #[serde(deserialize_with = "depth_rule")]
    rule: DepthRule,
    fraction: Option<f64>,
}

/// By hand, so that a refusal names the value and all rules.
fn depth_rule<'de, D: Deserializer<'de>>(deserializer: D) -> Result<DepthRule, D::Error> {
    let name = String::deserialize(deserializer)?;
    let shown: String = name.chars().take(40).collect();
    let unknown = || format!("no depth rule {shown:?}; allowed: {}", DepthRule::names().join(", "));
    DepthRule::from_name(&name).ok_or_else(|| serde::de::Error::custom(unknown()))
}

/// Refuses the cursor as the plane of the screen: only live views have one, and put it in before.
pub(super) fn expect_no_cursor(display: &DisplaySettings) -> Result<(), OutOfRange> {
    if display.screen_plane == Some(ScreenPlane::Cursor) {
        let allowed = "a point [x, y, z] in mm or null; live views have a cursor";
        return Err(OutOfRange::new("display.screen_plane", "\"cursor\"", allowed));
    }
    Ok(())
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct ClipFile {
    box_mm: Option<[[f64; 3]; 2]>,
    planes: Vec<PlaneFile>,
    sphere: Option<SphereFile>,
    /// Not for the ray's interval: it becomes a look of the labels.
    pub(super) labels: Option<ClipLabelsFile>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SphereFile {
    center_mm: [f64; 3],
    radius_mm: f64,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlaneFile {
    point_mm: [f64; 3],
    normal: [f64; 3],
}

/// Refuses arrays where the format has objects: serde would read them as an object's values in
/// order.
pub(super) fn expect_objects(scene: &serde_json::Value) -> Result<(), SceneError> {
    const OBJECTS: [&str; 16] = [
        "",
        "/camera",
        "/camera/projection",
        "/camera/projection/perspective",
        "/camera/projection/orthographic",
        "/transfer",
        "/transfer/window",
        "/transfer/gradient_opacity",
        "/shading",
        "/shading/occlusion",
        "/depth",
        "/clip",
        "/clip/sphere",
        "/slice",
        "/overlays",
        "/path_trace",
    ];
    let lists =
        ["/transfer/points", "/transfer/gradient_opacity/points", "/clip/planes", "/surfaces", "/lights"]
            .into_iter()
            .flat_map(|list| {
                let items = scene.pointer(list).and_then(serde_json::Value::as_array).map_or(0, Vec::len);
                (0..items).map(move |i| format!("{list}/{i}"))
            });
    let lists = lists.chain(overlay_items(scene)).chain(label_objects(scene));
    let paths = OBJECTS.into_iter().chain(["/display"]).map(str::to_owned).chain(lists);
    for path in paths {
        if scene.pointer(&path).is_some_and(serde_json::Value::is_array) {
            let path = path.trim_start_matches('/').replace('/', ".");
            let path = if path.is_empty() { ".".to_owned() } else { path };
            return Err(SceneError::Syntax { path, source: SyntaxError::Array });
        }
    }
    Ok(())
}

/// The items of the overlays, and their settings.
fn overlay_items(scene: &serde_json::Value) -> impl Iterator<Item = String> {
    let items = scene.pointer("/overlays/items").and_then(serde_json::Value::as_array).map_or(0, Vec::len);
    (0..items).flat_map(|i| {
        let item = format!("/overlays/items/{i}");
        let inner = OverlaysFile::KINDS.map(|kind| format!("{item}/{kind}"));
        std::iter::once(item).chain(inner)
    })
}

pub(super) fn default_mode(preset: Option<&Preset>) -> Mode {
    match preset.map(|preset| preset.mode) {
        Some(PresetMode::Maximum) => Mode::Mip,
        Some(PresetMode::Composite) | None => Mode::Composite,
    }
}

pub(super) fn default_shading(preset: Option<&Preset>) -> Shading {
    let ([ambient, diffuse, specular], shininess) =
        preset.map_or(([0.2, 0.8, 0.0], 10.0), |preset| (preset.light, preset.shininess));
    Shading { ambient, diffuse, specular, shininess }
}

impl DepthFile {
    /// The default where nothing was written: the rule that the layout needs.
    ///
    /// Views are made of frames with disparity, and by layouts of views; so their depth is made for
    /// views. A parallel projection has no views beside it.
    pub(super) fn usual(display: &DisplaySettings, mode: Mode, camera: &Camera) -> Self {
        let fraction = DepthRule::USUAL_FRACTION;
        let is_for_views =
            matches!(display.layout.info().content, FrameContent::Disparity(_) | FrameContent::Views(_));
        let has_views = matches!(camera.projection(), Projection::Perspective { .. });
        Self::of_rule(if is_for_views && has_views && mode == Mode::Composite {
            DepthRule::Views
        } else if display.layout.needs_background() {
            DepthRule::TwoLayer { fraction }
        } else {
            DepthRule::Threshold { fraction }
        })
    }

    pub(super) fn of_rule(rule: DepthRule) -> Self {
        Self { rule, fraction: None }
    }

    pub(super) fn resolve(self) -> Result<DepthRule, OutOfRange> {
        let Some(fraction) = self.fraction else { return Ok(self.rule) };
        self.rule.with_fraction(fraction).ok_or_else(|| {
            let allowed = format!("nothing beside rule {}", self.rule.name());
            OutOfRange::new("depth.fraction", fraction, allowed)
        })
    }
}

impl ClipFile {
    pub(super) fn resolve(self) -> Result<Clip, OutOfRange> {
        let mut clip = Clip::default();
        if let Some([min, max]) = self.box_mm {
            if !min.iter().zip(&max).all(|(low, high)| low < high && -1e6 <= *low && *high <= 1e6) {
                return Err(OutOfRange::new(
                    "clip.box_mm",
                    format!("{min:?} to {max:?}"),
                    "[min, max] with min < max, within 1000000 mm",
                ));
            }
            clip.add_box(Point::from_xyz(min.into()), Point::from_xyz(max.into()));
        }
        for (i, plane) in self.planes.into_iter().enumerate() {
            clip.planes.push(plane.resolve(i)?);
        }
        clip.sphere = self.sphere.map(|SphereFile { center_mm, radius_mm }| ClipSphere {
            center: Point::from_xyz(center_mm.into()),
            radius_mm,
        });
        Ok(clip)
    }
}

impl PlaneFile {
    fn resolve(self, index: usize) -> Result<ClipPlane, OutOfRange> {
        let Self { point_mm, normal } = self;
        let path = |key: &str| format!("clip.planes[{index}].{key}");
        if point_mm.iter().any(|mm| !(-1e6..=1e6).contains(mm)) {
            let allowed = "-1000000 to 1000000 mm each";
            return Err(OutOfRange::new(path("point_mm"), format!("{point_mm:?}"), allowed));
        }
        let plane =
            ClipPlane { point: Point::from_xyz(point_mm.into()), normal: Vector::from_xyz(normal.into()) };
        match plane.normal.normalized() {
            Some(_) => Ok(plane),
            None => {
                let allowed = "a direction of finite length above zero";
                Err(OutOfRange::new(path("normal"), format!("{normal:?}"), allowed))
            }
        }
    }
}
