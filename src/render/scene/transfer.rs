//! A scene's transfer function as written in JSON, and its resolved form.

use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer};

use super::SceneError;
use super::error::transfer_out_of_range;
use relief_base::OutOfRange;
use relief_volume::{
    Anatomy, ControlPoint, GradientOpacity, PRESETS, Preset, TransferFunction, Window, WindowMap, preset,
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
    /// Opaque grey, for slices.
    Opaque,
}

impl Windows {
    fn transfer(
        self,
        &WindowFile { center_hu, width_hu, map, invert }: &WindowFile,
    ) -> Result<TransferFunction, OutOfRange> {
        let window = Window { center_hu, width_hu, map: map.resolve(), is_inverted: invert };
        let made = match self {
            Self::Translucent => window.translucent(),
            Self::Opaque => window.opaque(),
        };
        made.map_err(transfer_out_of_range)
    }

    /// The transfer function that suits the anatomy; without one the first preset, or a window for
    /// soft tissue. Values that are not HU have a window over all of them.
    fn default_transfer(self, anatomy: Option<Anatomy>) -> TransferFile {
        let preset = anatomy.map_or(Some(&PRESETS[0]), Anatomy::preset);
        match preset.filter(|_| self == Self::Translucent) {
            Some(preset) => TransferFile::Preset(preset.name.to_owned()),
            None => {
                let [center_hu, width_hu] = usual_window_hu(anatomy);
                TransferFile::window(center_hu, width_hu)
            }
        }
    }
}

/// Centre and width of the window that suits the anatomy; without one that for soft tissue, HU.
pub(super) fn usual_window_hu(anatomy: Option<Anatomy>) -> [f64; 2] {
    anatomy.map_or([40.0, 400.0], Anatomy::window_hu)
}

/// The transfer function, and the preset it came from. Opacities whose unit is not written are per
/// `unit_mm` (see [`relief_volume::Grid::unit_mm`]).
pub(super) fn resolve_transfer(
    file: Option<TransferFile>,
    windows: Windows,
    anatomy: Option<Anatomy>,
    unit_mm: f64,
) -> Result<(TransferFunction, Option<&'static Preset>), SceneError> {
    match file.unwrap_or_else(|| windows.default_transfer(anatomy)) {
        TransferFile::Preset(name) => {
            let found = preset(&name).ok_or_else(|| OutOfRange::new("transfer", name, preset_names()))?;
            Ok((found.transfer().scaled(unit_mm), Some(found)))
        }
        TransferFile::Function(FunctionFile {
            points: Some(points),
            opacity_unit_mm,
            gradient_opacity,
            window: None,
        }) => {
            let points = points.into_iter().map(|PointFile { hu, rgba }| ControlPoint { hu, rgba }).collect();
            let transfer = TransferFunction::new(points, opacity_unit_mm.unwrap_or(unit_mm));
            let transfer = transfer.map_err(transfer_out_of_range)?;
            Ok((with_gradient_opacity(transfer, gradient_opacity)?, None))
        }
        TransferFile::Function(FunctionFile {
            points: None,
            opacity_unit_mm: None,
            gradient_opacity: None,
            window: Some(window),
        }) => Ok((windows.transfer(&window)?.scaled(unit_mm), None)),
        TransferFile::Function(_) => {
            let allowed = "either points (and opacity_unit_mm, gradient_opacity) or a window";
            Err(OutOfRange::new("transfer", "neither or both", allowed).into())
        }
    }
}

fn with_gradient_opacity(
    transfer: TransferFunction,
    file: Option<GradientFile>,
) -> Result<TransferFunction, OutOfRange> {
    let Some(GradientFile { points }) = file else { return Ok(transfer) };
    let points = points.into_iter().map(|point| [point.hu_per_mm, point.opacity]).collect();
    Ok(transfer.with_gradient_opacity(GradientOpacity::new(points).map_err(transfer_out_of_range)?))
}

fn preset_names() -> String {
    PRESETS.iter().map(|preset| preset.name).collect::<Vec<_>>().join(", ")
}
