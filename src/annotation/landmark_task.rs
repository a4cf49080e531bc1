//! Placing landmarks one after another: which missing item of a set is next, and the point that a
//! hand holds.
//!
//! What it is: values and their order, without a log or a view. What it is not: edits (see
//! `relief_store`) or the effects of a hand (see `relief_session`). Patient mm.

use std::collections::{BTreeSet, HashSet};
use std::sync::Arc;

use super::change::{Change, Versioned};
use super::geometry::Geometry;
use super::item::{Item, ItemId, State};
use super::placement::Placement;
use relief_base::{Patient, Point, Vector};

/// The state of one hand: the next label, and the point that it holds.
#[derive(Clone, Debug, Default)]
pub struct LandmarkTask {
    /// The next item; `None` is the first missing one.
    pub label: Option<ItemId>,
    /// The point that is moved.
    pub held: Option<HeldLandmark>,
    /// The epoch of the view in which the hand last closed, around a point or around nothing.
    pub began: Option<u64>,
}

/// A point of an item that a hand holds.
#[derive(Clone, Debug)]
pub struct HeldLandmark {
    /// The item as it was when the hand closed.
    pub known: Arc<Versioned>,
    /// Index of the point among the item's points.
    pub index: usize,
    /// From the cursor to the point.
    pub offset: Vector<Patient>,
    /// The cursor plus `offset`: the point but for rounding.
    pub from: Point<Patient>,
    /// The epoch of the view in which the hand closed.
    pub epoch: u64,
}

impl HeldLandmark {
    /// The point of `items` that is nearest to a place and within `reach_mm` of it.
    pub fn nearest<'a>(
        items: impl IntoIterator<Item = &'a Arc<Versioned>>,
        at: Point<Patient>,
        reach_mm: f64,
        epoch: u64,
    ) -> Option<Self> {
        let mut nearest: Option<(f64, Self)> = None;
        for known in items {
            let points = known.item.geometry.as_ref().map_or(&[][..], Geometry::points);
            for (index, point) in points.iter().enumerate() {
                let distance_mm = point.distance(at);
                if distance_mm <= nearest.as_ref().map_or(reach_mm, |(least, _)| *least) {
                    let offset = *point - at;
                    let held = Self { known: Arc::clone(known), index, offset, from: at + offset, epoch };
                    nearest = Some((distance_mm, held));
                }
            }
        }
        nearest.map(|(_, held)| held)
    }

    /// The change that moves the point. It names the version at which the point was grabbed, so a
    /// later change of another author causes a conflict and is not overwritten.
    #[must_use]
    pub fn moved_to(&self, to: Point<Patient>, placement: Placement) -> Change {
        let mut item = self.known.item.clone();
        let points = item.geometry.as_mut().map(Geometry::points_mut);
        if let Some(point) = points.and_then(|points| points.get_mut(self.index)) {
            *point = to;
        }
        item.placement = Some(placement);
        Change::Update { item: Box::new(item), version: self.known.version }
    }
}

/// The items of one set in their order, and which of them a landmark may define.
#[derive(Clone, Debug)]
pub struct LandmarkList<'a> {
    set: &'a str,
    items: Vec<&'a Arc<Versioned>>,
    others: HashSet<(String, String)>,
}

impl<'a> LandmarkList<'a> {
    /// The items of `set`, of all items of a volume in their order.
    #[must_use]
    pub fn new(set: &'a str, items: &'a [Arc<Versioned>]) -> Self {
        let items = items.iter().filter(|known| known.item.set == set).collect();
        Self { set, items, others: HashSet::new() }
    }

