//! The registry of views: found by name, opened on demand, removed when abandoned.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Instant;

use parking_lot::Mutex;

use super::View;
use super::motion::Delays;
use super::presentation::Presentation;

/// The live views of a server.
#[derive(Debug)]
pub struct Views {
    views: Mutex<HashMap<String, Arc<View>>>,
    /// Most views at a time.
    most: usize,
    pub(super) patience: Delays,
}

/// A view could not be opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the limit of open views is reached; try again soon")]
pub struct OpenError;

impl Views {
    /// An empty registry for at most `most` views.
    #[must_use]
    pub fn new(most: usize, patience: Delays) -> Arc<Self> {
        Arc::new(Self { views: Mutex::default(), most, patience })
    }

    /// The view of this name. It is kept for a while from now on.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<Arc<View>> {
        let views = self.views.lock();
        let view = views.get(name)?;
        view.touch(); // under the lock, under which views are removed
        Some(Arc::clone(view))
    }

    /// The view of this name, or a new one with this presentation, and whether it is new: its render
    /// loop must be started.
    ///
    /// # Errors
    /// When there are as many views as allowed.
    pub(super) fn find_or_add(
        &self,
        name: &str,
        presentation: Presentation,
    ) -> Result<(Arc<View>, bool), OpenError> {
        let mut views = self.views.lock();
        if let Some(view) = views.get(name) {
            view.touch();
            return Ok((Arc::clone(view), false));
        }
        if views.len() >= self.most {
            self.retire_unseen(&mut views)?;
        }
        let view = Arc::new(View::new(name.to_owned(), presentation, Instant::now()));
        views.insert(name.to_owned(), Arc::clone(&view));
        Ok((view, true))
    }

    /// Makes room: of the views that never had a viewer, ends the one that was opened first. A
    /// request without a session may open any number of such views.
    fn retire_unseen(&self, views: &mut HashMap<String, Arc<View>>) -> Result<(), OpenError> {
        let unseen = views.values().filter_map(|view| Some((view.unseen_since()?, view)));
        let oldest = unseen.min_by_key(|(since, _)| *since).map(|(_, view)| Arc::clone(view));
        let view = oldest.ok_or(OpenError)?;
        views.remove(&view.name);
        view.retire(self.patience.linger);
        Ok(())
    }

    /// Wakes all render loops: annotations or volumes have changed.
    pub fn wake(&self) {
        self.views.lock().values().for_each(|view| view.work.notify_one());
    }

    /// Removes a view that has had no viewer for long; returns false when a viewer has returned to
    /// it.
    pub(super) fn remove_abandoned(&self, view: &Arc<View>) -> bool {
        let mut views = self.views.lock();
        let is_abandoned = view.is_abandoned(Instant::now(), self.patience.linger);
        if is_abandoned && views.get(&view.name).is_some_and(|known| Arc::ptr_eq(known, view)) {
            views.remove(&view.name);
        }
        is_abandoned
    }

    pub(super) fn remove(&self, view: &Arc<View>) {
        let mut views = self.views.lock();
        if views.get(&view.name).is_some_and(|known| Arc::ptr_eq(known, view)) {
            views.remove(&view.name);
        }
    }
}
