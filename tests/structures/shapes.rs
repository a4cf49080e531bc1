//! Shapes with closed forms as masks, on grids of any axes.

use relief_base::{Patient, Point, Transform};
use relief_volume::{Grid, Mask, Volume};

use glam::{DMat3, DVec3};

/// A grid around the origin, `size_mm` wide, turned by Euler angles; left-handed where asked for.
pub(crate) fn grid(size_mm: f64, spacing_mm: [f64; 3], angles: [f64; 3], is_mirrored: bool) -> Grid {
    let turn = DMat3::from_euler(glam::EulerRot::XYZ, angles[0], angles[1], angles[2]);
    let dims = spacing_mm.map(|step| (size_mm / step).ceil() as usize + 1);
    let sign = if is_mirrored { -1.0 } else { 1.0 };
    let axes = [turn.x_axis * spacing_mm[0], turn.y_axis * spacing_mm[1], turn.z_axis * spacing_mm[2] * sign];
    let half: DVec3 = (0..3).map(|n| axes[n] * (dims[n] as f64 - 1.0) / 2.0).sum();
    // Off the voxels by parts of one, so that nothing is symmetrical by chance.
    let origin = -half + DVec3::new(0.137, -0.211, 0.173);
    Grid::new(dims, Transform::from_axes(axes[0], axes[1], axes[2], origin)).unwrap()
}

/// The voxels whose centres are where `is_in` says.
pub(crate) fn mask(grid: &Grid, is_in: impl Fn(DVec3) -> bool) -> Mask {
    let mut mask = Mask::empty(grid.clone());
    for index in indices(grid) {
        let place: Point<Patient> =
            grid.patient_from_voxel() * Point::new(index[0] as f64, index[1] as f64, index[2] as f64);
        mask.set(index, is_in(place.xyz));
    }
    mask
}

/// A volume of 100 HU where `is_in` says, and -1000 elsewhere.
pub(crate) fn volume(grid: &Grid, is_in: impl Fn(DVec3) -> bool) -> Volume {
    let mask = mask(grid, is_in);
    let values = indices(grid).map(|index| if mask.contains(index) { 100 } else { -1000 }).collect();
    Volume::new(grid.clone(), values).unwrap()
}

pub(crate) fn indices(grid: &Grid) -> impl Iterator<Item = [usize; 3]> + use<> {
    let [nx, ny, nz] = grid.dims();
    (0..nz).flat_map(move |k| (0..ny).flat_map(move |j| (0..nx).map(move |i| [i, j, k])))
}

/// Voxels in and out at random, as equal everywhere as `percent` says.
pub(crate) fn noise(dims: [usize; 3], percent: u64, seed: u64) -> Mask {
    let grid = Grid::axis_aligned(dims, [1.0; 3], [0.0; 3]).unwrap();
    let mut mask = Mask::empty(grid.clone());
    let mut state = seed;
    for index in indices(&grid) {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        mask.set(index, (state >> 33) % 100 < percent);
    }
    mask
}
