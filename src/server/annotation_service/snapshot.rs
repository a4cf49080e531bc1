//! The newest state of a volume's annotations, kept beside the store: lists and pictures ask for it
//! many times between two edits.
//!
//! A snapshot is that of the log's last event; whether it still is costs one small question. Edits
//! are added to it, those made here and those that others made and that were heard of; where some
//! were not heard of yet, it is read again.

use std::sync::Arc;
use std::time::Duration;

use parking_lot::MutexGuard;

use super::published::Home;
use super::service::Annotations;
use super::snapshots::{Snapshot, Snapshots, bare};
use crate::problem::Problem;
use relief_annotation::{Event, FrameOfReference, Set};
use relief_store::Filter;

/// Number of frames of reference whose snapshots are kept.
const MOST: usize = 16;
/// Sets that other programs changed are seen after this.
const SETS_AGE: Duration = Duration::from_secs(1);

impl Annotations {
    fn snapshots(&self) -> MutexGuard<'_, Snapshots> {
        // The value is whole between statements, so a panic elsewhere leaves it usable.
        self.snapshots.lock()
    }

    /// The newest state of the items of this frame of reference.
    pub(crate) async fn snapshot(&self, frame: &FrameOfReference) -> Result<Arc<Snapshot>, Problem> {
        let sets = self.sets().await?;
        let known = self.snapshots().known.get(frame).cloned();
        let seq = self.store.seq().await?;
        if let Some(known) = known.filter(|known| known.seq == seq) {
            if Arc::ptr_eq(&known.sets, &sets) {
                return Ok(known);
            }
            let fresh = Snapshot { sets, ..Snapshot::clone(&known) };
            return Ok(self.keep(frame, Arc::new(fresh)));
        }
        let filter = Filter { frame_of_reference: Some(frame.clone()), ..Filter::default() };
        let listing = self.store.list(&filter).await?;
        let items = listing.items.into_iter().map(|known| bare(known.version, known.item)).collect();
        Ok(self.keep(frame, Arc::new(Snapshot::new(listing.seq, items, sets))))
    }

    fn keep(&self, frame: &FrameOfReference, fresh: Arc<Snapshot>) -> Arc<Snapshot> {
        let mut snapshots = self.snapshots();
        if snapshots.known.len() >= MOST && !snapshots.known.contains_key(frame) {
            snapshots.known.clear();
        }
        // Another request may have kept a newer one meanwhile.
        let kept = snapshots.known.entry(frame.clone()).or_insert_with(|| Arc::clone(&fresh));
        if kept.seq <= fresh.seq {
            *kept = Arc::clone(&fresh);
        }
        fresh
    }

    /// Adds events to the snapshots that they follow; other snapshots are read again when they are
    /// needed.
    pub(crate) fn follow(&self, events: &[(Event, Home)]) {
        let (Some((first, _)), Some((last, _))) = (events.first(), events.last()) else { return };
        let follows = |known: &Arc<Snapshot>| known.seq + 1 == first.seq;
        let known = self.snapshots().known.clone();
        for (frame, known) in known.into_iter().filter(|(_, known)| follows(known)) {
            self.keep(&frame, Arc::new(known.after(&frame, events, last.seq)));
        }
    }

    /// All sets, as they were a moment ago. Where they are others than those that were known,
    /// pictures have to be looked at again.
    pub(crate) async fn sets(&self) -> Result<Arc<[Set]>, Problem> {
        loop {
            let asked = {
                let snapshots = self.snapshots();
                let is_fresh = snapshots.sets_read.is_some_and(|read| read.elapsed() < SETS_AGE);
                if let Some(sets) = snapshots.sets.as_ref().filter(|_| is_fresh) {
                    return Ok(Arc::clone(sets));
                }
                snapshots.sets_asked
            };
            let fresh = self.store.sets().await?;
            let Some((sets, are_others)) = self.snapshots().keep_sets(asked, fresh) else { continue };
            if are_others {
                self.changes.send_modify(|changes| *changes += 1);
            }
            return Ok(sets);
        }
    }

    /// There may be other sets than those that were read.
    pub(crate) fn read_sets_anew(&self) {
        self.snapshots().read_sets_anew();
    }

    /// Sets have changed.
    pub(crate) async fn sets_changed(&self) {
        self.read_sets_anew();
        if self.sets().await.is_err() {
            // Readers that can read them see the newest sets.
            self.changes.send_modify(|changes| *changes += 1);
        }
    }
}
