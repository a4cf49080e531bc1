//! The log of annotations: an append-only table of events in SQLite or PostgreSQL, and the items
//! that follow from it.
//!
//! [`Store`] takes an [`Edit`](relief_annotation::Edit), makes all of its changes or none, and
//! answers when they are on disk. It undoes and redoes edits, author by author. It lists the items
//! that follow from the log, and keeps the contents (voxels, triangles), the sets and the templates
//! that items name. [`Watch`] reports changes by other connections. The store does not use HTTP,
//! voxels or files of other programs. Space and units are those of
//! [`annotation`](relief_annotation); the store does not interpret geometry.
//!
//! | table | holds | changes |
//! |---|---|---|
//! | `events` | every change ever made | grows at its end; triggers refuse all else |
//! | `items` | the newest state of each item: the log folded | with each event, in its transaction |
//! | `edits` | whether an edit stands, is taken back, or is past making again | likewise |
//! | `contents` | bytes by their SHA-256 | grows; triggers refuse all else |
//! | `sets`, `templates` | the newest text of each | with each line of `audit`, in its transaction |
//! | `audit` | every text of a set or template | grows at its end |
//! | `meta` | the number of this schema | when the schema changes |
//!
//! `undo` and `redo` are events too: the log never loses one. Each author has one history of edits.
//! Undo walks it backwards, redo forwards, and a new edit ends what could be redone. The opposite
//! of an undo is a redo, not another undo. Both restore whole states, with their locks, and only
//! where an item is still as the edit left it (or, for redo, as it was before). Otherwise another
//! author has changed it since, which is a [conflict](StoreError::Conflict). A change that its
//! author has undone is no conflict.

mod apply;
mod check;
mod contents;
mod error;
mod faults;
mod history;
#[cfg(feature = "postgres")]
mod listen;
mod log_file;
mod named;
mod place;
mod pools;
mod query;
mod rows;
mod schema;
mod watch;

use std::sync::Arc;
use std::time::Duration;

use sqlx::AnyPool;
use sqlx::any::AnyConnectOptions;
use sqlx::{Any, Transaction};
use tokio::time::timeout;

pub use check::Checked;
pub use error::{Cause, Damage, ForeignFile, LocationError, StoreError};
pub use faults::StoreFaults;
pub use named::{Audited, AuditedKind, NamedState, Permission};
pub use query::{Filter, Listing, LogFilter};
pub use watch::{Changed, Watch};

use error::ConnectionFault;
use log_file::LogFile;
use place::{DatabaseAddress, DatabaseKind};
use pools::{Current, PATIENCE, Pools, READERS};

/// The longest time that a database may take to begin a transaction.
const ANSWER: Duration = Duration::from_secs(5);
/// The longest time that closing waits for calls in progress.
const CLOSING: Duration = Duration::from_secs(5);

/// An open log. A clone is the same log; calls may come from many tasks at once.
#[derive(Clone)]
pub struct Store {
    kind: DatabaseKind,
    options: AnyConnectOptions,
    pools: Arc<Pools>,
    /// `None` where the log is no file.
    file: Option<Arc<LogFile>>,
}

impl std::fmt::Debug for Store {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Store({:?})", self.kind) // its address may have a password
    }
}

impl Store {
    /// Opens a log, or creates it where it does not exist.
    ///
    /// `place` is a file (`annotations.db`), `sqlite:FILE` with `?mode=ro` or `?immutable=1` where
    /// nothing must be written, or `postgres://USER@HOST/DATABASE`, where the tables are in a
    /// schema of the name `relief`.
    ///
    /// # Errors
    /// When it cannot be reached, is no log of Relief, is damaged, or was made by a newer version.
    pub async fn open(place: &str) -> Result<Self, StoreError> {
        Self::open_with(place, StoreFaults::default()).await
    }

    /// As [`Self::open`], with injected failures.
    ///
    /// # Errors
    /// Those of [`Self::open`].
    pub async fn open_with(place: &str, faults: StoreFaults) -> Result<Self, StoreError> {
        Self::open_place(&DatabaseAddress::parse(place, true)?, faults).await
    }

    /// Opens an existing log; creates none.
    ///
    /// # Errors
    /// Those of [`Self::open`], and when the log does not exist.
    pub async fn open_existing(place: &str) -> Result<Self, StoreError> {
        Self::open_place(&DatabaseAddress::parse(place, false)?, StoreFaults::default()).await
    }

    async fn open_place(place: &DatabaseAddress, faults: StoreFaults) -> Result<Self, StoreError> {
        let file = schema::prepare(place).await?.map(Arc::new);
        let (kind, options) = (place.kind, place.options.clone());
        let pools = Arc::new(Pools::new(kind, place.read_only, options.clone(), faults));
        Ok(Self { kind, options, pools, file })
    }

