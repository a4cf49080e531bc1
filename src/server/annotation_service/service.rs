//! [`Annotations`]: the store of a server, and its caches.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use axum::http::StatusCode;
use parking_lot::Mutex;
use tokio::sync::{MutexGuard, Notify, Semaphore, broadcast, watch};

use super::published::Published;
use super::shape_cache::ShapeCache;
use super::snapshots::Snapshots;
use crate::problem::Problem;
use relief_store::Store;

/// The right to publish, with the number of the last published event; `None` before the log was
/// read.
pub(super) type Turn<'a> = MutexGuard<'a, Option<u64>>;

/// Most events that a slow listener may lag behind; beyond, it has to read the whole state.
const BEHIND: usize = 256;

/// The annotations of a server.
pub(crate) struct Annotations {
    pub(crate) store: Store,
    pub(super) snapshots: Mutex<Snapshots>,
    pub(super) shapes: Arc<ShapeCache>,
    /// Held while a surface is computed.
    pub(crate) making: Arc<tokio::sync::Mutex<()>>,
    /// Permit to compute a structure.
    pub(crate) structures: Arc<Semaphore>,
    /// Edits are stored and published one after another, so events are published in the order of
    /// the log. See `follow`.
    pub(crate) turn: tokio::sync::Mutex<Option<u64>>,
    /// Notified when the log has events that could not be published yet.
    pub(crate) behind: Notify,
    pub(crate) published: broadcast::Sender<Arc<Published>>,
    /// Number of the last published event.
    pub(crate) newest: AtomicU64,
    /// Counts whatever changes pictures, sets included.
    pub(crate) changes: watch::Sender<u64>,
}

impl Annotations {
    pub(crate) fn new(store: Store) -> Self {
        Self {
            store,
            snapshots: Mutex::default(),
            shapes: Arc::default(),
            making: Arc::default(),
            structures: Arc::new(Semaphore::new(1)),
            turn: tokio::sync::Mutex::default(),
            behind: Notify::new(),
            published: broadcast::Sender::new(BEHIND),
            newest: AtomicU64::new(0),
            changes: watch::Sender::new(0),
        }
    }

    /// Receives the events that are published from now on.
    pub(crate) fn listen(&self) -> broadcast::Receiver<Arc<Published>> {
        self.published.subscribe()
    }

    /// Number of the last published event.
    pub(crate) fn newest(&self) -> u64 {
        self.newest.load(Ordering::Relaxed)
    }

    /// The number of changes since the start.
    pub(crate) fn changes(&self) -> u64 {
        *self.changes.borrow()
    }
}

/// The annotations of a server.
///
/// # Errors
/// 404 where it has none.
pub(crate) fn of(annotations: Option<&Arc<Annotations>>) -> Result<&Arc<Annotations>, Problem> {
    annotations.ok_or_else(|| {
        let detail = "this server keeps no annotations; start it with --annotations PLACE";
        Problem::new(StatusCode::NOT_FOUND, "annotations-off", detail)
    })
}
