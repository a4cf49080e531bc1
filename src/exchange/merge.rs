//! Merging the items of a file with existing items: new, changed and equal ones.

use std::collections::{HashMap, VecDeque};

use super::ExchangeError;
use relief_annotation::{Change, Geometry, Item, ItemId, Versioned};

/// Points nearer than this have not moved: files have 32 bits at worst, mm.
const SAME_MM: f64 = 1e-4;

/// The treatment of items that exist already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExistingItems {
    /// They stay as they are.
    Keep,
    /// They are replaced by the file's version.
    Update,
    /// The file's come in beside them, under new ids.
    Duplicate,
}

/// The result of a merge.
#[derive(Clone, Debug)]
pub struct Merged {
    /// The changes, for one edit; may be empty.
    pub changes: Vec<Change>,
    /// Existing items that equal the file's.
    pub unchanged: usize,
    /// Existing items that differ and stay unchanged.
    pub skipped: usize,
    /// Existing items that the file duplicates.
    pub copies: usize,
}

impl Merged {
    /// Compares the items of a file with the existing ones. Items match by their ids. Items of a
    /// format without ids, or of another log, match by set, list, name and place.
    ///
    /// # Errors
    /// When this machine gives no random numbers.
    pub fn of(
        items: Vec<Item>,
        known: Vec<Versioned>,
        present: ExistingItems,
    ) -> Result<Self, ExchangeError> {
        let mut known = UnmatchedItems::of(known);
        let mut merged = Self { changes: Vec::new(), unchanged: 0, skipped: 0, copies: 0 };
        for mut item in items {
            let found = known.take(&item);
            let (found, read) = match (found, present) {
                (Some(found), ExistingItems::Keep | ExistingItems::Update) => (found, item),
                (found, _) => {
                    merged.copies += usize::from(found.is_some());
                    item.id = ItemId::random()?; // an id that was ever used is never used again
                    merged.changes.push(Change::Create { item: Box::new(item) });
                    continue;
                }
            };
            let updated = updated(&found.item, read);
            if updated == found.item {
                merged.unchanged += 1;
            } else if present == ExistingItems::Update {
                merged.changes.push(Change::Update { item: Box::new(updated), version: found.version });
            } else {
                merged.skipped += 1;
            }
        }
        Ok(merged)
    }

    /// The message to the user about existing items, with the options for another treatment.
    #[must_use]
    pub fn note(&self, update: &str, duplicate: &str) -> Option<String> {
        let Self { unchanged, skipped, copies, .. } = self;
        if *copies > 0 {
            return Some(format!("{copies} items were there already, and come in once more"));
        }
        if *skipped == 0 {
            let is_all = *unchanged > 0 && self.changes.is_empty();
            return is_all.then(|| {
                format!(
                    "{unchanged} items are there already, as the file has them; {duplicate} makes new ones"
                )
            });
        }
        Some(format!(
            "{} items are there already and stay as they are, {skipped} of them other than in the file; {update} changes \
             those, {duplicate} makes new items",
            unchanged + skipped
        ))
    }
}

/// Items of one name and place that are compared: a file of nothing else must not take the square of
/// its length.
const MOST_NAMESAKES: usize = 32;

/// Set, list and name of an item, and the cell of space that its first point is in.
type Key = ([String; 3], Option<[i64; 3]>);

/// The existing items that have not been matched yet.
struct UnmatchedItems {
    by_id: HashMap<ItemId, Versioned>,
    by_name: HashMap<Key, VecDeque<ItemId>>,
}

impl UnmatchedItems {
    fn of(known: Vec<Versioned>) -> Self {
        let mut by_name: HashMap<Key, VecDeque<ItemId>> = HashMap::new();
        for found in &known {
            by_name.entry((named(&found.item), cell(&found.item))).or_default().push_back(found.item.id);
        }
        Self { by_id: known.into_iter().map(|found| (found.item.id, found)).collect(), by_name }
    }

    fn take(&mut self, item: &Item) -> Option<Versioned> {
        if let Some(found) = self.by_id.remove(&item.id) {
            return Some(found);
        }
        let name = named(item);
        neighbours(cell(item)).into_iter().find_map(|cell| {
            let ids = self.by_name.get_mut(&(name.clone(), cell))?;
            let is_same = |id: &ItemId| {
                self.by_id.get(id).is_some_and(|found| match (&item.geometry, &found.item.geometry) {
                    (Some(new), Some(old)) => new == old || has_not_moved(new, old),
                    (new, old) => new.is_none() && old.is_none(),
                })
            };
            let index = ids.iter().take(MOST_NAMESAKES).position(is_same)?;
            self.by_id.remove(&ids.remove(index)?)
        })
    }
}

/// The cell of an item's first point; `None` for items without points. A cell is a hundred times as
/// wide as [`SAME_MM`].
fn cell(item: &Item) -> Option<[i64; 3]> {
    let first = item.geometry.as_ref()?.points().first()?;
    Some(first.xyz.to_array().map(|mm| (mm / (100.0 * SAME_MM)).round() as i64))
}

/// A cell, and those around it: the same place may be just beyond a cell's face.
fn neighbours(cell: Option<[i64; 3]>) -> Vec<Option<[i64; 3]>> {
    let Some([x, y, z]) = cell else { return vec![None] };
    let offsets = (0..27).map(|n| [n % 3, n / 3 % 3, n / 9].map(|at| [0, -1, 1][at]));
    offsets.map(|[dx, dy, dz]| Some([x + dx, y + dy, z + dz])).collect()
}

fn named(item: &Item) -> [String; 3] {
    [item.set.clone(), item.list.clone(), item.name.clone()]
}

/// An item with the properties that every format holds taken from a file; the rest is as it was.
fn updated(current: &Item, read: Item) -> Item {
    let mut geometry = read.geometry;
    // Files of other tools say neither whether a curve is smooth, nor the last digits of what did
    // not move.
    if let (Some(Geometry::Curve { smooth, .. }), Some(Geometry::Curve { smooth: was, .. })) =
        (&mut geometry, &current.geometry)
    {
        *smooth = *was;
    }
    if let (Some(new), Some(old)) = (&geometry, &current.geometry)
        && has_not_moved(new, old)
    {
        geometry = current.geometry.clone();
    }
    Item {
        name: read.name,
        description: read.description,
        state: if geometry.is_none() && current.geometry.is_none() { current.state } else { read.state },
        geometry,
        locked: read.locked,
        visible: read.visible,
        ..current.clone()
    }
}

fn has_not_moved(new: &Geometry, old: &Geometry) -> bool {
    let (a, b) = (new.points(), old.points());
    let is_near = a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.distance(*b) < SAME_MM);
    let is_plane = matches!(new, Geometry::Plane { .. });
    new.kind() == old.kind() && !a.is_empty() && is_near && !is_plane
}
