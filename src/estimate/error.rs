//! Why no depth was estimated.

/// The error of the runtime.
pub type BoxedError = Box<dyn std::error::Error + Send + Sync>;

/// An estimate that failed.
#[derive(Debug, thiserror::Error)]
pub enum EstimateError {
    /// The network's file is larger than any that is loaded.
    #[error("the network has {bytes} bytes, and at most {most} are loaded")]
    TooLarge {
        /// Size of the file.
        bytes: u64,
        /// [`crate::MAX_NETWORK_BYTES`].
        most: u64,
    },
    /// The file is not an ONNX network that the runtime can load.
    #[error("the network cannot be loaded: {0}. It has to be ONNX, without external data")]
    Load(#[source] BoxedError),
    /// The network's inputs are not one picture.
    #[error("the network takes {found}; it has to take one tensor of 1 x 3 x height x width")]
    Input {
        /// The inputs that it has.
        found: String,
    },
    /// The network's output is not one value a pixel.
    #[error(
        "the network gives a tensor of {found:?}; it has to give 1 x height x width, or 1 x 1 x height x width"
    )]
    Output {
        /// Sides of the tensor.
        found: Vec<usize>,
    },
    /// The network failed on a picture.
    #[error("the network failed: {0}")]
    Run(#[source] BoxedError),
    /// The network gave values that are not numbers.
    #[error("the network gives values that are not numbers")]
    NotFinite,
    /// The picture has no pixels.
    #[error("the picture is {width}x{height}, and needs at least one pixel")]
    Empty {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
    },
}
