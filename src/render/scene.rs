//! The JSON form of a request: the same in a scene file, in an HTTP body and in a batch job.
//!
//! [`SceneFile`] is what was written, every part optional; [`SceneFile::resolve`] fills the gaps for a volume and
//! gives a [`Scene`] whose every value is in range. Errors name the key's path, the value and what is allowed.

use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer};

use super::request::{Clip, ClipPlane, DepthRule, Mode, RenderRequest, RequestError, Shading};
use crate::camera::{Camera, CameraError, Orbit, OrbitError, Projection};
use crate::display::{DisplaySettings, SettingsError};
use crate::space::{Point, Vector};
use crate::transfer::{ControlPoint, PRESETS, Preset, TransferError, TransferFunction, preset};
use crate::volume::Grid;

/// A picture to render and how to show it.
#[derive(Clone, Debug)]
pub struct Scene {
    /// What the renderer does.
    pub request: RenderRequest,
    /// What becomes of the picture.
    pub display: DisplaySettings,
}

impl Scene {
    /// Checks that the picture has the size that its layout needs: of those who write a frame in that layout.
    ///
    /// # Errors
    /// With both sizes when it has another.
    pub fn expect_size_of_layout(&self) -> Result<(), SceneError> {
        let found = self.request.size_px;
        match self.display.encoder()?.render_size_px() {
            Some([width, height]) if found != [width, height] => {
                let layout = self.display.layout;
                let allowed =
                    format!("{width} x {height}, which layout {layout} needs (rgbd and color take any)");
                Err(RequestError::new("size_px", &format!("{} x {}", found[0], found[1]), &allowed).into())
            }
            _ => Ok(()),
        }
    }
}

/// A scene as written in JSON.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SceneFile {
    camera: Option<CameraFile>,
    size_px: Option<[u32; 2]>,
    mode: Option<ModeFile>,
    transfer: Option<TransferFile>,
    shading: Option<ShadingFile>,
    sample_distance_mm: Option<f64>,
    depth: Option<DepthFile>,
    clip: Option<ClipFile>,
    background_rgb: Option<[f64; 3]>,
    display: DisplaySettings,
}

/// Why a scene was refused.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// Not JSON, an unknown key, or a value of the wrong kind.
    #[error("{path}: {reason}")]
    Syntax {
        /// Key path; `.` for the whole.
        path: String,
        /// The parser's words, with line and column.
        reason: String,
    },
    /// A value out of range.
    #[error(transparent)]
    Range(#[from] RequestError),
}

impl From<SettingsError> for SceneError {
    fn from(SettingsError { path, value, allowed }: SettingsError) -> Self {
        RequestError { path: path.to_owned(), found: value, allowed }.into()
    }
}

impl From<OrbitError> for SceneError {
    fn from(OrbitError { what, found, allowed }: OrbitError) -> Self {
        RequestError { path: what.to_owned(), found: found.to_string(), allowed }.into()
    }
}

impl From<CameraError> for RequestError {
    fn from(error: CameraError) -> Self {
        let coordinates = "-1000000 to 1000000 mm";
        match &error {
            CameraError::Coordinate { what: "up", found } => Self::new("camera.up", found, coordinates),
            CameraError::Coordinate { what, found } => {
                Self::new(&format!("camera.{what}_mm"), found, coordinates)
            }
            CameraError::NoDirection(mm) => {
                Self::new("camera.look_at_mm", &format!("{mm} mm from eye_mm"), "at least 0.001 mm")
            }
            CameraError::NoUp(up) => {
                Self::new("camera.up", &format!("{up:?}"), "any direction across the viewing direction")
            }
            CameraError::FieldOfView(degrees) => {
                Self::new("camera.projection.perspective.vertical_fov_deg", degrees, "0.1 to 170")
            }
            CameraError::Height(mm) => {
                Self::new("camera.projection.orthographic.height_mm", mm, "0.001 to 1000000")
            }
        }
    }
}

