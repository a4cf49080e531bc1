//! Errors of a log. A message names an item only by its id.

use std::error::Error;
use std::time::Duration;

use relief_annotation::{ContentId, Item, ItemId, Versioned};
use relief_base::OutOfRange;

/// The error of a database or of its driver.
pub type Cause = Box<dyn Error + Send + Sync>;

/// A connection that gave no answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum ConnectionFault {
    #[error("no answer within {} s", .0.as_secs())]
    Silent(Duration),
    #[error("its connections are broken")]
    Broken,
    #[cfg(feature = "postgres")]
    #[error("the connection that listens was lost")]
    ListenerLost,
    #[cfg(feature = "postgres")]
    #[error("the connection that listens is silent")]
    ListenerSilent,
}

impl From<ConnectionFault> for StoreError {
    fn from(fault: ConnectionFault) -> Self {
        Self::Unreachable(fault.into())
    }
}

/// The reason why the store refused or failed. Nothing was changed, except after
/// [`StoreError::Unreachable`] and [`StoreError::Database`], where the change may or may not have
/// been made.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// Another author has changed the item since this author read it.
    #[error("item {id} {}; look at it again, and change that", changed(*.expected, .current.as_deref()))]
    Conflict {
        /// The item.
        id: ItemId,
        /// The version that the author saw, or for undo and redo the last one that the author made.
        expected: u64,
        /// The current version; `None` when it was deleted.
        current: Option<Box<Versioned>>,
        /// The author's version; `None` where the author wanted to delete it.
        yours: Option<Box<Item>>,
    },
    /// The item is locked: its lock comes off first, by itself.
    #[error("item {id} is locked; unlock it in an edit of its own first")]
    Locked {
        /// The item.
        id: ItemId,
    },
    /// There is no such item, and never was.
    #[error("no item has the id {id}")]
    NotFound {
        /// The missing one.
        id: ItemId,
    },
    /// A new item has an id that was used before.
    #[error("the id {id} was used before; ids are never reused, so give the new item another one")]
    Exists {
        /// The item.
        id: ItemId,
    },
    /// A content is not in the log.
    #[error("content {} does not exist; store it before an item refers to it", .id.as_str())]
    Content {
        /// Its id.
        id: ContentId,
    },
    /// There is no such template.
    #[error("no template is named {name:?}")]
    NoTemplate {
        /// The missing one.
        name: String,
    },
    /// A value of an edit or a set is out of its range.
    #[error(transparent)]
    Invalid(#[from] OutOfRange),
    /// The author has no edit that could be taken back.
    #[error("this author has no edit left to undo")]
    NothingToUndo,
    /// The author has no edit that could be made again.
    #[error("this author has no edit to redo; a new edit discards the edits that were undone before it")]
    NothingToRedo,
    /// The log was made by a newer version of Relief.
    #[error("the log has schema {found}, and this version of relief knows up to {known}; use a newer one")]
    Schema {
        /// The schema's number.
        found: u64,
        /// The newest that is known here.
        known: u64,
    },
    /// The place of the log is written wrongly.
    #[error(
        "invalid location of a log: {0}; expected a file path, sqlite:FILE or postgres://USER@HOST/DATABASE"
    )]
    Place(#[from] LocationError),
    /// The file is something else.
    #[error("this is not a log of Relief: {0}")]
    Foreign(ForeignFile),
    /// The log exists, and its content is inconsistent.
    #[error("the log is damaged: {0}; keep this file and continue with a backup")]
    Damaged(#[from] Damage),
    /// The author does not own the set or template.
    #[error("{name:?} has another owner")]
    NotOwner {
        /// Its name.
        name: String,
    },
    /// A set or template is not what its editor saw.
    #[error("{name:?} was changed meanwhile; read it again")]
    Replaced {
        /// Its name.
        name: String,
    },
    /// Nothing may be written there.
    #[error("the log is read-only: the file or its folder is write-protected, or ?mode=ro was given")]
    ReadOnly,
    /// Others have been writing for too long.
    #[error("the log was locked by other writers for 30 seconds; try again")]
    Busy,
    /// No room.
    #[error("cannot write the log: the disk is full")]
    Full,
    /// It cannot be opened, or the connection broke.
    #[error("cannot reach the log: {0}")]
    Unreachable(Cause),
    /// The file of the log was moved, removed or replaced since it was opened.
    #[error("the file of the log was moved or replaced: put it back, or restart the program")]
    FileGone,
    /// The connection cannot be encrypted.
    #[error(
        "the connection to the log cannot be encrypted: {0}; for a database without TLS in a trusted network, add ?sslmode=disable to its address"
    )]
    Unencrypted(Cause),
    /// Something else that the database says.
    #[error("the database refused: {0}")]
    Database(Cause),
}

