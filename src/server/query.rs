//! A scene from a query string: the same scene that a JSON body gives, part by part.
//!
//! Each parameter is a key of the JSON form (see `relief_render::SceneFile`), or part of an orbit
//! around the volume if no eye is given. Unknown, repeated or contradictory parameters are refused.
//! Lengths in mm, angles in degrees.

use axum::http::{StatusCode, Uri};
use serde_json::{Map, Value};

use super::problem::Problem;
use relief_annotation::ShownSets;
use relief_render::{Overlays, SceneFile};
use relief_volume::{Grid, Orbit};

/// The type of a parameter's value.
#[derive(Clone, Copy, Debug)]
enum ParameterType {
    /// A word.
    Text,
    /// `true` or `false`.
    Flag,
    /// A finite number.
    Number,
    /// This number of finite numbers with commas between them.
    Numbers(usize),
    /// Finite numbers with commas between them, any number of groups of this size.
    Groups(usize),
    /// This number of whole numbers with commas between them.
    Whole(usize),
    /// `true`, `false`, or names of sets of annotations with commas between them.
    Sets,
    /// Any number of labels, or of names of segments, with commas between them.
    Labels,
}

/// The part of a request that a query parameter sets.
#[derive(Clone, Copy, Debug)]
enum Target {
    /// A key of the JSON form.
    Key(&'static str),
    /// A part of the orbit, which checks its range.
    Orbit(fn(&mut Orbit) -> &mut f64),
    /// Field of view: the orbit's, or that of a camera that is given by its eye.
    FieldOfView,
    /// Centre and width of a grey ramp.
    Window,
    /// A key of the camera, or one of the slice where the mode is that.
    View { camera: &'static str, slice: &'static str },
    /// Two corners of a box.
    ClipBox,
    /// Overlays by their names, with commas between them.
    Overlay,
    /// Centre and radius of a sphere.
    ClipSphere,
    /// A point and a normal of each plane.
    ClipPlanes,
}

/// One parameter of a scene.
#[derive(Clone, Copy, Debug)]
struct Parameter {
    name: &'static str,
    kind: ParameterType,
    target: Target,
}

const fn key(name: &'static str, kind: ParameterType, path: &'static str) -> Parameter {
    Parameter { name, kind, target: Target::Key(path) }
}

const fn to(name: &'static str, kind: ParameterType, target: Target) -> Parameter {
    Parameter { name, kind, target }
}

const HEIGHT: &str = "camera.projection.orthographic.height_mm";

/// All parameters of a scene. `openapi.json` lists the same ones; a test compares them.
const PARAMETERS: &[Parameter] = &[
    key("preset", ParameterType::Text, "transfer"),
    to("window_hu", ParameterType::Numbers(2), Target::Window),
    to("window", ParameterType::Numbers(2), Target::Window),
    key("mode", ParameterType::Text, "mode"),
    key("classification", ParameterType::Text, "classification"),
    key("cut", ParameterType::Text, "cut"),
    key("iso_hu", ParameterType::Number, "iso_hu"),
    key("passes", ParameterType::Whole(1), "path_trace.passes"),
    key("seed", ParameterType::Whole(1), "path_trace.seed"),
    key("scatterings", ParameterType::Whole(1), "path_trace.scatterings"),
    key("denoise", ParameterType::Flag, "path_trace.denoise"),
    key("lights", ParameterType::Text, "lights"),
    key("shadows", ParameterType::Number, "shading.shadows"),
    key("occlusion", ParameterType::Number, "shading.occlusion.strength"),
    key("occlusion_radius_mm", ParameterType::Number, "shading.occlusion.radius_mm"),
    key("size_px", ParameterType::Whole(2), "size_px"),
    key("budget_ms", ParameterType::Number, "budget_ms"),
    to("azimuth_deg", ParameterType::Number, Target::Orbit(|orbit| &mut orbit.azimuth_deg)),
    to("elevation_deg", ParameterType::Number, Target::Orbit(|orbit| &mut orbit.elevation_deg)),
    to("zoom", ParameterType::Number, Target::Orbit(|orbit| &mut orbit.zoom)),
    to("vertical_fov_deg", ParameterType::Number, Target::FieldOfView),
    key("frame", ParameterType::Text, "frame"),
    key("table", ParameterType::Text, "table"),
    key("eye_mm", ParameterType::Numbers(3), "camera.eye_mm"),
    key("look_at_mm", ParameterType::Numbers(3), "camera.look_at_mm"),
    to("up", ParameterType::Numbers(3), Target::View { camera: "camera.up", slice: "slice.plane.up" }),
    to("height_mm", ParameterType::Number, Target::View { camera: HEIGHT, slice: "slice.height_mm" }),
    key("plane", ParameterType::Text, "slice.plane"),
    key("normal", ParameterType::Numbers(3), "slice.plane.normal"),
    key("center_mm", ParameterType::Numbers(3), "slice.center_mm"),
    key("offset_mm", ParameterType::Number, "slice.offset_mm"),
    key("slab_mm", ParameterType::Number, "slice.slab_mm"),
    key("slab_blend", ParameterType::Text, "slice.blend"),
    key("letters", ParameterType::Flag, "slice.letters"),
    key("quality", ParameterType::Text, "quality"),
    key("sample_distance_mm", ParameterType::Number, "sample_distance_mm"),
    key("depth_rule", ParameterType::Text, "depth.rule"),
    key("depth_fraction", ParameterType::Number, "depth.fraction"),
    to("clip_box_mm", ParameterType::Numbers(6), Target::ClipBox),
    to("clip_sphere_mm", ParameterType::Numbers(4), Target::ClipSphere),
    to("clip_planes_mm", ParameterType::Groups(6), Target::ClipPlanes),
    key("cut_labels", ParameterType::Labels, "clip.labels.cut"),
    key("keep_labels", ParameterType::Labels, "clip.labels.keep"),
    key("label_tint", ParameterType::Number, "labels.tint"),
    key("background_rgb", ParameterType::Numbers(3), "background_rgb"),
    to("overlay", ParameterType::Text, Target::Overlay),
    key("annotations", ParameterType::Sets, "annotations"),
    key("layout", ParameterType::Text, "display.layout"),
    key("profile", ParameterType::Text, "display.profile"),
    key("vz", ParameterType::Number, "display.profile.vz"),
    key("content", ParameterType::Text, "display.content"),
    key("factor", ParameterType::Whole(1), "display.factor"),
    key("offset", ParameterType::Whole(1), "display.offset"),
    key("view_span", ParameterType::Number, "display.view_span"),
    key("view_cone_deg", ParameterType::Number, "display.view_cone_deg"),
    key("depth_filter", ParameterType::Text, "display.depth_filter"),
    key("depth_range", ParameterType::Text, "display.depth_range"),
    key("screen_plane_mm", ParameterType::Numbers(3), "display.screen_plane"),
    key("near_mm", ParameterType::Number, "display.near_mm"),
    key("far_mm", ParameterType::Number, "display.far_mm"),
];

/// Parameters that exclude each other: two ways to say the same thing.
const EXCLUSIVE: &[(&str, &str)] = &[
    ("preset", "window_hu"),
    ("preset", "window"),
    ("window_hu", "window"),
    ("plane", "normal"),
    ("cut_labels", "keep_labels"),
    ("profile", "vz"),
    ("view_span", "view_cone_deg"),
    ("eye_mm", "azimuth_deg"),
    ("eye_mm", "elevation_deg"),
    ("eye_mm", "zoom"),
    ("eye_mm", "frame"),
    ("height_mm", "vertical_fov_deg"),
];

/// Parameters that mean nothing without another one.
const NEEDS: &[(&str, &str)] = &[
    ("look_at_mm", "eye_mm"),
    ("depth_fraction", "depth_rule"),
    ("shadows", "lights"),
    ("occlusion_radius_mm", "occlusion"),
];
/// The same where the mode is no slice, and where it is.
const NEEDS_OF_VIEW: &[(&str, &str)] = &[
    ("up", "eye_mm"),
    ("height_mm", "eye_mm"),
    ("plane", SLICE),
    ("normal", SLICE),
    ("center_mm", SLICE),
    ("offset_mm", SLICE),
    ("slab_mm", SLICE),
    ("slab_blend", SLICE),
    ("letters", SLICE),
];
const NEEDS_OF_SLICE: &[(&str, &str)] = &[("up", "normal")];
const SLICE: &str = "mode=slice";

/// Names of the parameters that a scene's query may have.
pub(super) fn parameter_names() -> impl Iterator<Item = &'static str> {
    PARAMETERS.iter().map(|parameter| parameter.name)
}

