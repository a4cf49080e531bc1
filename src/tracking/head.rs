//! From the pose of a head, as a head tracker reports it, to the eyes in front of a display.
//!
//! Head trackers report movements from a place of rest, which the user sets: OpenTrack sends six
//! numbers by UDP (`UDP over network`). [`DisplayGeometry`] says where that place is in the space
//! of the screen: the origin is the centre of the screen, x to the right and y up for the viewer, z
//! towards the viewer, mm.

use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::pose::SensorPose;
use relief_base::OutOfRange;

/// Size of a datagram of OpenTrack, bytes: six numbers of 64 bits, little-endian.
pub const OPENTRACK_BYTES: usize = 48;

/// A movement of a head from its place of rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadPose {
    /// To the right, up and away from the screen, mm.
    pub position_mm: Vector3<f64>,
    /// Turn to the left (yaw), nod upwards (pitch) and tilt towards the right shoulder (roll), degrees.
    pub angles_deg: [f64; 3],
}

/// A datagram that is not a pose.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum HeadPoseError {
    /// It has another size.
    #[error("a datagram of {0} bytes is not a pose of OpenTrack, which has {OPENTRACK_BYTES}")]
    Size(usize),
    /// A number of it is out of range.
    #[error("a pose of OpenTrack has the number {0}, which is out of range")]
    Number(f64),
}

/// The place of a display for a head tracker: the file of `relief client --display-geometry`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DisplayGeometry {
    /// Width of the screen, mm.
    pub width_mm: f64,
    /// Height of the screen, mm.
    pub height_mm: f64,
    /// The point between the eyes while the head rests, in the space of the screen, mm.
    pub rest_mm: [f64; 3],
    /// The turn of the tracker's axes about the screen's x axis, degrees: positive looks down at
    /// the viewer.
    pub tracker_pitch_deg: f64,
    /// Distance between the eyes, mm.
    pub eye_separation_mm: f64,
}

impl Default for DisplayGeometry {
    /// A 42-inch display, seen from twice its width.
    fn default() -> Self {
        Self {
            width_mm: 930.0,
            height_mm: 523.0,
            rest_mm: [0.0, 0.0, 1860.0],
            tracker_pitch_deg: 0.0,
            eye_separation_mm: 65.0,
        }
    }
}

impl DisplayGeometry {
    /// Refuses sizes and places that no display and no head have.
    ///
    /// # Errors
    /// The first invalid value, with the allowed ones.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        let in_room = "-20000 to 20000 mm";
        for (key, value, range, allowed) in [
            ("width_mm", self.width_mm, 10.0..=20_000.0, "10 to 20000 mm"),
            ("height_mm", self.height_mm, 10.0..=20_000.0, "10 to 20000 mm"),
            ("rest_mm[0]", self.rest_mm[0], -20_000.0..=20_000.0, in_room),
            ("rest_mm[1]", self.rest_mm[1], -20_000.0..=20_000.0, in_room),
            ("rest_mm[2]", self.rest_mm[2], 50.0..=20_000.0, "50 to 20000 mm in front of the screen"),
            ("tracker_pitch_deg", self.tracker_pitch_deg, -90.0..=90.0, "-90 to 90"),
            ("eye_separation_mm", self.eye_separation_mm, 30.0..=100.0, "30 to 100 mm"),
        ] {
            if !range.contains(&value) {
                return Err(OutOfRange::new(key, value, allowed));
            }
        }
        Ok(())
    }

    /// The left and the right eye of a head, in the space of the screen, mm.
    #[must_use]
    pub fn eyes(&self, head: &HeadPose) -> [Vector3<f64>; 2] {
        let screen_from_tracker =
            Rotation3::from_axis_angle(&Vector3::x_axis(), self.tracker_pitch_deg.to_radians());
        let middle = Vector3::from(self.rest_mm) + screen_from_tracker * head.position_mm;
        let half =
            screen_from_tracker * head.tracker_from_head() * Vector3::x() * (self.eye_separation_mm / 2.0);
        [middle - half, middle + half]
    }
}

impl HeadPose {
    /// From the axes of the head (x right, y up, z away from the screen) to those of the tracker.
    fn tracker_from_head(&self) -> Rotation3<f64> {
        let [yaw, pitch, roll] = self.angles_deg.map(f64::to_radians);
        Rotation3::from_axis_angle(&Vector3::y_axis(), yaw)
            * Rotation3::from_axis_angle(&Vector3::x_axis(), pitch)
            * Rotation3::from_axis_angle(&Vector3::z_axis(), -roll)
    }

    /// The same movement of a pointer in the hand, which has the axes of a Wiimote: x right, y down,
    /// z forward.
    #[must_use]
    pub fn pointer(&self) -> SensorPose {
        let head_from_pointer = Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let orientation =
            UnitQuaternion::from_rotation_matrix(&(self.tracker_from_head() * head_from_pointer));
        SensorPose { position: self.position_mm, orientation }
    }