/// Why a text is not the location of a log.
#[derive(Debug, thiserror::Error)]
pub enum LocationError {
    /// An unknown option after the question mark.
    #[error("what follows ? is not mode=ro, mode=rw, mode=rwc or immutable=1")]
    Mode,
    /// A SQLite address without a file.
    #[error("it names no file; a log in memory would be lost")]
    NoFile,
    /// A URL of another kind.
    #[error("only sqlite: and postgres:// are known")]
    Scheme,
    /// A PostgreSQL address, in a build without its driver.
    #[error("this build has no PostgreSQL: build relief with --features postgres")]
    NoPostgres,
    /// Nothing.
    #[error("it is empty")]
    Empty,
    /// A path that a URL cannot hold.
    #[error("the path is not UTF-8")]
    NotUtf8,
    /// A path that cannot be made absolute.
    #[error(transparent)]
    Path(#[from] std::io::Error),
    /// A URL that the database driver refuses.
    #[error("{0}")]
    Url(#[source] sqlx::Error),
}

/// Why the content of a log is invalid. Messages contain no values of items.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Damage {
    /// The database reports damage, or a value of the wrong type.
    #[error("{finding}")]
    Database {
        /// The message of the database.
        finding: String,
    },
    /// An event contradicts the events before it.
    #[error("event {seq} {fault}")]
    Event {
        /// The number of the event.
        seq: u64,
        /// The contradiction.
        fault: &'static str,
    },
    /// A column of an event cannot be read.
    #[error("event {seq} has no readable {column}")]
    Column {
        /// The number of the event.
        seq: u64,
        /// The column.
        column: &'static str,
    },
    /// An undo or redo of an edit in the wrong state.
    #[error("event {seq} is of an edit that was not {expected}")]
    Step {
        /// The number of the event.
        seq: u64,
        /// The state that the edit should have: done or undone.
        expected: &'static str,
    },
    /// An item differs from its last event.
    #[error("an item is not as event {seq} left it")]
    Item {
        /// The number of the event.
        seq: u64,
    },
    /// Items of the events are missing.
    #[error("items missing: {count}")]
    MissingItems {
        /// Their number.
        count: usize,
    },
    /// The state of an edit differs from the events.
    #[error("edit {edit} is not as the log has it")]
    Edit {
        /// The number of the edit.
        edit: u64,
    },
    /// Edits of the events are missing.
    #[error("edits missing: {count}")]
    MissingEdits {
        /// Their number.
        count: usize,
    },
    /// The bytes of a content do not have its SHA-256.
    #[error("content {id} has other bytes")]
    Content {
        /// The SHA-256 that is its name.
        id: String,
    },
    /// An item has events, and no current state.
    #[error("item {id} has events and no state")]
    NoState {
        /// The item.
        id: ItemId,
    },
    /// The text of an item is not an item.
    #[error("an item cannot be read from column {column} of its text on")]
    ItemText {
        /// The position in the text.
        column: usize,
    },
    /// The text of an item has no version before it.
    #[error("an item has no version")]
    NoVersion,
    /// The text of a set is not a set.
    #[error("a set cannot be read from column {column} of its text on")]
    SetText {
        /// The position in the text.
        column: usize,
    },
    /// A line of the audit has no time.
    #[error("line {seq} of audit has no time")]
    AuditTime {
        /// The number of the line.
        seq: u64,
    },
    /// A number that cannot be negative is.
    #[error("a number is {found}")]
    Number {
        /// The number.
        found: i64,
    },
    /// The number of the schema is missing.
    #[error("it has no schema number")]
    NoSchema,
}

/// Why a database is not a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ForeignFile {
    /// A file of another format.
    #[error("it is not a database of SQLite")]
    NoSqlite,
    /// A file without content.
    #[error("the file is empty")]
    Empty,
    /// A SQLite database of another program.
    #[error("the SQLite database belongs to another program")]
    Sqlite,
    /// A PostgreSQL schema `relief` of another program.
    #[error("its schema relief belongs to another program")]
    Schema,
}

fn changed(expected: u64, current: Option<&Versioned>) -> String {
    current.map_or_else(
        || format!("is gone; you saw version {expected}"),
        |current| format!("has version {} by now; you saw {expected}", current.version),
    )
}

/// Primary result codes of SQLite (<https://www.sqlite.org/rescode.html>); an extended code has one
/// in its low byte.
mod sqlite {
    pub(super) const BUSY: u32 = 5;
    pub(super) const LOCKED: u32 = 6;
    pub(super) const READONLY: u32 = 8;
    pub(super) const IOERR: u32 = 10;
    pub(super) const CORRUPT: u32 = 11;
    pub(super) const FULL: u32 = 13;
    pub(super) const CANTOPEN: u32 = 14;
    pub(super) const NOTADB: u32 = 26;
}

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        match error {
            sqlx::Error::Database(found) => {
                let code = found.code().unwrap_or_default();
                // A code of PostgreSQL has five letters and digits.
                let code = if code.len() == 5 { None } else { code.parse::<u32>().ok() };
                let protected = found.code().is_some_and(|code| code == "25006");
                let busy = found.code().is_some_and(|code| matches!(&*code, "55P03" | "57014" | "40P01"));
                let full = found.code().is_some_and(|code| matches!(&*code, "53100"));
                match code.map(|code| code & 0xff) {
                    Some(sqlite::BUSY | sqlite::LOCKED) => Self::Busy,
                    Some(sqlite::READONLY) => Self::ReadOnly,
                    Some(sqlite::FULL) => Self::Full,
                    Some(sqlite::CORRUPT) => Damage::Database { finding: found.message().to_owned() }.into(),
                    Some(sqlite::NOTADB) => Self::Foreign(ForeignFile::NoSqlite),
                    Some(sqlite::CANTOPEN | sqlite::IOERR) => Self::Unreachable(found.into()),
                    None if protected => Self::ReadOnly,
                    None if busy => Self::Busy,
                    None if full => Self::Full,
                    _ => Self::Database(found.into()),
                }
            }
            sqlx::Error::PoolTimedOut => Self::Busy,
            sqlx::Error::Tls(_) => Self::Unencrypted(error.into()),
            sqlx::Error::Io(_) | sqlx::Error::PoolClosed | sqlx::Error::WorkerCrashed => {
                Self::Unreachable(error.into())
            }
            sqlx::Error::ColumnDecode { .. } | sqlx::Error::Decode(_) | sqlx::Error::ColumnNotFound(_) => {
                Damage::Database { finding: error.to_string() }.into()
            }
            _ => Self::Database(error.into()),
        }
    }
}
