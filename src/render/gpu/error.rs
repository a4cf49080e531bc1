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
    #[error("{adapter} cannot be opened: {source}")]
    Device {
        /// The adapter.
        adapter: String,
        /// The error of wgpu.
        source: Box<wgpu::RequestDeviceError>,
    },
    /// An allocation failed.
    #[error("the adapter does not have enough memory for {what}")]
    OutOfMemory {
        /// The resource.
        what: &'static str,
    },
    /// A command was refused: a defect of this program.
    #[error("the adapter refused {what}: {source}")]
    Refused {
        /// The operation.
        what: &'static str,
        /// The validation error.
        source: Box<ValidationError>,
    },
    /// The device did not answer.
    #[error("the adapter did not finish {what}: {source}")]
    Stalled {
        /// The operation.
        what: &'static str,
        /// The error of wgpu.
        source: StallError,
    },
}

/// Why a shader or a command is invalid.
#[derive(Debug, thiserror::Error)]
pub enum ValidationError {
    /// The shader is not WGSL.
    #[error(transparent)]
    Shader(#[from] naga::front::wgsl::ParseError),
    /// The shader does not have these constants.
    #[error(transparent)]
    Constants(#[from] naga::back::pipeline_constants::PipelineConstantError),
    /// The device refused a command.
    #[error(transparent)]
    Command(#[from] wgpu::Error),
}

/// Why a result did not come back from the device.
#[derive(Debug, thiserror::Error)]
pub enum StallError {
    /// The work was not finished in time.
    #[error(transparent)]
    Poll(#[from] wgpu::PollError),
    /// The device did not report the end of a copy.
    #[error(transparent)]
    NoReport(#[from] std::sync::mpsc::TryRecvError),
    /// The copy failed.
    #[error(transparent)]
    Copy(#[from] wgpu::BufferAsyncError),
    /// The copied bytes cannot be read.
    #[error(transparent)]
    Range(#[from] wgpu::MapRangeError),
    /// A test made the device fail.
    #[error("it was made to fail")]
    Injected,
}
