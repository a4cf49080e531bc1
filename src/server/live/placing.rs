//! Placing landmarks by hand: points that users place in a view become items of the volume's
//! annotations.
//!
//! The next missing item of the set, in its order, gets the position; without missing items, a new
//! point gets the next free number. Each session has its own place in that order, so that two
//! people can work through one list and skip items. Existing points can be grabbed and moved.

use std::collections::{BTreeSet, HashSet};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use serde_json::Value;

use crate::annotations::{Annotations, HistoryStep, Snapshot, Visible, missing_author, of};
use crate::problem::Problem;
use crate::state::LiveParts;
use relief_annotation::{
    CameraRecord, Change, Device, Expected, ExpectedKind, Geometry, Item, ItemId, Method, Placement, Set,
    ShownSets, Snap, State, Versioned,
};
use relief_base::{Patient, Point, Vector};
use relief_live::{AnnotationsMessage, NextLabel, ServerMessage};
use relief_session::{EditContext, Effect, Engine, HeldPoint, View, VolumeEntry, lock};
use relief_volume::{Camera, Projection};

/// Why an item came to be where it is, in the log.
const REASON: &str = "live session";

/// Who places, and where in the list.
pub(super) struct LandmarkPlacer<'a> {
    pub(super) author: Option<&'a str>,
    pub(super) task: &'a Mutex<Task>,
    /// The tracked device of the hand.
    pub(super) device: Device,
}

/// The state of a hand.
#[derive(Clone, Default)]
pub(super) struct Task {
    /// The next item; `None` is the first missing one.
    label: Option<ItemId>,
    /// The point that is moved.
    moved: Option<GrabbedPoint>,
    /// The era of the view in which the hand last took hold, of a point or of nothing.
    began: Option<u64>,
}

/// A point of an item, as it was taken hold of.
#[derive(Clone)]
struct GrabbedPoint {
    known: Arc<Versioned>,
    /// Which of its points.
    index: usize,
    /// From the cursor to the point.
    offset: Vector<Patient>,
    /// The cursor and `offset`: the point but for rounding.
    from: Point<Patient>,
    /// The era of the view in which it was taken hold of.
    epoch: u64,
}

/// Applies an effect in the context in which it was caused, and returns the next label.
///
/// # Errors
/// When no author is known, and whatever the store refuses.
pub(super) async fn apply_effect(
    parts: &LiveParts,
    view: &View,
    hand: &LandmarkPlacer<'_>,
    (effect, context): (Effect, &EditContext),
) -> Result<AnnotationsMessage, Problem> {
    let annotations = of(parts.annotations.as_ref())?;
    let author = hand.author.ok_or_else(missing_author)?;
    let EditContext { entry, shown, epoch } = context;
    let by = EditAuthor { annotations, entry, shown, author };
    match effect {
        Effect::Take { at, reach_mm } => {
            lock(hand.task).began = Some(*epoch);
            let moved = by.nearest((at, reach_mm), *epoch).await?;
            let held = moved.as_ref().map(|GrabbedPoint { known, offset, from, .. }| HeldPoint {
                name: known.item.name.clone(),
                offset: *offset,
                from: *from,
            });
            lock(hand.task).moved = moved;
            view.hold(held, *epoch, Instant::now());
            return next(parts, view, hand).await; // nothing has changed yet
        }
        Effect::Cancel => {
            abandon(hand.task, view);
            return next(parts, view, hand).await;
        }
        Effect::Place { at, camera, method } => {
            let began = lock(hand.task).began.take();
            let moved = let_go(hand.task, view);
            let wanted = moved.as_ref().map_or(at, |moved| at + moved.offset);
            // A hand that closed before the view came to show something else means nothing here,
            // and a point that was taken hold of and not moved stays where it is.
            let is_stale = began.is_some_and(|began| began != *epoch);
            if is_stale || moved.as_ref().is_some_and(|moved| moved.from == wanted) {
                return next(parts, view, hand).await;
            }
            let ray = (method == Method::Pick).then(|| wanted - camera.eye());
            let (to, snapped_mm) = snapped(&parts.engine, view.snap(), entry, (wanted, ray)).await?;
            let (device, camera) = (Some(hand.device.clone()), Some(record(&camera)));
            let placement = Placement { method, device, camera, snapped_mm };
            match moved {
                Some(moved) => by.move_to(&moved, to, placement).await?,
                None => by.place(hand, to, placement).await?,
            }
        }
        Effect::NextLabel => {
            let snapshot = annotations.snapshot(&entry.frame_of_reference()).await?;
            let list = List::of(annotations, &snapshot, shown, author).await;
            let mut task = lock(hand.task);
            task.label = list.target(task.label).and_then(|target| list.following(target.item.id));
        }
        Effect::Undo => {
            annotations.step(entry, author, REASON, HistoryStep::Undo).await?;
        }
    }
    parts.live.views.wake();
    next(parts, view, hand).await
}

