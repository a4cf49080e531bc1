//! The GPU renderer as the service's backend.

use std::ops::ControlFlow;

use super::{BackendError, RenderBackend};
use relief_render::{GpuError, MemoryUse, Progress, RenderError, RenderRequest, RenderedFrame, Renderer};
use relief_volume::{ContentHash, Volume};

impl RenderBackend for Renderer {
    fn render(
        &mut self,
        volume: &Volume,
        request: &RenderRequest,
        goes_on: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<RenderedFrame, BackendError> {
        self.render_watched(volume, request, goes_on).map_err(|error| match error {
            RenderError::Cancelled => BackendError::Cancelled,
            // Too little memory for one picture says nothing about the next.
            RenderError::Request(_)
            | RenderError::VolumeTooLarge { .. }
            | RenderError::VolumeOverTexture { .. }
            | RenderError::VolumeOverMemory { .. }
            | RenderError::Gpu(GpuError::OutOfMemory { .. }) => BackendError::Refused(error.into()),
            RenderError::Gpu(_) => BackendError::Failed(error.into()),
        })
    }

    fn forget(&mut self, volume: ContentHash) {
        // Inherent methods go first, so this is the renderer's own.
        self.forget(volume);
    }

    fn memory(&self) -> MemoryUse {
        self.memory()
    }
}
