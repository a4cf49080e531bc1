//! The viewers of a view. Which annotations it draws depends on all of them.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Instant;

use super::{Inner, View};
use crate::Drawables;
use crate::live::viewer::Viewer;
use relief_annotation::ShownSets;
use relief_live::{Peers, Role};

impl View {
    /// Adds a viewer who may see all annotations of the sets `visible`. If the view draws other sets, the
    /// current frame is dropped, and new frames have no annotations until these have been read again for
    /// all viewers.
    pub fn join(&self, viewer: &Arc<Viewer>, visible: &ShownSets, now: Instant) {
        {
            let mut inner = self.lock();
            inner.viewers.push(Arc::clone(viewer));
            inner.was_joined = true;
            if viewer.reader.is_some() {
                inner.drawn_revision = None;
            }
            // Compared under the lock: a presenter may have chosen other sets since they were checked.
            let draws_others = !inner.presentation.shown.is_nothing() && inner.presentation.shown != *visible;
            if viewer.reader.is_some() && draws_others {
                inner.presentation.set_drawables(Drawables::default());
                inner.audience += 1;
                inner.renewed(now);
                inner.published = None;
                self.frames.send_replace(None);
            }
        }
        self.count_peers();
        self.work.notify_one();
    }

    /// Removes a viewer.
    pub fn leave(&self, viewer: &Viewer) {
        let mut inner = self.lock();
        inner.viewers.retain(|known| known.id != viewer.id);
        if viewer.reader.is_some() {
            inner.drawn_revision = None; // the remaining viewers may be allowed to see more
        }
        if inner.viewers.is_empty() {
            inner.idle_since = Instant::now();
        }
        drop(inner);
        self.count_peers();
        self.work.notify_one();
    }

    fn count_peers(&self) {
        let inner = self.lock();
        let presenters =
            inner.viewers.iter().filter(|known| known.role == Role::Presenter && !known.is_plain);
        let presenters = presenters.count();
        let peers = Peers { presenters, watchers: inner.viewers.len() - presenters };
        self.peers.send_if_modified(|known| std::mem::replace(known, peers) != peers);
    }
}

impl Inner {
    /// The verified names of the viewers.
    pub(super) fn readers(&self) -> BTreeSet<String> {
        self.viewers.iter().filter_map(|viewer| viewer.reader.clone()).collect()
    }
}
