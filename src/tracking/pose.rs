//! Rigid poses between `Beacon` and `Sensor` and their uncertainty.
//!
//! Solvers work with `sensor_from_beacon` ([`Pose`]) and small changes of it to the left, `exp(w) R
//! P + t + v`: w in radians about the sensor's axes, v in mm. The reported pose is the inverse
//! ([`SensorPose`]).

use nalgebra::{Matrix3, Matrix6, Rotation3, UnitQuaternion, Vector3, Vector6};

use relief_base::{Beacon as BeaconSpace, Sensor, Transform};

/// `sensor_from_beacon`: a point P of the beacon is at `rotation * P + translation` before the
/// sensor, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Turns beacon axes into sensor axes.
    pub rotation: Rotation3<f64>,
    /// The beacon's origin in sensor space, mm.
    pub translation: Vector3<f64>,
}

impl Pose {
    /// This pose after a small change to the left: w (radians), then v (mm).
    #[must_use]
    pub fn changed(&self, change: &Vector6<f64>) -> Self {
        let w = change.fixed_rows::<3>(0).into_owned();
        let v = change.fixed_rows::<3>(3).into_owned();
        Self { rotation: Rotation3::from_scaled_axis(w) * self.rotation, translation: self.translation + v }
    }

    /// A beacon point in sensor space.
    #[must_use]
    pub fn place(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point + self.translation
    }

    /// The sensor's place in the beacon's frame.
    #[must_use]
    pub fn inverse(&self) -> SensorPose {
        let turn = self.rotation.inverse();
        SensorPose {
            position: -(turn * self.translation),
            orientation: UnitQuaternion::from_rotation_matrix(&turn),
        }
    }

    /// Covariance of position (mm) and turn (radians, beacon axes) of the inverse, from that of a
    /// change to the left.
    #[must_use]
    pub fn inverse_covariance(&self, covariance: &Matrix6<f64>) -> Matrix6<f64> {
        let turn = self.rotation.inverse().into_inner();
        let mut jacobian = Matrix6::zeros();
        jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&(-turn * cross_matrix(&self.translation)));
        jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&-turn);
        jacobian.fixed_view_mut::<3, 3>(3, 0).copy_from(&-turn);
        jacobian * covariance * jacobian.transpose()
    }

    /// Angle in radians and distance in mm between where this pose and another put the sensor in
    /// the beacon's frame.
    #[must_use]
    pub fn inverse_distance(&self, other: &Self) -> (f64, f64) {
        let (angle, _) = self.distance(other);
        (angle, (self.inverse().position - other.inverse().position).norm())
    }

    /// Angle in radians and distance in mm to another pose.
    #[must_use]
    pub fn distance(&self, other: &Self) -> (f64, f64) {
        // From sine and cosine: the arc cosine alone is NaN for matrices that differ only by
        // rounding.
        let turn = (self.rotation * other.rotation.inverse()).into_inner();
        let odd = turn - turn.transpose();
        let sine = Vector3::new(odd.m32, odd.m13, odd.m21).norm() / 2.0;
        let angle = sine.atan2((turn.trace() - 1.0) / 2.0);
        (angle, (self.translation - other.translation).norm())
    }
}

/// `beacon_from_sensor`: where a Wiimote's camera is, and how it is turned, in the beacon's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorPose {
    /// The camera's centre, mm.
    pub position: Vector3<f64>,
    /// Turns sensor axes (x right, y down, z forward) into beacon axes.
    pub orientation: UnitQuaternion<f64>,
}

impl SensorPose {
    /// `sensor_from_beacon`.
    #[must_use]
    pub fn inverse(&self) -> Pose {
        let turn = self.orientation.inverse().to_rotation_matrix();
        Pose { rotation: turn, translation: -(turn * self.position) }
    }

    /// Quaternion x, y, z, w, with w not negative.
    #[must_use]
    pub fn orientation_xyzw(&self) -> [f64; 4] {
        let q = self.orientation.quaternion();
        let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
        [q.i * sign, q.j * sign, q.k * sign, q.w * sign]
    }

    /// The same as a typed transform.
    #[must_use]
    pub fn beacon_from_sensor(&self) -> Transform<BeaconSpace, Sensor> {
        let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()]
            .map(|axis| glam::DVec3::from_array((self.orientation * axis).into()));
        Transform::from_axes(x, y, z, glam::DVec3::from_array(self.position.into()))
    }

    /// A camera at `position` that looks at `target`, its x axis across `up` (its y axis then
    /// points down), rolled by `roll` radians about its own z axis; `None` when `up` is along the
    /// view.
    #[must_use]
    pub fn looking_at(
        position: Vector3<f64>,
        target: Vector3<f64>,
        up: &Vector3<f64>,
        roll: f64,
    ) -> Option<Self> {
        let forward = (target - position).try_normalize(1e-9)?;
        let right = forward.cross(up).try_normalize(1e-9)?;
        let axes = Matrix3::from_columns(&[right, forward.cross(&right), forward]);
        let level = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        Some(Self { position, orientation: level * UnitQuaternion::from_scaled_axis(Vector3::z() * roll) })
    }
}

/// The matrix of `v x`.
#[must_use]
pub(crate) fn cross_matrix(v: &Vector3<f64>) -> Matrix3<f64> {
    v.cross_matrix()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverses_undo() {
        let pose = Pose {
            rotation: Rotation3::from_euler_angles(0.3, -0.8, 2.0),
            translation: Vector3::new(10.0, -20.0, 1500.0),
        };
        let (angle, distance) = pose.inverse().inverse().distance(&pose);
        assert!(angle < 1e-7 && distance < 1e-9, "{angle} {distance}");
        let typed = pose.inverse().beacon_from_sensor();
        let point = typed * relief_base::Point::new(1.0, 2.0, 3.0);
        let expected = pose.rotation.inverse() * (Vector3::new(1.0, 2.0, 3.0) - pose.translation);
        assert!((Vector3::from(point.xyz.to_array()) - expected).norm() < 1e-9);
    }

    /// The covariance of the inverse against finite changes of the pose.
    #[test]
    fn the_inverse_covariance_follows_small_changes() {
        let pose = Pose {
            rotation: Rotation3::from_euler_angles(-0.5, 0.4, 1.0),
            translation: Vector3::new(100.0, 50.0, 1200.0),
        };
        let change = Vector6::new(1e-6, -2e-6, 3e-6, 1e-3, 2e-3, -1e-3);
        let moved = pose.changed(&change).inverse();
        let turn = (moved.orientation * pose.inverse().orientation.inverse()).scaled_axis();
        let shift = moved.position - pose.inverse().position;
        // A covariance of rank one holds exactly the change itself.
        let covariance = pose.inverse_covariance(&(change * change.transpose()));
        for axis in 0..3 {
            assert!((covariance[(axis, axis)].sqrt() - shift[axis].abs()).abs() < 1e-7);
            assert!((covariance[(axis + 3, axis + 3)].sqrt() - turn[axis].abs()).abs() < 1e-10);
        }
    }

    #[test]
    fn a_level_camera_has_its_y_axis_down() {
        let pose =
            SensorPose::looking_at(Vector3::new(0.0, 0.0, 1000.0), Vector3::zeros(), &Vector3::y(), 0.0)
                .unwrap();
        assert!((pose.orientation * Vector3::y() + Vector3::y()).norm() < 1e-12);
        assert!((pose.orientation * Vector3::z() + Vector3::z()).norm() < 1e-12);
    }
}
