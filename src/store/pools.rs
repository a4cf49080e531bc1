//! The connections of a log: one that writes, some that read. They are recreated when a database
//! stops answering.
//!
//! A network may drop a connection silently: a query on it waits until TCP gives up,
//! a quarter of an hour. Its pool would have no connection left meanwhile.

use std::time::Duration;

use parking_lot::Mutex;
use sqlx::AnyPool;
use sqlx::any::{AnyConnectOptions, AnyPoolOptions};

use super::faults::StoreFaults;
use super::place::DatabaseKind;
use super::schema;

/// Connections that read at a time.
pub(super) const READERS: u32 = 4;
/// The longest time that a change waits for others, and a connection for a free place.
pub(super) const PATIENCE: Duration = Duration::from_secs(30);

/// The connections of a log, and how to make them.
pub(super) struct Pools {
    kind: DatabaseKind,
    read_only: bool,
    options: AnyConnectOptions,
    faults: StoreFaults,
    current: Mutex<Current>,
}

/// Connections that belong together.
#[derive(Clone)]
pub(super) struct Current {
    /// Counts renewals.
    generation: u64,
    pub(super) write: AnyPool,
    pub(super) read: AnyPool,
}

impl Pools {
    pub(super) fn new(
        kind: DatabaseKind,
        read_only: bool,
        options: AnyConnectOptions,
        faults: StoreFaults,
    ) -> Self {
        let [write, read] =
            [1, READERS].map(|connections| pool(kind, read_only, faults, &options, connections));
        let current = Mutex::new(Current { generation: 0, write, read });
        Self { kind, read_only, options, faults, current }
    }

    /// The failures that are brought about.
    pub(super) fn faults(&self) -> StoreFaults {
        self.faults
    }

    pub(super) fn current(&self) -> Current {
        self.current.lock().clone()
    }

    /// Gives up connections that do not answer, unless that was done already.
    pub(super) fn renew(&self, broken: &Current) {
        let mut current = self.current.lock();
        if current.generation != broken.generation {
            return;
        }
        let made = |connections| pool(self.kind, self.read_only, self.faults, &self.options, connections);
        let next = Current { generation: broken.generation + 1, write: made(1), read: made(READERS) };
        *current = next;
    }
}

fn pool(
    kind: DatabaseKind,
    read_only: bool,
    faults: StoreFaults,
    options: &AnyConnectOptions,
    connections: u32,
) -> AnyPool {
    AnyPoolOptions::new()
        .max_connections(connections)
        .acquire_timeout(PATIENCE)
        .after_connect(move |connection, _| Box::pin(schema::settle(connection, kind, read_only, faults)))
        .connect_lazy_with(options.clone())
}
