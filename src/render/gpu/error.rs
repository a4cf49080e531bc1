//! Why the graphics adapter cannot be used.

use crate::gpu::choice::AdapterChoice;
/// Why the GPU could not do its work.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// No adapter of the wanted kind.
    #[error(
        "no graphics adapter for {wanted}; available: {}. `relief doctor` reports missing drivers and how to install them",
        if available.is_empty() { "none".to_owned() } else { available.join(", ") }
    )]
    NoAdapter {
        /// The requested name or driver.
        wanted: AdapterChoice,
        /// The available adapters.
        available: Vec<String>,
    },
    /// The driver refused to open the device.
    #[error("{adapter} cannot be opened: {reason}")]
    Device {
        /// The adapter.
        adapter: String,
        /// The driver's words.
        reason: String,
    },
    /// An allocation failed.
    #[error("the adapter does not have enough memory for {what}")]
    OutOfMemory {
        /// The resource.
        what: &'static str,
    },
    /// A command was refused: a defect of this program.
    #[error("the adapter refused {what}: {reason}")]
    Refused {
        /// The operation.
        what: &'static str,
        /// The validation message.
        reason: String,
    },
    /// The device did not answer.
    #[error("the adapter did not finish {what}: {reason}")]
    Stalled {
        /// The operation.
        what: &'static str,
        /// The driver's words.
        reason: String,
    },
}
