//! The keys that are read and written.

use serde::de::value::SeqAccessDeserializer;
use serde::de::{Error, SeqAccess, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::super::extra::Extra;

/// The schema identifier that is written; it is not an address of a file.
pub(super) const SCHEMA: &str = "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/\
                                 Resources/Schema/markups-schema-v1.0.3.json#";

/// Only what says how to read the rest.
#[derive(Deserialize)]
pub(super) struct Head {
    #[serde(rename = "@schema")]
    pub(super) schema: String,
}

#[derive(Serialize, Deserialize)]
pub(super) struct File {
    #[serde(rename = "@schema")]
    pub(super) schema: String,
    pub(super) markups: Vec<Markup>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum MarkupType {
    Fiducial,
    Line,
    Angle,
    Curve,
    ClosedCurve,
    Plane,
    #[serde(rename = "ROI")]
    Roi,
}

#[derive(Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum CoordinateSystem {
    #[default]
    #[serde(rename = "LPS")]
    Lps,
    #[serde(rename = "RAS")]
    Ras,
}

/// A unit's name, or its code, scheme and meaning.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
pub(super) enum Units {
    Name(String),
    Code([String; 3]),
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Markup {
    #[serde(rename = "type")]
    pub(super) kind: MarkupType,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) name: Option<String>,
    #[serde(default)]
    pub(super) coordinate_system: CoordinateSystem,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) coordinate_units: Option<Units>,
    #[serde(default)]
    pub(super) locked: bool,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) fixed_number_of_control_points: Option<bool>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) label_format: Option<String>,
    // Of planes and boxes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) plane_type: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) size_mode: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) center: Option<[f64; 3]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) normal: Option<[f64; 3]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) object_to_base: Option<[f64; 16]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) base_to_node: Option<[f64; 16]>,
    /// Row by row; its columns are the axes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) orientation: Option<[f64; 9]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) size: Option<[f64; 3]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) plane_bounds: Option<[f64; 4]>,
    #[serde(default)]
    pub(super) control_points: Vec<ControlPoint>,
    /// They follow from the points, and are not read.
    #[serde(default, skip_deserializing)]
    pub(super) measurements: Vec<Measurement>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) display: Option<Display>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) relief: Option<Box<Extra>>,
}

/// Some tools number their points.
#[derive(Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(untagged)]
pub(super) enum PointId {
    Text(String),
    Number(u64),
}

#[derive(Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum PositionStatus {
    Undefined,
    Preview,
    Defined,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct ControlPoint {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) id: Option<PointId>,
    #[serde(default)]
    pub(super) label: String,
    #[serde(default)]
    pub(super) description: String,
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "position")]
    pub(super) position: Option<[f64; 3]>,
    /// Written for Slicer, and never read.
    #[serde(skip_deserializing)]
    pub(super) orientation: &'static [f64],
    #[serde(default = "yes")]
    pub(super) selected: bool,
    #[serde(default)]
    pub(super) locked: bool,
    #[serde(default = "yes")]
    pub(super) visibility: bool,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) position_status: Option<PositionStatus>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) relief: Option<Box<Extra>>,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Measurement {
    pub(super) name: &'static str,
    pub(super) enabled: bool,
    pub(super) value: f64,
    pub(super) units: &'static str,
    pub(super) print_format: &'static str,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Display {
    #[serde(default = "yes")]
    pub(super) visibility: bool,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) color: Option<[f64; 3]>,
    /// Points are selected by default; unselected ones are hidden.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) selected_color: Option<[f64; 3]>,
}

fn yes() -> bool {
    true
}

/// Three numbers; Slicer writes an empty text for a point that is nowhere.
fn position<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<[f64; 3]>, D::Error> {
    struct Position;

    impl<'de> Visitor<'de> for Position {
        type Value = Option<[f64; 3]>;

        fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            f.write_str("three numbers")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, numbers: A) -> Result<Self::Value, A::Error> {
            <[f64; 3]>::deserialize(SeqAccessDeserializer::new(numbers)).map(Some)
        }

        fn visit_str<E: Error>(self, text: &str) -> Result<Self::Value, E> {
            if text.is_empty() { Ok(None) } else { Err(E::invalid_value(Unexpected::Str(text), &self)) }
        }

        fn visit_unit<E: Error>(self) -> Result<Self::Value, E> {
            Ok(None)
        }
    }

    deserializer.deserialize_any(Position)
}
