//! What `relief track experiment` measured: the content of its JSON, tables and plots.

use relief_tracking::ExperimentOutcome;

#[derive(serde::Serialize)]
pub(super) struct WayReport {
    pub(super) way: &'static str,
    pub(super) outcomes: Vec<ExperimentOutcome>,
}

#[derive(serde::Serialize)]
pub(super) struct ExperimentReport {
    pub(super) distance_mm: f64,
    pub(super) noise_px: f64,
    pub(super) repeats: u32,
    pub(super) true_focal_px: f64,
    pub(super) calibrated_focal_px: f64,
    pub(super) runs: Vec<&'static str>,
    pub(super) paper_mean: Vec<f64>,
    pub(super) paper_deviation: Vec<f64>,
    pub(super) ways: Vec<WayReport>,
}
