//! Whether a log holds together.

use std::collections::{BTreeMap, HashMap};

use sqlx::{Any, Row, Transaction};

use super::Store;
use super::error::{Damage, StoreError};
use super::place::DatabaseKind as Database;
use super::rows::{EVENT, event, item, signed, unsigned};
use relief_annotation::{ContentId, Event, EventKind, Item, ItemId};

/// Events that are read at a time.
const PAGE: u64 = 5000;

/// The numbers of verified records.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Checked {
    /// Events of the log.
    pub events: u64,
    /// Items that there are.
    pub items: u64,
    /// Contents, each with the bytes that its name says.
    pub contents: u64,
}

/// The log, folded event by event.
#[derive(Default)]
struct Folded {
    /// Version, event and item.
    items: HashMap<ItemId, (u64, u64, Option<Item>)>,
    edits: BTreeMap<u64, (String, &'static str)>,
    last: Option<Event>,
}

impl Store {
    /// Reads the whole log: SQLite's own check of its file; events without gaps, each following
    /// from those before; items and edits as the events have them; contents with the SHA-256 that
    /// is their name.
    ///
    /// # Errors
    /// [`StoreError::Damaged`] with the first fault, and errors of the database.
    pub async fn check(&self) -> Result<Checked, StoreError> {
        let mut transaction = self.begin_read().await?;
        if self.kind == Database::Sqlite {
            let row = sqlx::query("PRAGMA integrity_check(1)").fetch_one(&mut *transaction).await?;
            let found: String = row.try_get(0)?;
            if found != "ok" {
                return Err(Damage::Database { finding: found }.into());
            }
        }
        let mut folded = Folded::default();
        loop {
            let after = folded.last.as_ref().map_or(0, |event| event.seq);
            let page = format!("SELECT {EVENT} FROM events WHERE seq > $1 ORDER BY seq LIMIT {PAGE}");
            let page = sqlx::query(sqlx::AssertSqlSafe(page)).bind(signed(after));
            let rows = page.fetch_all(&mut *transaction).await?;
            if rows.is_empty() {
                break;
            }
            for row in &rows {
                folded.add(event(row)?)?;
            }
        }
        let events = folded.last.as_ref().map_or(0, |event| event.seq);
        let items = compare_items(&mut transaction, folded.items).await?;
        compare_edits(&mut transaction, folded.edits).await?;
        let contents = check_contents(&mut transaction).await?;
        Ok(Checked { events, items, contents })
    }
}

impl Folded {
    fn add(&mut self, event: Event) -> Result<(), StoreError> {
        let wrong = |fault| Err(Damage::Event { seq: event.seq, fault }.into());
        let (last, edit) = self.last.as_ref().map_or((0, 0), |last| (last.seq, last.edit));
        if event.seq != last + 1 {
            return wrong("does not follow the one before it");
        }
        let version = self.items.get(&event.id).map_or(0, |(version, ..)| *version);
        if event.version != version + 1 {
            return wrong("does not have the version after the item's last one");
        }
        if event.item.as_ref().is_some_and(|item| item.id != event.id) {
            return wrong("has another item than it says");
        }
        if event.edit == event.seq {
            self.turn(&event)?;
        } else if event.edit != edit
            || self.last.as_ref().is_some_and(|last| (last.kind, last.target) != (event.kind, event.target))
            || self.last.as_ref().is_some_and(|last| last.author != event.author)
        {
            return wrong("belongs to no edit");
        }
        self.items.insert(event.id, (event.version, event.seq, event.item.clone()));
        self.last = Some(event);
        Ok(())
    }

    /// The effect of an edit, undo or redo, by its first event, on the author's history.
    fn turn(&mut self, event: &Event) -> Result<(), StoreError> {
        let (from, to) = match event.kind {
            EventKind::Do => {
                let own = self.edits.values_mut().filter(|(author, _)| *author == event.author);
                own.filter(|(_, state)| *state == "undone").for_each(|(_, state)| *state = "dropped");
                self.edits.insert(event.edit, (event.author.clone(), "done"));
                return Ok(());
            }
            EventKind::Undo => ("done", "undone"),
            EventKind::Redo => ("undone", "done"),
        };
        match self.edits.get_mut(&event.target.unwrap_or_default()) {
            Some((author, state)) if *author == event.author && *state == from => {
                *state = to;
                Ok(())
            }
            _ => Err(Damage::Step { seq: event.seq, expected: from }.into()),
        }
    }
}

async fn compare_items(
    transaction: &mut Transaction<'_, Any>,
    mut folded: HashMap<ItemId, (u64, u64, Option<Item>)>,
) -> Result<u64, StoreError> {
    let query = sqlx::query("SELECT id, version, seq, item, set_name, frame FROM items ORDER BY seq");
    let mut there = 0;
    for row in query.fetch_all(&mut **transaction).await? {
        let text: Option<String> = row.try_get(3)?;
        let (set, frame): (Option<String>, Option<String>) = (row.try_get(4)?, row.try_get(5)?);
        let found = (unsigned(&row, 1)?, unsigned(&row, 2)?, text.as_deref().map(item).transpose()?);
        let id: Option<ItemId> = row.try_get::<String, _>(0)?.parse().ok();
        let columns =
            found.2.as_ref().map(|item| (&item.set, item.frame_of_reference.as_ref().map(|f| &f.0)));
        let agrees = columns.map_or((None, None), |(set, frame)| (Some(set), frame));
        if id.and_then(|id| folded.remove(&id)).as_ref() != Some(&found)
            || agrees != (set.as_ref(), frame.as_ref())
        {
            return Err(Damage::Item { seq: found.1 }.into());
        }
        there += u64::from(found.2.is_some());
    }
    if folded.is_empty() { Ok(there) } else { Err(Damage::MissingItems { count: folded.len() }.into()) }
}

async fn compare_edits(
    transaction: &mut Transaction<'_, Any>,
    mut folded: BTreeMap<u64, (String, &'static str)>,
) -> Result<(), StoreError> {
    let query = sqlx::query("SELECT edit, author, state FROM edits ORDER BY edit");
    for row in query.fetch_all(&mut **transaction).await? {
        let (edit, author, state) = (unsigned(&row, 0)?, row.try_get(1)?, row.try_get::<String, _>(2)?);
        let as_folded = folded.remove(&edit);
        if as_folded.is_none_or(|(by, is): (String, _)| (by, is) != (author, state.as_str())) {
            return Err(Damage::Edit { edit }.into());
        }
    }
    if folded.is_empty() { Ok(()) } else { Err(Damage::MissingEdits { count: folded.len() }.into()) }
}

async fn check_contents(transaction: &mut Transaction<'_, Any>) -> Result<u64, StoreError> {
    let ids = sqlx::query("SELECT id FROM contents ORDER BY id").fetch_all(&mut **transaction).await?;
    for row in &ids {
        let id: String = row.try_get(0)?;
        // One at a time: they may be large.
        let query = sqlx::query("SELECT bytes FROM contents WHERE id = $1").bind(&id);
        let bytes: Vec<u8> = query.fetch_one(&mut **transaction).await?.try_get(0)?;
        if ContentId::of(&bytes).as_str() != id {
            return Err(Damage::Content { id }.into());
        }
    }
    Ok(ids.len() as u64)
}
