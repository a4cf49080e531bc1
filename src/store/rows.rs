//! Lines of the tables as values, and the other way.

use sqlx::any::AnyRow;
use sqlx::{Any, Row, Transaction};

use super::error::{Damage, StoreError};
use relief_annotation::{Event, EventKind, Item, ItemId, Versioned};

/// All columns of an event, in the order in which [`event`] reads them.
pub(super) const EVENT: &str = "seq, edit, kind, target, id, version, author, reason, time, item";

/// A number that the database keeps with a sign.
pub(super) fn signed(number: u64) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}

/// A number that never is below zero.
pub(super) fn unsigned(row: &AnyRow, column: usize) -> Result<u64, StoreError> {
    let number: i64 = row.try_get(column)?;
    u64::try_from(number).map_err(|_| Damage::Number { found: number }.into())
}

pub(super) const fn kind_name(kind: EventKind) -> &'static str {
    match kind {
        EventKind::Do => "do",
        EventKind::Undo => "undo",
        EventKind::Redo => "redo",
    }
}

/// Reads a line of [`EVENT`].
pub(super) fn event(row: &AnyRow) -> Result<Event, StoreError> {
    let seq = unsigned(row, 0)?;
    let odd = |column| StoreError::from(Damage::Column { seq, column });
    let kind = match row.try_get::<String, _>(2)?.as_str() {
        "do" => EventKind::Do,
        "undo" => EventKind::Undo,
        "redo" => EventKind::Redo,
        _ => return Err(odd("kind")),
    };
    let target: Option<i64> = row.try_get(3)?;
    let text: Option<String> = row.try_get(9)?;
    Ok(Event {
        seq,
        edit: unsigned(row, 1)?,
        kind,
        target: target.map(u64::try_from).transpose().map_err(|_| odd("target"))?,
        id: row.try_get::<String, _>(4)?.parse().map_err(|_| odd("id"))?,
        version: unsigned(row, 5)?,
        author: row.try_get(6)?,
        reason: row.try_get(7)?,
        time: row.try_get::<String, _>(8)?.parse().map_err(|_| odd("time"))?,
        item: text.as_deref().map(item).transpose()?,
    })
}

/// Reads the text of an item. Its values are in no message.
pub(super) fn item(text: &str) -> Result<Item, StoreError> {
    serde_json::from_str(text).map_err(|error| Damage::ItemText { column: error.column() }.into())
}

pub(super) fn item_text(item: &Item) -> Result<String, StoreError> {
    serde_json::to_string(item).map_err(|error| StoreError::Database(error.into()))
}

/// The newest state of an item: `None` where there never was one, and `Some` of its version and no
/// item where it is gone.
pub(super) async fn current(
    transaction: &mut Transaction<'_, Any>,
    id: ItemId,
) -> Result<Option<(u64, Option<Item>)>, StoreError> {
    let query = sqlx::query("SELECT version, item FROM items WHERE id = $1").bind(id.to_string());
    let Some(row) = query.fetch_optional(&mut **transaction).await? else { return Ok(None) };
    let text: Option<String> = row.try_get(1)?;
    Ok(Some((unsigned(&row, 0)?, text.as_deref().map(item).transpose()?)))
}

/// The same, as shown to people.
pub(super) fn versioned(version: u64, item: Option<Item>) -> Option<Box<Versioned>> {
    item.map(|item| Box::new(Versioned { version, item }))
}
