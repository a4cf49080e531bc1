//! Intents: requests to change a view, from any input device; one JSON object each.
//!
//! Angles in degrees, lengths in mm, quaternions x, y, z, w. View axes: x right, y up, z towards
//! the viewer. Unknown keys are refused; ranges are checked by [`Intent::validate`], before
//! anything changes.

use std::ops::RangeInclusive;
use std::sync::Arc;

use glam::DQuat;
use serde::{Deserialize, Serialize};

use relief_volume::Orbit;

/// One intent. Angles and lengths are changes unless said otherwise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "intent", rename_all = "snake_case", deny_unknown_fields)]
pub enum Intent {
    /// Turns the eye about the patient, as a turntable: its elevation ends above the head and below
    /// the feet.
    Orbit {
        /// About the patient's long axis: positive goes from the front to the patient's left. -3600
        /// to 3600.
        #[serde(default)]
        azimuth_deg: f64,
        /// Up, positive. -3600 to 3600.
        #[serde(default)]
        elevation_deg: f64,
    },
    /// Turns the volume about the focal point, freely.
    Turn {
        /// The rotation in view axes; a unit quaternion.
        rotation_xyzw: [f64; 4],
    },
    /// Sets the angles of [`Orbit`]. An omitted angle stays.
    Look {
        /// 0 from the front, 90 from the patient's left. -3600 to 3600.
        azimuth_deg: f64,
        /// 90 from the head, -90 from the feet.
        elevation_deg: f64,
        /// 1 fits the whole into the picture. 0.2 to 40.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        zoom: Option<f64>,
        /// Full vertical field of view at zoom 1; 0 is a parallel projection. 0, or 5 to 150.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        vertical_fov_deg: Option<f64>,
    },
    /// Shifts the picture at the focal point's depth, as a fraction of its height.
    Pan {
        /// To the right. -10 to 10.
        #[serde(default)]
        right: f64,
        /// Up. -10 to 10.
        #[serde(default)]
        up: f64,
    },
    /// Comes closer or goes away.
    Zoom {
        /// Above 1 is closer. 0.01 to 100.
        factor: f64,
    },
    /// Takes hold of the volume. While it is held already: takes hold again where the hand is now,
    /// so that nothing moves.
    Grab {
        /// The hand, mm along view axes, the focal point being 0; -100000 to 100000. Only its
        /// changes move the volume.
        position_mm: [f64; 3],
        /// How the hand is turned in view axes; a unit quaternion. Only its changes turn the
        /// volume.
        orientation_xyzw: [f64; 4],
        /// The movements that the grab permits.
        #[serde(default)]
        mode: GrabMode,
        /// The point that stays in place while the hand only turns.
        #[serde(default)]
        pivot: Pivot,
    },
    /// Moves the held volume to the hand's present pose. Has no effect while nothing is held.
    Move {
        /// As in `grab`.
        position_mm: [f64; 3],
        /// As in `grab`.
        orientation_xyzw: [f64; 4],
    },
    /// Releases the volume; the view stays as it is.
    Release {},
    /// Cuts the near part away, by a plane across the viewing axis. Exactly one of the two keys is
    /// required.
    Clip {
        /// Deeper by this much. -20000 to 20000.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        by_mm: Option<f64>,
        /// To this depth behind the front of the volume's bounding sphere; 0 cuts nothing. 0 to
        /// 20000.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        to_mm: Option<f64>,
    },
    /// Another preset. One of the two.
    Preset {
        /// By its name.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// Steps in the cyclic list of presets, -1000 to 1000.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        step: Option<i32>,
    },
    /// Moves the 3D cursor; it stays within the volume's bounding sphere. One of the four.
    Cursor {
        /// Moves the cursor to the surface at this place of the picture: pixels of the full-size
        /// picture, u right, v down, centres at +0.5, -100000 to 100000. Where no surface is
        /// visible the cursor keeps its depth.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        at_px: Option<[f64; 2]>,
        /// To this place along view axes, the focal point being 0. -100000 to 100000.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        at_view_mm: Option<[f64; 3]>,
        /// By this much along view axes. -100000 to 100000.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        by_view_mm: Option<[f64; 3]>,
        /// To this patient position. -1000000 to 1000000.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        point_mm: Option<[f64; 3]>,
    },
    /// Sets something down where the cursor is.
    Place {
        /// The phase.
        phase: PlacePhase,
    },
    /// Takes back the last change of the view.
    Undo {},
    /// Advances to the next label to place.
    NextLabel {},
    /// The view that a session begins with.
    Reset {},
}

