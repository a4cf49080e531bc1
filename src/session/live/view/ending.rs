//! When a view ends: long after its last viewer, or sooner where it never had one.

use std::time::{Duration, Instant};

use super::View;

impl View {
    /// Since when the view has been idle; `None` when it has a viewer, or had one.
    pub(in crate::live) fn unseen_since(&self) -> Option<Instant> {
        let inner = self.lock();
        (!inner.was_joined).then_some(inner.idle_since)
    }

    /// When the last viewer left; `None` if the view has a viewer.
    pub(in crate::live) fn idle_since(&self) -> Option<Instant> {
        let inner = self.lock();
        inner.viewers.is_empty().then_some(inner.idle_since)
    }

    /// Ends the view now, as after `linger` without viewers. Sessions cannot resume it.
    pub(in crate::live) fn retire(&self, linger: Duration) {
        self.ended.send_replace(true);
        let mut inner = self.lock();
        inner.idle_since = inner.idle_since.checked_sub(linger).unwrap_or(inner.idle_since);
        drop(inner);
        self.work.notify_one();
    }
}
