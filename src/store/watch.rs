//! Notifications of changes that other connections make to the log.
//!
//! [`Watch`] reports that the log may have changed. A reader then reads the log after the last
//! event that it has seen, so a lost, repeated or late notification does no harm. It reads no
//! events itself.
//!
//! - **PostgreSQL** notifies: a writer sends `NOTIFY` in the transaction of the events, so
//!   listeners hear it when that is committed, and never after a rollback. A notification contains
//!   only a number. Listening takes a connection of its own, which is probed at times, since a
//!   network may lose it silently.
//! - **SQLite** is polled: `PRAGMA data_version` changes when another connection has committed.

use std::time::Duration;

use sqlx::any::AnyConnectOptions;
use sqlx::{Any, AnyConnection, AssertSqlSafe, ConnectOptions, Executor, Transaction};
use tokio::time::sleep;

use super::Store;
use super::error::StoreError;
#[cfg(feature = "postgres")]
use super::listen::Listener;
use super::place::DatabaseKind;
use super::schema::number;

/// The channel of PostgreSQL.
const CHANNEL: &str = "relief_log";
/// The words of notifications about events, and about sets and templates.
pub(super) const EVENT: &str = "event";
pub(super) const AUDIT: &str = "audit";
/// The time between two queries of SQLite: a person sees a change within a quarter of a second as
/// one that comes at once.
const ASKING: Duration = Duration::from_millis(250);

/// The part of the log that may have changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Changed {
    /// There are events; sets and templates are as they were, but for sets that the events name.
    Events,
    /// Anything.
    Anything,
}

/// See the module.
pub struct Watch {
    kind: DatabaseKind,
    options: AnyConnectOptions,
    source: Option<Source>,
}

enum Source {
    #[cfg(feature = "postgres")]
    Postgres(Listener),
    /// A connection that only polls, and the last answer.
    Sqlite(AnyConnection, i64),
}

impl std::fmt::Debug for Watch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Watch({:?})", self.kind) // its address may have a password
    }
}

impl Store {
    /// Hears of changes from the first call of [`Watch::changed`] on.
    #[must_use]
    pub fn watch(&self) -> Watch {
        Watch { kind: self.kind, options: self.options.clone(), source: None }
    }

    /// Notifies all listeners when the transaction is committed.
    pub(super) async fn announce(
        &self,
        transaction: &mut Transaction<'static, Any>,
        what: &'static str,
        seq: u64,
    ) -> Result<(), StoreError> {
        if self.kind == DatabaseKind::Postgres {
            let notify = AssertSqlSafe(format!("NOTIFY {CHANNEL}, '{what} {seq}'"));
            (&mut **transaction).execute(notify).await?;
        }
        Ok(())
    }
}

impl Watch {
    /// Waits until the log may have changed since the last call. The first call, and the first one
    /// after an error, returns as soon as changes can be heard of: whatever came before is in the
    /// log by then.
    ///
    /// A call that is dropped before it is done loses nothing.
    ///
    /// # Errors
    /// When the connection cannot be made, or broke. The next call makes another one.
    pub async fn changed(&mut self) -> Result<Changed, StoreError> {
        let Some(source) = &mut self.source else {
            self.source = Some(Source::open(self.kind, &self.options).await?);
            return Ok(Changed::Anything);
        };
        let heard = match source {
            #[cfg(feature = "postgres")]
            Source::Postgres(listener) => heard(listener).await,
            Source::Sqlite(connection, version) => asked(connection, version).await,
        };
        if heard.is_err() {
            self.source = None;
        }
        heard
    }
}

impl Source {
    async fn open(kind: DatabaseKind, options: &AnyConnectOptions) -> Result<Self, StoreError> {
        match kind {
            DatabaseKind::Sqlite => {
                let mut connection = options.connect().await?;
                let version = version(&mut connection).await?;
                Ok(Self::Sqlite(connection, version))
            }
            #[cfg(feature = "postgres")]
            DatabaseKind::Postgres => Ok(Self::Postgres(Listener::open(options, CHANNEL).await?)),
            #[cfg(not(feature = "postgres"))]
            DatabaseKind::Postgres => Err(super::error::LocationError::NoPostgres.into()),
        }
    }
}

#[cfg(feature = "postgres")]
async fn heard(listener: &mut Listener) -> Result<Changed, StoreError> {
    // One look at the log is for all that came together.
    let words = listener.words().await?;
    let only_events = words.iter().all(|word| word.starts_with(EVENT));
    Ok(if only_events { Changed::Events } else { Changed::Anything })
}

async fn asked(connection: &mut AnyConnection, known: &mut i64) -> Result<Changed, StoreError> {
    loop {
        sleep(ASKING).await;
        let version = version(connection).await?;
        if std::mem::replace(known, version) != version {
            return Ok(Changed::Anything);
        }
    }
}

async fn version(connection: &mut AnyConnection) -> Result<i64, StoreError> {
    number(connection, "PRAGMA data_version").await
}