impl From<TransferError> for RequestError {
    fn from(error: TransferError) -> Self {
        match &error {
            TransferError::Count(count) => {
                let allowed = format!("1 to {} points", TransferFunction::MAX_POINTS);
                Self::new("transfer.points", &format!("{count} points"), &allowed)
            }
            TransferError::Order { index, found, previous } => {
                let allowed = format!("more than {previous}, that of the point before");
                Self::new(&format!("transfer.points[{index}].hu"), found, &allowed)
            }
            TransferError::Value { index, what: "HU", found, allowed } => {
                Self::new(&format!("transfer.points[{index}].hu"), found, allowed)
            }
            TransferError::Value { index, found, allowed, .. } => {
                Self::new(&format!("transfer.points[{index}].rgba"), found, allowed)
            }
            TransferError::Unit(mm) => Self::new("transfer.opacity_unit_mm", mm, "0.001 to 1000"),
            TransferError::Window { what, found, allowed } => {
                Self::new(&format!("transfer.window.{what}"), found, allowed)
            }
        }
    }
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    eye_mm: [f64; 3],
    look_at_mm: [f64; 3],
    #[serde(default = "head_up")]
    up: [f64; 3],
    projection: ProjectionFile,
}

fn head_up() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
enum ProjectionFile {
    Perspective { vertical_fov_deg: f64 },
    Orthographic { height_mm: f64 },
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
enum ModeFile {
    Composite,
    Mip,
}

/// A preset's name, or control points, or a window.
#[derive(Clone, Debug)]
enum TransferFile {
    Preset(String),
    Function(FunctionFile),
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct FunctionFile {
    points: Option<Vec<PointFile>>,
    opacity_unit_mm: Option<f64>,
    window: Option<WindowFile>,
}

/// By hand, since serde's untagged enums forget where in the points a mistake is.
impl<'de> Deserialize<'de> for TransferFile {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct PresetOrFunction;
        impl<'de> Visitor<'de> for PresetOrFunction {
            type Value = TransferFile;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                write!(f, "a preset's name, {{\"points\": [...]}} or {{\"window\": {{...}}}}")
            }

