//! What the viewers of a view may see of its annotations.
//!
//! One picture serves all viewers of a view, so it shows only what each of them may see: a blinded set is
//! drawn while its reader is alone. A server without identities does not know its viewers, and draws what
//! the presenter asked for.

use std::sync::Arc;
use std::time::Instant;

use crate::annotation_service::Visible;
use crate::identity::Caller;
use crate::state::LiveParts;
use relief_live::Role;
use relief_session::{View, Viewer};

/// Adds a viewer to a view.
pub(super) async fn join(
    parts: &LiveParts,
    view: &View,
    role: Role,
    is_plain: bool,
    caller: &Caller,
) -> Arc<Viewer> {
    let reader = caller.identity.as_ref().map(|identity| identity.name.clone());
    let sees_all = sees_all(parts, view, reader.as_deref()).await;
    let viewer = Viewer::new(parts.live.next_id(), role, is_plain, reader, Instant::now());
    view.join(&viewer, sees_all, Instant::now());
    viewer
}

/// Whether a viewer may see every set that a view may draw.
async fn sees_all(parts: &LiveParts, view: &View, reader: Option<&str>) -> bool {
    let (Some(annotations), Some(_)) = (&parts.annotations, reader) else { return true };
    let shown = view.shown();
    if shown.is_nothing() {
        return true;
    }
    let Ok(sets) = annotations.sets().await else { return false };
    let visible = Visible::new(&sets, reader);
    sets.iter().all(|set| !shown.has(&set.name) || visible.sees(&set.name))
}
