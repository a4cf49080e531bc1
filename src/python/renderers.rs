//! One renderer of each adapter for the process: opening one takes longer than a picture.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::LazyLock;

use parking_lot::Mutex;

use relief_render::{AdapterChoice, RenderError, RenderRequest, RenderedFrame, Renderer};
use relief_volume::Volume;

static RENDERERS: LazyLock<Mutex<HashMap<String, Renderer>>> = LazyLock::new(Mutex::default);

/// A picture by the renderer of this adapter. One picture is rendered at a time.
pub(crate) fn render(
    adapter: &str,
    volume: &Volume,
    request: &RenderRequest,
) -> Result<RenderedFrame, RenderError> {
    let mut renderers = RENDERERS.lock();
    let rendered = match renderers.entry(adapter.to_owned()) {
        Entry::Occupied(mut open) => open.get_mut().render(volume, request),
        Entry::Vacant(place) => {
            let renderer = Renderer::open(&AdapterChoice::parse(adapter))?;
            place.insert(renderer).render(volume, request)
        }
    };
    if rendered.is_err() {
        renderers.remove(adapter); // a device that was lost is opened again
    }
    rendered
}