/// The label that the next `place` defines.
///
/// # Errors
/// Whatever the store says.
pub(super) async fn next(
    parts: &LiveParts,
    view: &View,
    hand: &LandmarkPlacer<'_>,
) -> Result<AnnotationsMessage, Problem> {
    let annotations = of(parts.annotations.as_ref())?;
    let EditContext { entry, shown, epoch } = view.context();
    let snapshot = annotations.snapshot(&entry.frame_of_reference()).await?;
    let author = hand.author.unwrap_or_default();
    let list = List::of(annotations, &snapshot, &shown, author).await;
    let task = lock(hand.task).clone();
    let of = |known: &Versioned| NextLabel {
        set: known.item.set.clone(),
        name: known.item.name.clone(),
        id: Some(known.item.id.to_string()),
    };
    let moved = task.moved.filter(|moved| moved.epoch == epoch);
    let next = match (&moved, list.target(task.label)) {
        (Some(moved), _) => of(&moved.known),
        (None, Some(target)) => of(target),
        (None, None) => NextLabel { set: list.set.to_owned(), name: list.number(), id: None },
    };
    Ok(AnnotationsMessage { seq: snapshot.seq, events: Vec::new(), more: false, next: Some(next) })
}

/// Where something is set down in a view that snaps, and by how much it was moved; where nothing of
/// the kind is near, it stays.
async fn snapped(
    engine: &Engine,
    wanted: Option<Snap>,
    entry: &VolumeEntry,
    (at, ray): (Point<Patient>, Option<Vector<Patient>>),
) -> Result<(Point<Patient>, Option<[f64; 3]>), Problem> {
    let Some(wanted) = wanted else { return Ok((at, None)) };
    let found = engine.snap(entry, (at, ray), wanted).await?;
    Ok(found.map_or((at, None), |found| (found.at, Some(found.shift.xyz.to_array()))))
}

/// Releases the held point where it was.
pub(super) fn abandon(task: &Mutex<Task>, view: &View) {
    drop(let_go(task, view));
}

/// Releases the held point and returns it.
fn let_go(task: &Mutex<Task>, view: &View) -> Option<GrabbedPoint> {
    let moved = {
        let mut task = lock(task);
        task.began = None;
        task.moved.take()
    };
    if let Some(moved) = &moved {
        view.hold(None, moved.epoch, Instant::now());
    }
    moved
}

/// An author who changes the annotations of a view.
struct EditAuthor<'a> {
    annotations: &'a Annotations,
    entry: &'a VolumeEntry,
    shown: &'a ShownSets,
    author: &'a str,
}

