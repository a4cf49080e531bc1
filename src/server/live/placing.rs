//! The effects of a hand on the annotations of a volume: points that users place in a view become
//! items.
//!
//! The next missing item of the set, in its order, gets the position; without missing items, a new
//! point gets the next free number. Each session has its own place in that order, so that two
//! people can work through one list and skip items. Existing points can be grabbed and moved.

use std::sync::Arc;
use std::time::Instant;

use parking_lot::Mutex;
use serde_json::Value;

use crate::annotation_service::{
    Annotations, HistoryStep, Home, Published, Snapshot, Visible, of, outward_event,
};
use crate::annotations::missing_author;
use crate::identity::{Caller, Scope};
use crate::problem::Problem;
use crate::state::LiveParts;
use relief_annotation::{
    CameraRecord, Change, Device, Expected, ExpectedKind, HeldLandmark, Item, LandmarkList, LandmarkTask,
    Method, Placement, Set, ShownSets, Snap, Versioned,
};
use relief_base::{Patient, Point, Vector};
use relief_live::{AnnotationsMessage, NextLabel, ServerMessage};
use relief_session::{EditContext, Effect, Engine, HeldPoint, View, VolumeEntry};
use relief_volume::{Camera, Projection};

/// The reason for an item's place, in the log.
const REASON: &str = "live session";

/// Author of placements, and position in the list.
pub(super) struct LandmarkPlacer<'a> {
    pub(super) author: Option<&'a str>,
    pub(super) caller: &'a Caller,
    pub(super) task: &'a Mutex<LandmarkTask>,
    /// The tracked device of the hand.
    pub(super) device: Device,
}

