//! Where what is being placed would be set down: snapping is tried while the cursor is led, and its place is shown before it counts.
//!
//! A view has one search at a time, for its newest cursor; those that came meanwhile are passed over. After each a search rests as long as
//! it took, so that pictures keep at least half of a processor that they share. A `place` that is committed is snapped in the same
//! way from the same place, so that it goes where the ghost was.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::view::View;
use crate::annotations::snap_in;
use crate::state::Server;
use crate::volumes::Entry;
use relief_annotation::{Snap, Snapped};
use relief_base::{Patient, Point, Vector};

/// The longest rest of a search.
const LONGEST_REST: Duration = Duration::from_secs(1);

/// What would be snapped if it were set down now.
#[derive(Clone)]
pub(super) struct Aim {
    pub(super) entry: Arc<Entry>,
    pub(super) at: Point<Patient>,
    /// The line of sight, where the place was seen in a picture.
    pub(super) ray: Option<Vector<Patient>>,
    pub(super) snap: Snap,
}

impl PartialEq for Aim {
    fn eq(&self, other: &Self) -> bool {
        let told = |aim: &Self| (aim.at, aim.ray, aim.snap);
        self.entry.id == other.entry.id && told(self) == told(other)
    }
}

/// Where something would be set down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ghost {
    /// From where it was moved.
    pub(super) from: Point<Patient>,
    pub(super) at: Point<Patient>,
}

/// The search of a view and its newest answer.
#[derive(Default)]
pub(super) struct Preview {
    is_searching: bool,
    /// The newest aim that was answered, and what was found for it.
    answer: Option<(Aim, Option<Ghost>)>,
}

impl Preview {
    /// The aim to begin a search for; none while another search goes on, or where this one was answered.
    pub(super) fn begin(&mut self, wanted: Option<Aim>) -> Option<Aim> {
        let aim = wanted.filter(|aim| !self.is_searching && !self.knows(aim))?;
        self.is_searching = true;
        Some(aim)
    }

    /// The aim to go on with after one that was answered; none ends the search.
    pub(super) fn go_on(&mut self, wanted: Option<Aim>) -> Option<Aim> {
        self.is_searching = false;
        self.begin(wanted)
    }

    /// Takes an answer, where it still says something of what is wanted: the cursor may have gone on meanwhile.
    pub(super) fn answer(&mut self, wanted: Option<&Aim>, aim: Aim, found: Option<&Snapped>) {
        if wanted.is_some_and(|wanted| wanted.entry.id == aim.entry.id && wanted.snap == aim.snap) {
            let ghost = found.map(|found| Ghost { from: aim.at, at: found.at });
            self.answer = Some((aim, ghost));
        }
    }

    /// Nothing is being placed any more.
    pub(super) fn forget(&mut self) {
        self.answer = None;
    }

    /// What is known of where something would be set down.
    pub(super) fn ghost(&self) -> Option<Ghost> {
        self.answer.as_ref().and_then(|(_, ghost)| *ghost)
    }

    fn knows(&self, aim: &Aim) -> bool {
        self.answer.as_ref().is_some_and(|(known, _)| known == aim)
    }
}

/// Searches for the place of what is being placed in a view, as long as it has another one and nobody searches yet.
pub(super) fn search(server: &Arc<Server>, view: &Arc<View>) {
    let Some(mut aim) = view.preview(Preview::begin) else { return };
    let (server, view) = (Arc::clone(server), Arc::clone(view));
    tokio::spawn(async move {
        loop {
            let began = Instant::now();
            // A search that fails shows nothing; a `commit` tells why.
            let found = snap_in(&server, &aim.entry, (aim.at, aim.ray), aim.snap).await;
            let found = found.ok().and_then(Result::ok);
            view.preview(|preview, wanted| preview.answer(wanted.as_ref(), aim, found.as_ref()));
            tokio::time::sleep(began.elapsed().min(LONGEST_REST)).await;
            match view.preview(Preview::go_on) {
                Some(next) => aim = next,
                None => return,
            }
        }
    });
}
