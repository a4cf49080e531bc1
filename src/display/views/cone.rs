//! The view cone of a display: the angle between the cameras of its outermost views, seen from the middle
//! of the screen.

use relief_base::OutOfRange;

/// Permitted view cones, degrees.
pub const VIEW_CONES_DEG: std::ops::RangeInclusive<f64> = 0.0..=90.0;

/// The view cone of quilts, and of a Looking Glass whose calibration states none, degrees. The
/// manufacturer's plug-ins have the same default.
pub const USUAL_VIEW_CONE_DEG: f64 = 35.0;

/// Refuses an angle that is out of range.
pub(crate) fn check_cone(path: &'static str, cone_deg: f64) -> Result<(), OutOfRange> {
    let range = VIEW_CONES_DEG;
    if range.contains(&cone_deg) {
        return Ok(());
    }
    Err(OutOfRange::new(path, cone_deg, format!("{} to {} degrees", range.start(), range.end())))
}
