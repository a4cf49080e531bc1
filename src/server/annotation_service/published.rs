//! Events as listeners get them, with the place of their items.

use std::sync::Arc;

use relief_annotation::{Event, FrameOfReference, Item, Set};

/// Events that are read at a time.
pub(super) const PAGE: u64 = 5000;

/// The published events of an edit.
pub(crate) struct Published {
    /// The log's last event.
    pub(crate) seq: u64,
    /// Each with the frame of reference and set of its item.
    pub(crate) events: Vec<(Event, Home)>,
    pub(crate) sets: Arc<[Set]>,
}

/// The frame of reference and the set of an item.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Home {
    pub(crate) frame: Option<FrameOfReference>,
    pub(crate) set: String,
}

impl Home {
    pub(super) fn of(item: &Item) -> Self {
        Self { frame: item.frame_of_reference.clone(), set: item.set.clone() }
    }
}

/// Direction of a step through an author's edits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum HistoryStep {
    Undo,
    Redo,
}
