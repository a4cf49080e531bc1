//! The newest state of a volume's annotations, kept beside the store: lists and pictures ask for it many times between two edits.
//!
//! A snapshot is that of the log's last event; whether it still is costs one small question. Edits made here are added to it, edits of
//! other programs make it be read anew.

use std::collections::HashMap;
use std::sync::{Arc, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::Annotations;
use crate::annotation::{Event, FrameOfReference, Item, ItemId, Set, Versioned};
use crate::server::problem::Problem;
use crate::store::Filter;

/// Snapshots of so many frames of reference are kept.
const MOST: usize = 16;
/// Sets that other programs changed are seen after this.
const SETS_AGE: Duration = Duration::from_secs(1);

/// See the module. Items are without their frame of reference, which is the same for all.
pub(in crate::server) struct Snapshot {
    /// The log's last event.
    pub(in crate::server) seq: u64,
    /// By set, list, order, creation and id.
    pub(in crate::server) items: Vec<Arc<Versioned>>,
    pub(in crate::server) sets: Arc<[Set]>,
    at: HashMap<ItemId, usize>,
}

#[derive(Default)]
pub(super) struct Snapshots {
    known: HashMap<FrameOfReference, Arc<Snapshot>>,
    sets: Option<Arc<[Set]>>,
    /// When they were read; `None` when there may be others by now.
    sets_read: Option<Instant>,
}

impl Snapshot {
    fn new(seq: u64, items: Vec<Arc<Versioned>>, sets: Arc<[Set]>) -> Self {
        let at = items.iter().enumerate().map(|(at, known)| (known.item.id, at)).collect();
        Self { seq, items, sets, at }
    }

    /// The item with this id.
    pub(in crate::server) fn get(&self, id: ItemId) -> Option<&Arc<Versioned>> {
        self.at.get(&id).map(|&at| &self.items[at])
    }

    /// The state after these events, which follow it at once.
    fn after(&self, events: &[Event], seq: u64) -> Self {
        let mut items = self.items.clone();
        let mut at = self.at.clone();
        let mut gone = Vec::new();
        for event in events {
            match (&event.item, at.get(&event.id).copied()) {
                (Some(item), Some(place)) => items[place] = bare(event.version, item.clone()),
                (Some(item), None) => {
                    at.insert(event.id, items.len());
                    items.push(bare(event.version, item.clone()));
                }
                (None, Some(_)) => gone.push(event.id),
                (None, None) => {}
            }
        }
        items.retain(|known| !gone.contains(&known.item.id));
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
        // What is locked here is whole between statements, so a panic elsewhere leaves it usable.
        self.snapshots.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The newest state of what is told from this frame of reference.
    pub(in crate::server) async fn snapshot(
        &self,
        frame: &FrameOfReference,
    ) -> Result<Arc<Snapshot>, Problem> {
        let sets = self.sets().await?;
        let known = self.snapshots().known.get(frame).cloned();
        let seq = self.store.seq().await?;
        if let Some(known) = known.filter(|known| known.seq == seq) {
            if Arc::ptr_eq(&known.sets, &sets) {
                return Ok(known);
            }
            let fresh = Snapshot::new(seq, known.items.clone(), sets);
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

    /// Adds events to the snapshot that they follow; any other one is read anew when it is asked for.
    pub(super) fn follow(&self, frame: &FrameOfReference, events: &[Event]) {
        let (Some(first), Some(last)) = (events.first(), events.last()) else { return };
        let known = self.snapshots().known.get(frame).cloned();
        if let Some(known) = known.filter(|known| known.seq + 1 == first.seq) {
            self.keep(frame, Arc::new(known.after(events, last.seq)));
        }
    }

    /// All sets, as they were a moment ago.
    pub(super) async fn sets(&self) -> Result<Arc<[Set]>, Problem> {
        let (known, read) = {
            let snapshots = self.snapshots();
            (snapshots.sets.clone(), snapshots.sets_read)
        };
        if let Some(sets) = known.as_ref().filter(|_| read.is_some_and(|read| read.elapsed() < SETS_AGE)) {
            return Ok(Arc::clone(sets));
        }
        let fresh: Arc<[Set]> = self.store.sets().await?.into();
        let sets = known.filter(|known| **known == *fresh).unwrap_or(fresh);
        let mut snapshots = self.snapshots();
        snapshots.sets = Some(Arc::clone(&sets));
        snapshots.sets_read = Some(Instant::now());
        Ok(sets)
    }

    /// There may be other sets than those that were read.
    pub(super) fn read_sets_anew(&self) {
        self.snapshots().sets_read = None;
    }

    /// Reads the sets anew; true where they are others than those that were known.
    pub(super) async fn sets_are_others(&self) -> Result<bool, Problem> {
        let known = self.snapshots().sets.clone();
        self.read_sets_anew();
        let sets = self.sets().await?;
        Ok(known.is_some_and(|known| !Arc::ptr_eq(&known, &sets)))
    }

    /// Sets have changed.
    pub(super) fn forget_sets(&self) {
        self.read_sets_anew();
        self.changes.send_modify(|changes| *changes += 1);
    }
}
