//! The newest state of the annotations of each volume, in memory.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Instant;

use super::published::Home;
use relief_annotation::{Event, FrameOfReference, Item, ItemId, Set, Versioned};

/// See the module. Items are without their frame of reference, which is the same for all.
#[derive(Clone)]
pub(crate) struct Snapshot {
    /// The log's last event.
    pub(crate) seq: u64,
    /// By set, list, order, creation and id.
    pub(crate) items: Arc<[Arc<Versioned>]>,
    pub(crate) sets: Arc<[Set]>,
    pub(super) at: Arc<HashMap<ItemId, usize>>,
}

#[derive(Default)]
pub(super) struct Snapshots {
    pub(super) known: HashMap<FrameOfReference, Arc<Snapshot>>,
    pub(super) sets: Option<Arc<[Set]>>,
    /// When they were read; `None` when there may be others by now.
    pub(super) sets_read: Option<Instant>,
    /// Counts changes of the sets. A read that began before a change is out of date.
    pub(super) sets_asked: u64,
}

impl Snapshots {
    /// Stores sets that were read at this count. Returns the stored sets and whether they differ
    /// from those before; `None` if they are out of date.
    pub(super) fn keep_sets(&mut self, asked: u64, fresh: Vec<Set>) -> Option<(Arc<[Set]>, bool)> {
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

    pub(super) fn read_sets_anew(&mut self) {
        self.sets_read = None;
        self.sets_asked += 1;
    }
}

impl Snapshot {
    pub(super) fn new(seq: u64, items: Vec<Arc<Versioned>>, sets: Arc<[Set]>) -> Self {
        let at = items.iter().enumerate().map(|(at, known)| (known.item.id, at)).collect();
        Self { seq, items: items.into(), sets, at: Arc::new(at) }
    }

    /// The item with this id.
    pub(crate) fn get(&self, id: ItemId) -> Option<&Arc<Versioned>> {
        self.at.get(&id).map(|&at| &self.items[at])
    }

    /// The state after these events, which follow it directly, for this frame of reference.
    pub(super) fn after(&self, frame: &FrameOfReference, events: &[(Event, Home)], seq: u64) -> Self {
        let is_here = |home: &Home| home.frame.as_ref() == Some(frame);
        let concerns = |(event, home): &&(Event, Home)| is_here(home) || self.at.contains_key(&event.id);
        let mut changed: HashMap<ItemId, Option<Arc<Versioned>>> = HashMap::new();
        for (event, home) in events.iter().filter(concerns) {
            // An item that went to another frame of reference is gone from this one.
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

pub(super) fn bare(version: u64, item: Item) -> Arc<Versioned> {
    Arc::new(Versioned { version, item: Item { frame_of_reference: None, ..item } })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sets(blinded: bool) -> Vec<Set> {
        vec![Set { name: "a".to_owned(), reader: None, blinded, template: None }]
    }

    #[test]
    fn sets_requested_before_a_change_are_not_cached() {
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
