//! Settings of a view.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::interaction::GrabMode;
use relief_annotation::ShownSets;
use relief_display::DisplaySettings;

/// Settings of a view. An omitted setting stays.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// A merge patch (RFC 7396) of the scene, in the JSON of a request without `camera`, `size_px`,
    /// `display` and `budget_ms`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scene: Option<Map<String, Value>>,
    /// The display, as in a request; replaces the previous display settings.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub display: Option<DisplaySettings>,
    /// Size of the picture; where the layout fixes the size, only that size is valid.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size_px: Option<[u32; 2]>,
    /// The annotations that are drawn: `false`, `true`, or sets by their names. While any are,
    /// `place` sets landmarks down and `undo` takes back edits.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub annotations: Option<ShownSets>,
    /// A preset by its name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preset: Option<String>,
    /// Another volume, by its id.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume: Option<String>,
    /// A phase of the volume's series, by its number; the camera stays.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub phase: Option<usize>,
    /// Whether the phases of the volume's series are shown one after the other: `false`, or their
    /// number per second.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub play: Option<Play>,
    /// The time budget of a picture while the view moves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quality: Option<Quality>,
    /// The movements that B allows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub grab_mode: Option<GrabMode>,
    /// The target that a placed landmark snaps to: `false`, or a target.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub snap: Option<SnapTo>,
}

/// The target that a placed landmark snaps to.
#[derive(Clone, Debug, PartialEq)]
pub enum SnapTo {
    /// Nothing: they stay under the cursor.
    Nothing,
    /// The nearest of a kind.
    Target(SnapTarget),
}

/// A kind of place, as `POST /v1/volumes/{id}/annotations/snap` takes it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SnapTarget {
    /// Its name.
    pub to: String,
    /// The level of a surface, HU.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hu: Option<f64>,
    /// The largest distance, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius_mm: Option<f64>,
}

impl Serialize for SnapTo {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Nothing => serializer.serialize_bool(false),
            Self::Target(target) => target.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for SnapTo {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        use serde::de::Error;
        match Value::deserialize(deserializer)? {
            Value::Bool(false) => Ok(Self::Nothing),
            object @ Value::Object(_) => {
                SnapTarget::deserialize(object).map(Self::Target).map_err(D::Error::custom)
            }
            _ => Err(D::Error::custom("expected false or {\"to\": a kind of place}")),
        }
    }
}

/// How the phases of a series play.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Play {
    /// They do not.
    Stopped,
    /// One after the other, the first behind the last.
    Phases {
        /// Phases per second; see [`Play::PER_S`]. A slower renderer leaves phases out.
        per_s: f64,
    },
}

impl Play {
    /// Phases per second that can be shown.
    pub const PER_S: std::ops::RangeInclusive<f64> = 0.1..=60.0;
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PhasesFile {
    phases_per_s: f64,
}

impl Serialize for Play {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match *self {
            Self::Stopped => serializer.serialize_bool(false),
            Self::Phases { per_s } => PhasesFile { phases_per_s: per_s }.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Play {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        use serde::de::Error;
        match Value::deserialize(deserializer)? {
            Value::Bool(false) => Ok(Self::Stopped),
            object @ Value::Object(_) => {
                let PhasesFile { phases_per_s } =
                    PhasesFile::deserialize(object).map_err(D::Error::custom)?;
                if !Self::PER_S.contains(&phases_per_s) {
                    let (low, high) = (Self::PER_S.start(), Self::PER_S.end());
                    let found = format!("phases_per_s is {phases_per_s}, allowed: {low} to {high}");
                    return Err(D::Error::custom(found));
                }
                Ok(Self::Phases { per_s: phases_per_s })
            }
            _ => Err(D::Error::custom("expected false or {\"phases_per_s\": 0.1 to 60}")),
        }
    }
}

/// The time budget of a picture while the view moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Quality {
    /// Computed from the measured speed of the connection and of the renderer.
    Auto,
    /// A time budget of rendering in ms, and JPEG of the default quality.
    Budget {
        /// Milliseconds; 1 to 60000.
        budget_ms: f64,
    },
}

impl Serialize for Quality {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Auto => serializer.serialize_str("auto"),
            Self::Budget { budget_ms } => BudgetFile { budget_ms: *budget_ms }.serialize(serializer),
        }
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BudgetFile {
    budget_ms: f64,
}

impl<'de> Deserialize<'de> for Quality {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        use serde::de::Error;
        match Value::deserialize(deserializer)? {
            Value::String(word) if word == "auto" => Ok(Self::Auto),
            object @ Value::Object(_) => {
                let BudgetFile { budget_ms } = BudgetFile::deserialize(object).map_err(D::Error::custom)?;
                if !(1.0..=60_000.0).contains(&budget_ms) {
                    return Err(D::Error::custom(format!("budget_ms is {budget_ms}, allowed: 1 to 60000")));
                }
                Ok(Self::Budget { budget_ms })
            }
            _ => Err(D::Error::custom("expected \"auto\" or {\"budget_ms\": 1 to 60000}")),
        }
    }
}
