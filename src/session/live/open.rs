//! Opening a view: its render loop starts with it.

use std::sync::Arc;

use super::presentation::Presentation;
use super::render_loop::{self, DrawableSource};
use super::view::View;
use super::views::{OpenError, Views};
use crate::engine::Engine;

impl Views {
    /// The view of this name, or a new one with this presentation. Call it inside a tokio runtime,
    /// which runs the render loop. A new view counts for `caller`, who has a limited number of views; `None` is a caller without a limit.
    ///
    /// # Errors
    /// When the server or the caller has as many views as allowed.
    pub fn find_or_open(
        self: &Arc<Self>,
        engine: &Arc<Engine>,
        drawables: Option<Arc<impl DrawableSource>>,
        name: &str,
        presentation: Presentation,
        caller: Option<&Arc<str>>,
    ) -> Result<Arc<View>, OpenError> {
        let (view, is_new) = self.find_or_add(name, presentation, caller)?;
        if is_new {
            let (registry, engine) = (Arc::clone(self), Arc::clone(engine));
            tokio::spawn(supervised(registry, engine, drawables, Arc::clone(&view)));
        }
        Ok(view)
    }
}

/// Runs the render loop of a view. A panic in it ends the view and its sessions, which can come back
/// to a new one; they would wait for frames for ever otherwise.
async fn supervised(
    views: Arc<Views>,
    engine: Arc<Engine>,
    drawables: Option<Arc<impl DrawableSource>>,
    view: Arc<View>,
) {
    let running = render_loop::run(Arc::clone(&views), engine, drawables, Arc::clone(&view));
    if let Err(error) = tokio::spawn(running).await {
        tracing::error!(%error, "the render loop of a view ended by a panic");
        view.ended.send_replace(true);
        views.remove(&view);
    }
}
