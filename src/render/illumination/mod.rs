//! Placed lights, shadows and occlusion of the ray-cast modes.
//!
//! What it is: [`Illumination`], the settings; cells of a coarse grid over the volume, each with the share of each
//! light that reaches it and the share of all directions that is open around it, filled on the GPU; and the uniform
//! by which rays light their samples. What it is not: light of mode path-traced, which follows its own paths.
//!
//! Cells are filled once for a volume, a transfer function or surfaces, a clip, and what light comes from, all in
//! patient space. A light in view space turns with the camera, so its cells are filled anew when that turns.
//!
//! Spaces: patient mm, voxel index, start space (see `shaders/lib/frame.wgsl`) of a camera that the volume alone decides.

mod cells;
mod illuminator;
mod settings;
mod stage;
mod uniform;

pub(super) use cells::{Cells, DIRECTIONS, disc_rays, sphere_direction};
pub(super) use illuminator::{Illuminator, Order};
pub use settings::{Illumination, Occlusion};
pub(super) use stage::lighting_layout;
