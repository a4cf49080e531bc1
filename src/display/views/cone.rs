//! The view cone of a display: the angle between its outermost views, as the middle of the screen sees
//! their cameras.

use relief_base::OutOfRange;

/// The angle between the outermost views, degrees.
pub const VIEW_CONES_DEG: std::ops::RangeInclusive<f64> = 0.0..=90.0;

/// The view cone of a Looking Glass whose calibration has none, and of quilts, degrees: that of the
/// manufacturer's plug-ins.
pub const USUAL_VIEW_CONE_DEG: f64 = 35.0;

/// Refuses an angle that is out of range.
pub(crate) fn check_cone(path: &'static str, cone_deg: f64) -> Result<(), OutOfRange> {
    let range = VIEW_CONES_DEG;
    if range.contains(&cone_deg) {
        return Ok(());
    }
    Err(OutOfRange::new(path, cone_deg, format!("{} to {} degrees", range.start(), range.end())))
}