/// Decoded name-value pairs of a query string.
#[derive(Debug)]
pub(super) struct Query(Vec<(String, String)>);

impl Query {
    /// The query of a request's target.
    ///
    /// # Errors
    /// When it is not `application/x-www-form-urlencoded`, or a name appears twice.
    pub(super) fn of(uri: &Uri) -> Result<Self, Problem> {
        let pairs = axum::extract::Query::<Vec<(String, String)>>::try_from_uri(uri)
            .map_err(|error| bad_parameter(error.body_text()))?
            .0;
        let twice =
            pairs.iter().enumerate().find(|(i, (name, _))| pairs[..*i].iter().any(|(n, _)| n == name));
        match twice {
            Some((_, (name, _))) => {
                Err(bad_parameter(format!("the parameter {name} is there twice")).with("path", name.as_str()))
            }
            None => Ok(Self(pairs)),
        }
    }

    /// Takes out the number of this name, which must be there.
    pub(super) fn take_number(&mut self, name: &'static str) -> Result<f64, Problem> {
        let at = self.0.iter().position(|(n, _)| n == name).ok_or_else(|| {
            bad_parameter(format!("the parameter {name} is missing, allowed: a number")).with("path", name)
        })?;
        let (_, text) = self.0.swap_remove(at);
        number(name, &text)
    }

