//! How a tracker works: filter, solver, noise.

use crate::filter::MotionDensity;
use crate::report::calibration::AccelerometerCalibration;
use crate::report::motion_plus::GyroCalibration;
use crate::solve::bound::quantised_noise;

/// The filter that joins the poses of single frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilterKind {
    /// Nothing: each frame on its own.
    None,
    /// The error-state filter on pixels.
    ErrorState,
    /// The paper's plain Kalman filter on poses.
    Pose,
}

/// How the pose of a single frame is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SolverKind {
    /// Least squared pixel errors, by Levenberg-Marquardt.
    Lm,
    /// The paper's linearised energy, by an interior-point method.
    Paper,
    /// The same energy by IPOPT itself; a step allocates.
    #[cfg(feature = "ipopt")]
    Ipopt,
}

/// See the fields; [`TrackerOptions::default`] suits a hand that holds a Wiimote.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerOptions {
    /// The filter that joins frames.
    pub filter: FilterKind,
    /// Method that finds the pose of a single frame.
    pub solver: SolverKind,
    /// Standard deviation of a blob's coordinate, px, rounding to whole pixels included.
    pub noise_px: f64,
    /// How the Wiimote may move.
    pub motion: MotionDensity,
    /// Standard deviation of up by the accelerometer while tracking fewer than four LEDs, radians.
    /// A hand's acceleration is the largest part of it, and lasts for about 0.15 s.
    pub gravity_sigma: f64,
    /// The same while searching.
    pub search_gravity_sigma: f64,
    /// Whether a MotionPlus' rates are used.
    pub use_gyroscope: bool,
    /// Standard deviation of its rates, rad/s.
    pub gyroscope_sigma: f64,
    /// LEDs whose pictures are nearer than this are one blob, px.
    pub merge_px: f64,
    /// The scale of accelerometer counts.
    pub accelerometer: AccelerometerCalibration,
    /// The scale of gyroscope counts.
    pub gyroscope: GyroCalibration,
}

impl Default for TrackerOptions {
    fn default() -> Self {
        Self {
            filter: FilterKind::ErrorState,
            solver: SolverKind::Lm,
            noise_px: quantised_noise(0.5),
            motion: MotionDensity::HAND,
            gravity_sigma: 3_f64.to_radians(),
            search_gravity_sigma: 3_f64.to_radians(),
            use_gyroscope: false,
            gyroscope_sigma: 0.01,
            merge_px: 20.0,
            accelerometer: AccelerometerCalibration::TYPICAL,
            gyroscope: GyroCalibration::TYPICAL,
        }
    }
}
