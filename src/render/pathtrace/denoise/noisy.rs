//! The input of the denoiser: the sums of a picture, and its guides.

use bytemuck::{Pod, Zeroable};

/// The guides of one pixel: the mirror of `struct Guide` in `shaders/guides.wgsl`,
/// which defines meanings and units.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(in crate::pathtrace) struct Guide {
    pub(in crate::pathtrace) albedo: [f32; 3],
    pub(in crate::pathtrace) coverage: f32,
    pub(in crate::pathtrace) normal: [f32; 3],
    pub(in crate::pathtrace) distance_mm: f32,
    pub(in crate::pathtrace) light: [f32; 3],
    pub(in crate::pathtrace) unused_a: f32,
    pub(in crate::pathtrace) shadowed: [f32; 3],
    pub(in crate::pathtrace) unused_b: f32,
}

/// The sums of a picture's passes; rows from the top, linear red, green, blue and collisions.
pub(in crate::pathtrace) struct NoisyPicture {
    pub(in crate::pathtrace) size_px: [u32; 2],
    pub(in crate::pathtrace) passes: u32,
    pub(in crate::pathtrace) all: Vec<[f32; 4]>,
    /// Of the passes of odd numbers.
    pub(in crate::pathtrace) odd: Vec<[f32; 4]>,
    pub(in crate::pathtrace) guides: Vec<Guide>,
}