    /// Refuses keys that nothing has read.
    pub(super) fn expect_empty(&self) -> Result<(), Problem> {
        self.0.first().map_or(Ok(()), |(name, _)| Err(unknown(name, "none here")))
    }

    /// A slice's default layout: only the picture.
    ///
    /// # Errors
    /// When the mode is another one.
    pub(super) fn of_slice(uri: &Uri) -> Result<Self, Problem> {
        let mut query = Self::of(uri)?;
        if query.has("mode") && !query.is_slice() {
            return Err(conflict(
                "the mode of this path is slice; other modes are rendered by /frame",
                "mode",
            ));
        }
        for (name, value) in [("mode", "slice"), ("layout", "color")] {
            if !query.has(name) {
                query.0.push((name.to_owned(), value.to_owned()));
            }
        }
        Ok(query)
    }

    fn is_slice(&self) -> bool {
        self.0.iter().any(|(name, value)| name == "mode" && value == "slice")
    }

    fn has(&self, name: &str) -> bool {
        self.0.iter().any(|(n, _)| n == name)
    }
}

/// A scene as ordered, before its gaps are filled for a volume.
#[derive(Debug)]
pub(super) struct SceneQuery {
    /// The text of the request.
    pub(super) file: SceneFile,
    /// The camera where it wrote none.
    pub(super) orbit: Orbit,
}

impl SceneQuery {
    /// The scene of a query.
    ///
    /// # Errors
    /// When a parameter is unknown, malformed, out of range or contradicts another.
    pub(super) fn from_query(query: &Query, grid: &Grid) -> Result<Self, Problem> {
        check_combination(query)?;
        let (mut scene, mut orbit) = (Map::new(), Orbit::default());
        if query.has("eye_mm") {
            let center = grid.center().xyz.to_array();
            set(&mut scene, "camera.look_at_mm", center.to_vec().into());
            if !query.has("height_mm") {
                let usual = orbit.vertical_fov_deg.into();
                set(&mut scene, "camera.projection.perspective.vertical_fov_deg", usual);
            }
        }
        for (name, text) in &query.0 {
            let parameter = PARAMETERS.iter().find(|parameter| parameter.name == name);
            let parameter = parameter.ok_or_else(|| unknown(name, &names()))?;
            parameter.apply(text, query, &mut scene, &mut orbit)?;
        }
        let json = Value::Object(scene).to_string();
        let file = SceneFile::parse(json.as_bytes())?;
        Ok(Self { file, orbit })
    }