impl EditAuthor<'_> {
    /// The point that is drawn nearest to a place, within a reach, of an item that the author may
    /// change.
    async fn nearest(
        &self,
        (at, reach_mm): (Point<Patient>, f64),
        epoch: u64,
    ) -> Result<Option<GrabbedPoint>, Problem> {
        let snapshot = self.annotations.snapshot(&self.entry.frame_of_reference()).await?;
        let visible = Visible::new(&snapshot.sets, Some(self.author));
        let may = |item: &Item| {
            let is_drawn = item.visible && self.shown.has(&item.set);
            is_drawn && !item.locked && visible.expect_writable(&item.set).is_ok()
        };
        let mut nearest: Option<(f64, GrabbedPoint)> = None;
        for known in snapshot.items.iter().filter(|known| may(&known.item)) {
            let points = known.item.geometry.as_ref().map_or(&[][..], Geometry::points);
            for (index, point) in points.iter().enumerate() {
                let distance = point.distance(at);
                if distance <= nearest.as_ref().map_or(reach_mm, |(least, _)| *least) {
                    let (known, offset) = (Arc::clone(known), *point - at);
                    nearest =
                        Some((distance, GrabbedPoint { known, index, offset, from: at + offset, epoch }));
                }
            }
        }
        Ok(nearest.map(|(_, moved)| moved))
    }

    /// Moves a point.
    async fn move_to(
        &self,
        moved: &GrabbedPoint,
        to: Point<Patient>,
        placement: Placement,
    ) -> Result<(), Problem> {
        let GrabbedPoint { known, index, .. } = moved;
        let mut item = known.item.clone();
        if let Some(point) = item.geometry.as_mut().and_then(|geometry| geometry.points_mut().get_mut(*index))
        {
            *point = to;
        }
        item.placement = Some(placement);
        // The version at which it was grabbed: a later change of another author is not overwritten.
        let change = Change::Update { item: Box::new(item), version: known.version };
        self.annotations.apply(self.entry, self.author, REASON, vec![change]).await.map(drop)
    }

    /// Sets the next landmark down.
    async fn place(
        &self,
        hand: &LandmarkPlacer<'_>,
        at: Point<Patient>,
        placement: Placement,
    ) -> Result<(), Problem> {
        let snapshot = self.annotations.snapshot(&self.entry.frame_of_reference()).await?;
        let list = List::of(self.annotations, &snapshot, self.shown, self.author).await;
        let target = list.target(lock(hand.task).label);
        let change = list.placed(target, self.author, at, placement)?;
        self.annotations.apply(self.entry, self.author, REASON, vec![change]).await?;
        // The next label follows it.
        lock(hand.task).label = target.and_then(|target| list.following(target.item.id));
        Ok(())
    }
}

/// The set into which an author places.
struct List<'a> {
    set: &'a str,
    items: Vec<&'a Arc<Versioned>>,
    /// Lists and names of items that templates expect not to be points.
    others: HashSet<(String, String)>,
}

impl<'a> List<'a> {
    /// Of the sets that are shown the first into which the author may write; the author's own where
    /// all are shown.
    async fn of(
        annotations: &Annotations,
        snapshot: &'a Snapshot,
        shown: &'a ShownSets,
        author: &str,
    ) -> Self {
        let visible = Visible::new(&snapshot.sets, Some(author).filter(|author| !author.is_empty()));
        let set = match shown {
            ShownSets::Sets(names) => {
                let named = names.iter().find(|name| visible.expect_writable(name).is_ok());
                named.or(names.first()).map_or(Set::DEFAULT, String::as_str)
            }
            ShownSets::All | ShownSets::Nothing => {
                let own = visible.own();
                snapshot.sets.iter().find(|set| set.name == own).map_or(Set::DEFAULT, |set| &set.name)
            }
        };
        let items: Vec<_> = snapshot.items.iter().filter(|known| known.item.set == set).collect();
        let missing = items.iter().filter(|known| known.item.state == State::Missing);
        let lists: BTreeSet<&str> = missing.map(|known| known.item.list.as_str()).collect();
        let mut others = HashSet::new();
        for list in lists.into_iter().filter(|list| Set::check_name(list).is_ok()) {
            // A list without a template is one of points.
            let Ok(template) = annotations.template(list).await else { continue };
            let is_other = |expected: &Expected| expected.kind != ExpectedKind::Point;
            let names = template.items.into_iter().filter(is_other).map(|expected| expected.name);
            others.extend(names.map(|name| (list.to_owned(), name)));
        }
        Self { set, items, others }
    }

