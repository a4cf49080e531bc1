//! The newest state of a volume's annotations, kept beside the store: lists and pictures ask for it
//! many times between two edits.
//!
//! A snapshot is that of the log's last event; whether it still is costs one small question. Edits
//! are added to it, those made here and those that others made and that were heard of; where some
//! were not heard of yet, it is read anew.

use std::collections::HashMap;
use std::sync::{Arc, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::{Annotations, Home};
use crate::problem::Problem;
use relief_annotation::{Event, FrameOfReference, Item, ItemId, Set, Versioned};
use relief_store::Filter;

/// Number of frames of reference whose snapshots are kept.
const MOST: usize = 16;
/// Sets that other programs changed are seen after this.
const SETS_AGE: Duration = Duration::from_secs(1);

/// See the module. Items are without their frame of reference, which is the same for all.
#[derive(Clone)]
pub(crate) struct Snapshot {
    /// The log's last event.
    pub(crate) seq: u64,
    /// By set, list, order, creation and id.
    pub(crate) items: Arc<[Arc<Versioned>]>,
    pub(crate) sets: Arc<[Set]>,
    at: Arc<HashMap<ItemId, usize>>,
}

#[derive(Default)]
pub(super) struct Snapshots {
    known: HashMap<FrameOfReference, Arc<Snapshot>>,
    sets: Option<Arc<[Set]>>,
    /// When they were read; `None` when there may be others by now.
    sets_read: Option<Instant>,
    /// Counts changes of the sets. A read that began before a change is out of date.
    sets_asked: u64,
}

impl Snapshots {
    /// Stores sets that were read at this count. Returns the stored sets and whether they differ
    /// from those before; `None` if they are out of date.
    fn keep_sets(&mut self, asked: u64, fresh: Vec<Set>) -> Option<(Arc<[Set]>, bool)> {
        if self.sets_asked != asked {
            return None;
        }
        let known = self.sets.take();
        let were_known = known.is_some();
        let same = known.filter(|known| **known == *fresh);
        let are_others = were_known && same.is_none();
        let sets = same.unwrap_or_else(|| fresh.into());
        self.sets = Some(Arc::clone(&sets));
        self.sets_read = Some(Instant::now());
        Some((sets, are_others))
    }

    fn read_sets_anew(&mut self) {
        self.sets_read = None;
        self.sets_asked += 1;
    }
}

impl Snapshot {
    fn new(seq: u64, items: Vec<Arc<Versioned>>, sets: Arc<[Set]>) -> Self {
        let at = items.iter().enumerate().map(|(at, known)| (known.item.id, at)).collect();
        Self { seq, items: items.into(), sets, at: Arc::new(at) }
    }

    /// The item with this id.
    pub(crate) fn get(&self, id: ItemId) -> Option<&Arc<Versioned>> {
        self.at.get(&id).map(|&at| &self.items[at])
    }

    /// The state after these events, which follow it directly, for this frame of reference.
    fn after(&self, frame: &FrameOfReference, events: &[(Event, Home)], seq: u64) -> Self {
        let is_here = |home: &Home| home.frame.as_ref() == Some(frame);
        let concerns = |(event, home): &&(Event, Home)| is_here(home) || self.at.contains_key(&event.id);
        let mut changed: HashMap<ItemId, Option<Arc<Versioned>>> = HashMap::new();
        for (event, home) in events.iter().filter(concerns) {
            // What went to another frame of reference is gone from this one.
            let item = event.item.clone().filter(|_| is_here(home));
            changed.insert(event.id, item.map(|item| bare(event.version, item)));
        }
        if changed.is_empty() {
            return Self { seq, ..self.clone() };
        }
        let kept = self.items.iter().filter(|known| !changed.contains_key(&known.item.id)).cloned();
        let mut items: Vec<_> = kept.collect();
        items.extend(changed.into_values().flatten());
        items.sort_by(|a, b| order(&a.item).cmp(&order(&b.item)));
        Self::new(seq, items, Arc::clone(&self.sets))
    }
}

fn order(item: &Item) -> impl Ord + '_ {
    (item.set.as_str(), item.list.as_str(), item.order, item.created, item.id)
}

fn bare(version: u64, item: Item) -> Arc<Versioned> {
    Arc::new(Versioned { version, item: Item { frame_of_reference: None, ..item } })
}

impl Annotations {
    fn snapshots(&self) -> MutexGuard<'_, Snapshots> {
        // The value is whole between statements, so a panic elsewhere leaves it usable.
        self.snapshots.lock().unwrap_or_else(PoisonError::into_inner)
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
    pub(super) fn follow(&self, events: &[(Event, Home)]) {
        let (Some((first, _)), Some((last, _))) = (events.first(), events.last()) else { return };
        let follows = |known: &Arc<Snapshot>| known.seq + 1 == first.seq;
        let known = self.snapshots().known.clone();
        for (frame, known) in known.into_iter().filter(|(_, known)| follows(known)) {
            self.keep(&frame, Arc::new(known.after(&frame, events, last.seq)));
        }
    }

    /// All sets, as they were a moment ago. Where they are others than those that were known,
    /// pictures have to be looked at again.
    pub(super) async fn sets(&self) -> Result<Arc<[Set]>, Problem> {
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
    pub(super) fn read_sets_anew(&self) {
        self.snapshots().read_sets_anew();
    }

    /// Sets have changed.
    pub(super) async fn sets_changed(&self) {
        self.read_sets_anew();
        if self.sets().await.is_err() {
            // Readers that can read them see the newest sets.
            self.changes.send_modify(|changes| *changes += 1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sets(blinded: bool) -> Vec<Set> {
        vec![Set { name: "a".to_owned(), reader: None, blinded, template: None }]
    }

    #[test]
    fn sets_that_were_asked_for_before_a_change_was_known_of_are_not_kept() {
        let mut snapshots = Snapshots::default();
        let early = snapshots.sets_asked;
        assert!(!snapshots.keep_sets(early, sets(false)).unwrap().1, "the first are no others");
        snapshots.read_sets_anew();
        let late = snapshots.sets_asked;
        let (blinded, are_others) = snapshots.keep_sets(late, sets(true)).unwrap();
        assert!(are_others && blinded[0].blinded);
        assert!(snapshots.keep_sets(early, sets(false)).is_none(), "an answer that was long on its way");
        assert!(Arc::ptr_eq(snapshots.sets.as_ref().unwrap(), &blinded));
        let (same, are_others) = snapshots.keep_sets(late, sets(true)).unwrap();
        assert!(Arc::ptr_eq(&same, &blinded) && !are_others);
    }
}
