//! A tracked Wiimote as a hand: its place at a time, and the meaning of its movements in view.
//!
//! The place of a hand is the Wiimote's tip, a point before its camera. Spaces: `Beacon` and
//! `Sensor` as in `tracking`; the axes of the recommended beacon (x right, y up, z towards the
//! viewer) are view axes.

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use super::intent::{GrabMode, IntentError, Pivot, unit, within};
use relief_tracking::{SensorPose, TrackedSample, TrackingState};

/// The pose of a Wiimote's camera: `beacon_from_sensor`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandPose {
    position_mm: DVec3,
    /// Of unit length.
    orientation: DQuat,
}

/// A tracked hand at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandSample {
    /// Time, ns from any start.
    pub t_ns: u64,
    /// The tracking state. Only `tracking` moves anything.
    pub state: TrackingState,
    /// `beacon_from_sensor`, while tracking.
    pub pose: Option<HandPose>,
}

/// How a hand's movements change a view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HandOptions {
    /// Millimetres in view for each of the hand: 0.05 to 20.
    pub gain: f64,
    /// The distance of the tip before the Wiimote's camera, mm: 0 to 5000. Errors of a pose turn about
    /// the beacon, so a tip at the beacon's distance is ten times steadier (0.4 against 4.6 mm rms
    /// across the view, from 1200 mm), but turning the wrist moves it far.
    pub tip_mm: f64,
    /// The beacon position that is the focal point in view, mm; null: where the tip is when it is
    /// first tracked, and after home. -10000 to 10000.
    pub tip_center_mm: Option<[f64; 3]>,
    /// Turns beacon axes into view axes, for beacons that are mounted otherwise; a unit quaternion.
    pub view_from_beacon_xyzw: [f64; 4],
    /// The movements that B allows.
    pub grab_mode: GrabMode,
    /// The centre of turns by B.
    pub pivot: Pivot,
    /// A grabbed volume rests until the hand has turned by this, degrees: 0 to 20.
    pub dead_zone_deg: f64,
    /// Or has moved by this, mm: 0 to 50. A remote at rest is tracked from 1200 mm within 0.6
    /// degrees and 10 mm for nine tenths of the time.
    pub dead_zone_mm: f64,
    /// The cursor rests until the hand has moved by this, mm: 0 to 50.
    pub cursor_rest_mm: f64,
    /// While A is held the cursor goes so much of the hand's way, as a share: 0.02 to 1.
    pub precise_gain: f64,
    /// And it follows the mean of the hand over about this time, s: 0 to 2. Where the hand rests as
    /// A is pressed (within `dead_zone_mm` of that mean), the cursor goes to the mean.
    pub steady_s: f64,
    /// The zoom of a second of +, as a factor: 1.01 to 100.
    pub zoom_per_s: f64,
    /// The movement of the clip plane in a second of the cross, mm: 0.1 to 2000.
    pub clip_mm_per_s: f64,
}

impl Default for HandOptions {
    fn default() -> Self {
        Self {
            gain: 1.0,
            tip_mm: 150.0,
            tip_center_mm: None,
            view_from_beacon_xyzw: [0.0, 0.0, 0.0, 1.0],
            grab_mode: GrabMode::Both,
            pivot: Pivot::Cursor,
            dead_zone_deg: 1.0,
            dead_zone_mm: 10.0,
            cursor_rest_mm: 0.5,
            precise_gain: 0.2,
            steady_s: 0.45,
            zoom_per_s: 2.0,
            clip_mm_per_s: 60.0,
        }
    }
}

impl HandOptions {
    /// Checks every range.
    ///
    /// # Errors
    /// The first value out of range, with its key.
    pub fn validate(&self) -> Result<(), IntentError> {
        within("gain", self.gain, &(0.05..=20.0))?;
        within("tip_mm", self.tip_mm, &(0.0..=5000.0))?;
        for coordinate in self.tip_center_mm.into_iter().flatten() {
            within("tip_center_mm", coordinate, &(-1e4..=1e4))?;
        }
        unit("view_from_beacon_xyzw", &self.view_from_beacon_xyzw)?;
        within("dead_zone_deg", self.dead_zone_deg, &(0.0..=20.0))?;
        within("dead_zone_mm", self.dead_zone_mm, &(0.0..=50.0))?;
        within("cursor_rest_mm", self.cursor_rest_mm, &(0.0..=50.0))?;
        within("precise_gain", self.precise_gain, &(0.02..=1.0))?;
        within("steady_s", self.steady_s, &(0.0..=2.0))?;
        within("zoom_per_s", self.zoom_per_s, &(1.01..=100.0))?;
        within("clip_mm_per_s", self.clip_mm_per_s, &(0.1..=2000.0))
    }
}

impl HandPose {
    /// Position, mm.
    #[must_use]
    pub fn position_mm(&self) -> [f64; 3] {
        self.position_mm.to_array()
    }

    /// How it is turned: a unit quaternion.
    #[must_use]
    pub fn orientation_xyzw(&self) -> [f64; 4] {
        self.orientation.to_array()
    }

    /// The pose of these numbers, as a line of `relief track` has them.
    ///
    /// # Errors
    /// When a coordinate is beyond 100000 mm or the quaternion is not a rotation.
    pub fn new(position_mm: [f64; 3], orientation_xyzw: [f64; 4]) -> Result<Self, IntentError> {
        for coordinate in position_mm {
            within("position_mm", coordinate, &(-1e5..=1e5))?;
        }
        let orientation = unit("orientation_xyzw", &orientation_xyzw)?;
        Ok(Self { position_mm: DVec3::from_array(position_mm), orientation })
    }

    /// The point `tip_mm` before the camera, in beacon space.
    pub(super) fn tip(&self, tip_mm: f64) -> DVec3 {
        self.position_mm + self.orientation * DVec3::new(0.0, 0.0, tip_mm)
    }

    pub(super) fn orientation(&self) -> DQuat {
        self.orientation
    }
}

impl From<&TrackedSample> for HandSample {
    /// A pose that is out of range counts as missing: nothing moves.
    fn from(sample: &TrackedSample) -> Self {
        let of_numbers = |pose: SensorPose| HandPose::new(pose.position.into(), pose.orientation_xyzw()).ok();
        Self { t_ns: sample.t_ns, state: sample.state, pose: sample.pose.and_then(of_numbers) }
    }
}
