//! The results of `relief track experiment`: the content of its JSON, tables and plots.

use relief_tracking::ExperimentOutcome;

#[derive(serde::Serialize)]
pub(crate) struct WayReport {
    pub(crate) way: &'static str,
    pub(crate) outcomes: Vec<ExperimentOutcome>,
}

#[derive(serde::Serialize)]
pub(crate) struct ExperimentReport {
    pub(crate) distance_mm: f64,
    pub(crate) noise_px: f64,
    pub(crate) repeats: u32,
    pub(crate) true_focal_px: f64,
    pub(crate) calibrated_focal_px: f64,
    pub(crate) runs: Vec<&'static str>,
    pub(crate) paper_mean: Vec<f64>,
    pub(crate) paper_deviation: Vec<f64>,
    pub(crate) ways: Vec<WayReport>,
}
