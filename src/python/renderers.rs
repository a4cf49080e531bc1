//! One renderer of each adapter for the process: opening one takes longer than a picture.

use std::collections::HashMap;
use std::sync::{LazyLock, Mutex, PoisonError};

use relief_render::{AdapterChoice, RenderError, RenderRequest, RenderedFrame, Renderer};
use relief_volume::Volume;

static RENDERERS: LazyLock<Mutex<HashMap<String, Renderer>>> = LazyLock::new(Mutex::default);

/// A picture by the renderer of this adapter. One picture is rendered at a time.
pub(crate) fn render(
    adapter: &str,
    volume: &Volume,
    request: &RenderRequest,
) -> Result<RenderedFrame, RenderError> {
    let mut renderers = RENDERERS.lock().unwrap_or_else(PoisonError::into_inner);
    if !renderers.contains_key(adapter) {
        renderers.insert(adapter.to_owned(), Renderer::open(&AdapterChoice::parse(adapter))?);
    }
    let Some(renderer) = renderers.get_mut(adapter) else { return Err(RenderError::DeviceLost) };
    let rendered = renderer.render(volume, request);
    if rendered.is_err() {
        renderers.remove(adapter); // a device that was lost is opened again
    }
    rendered
}