    /// The name of the set.
    #[must_use]
    pub const fn set(&self) -> &'a str {
        self.set
    }

    /// The lists that have missing items. Their templates name the items that are not points.
    #[must_use]
    pub fn lists_with_missing(&self) -> BTreeSet<&'a str> {
        let missing = self.items.iter().filter(|known| known.item.state == State::Missing);
        missing.map(|known| known.item.list.as_str()).collect()
    }

    /// Leaves out items of a list, by name: their template expects something else than a point.
    pub fn leave_out(&mut self, list: &str, names: impl IntoIterator<Item = String>) {
        self.others.extend(names.into_iter().map(|name| (list.to_owned(), name)));
    }

    /// Whether a landmark can define it.
    fn is_open(&self, known: &Versioned) -> bool {
        let Item { state, locked, list, name, .. } = &known.item;
        *state == State::Missing && !locked && !self.others.contains(&(list.clone(), name.clone()))
    }

    /// The item that the next landmark defines: `label` if it is still missing, or the first
    /// missing one.
    #[must_use]
    pub fn target(&self, label: Option<ItemId>) -> Option<&'a Arc<Versioned>> {
        let mut missing = self.items.iter().copied().filter(|known| self.is_open(known));
        let first = missing.clone().next();
        label.and_then(|label| missing.find(|known| known.item.id == label)).or(first)
    }

    /// The missing item after this one; after the last, the first.
    #[must_use]
    pub fn following(&self, id: ItemId) -> Option<ItemId> {
        let at = self.items.iter().position(|known| known.item.id == id)?;
        let is_missing = |known: &&&Arc<Versioned>| self.is_open(known);
        let (before, behind) = self.items.split_at(at);
        let next = behind.iter().skip(1).find(is_missing).or_else(|| before.iter().find(is_missing));
        next.map(|known| known.item.id)
    }

    /// The name of a new point: the number after the largest that an item has as its name.
    #[must_use]
    pub fn next_number(&self) -> String {
        let numbers = self.items.iter().filter_map(|known| known.item.name.parse::<u64>().ok());
        (numbers.max().unwrap_or(0).saturating_add(1)).to_string()
    }

    /// The change that places a landmark: it defines `target`, or creates a new numbered point at
    /// the end of the set.
    ///
    /// # Errors
    /// When the machine gives no random numbers for a new id.
    pub fn placed(
        &self,
        target: Option<&Arc<Versioned>>,
        author: &str,
        at_mm: Point<Patient>,
        placement: Placement,
    ) -> Result<Change, getrandom::Error> {
        let geometry = Some(Geometry::Point { at_mm });
        let placement = Some(placement);
        if let Some(target) = target {
            let item = Item { state: State::Defined, geometry, placement, ..target.item.clone() };
            return Ok(Change::Update { item: Box::new(item), version: target.version });
        }
        let item = Item::new(&self.next_number(), author, geometry)?;
        let last = self.items.iter().map(|known| known.item.order).max();
        let order = last.map_or(0, |last| last.saturating_add(1));
        Ok(Change::Create { item: Box::new(Item { set: self.set.to_owned(), order, placement, ..item }) })
    }
}

#[cfg(test)]
mod tests {
    use super::super::placement::Method;
    use super::*;

    fn item(name: &str, list: &str, at: Option<[f64; 3]>) -> Arc<Versioned> {
        let geometry = at.map(|at| Geometry::Point { at_mm: Point::from_xyz(at.into()) });
        let item = Item::new(name, "anna", geometry).unwrap();
        Arc::new(Versioned { version: 3, item: Item { list: list.to_owned(), ..item } })
    }

    fn placement() -> Placement {
        Placement { method: Method::Pick, device: None, camera: None, snapped_mm: None }
    }

    #[test]
    fn missing_items_come_in_their_order_and_begin_again_after_the_last() {
        let items = [
            item("Nasion", "face", None),
            item("Chin", "face", Some([1.0, 2.0, 3.0])),
            item("Outline", "face", None),
            item("Sella", "face", None),
        ];
        let mut list = LandmarkList::new("default", &items);
        assert_eq!(list.lists_with_missing().into_iter().collect::<Vec<_>>(), ["face"]);
        list.leave_out("face", ["Outline".to_owned()]);
        let id = |at: usize| items[at].item.id;
        assert_eq!(list.target(None).unwrap().item.id, id(0));
        assert_eq!(list.target(Some(id(3))).unwrap().item.id, id(3));
        assert_eq!(list.target(Some(id(1))).unwrap().item.id, id(0), "the chin is defined already");
        assert_eq!(list.following(id(0)), Some(id(3)), "the outline is not a point");
        assert_eq!(list.following(id(3)), Some(id(0)));
    }

    #[test]
    fn a_landmark_defines_its_target_or_becomes_a_numbered_point_at_the_end() {
        let items = [item("7", "", Some([0.0; 3])), item("Nasion", "", None)];
        let list = LandmarkList::new("default", &items);
        let at = Point::from_xyz(glam::DVec3::new(4.0, 5.0, 6.0));
        let Change::Update { item, version } =
            list.placed(list.target(None), "anna", at, placement()).unwrap()
        else {
            panic!("a missing item is updated")
        };
        assert_eq!((item.id, version, item.point()), (items[1].item.id, 3, Some(at)));
        assert_eq!(item.state, State::Defined);
        let Change::Create { item } = list.placed(None, "ben", at, placement()).unwrap() else {
            panic!("a new point is created")
        };
        assert_eq!((item.name.as_str(), item.order, item.author.as_str()), ("8", 1, "ben"));
    }

    #[test]
    fn a_hand_takes_the_nearest_point_within_its_reach_and_moves_that_version() {
        let items = [item("far", "", Some([9.0, 0.0, 0.0])), item("near", "", Some([2.0, 0.0, 0.0]))];
        let at = Point::from_xyz(glam::DVec3::X);
        assert!(HeldLandmark::nearest(&items, at, 0.5, 1).is_none());
        let held = HeldLandmark::nearest(&items, at, 20.0, 1).unwrap();
        assert_eq!((held.known.item.name.as_str(), held.offset.xyz), ("near", glam::DVec3::X));
        let to = Point::from_xyz(glam::DVec3::Y);
        let Change::Update { item, version } = held.moved_to(to, placement()) else { panic!("an update") };
        assert_eq!((item.point(), version), (Some(to), 3));
    }
}