/// The movements that a grab permits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GrabMode {
    /// Turn and move, as with a thing in one's hand.
    #[default]
    Both,
    /// Turn about the focal point.
    Rotate,
    /// Move without turning.
    Move,
}

/// The pivot of a grab in mode `both`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Pivot {
    /// The cursor, or the focal point where there is no cursor.
    #[default]
    Cursor,
    /// The focal point.
    Focal,
}

/// The phase of placing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PlacePhase {
    /// It shows where it would be, and follows the cursor.
    Preview,
    /// The same; but a point of an annotation that is under the cursor is taken hold of instead,
    /// and goes with the cursor.
    Take,
    /// There.
    Commit,
    /// Nowhere.
    Cancel,
}

/// An intent that cannot be applied; the view is unchanged.
#[derive(Clone, Debug, thiserror::Error)]
pub enum IntentError {
    /// Not the JSON of an intent.
    #[error("invalid intent: {0}")]
    Json(Arc<serde_json::Error>),
    /// JSON without the name of an intent.
    #[error("invalid intent: expected an object with a key \"intent\", such as {{\"intent\":\"reset\"}}")]
    Unnamed,
    /// A value out of range.
    #[error("{field} is {found}, allowed: {allowed}")]
    Range {
        /// The key.
        field: &'static str,
        /// Its value.
        found: String,
        /// The permitted values.
        allowed: String,
    },
    /// None or several of keys that exclude one another.
    #[error("{intent} has {found} of {keys}, allowed: exactly one")]
    OneOf {
        /// The intent.
        intent: &'static str,
        /// The number found.
        found: usize,
        /// The keys.
        keys: &'static str,
    },
    /// Placing where there is no cursor.
    #[error("place needs a cursor: send an intent \"cursor\" first")]
    NoCursor,
}

/// Degrees that one intent may turn, either way.
const TURNS_DEG: RangeInclusive<f64> = Orbit::AZIMUTHS_DEG;
/// Shares of the picture's height that one intent may shift.
const PANS: RangeInclusive<f64> = -10.0..=10.0;
/// The largest factor of one intent.
const FACTORS: RangeInclusive<f64> = 0.01..=100.0;
/// Lengths along view axes, mm.
const VIEW_MM: RangeInclusive<f64> = -1e5..=1e5;
/// Changes of the clip plane's depth, mm.
const CLIPS_MM: RangeInclusive<f64> = -2e4..=2e4;
/// Coordinates of patient positions, mm: those of cameras.
const PATIENT_MM: RangeInclusive<f64> = -1e6..=1e6;
/// Lengths of quaternions that are taken as one: clients round.
const UNIT: RangeInclusive<f64> = 0.99..=1.01;

impl Intent {
    /// Reads an intent: one JSON object.
    ///
    /// # Errors
    /// When the JSON is not an intent, has an unknown or a missing key, or a value is out
    /// of range.
    pub fn from_json(json: &[u8]) -> Result<Self, IntentError> {
        let value: serde_json::Value =
            serde_json::from_slice(json).map_err(|error| IntentError::Json(Arc::new(error)))?;
        // Serde would take an array, and a number for the name.
        if !value.get("intent").is_some_and(serde_json::Value::is_string) {
            return Err(IntentError::Unnamed);
        }
        let intent: Self =
            serde_json::from_value(value).map_err(|error| IntentError::Json(Arc::new(error)))?;
        intent.validate()?;
        Ok(intent)
    }

