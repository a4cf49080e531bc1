//! View sets: the views that are rendered of every series.

use std::path::Path;

use serde_json::{Map, Value, json};

use super::error::{PlanError, ViewError, ViewsError};
use super::names::{NAMES, is_name};
use relief_base::OutOfRange;
use relief_render::SceneFile;

/// A view by name, and its difference to the shared scene.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Part of the names of files.
    pub name: String,
    /// Its group of views; empty for a single view.
    pub group: String,
    /// Keys of the scene, which go before those that all views share.
    pub scene: Map<String, Value>,
    /// Angles around the volume; `None` if the scene has a camera or a slice.
    pub orbit: Option<[f64; 2]>,
}

/// Views to be rendered of every series.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ViewSet {
    /// Those that are alike for all series.
    pub views: Vec<View>,
    /// One for each landmark of the series, along its normal.
    pub landmarks: bool,
    /// Turns of each series that has phases: each picture shows the next phase.
    pub time: Vec<View>,
    /// One through each camera by which an annotation of the series was placed.
    pub cameras: bool,
}

/// Sets of turns, and the groups of their views: of each series, and of each one that has phases.
pub(super) const TURNTABLE: &str = "turntable";
pub(super) const TIME: &str = "time";
/// The groups whose pictures become films.
pub const FILMS: [&str; 2] = [TURNTABLE, TIME];

/// Most views of a turntable: one for each half degree.
const MOST_TURNS: u32 = 720;

impl ViewSet {
    /// Whether all views are slices, as far as views are known before annotations are read.
    #[must_use]
    pub fn are_slices(&self) -> bool {
        let all = self.views.iter().all(|view| view.scene.contains_key("slice"));
        all && !self.views.is_empty() && self.time.is_empty() && !self.needs_annotations()
    }

    /// Reads sets with commas between them: `turntable:N`, `time:N`, `sides`, `planes`,
    /// `landmarks`, `cameras`, or a file: a JSON array of `{"name", "scene"}`.
    ///
    /// # Errors
    /// When one is no such set, the file cannot be read or has no views, or two views have one
    /// name.
    pub fn parse(text: &str) -> Result<Self, PlanError> {
        let mut sets = Self::default();
        let views = &mut sets.views;
        for set in text.split(',').map(str::trim) {
            match set.split_once(':') {
                Some((TURNTABLE, count)) => views.extend(turns(TURNTABLE, count)?),
                Some((TIME, count)) => sets.time.extend(turns(TIME, count)?),
                _ if set == "sides" => views.extend(sides()),
                _ if set == "planes" => views.extend(planes()),
                _ if set == "landmarks" => sets.landmarks = true,
                _ if set == "cameras" => sets.cameras = true,
                _ => views.extend(read(Path::new(set))?),
            }
        }
        let views: Vec<&View> = sets.views.iter().chain(&sets.time).collect();
        for (index, view) in views.iter().enumerate() {
            if views[..index].iter().any(|other| other.name == view.name) {
                return Err(ViewsError::Twice { name: view.name.clone() }.into());
            }
        }
        Ok(sets)
    }

    /// Whether only phases have views.
    #[must_use]
    pub fn is_time(&self) -> bool {
        !self.time.is_empty() && self.views.is_empty() && !self.needs_annotations()
    }

    /// Whether some of the views are those of annotations.
    #[must_use]
    pub fn needs_annotations(&self) -> bool {
        self.landmarks || self.cameras
    }
}

/// Equal turns about the patient's long axis, from the front.
fn turns(set: &'static str, count: &str) -> Result<Vec<View>, ViewsError> {
    let wrong = || ViewsError::Turns { set, found: count.to_owned(), most: MOST_TURNS };
    let count: u32 = count.parse().map_err(|_| wrong())?;
    if !(1..=MOST_TURNS).contains(&count) {
        return Err(wrong());
    }
    let view = |turn: u32| {
        let azimuth_deg = 360.0 * f64::from(turn) / f64::from(count);
        let name = format!("{set}-{turn:03}");
        View { name, group: set.to_owned(), scene: Map::new(), orbit: Some([azimuth_deg, 0.0]) }
    };
    Ok((0..count).map(view).collect())
}

/// From the six sides of the patient.
fn sides() -> Vec<View> {
    let sides = [
        ("anterior", [0.0, 0.0]),
        ("left", [90.0, 0.0]),
        ("posterior", [180.0, 0.0]),
        ("right", [270.0, 0.0]),
        ("superior", [0.0, 90.0]),
        ("inferior", [0.0, -90.0]),
    ];
    let view = |(name, orbit): (&str, _)| View {
        name: name.to_owned(),
        group: "sides".to_owned(),
        scene: Map::new(),
        orbit: Some(orbit),
    };
    sides.map(view).to_vec()
}

/// The three named planes through the middle.
fn planes() -> Vec<View> {
    let view = |plane: &str| {
        let scene = json!({ "mode": "slice", "slice": { "plane": plane } });
        let scene = scene.as_object().cloned().unwrap_or_default();
        View { name: plane.to_owned(), group: "planes".to_owned(), scene, orbit: None }
    };
    ["axial", "coronal", "sagittal"].map(view).to_vec()
}

/// Views of a file.
fn read(path: &Path) -> Result<Vec<View>, ViewsError> {
    let path = || path.to_owned();
    let bytes = std::fs::read(path()).map_err(|source| ViewsError::Unreadable { path: path(), source })?;
    let file: Value =
        serde_json::from_slice(&bytes).map_err(|source| ViewsError::Json { path: path(), source })?;
    let views = file.as_array().filter(|views| !views.is_empty());
    let views = views.ok_or_else(|| ViewsError::NoList { path: path() })?;
    let view =
        |(index, view)| read_view(view).map_err(|source| ViewsError::View { path: path(), index, source });
    views.iter().enumerate().map(view).collect()
}

fn read_view(view: &Value) -> Result<View, ViewError> {
    const KEYS: [&str; 5] = ["name", "group", "scene", "azimuth_deg", "elevation_deg"];
    let object = view.as_object().ok_or(ViewError::NoObject)?;
    if let Some(key) = object.keys().find(|key| !KEYS.contains(&key.as_str())) {
        return Err(ViewError::UnknownKey { key: key.clone() });
    }
    let wrong =
        |key: &str, found: &Value, allowed: &str| ViewError::Value(OutOfRange::new(key, found, allowed));
    let text = |key| match object.get(key) {
        None => Ok(String::new()),
        Some(Value::String(text)) => Ok(text.clone()),
        Some(other) => Err(wrong(key, other, "a text")),
    };
    let angle = |key| match object.get(key) {
        None => Ok(None),
        Some(number) => number.as_f64().map(Some).ok_or_else(|| wrong(key, number, "degrees")),
    };
    let name = text("name")?;
    if !is_name(&name) {
        return Err(wrong("name", &json!(name), NAMES));
    }
    let scene = match object.get("scene") {
        None => Map::new(),
        Some(Value::Object(scene)) => scene.clone(),
        Some(other) => return Err(wrong("scene", other, "an object")),
    };
    // Invalid keys are reported now, not for every job.
    let parsed = SceneFile::from_value(&Value::Object(scene.clone()))?;
    let angles = [angle("azimuth_deg")?, angle("elevation_deg")?];
    let has_view = parsed.has_camera() || parsed.is_slice();
    if has_view && angles.iter().any(Option::is_some) {
        return Err(ViewError::Angles);
    }
    let orbit = (!has_view).then(|| angles.map(Option::unwrap_or_default));
    Ok(View { name, group: text("group")?, scene, orbit })
}