    /// A datagram of OpenTrack: x, y, z in cm, yaw, pitch, roll in degrees.
    ///
    /// # Errors
    /// When it has another size, or a number that no head reaches.
    pub fn from_opentrack(datagram: &[u8]) -> Result<Self, HeadPoseError> {
        let (numbers, rest) = datagram.as_chunks::<8>();
        let &[x, y, z, yaw, pitch, roll] = numbers else { return Err(HeadPoseError::Size(datagram.len())) };
        if !rest.is_empty() {
            return Err(HeadPoseError::Size(datagram.len()));
        }
        let [x, y, z, yaw, pitch, roll] = [x, y, z, yaw, pitch, roll].map(f64::from_le_bytes);
        for number in [x, y, z, yaw, pitch, roll] {
            if !(-1000.0..=1000.0).contains(&number) {
                return Err(HeadPoseError::Number(number));
            }
        }
        Ok(Self { position_mm: Vector3::new(x, y, z) * 10.0, angles_deg: [yaw, pitch, roll] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn datagram(numbers: [f64; 6]) -> Vec<u8> {
        numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
    }

    fn eyes(numbers: [f64; 6], geometry: &DisplayGeometry) -> [Vector3<f64>; 2] {
        geometry.eyes(&HeadPose::from_opentrack(&datagram(numbers)).unwrap())
    }

    fn assert_near(found: Vector3<f64>, expected: [f64; 3]) {
        assert!((found - Vector3::from(expected)).norm() < 1e-9, "{found:?}, not {expected:?}");
    }

    #[test]
    fn a_resting_head_has_its_eyes_beside_the_place_of_rest() {
        let geometry =
            DisplayGeometry { rest_mm: [10.0, 20.0, 600.0], eye_separation_mm: 64.0, ..Default::default() };
        let [left, right] = eyes([0.0; 6], &geometry);
        assert_near(left, [-22.0, 20.0, 600.0]);
        assert_near(right, [42.0, 20.0, 600.0]);
    }

    #[test]
    fn movements_are_in_centimetres_and_angles_turn_the_line_of_the_eyes() {
        let geometry =
            DisplayGeometry { rest_mm: [0.0, 0.0, 600.0], eye_separation_mm: 60.0, ..Default::default() };
        let [left, _] = eyes([5.0, -3.0, 10.0, 0.0, 0.0, 0.0], &geometry);
        assert_near(left, [20.0, -30.0, 700.0]);
        // A head that looks to its left has its right eye nearer to the screen.
        let [left, right] = eyes([0.0, 0.0, 0.0, 90.0, 0.0, 0.0], &geometry);
        assert_near(left, [0.0, 0.0, 630.0]);
        assert_near(right, [0.0, 0.0, 570.0]);
        // A head that tilts to the right shoulder has its right eye lower.
        let [left, right] = eyes([0.0, 0.0, 0.0, 0.0, 0.0, 90.0], &geometry);
        assert_near(left, [0.0, 30.0, 600.0]);
        assert_near(right, [0.0, -30.0, 600.0]);
        // Nodding moves neither.
        let [left, right] = eyes([0.0, 0.0, 0.0, 0.0, 40.0, 0.0], &geometry);
        assert_near(left, [-30.0, 0.0, 600.0]);
        assert_near(right, [30.0, 0.0, 600.0]);
    }

    #[test]
    fn a_pointer_has_the_axes_of_a_wiimote() {
        let pointer = |numbers| HeadPose::from_opentrack(&datagram(numbers)).unwrap().pointer();
        let rest = pointer([1.0, 2.0, 3.0, 0.0, 0.0, 0.0]);
        assert_near(rest.position, [10.0, 20.0, 30.0]);
        // Forward is towards the screen, against z; down is against y.
        assert_near(rest.orientation * Vector3::z(), [0.0, 0.0, -1.0]);
        assert_near(rest.orientation * Vector3::y(), [0.0, -1.0, 0.0]);
        // Turned to the left it points to the left, nodding upwards it points up.
        assert_near(pointer([0.0, 0.0, 0.0, 90.0, 0.0, 0.0]).orientation * Vector3::z(), [-1.0, 0.0, 0.0]);
        assert_near(pointer([0.0, 0.0, 0.0, 0.0, 90.0, 0.0]).orientation * Vector3::z(), [0.0, 1.0, 0.0]);
    }

    #[test]
    fn a_tracker_that_looks_down_has_its_axes_turned() {
        let geometry =
            DisplayGeometry { rest_mm: [0.0, 0.0, 600.0], tracker_pitch_deg: 30.0, ..Default::default() };
        let [left, right] = eyes([0.0, 0.0, 10.0, 0.0, 0.0, 0.0], &geometry);
        let middle = (left + right) / 2.0;
        let (sin, cos) = 30f64.to_radians().sin_cos();
        assert_near(middle, [0.0, -100.0 * sin, 600.0 + 100.0 * cos]);
    }

    #[test]
    fn other_datagrams_and_geometries_are_refused() {
        assert_eq!(HeadPose::from_opentrack(&[0; 47]), Err(HeadPoseError::Size(47)));
        assert_eq!(HeadPose::from_opentrack(&[0; 56]), Err(HeadPoseError::Size(56)));
        assert_eq!(HeadPose::from_opentrack(&[0; 49]), Err(HeadPoseError::Size(49)));
        assert!(HeadPose::from_opentrack(&datagram([f64::NAN; 6])).is_err());
        assert!(HeadPose::from_opentrack(&datagram([0.0, 1e9, 0.0, 0.0, 0.0, 0.0])).is_err());
        let wrong = DisplayGeometry { rest_mm: [0.0, 0.0, 0.0], ..Default::default() };
        assert!(wrong.validate().unwrap_err().to_string().contains("rest_mm[2] is 0"));
        assert_eq!(DisplayGeometry::default().validate(), Ok(()));
    }
}