    /// Checks every range that does not depend on the current view.
    ///
    /// # Errors
    /// The first value out of range, with its key.
    pub fn validate(&self) -> Result<(), IntentError> {
        match self {
            Self::Orbit { azimuth_deg, elevation_deg } => {
                within("azimuth_deg", *azimuth_deg, &TURNS_DEG)?;
                within("elevation_deg", *elevation_deg, &TURNS_DEG)
            }
            Self::Turn { rotation_xyzw } => unit("rotation_xyzw", rotation_xyzw).map(drop),
            Self::Look { azimuth_deg, elevation_deg, zoom, vertical_fov_deg } => {
                within("azimuth_deg", *azimuth_deg, &Orbit::AZIMUTHS_DEG)?;
                within("elevation_deg", *elevation_deg, &Orbit::ELEVATIONS_DEG)?;
                zoom.map_or(Ok(()), |zoom| within("zoom", zoom, &super::aspect::ZOOMS))?;
                vertical_fov_deg.map_or(Ok(()), field_of_view)
            }
            Self::Pan { right, up } => {
                within("right", *right, &PANS)?;
                within("up", *up, &PANS)
            }
            Self::Zoom { factor } => within("factor", *factor, &FACTORS),
            Self::Grab { position_mm, orientation_xyzw, .. }
            | Self::Move { position_mm, orientation_xyzw } => {
                all_within("position_mm", position_mm, &VIEW_MM)?;
                unit("orientation_xyzw", orientation_xyzw).map(drop)
            }
            Self::Clip { by_mm, to_mm } => {
                one_of("clip", "by_mm, to_mm", &[by_mm.is_some(), to_mm.is_some()])?;
                by_mm.map_or(Ok(()), |by| within("by_mm", by, &CLIPS_MM))?;
                to_mm.map_or(Ok(()), |to| within("to_mm", to, &(0.0..=*CLIPS_MM.end())))
            }
            Self::Preset { name, step } => {
                one_of("preset", "name, step", &[name.is_some(), step.is_some()])?;
                step.map_or(Ok(()), |step| within("step", f64::from(step), &(-1000.0..=1000.0)))
            }
            Self::Cursor { at_px, at_view_mm, by_view_mm, point_mm } => {
                let given = [at_px.is_some(), at_view_mm.is_some(), by_view_mm.is_some(), point_mm.is_some()];
                one_of("cursor", "at_px, at_view_mm, by_view_mm, point_mm", &given)?;
                at_px.map_or(Ok(()), |at| all_within("at_px", &at, &VIEW_MM))?;
                at_view_mm.map_or(Ok(()), |at| all_within("at_view_mm", &at, &VIEW_MM))?;
                by_view_mm.map_or(Ok(()), |by| all_within("by_view_mm", &by, &VIEW_MM))?;
                point_mm.map_or(Ok(()), |at| all_within("point_mm", &at, &PATIENT_MM))
            }
            Self::Release {} | Self::Place { .. } | Self::Undo {} | Self::NextLabel {} | Self::Reset {} => {
                Ok(())
            }
        }
    }
}

pub(super) fn within(
    field: &'static str,
    found: f64,
    range: &RangeInclusive<f64>,
) -> Result<(), IntentError> {
    let refuse = || IntentError::Range {
        field,
        found: found.to_string(),
        allowed: format!("{} to {}", range.start(), range.end()),
    };
    range.contains(&found).then_some(()).ok_or_else(refuse)
}

fn all_within(field: &'static str, found: &[f64], range: &RangeInclusive<f64>) -> Result<(), IntentError> {
    found.iter().try_for_each(|&component| within(field, component, range))
}

/// A field of view, or 0 for a parallel projection.
fn field_of_view(found: f64) -> Result<(), IntentError> {
    if found == 0.0 || Orbit::FIELDS_OF_VIEW_DEG.contains(&found) {
        return Ok(());
    }
    let (least, most) = (Orbit::FIELDS_OF_VIEW_DEG.start(), Orbit::FIELDS_OF_VIEW_DEG.end());
    let allowed = format!("0 (parallel) or {least} to {most}");
    Err(IntentError::Range { field: "vertical_fov_deg", found: found.to_string(), allowed })
}

/// The rotation of a unit quaternion, made of unit length exactly.
pub(super) fn unit(field: &'static str, xyzw: &[f64; 4]) -> Result<DQuat, IntentError> {
    let rotation = DQuat::from_array(*xyzw);
    let length = rotation.length();
    if UNIT.contains(&length) {
        return Ok(rotation.normalize());
    }
    let allowed = format!("a unit quaternion, of length {} to {}", UNIT.start(), UNIT.end());
    Err(IntentError::Range { field, found: format!("{xyzw:?}, of length {length}"), allowed })
}

