//! A camera's parameters from recorded views of a beacon.
//!
//! Bundle adjustment: the camera's seven numbers and a pose for each view, by Levenberg-Marquardt
//! on all pixels at once. The poses are eliminated view by view (Schur complement), so the work
//! grows with the number of views. A view of four LEDs has eight equations for six unknowns of its
//! own: two remain for the camera. Therefore it needs many views, from different sides and all over
//! the picture. An insufficient set is refused with the reason.

mod adjust;
mod choose;

pub(crate) use adjust::adjust;
pub use adjust::{Parameter, Square};
pub use choose::{BlobIdentifier, CalibrationView, choose_views, moving_views};

use super::sensor::{Pinhole, PinholeError};
use super::solve::{PoseView, Sighting};

/// The camera's numbers that are calibrated; the others stay as they were at the start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CalibrationModel {
    /// One focal length and the principal point.
    Square,
    /// Two focal lengths and the principal point.
    Pinhole,
    /// These and the skew.
    Skew,
    /// Two focal lengths, the principal point and k1.
    Radial,
}

/// Fewer views are refused.
pub(crate) const MIN_VIEWS: usize = 12;
/// Views whose directions are within this angle of each other tell too little, radians.
const MIN_TILT: f64 = 0.35;
/// The share of the picture's width and height that the blobs have to cover.
const MIN_COVERAGE: f64 = 0.4;
/// A focal length known less well is not calibrated, as a share of it.
const MAX_FOCAL_SIGMA: f64 = 0.01;
/// One view in this number is held out.
const HOLD_OUT: usize = 5;

/// A calibrated camera and how good it is.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// The camera.
    pub camera: Pinhole,
    /// Covariance of fx, fy, skew, cx, cy, k1, k2; 0 for those that were not looked for.
    pub covariance: Square,
    /// Their standard deviations.
    pub sigma: [f64; 7],
    /// Correlation of fx with the distance of the first view: near 1, only their ratio is known.
    pub focal_distance_correlation: f64,
    /// Root mean square of the pixel errors of all views used, px.
    pub rms_px: f64,
    /// The same of each view.
    pub view_rms_px: Vec<f64>,
    /// The same of views that were not used, px.
    pub held_out_rms_px: f64,
    /// Standard deviation of a coordinate, estimated from the residuals, px.
    pub noise_px: f64,
    /// The largest angle between the directions of two views, radians.
    pub tilt: f64,
    /// Share of the picture's width and height that the blobs cover.
    pub coverage: [f64; 2],
}

/// Views that no camera follows from.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// Too few.
    #[error("{0} different views with four LEDs, needed: at least {MIN_VIEWS}; move the remote more")]
    Views(usize),
    /// All from one side.
    #[error("the views span {found_deg:.0} degrees, needed: at least 20; turn around the beacon")]
    Tilt {
        /// The largest angle between two.
        found_deg: f64,
    },
    /// All in one part of the picture.
    #[error(
        "the blobs cover {width:.0} x {height:.0} % of the picture, needed: at least 40 x 40; aim next to the beacon too"
    )]
    Coverage {
        /// Share of the width, %.
        width: f64,
        /// Share of the height, %.
        height: f64,
    },
    /// Not known in the end.
    #[error("the uncertainty of fx is {0:.1} px; move closer and view the beacon from more sides")]
    Uncertain(f64),
    /// The errors do not fit a camera at all.
    #[error("the errors are {0:.2} px, expected below 3; is it the right beacon?")]
    Misfit(f64),
    /// Numbers that no camera has.
    #[error(transparent)]
    Camera(#[from] PinholeError),
    /// The adjustment broke down.
    #[error("the adjustment does not converge; is it the right beacon?")]
    Diverged,
}

/// Calibrates from views that were chosen to differ, beginning at `start`.
///
/// # Errors
/// When the views are too few or too alike, or the result is not known well.
pub fn calibrate_camera(
    views: &[CalibrationView],
    start: &Pinhole,
    model: CalibrationModel,
) -> Result<Calibration, CalibrationError> {
    if views.len() < MIN_VIEWS {
        return Err(CalibrationError::Views(views.len()));
    }
    let tilt = choose::tilt(views);
    if tilt < MIN_TILT {
        return Err(CalibrationError::Tilt { found_deg: tilt.to_degrees() });
    }
    let coverage = choose::coverage(views);
    if coverage.iter().any(|share| *share < MIN_COVERAGE) {
        let [width, height] = coverage.map(|share| share * 100.0);
        return Err(CalibrationError::Coverage { width, height });
    }
    let is_held_out = |at: usize| at % HOLD_OUT == HOLD_OUT - 1;
    let part = |wanted: bool| views.iter().enumerate().filter(move |(at, _)| is_held_out(*at) == wanted);
    let used: Vec<CalibrationView> = part(false).map(|(_, view)| view.clone()).collect();
    let adjusted = adjust(&used, start, model).ok_or(CalibrationError::Diverged)?;
    let camera = adjusted.camera.checked()?;
    if adjusted.rms_px > 3.0 {
        return Err(CalibrationError::Misfit(adjusted.rms_px));
    }
    let sigma: [f64; 7] = std::array::from_fn(|at| adjusted.covariance[(at, at)].sqrt());
    if sigma[0] > MAX_FOCAL_SIGMA * camera.fx {
        return Err(CalibrationError::Uncertain(sigma[0]));
    }
    let held_out: Vec<f64> = part(true).filter_map(|(_, view)| rms_of(&camera, &view.sightings)).collect();
    let held_out_rms_px =
        (held_out.iter().map(|rms| rms * rms).sum::<f64>() / held_out.len().max(1) as f64).sqrt();
    Ok(Calibration {
        camera,
        covariance: adjusted.covariance,
        sigma,
        focal_distance_correlation: adjusted.focal_distance_correlation,
        rms_px: adjusted.rms_px,
        view_rms_px: adjusted.view_rms_px,
        held_out_rms_px,
        noise_px: adjusted.noise_px,
        tilt,
        coverage,
    })
}

/// The residuals of a view when its pose is found with this camera.
fn rms_of(camera: &Pinhole, sightings: &[Sighting]) -> Option<f64> {
    let view = PoseView { camera, sightings, noise_px: 1.0, gravity: None };
    view.rms_px(&view.solve()?.best.pose)
}

#[cfg(test)]
mod tests;
