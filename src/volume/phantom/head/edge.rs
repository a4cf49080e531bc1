//! The edge between two materials.

use crate::phantom::sdf::smooth_step;
/// How sharp the edges between tissues are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edge {
    pub(super) half_width_mm: f32,
}

impl Edge {
    /// Edges as wide as a voxel and the blur of a scanner make them.
    pub(super) fn of_voxels(spacing_mm: [f64; 3]) -> Self {
        let voxel = spacing_mm.iter().product::<f64>().cbrt() as f32;
        Self { half_width_mm: 0.85 * (voxel * voxel + 0.35).sqrt() }
    }

    /// Share of a voxel that lies inside a surface at this signed distance, 0..1.
    pub(super) fn cover(self, distance: f32) -> f32 {
        smooth_step(self.half_width_mm, -self.half_width_mm, distance)
    }

    /// `hu` with a tissue of value `over` painted over it.
    pub(super) fn paint(self, hu: f32, over: f32, distance: f32) -> f32 {
        hu + (over - hu) * self.cover(distance)
    }
}
