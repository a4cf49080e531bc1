//! Made-up logs, items and edits.

use std::path::PathBuf;
use std::sync::atomic::{AtomicI64, Ordering};

use relief_annotation::{Change, Edit, Event, Geometry, Item, ItemId, Timestamp};
use relief_base::Point;
use relief_store::{Filter, Store};

/// A log in a folder that goes with it.
pub(crate) struct Made {
    pub(crate) store: Store,
    pub(crate) file: PathBuf,
    _folder: tempfile::TempDir,
}

impl Made {
    pub(crate) async fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("annotations.db");
        Self { store: Store::open(file.to_str().unwrap()).await.unwrap(), file, _folder: folder }
    }

    pub(crate) fn place(&self) -> &str {
        self.file.to_str().unwrap()
    }
}

/// A landmark at x mm, made after all others.
pub(crate) fn point(name: &str, x: f64) -> Item {
    static MADE: AtomicI64 = AtomicI64::new(0);
    let geometry = Geometry::Point { at_mm: Point::new(x, -2.5, 1.0 / 3.0) };
    let created = Timestamp::from_millis(MADE.fetch_add(1, Ordering::Relaxed)).unwrap();
    Item { created, ..Item::new(name, "anna", Some(geometry)).unwrap() }
}

pub(crate) fn edit(author: &str, changes: Vec<Change>) -> Edit {
    Edit { author: author.to_owned(), reason: "a test".to_owned(), changes }
}

pub(crate) fn create(item: &Item) -> Change {
    Change::Create { item: Box::new(item.clone()) }
}

/// The new state of the item, from the version that was read.
pub(crate) fn update(item: &Item, version: u64) -> Change {
    Change::Update { item: Box::new(item.clone()), version }
}

pub(crate) fn delete(id: ItemId, version: u64) -> Change {
    Change::Delete { id, version }
}

/// The same item by another name.
pub(crate) fn named(item: &Item, name: &str) -> Item {
    Item { name: name.to_owned(), ..item.clone() }
}

/// Names of all items, in the order of a listing.
pub(crate) async fn names(store: &Store) -> Vec<String> {
    let listing = store.list(&Filter::default()).await.unwrap();
    listing.items.into_iter().map(|found| found.item.name).collect()
}

pub(crate) fn seqs(events: &[Event]) -> Vec<u64> {
    events.iter().map(|event| event.seq).collect()
}
