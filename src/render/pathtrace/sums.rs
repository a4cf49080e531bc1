//! The accumulated passes of one picture, on the GPU.

use super::denoise::Guide;
use crate::error::RenderError;
use crate::gpu::{ErrorScope, Gpu, Readback};
use crate::request::RenderRequest;
use relief_base::OutOfRange;
use relief_volume::ContentHash;

/// Bytes of a pixel in the buffers of guides and sums.
const GUIDE_BYTES: u64 = size_of::<Guide>() as u64;
const SUM_BYTES: u64 = size_of::<[f32; 4]>() as u64;

/// The accumulated passes, and their request.
pub(super) struct Sums {
    volume: ContentHash,
    /// Without what may differ between pictures that share passes.
    request: RenderRequest,
    pub(super) passes: u32,
    pub(super) pixels: u64,
    /// Rows from the top: linear red, green, blue and collisions.
    pub(super) all: wgpu::Buffer,
    /// The same of the passes of odd numbers.
    pub(super) odd: wgpu::Buffer,
    pub(super) picture: Readback,
    /// The guides of the denoiser, once a picture has needed them.
    pub(super) guides: Option<wgpu::Buffer>,
}

impl Sums {
    /// Empty sums, in the buffers of old ones where they have the size.
    pub(super) fn new(
        gpu: &Gpu,
        volume: ContentHash,
        request: &RenderRequest,
        old: Option<Self>,
    ) -> Result<Self, RenderError> {
        let request_of_sums = without_passes(request);
        let [width, height] = request.size_px;
        let pixels = u64::from(width) * u64::from(height);
        if let Some(old) = old.filter(|old| old.pixels == pixels) {
            return Ok(Self { volume, request: request_of_sums, passes: 0, guides: None, ..old });
        }
        check_size(gpu, request, pixels, SUM_BYTES, "in mode path-traced")?;
        let scope = ErrorScope::open(gpu, "a path-traced picture");
        let [all, odd] =
            ["sums of light", "sums of odd passes"].map(|label| storage(gpu, label, pixels * SUM_BYTES));
        let picture = Readback::new(gpu, "path-traced picture", pixels * 4);
        scope.close()?;
        Ok(Self { volume, request: request_of_sums, passes: 0, pixels, all, odd, picture, guides: None })
    }

    /// Whether more passes, or none, make this the picture of that request.
    pub(super) fn can_become(&self, volume: ContentHash, request: &RenderRequest) -> bool {
        self.volume == volume
            && self.passes <= request.path_trace.passes
            && self.request == without_passes(request)
    }

    /// Whether they belong to a volume.
    pub(super) fn is_of(&self, volume: ContentHash) -> bool {
        self.volume == volume
    }

    /// A buffer for the guides of this picture.
    pub(super) fn guide_buffer(
        &self,
        gpu: &Gpu,
        request: &RenderRequest,
    ) -> Result<wgpu::Buffer, RenderError> {
        check_size(gpu, request, self.pixels, GUIDE_BYTES, "with path_trace.denoise")?;
        let scope = ErrorScope::open(gpu, "guides of the denoiser");
        let buffer = storage(gpu, "guides", self.pixels * GUIDE_BYTES);
        scope.close()?;
        Ok(buffer)
    }
}

fn storage(gpu: &Gpu, label: &'static str, size: u64) -> wgpu::Buffer {
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size,
        usage,
        mapped_at_creation: false,
    })
}

fn check_size(
    gpu: &Gpu,
    request: &RenderRequest,
    pixels: u64,
    bytes: u64,
    when: &str,
) -> Result<(), RenderError> {
    let most = gpu.limits().storage_bytes / bytes;
    if pixels <= most {
        return Ok(());
    }
    let [width, height] = request.size_px;
    let allowed = format!("at most {most} pixels {when} on this adapter");
    Err(OutOfRange::new("size_px", format!("{width} x {height}"), allowed).into())
}

/// The request without the number of passes and the denoiser.
fn without_passes(request: &RenderRequest) -> RenderRequest {
    let mut request = request.clone();
    request.path_trace.passes = 0;
    request.path_trace.denoise = false;
    request
}
