//! Queries for items and events.

use rayon::prelude::*;
use sqlx::any::AnyRow;
use sqlx::{Any, Row, Transaction};

use super::Store;
use super::error::{Damage, StoreError};
use super::rows::{EVENT, event, item, signed, unsigned};
use relief_annotation::{Event, FrameOfReference, Item, ItemId, Versioned};

/// A filter of items: those that meet every given condition.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Filter {
    /// Of one of these sets.
    pub sets: Option<Vec<String>>,
    /// The value of the comparison.
    pub frame_of_reference: Option<FrameOfReference>,
    /// Changed by an event after this one.
    pub after_seq: u64,
}

/// Items at one moment of the log.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Listing {
    /// The number of the last event at that time; 0 for an empty log.
    pub seq: u64,
    /// By set, list, order, creation and id.
    pub items: Vec<Versioned>,
}

/// A filter of events: those that meet every given condition.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LogFilter {
    /// Later than this one.
    pub after: u64,
    /// Maximum number of events; the first ones are returned.
    pub limit: Option<u64>,
    /// By this author.
    pub author: Option<String>,
    /// Of this item.
    pub item: Option<ItemId>,
}

/// A statement with one condition for each value that is bound.
struct Conditions {
    statement: String,
    values: Vec<Value>,
}

enum Value {
    Number(i64),
    Text(String),
}

impl Conditions {
    fn new(statement: String) -> Self {
        Self { statement, values: Vec::new() }
    }

    /// `condition` with a placeholder in the place of `?`.
    fn and(&mut self, condition: &str, value: Value) {
        self.values.push(value);
        let condition = condition.replace('?', &format!("${}", self.values.len()));
        self.statement += &format!(" AND {condition}");
    }

    async fn fetch_one(self, transaction: &mut Transaction<'_, Any>) -> Result<AnyRow, StoreError> {
        self.fetch(transaction).await?.pop().ok_or_else(|| sqlx::Error::RowNotFound.into())
    }

    async fn fetch(self, transaction: &mut Transaction<'_, Any>) -> Result<Vec<AnyRow>, sqlx::Error> {
        // The text is constant; values from callers are bound.
        let mut query = sqlx::query(sqlx::AssertSqlSafe(self.statement));
        for value in self.values {
            query = match value {
                Value::Number(number) => query.bind(number),
                Value::Text(text) => query.bind(text),
            };
        }
        query.fetch_all(&mut **transaction).await
    }
}

impl Store {
    /// The number of the log's last event; 0 for an empty log.
    ///
    /// # Errors
    /// Errors of the database.
    pub async fn seq(&self) -> Result<u64, StoreError> {
        last(&mut self.begin_read().await?).await
    }

    /// Items as they are now.
    ///
    /// # Errors
    /// Errors of the database.
    pub async fn list(&self, filter: &Filter) -> Result<Listing, StoreError> {
        let mut transaction = self.begin_read().await?;
        let seq = last(&mut transaction).await?;
        let (mut parts, mut after) = (Vec::new(), filter.after_seq);
        loop {
            let row = part(filter, after).fetch_one(&mut transaction).await?;
            after = unsigned(&row, 0)?;
            parts.extend(row.try_get::<Option<String>, _>(2)?);
            if unsigned(&row, 1)? < PART {
                break;
            }
        }
        transaction.commit().await?;
        let lines: Vec<&str> = parts.iter().flat_map(|part| part.split(LINE)).collect();
        let mut items: Vec<Versioned> =
            lines.into_par_iter().with_min_len(FEWEST).map(read).collect::<Result<_, _>>()?;
        if let Some(sets) = &filter.sets {
            items.retain(|found| sets.contains(&found.item.set));
        }
        items.sort_by(|a, b| place(&a.item).cmp(&place(&b.item)));
        Ok(Listing { seq, items })
    }

    /// One item as it is now.
    ///
    /// # Errors
    /// [`StoreError::NotFound`] when the item does not exist or was deleted, and errors of
    /// the database.
    pub async fn item(&self, id: ItemId) -> Result<Versioned, StoreError> {
        let mut transaction = self.begin_read().await?;
        match super::rows::current(&mut transaction, id).await? {
            Some((version, Some(item))) => Ok(Versioned { version, item }),
            _ => Err(StoreError::NotFound { id }),
        }
    }

    /// Events, the oldest first.
    ///
    /// # Errors
    /// Errors of the database.
    pub async fn log(&self, filter: &LogFilter) -> Result<Vec<Event>, StoreError> {
        let mut conditions = Conditions::new(format!("SELECT {EVENT} FROM events WHERE seq > 0"));
        if filter.after > 0 {
            conditions.and("seq > ?", Value::Number(signed(filter.after)));
        }
        if let Some(author) = &filter.author {
            conditions.and("author = ?", Value::Text(author.clone()));
        }
        if let Some(item) = filter.item {
            conditions.and("id = ?", Value::Text(item.to_string()));
        }
        conditions.statement += " ORDER BY seq";
        if let Some(limit) = filter.limit {
            conditions.statement += &format!(" LIMIT {}", signed(limit));
        }
        let mut transaction = self.begin_read().await?;
        let rows = conditions.fetch(&mut transaction).await?;
        transaction.commit().await?;
        rows.iter().map(event).collect()
    }
}

/// Items that the database returns as one text, a line each, because rows are slower. The longest
/// items, of 10,000 points each, make a text of 600 MB, which is within the limits of the
/// databases.
const PART: u64 = 1000;

/// Fewer items are read by the thread that asks, which would wait for others longer than it reads.
const FEWEST: usize = 256;

/// Between lines; JSON on one line has none.
const LINE: char = '\n';

/// The statement for the next items of a listing, by the log: the place of the last one, how many
/// there are, and their lines.
fn part(filter: &Filter, after: u64) -> Conditions {
    let lines = format!("coalesce(max(seq), 0), count(*), string_agg(version || ' ' || item, '{LINE}')");
    let items = "SELECT seq, version, item FROM items WHERE item IS NOT NULL";
    let mut conditions = Conditions::new(format!("SELECT {lines} FROM ({items}"));
    conditions.and("seq > ?", Value::Number(signed(after)));
    if let Some(frame) = &filter.frame_of_reference {
        conditions.and("frame = ?", Value::Text(frame.0.clone()));
    }
    conditions.statement += &format!(" ORDER BY seq LIMIT {PART}) AS part");
    conditions
}

/// Reads a line of an item: its version and its text.
fn read(line: &str) -> Result<Versioned, StoreError> {
    let read = line.split_once(' ').and_then(|(version, text)| Some((version.parse().ok()?, text)));
    let (version, text) = read.ok_or(Damage::NoVersion)?;
    Ok(Versioned { version, item: item(text)? })
}

/// The order of a listing.
fn place(item: &Item) -> impl Ord + '_ {
    (item.set.as_str(), item.list.as_str(), item.order, item.created, item.id)
}

async fn last(transaction: &mut Transaction<'_, Any>) -> Result<u64, StoreError> {
    let row = sqlx::query("SELECT coalesce(max(seq), 0) FROM events").fetch_one(&mut **transaction).await?;
    unsigned(&row, 0)
}
