//! Who watches a view: viewers come and go, and decide together what may be drawn.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Instant;

use super::{Inner, View};
use crate::Drawables;
use crate::live::viewer::Viewer;
use relief_live::{Peers, Role};

impl View {
    /// Adds a viewer. Where it may not see all that the view draws, the present frame is dropped, and frames
    /// have no annotations until they have been read for the new viewers.
    pub fn join(&self, viewer: &Arc<Viewer>, sees_all: bool, now: Instant) {
        {
            let mut inner = self.lock();
            inner.viewers.push(Arc::clone(viewer));
            inner.was_joined = true;
            if !sees_all {
                inner.drawn_revision = None;
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
            inner.drawn_revision = None; // the others may see more
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
