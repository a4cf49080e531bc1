//! The GPU renderer as the service's backend.

use super::{BackendError, RenderBackend};
use crate::gpu::GpuError;
use crate::render::{RenderError, RenderRequest, RenderedFrame, Renderer};
use crate::volume::{ContentHash, Volume};

impl RenderBackend for Renderer {
    fn render(&mut self, volume: &Volume, request: &RenderRequest) -> Result<RenderedFrame, BackendError> {
        // Inherent methods go first, so this is the renderer's own.
        self.render(volume, request).map_err(|error| match error {
            // Too little memory for one picture says nothing about the next.
            RenderError::Request(_)
            | RenderError::VolumeTooLarge { .. }
            | RenderError::Gpu(GpuError::OutOfMemory { .. }) => BackendError::Refused(error.into()),
            RenderError::Gpu(_) => BackendError::Failed(error.into()),
        })
    }

    fn forget(&mut self, volume: ContentHash) {
        self.forget(volume);
    }
}
