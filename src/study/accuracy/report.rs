//! The result of one way of placing.

use serde::Serialize;

use super::PointerKind;

/// The errors of one way to place landmarks.
#[derive(Debug, Serialize)]
pub struct WayReport {
    /// The device.
    #[serde(serialize_with = "name")]
    pub pointer: PointerKind,
    /// `ray` or `tip`.
    pub way: &'static str,
    /// The number of the mapping among those of the pointer.
    #[serde(skip)]
    pub(super) number: usize,
    /// `direct`, `lever` or `default`.
    pub mapping: &'static str,
    /// Distance from the remote's camera to the tip, mm.
    pub lever_mm: f64,
    /// `none`, `boundary` or `gradient`.
    pub snap: &'static str,
    /// Median error, mm.
    pub median_mm: f64,
    /// Median error of each seed, mm.
    pub medians_mm: Vec<f64>,
    /// 95th percentile of the errors, mm.
    pub p95_mm: f64,
    /// Largest error, mm.
    pub max_mm: f64,
    /// Placements without a surface under the cursor or without a feature to snap to; the latter
    /// keep the unsnapped place.
    pub missed: usize,
    /// Errors, mm, by seed and landmark.
    pub errors_mm: Vec<f64>,
    /// Number of errors before the current seed.
    #[serde(skip)]
    before: usize,
}

impl WayReport {
    /// All combinations of a pointer's ways, mappings and snapping, without placements.
    pub(super) fn all(pointer: PointerKind, distance_mm: f64) -> Vec<Self> {
        let mut ways = Vec::new();
        for &way in pointer.ways() {
            for (number, (mapping, options)) in pointer.mappings(distance_mm).iter().enumerate() {
                for snap in ["none", "boundary", "gradient"] {
                    ways.push(Self {
                        pointer,
                        way,
                        number,
                        mapping,
                        lever_mm: options.tip_mm,
                        snap,
                        median_mm: f64::NAN,
                        medians_mm: Vec::new(),
                        p95_mm: f64::NAN,
                        max_mm: f64::NAN,
                        missed: 0,
                        errors_mm: Vec::new(),
                        before: 0,
                    });
                }
            }
        }
        ways
    }

    /// Ends a seed: the errors since the last call are those of one seed.
    pub(super) fn end_seed(&mut self) {
        self.medians_mm.push(quantile(&self.errors_mm[self.before..], 0.5));
        self.before = self.errors_mm.len();
    }

    pub(super) fn summarise(&mut self) {
        [self.median_mm, self.p95_mm, self.max_mm] =
            [0.5, 0.95, 1.0].map(|share| quantile(&self.errors_mm, share));
    }
}

fn name<S: serde::Serializer>(pointer: &PointerKind, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(pointer.name())
}

/// The quantile of `errors_mm` at `share`, by nearest rank.
fn quantile(errors_mm: &[f64], share: f64) -> f64 {
    let mut sorted = errors_mm.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = ((sorted.len() as f64 - 1.0) * share).round();
    sorted.get(at as usize).copied().unwrap_or(f64::NAN)
}
