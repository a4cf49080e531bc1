//! The GPU: adapter choice, device, shader modules, read-back, and errors as values.
//!
//! Only this module opens a device and allocates its memory. It has no volume, camera or picture
//! (see `render`).

mod adapter;
mod choice;
mod device;
pub(crate) mod error;
mod shader;

pub use crate::gpu::choice::AdapterChoice;
pub(crate) use adapter::has_card;
pub use adapter::{AdapterDescription, AdapterKind, adapters};
pub(crate) use device::{ErrorScope, Readback, SubmissionIndex};
pub use device::{Gpu, GpuLimits};
pub use error::{GpuError, StallError, ValidationError};
pub(crate) use shader::Shader;
