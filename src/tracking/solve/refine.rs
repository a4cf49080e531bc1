//! Levenberg-Marquardt on SE(3) in pixels, with the covariance of its result.
//!
//! The cost is the chi-square of the view: squared pixel errors over `noise_px` squared, and the
//! squared part of the measured up across the predicted one over its sigma. Changes act from the
//! left: `exp(w) R P + t + v`.

use nalgebra::{Matrix2x6, Matrix3, Matrix6, Vector3, Vector6};

use super::{Gravity, PoseView};
use crate::pose::{Pose, cross_matrix};

/// A minimum.
#[derive(Clone, Copy, Debug)]
pub struct Minimum {
    /// `sensor_from_beacon`.
    pub pose: Pose,
    /// Chi-square of all measurements.
    pub cost: f64,
    /// Inverse covariance of a change to the left (radians, mm).
    pub information: Matrix6<f64>,
    /// Steps taken.
    pub iterations: usize,
}

impl Minimum {
    /// Covariance of the sensor's position (mm) and turn (radians) in beacon axes; `None` when the
    /// view leaves a direction open.
    #[must_use]
    pub fn covariance(&self) -> Option<Matrix6<f64>> {
        let covariance = self.information.cholesky()?.inverse();
        Some(self.pose.inverse_covariance(&covariance))
    }
}

/// Cost, half its gradient, and the Gauss-Newton matrix.
pub(super) struct Linear {
    pub(super) cost: f64,
    pub(super) gradient: Vector6<f64>,
    pub(super) information: Matrix6<f64>,
}

const MAX_ITERATIONS: usize = 60;

impl PoseView<'_> {
    /// Chi-square of the view at this pose; `None` when an LED is not before the camera.
    #[must_use]
    pub fn cost(&self, pose: &Pose) -> Option<f64> {
        let weight = self.noise_px.powi(-2);
        let mut cost = self.gravity.map_or(0.0, |gravity| gravity.cost(pose));
        for sighting in self.sightings {
            let pixel = self.camera.project(&pose.place(&sighting.led))?;
            cost += weight * (pixel - sighting.pixel).norm_squared();
        }
        Some(cost)
    }

    pub(super) fn linear(&self, pose: &Pose) -> Option<Linear> {
        let weight = self.noise_px.powi(-2);
        let mut linear = Linear { cost: 0.0, gradient: Vector6::zeros(), information: Matrix6::zeros() };
        for sighting in self.sightings {
            let turned = pose.rotation * sighting.led;
            let (pixel, by_point) = self.camera.project_with_jacobian(&(turned + pose.translation))?;
            let mut jacobian = Matrix2x6::zeros();
            jacobian.fixed_view_mut::<2, 3>(0, 0).copy_from(&(by_point * -cross_matrix(&turned)));
            jacobian.fixed_view_mut::<2, 3>(0, 3).copy_from(&by_point);
            let error = pixel - sighting.pixel;
            linear.cost += weight * error.norm_squared();
            linear.gradient += jacobian.tr_mul(&error) * weight;
            linear.information += jacobian.tr_mul(&jacobian) * weight;
        }
        if let Some(gravity) = self.gravity {
            gravity.add_to(pose, &mut linear);
        }
        Some(linear)
    }

    /// The minimum next to `start`; `None` when an LED is behind the camera there, or numbers run
    /// away.
    #[must_use]
    pub fn refine(&self, start: &Pose) -> Option<Minimum> {
        let mut pose = *start;
        let mut linear = self.linear(&pose)?;
        let mut damping = 1e-4;
        let mut iterations = 0;
        while iterations < MAX_ITERATIONS {
            iterations += 1;
            let mut matrix = linear.information;
            for i in 0..6 {
                matrix[(i, i)] += damping * linear.information[(i, i)].max(1e-12);
            }
            let step = matrix.cholesky()?.solve(&-linear.gradient);
            let next = pose.changed(&step);
            let gain = self.linear(&next).filter(|next| next.cost <= linear.cost);
            // Moves below 1e-11 radians and 1e-8 mm change nothing that is printed.
            let still = step.fixed_rows::<3>(0).norm() < 1e-11 && step.fixed_rows::<3>(3).norm() < 1e-8;
            if let Some(next_linear) = gain {
                (pose, linear) = (next, next_linear);
                damping = (damping * 0.1).max(1e-15);
            } else {
                damping *= 10.0;
            }
            if still || damping > 1e12 {
                break;
            }
        }
        pose.rotation.renormalize();
        linear.cost.is_finite().then_some(Minimum {
            pose,
            cost: linear.cost,
            information: linear.information,
            iterations,
        })
    }
}

impl Gravity {
    /// The part of the predicted up across the measured one, in sensor space.
    fn error(&self, pose: &Pose) -> (Vector3<f64>, Vector3<f64>) {
        let predicted = pose.rotation * self.up_in_beacon.into_inner();
        (predicted, predicted - self.up_in_sensor.into_inner())
    }

    /// Chi-square of the tilt.
    #[must_use]
    pub fn cost(&self, pose: &Pose) -> f64 {
        self.error(pose).1.norm_squared() / (self.sigma * self.sigma)
    }

    fn add_to(&self, pose: &Pose, linear: &mut Linear) {
        let (predicted, error) = self.error(pose);
        let weight = self.sigma.powi(-2);
        let by_turn: Matrix3<f64> = -cross_matrix(&predicted);
        linear.cost += weight * error.norm_squared();
        let gradient = by_turn.tr_mul(&error) * weight;
        let information = by_turn.tr_mul(&by_turn) * weight;
        let mut rows = linear.gradient.fixed_rows_mut::<3>(0);
        rows += gradient;
        let mut block = linear.information.fixed_view_mut::<3, 3>(0, 0);
        block += information;
    }
}
