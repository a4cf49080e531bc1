//! Why a point cannot be snapped.

use super::feature::SnapFeature;

/// Why a place was not moved.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SnapError {
    /// A value out of range.
    #[error("{key} is {found}; allowed is {allowed}")]
    OutOfRange {
        /// Its name.
        key: &'static str,
        /// The value.
        found: String,
        /// The allowed values, with the unit.
        allowed: String,
    },
    /// Nothing of that kind is near.
    #[error("no {feature} within {radius_mm} mm of the point; try a larger radius or another target")]
    NotFound {
        /// The feature.
        feature: SnapFeature,
        /// The radius of the search, mm.
        radius_mm: f64,
    },
}

pub(super) fn out_of_range(key: &'static str, found: &impl ToString, allowed: &str) -> SnapError {
    SnapError::OutOfRange { key, found: found.to_string(), allowed: allowed.to_owned() }
}
