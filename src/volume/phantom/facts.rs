//! The grid of a phantom, and its truth before the voxels are counted and hashed.
//!
//! Space: patient LPS, mm.

use super::truth::{Material, PhantomLandmark, Surface};
use crate::Grid;

/// Dimensions and patient placement of the voxels to be made.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placement {
    pub(super) dims: [usize; 3],
    pub(super) spacing_mm: [f64; 3],
    pub(super) origin_mm: [f64; 3],
}

impl Placement {
    /// Voxels that fill a box of `extent_mm` around `center_mm`.
    pub(super) fn centered(dims: [usize; 3], extent_mm: [f64; 3], center_mm: [f64; 3]) -> Self {
        let spacing_mm = std::array::from_fn(|a| extent_mm[a] / dims[a] as f64);
        let origin_mm = std::array::from_fn(|a| center_mm[a] - spacing_mm[a] * (dims[a] as f64 - 1.0) / 2.0);
        Self { dims, spacing_mm, origin_mm }
    }

    pub(super) fn grid(&self) -> Grid {
        Grid::axis_aligned(self.dims, self.spacing_mm, self.origin_mm)
            .expect("sizes are at least 16 and extents positive, so the grid holds voxels")
    }

    /// Patient coordinate of a voxel centre along one axis, mm.
    pub(super) fn coordinate(&self, axis: usize, index: usize) -> f64 {
        self.origin_mm[axis] + self.spacing_mm[axis] * index as f64
    }
}

/// The truth of a phantom, without its voxels.
#[derive(Debug, Default)]
pub(super) struct PhantomFacts {
    pub(super) noise_sigma_hu: f64,
    pub(super) gradient_hu_per_mm: Option<[f64; 3]>,
    pub(super) materials: Vec<Material>,
    pub(super) surfaces: Vec<Surface>,
    pub(super) landmarks: Vec<PhantomLandmark>,
}
