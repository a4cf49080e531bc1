//! The GPU renderer as the service's backend.

use super::{BackendError, RenderBackend};
use crate::render::{RenderError, RenderRequest, RenderedFrame, Renderer};
use crate::volume::Volume;

impl RenderBackend for Renderer {
    fn render(&mut self, volume: &Volume, request: &RenderRequest) -> Result<RenderedFrame, BackendError> {
        // Inherent methods go first, so this is the renderer's own.
        self.render(volume, request).map_err(|error| match error {
            RenderError::Request(_) | RenderError::VolumeTooLarge { .. } => {
                BackendError::Refused(error.into())
            }
            RenderError::Gpu(_) => BackendError::Failed(error.into()),
        })
    }
}
