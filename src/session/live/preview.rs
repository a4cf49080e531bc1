//! Preview of snapping: while the user moves the cursor, the view shows where the point would snap
//! to.
//!
//! A view runs one search at a time, for its newest cursor; it skips cursors that came meanwhile.
//! After each search it pauses as long as the search took (at most a second), so that rendering
//! keeps at least half of a shared processor. A commit snaps with the same code from the same
//! place, so the point goes where the preview was.

use std::sync::Arc;

use crate::live::ghost::Ghost;
use crate::volumes::VolumeEntry;
use relief_annotation::{Snap, Snapped};
use relief_base::{Patient, Point, Vector};

/// The input of a search.
#[derive(Clone)]
pub(super) struct SnapQuery {
    pub(super) entry: Arc<VolumeEntry>,
    pub(super) at: Point<Patient>,
    /// The line of sight, where the cursor was picked in a picture.
    pub(super) ray: Option<Vector<Patient>>,
    pub(super) snap: Snap,
}

impl PartialEq for SnapQuery {
    fn eq(&self, other: &Self) -> bool {
        let key = |aim: &Self| (aim.at, aim.ray, aim.snap);
        self.entry.id == other.entry.id && key(self) == key(other)
    }
}

/// The search of a view and its newest result.
#[derive(Default)]
pub(super) struct Preview {
    is_searching: bool,
    /// The newest aim that was searched for, and its result.
    answer: Option<(SnapQuery, Option<Ghost>)>,
}

impl Preview {
    /// The aim of a new search; `None` while a search runs, or when this aim has a result.
    pub(super) fn begin(&mut self, wanted: Option<SnapQuery>) -> Option<SnapQuery> {
        let aim = wanted.filter(|aim| !self.is_searching && !self.knows(aim))?;
        self.is_searching = true;
        Some(aim)
    }

    /// The aim of the next search after one that ended; `None` ends searching.
    pub(super) fn go_on(&mut self, wanted: Option<SnapQuery>) -> Option<SnapQuery> {
        self.is_searching = false;
        self.begin(wanted)
    }

    /// Stores a result, unless the view has changed its volume or its snapping. The cursor may have
    /// moved on.
    pub(super) fn answer(&mut self, wanted: Option<&SnapQuery>, aim: SnapQuery, found: Option<&Snapped>) {
        if wanted.is_some_and(|wanted| wanted.entry.id == aim.entry.id && wanted.snap == aim.snap) {
            let ghost = found.map(|found| Ghost { from: aim.at, at: found.at });
            self.answer = Some((aim, ghost));
        }
    }

    /// Drops the result: the user no longer places anything.
    pub(super) fn forget(&mut self) {
        self.answer = None;
    }

    /// The newest result.
    pub(super) fn ghost(&self) -> Option<Ghost> {
        self.answer.as_ref().and_then(|(_, ghost)| *ghost)
    }

    fn knows(&self, aim: &SnapQuery) -> bool {
        self.answer.as_ref().is_some_and(|(known, _)| known == aim)
    }
}
