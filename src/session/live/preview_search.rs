//! The searches of a view's preview: one at a time, for the newest cursor, with pauses between.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::preview::Preview;
use super::view::View;
use crate::engine::Engine;

/// Longest pause after a search.
const LONGEST_PAUSE: Duration = Duration::from_secs(1);

/// Starts a search for the snapped place of the cursor, unless one runs already. It goes on while
/// the cursor moves.
pub fn search_preview(engine: &Arc<Engine>, view: &Arc<View>) {
    let Some(mut aim) = view.preview(Preview::begin) else { return };
    let (engine, view) = (Arc::clone(engine), Arc::clone(view));
    tokio::spawn(async move {
        loop {
            let began = Instant::now();
            // A failed search shows nothing; a commit reports why.
            let found = engine.snap(&aim.entry, aim.at, aim.ray, aim.snap).await;
            let found = found.ok().and_then(Result::ok);
            view.preview(|preview, wanted| preview.answer(wanted.as_ref(), aim, found.as_ref()));
            tokio::time::sleep(began.elapsed().min(LONGEST_PAUSE)).await;
            match view.preview(Preview::go_on) {
                Some(next) => aim = next,
                None => return,
            }
        }
    });
}
