//! The grid of cells over a volume, and the directions in which a cell looks.
//!
//! Shared by the GPU's shader and its twin in lanes: it defines sample positions, not their values.
//! Voxel index; mm.

use std::f64::consts::PI;

use glam::DVec3;

use relief_volume::Grid;

/// Directions in which openness is looked for.
pub(crate) const DIRECTIONS: usize = 32;

/// Points of the disc of a light that has a size.
const DISC_RAYS: u32 = 6;

/// How cells tile a volume: from its outer faces on, so that the last ones may stick out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cells {
    /// Cells along i, j, k.
    pub(crate) dims: [usize; 3],
    /// Voxels along each edge of a cell.
    pub(crate) voxels: [usize; 3],
    /// The edge of a cube as large as a cell, mm.
    pub(crate) edge_mm: f64,
    /// Distance between voxels along the finest axis, mm.
    finest_mm: f64,
}

impl Cells {
    /// Most cells of a volume: 16 MiB of texels.
    pub(crate) const MOST: usize = 1 << 21;

    /// Cells of two voxels along the finest axis and about as wide along the others, or as much
    /// coarser as it takes.
    pub(crate) fn of(grid: &Grid) -> Self {
        let spacing = grid.spacing_mm();
        let finest = spacing.into_iter().fold(f64::INFINITY, f64::min);
        let mut wanted_mm = 2.0 * finest;
        loop {
            let voxels = spacing.map(|mm| (wanted_mm / mm).round().max(1.0) as usize);
            let dims: [usize; 3] = std::array::from_fn(|axis| grid.dims()[axis].div_ceil(voxels[axis]));
            if dims.iter().product::<usize>() <= Self::MOST {
                let volume: f64 = (0..3).map(|axis| voxels[axis] as f64 * spacing[axis]).product();
                let edge_mm = volume.cbrt();
                return Self { dims, voxels, edge_mm, finest_mm: finest };
            }
            wanted_mm += 0.25 * finest;
        }
    }

    /// Distance between samples on the way to a light, mm: thin walls are met.
    pub(crate) fn shadow_step_mm(&self) -> f64 {
        (0.5 * self.edge_mm).min(2.0 * self.finest_mm)
    }

    /// Distance between samples of openness within a radius, mm. Few samples suffice, since other
    /// directions compensate for the misses of one. A step stays within a brick.
    pub(crate) fn openness_step_mm(&self, radius_mm: f64) -> f64 {
        self.shadow_step_mm().max(radius_mm / 8.0).min(3.0 * self.finest_mm)
    }

    /// The start of rays: half a cell from its centre, so that the surface that a cell lies in casts
    /// no shadow on it.
    pub(crate) fn begin_mm(&self) -> f64 {
        0.5 * self.edge_mm
    }

    /// Voxel index of a cell's centre.
    pub(crate) fn center(&self, cell: [usize; 3]) -> DVec3 {
        let center = |axis: usize| (cell[axis] as f64 + 0.5) * self.voxels[axis] as f64 - 0.5;
        DVec3::new(center(0), center(1), center(2))
    }

    /// A step of one cell along a unit normal (patient axes), in cells.
    pub(crate) fn step_before(grid: &Grid, normal: DVec3) -> DVec3 {
        DVec3::from(grid.axis_directions().map(|axis| axis.dot(normal)))
    }

    /// The largest distance, in bricks, of a visible sample from the cells that it looks up: one cell
    /// before the surface, and one to the next centres.
    pub(crate) fn reach(&self, brick_edge: usize) -> usize {
        self.voxels.into_iter().map(|voxels| (2 * voxels + 1) / brick_edge + 1).max().unwrap_or(1)
    }
}

/// Direction `i` of [`DIRECTIONS`], evenly spread over the sphere (Fibonacci's lattice); unit
/// length.
pub(crate) fn sphere_direction(i: usize) -> DVec3 {
    let z = 1.0 - (2.0 * i as f64 + 1.0) / DIRECTIONS as f64;
    let (sine, cosine) = (i as f64 * PI * (3.0 - 5.0f64.sqrt())).sin_cos();
    let across = (1.0 - z * z).sqrt();
    DVec3::new(across * cosine, across * sine, z)
}

/// Rays towards a light that fills this angle, radians.
pub(crate) fn disc_rays(size: f64) -> u32 {
    if size > 0.0 { DISC_RAYS } else { 1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_about_cubes_and_never_too_many() {
        let cells = |dims, spacing| Cells::of(&Grid::axis_aligned(dims, spacing, [0.0; 3]).unwrap());
        let even = cells([65, 64, 64], [2.0; 3]);
        assert_eq!((even.dims, even.voxels), ([33, 32, 32], [2; 3]));
        assert!((even.edge_mm - 4.0).abs() < 1e-9 && (even.shadow_step_mm() - 2.0).abs() < 1e-9);
        assert_eq!([4.0, 20.0, 99.0].map(|radius_mm| even.openness_step_mm(radius_mm)), [2.0, 2.5, 6.0]);
        let thick = cells([64, 64, 20], [0.7, 0.7, 5.0]);
        assert_eq!((thick.dims, thick.voxels), ([32, 32, 20], [2, 2, 1]));
        for dims in [[512, 512, 400], [2048, 2048, 2000], [100_000, 100, 1]] {
            let found = cells(dims, [0.7, 0.7, 1.0]);
            let count: usize = found.dims.iter().product();
            assert!(count <= Cells::MOST && count > Cells::MOST / 4, "{count} cells");
            assert!((0..3).all(|axis| found.dims[axis] * found.voxels[axis] >= dims[axis]));
        }
        assert_eq!(even.center([0, 1, 2]), DVec3::new(0.5, 2.5, 4.5));
    }

    #[test]
    fn directions_are_even() {
        let directions: Vec<DVec3> = (0..DIRECTIONS).map(sphere_direction).collect();
        let mean = directions.iter().sum::<DVec3>() / DIRECTIONS as f64;
        assert!(mean.length() < 0.02, "{mean}");
        // Half of them on either side of any plane, but for those that are near it.
        for turn in 0..20 {
            let normal = DVec3::new(f64::from(turn).sin(), f64::from(turn * 3).cos(), 0.3).normalize();
            let open = directions.iter().filter(|direction| direction.dot(normal) > 0.0).count();
            assert!((14..=18).contains(&open), "{open} of 32 on one side of {normal}");
        }
        assert!(directions.iter().all(|direction| (direction.length() - 1.0).abs() < 1e-12));
    }
}
