//! The parts of a scene as written in JSON, and what each becomes.

use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer};

use super::SceneError;
use super::labels::{ClipLabelsFile, label_objects};
use super::overlays::OverlaysFile;
use crate::mode::Mode;
use crate::request::{Clip, ClipPlane, ClipSphere, DepthRule, Shading};
use crate::request_error::RequestError;
use relief_base::{Point, Vector};
use relief_display::DisplaySettings;
use relief_volume::{
    ControlPoint, GradientOpacity, PRESETS, Preset, PresetMode, TransferFunction, Window, WindowMap, preset,
};

/// A preset's name, or control points, or a window.
#[derive(Clone, Debug)]
pub(super) enum TransferFile {
    Preset(String),
    Function(FunctionFile),
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FunctionFile {
    points: Option<Vec<PointFile>>,
    opacity_unit_mm: Option<f64>,
    gradient_opacity: Option<GradientFile>,
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
struct GradientFile {
    points: Vec<GradientPointFile>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct GradientPointFile {
    hu_per_mm: f64,
    opacity: f64,
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
    #[serde(default)]
    invert: bool,
    #[serde(default)]
    map: WindowMapFile,
}

#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
enum WindowMapFile {
    #[default]
    Grey,
    Hot,
    Ice,
}

impl WindowMapFile {
    fn resolve(self) -> WindowMap {
        match self {
            Self::Grey => WindowMap::Grey,
            Self::Hot => WindowMap::Hot,
            Self::Ice => WindowMap::Ice,
        }
    }
}

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
            return Err(SceneError::Syntax { path, reason: "found an array, expected an object".to_owned() });
        }
    }
    Ok(())
}

/// The items of the overlays, and what each says.
fn overlay_items(scene: &serde_json::Value) -> impl Iterator<Item = String> {
    let items = scene.pointer("/overlays/items").and_then(serde_json::Value::as_array).map_or(0, Vec::len);
    (0..items).flat_map(|i| {
        let item = format!("/overlays/items/{i}");
        let inner = OverlaysFile::KINDS.map(|kind| format!("{item}/{kind}"));
        std::iter::once(item).chain(inner)
    })
}

impl TransferFile {
    pub(super) fn window(center_hu: f64, width_hu: f64) -> Self {
        let window = Some(WindowFile { center_hu, width_hu, invert: false, map: WindowMapFile::Grey });
        Self::Function(FunctionFile { points: None, opacity_unit_mm: None, gradient_opacity: None, window })
    }
}

/// The transfer function of a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Windows {
    /// White of rising opacity, for rays.
    Translucent,
    /// Opaque grey, for slices; one for soft tissue where there is no transfer function at all.
    Opaque,
}

impl Windows {
    fn transfer(
        self,
        &WindowFile { center_hu, width_hu, map, invert }: &WindowFile,
    ) -> Result<TransferFunction, RequestError> {
        let window = Window { center_hu, width_hu, map: map.resolve(), is_inverted: invert };
        let made = match self {
            Self::Translucent => window.translucent(),
            Self::Opaque => window.opaque(),
        };
        made.map_err(RequestError::from)
    }

    fn default_transfer(self) -> TransferFile {
        match self {
            Self::Translucent => TransferFile::Preset(PRESETS[0].name.to_owned()),
            Self::Opaque => TransferFile::window(40.0, 400.0),
        }
    }
}

/// The transfer function, and the preset it came from.
pub(super) fn resolve_transfer(
    file: Option<TransferFile>,
    windows: Windows,
) -> Result<(TransferFunction, Option<&'static Preset>), SceneError> {
    match file.unwrap_or_else(|| windows.default_transfer()) {
        TransferFile::Preset(name) => {
            let found = preset(&name).ok_or_else(|| RequestError::new("transfer", &name, &preset_names()))?;
            Ok((found.transfer(), Some(found)))
        }
        TransferFile::Function(FunctionFile {
            points: Some(points),
            opacity_unit_mm,
            gradient_opacity,
            window: None,
        }) => {
            let points = points.into_iter().map(|PointFile { hu, rgba }| ControlPoint { hu, rgba }).collect();
            let transfer = TransferFunction::new(points, opacity_unit_mm.unwrap_or(1.0));
            let transfer = transfer.map_err(RequestError::from)?;
            Ok((with_gradient_opacity(transfer, gradient_opacity)?, None))
        }
        TransferFile::Function(FunctionFile {
            points: None,
            opacity_unit_mm: None,
            gradient_opacity: None,
            window: Some(window),
        }) => Ok((windows.transfer(&window)?, None)),
        TransferFile::Function(_) => {
            let allowed = "either points (and opacity_unit_mm, gradient_opacity) or a window";
            Err(RequestError::new("transfer", &"neither or both", allowed).into())
        }
    }
}

fn with_gradient_opacity(
    transfer: TransferFunction,
    file: Option<GradientFile>,
) -> Result<TransferFunction, RequestError> {
    let Some(GradientFile { points }) = file else { return Ok(transfer) };
    let points = points.into_iter().map(|point| [point.hu_per_mm, point.opacity]).collect();
    Ok(transfer.with_gradient_opacity(GradientOpacity::new(points)?))
}

fn preset_names() -> String {
    PRESETS.iter().map(|preset| preset.name).collect::<Vec<_>>().join(", ")
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
    /// What applies where nothing was written: the rule that the layout needs.
    pub(super) fn usual(display: &DisplaySettings) -> Self {
        let fraction = DepthRule::USUAL_FRACTION;
        Self::of_rule(if display.layout.needs_background() {
            DepthRule::TwoLayer { fraction }
        } else {
            DepthRule::Threshold { fraction }
        })
    }

    pub(super) fn of_rule(rule: DepthRule) -> Self {
        Self { rule, fraction: None }
    }

    pub(super) fn resolve(self) -> Result<DepthRule, RequestError> {
        let Some(fraction) = self.fraction else { return Ok(self.rule) };
        self.rule.with_fraction(fraction).ok_or_else(|| {
            let allowed = format!("nothing beside rule {}", self.rule.name());
            RequestError::new("depth.fraction", &fraction, &allowed)
        })
    }
}

impl ClipFile {
    pub(super) fn resolve(self) -> Result<Clip, RequestError> {
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
        clip.sphere = self.sphere.map(|SphereFile { center_mm, radius_mm }| ClipSphere {
            center: Point::from_xyz(center_mm.into()),
            radius_mm,
        });
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