    /// The scene of a JSON body.
    ///
    /// # Errors
    /// When it is not JSON, has an unknown key, or a value of the wrong kind.
    pub(super) fn from_body(body: &[u8]) -> Result<Self, Problem> {
        Ok(Self { file: SceneFile::parse(body)?, orbit: Orbit::default() })
    }
}

impl Parameter {
    /// Whether a problem with this JSON path is about this parameter.
    fn sets(&self, path: &str) -> bool {
        match self.target {
            Target::Key(known) => {
                path.strip_prefix(known).is_some_and(|rest| rest.is_empty() || rest.starts_with('['))
            }
            Target::Window => path.starts_with("transfer"),
            Target::ClipBox => path == "clip.box_mm",
            Target::Overlay => path == "overlays",
            Target::ClipSphere => path.starts_with("clip.sphere"),
            Target::ClipPlanes => path.starts_with("clip.planes"),
            Target::FieldOfView => path.ends_with(self.name),
            Target::View { camera, slice } => path == camera || path == slice,
            Target::Orbit(_) => path == self.name,
        }
    }

    fn apply(
        &self,
        text: &str,
        query: &Query,
        scene: &mut Map<String, Value>,
        orbit: &mut Orbit,
    ) -> Result<(), Problem> {
        let value = self.kind.read(self.name, text)?;
        match self.target {
            Target::Key(path) => set(scene, path, value),
            Target::View { slice, .. } if query.is_slice() => set(scene, slice, value),
            Target::View { camera, .. } => set(scene, camera, value),
            Target::FieldOfView if query.has("eye_mm") => {
                set(scene, "camera.projection.perspective.vertical_fov_deg", value);
            }
            Target::FieldOfView => orbit.vertical_fov_deg = number(self.name, text)?,
            Target::Orbit(part) => *part(orbit) = number(self.name, text)?,
            Target::Window => {
                set(scene, "transfer.window.center_hu", value[0].clone());
                set(scene, "transfer.window.width_hu", value[1].clone());
            }
            Target::Overlay => {
                for name in text.split(',') {
                    let known = Overlays::SWITCHES.iter().find(|(known, _)| *known == name);
                    let (_, key) =
                        known.ok_or_else(|| malformed(self.name, name, &Overlays::switch_names()))?;
                    set(scene, &format!("overlays.{key}"), true.into());
                }
            }
            Target::ClipSphere => {
                let numbers = value.as_array().map_or(&[][..], Vec::as_slice);
                set(scene, "clip.sphere.center_mm", numbers[..3].into());
                set(scene, "clip.sphere.radius_mm", numbers[3].clone());
            }
            Target::ClipPlanes => {
                let numbers = value.as_array().map_or(&[][..], Vec::as_slice);
                let plane =
                    |plane: &[Value]| serde_json::json!({ "point_mm": &plane[..3], "normal": &plane[3..] });
                set(scene, "clip.planes", numbers.chunks_exact(6).map(plane).collect());
            }
            Target::ClipBox => {
                let corners = value.as_array().map_or(&[][..], Vec::as_slice).chunks(3);
                set(scene, "clip.box_mm", corners.map(<[Value]>::to_vec).map(Value::from).collect());
            }
        }
        Ok(())
    }
}

impl ParameterType {
    fn read(self, name: &str, text: &str) -> Result<Value, Problem> {
        match self {
            Self::Text => Ok(text.into()),
            Self::Flag => {
                text.parse::<bool>().map(Value::from).map_err(|_| malformed(name, text, "true or false"))
            }
            Self::Number => number(name, text).map(Value::from),
            Self::Numbers(count) => {
                let values: Option<Vec<f64>> = text.split(',').map(finite).collect();
                let values = values.filter(|values| values.len() == count);
                values
                    .map(Value::from)
                    .ok_or_else(|| malformed(name, text, &format!("{count} numbers, a,b,...")))
            }
            Self::Groups(size) => {
                let allowed = format!("groups of {size} numbers, a,b,...");
                let values: Option<Vec<f64>> = text.split(',').map(finite).collect();
                let values = values.ok_or_else(|| malformed(name, text, &allowed))?;
                if values.len() % size == 0 {
                    Ok(values.into())
                } else {
                    Err(incomplete(name, &values, &allowed))
                }
            }
            Self::Labels => {
                let label = |word: &str| {
                    let word = word.trim();
                    word.parse::<u16>().map_or_else(|_| Value::from(word), Value::from)
                };
                Ok(text.split(',').map(label).collect::<Vec<_>>().into())
            }
            Self::Sets => ShownSets::parse(text).map(|shown| serde_json::json!(shown)).map_err(|reason| {
                malformed(name, text, &format!("true, false, or names of sets ({reason})"))
            }),
            Self::Whole(count) => {
                let values: Option<Vec<u32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
                let values = values.filter(|values| values.len() == count);
                let value =
                    values.map(|values| if count == 1 { values[0].into() } else { Value::from(values) });
                value.ok_or_else(|| malformed(name, text, &format!("{count} whole number(s), a,b")))
            }
        }
    }
}

