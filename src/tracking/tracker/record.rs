//! A pose as it is written: one JSON object a line.

use super::{TrackedSample, TrackingState};

/// A line of a poses file.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseRecord {
    /// Time of the report, ns.
    pub t_ns: u64,
    /// The tracking state.
    pub state: TrackingState,
    /// The sensor in the beacon's frame, mm.
    pub position_mm: Option<[f64; 3]>,
    /// Turns sensor axes into beacon axes; w is not negative.
    pub orientation_xyzw: Option<[f64; 4]>,
    /// 36 numbers, row by row: position (mm), then turn (radians) about beacon axes.
    pub covariance: Option<Vec<f64>>,
    /// Root mean square of the matched blobs' errors, px.
    pub rms_px: Option<f64>,
    /// The number of matched blobs.
    pub leds: usize,
    /// Time that the pose took, µs.
    pub solve_us: f64,
}

impl PoseRecord {
    /// The record of a sample that took `solve_us`.
    #[must_use]
    pub fn new(sample: &TrackedSample, solve_us: f64) -> Self {
        let row_major = |covariance: nalgebra::Matrix6<f64>| covariance.transpose().iter().copied().collect();
        Self {
            t_ns: sample.t_ns,
            state: sample.state,
            position_mm: sample.pose.map(|pose| pose.position.into()),
            orientation_xyzw: sample.pose.map(|pose| pose.orientation_xyzw()),
            covariance: sample.covariance.map(row_major),
            rms_px: sample.rms_px,
            leds: sample.leds,
            solve_us,
        }
    }
}
