//! Why a point cannot be snapped.

use super::feature::SnapFeature;
use relief_base::OutOfRange;

/// Why a place was not moved.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SnapError {
    /// A value is out of range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// Nothing of that kind is near.
    #[error("no {feature} within {radius_mm} mm of the point; try a larger radius or another target")]
    NotFound {
        /// The feature.
        feature: SnapFeature,
        /// The radius of the search, mm.
        radius_mm: f64,
    },
}
