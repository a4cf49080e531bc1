//! The voxels that moving pictures are cast through.

use relief_render::{Detail, Mode, RenderRequest, TableRule};
use relief_volume::{Grid, Projection};

/// Smallest side of a volume that has a coarse form, voxels.
const LEAST_SIDE: usize = 16;
/// Pixels of a moving picture are at least this wide, in voxels, where coarse voxels do.
const LEAST_PIXEL: f64 = 0.8;

/// The detail that a moving picture of this request is cast through: coarse voxels where a pixel at
/// the focal point is about a voxel wide or wider, so that a coarse voxel covers two pixels at
/// most.
///
/// Modes that show extremes or sums keep theirs, and so does a picture that shows the table.
#[must_use]
pub fn moving_detail(request: &RenderRequest, grid: &Grid) -> Detail {
    let blends = matches!(request.mode, Mode::Composite | Mode::Isosurface);
    let has_form = request.table == TableRule::Remove && request.labels.is_none();
    let is_large = grid.dims().iter().all(|side| *side >= LEAST_SIDE);
    let finest_mm = grid.spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
    let is_wide = pixel_mm(request) >= LEAST_PIXEL * finest_mm;
    if blends && has_form && is_large && is_wide { Detail::Coarse } else { Detail::Full }
}

/// Width of a pixel at the focal point, mm.
fn pixel_mm(request: &RenderRequest) -> f64 {
    let [_, half] = request.camera.half_extent(request.size_px);
    let distance = match request.camera.projection() {
        Projection::Perspective { .. } => request.camera.distance_mm(),
        Projection::Orthographic { .. } => 1.0,
    };
    2.0 * half * distance / f64::from(request.size_px[1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use relief_render::SceneFile;
    use relief_volume::Orbit;

    #[test]
    fn moving_pictures_are_coarse_where_a_pixel_covers_a_voxel() {
        let grid = Grid::axis_aligned([100, 100, 50], [1.0, 1.0, 2.0], [0.0; 3]).expect("a grid");
        let scene = SceneFile::default().with_size([160, 100]).resolve(&grid, &Orbit::default());
        let request = scene.expect("a scene").request;
        let width_mm = pixel_mm(&request);
        let sized = |factor: f64| RenderRequest {
            size_px: request.size_px.map(|side| (f64::from(side) * width_mm / factor).round() as u32),
            ..request.clone()
        };
        // Pixels of about 1.2 and 0.5 voxels.
        assert_eq!(moving_detail(&sized(1.2), &grid), Detail::Coarse);
        assert_eq!(moving_detail(&sized(0.5), &grid), Detail::Full);
        let other = RenderRequest { mode: Mode::Mip, ..sized(1.2) };
        assert_eq!(moving_detail(&other, &grid), Detail::Full, "means have other maxima");
        let thin = Grid::axis_aligned([100, 100, 4], [1.0, 1.0, 2.0], [0.0; 3]).expect("a grid");
        assert_eq!(moving_detail(&sized(1.2), &thin), Detail::Full);
    }
}
