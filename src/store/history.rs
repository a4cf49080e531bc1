//! Taking back, and making again.

use sqlx::{Any, Row, Transaction};

use super::apply::EditWriter;
use super::error::{Damage, StoreError};
use super::rows::{EVENT, current, event, item, signed, unsigned, versioned};
use super::{Store, watch};
use relief_annotation::{Edit, Event, EventKind, Item, ItemId};

impl Store {
    /// Takes back the author's newest edit that stands, all of it.
    ///
    /// # Errors
    /// [`StoreError::NothingToUndo`], and [`StoreError::Conflict`] where another author
    /// has changed an item since the edit.
    pub async fn undo(&self, author: &str, reason: &str) -> Result<Vec<Event>, StoreError> {
        self.undo_if(author, reason, |_| Ok(())).await
    }

    /// Repeats the edit that the author undid last. A new edit removes all edits that could be
    /// repeated.
    ///
    /// # Errors
    /// [`StoreError::NothingToRedo`], and [`StoreError::Conflict`] where an item is not as it was
    /// before the edit.
    pub async fn redo(&self, author: &str, reason: &str) -> Result<Vec<Event>, StoreError> {
        self.redo_if(author, reason, |_| Ok(())).await
    }

    /// The same as [`Self::undo`], where every item of the edit may be changed: as it was before
    /// the edit, as the edit left it, and as it is now.
    ///
    /// # Errors
    /// Those of [`Self::undo`], and whatever `may` says: nothing has changed then.
    pub async fn undo_if<E: From<StoreError>>(
        &self,
        author: &str,
        reason: &str,
        may: impl Fn(&Item) -> Result<(), E> + Send + Sync,
    ) -> Result<Vec<Event>, E> {
        self.step(EventKind::Undo, author, reason, may).await
    }

    /// The same as [`Self::redo`], where every item of the edit may be changed.
    ///
    /// # Errors
    /// Those of [`Self::redo`], and whatever `may` says: nothing has changed then.
    pub async fn redo_if<E: From<StoreError>>(
        &self,
        author: &str,
        reason: &str,
        may: impl Fn(&Item) -> Result<(), E> + Send + Sync,
    ) -> Result<Vec<Event>, E> {
        self.step(EventKind::Redo, author, reason, may).await
    }

    async fn step<E: From<StoreError>>(
        &self,
        kind: EventKind,
        author: &str,
        reason: &str,
        may: impl Fn(&Item) -> Result<(), E> + Send + Sync,
    ) -> Result<Vec<Event>, E> {
        Edit::check_words(author, reason).map_err(StoreError::from)?;
        let mut transaction = self.begin_write().await?;
        let (target, made) = next_step(&mut transaction, kind, author).await?;
        for MadeEvent { event, before, now, .. } in &made {
            event.item.iter().chain(before).chain(now).try_for_each(&may)?;
        }
        Ok(self.take_step(transaction, kind, target, author, reason, made).await?)
    }

    async fn take_step(
        &self,
        mut transaction: Transaction<'static, Any>,
        kind: EventKind,
        target: u64,
        author: &str,
        reason: &str,
        made: Vec<MadeEvent>,
    ) -> Result<Vec<Event>, StoreError> {
        let mut writing = EditWriter::begin(&mut transaction, kind, Some(target), author, reason).await?;
        for made in made {
            restore(&mut writing, kind, made, author).await?;
        }
        let events = writing.finish();
        sqlx::query("UPDATE edits SET state = $1 WHERE edit = $2")
            .bind(if kind == EventKind::Undo { "undone" } else { "done" })
            .bind(signed(target))
            .execute(&mut *transaction)
            .await?;
        self.announce(&mut transaction, watch::EVENT, events.last().map_or(0, |event| event.seq)).await?;
        transaction.commit().await?;
        Ok(events)
    }
}

/// An event of an edit.
struct MadeEvent {
    event: Event,
    /// The item before it; `None` where it did not exist.
    before: Option<Item>,
    /// The item as it is now; `None` where it is gone.
    now: Option<Item>,
    version: u64,
}

/// The edit that a step of an author concerns: its number, and its events in the order of the step.
async fn next_step(
    transaction: &mut Transaction<'_, Any>,
    kind: EventKind,
    author: &str,
) -> Result<(u64, Vec<MadeEvent>), StoreError> {
    // Those taken back are all newer than those that stand: the lines of both meet between the
    // newest and the oldest.
    let (find, nothing) = if kind == EventKind::Undo {
        let find = "SELECT coalesce(max(edit), 0) FROM edits WHERE author = $1 AND state = 'done'";
        (find, StoreError::NothingToUndo)
    } else {
        let find = "SELECT coalesce(min(edit), 0) FROM edits WHERE author = $1 AND state = 'undone'";
        (find, StoreError::NothingToRedo)
    };
    let found = sqlx::query(find).bind(author).fetch_one(&mut **transaction).await?;
    let target = unsigned(&found, 0)?;
    if target == 0 {
        return Err(nothing);
    }
    let mut made = Vec::new();
    for event in events_of(transaction, target).await? {
        let id = event.id;
        let before = state(transaction, id, event.version - 1).await?;
        let Some((version, now)) = current(transaction, id).await? else {
            return Err(Damage::NoState { id }.into());
        };
        made.push(MadeEvent { event, before, now, version });
    }
    if kind == EventKind::Undo {
        made.reverse();
    }
    Ok((target, made))
}

/// Brings one item from one side of an edit's event to the other.
async fn restore(
    writing: &mut EditWriter<'_>,
    kind: EventKind,
    made: MadeEvent,
    author: &str,
) -> Result<(), StoreError> {
    let MadeEvent { event, before, now, version } = made;
    let id = event.id;
    let (from, to) = if kind == EventKind::Undo { (event.item, before) } else { (before, event.item) };
    if now != from {
        let expected = own_version(writing.transaction, id, author).await?;
        return Err(StoreError::Conflict {
            id,
            expected,
            current: versioned(version, now),
            yours: to.map(Box::new),
        });
    }
    writing.push(id, version + 1, to).await
}

/// The events of an edit, in order.
async fn events_of(transaction: &mut Transaction<'_, Any>, edit: u64) -> Result<Vec<Event>, StoreError> {
    let query = sqlx::AssertSqlSafe(format!("SELECT {EVENT} FROM events WHERE edit = $1 ORDER BY seq"));
    let rows = sqlx::query(query).bind(signed(edit)).fetch_all(&mut **transaction).await?;
    rows.iter().map(event).collect()
}

/// The item at a version; `None` before the first, and where it was gone.
async fn state(
    transaction: &mut Transaction<'_, Any>,
    id: ItemId,
    version: u64,
) -> Result<Option<Item>, StoreError> {
    let query = sqlx::query("SELECT item FROM events WHERE id = $1 AND version = $2");
    let row = query.bind(id.to_string()).bind(signed(version)).fetch_optional(&mut **transaction).await?;
    let text: Option<String> = row.map(|row| row.try_get(0)).transpose()?.flatten();
    text.as_deref().map(item).transpose()
}

/// The last version that the author made.
async fn own_version(
    transaction: &mut Transaction<'_, Any>,
    id: ItemId,
    author: &str,
) -> Result<u64, StoreError> {
    let query = sqlx::query("SELECT coalesce(max(version), 0) FROM events WHERE id = $1 AND author = $2");
    let row = query.bind(id.to_string()).bind(author).fetch_one(&mut **transaction).await?;
    unsigned(&row, 0)
}
