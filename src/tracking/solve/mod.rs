//! Poses from one view: pixels of known LEDs, and which way is up.
//!
//! [`PoseView::solve`] finds the pose with the least sum of squared pixel errors: global starts
//! ([`start`]), each refined by Levenberg-Marquardt on SE(3) ([`PoseView::refine`]). [`paper`]
//! keeps the way of the 2009 paper; `ipopt`, of builds with that feature, has its solver. [`bound`]
//! says how well it could be done at all. Nothing here allocates, but `ipopt`.

pub(crate) mod bound;
#[cfg(feature = "ipopt")]
pub(crate) mod ipopt;
pub(crate) mod paper;
pub(crate) mod random;
mod refine;
mod start;

use nalgebra::{Unit, Vector2, Vector3};

use super::pose::Pose;
use super::sensor::Pinhole;
pub use refine::Minimum;

/// The most LEDs that a view can hold: the camera reports four blobs.
pub const MAX_SEEN: usize = 4;

/// An LED and the pixel where it is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Position in beacon space, mm.
    pub led: Vector3<f64>,
    /// Pixel, u right, v down.
    pub pixel: Vector2<f64>,
}

/// The reading of an accelerometer at rest: a direction known in both spaces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gravity {
    /// Up in beacon space.
    pub up_in_beacon: Unit<Vector3<f64>>,
    /// Up in sensor space, as measured.
    pub up_in_sensor: Unit<Vector3<f64>>,
    /// Standard deviation of its direction, radians, about either axis across it.
    pub sigma: f64,
}

/// One view to find a pose from.
#[derive(Clone, Copy, Debug)]
pub struct PoseView<'a> {
    /// The camera.
    pub camera: &'a Pinhole,
    /// Two to four LEDs.
    pub sightings: &'a [Sighting],
    /// Standard deviation of a pixel coordinate, px, quantisation included.
    pub noise_px: f64,
    /// Up, if it is known.
    pub gravity: Option<Gravity>,
}

/// The poses that explain a view: the best, and the next best that is another one.
#[derive(Clone, Copy, Debug)]
pub struct Solutions {
    /// The least cost.
    pub best: Minimum,
    /// Another pose that is a minimum too.
    pub second: Option<Minimum>,
}

/// Two minima are one when they are closer than this.
const SAME_ANGLE: f64 = 1e-3;
const SAME_MM: f64 = 0.5;

impl PoseView<'_> {
    /// The pose with the least cost, and the next best minimum; `None` when the view has fewer than
    /// three LEDs (two with gravity), or no pose has them before the camera.
    #[must_use]
    pub fn solve(&self) -> Option<Solutions> {
        self.solve_below(f64::INFINITY)
    }

    /// The same, without minima whose starts have a chi-square above `hopeless`: starts are close
    /// to their minima.
    #[must_use]
    pub fn solve_below(&self, hopeless: f64) -> Option<Solutions> {
        let mut starts = start::Starts::default();
        if self.sightings.len() >= 3 {
            start::global(self, &mut starts);
        }
        if self.gravity.is_some() {
            start::upright(self, &mut starts);
        }
        let mut best: Option<Minimum> = None;
        let mut second: Option<Minimum> = None;
        for pose in starts.poses() {
            let known = [best, second];
            let is_known = |pose: &Pose| known.iter().flatten().any(|found| is_same(&found.pose, pose));
            if is_known(pose) || self.cost(pose).is_none_or(|cost| cost > hopeless) {
                continue;
            }
            let Some(found) = self.refine(pose).filter(|found| !is_known(&found.pose)) else { continue };
            if best.is_none_or(|best| found.cost < best.cost) {
                second = best;
                best = Some(found);
            } else if second.is_none_or(|second| found.cost < second.cost) {
                second = Some(found);
            }
        }
        best.map(|best| Solutions { best, second })
    }

    /// Root mean square of the pixel coordinates' errors, px; `None` when an LED is behind the
    /// camera.
    #[must_use]
    pub fn rms_px(&self, pose: &Pose) -> Option<f64> {
        let mut sum = 0.0;
        for sighting in self.sightings {
            sum += (self.camera.project(&pose.place(&sighting.led))? - sighting.pixel).norm_squared();
        }
        Some((sum / (2 * self.sightings.len()) as f64).sqrt())
    }
}

fn is_same(a: &Pose, b: &Pose) -> bool {
    let (angle, distance) = a.distance(b);
    angle < SAME_ANGLE && distance < SAME_MM
}

#[cfg(test)]
mod tests;
