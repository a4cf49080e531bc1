//! Errors of a render: an invalid request, an unsuitable volume, or a failure of the adapter.

use crate::gpu::GpuError;
use relief_base::OutOfRange;

/// Why a picture could not be rendered.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// The request is out of range.
    #[error(transparent)]
    Request(#[from] OutOfRange),
    /// The volume exceeds the adapter's limit.
    #[error(
        "the volume has {dims:?} voxels, this adapter takes at most {limit} along a side; \
         load it with --downsample {factor}"
    )]
    VolumeTooLarge {
        /// Voxels along i, j, k.
        dims: [usize; 3],
        /// Most voxels along a side.
        limit: usize,
        /// The smallest factor that fits.
        factor: usize,
    },
    /// The volume is larger than a texture of this adapter may be.
    #[error(
        "the volume has {dims:?} voxels and needs {needed} bytes, {available} are available in one texture of this adapter; \
         load it with --downsample {factor}"
    )]
    VolumeOverTexture {
        /// Voxels along i, j, k.
        dims: [usize; 3],
        /// Bytes of voxels.
        needed: u64,
        /// Bytes that a texture may have.
        available: u64,
        /// The smallest factor that fits.
        factor: usize,
    },
    /// The volume needs more memory than volumes may take.
    #[error(
        "the volume has {dims:?} voxels and needs {needed} bytes of graphics memory, {available} are available; \
         {}allow more with --gpu-memory",
        factor.map_or_else(String::new, |factor| format!("load it with --downsample {factor}, or "))
    )]
    VolumeOverMemory {
        /// Voxels along i, j, k.
        dims: [usize; 3],
        /// Bytes of the volume, lit without gradients, and of one appearance.
        needed: u64,
        /// Bytes that volumes may take.
        available: u64,
        /// The smallest factor that fits; `None` where none does.
        factor: Option<usize>,
    },
    /// The processor's ray caster leaves a part of the request to a graphics adapter, and there is
    /// none.
    #[error(
        "{part} cannot be rendered on the processor alone, and there is no graphics adapter for it: {source}; \
         install a Vulkan driver (`relief doctor` says which)"
    )]
    BeyondProcessor {
        /// The part of the request.
        part: &'static str,
        /// Why there is no adapter.
        source: GpuError,
    },
    /// The caller cancelled the picture.
    #[error("the picture was cancelled")]
    Cancelled,
    /// The GPU failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}
