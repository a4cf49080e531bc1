//! Which annotations a view draws for its viewers.
//!
//! All viewers of a view get the same picture, so it draws only sets that each of them may see. A blinded set is
//! drawn while all viewers are its reader. A server without identities does not know its viewers; there the
//! view draws the sets that the presenter chose.

use std::sync::Arc;
use std::time::Instant;

use crate::annotation_service::Visible;
use crate::identity::Caller;
use crate::state::LiveParts;
use relief_annotation::ShownSets;
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
    let visible = visible_sets(parts, view, reader.as_deref()).await;
    let viewer = Viewer::new(parts.live.next_id(), role, is_plain, reader, Instant::now());
    view.join(&viewer, &visible, Instant::now());
    viewer
}

/// The sets that a view draws, if the reader may see all of them; otherwise none.
async fn visible_sets(parts: &LiveParts, view: &View, reader: Option<&str>) -> ShownSets {
    let (Some(annotations), Some(_)) = (&parts.annotations, reader) else { return ShownSets::Nothing };
    let shown = view.shown();
    if shown.is_nothing() {
        return shown;
    }
    let Ok(sets) = annotations.sets().await else { return ShownSets::Nothing };
    let visible = Visible::new(&sets, reader);
    let sees_all = sets.iter().all(|set| !shown.has(&set.name) || visible.sees(&set.name));
    if sees_all { shown } else { ShownSets::Nothing }
}
