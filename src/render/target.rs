//! The buffers that the rays of a picture write, and pictures that were cancelled between two bands.

use std::time::Duration;

use super::error::RenderError;
use super::pipelines::Output;
use super::region::Region;
use super::request::RenderRequest;
use super::skipping::EmptySpaceSkipping;
use crate::gpu::{ErrorScope, Gpu, Readback};
use relief_base::OutOfRange;
use relief_volume::ContentHash;

/// The buffers for pictures of some number of pixels.
pub(super) struct Target {
    /// Pixels of all layers.
    pixels: usize,
    /// The part of the last picture that rays can hit.
    pub(super) region: Region,
    pub(super) color: Readback,
    pub(super) depth: Readback,
}

impl Target {
    /// # Errors
    /// When the adapter has no buffers of that size, or too little memory.
    pub(super) fn new(gpu: &Gpu, request: &RenderRequest) -> Result<Self, RenderError> {
        let [width, height] = request.size_px;
        let pixels = pixels(request);
        let bytes = pixels as u64 * 4;
        let limit = gpu.limits().storage_bytes;
        if bytes > limit {
            let allowed = format!("at most {} pixels on this adapter", limit / 4 / layers(request) as u64);
            return Err(OutOfRange::new("size_px", format!("{width} x {height}"), allowed).into());
        }
        let scope = ErrorScope::open(gpu, "a picture");
        let color = Readback::new(gpu, "colour", bytes);
        let depth = Readback::new(gpu, "depth", bytes);
        scope.close()?;
        Ok(Self { pixels, region: Region::whole(request.size_px), color, depth })
    }

    /// Whether it has the size that the request needs.
    pub(super) fn fits(&self, request: &RenderRequest) -> bool {
        self.pixels == pixels(request)
    }
}

/// The space that the rays of a cast skip, and the pixels that they write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CastOptions {
    pub(super) skipping: EmptySpaceSkipping,
    pub(super) output: Output,
}

/// Everything that decides the pixels of a cast.
pub(super) struct CastKey {
    pub(super) volume: ContentHash,
    pub(super) request: RenderRequest,
    pub(super) options: CastOptions,
}

impl CastKey {
    /// Whether this is the key of such a cast.
    pub(super) fn is_of(&self, volume: ContentHash, request: &RenderRequest, options: CastOptions) -> bool {
        (self.volume, self.options) == (volume, options) && self.request == *request
    }
}

/// A picture that was cancelled between two bands. An equal request continues it.
pub(super) struct Unfinished {
    pub(super) key: CastKey,
    pub(super) target: Target,
    /// Rows of its region that are rendered.
    pub(super) rows: u32,
    /// Time that they took.
    pub(super) spent: Duration,
}

/// The number of pictures of a request: the first layer, and the background layer.
pub(super) fn layers(request: &RenderRequest) -> usize {
    if request.has_back_layer() { 2 } else { 1 }
}

fn pixels(request: &RenderRequest) -> usize {
    let [width, height] = request.size_px;
    width as usize * height as usize * layers(request)
}

/// The pixel of a ray that hits nothing: halves go to even numbers, as in the shader.
pub(super) fn background(request: &RenderRequest) -> [u8; 4] {
    let byte = |channel: f64| (channel.clamp(0.0, 1.0) as f32 * 255.0).round_ties_even() as u8;
    let [red, green, blue] = request.background_rgb.map(byte);
    [red, green, blue, 0]
}
