//! Edits: stored one after another, added to the snapshot, and published to listeners.

use std::collections::HashMap;
use std::sync::Arc;

use axum::http::StatusCode;

use super::published::{HistoryStep, Home, PAGE};
use super::refusal::no_such_item;
use super::service::{Annotations, Turn};
use super::snapshots::Snapshot;
use super::visible::Visible;
use crate::problem::Problem;
use relief_annotation::{Change, Edit, Event, Item, ItemId, Set, Timestamp, Versioned};
use relief_session::VolumeEntry;
use relief_store::{LogFilter, StoreError};

/// Up to this many items, the home of each is looked up; beyond, the whole log is read once.
const FEW: usize = 32;

impl Annotations {
    /// Makes changes to the items of a volume: all or none.
    ///
    /// # Errors
    /// 404 for items that are not there or not the author's to see, 403 for sets of others, and
    /// whatever the store refuses.
    pub(crate) async fn apply(
        &self,
        entry: &VolumeEntry,
        author: &str,
        reason: &str,
        changes: Vec<Change>,
    ) -> Result<Vec<(Event, Home)>, Problem> {
        let frame = entry.frame_of_reference();
        let turn = self.turn().await?;
        let snapshot = self.snapshot(&frame).await?;
        self.expect_none_elsewhere(&snapshot, &changes).await?;
        let visible = Visible::new(&snapshot.sets, Some(author));
        let completed =
            changes.into_iter().map(|change| complete(change, &snapshot, &visible, author, entry));
        let changes = completed.collect::<Result<_, _>>()?;
        let edit = Edit { author: author.to_owned(), reason: reason.to_owned(), changes };
        let events = self.store.apply(&edit).await?;
        let home = |event: &Event| {
            let before = || snapshot.get(event.id).map(|known| known.item.set.clone()).unwrap_or_default();
            let set = event.item.as_ref().map_or_else(before, |item| item.set.clone());
            Home { frame: Some(frame.clone()), set }
        };
        let homes = events.iter().map(home).collect();
        Ok(self.tell_own(turn, events, homes, &snapshot.sets).await)
    }

