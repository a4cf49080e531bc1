//! The GPU: adapter choice, device, shader modules, read-back, and errors as values.
//!
//! What it is: the one place that opens a device and asks it for memory. What it is not: it knows no volume, no
//! camera and no picture (see `render`).

mod adapter;
mod device;

pub use adapter::{AdapterChoice, AdapterDescription, AdapterKind, adapters};
pub(crate) use device::{ErrorScope, Readback, SubmissionIndex};
pub use device::{Gpu, GpuError, GpuLimits};