fn one_of(intent: &'static str, keys: &'static str, given: &[bool]) -> Result<(), IntentError> {
    let found = given.iter().filter(|given| **given).count();
    if found == 1 { Ok(()) } else { Err(IntentError::OneOf { intent, found, keys }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every intent as clients write it, and back.
    #[test]
    fn intents_are_read_and_written_alike() {
        for json in [
            r#"{"intent":"orbit","azimuth_deg":5.0,"elevation_deg":-2.0}"#,
            r#"{"intent":"turn","rotation_xyzw":[0.0,0.0,0.0,1.0]}"#,
            r#"{"intent":"look","azimuth_deg":90.0,"elevation_deg":0.0}"#,
            r#"{"intent":"look","azimuth_deg":90.0,"elevation_deg":0.0,"zoom":2.0,"vertical_fov_deg":0.0}"#,
            r#"{"intent":"pan","right":0.1,"up":0.0}"#,
            r#"{"intent":"zoom","factor":1.1}"#,
            r#"{"intent":"grab","position_mm":[0.0,0.0,0.0],"orientation_xyzw":[0.0,0.0,0.0,1.0],"mode":"both","pivot":"cursor"}"#,
            r#"{"intent":"move","position_mm":[1.0,0.0,0.0],"orientation_xyzw":[0.0,0.0,0.0,1.0]}"#,
            r#"{"intent":"release"}"#,
            r#"{"intent":"clip","by_mm":-5.0}"#,
            r#"{"intent":"clip","to_mm":40.0}"#,
            r#"{"intent":"preset","name":"bone"}"#,
            r#"{"intent":"preset","step":-1}"#,
            r#"{"intent":"cursor","at_px":[480.5,270.5]}"#,
            r#"{"intent":"cursor","point_mm":[1.0,2.0,3.0]}"#,
            r#"{"intent":"place","phase":"commit"}"#,
            r#"{"intent":"place","phase":"take"}"#,
            r#"{"intent":"undo"}"#,
            r#"{"intent":"next_label"}"#,
            r#"{"intent":"reset"}"#,
        ] {
            let intent = Intent::from_json(json.as_bytes()).expect(json);
            assert_eq!(serde_json::to_string(&intent).unwrap(), json);
        }
    }

    /// An error names the key, the value and the permitted values.
    #[test]
    fn invalid_fields_are_named() {
        for (json, says) in [
            ("", "invalid intent: EOF"),
            ("[1]", "expected an object with a key \"intent\""),
            (r#"["zoom",2]"#, "expected an object with a key \"intent\""),
            (r#"{"intent":0}"#, "expected an object with a key \"intent\""),
            (r#"{"intent":"fly"}"#, "unknown variant `fly`, expected one of `orbit`"),
            (r#"{"intent":"zoom"}"#, "missing field `factor`"),
            (r#"{"intent":"zoom","factor":2,"fast":true}"#, "unknown field `fast`"),
            (r#"{"intent":"undo","steps":2}"#, "unknown field `steps`"),
            (r#"{"intent":"zoom","factor":1e999}"#, "number out of range"),
            (r#"{"intent":"zoom","factor":0}"#, "factor is 0, allowed: 0.01 to 100"),
            (r#"{"intent":"orbit","azimuth_deg":1e9}"#, "azimuth_deg is 1000000000, allowed: -3600 to 3600"),
            (r#"{"intent":"pan","up":-11}"#, "up is -11, allowed: -10 to 10"),
            (
                r#"{"intent":"turn","rotation_xyzw":[0,0,0,2]}"#,
                "rotation_xyzw is [0.0, 0.0, 0.0, 2.0], of length 2, allowed: a unit quaternion",
            ),
            (
                r#"{"intent":"look","azimuth_deg":0,"elevation_deg":91}"#,
                "elevation_deg is 91, allowed: -90 to 90",
            ),
            (
                r#"{"intent":"look","azimuth_deg":0,"elevation_deg":0,"vertical_fov_deg":2}"#,
                "vertical_fov_deg is 2, allowed: 0 (parallel) or 5 to 150",
            ),
            (r#"{"intent":"clip"}"#, "clip has 0 of by_mm, to_mm, allowed: exactly one"),
            (r#"{"intent":"clip","to_mm":-1}"#, "to_mm is -1, allowed: 0 to 20000"),
            (
                r#"{"intent":"preset","name":"a","step":1}"#,
                "preset has 2 of name, step, allowed: exactly one",
            ),
            (r#"{"intent":"cursor"}"#, "cursor has 0 of at_px, at_view_mm, by_view_mm, point_mm"),
            (
                r#"{"intent":"cursor","point_mm":[0,0,2e6]}"#,
                "point_mm is 2000000, allowed: -1000000 to 1000000",
            ),
            (r#"{"intent":"place","phase":"maybe"}"#, "unknown variant `maybe`, expected one of `preview`"),
        ] {
            let refused = Intent::from_json(json.as_bytes()).unwrap_err().to_string();
            assert!(refused.contains(says), "{json}: {refused}");
        }
        let nan = Intent::Pan { right: f64::NAN, up: 0.0 };
        assert_eq!(nan.validate().unwrap_err().to_string(), "right is NaN, allowed: -10 to 10");
    }
}
