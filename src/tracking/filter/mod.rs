//! The pose over time.
//!
//! [`ErrorStateFilter`] is an error-state Kalman filter on SE(3) that takes pixels, gravity and
//! angular rates; [`PoseFilter`] is the paper's, a plain Kalman filter on poses that were solved
//! frame by frame. Both move at a constant velocity but for white acceleration, whose density is
//! [`MotionDensity`]'s.

pub(crate) mod error_state;
mod plain;

pub use error_state::{ErrorStateFilter, State, Update, Verdict};
pub(crate) use plain::PoseFilter;

/// How the Wiimote may move: densities of white acceleration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionDensity {
    /// Along each axis, mm²/s³.
    pub acceleration: f64,
    /// About each axis, rad²/s³.
    pub angular_acceleration: f64,
}

impl MotionDensity {
    /// In a hand: it changes its speed by about 600 mm/s and 3 rad/s in a second.
    pub const HAND: Self = Self { acceleration: 4e5, angular_acceleration: 10.0 };
    /// On a robot's arm that goes slowly from stop to stop: by about 13 mm/s and 0.5 degrees/s in a
    /// second.
    pub const ARM: Self = Self { acceleration: 160.0, angular_acceleration: 7.5e-5 };
}
