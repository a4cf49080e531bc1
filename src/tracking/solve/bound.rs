//! How well a pose can be known from a view at all: the bound of Cramer and Rao.
//!
//! No unbiased estimate has a covariance below the inverse of `sum J' S^-1 J`, J being the
//! derivative of each measurement by the pose. Whole pixels add 1/12 px² to the noise.

use nalgebra::Matrix6;

use super::PoseView;
use crate::pose::Pose;

/// Variance of rounding to whole pixels.
pub(crate) const QUANTISATION_VARIANCE: f64 = 1.0 / 12.0;

/// Standard deviation of a coordinate with this much noise before it is rounded to whole pixels.
#[must_use]
pub fn quantised_noise(noise_px: f64) -> f64 {
    (noise_px * noise_px + QUANTISATION_VARIANCE).sqrt()
}

impl PoseView<'_> {
    /// The least covariance of position (mm) and turn (radians) of the sensor in beacon axes at
    /// this true pose; `None` when the view leaves a direction open.
    #[must_use]
    pub fn bound(&self, truth: &Pose) -> Option<Matrix6<f64>> {
        let information = self.linear(truth)?.information;
        Some(truth.inverse_covariance(&information.cholesky()?.inverse()))
    }
}