    /// Whether a landmark can be set down for it.
    fn is_open(&self, known: &Versioned) -> bool {
        let Item { state, locked, list, name, .. } = &known.item;
        *state == State::Missing && !locked && !self.others.contains(&(list.clone(), name.clone()))
    }

    fn missing(&self) -> impl Iterator<Item = &'a Arc<Versioned>> {
        self.items.iter().copied().filter(|known| self.is_open(known))
    }

    /// The missing item that is next: this one if it still is missing, or the first.
    fn target(&self, label: Option<ItemId>) -> Option<&'a Arc<Versioned>> {
        let labelled = label.and_then(|label| self.missing().find(|known| known.item.id == label));
        labelled.or_else(|| self.missing().next())
    }

    /// The missing item after this one; the first again behind the last.
    fn following(&self, id: ItemId) -> Option<ItemId> {
        let at = self.items.iter().position(|known| known.item.id == id)?;
        let is_missing = |known: &&&Arc<Versioned>| self.is_open(known);
        let (before, behind) = self.items.split_at(at);
        let next = behind.iter().skip(1).find(is_missing).or_else(|| before.iter().find(is_missing));
        next.map(|known| known.item.id)
    }

    /// The name of the next point that has none: a number that no item has.
    fn number(&self) -> String {
        let numbers = self.items.iter().filter_map(|known| known.item.name.parse::<u64>().ok());
        (numbers.max().unwrap_or(0).saturating_add(1)).to_string()
    }

    fn placed(
        &self,
        target: Option<&Arc<Versioned>>,
        author: &str,
        at_mm: Point<Patient>,
        placement: Placement,
    ) -> Result<Change, Problem> {
        let geometry = Some(Geometry::Point { at_mm });
        let placement = Some(placement);
        if let Some(target) = target {
            let item = Item { state: State::Defined, geometry, placement, ..target.item.clone() };
            return Ok(Change::Update { item: Box::new(item), version: target.version });
        }
        let item = Item::new(&self.number(), author, geometry)
            .map_err(|error| Problem::internal("drawing a random id", error))?;
        let order =
            self.items.iter().map(|known| known.item.order).max().map_or(0, |last| last.saturating_add(1));
        Ok(Change::Create { item: Box::new(Item { set: self.set.to_owned(), order, placement, ..item }) })
    }
}

/// A message for clients.
pub(super) fn text(message: AnnotationsMessage) -> String {
    ServerMessage::Annotations(message).to_text()
}

/// Events for a client that sees these sets of this volume; `None` where none is for it.
pub(super) fn told(
    published: &crate::annotations::Published,
    frame: &relief_annotation::FrameOfReference,
    author: Option<&str>,
) -> Option<AnnotationsMessage> {
    let visible = Visible::new(&published.sets, author);
    let is_for =
        |home: &crate::annotations::Home| home.frame.as_ref() == Some(frame) && visible.sees(&home.set);
    let events: Vec<Value> = published
        .events
        .iter()
        .filter(|(_, home)| is_for(home))
        .map(|(event, home)| crate::annotations::outward_event(event, &home.set))
        .collect();
    let seq = published.seq;
    (!events.is_empty()).then(|| AnnotationsMessage { seq, events, more: false, next: None }.bounded())
}

fn record(camera: &Camera) -> CameraRecord {
    let (vertical_fov_deg, height_mm) = match camera.projection() {
        Projection::Perspective { vertical_fov } => (Some(vertical_fov.to_degrees()), None),
        Projection::Orthographic { height_mm } => (None, Some(height_mm)),
    };
    CameraRecord {
        eye_mm: camera.eye().xyz.to_array(),
        look_at_mm: camera.look_at().xyz.to_array(),
        up: camera.up().xyz.to_array(),
        vertical_fov_deg,
        height_mm,
    }
}

/// The device of a session without a tracked remote.
pub(super) fn pointer() -> Device {
    Device { kind: "pointer".to_owned(), position_mm: None, orientation_xyzw: None }
}
