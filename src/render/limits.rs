//! The depth limits of a picture.

use relief_base::DepthLimits;
use relief_volume::{Camera, Grid};
/// The depth limits of a picture, view depth in mm: the volume's bounding sphere around the focal
/// point, along the viewing axis. They are steady while the camera circles. Near is 0 where the eye
/// is within the sphere.
#[must_use]
pub fn depth_limits(camera: &Camera, grid: &Grid) -> DepthLimits {
    let radius =
        grid.corners().into_iter().map(|corner| corner.distance(camera.look_at())).fold(0.0, f64::max);
    let (near_mm, far_mm) = ((camera.distance_mm() - radius).max(0.0), camera.distance_mm() + radius);
    DepthLimits { near_mm, far_mm }
}