/// Parameters that are valid by themselves, but not together.
fn conflict(detail: &str, parameter: &str) -> Problem {
    Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "conflicting-parameters", detail).with("path", parameter)
}

fn check_combination(query: &Query) -> Result<(), Problem> {
    for (a, b) in EXCLUSIVE {
        if query.has(a) && query.has(b) {
            return Err(conflict(&format!("{a} and {b} exclude each other"), b));
        }
    }
    let of_mode = if query.is_slice() { NEEDS_OF_SLICE } else { NEEDS_OF_VIEW };
    for (name, needed) in NEEDS.iter().chain(of_mode) {
        if query.has(name) && !query.has(needed) {
            return Err(conflict(&format!("{name} means nothing without {needed}"), name));
        }
    }
    Ok(())
}

/// Sets a key by its dotted path. The paths of [`PARAMETERS`] that may come together never cross.
fn set(scene: &mut Map<String, Value>, path: &str, value: Value) {
    match path.split_once('.') {
        None => {
            scene.insert(path.to_owned(), value);
        }
        Some((outer, rest)) => {
            let inner = scene.entry(outer).or_insert_with(|| Map::new().into());
            if let Value::Object(inner) = inner {
                set(inner, rest, value);
            }
        }
    }
}

impl Query {
    /// A problem about a JSON path, rewritten as one about the parameter that set it.
    pub(super) fn blame(&self, problem: Problem) -> Problem {
        let Some(path) = problem.path().map(str::to_owned) else { return problem };
        let about: Vec<&Parameter> = PARAMETERS.iter().filter(|parameter| parameter.sets(&path)).collect();
        // A value can be wrong beside one that is not there: a far limit before the volume's own
        // near limit.
        let named = about.iter().find(|parameter| self.has(parameter.name)).or(about.first());
        match named {
            Some(parameter) if parameter.name != path => problem.renamed(&path, parameter.name),
            _ => problem,
        }
    }
}

fn finite(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|value: &f64| value.is_finite())
}

fn number(name: &str, text: &str) -> Result<f64, Problem> {
    finite(text).ok_or_else(|| malformed(name, text, "a finite number"))
}

fn malformed(name: &str, text: &str, allowed: &str) -> Problem {
    let found: String = text.chars().take(60).collect();
    bad_parameter(format!("{name} is {found:?}, allowed: {allowed}"))
        .with("path", name)
        .with("found", found)
        .with("allowed", allowed)
}

/// A list of numbers whose last group is incomplete. The API description cannot express this rule, so
/// that the request follows it.
fn incomplete(name: &str, values: &[f64], allowed: &str) -> Problem {
    let detail = format!("{name} has {} numbers, allowed: {allowed}", values.len());
    Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "out-of-range", detail).with("path", name)
}

fn unknown(name: &str, allowed: &str) -> Problem {
    let name: String = name.chars().take(60).collect();
    let detail = format!("{name:?} is not a parameter, allowed: {allowed}");
    Problem::new(StatusCode::BAD_REQUEST, "unknown-parameter", detail)
        .with("path", name)
        .with("allowed", allowed)
}

fn names() -> String {
    PARAMETERS.iter().map(|parameter| parameter.name).collect::<Vec<_>>().join(", ")
}

fn bad_parameter(detail: impl std::fmt::Display) -> Problem {
    Problem::new(StatusCode::BAD_REQUEST, "malformed-parameter", detail)
}