            fn visit_str<E: serde::de::Error>(self, name: &str) -> Result<TransferFile, E> {
                Ok(TransferFile::Preset(name.to_owned()))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<TransferFile, A::Error> {
                FunctionFile::deserialize(MapAccessDeserializer::new(map)).map(TransferFile::Function)
            }
        }
        deserializer.deserialize_any(PresetOrFunction)
    }
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PointFile {
    hu: f64,
    rgba: [f64; 4],
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct WindowFile {
    center_hu: f64,
    width_hu: f64,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ShadingFile {
    ambient: f64,
    diffuse: f64,
    #[serde(default)]
    specular: f64,
    #[serde(default = "soft_highlight")]
    shininess: f64,
}

fn soft_highlight() -> f64 {
    10.0
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct DepthFile {
    rule: DepthRuleFile,
    fraction: Option<f64>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum DepthRuleFile {
    FirstHit,
    Threshold,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct ClipFile {
    box_mm: Option<[[f64; 3]; 2]>,
    planes: Vec<PlaneFile>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlaneFile {
    point_mm: [f64; 3],
    normal: [f64; 3],
}

impl SceneFile {
    /// Reads the JSON form.
    ///
    /// # Errors
    /// When it is not JSON, has an unknown key, or a value of the wrong kind; with the key's path.
    pub fn parse(json: &[u8]) -> Result<Self, SceneError> {
        expect_objects(json)?;
        let mut reader = serde_json::Deserializer::from_slice(json);
        let scene = serde_path_to_error::deserialize(&mut reader).map_err(|error| SceneError::Syntax {
            path: error.path().to_string(),
            reason: error.inner().to_string(),
        })?;
        reader.end().map_err(|error| SceneError::Syntax { path: ".".into(), reason: error.to_string() })?;
        Ok(scene)
    }

    /// Replaces the transfer function by a preset of this name.
    #[must_use]
    pub fn with_preset(self, name: &str) -> Self {
        Self { transfer: Some(TransferFile::Preset(name.to_owned())), shading: None, ..self }
    }

    /// Replaces the size of the picture.
    #[must_use]
    pub fn with_size(self, size_px: [u32; 2]) -> Self {
        Self { size_px: Some(size_px), ..self }
    }

    /// Leaves the size to the layout.
    #[must_use]
    pub fn with_size_of_layout(self) -> Self {
        Self { size_px: None, ..self }
    }

    /// Replaces the display settings.
    #[must_use]
    pub fn with_display(self, display: DisplaySettings) -> Self {
        Self { display, ..self }
    }

    /// How the picture is to be shown.
    #[must_use]
    pub fn display(&self) -> &DisplaySettings {
        &self.display
    }

    /// Whether the file says where the eye is.
    #[must_use]
    pub fn has_camera(&self) -> bool {
        self.camera.is_some()
    }

    /// The complete scene for a volume on `grid`: parts that were not written get their defaults, and a camera that
    /// was not written becomes `orbit` around the volume. A size that was not written is the layout's.
    ///
    /// # Errors
    /// The first value out of range, with the key's path, the value and the allowed range.
    pub fn resolve(self, grid: &Grid, orbit: &Orbit) -> Result<Scene, SceneError> {
        self.display.validate()?;
        let size_of_layout = self.display.encoder()?.render_size_px();
        let camera = match self.camera {
            Some(camera) => camera.resolve(),
            None => {
                orbit.validate()?;
                orbit.camera(grid.center(), grid.bounding_radius_mm())
            }
        };
        let (transfer, preset) = resolve_transfer(self.transfer)?;
        let finest = grid.spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
        let request = RenderRequest {
            camera: camera.map_err(RequestError::from)?,
            size_px: self.size_px.or(size_of_layout).unwrap_or([960, 540]),
            mode: self.mode.map_or(Mode::Composite, ModeFile::resolve),
            transfer,
            shading: self.shading.map_or_else(|| default_shading(preset), ShadingFile::resolve),
            // Two samples a voxel: at one, sharp surfaces show rings where samples step over them.
            sample_distance_mm: self.sample_distance_mm.unwrap_or((finest / 2.0).clamp(0.1, 10.0)),
            depth: self.depth.map_or(Ok(DepthRule::Threshold { fraction: 0.5 }), DepthFile::resolve)?,
            clip: self.clip.unwrap_or_default().resolve()?,
            background_rgb: self.background_rgb.unwrap_or([0.0; 3]),
        };
        request.validate_on(grid)?;
        Ok(Scene { request, display: self.display })
    }
}

/// Refuses arrays where the format has objects: serde would read them as an object's values in order.
///
/// What is no JSON at all passes: the parser proper says where it goes wrong.
fn expect_objects(json: &[u8]) -> Result<(), SceneError> {
    const OBJECTS: [&str; 10] = [
        "",
        "/camera",
        "/camera/projection",
        "/camera/projection/perspective",
        "/camera/projection/orthographic",
        "/transfer",
        "/transfer/window",
        "/shading",
        "/depth",
        "/clip",
    ];
    let Ok(scene) = serde_json::from_slice::<serde_json::Value>(json) else { return Ok(()) };
    let lists = ["/transfer/points", "/clip/planes"].into_iter().flat_map(|list| {
        let items = scene.pointer(list).and_then(serde_json::Value::as_array).map_or(0, Vec::len);
        (0..items).map(move |i| format!("{list}/{i}"))
    });
    let paths = OBJECTS.into_iter().chain(["/display"]).map(str::to_owned).chain(lists);
    for path in paths {
        if scene.pointer(&path).is_some_and(serde_json::Value::is_array) {
            let path = path.trim_start_matches('/').replace('/', ".");
            let path = if path.is_empty() { ".".to_owned() } else { path };
            return Err(SceneError::Syntax { path, reason: "found an array, expected an object".to_owned() });
        }
    }
    Ok(())
}

impl CameraFile {
    fn resolve(self) -> Result<Camera, CameraError> {
        let projection = match self.projection {
            ProjectionFile::Perspective { vertical_fov_deg } => {
                Projection::Perspective { vertical_fov: vertical_fov_deg.to_radians() }
            }
            ProjectionFile::Orthographic { height_mm } => Projection::Orthographic { height_mm },
        };
        let (eye, look_at) = (self.eye_mm.into(), self.look_at_mm.into());
        let up = Vector::from_xyz(self.up.into());
        Camera::new(Point::from_xyz(eye), Point::from_xyz(look_at), up, projection)
    }
}

impl ModeFile {
    fn resolve(self) -> Mode {
        match self {
            Self::Composite => Mode::Composite,
            Self::Mip => Mode::Mip,
        }
    }
}

/// The transfer function, and the preset it came from.
fn resolve_transfer(
    file: Option<TransferFile>,
) -> Result<(TransferFunction, Option<&'static Preset>), SceneError> {
    match file.unwrap_or(TransferFile::Preset(PRESETS[0].name.to_owned())) {
        TransferFile::Preset(name) => {
            let found = preset(&name).ok_or_else(|| RequestError::new("transfer", &name, &preset_names()))?;
            Ok((found.transfer(), Some(found)))
        }
        TransferFile::Function(FunctionFile { points: Some(points), opacity_unit_mm, window: None }) => {
            let points = points.into_iter().map(|PointFile { hu, rgba }| ControlPoint { hu, rgba }).collect();
            let transfer = TransferFunction::new(points, opacity_unit_mm.unwrap_or(1.0));
            Ok((transfer.map_err(RequestError::from)?, None))
        }
        TransferFile::Function(FunctionFile {
            points: None,
            opacity_unit_mm: None,
            window: Some(window),
        }) => {
            let transfer = TransferFunction::window(window.center_hu, window.width_hu);
            Ok((transfer.map_err(RequestError::from)?, None))
        }
        TransferFile::Function(_) => {
            let allowed = "either points (and opacity_unit_mm) or a window";
            Err(RequestError::new("transfer", &"neither or both", allowed).into())
        }
    }
}

fn preset_names() -> String {
    PRESETS.iter().map(|preset| preset.name).collect::<Vec<_>>().join(", ")
}

fn default_shading(preset: Option<&Preset>) -> Shading {
    let ([ambient, diffuse, specular], shininess) =
        preset.map_or(([0.2, 0.8, 0.0], 10.0), |preset| (preset.light, preset.shininess));
    Shading { ambient, diffuse, specular, shininess }
}

impl ShadingFile {
    fn resolve(self) -> Shading {
        let Self { ambient, diffuse, specular, shininess } = self;
        Shading { ambient, diffuse, specular, shininess }
    }
}

impl DepthFile {
    fn resolve(self) -> Result<DepthRule, RequestError> {
        match (self.rule, self.fraction) {
            (DepthRuleFile::FirstHit, None) => Ok(DepthRule::FirstHit),
            (DepthRuleFile::FirstHit, Some(fraction)) => {
                Err(RequestError::new("depth.fraction", &fraction, "nothing beside rule first-hit"))
            }
            (DepthRuleFile::Threshold, fraction) => {
                Ok(DepthRule::Threshold { fraction: fraction.unwrap_or(0.5) })
            }
        }
    }
}

impl ClipFile {
    fn resolve(self) -> Result<Clip, RequestError> {
        let mut clip = Clip::default();
        if let Some([min, max]) = self.box_mm {
            if !min.iter().zip(&max).all(|(low, high)| low < high && -1e6 <= *low && *high <= 1e6) {
                return Err(RequestError::new(
                    "clip.box_mm",
                    &format!("{min:?} to {max:?}"),
                    "[min, max] with min < max, within 1000000 mm",
                ));
            }
            clip.add_box(Point::from_xyz(min.into()), Point::from_xyz(max.into()));
        }
        for (i, plane) in self.planes.into_iter().enumerate() {
            clip.planes.push(plane.resolve(i)?);
        }
        Ok(clip)
    }
}

impl PlaneFile {
    fn resolve(self, index: usize) -> Result<ClipPlane, RequestError> {
        let Self { point_mm, normal } = self;
        let path = |key: &str| format!("clip.planes[{index}].{key}");
        if point_mm.iter().any(|mm| !(-1e6..=1e6).contains(mm)) {
            let allowed = "-1000000 to 1000000 mm each";
            return Err(RequestError::new(&path("point_mm"), &format!("{point_mm:?}"), allowed));
        }
        let plane =
            ClipPlane { point: Point::from_xyz(point_mm.into()), normal: Vector::from_xyz(normal.into()) };
        match plane.normal.normalized() {
            Some(_) => Ok(plane),
            None => {
                let allowed = "a direction of finite length above zero";
                Err(RequestError::new(&path("normal"), &format!("{normal:?}"), allowed))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Grid {
        Grid::axis_aligned([10, 10, 10], [1.0; 3], [0.0; 3]).unwrap()
    }

    fn refused(json: &str) -> String {
        let resolved =
            SceneFile::parse(json.as_bytes()).and_then(|scene| scene.resolve(&grid(), &Orbit::default()));
        resolved.expect_err("a refusal").to_string()
    }

    #[test]
    fn an_empty_scene_has_sane_defaults() {
        let scene = SceneFile::parse(b"{}").unwrap().resolve(&grid(), &Orbit::default()).unwrap();
        assert_eq!(scene.request.size_px, [960, 540]);
        assert_eq!(scene.request.mode, Mode::Composite);
        assert_eq!(scene.request.depth, DepthRule::Threshold { fraction: 0.5 });
        assert_eq!(scene.request.sample_distance_mm, 0.5);
    }

    #[test]
    fn every_part_that_is_wrong_is_named_with_path_value_and_range() {
        let camera = |projection: &str| {
            format!(r#"{{"camera":{{"eye_mm":[0,-9,0],"look_at_mm":[0,0,0],"projection":{projection}}}}}"#)
        };
        for (json, parts) in [
            (r#"{"sise_px":[1,1]}"#.to_owned(), &["sise_px", "unknown field"][..]),
            (r#"{"sample_distance_mm":0}"#.to_owned(), &["sample_distance_mm is 0", "0.01 to 100"]),
            (r#"{"sample_distance_mm":1e999}"#.to_owned(), &["sample_distance_mm", "out of range"]),
            (r#"{"size_px":[0,5]}"#.to_owned(), &["size_px is 0", "1 to 8192"]),
            (r#"{"mode":"xray"}"#.to_owned(), &["mode", "xray", "composite", "mip"]),
            (r#"{"transfer":"bones"}"#.to_owned(), &["transfer is bones", "bone, skin"]),
            (
                r#"{"transfer":{"window":{"center_hu":0,"width_hu":0}}}"#.to_owned(),
                &["transfer.window.width_hu is 0", "1 to 65536"],
            ),
            (
                r#"{"transfer":{"points":[{"hu":1,"rgba":[0,0,0,0]},{"hu":1,"rgba":[0,0,0,0]}]}}"#.to_owned(),
                &["transfer.points[1].hu is 1", "more than 1"],
            ),
            (
                r#"{"transfer":{"points":[{"hu":1,"rgba":[0,0,0,2]}]}}"#.to_owned(),
                &["transfer.points[0].rgba is 2", "0 to 1"],
            ),
            (
                r#"{"transfer":{"points":[{"hu":1,"rgb":[0,0,0]}]}}"#.to_owned(),
                &["transfer.points[0]", "rgb"],
            ),
            (r#"{"transfer":{}}"#.to_owned(), &["transfer is neither or both"]),
            ("[]".to_owned(), &["found an array, expected an object"]),
            (r#"{"shading":[0.2,0.8,0,10]}"#.to_owned(), &["shading: found an array"]),
            (r#"{"transfer":{"points":[[1,[0,0,0,0]]]}}"#.to_owned(), &["transfer.points.0: found an array"]),
            (r#"{"size_px":[8192,8192]}"#.to_owned(), &["size_px is 8192 x 8192", "at most 16777216 pixels"]),
            (r#"{"depth":{"rule":"threshold","fraction":2}}"#.to_owned(), &["depth.fraction is 2", "to 1"]),
            (r#"{"shading":{"ambient":2,"diffuse":0}}"#.to_owned(), &["shading.ambient is 2", "0 to 1"]),
            (r#"{"clip":{"box_mm":[[0,0,0],[1,-1,1]]}}"#.to_owned(), &["clip.box_mm", "min < max"]),
            (
                r#"{"clip":{"planes":[{"point_mm":[0,0,0],"normal":[0,0,0]}]}}"#.to_owned(),
                &["clip.planes[0].normal is [0.0, 0.0, 0.0]"],
            ),
            (
                camera(r#"{"perspective":{"vertical_fov_deg":400}}"#),
                &["camera.projection.perspective.vertical_fov_deg is 400", "0.1 to 170"],
            ),
            (camera(r#"{"fisheye":{}}"#), &["camera.projection", "fisheye"]),
            ("{} trailing".to_owned(), &["trailing"]),
        ] {
            let message = refused(&json);
            for part in parts {
                assert!(message.contains(part), "{json}: {message:?} lacks {part:?}");
            }
        }
    }
}
