//! The paper's filter: a plain Kalman filter with constant velocity, on poses that were solved
//! before.
//!
//! Each of six coordinates has its own: three of position (mm), three of the turn since the last
//! estimate (radians, beacon axes). What one view knows better than another is lost here; that is
//! what [`super::ErrorStateFilter`] keeps.

use nalgebra::{Matrix2, Matrix6, UnitQuaternion, Vector2, Vector3};

use super::MotionDensity;
use crate::pose::SensorPose;

/// A coordinate, its speed, and their covariance.
#[derive(Clone, Copy, Debug)]
struct Axis {
    state: Vector2<f64>,
    covariance: Matrix2<f64>,
}

impl Axis {
    fn new(value: f64, variance: f64, speed_variance: f64) -> Self {
        Self {
            state: Vector2::new(value, 0.0),
            covariance: Matrix2::from_diagonal(&Vector2::new(variance, speed_variance)),
        }
    }

    fn predict(&mut self, dt: f64, density: f64) {
        let transition = Matrix2::new(1.0, dt, 0.0, 1.0);
        let noise = Matrix2::new(dt.powi(3) / 3.0, dt.powi(2) / 2.0, dt.powi(2) / 2.0, dt) * density;
        self.state = transition * self.state;
        self.covariance = transition * self.covariance * transition.transpose() + noise;
    }

    fn update(&mut self, value: f64, variance: f64) {
        let gain = self.covariance.column(0) / (self.covariance.m11 + variance);
        self.state += gain * (value - self.state.x);
        self.covariance -= gain * self.covariance.row(0);
    }
}

/// The filter.
#[derive(Clone, Debug)]
pub(crate) struct PoseFilter {
    position: [Axis; 3],
    /// The turn since `reference`; its value is zero except during an update.
    turn: [Axis; 3],
    reference: UnitQuaternion<f64>,
    motion: MotionDensity,
}

impl PoseFilter {
    /// Begins at a solved pose and the covariance of its position (mm) and turn (radians).
    #[must_use]
    pub(crate) fn new(pose: &SensorPose, covariance: &Matrix6<f64>, motion: MotionDensity) -> Self {
        Self {
            position: std::array::from_fn(|i| Axis::new(pose.position[i], covariance[(i, i)], 500.0 * 500.0)),
            turn: std::array::from_fn(|i| Axis::new(0.0, covariance[(i + 3, i + 3)], 4.0)),
            reference: pose.orientation,
            motion,
        }
    }

    /// Moves on by `seconds`.
    pub(crate) fn predict(&mut self, seconds: f64) {
        let dt = seconds.max(0.0);
        self.position.iter_mut().for_each(|axis| axis.predict(dt, self.motion.acceleration));
        self.turn.iter_mut().for_each(|axis| axis.predict(dt, self.motion.angular_acceleration));
        self.fold();
    }

    /// Takes a solved pose with the covariance of its position and turn, of which the diagonal
    /// counts.
    pub(crate) fn update(&mut self, pose: &SensorPose, covariance: &Matrix6<f64>) {
        let turn = (pose.orientation * self.reference.inverse()).scaled_axis();
        for i in 0..3 {
            self.position[i].update(pose.position[i], covariance[(i, i)]);
            self.turn[i].update(turn[i], covariance[(i + 3, i + 3)]);
        }
        self.fold();
    }

    /// The turn goes into the reference, so that it stays small.
    fn fold(&mut self) {
        let turn = Vector3::from(self.turn.map(|axis| axis.state.x));
        self.reference = UnitQuaternion::from_scaled_axis(turn) * self.reference;
        self.turn.iter_mut().for_each(|axis| axis.state.x = 0.0);
    }

    /// The estimate.
    #[must_use]
    pub(crate) fn pose(&self) -> SensorPose {
        SensorPose {
            position: Vector3::from(self.position.map(|axis| axis.state.x)),
            orientation: self.reference,
        }
    }

    /// Covariance of position (mm) and turn (radians, beacon axes): a diagonal.
    #[must_use]
    pub(crate) fn covariance(&self) -> Matrix6<f64> {
        let axes = self.position.iter().chain(&self.turn).map(|axis| axis.covariance.m11);
        Matrix6::from_diagonal(&nalgebra::Vector6::from_iterator(axes))
    }
}