    /// Refuses to change items of other volumes: a change here would bring them into this one.
    async fn expect_none_elsewhere(&self, snapshot: &Snapshot, changes: &[Change]) -> Result<(), Problem> {
        let changed = changes.iter().filter_map(|change| match change {
            Change::Create { .. } => None,
            Change::Update { item, .. } => Some(item.id),
            Change::Delete { id, .. } => Some(*id),
        });
        for id in changed.filter(|id| snapshot.get(*id).is_none()) {
            match self.store.item(id).await {
                Ok(_) => return Err(no_such_item(&id)),
                Err(StoreError::NotFound { .. }) => {} // gone: the store answers with both versions
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    /// Undoes the author's newest edit, or redoes the one that was undone last. Allowed only where
    /// it belongs to this volume and to sets into which the author may write.
    ///
    /// # Errors
    /// 409 where there is nothing to undo or redo or it belongs to another volume, 403 for
    /// sets of other authors, and errors of the store.
    pub(crate) async fn step(
        &self,
        entry: &VolumeEntry,
        author: &str,
        reason: &str,
        step: HistoryStep,
    ) -> Result<Vec<(Event, Home)>, Problem> {
        let frame = entry.frame_of_reference();
        let turn = self.turn().await?;
        let sets = self.sets().await?;
        let visible = Visible::new(&sets, Some(author));
        // Checked inside the transaction: another edit may have become the newest meanwhile.
        let may = |item: &Item| {
            if item.frame_of_reference.as_ref() == Some(&frame) {
                visible.expect_writable(&item.set)
            } else {
                Err(of_another_volume(step))
            }
        };
        let events = match step {
            HistoryStep::Undo => self.store.undo_if(author, reason, may).await?,
            HistoryStep::Redo => self.store.redo_if(author, reason, may).await?,
        };
        let homes = self.homes(&events).await?;
        Ok(self.tell_own(turn, events, homes, &sets).await)
    }

    /// Tells an edit that was made here, behind what others have made before it.
    async fn tell_own(
        &self,
        mut turn: Turn<'_>,
        events: Vec<Event>,
        homes: Vec<Home>,
        sets: &Arc<[Set]>,
    ) -> Vec<(Event, Home)> {
        let first = events.first().map_or(0, |event| event.seq);
        let events: Vec<(Event, Home)> = events.into_iter().zip(homes).collect();
        match self.tell_until(&mut turn, first).await {
            Ok(_) => {
                self.follow(&events);
                self.tell(&mut turn, events.clone(), Arc::clone(sets));
            }
            // The edit is made: its author hears so, the others as soon as the log can be read.
            Err(_) => self.behind.notify_one(),
        }
        events
    }

    /// The volumes of the items of events; of a removed item, its last volume.
    pub(crate) async fn homes(&self, events: &[Event]) -> Result<Vec<Home>, Problem> {
        let gone: Vec<ItemId> =
            events.iter().filter(|event| event.item.is_none()).map(|event| event.id).collect();
        let mut known: HashMap<ItemId, Home> = HashMap::new();
        let filters = if gone.len() <= FEW {
            gone.iter().map(|&id| LogFilter { item: Some(id), ..LogFilter::default() }).collect()
        } else {
            vec![LogFilter::default()]
        };
        for mut filter in filters {
            filter.limit = Some(PAGE);
            loop {
                let page = self.store.log(&filter).await?;
                let Some(last) = page.last() else { break };
                filter.after = last.seq;
                for event in page {
                    known.extend(event.item.as_ref().map(|item| (event.id, Home::of(item))));
                }
            }
        }
        let nowhere = || Home { frame: None, set: String::new() };
        let home = |event: &Event| {
            let before = || known.get(&event.id).cloned().unwrap_or_else(nowhere);
            event.item.as_ref().map_or_else(before, Home::of)
        };
        Ok(events.iter().map(home).collect())
    }
}

/// Why an undo that would change another volume or a foreign set is refused.
fn of_another_volume(step: HistoryStep) -> Problem {
    let (kind, what) = match step {
        HistoryStep::Undo => {
            ("nothing-to-undo", "your newest change is of another volume; take it back there")
        }
        HistoryStep::Redo => {
            ("nothing-to-redo", "what you took back last is of another volume; make it again there")
        }
    };
    Problem::new(StatusCode::CONFLICT, kind, what)
}

/// Sets the author, time and frame of reference of a change, and checks that the author may make
/// it.
fn complete(
    change: Change,
    snapshot: &Snapshot,
    visible: &Visible<'_>,
    author: &str,
    entry: &VolumeEntry,
) -> Result<Change, Problem> {
    let frame = entry.frame_of_reference();
    let phase = entry.phase().and_then(|phase| u32::try_from(phase.number).ok());
    let seen = |id: ItemId| -> Result<&Arc<Versioned>, Problem> {
        let known = snapshot.get(id).filter(|known| visible.sees(&known.item.set));
        let known = known.ok_or_else(|| no_such_item(&id))?;
        visible.expect_writable(&known.item.set).map(|()| known)
    };
    Ok(match change {
        Change::Create { mut item } => {
            visible.expect_writable(&item.set)?;
            item.author = author.to_owned();
            item.created = Timestamp::now();
            item.frame_of_reference = Some(frame);
            item.phase = phase;
            Change::Create { item }
        }
        Change::Update { mut item, version } => {
            match seen(item.id) {
                Ok(known) => {
                    item.author.clone_from(&known.item.author);
                    item.created = known.item.created;
                    // A place belongs to the phase in which it was chosen.
                    let is_moved = item.geometry != known.item.geometry;
                    item.phase = if is_moved { phase } else { known.item.phase };
                }
                // Gone since the author saw it: the store knows, and answers with both versions.
                Err(_) if version > 0 && snapshot.get(item.id).is_none() => {}
                Err(problem) => return Err(problem),
            }
            visible.expect_writable(&item.set)?;
            item.frame_of_reference = Some(frame);
            Change::Update { item, version }
        }
        Change::Delete { id, version } => {
            if snapshot.get(id).is_some() {
                seen(id)?;
            }
            Change::Delete { id, version }
        }
    })
}
