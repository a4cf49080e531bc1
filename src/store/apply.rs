//! Changes: wanted ones become events.

use sqlx::{Any, Row, Transaction};

use super::error::StoreError;
use super::rows::{current, item_text, kind_name, signed, unsigned, versioned};
use super::{Store, watch};
use relief_annotation::{Change, ContentId, Edit, Event, EventKind, Item, ItemId, Timestamp};

/// Events that are being added, all of one edit.
pub(super) struct EditWriter<'a> {
    pub(super) transaction: &'a mut Transaction<'static, Any>,
    /// Their common properties.
    kind: EventKind,
    target: Option<u64>,
    author: &'a str,
    reason: &'a str,
    time: Timestamp,
    /// The number of the first of them.
    edit: u64,
    events: Vec<Event>,
}

impl Store {
    /// Makes all changes of an edit or none of them. When it returns they are on the disk.
    ///
    /// # Errors
    /// [`StoreError::Conflict`] with both versions where another author was faster,
    /// [`StoreError::Locked`], [`StoreError::NotFound`], [`StoreError::Exists`],
    /// [`StoreError::Content`], [`StoreError::Invalid`], and errors of the database.
    pub async fn apply(&self, edit: &Edit) -> Result<Vec<Event>, StoreError> {
        edit.validate()?;
        let mut transaction = self.begin_write().await?;
        let mut writing =
            EditWriter::begin(&mut transaction, EventKind::Do, None, &edit.author, &edit.reason).await?;
        for change in &edit.changes {
            writing.change(change).await?;
        }
        let events = writing.events;
        let dropped = "UPDATE edits SET state = 'dropped' WHERE author = $1 AND state = 'undone'";
        sqlx::query(dropped).bind(&edit.author).execute(&mut *transaction).await?;
        sqlx::query("INSERT INTO edits (edit, author, state) VALUES ($1, $2, 'done')")
            .bind(signed(events.first().map_or(0, |event| event.edit)))
            .bind(&edit.author)
            .execute(&mut *transaction)
            .await?;
        self.announce(&mut transaction, watch::EVENT, events.last().map_or(0, |event| event.seq)).await?;
        transaction.commit().await?;
        Ok(events)
    }
}

impl<'a> EditWriter<'a> {
    pub(super) async fn begin(
        transaction: &'a mut Transaction<'static, Any>,
        kind: EventKind,
        target: Option<u64>,
        author: &'a str,
        reason: &'a str,
    ) -> Result<Self, StoreError> {
        let row =
            sqlx::query("SELECT coalesce(max(seq), 0) FROM events").fetch_one(&mut **transaction).await?;
        let edit = unsigned(&row, 0)? + 1;
        let events = Vec::new();
        Ok(Self { transaction, kind, target, author, reason, time: Timestamp::now(), edit, events })
    }

    pub(super) fn finish(self) -> Vec<Event> {
        self.events
    }

    async fn change(&mut self, change: &Change) -> Result<(), StoreError> {
        let id = change.id();
        let found = current(self.transaction, id).await?;
        let (expected, yours) = match change {
            Change::Create { item } => {
                if found.is_some() {
                    return Err(StoreError::Exists { id });
                }
                return self.push(id, 1, Some(item.as_ref().clone())).await;
            }
            Change::Update { item, version } => (*version, Some(item.as_ref())),
            Change::Delete { version, .. } => (*version, None),
        };
        let Some((version, now)) = found else { return Err(StoreError::NotFound { id }) };
        match now {
            Some(now) if version == expected => {
                if now.locked && !yours.is_some_and(|yours| only_unlocks(&now, yours)) {
                    return Err(StoreError::Locked { id });
                }
                self.push(id, version + 1, yours.cloned()).await
            }
            now => {
                let yours = yours.cloned().map(Box::new);
                Err(StoreError::Conflict { id, expected, current: versioned(version, now), yours })
            }
        }
    }

    /// Adds an event, and brings the item's newest state to it.
    pub(super) async fn push(
        &mut self,
        id: ItemId,
        version: u64,
        item: Option<Item>,
    ) -> Result<(), StoreError> {
        let content = item.as_ref().and_then(|item| item.geometry.as_ref()?.content().cloned());
        if let Some(content) = &content {
            self.expect_content(content).await?;
        }
        let seq = self.edit + self.events.len() as u64;
        let text = item.as_ref().map(item_text).transpose()?;
        let insert = "INSERT INTO events (seq, edit, kind, target, id, version, author, reason, time, item, content) \
            VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11)";
        sqlx::query(insert)
            .bind(signed(seq))
            .bind(signed(self.edit))
            .bind(kind_name(self.kind))
            .bind(self.target.map(signed))
            .bind(id.to_string())
            .bind(signed(version))
            .bind(self.author)
            .bind(self.reason)
            .bind(self.time.to_string())
            .bind(text.as_deref())
            .bind(content.as_ref().map(ContentId::as_str))
            .execute(&mut **self.transaction)
            .await?;
        let newest = "INSERT INTO items (id, version, seq, set_name, frame, item) VALUES ($1, $2, $3, $4, $5, $6) \
            ON CONFLICT (id) DO UPDATE SET version = excluded.version, seq = excluded.seq, \
            set_name = excluded.set_name, frame = excluded.frame, item = excluded.item";
        let frame = item.as_ref().and_then(|item| item.frame_of_reference.as_ref());
        sqlx::query(newest)
            .bind(id.to_string())
            .bind(signed(version))
            .bind(signed(seq))
            .bind(item.as_ref().map(|item| item.set.as_str()))
            .bind(frame.map(|frame| frame.0.as_str()))
            .bind(text.as_deref())
            .execute(&mut **self.transaction)
            .await?;
        let (edit, kind, target, time) = (self.edit, self.kind, self.target, self.time);
        let (author, reason) = (self.author.to_owned(), self.reason.to_owned());
        self.events.push(Event { seq, edit, kind, target, id, version, author, reason, time, item });
        Ok(())
    }

    async fn expect_content(&mut self, id: &ContentId) -> Result<(), StoreError> {
        let query = sqlx::query("SELECT count(*) FROM contents WHERE id = $1").bind(id.as_str());
        let found: i64 = query.fetch_one(&mut **self.transaction).await?.try_get(0)?;
        if found == 0 { Err(StoreError::Content { id: id.clone() }) } else { Ok(()) }
    }
}

/// Whether the lock comes off, and nothing else changes.
fn only_unlocks(now: &Item, wanted: &Item) -> bool {
    !wanted.locked && Item { locked: true, ..wanted.clone() } == *now
}
