//! How a cut face looks: where the volume's edge, a clip plane or the cut-away sphere opens a body.

use serde::Deserialize;
use serde_json::Value;

/// How cut faces look in mode composite.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum CutFaces {
    /// The colours of the transfer function, lit by the normal of the face.
    #[default]
    Lit,
    /// The slice of the volume in the plane of the face, in grey and without light. Values at or
    /// below the window are not painted: the rays go on there.
    Slice {
        /// Centre and width of the window, HU.
        window_hu: [f64; 2],
    },
}

impl CutFaces {
    /// The names in requests and on the command line.
    pub const NAMES: [&str; 2] = ["lit", "slice"];
    /// Widths that a window may have, HU.
    pub const WIDTHS_HU: std::ops::RangeInclusive<f64> = 1.0..=100_000.0;

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lit => Self::NAMES[0],
            Self::Slice { .. } => Self::NAMES[1],
        }
    }

    /// The lowest value of the window, and one over its width; HU. Zero without a slice.
    pub(crate) fn window(self) -> [f64; 2] {
        match self {
            Self::Lit => [0.0; 2],
            Self::Slice { window_hu: [center_hu, width_hu] } => [center_hu - 0.5 * width_hu, 1.0 / width_hu],
        }
    }
}

/// The value of `cut` in a request: a name, or a slice with a window of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CutChoice {
    /// Lit faces.
    Lit,
    /// Slices; without a window in that of the volume's body part.
    Slice {
        /// Centre and width, HU.
        window_hu: Option<[f64; 2]>,
    },
}

impl CutChoice {
    /// The choice of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "lit" => Some(Self::Lit),
            "slice" => Some(Self::Slice { window_hu: None }),
            _ => None,
        }
    }

    /// The faces, where `usual_window_hu` is the window of the volume's body part.
    pub(crate) fn resolve(self, usual_window_hu: [f64; 2]) -> CutFaces {
        match self {
            Self::Lit => CutFaces::Lit,
            Self::Slice { window_hu } => CutFaces::Slice { window_hu: window_hu.unwrap_or(usual_window_hu) },
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SliceFile {
    slice: WindowFile,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WindowFile {
    window_hu: [f64; 2],
}

impl<'de> Deserialize<'de> for CutChoice {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        use serde::de::Error;
        match Value::deserialize(deserializer)? {
            Value::String(name) => Self::from_name(&name).ok_or_else(|| {
                D::Error::custom(format!("unknown cut {name:?}, allowed: {}", CutFaces::NAMES.join(", ")))
            }),
            object @ Value::Object(_) => {
                let SliceFile { slice } = SliceFile::deserialize(object).map_err(D::Error::custom)?;
                Ok(Self::Slice { window_hu: Some(slice.window_hu) })
            }
            _ => Err(D::Error::custom(
                "expected \"lit\", \"slice\", or {\"slice\": {\"window_hu\": [center, width]}}",
            )),
        }
    }
}
