//! The cameras of the eyes that look at a display: beside the camera of a picture, converging on
//! the plane of the screen.
//!
//! Spaces: eyes are in eye separations to the right of the middle, depth is view depth in mm.

use relief_base::{DepthLimits, OutOfRange};
use relief_display::{DisplaySettings, TrueViews};
use relief_volume::{Camera, CameraError, Projection};

/// Why a picture has no views beside it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TrueViewsError {
    /// A setting of the display is out of range.
    #[error(transparent)]
    Settings(#[from] OutOfRange),
    /// The depth that the display shows on its screen is not before the camera.
    #[error("the plane of the screen is behind the camera: set near_mm and far_mm, or another offset")]
    ScreenBehindCamera,
    /// The camera has no eye.
    #[error("true views need a perspective: a parallel projection has no eye to be moved")]
    Parallel(#[source] CameraError),
}

/// The plane of the screen before a camera, and the distance of eyes there.
///
/// # Errors
/// When the settings are invalid, or that plane is behind the camera.
pub fn true_views(
    display: &DisplaySettings,
    camera: &Camera,
    size_px: [u32; 2],
    limits: DepthLimits,
) -> Result<TrueViews, TrueViewsError> {
    let [half_width, _] = camera.half_extent(size_px);
    let parallax = display.encoder()?.parallax(size_px[0]);
    parallax.true_views(limits, half_width, size_px[0]).ok_or(TrueViewsError::ScreenBehindCamera)
}

/// The settings with their view cone converted to eye separations for this camera. Settings without a
/// view cone, or with a layout that has no views, come back unchanged.
///
/// A parallel projection, or a screen behind the camera, has no angle between eyes. There the view
/// cone of a panel is left out.
///
/// # Errors
/// When the settings are invalid, or set a view cone that this camera cannot have.
pub fn with_span_of_cone(
    display: &DisplaySettings,
    camera: &Camera,
    size_px: [u32; 2],
    limits: DepthLimits,
) -> Result<DisplaySettings, OutOfRange> {
    let has_views = display.layout.view_count() > 0;
    let Some(cone_deg) = display.view_cone().filter(|_| has_views) else { return Ok(display.clone()) };
    let refused = |allowed: &str| match display.view_cone_deg {
        Some(cone_deg) => Err(OutOfRange::new("display.view_cone_deg", cone_deg, allowed)),
        None => Ok(display.clone()),
    };
    if !matches!(camera.projection(), Projection::Perspective { .. }) {
        return refused("null in a parallel projection, which has no angle between eyes");
    }
    match true_views(display, camera, size_px, limits) {
        Ok(setup) => {
            let view_span = Some(setup.span_of_cone(cone_deg));
            Ok(DisplaySettings { view_span, view_cone_deg: None, ..display.clone() })
        }
        Err(TrueViewsError::Settings(error)) => Err(error),
        Err(_) => refused("null where the plane of the screen is behind the camera: see near_mm and far_mm"),
    }
}

/// The cameras of these eyes before the screen that `setup` describes.
///
/// # Errors
/// In a parallel projection, whose eye is nowhere.
pub fn eye_cameras(setup: &TrueViews, camera: &Camera, eyes: &[f64]) -> Result<Vec<Camera>, TrueViewsError> {
    let beside = |eye: &f64| camera.seen_from_beside(eye * setup.baseline_mm, setup.converging_mm);
    eyes.iter().map(|eye| beside(eye).map_err(TrueViewsError::Parallel)).collect()
}