/// Applies an effect in the context in which it was caused, and returns the next label.
///
/// # Errors
/// When the caller may not annotate, no author is known, and whatever the store refuses.
pub(super) async fn apply_effect(
    parts: &LiveParts,
    view: &View,
    hand: &LandmarkPlacer<'_>,
    effect: Effect,
    context: &EditContext,
) -> Result<AnnotationsMessage, Problem> {
    let annotations = of(parts.annotations.as_ref())?;
    hand.caller.may(Scope::Annotate)?;
    let author = hand.author.ok_or_else(missing_author)?;
    let EditContext { entry, shown, epoch } = context;
    let by = EditAuthor { annotations, entry, shown, author };
    match effect {
        Effect::Take { at, reach_mm } => {
            hand.task.lock().began = Some(*epoch);
            let moved = by.nearest(at, reach_mm, *epoch).await?;
            let held = moved.as_ref().map(|HeldLandmark { known, offset, from, .. }| HeldPoint {
                name: known.item.name.clone(),
                offset: *offset,
                from: *from,
            });
            hand.task.lock().held = moved;
            view.hold(held, *epoch, Instant::now());
            return next(parts, view, hand).await; // nothing has changed yet
        }
        Effect::Cancel => {
            abandon(hand.task, view);
            return next(parts, view, hand).await;
        }
        Effect::Place { at, camera, method } => {
            let began = hand.task.lock().began.take();
            let moved = let_go(hand.task, view);
            let wanted = moved.as_ref().map_or(at, |moved| at + moved.offset);
            // A hand that closed before the view came to show something else means nothing here,
            // and a point that was taken hold of and not moved stays where it is.
            let is_stale = began.is_some_and(|began| began != *epoch);
            if is_stale || moved.as_ref().is_some_and(|moved| moved.from == wanted) {
                return next(parts, view, hand).await;
            }
            let ray = (method == Method::Pick).then(|| wanted - camera.eye());
            let (to, snapped_mm) = snapped(&parts.engine, view.snap(), entry, wanted, ray).await?;
            let (device, camera) = (Some(hand.device.clone()), Some(record(&camera)));
            let placement = Placement { method, device, camera, snapped_mm };
            match moved {
                Some(moved) => by.change(moved.moved_to(to, placement)).await?,
                None => by.place(hand, to, placement).await?,
            }
        }
        Effect::NextLabel => {
            let snapshot = annotations.snapshot(&entry.frame_of_reference()).await?;
            let list = list_of(annotations, &snapshot, shown, author).await;
            let mut task = hand.task.lock();
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
/// The errors of the store.
pub(super) async fn next(
    parts: &LiveParts,
    view: &View,
    hand: &LandmarkPlacer<'_>,
) -> Result<AnnotationsMessage, Problem> {
    let annotations = of(parts.annotations.as_ref())?;
    let EditContext { entry, shown, epoch } = view.context();
    let snapshot = annotations.snapshot(&entry.frame_of_reference()).await?;
    let author = hand.author.unwrap_or_default();
    let list = list_of(annotations, &snapshot, &shown, author).await;
    let task = hand.task.lock().clone();
    let of = |known: &Versioned| NextLabel {
        set: known.item.set.clone(),
        name: known.item.name.clone(),
        id: Some(known.item.id.to_string()),
    };
    let moved = task.held.filter(|moved| moved.epoch == epoch);
    let next = match (&moved, list.target(task.label)) {
        (Some(moved), _) => of(&moved.known),
        (None, Some(target)) => of(target),
        (None, None) => NextLabel { set: list.set().to_owned(), name: list.next_number(), id: None },
    };
    Ok(AnnotationsMessage { seq: snapshot.seq, events: Vec::new(), more: false, next: Some(next) })
}

/// Where something is set down in a view that snaps, and by how much it was moved; where nothing of
/// the kind is near, it stays.
async fn snapped(
    engine: &Engine,
    wanted: Option<Snap>,
    entry: &VolumeEntry,
    at: Point<Patient>,
    ray: Option<Vector<Patient>>,
) -> Result<(Point<Patient>, Option<[f64; 3]>), Problem> {
    let Some(wanted) = wanted else { return Ok((at, None)) };
    let found = engine.snap(entry, at, ray, wanted).await?;
    Ok(found.map_or((at, None), |found| (found.at, Some(found.shift.xyz.to_array()))))
}

/// Releases the held point where it was.
pub(super) fn abandon(task: &Mutex<LandmarkTask>, view: &View) {
    drop(let_go(task, view));
}

/// Releases the held point and returns it.
fn let_go(task: &Mutex<LandmarkTask>, view: &View) -> Option<HeldLandmark> {
    let moved = {
        let mut task = task.lock();
        task.began = None;
        task.held.take()
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
        at: Point<Patient>,
        reach_mm: f64,
        epoch: u64,
    ) -> Result<Option<HeldLandmark>, Problem> {
        let snapshot = self.annotations.snapshot(&self.entry.frame_of_reference()).await?;
        let visible = Visible::new(&snapshot.sets, Some(self.author));
        let phase = self.entry.phase().map(|phase| phase.number);
        let may = |known: &&Arc<Versioned>| {
            let Item { visible: is_visible, set, locked, .. } = &known.item;
            let is_drawn = *is_visible && self.shown.has(set) && known.item.is_in_phase(phase);
            is_drawn && !locked && visible.expect_writable(set).is_ok()
        };
        Ok(HeldLandmark::nearest(snapshot.items.iter().filter(may), at, reach_mm, epoch))
    }

    /// Stores a change.
    async fn change(&self, change: Change) -> Result<(), Problem> {
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
        let list = list_of(self.annotations, &snapshot, self.shown, self.author).await;
        let target = list.target(hand.task.lock().label);
        let change = list
            .placed(target, self.author, at, placement)
            .map_err(|error| Problem::internal("drawing a random id", error))?;
        self.change(change).await?;
        // The next label follows it.
        hand.task.lock().label = target.and_then(|target| list.following(target.item.id));
        Ok(())
    }
}

/// The list in which an author places: of the sets that are shown the first into which the author
/// may write; the author's own where all are shown.
async fn list_of<'a>(
    annotations: &Annotations,
    snapshot: &'a Snapshot,
    shown: &'a ShownSets,
    author: &str,
) -> LandmarkList<'a> {
    let visible = Visible::new(&snapshot.sets, Some(author).filter(|author| !author.is_empty()));
    let set = match shown {
        ShownSets::Sets(names) => {
            let named = names.iter().find(|name| visible.expect_writable(name).is_ok());
            let seen = || names.iter().find(|name| visible.sees(name));
            named.or_else(seen).map_or(Set::DEFAULT, String::as_str)
        }
        ShownSets::All | ShownSets::Nothing => {
            let own = visible.own();
            snapshot.sets.iter().find(|set| set.name == own).map_or(Set::DEFAULT, |set| &set.name)
        }
    };
    let mut list = LandmarkList::new(set, &snapshot.items);
    for name in list.lists_with_missing().into_iter().filter(|name| Set::check_name(name).is_ok()) {
        // A list without a template is one of points.
        let Ok(template) = annotations.template(name).await else { continue };
        let is_other = |expected: &Expected| expected.kind != ExpectedKind::Point;
        list.leave_out(name, template.items.into_iter().filter(is_other).map(|expected| expected.name));
    }
    list
}

/// A message for clients.
pub(super) fn text(message: AnnotationsMessage) -> String {
    ServerMessage::Annotations(message).to_text()
}

/// Events for a client that sees these sets of this volume; `None` where none is for it.
pub(super) fn event_message(
    published: &Published,
    frame: &relief_annotation::FrameOfReference,
    author: Option<&str>,
) -> Option<AnnotationsMessage> {
    let visible = Visible::new(&published.sets, author);
    let is_for = |home: &Home| home.frame.as_ref() == Some(frame) && visible.sees(&home.set);
    let events: Vec<Value> = published
        .events
        .iter()
        .filter(|(_, home)| is_for(home))
        .map(|(event, home)| outward_event(event, &home.set))
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
