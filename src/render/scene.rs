//! The JSON form of a request: the same in a scene file, in an HTTP body and in a batch job.
//!
//! [`SceneFile`] is what was written, every part optional; [`SceneFile::resolve`] fills the gaps for a volume and
//! gives a [`Scene`] whose every value is in range. Errors name the key's path, the value and what is allowed.

use serde::Deserialize;

use super::request::{Clip, ClipPlane, DepthRule, Mode, RenderRequest, RequestError, Shading};
use crate::camera::{Camera, CameraError, Orbit, Projection};
use crate::display::DisplaySettings;
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
    /// The camera.
    #[error("camera: {0}")]
    Camera(#[from] CameraError),
    /// The transfer function.
    #[error("transfer: {0}")]
    Transfer(#[from] TransferError),
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

#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "a preset's name, {\"points\": [...]} or {\"window\": {...}}")]
enum TransferFile {
    Preset(String),
    Points(PointsFile),
    Window(WindowOuterFile),
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PointsFile {
    points: Vec<PointFile>,
    #[serde(default = "one_mm")]
    opacity_unit_mm: f64,
}

fn one_mm() -> f64 {
    1.0
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PointFile {
    hu: f64,
    rgba: [f64; 4],
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct WindowOuterFile {
    window: WindowFile,
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
    /// was not written becomes `orbit` around the volume.
    ///
    /// # Errors
    /// The first value out of range, with the key's path, the value and the allowed range.
    pub fn resolve(self, grid: &Grid, orbit: &Orbit) -> Result<Scene, SceneError> {
        let camera = match self.camera {
            Some(camera) => camera.resolve()?,
            None => orbit.camera(grid.center(), grid.bounding_radius_mm())?,
        };
        let (transfer, preset) = resolve_transfer(self.transfer)?;
        let finest = grid.spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
        let request = RenderRequest {
            camera,
            size_px: self.size_px.unwrap_or([960, 540]),
            mode: self.mode.map_or(Mode::Composite, ModeFile::resolve),
            transfer,
            shading: self.shading.map_or_else(|| default_shading(preset), ShadingFile::resolve),
            // Two samples a voxel: at one, sharp surfaces show rings where samples step over them.
            sample_distance_mm: self.sample_distance_mm.unwrap_or((finest / 2.0).clamp(0.1, 10.0)),
            depth: self.depth.map_or(Ok(DepthRule::Threshold { fraction: 0.5 }), DepthFile::resolve)?,
            clip: self.clip.unwrap_or_default().resolve()?,
            background_rgb: self.background_rgb.unwrap_or([0.0; 3]),
        };
        request.validate()?;
        Ok(Scene { request, display: self.display })
    }
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
        TransferFile::Points(PointsFile { points, opacity_unit_mm }) => {
            let points = points.into_iter().map(|PointFile { hu, rgba }| ControlPoint { hu, rgba }).collect();
            Ok((TransferFunction::new(points, opacity_unit_mm)?, None))
        }
        TransferFile::Window(WindowOuterFile { window }) => {
            Ok((TransferFunction::window(window.center_hu, window.width_hu)?, None))
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
            if !min.iter().zip(&max).all(|(low, high)| low < high && low.is_finite() && high.is_finite()) {
                return Err(RequestError::new(
                    "clip.box_mm",
                    &format!("{min:?} to {max:?}"),
                    "[min, max] with min < max",
                ));
            }
            clip.add_box(Point::from_xyz(min.into()), Point::from_xyz(max.into()));
        }
        clip.planes.extend(self.planes.into_iter().map(|PlaneFile { point_mm, normal }| ClipPlane {
            point: Point::from_xyz(point_mm.into()),
            normal: Vector::from_xyz(normal.into()),
        }));
        Ok(clip)
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
            (r#"{"transfer":{"window":{"center_hu":0,"width_hu":0}}}"#.to_owned(), &["window width is 0"]),
            (r#"{"depth":{"rule":"threshold","fraction":2}}"#.to_owned(), &["depth.fraction is 2", "to 1"]),
            (r#"{"shading":{"ambient":2,"diffuse":0}}"#.to_owned(), &["shading.ambient is 2", "0 to 1"]),
            (r#"{"clip":{"box_mm":[[0,0,0],[1,-1,1]]}}"#.to_owned(), &["clip.box_mm", "min < max"]),
            (
                r#"{"clip":{"planes":[{"point_mm":[0,0,0],"normal":[0,0,0]}]}}"#.to_owned(),
                &["clip.planes[0]"],
            ),
            (camera(r#"{"perspective":{"vertical_fov_deg":400}}"#), &["camera", "400", "0.1 to 170"]),
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
