//! What is computed for each cell, and how it is stored.

use crate::light::InPatient;
/// What cells are kept in: every adapter can write and filter it. Drivers in software interpolate
/// 8-bit texels by weights of 8 bits, which showed in pictures.
pub(super) const TEXELS: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// The quantity that is computed for each cell.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum LightQuantity {
    /// The share of each light that reaches it: where the light is, and the angle that it fills in
    /// radians.
    Shadows(Vec<(InPatient, f64)>),
    /// The share of directions that is open within this radius.
    Openness { radius_mm: f64 },
}