    /// Closes all connections, when the calls that are under way are done. A SQLite log is one file
    /// then, without a `-wal` file beside it. A store that is dropped without is as safe, and is
    /// tidied up when it is opened next. Connections that do not answer are not waited for.
    pub async fn close(&self) {
        let Current { read, write, .. } = self.pools.current();
        let _ = timeout(CLOSING, async {
            read.close().await;
            write.close().await;
        })
        .await;
    }

    /// The connections that read.
    fn read(&self) -> AnyPool {
        self.pools.current().read
    }

    /// A transaction that changes something: no other connection writes until it ends.
    async fn begin_write(&self) -> Result<Transaction<'static, Any>, StoreError> {
        if self.file.as_ref().is_some_and(|file| !file.is_there()) {
            return Err(StoreError::FileGone);
        }
        let statement = match self.kind {
            DatabaseKind::Sqlite => "BEGIN IMMEDIATE",
            DatabaseKind::Postgres => "BEGIN",
        };
        let mut transaction = self.begin(|current| &current.write, statement).await?;
        if self.kind == DatabaseKind::Postgres {
            sqlx::query("LOCK TABLE events IN EXCLUSIVE MODE").execute(&mut *transaction).await?;
        }
        let delay = self.pools.faults().delay;
        if !delay.is_zero() {
            tokio::time::sleep(delay).await; // even a wait of zero takes up to a millisecond
        }
        Ok(transaction)
    }

    /// A transaction that sees one moment of the log.
    async fn begin_read(&self) -> Result<Transaction<'static, Any>, StoreError> {
        let statement = match self.kind {
            DatabaseKind::Sqlite => "BEGIN DEFERRED",
            DatabaseKind::Postgres => "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY",
        };
        self.begin(|current| &current.read, statement).await
    }

    /// Begins a transaction. A database server that does not answer is given up, and the next call
    /// reconnects.
    async fn begin(
        &self,
        pool: fn(&Current) -> &AnyPool,
        statement: &'static str,
    ) -> Result<Transaction<'static, Any>, StoreError> {
        let current = self.pools.current();
        let begun = timeout(PATIENCE + ANSWER, begin(pool(&current), statement)).await;
        let is_silent = matches!(begun, Err(_) | Ok(Err(StoreError::Busy)));
        if self.kind == DatabaseKind::Postgres && is_silent {
            self.pools.renew(&current);
        }
        begun.map_err(|_| ConnectionFault::Silent(PATIENCE))?
    }
}

/// Begins a transaction.
///
/// Where a disk fails, SQLite ends a transaction by itself, and the connection's counter of
/// transactions does not notice: such a connection is given up, and another one does as well as the
/// disk does by then.
async fn begin(pool: &AnyPool, statement: &'static str) -> Result<Transaction<'static, Any>, StoreError> {
    for _ in 0..=READERS {
        match pool.begin_with(statement).await {
            Err(sqlx::Error::InvalidSavePointStatement | sqlx::Error::BeginFailed) => {
                // The connection cannot be used again; the result of closing it does not matter.
                let _ = pool.acquire().await?.close().await;
            }
            begun => return Ok(begun?),
        }
    }
    Err(ConnectionFault::Broken.into())
}

#[cfg(test)]
mod tests {
    use sqlx::{Executor, Row};

    use super::*;

    /// Invariant: An acknowledged edit is durable, and no edit is stored partially, whenever the
    /// process is killed.
    ///
    /// The settings that make a commit durable hold on every connection of both pools, and whatever
    /// the file's own settings were.
    #[tokio::test]
    async fn every_connection_waits_for_the_disk() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("a.db");
        let place = place.to_str().unwrap();
        Store::open(place).await.unwrap().close().await;
        let store = Store::open(place).await.unwrap();
        store
            .pools
            .current()
            .write
            .acquire()
            .await
            .unwrap()
            .execute("PRAGMA journal_mode = DELETE")
            .await
            .unwrap();
        store.close().await;
        let store = Store::open(place).await.unwrap();
        let mut held = vec![store.pools.current().write.acquire().await.unwrap()];
        for _ in 0..READERS {
            held.push(store.read().acquire().await.unwrap());
        }
        for connection in &mut held {
            let mut found = Vec::new();
            for pragma in ["synchronous", "foreign_keys", "recursive_triggers", "fullfsync", "busy_timeout"] {
                let query = sqlx::query(sqlx::AssertSqlSafe(format!("PRAGMA {pragma}")));
                found.push(query.fetch_one(&mut **connection).await.unwrap().get::<i64, _>(0));
            }
            assert_eq!(found, [2, 1, 1, 1, 30_000], "synchronous 2 is FULL");
            let mode = connection.fetch_one("PRAGMA journal_mode").await.unwrap();
            assert_eq!(mode.get::<String, _>(0), "wal");
        }
        assert_eq!(held.len(), 5);
    }
}
