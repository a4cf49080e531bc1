//! Placed lights, shadows and occlusion of the ray-cast modes.
//!
//! [`Illumination`] holds the settings. A coarse grid over the volume has cells; each stores the
//! share of each light that reaches it, and the share of directions that are open around it. The
//! GPU fills the cells, and rays light their samples by them through a uniform. Mode path-traced
//! does not use this; its light follows its own paths.
//!
//! Cells are filled once for a volume, a transfer function or surfaces, a clip, and the light
//! comes from, all in patient space. A light in view space turns with the camera, so its cells are
//! filled again when that turns.
//!
//! Spaces: patient mm, voxel index, start space (see `shaders/lib/frame.wgsl`) of a camera that
//! depends only on the volume.

mod cells;
mod illuminator;
mod quantity;
mod settings;
mod stage;
mod uniform;

pub(super) use cells::{Cells, DIRECTIONS, disc_rays, sphere_direction};
pub(super) use illuminator::{IlluminationJob, Illuminator};
pub(super) use quantity::{FillingKey, LightQuantity};
pub use settings::{Illumination, Occlusion};
pub(super) use stage::lighting_layout;
