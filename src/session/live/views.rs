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
    views: Mutex<HashMap<String, Opened>>,
    /// Most views at a time.
    most: usize,
    /// Most views at a time of one caller.
    most_of_caller: usize,
    pub(super) patience: Delays,
}

/// A view and the caller who opened it; `None` for callers without a limit.
#[derive(Debug)]
struct Opened {
    view: Arc<View>,
    caller: Option<Arc<str>>,
}

/// A view could not be opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OpenError {
    /// The server has as many views as allowed.
    #[error("the limit of open views is reached; try again soon")]
    Full,
    /// The caller has as many views as allowed, and all of them have viewers.
    #[error("you have {0} open views, the most that one caller may have")]
    OfCaller(usize),
}

impl Views {
    /// An empty registry for at most `most` views. One caller may have half of them.
    #[must_use]
    pub fn new(most: usize, patience: Delays) -> Arc<Self> {
        Arc::new(Self { views: Mutex::default(), most, most_of_caller: most.div_ceil(2), patience })
    }

    /// The view of this name. It is kept for a while from now on.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<Arc<View>> {
        let views = self.views.lock();
        let view = &views.get(name)?.view;
        view.touch(); // under the lock, under which views are removed
        Some(Arc::clone(view))
    }

    /// The view of this name, or a new one with this presentation, and whether it is new: its render
    /// loop must be started.
    ///
    /// # Errors
    /// When the server or the caller has as many views as allowed.
    pub(super) fn find_or_add(
        &self,
        name: &str,
        presentation: Presentation,
        caller: Option<&Arc<str>>,
    ) -> Result<(Arc<View>, bool), OpenError> {
        let mut views = self.views.lock();
        if let Some(Opened { view, .. }) = views.get(name) {
            view.touch();
            return Ok((Arc::clone(view), false));
        }
        let of_caller = |opened: &Opened| caller.is_some() && opened.caller.as_ref() == caller;
        if views.values().filter(|opened| of_caller(opened)).count() >= self.most_of_caller {
            let left = |opened: &Opened| opened.view.idle_since().filter(|_| of_caller(opened));
            self.retire(&mut views, left).ok_or(OpenError::OfCaller(self.most_of_caller))?;
        }
        if views.len() >= self.most {
            // Requests without a session can open many views that never get a viewer.
            self.retire(&mut views, |opened| opened.view.unseen_since()).ok_or(OpenError::Full)?;
        }
        let view = Arc::new(View::new(name.to_owned(), presentation, Instant::now()));
        let opened = Opened { view: Arc::clone(&view), caller: caller.cloned() };
        views.insert(name.to_owned(), opened);
        Ok((view, true))
    }

    /// Ends the view that has been idle the longest, by `since`; `None` if no view is idle.
    fn retire(
        &self,
        views: &mut HashMap<String, Opened>,
        since: impl Fn(&Opened) -> Option<Instant>,
    ) -> Option<()> {
        let idle = views.values().filter_map(|opened| Some((since(opened)?, &opened.view)));
        let view = idle.min_by_key(|(since, _)| *since).map(|(_, view)| Arc::clone(view))?;
        views.remove(&view.name);
        view.retire(self.patience.linger);
        Some(())
    }

    /// Wakes all render loops: annotations or volumes have changed.
    pub fn wake(&self) {
        self.views.lock().values().for_each(|opened| opened.view.work.notify_one());
    }

    /// Removes a view that has had no viewer for long; returns false when a viewer has returned to
    /// it.
    pub(super) fn remove_abandoned(&self, view: &Arc<View>) -> bool {
        let mut views = self.views.lock();
        let is_abandoned = view.is_abandoned(Instant::now(), self.patience.linger);
        if is_abandoned && views.get(&view.name).is_some_and(|known| Arc::ptr_eq(&known.view, view)) {
            views.remove(&view.name);
        }
        is_abandoned
    }

    pub(super) fn remove(&self, view: &Arc<View>) {
        let mut views = self.views.lock();
        if views.get(&view.name).is_some_and(|known| Arc::ptr_eq(&known.view, view)) {
            views.remove(&view.name);
        }
    }
}
