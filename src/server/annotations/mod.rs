//! Annotations over HTTP: items of a volume, their log, sets, templates and files.
//!
//! What it is: [`Annotations`], the store of a server with a snapshot of each volume, and the
//! routes under `/v1/volumes/{id}/annotations`. What it is not: storage (see `relief_store`), file
//! formats (see `relief_exchange`) or drawing (see `relief_session`).
//!
//! An author is a name that a request states: there is no authentication, and a blinded set relies
//! on readers who use their own names. A frame of reference is a UID, which leads to a patient: no
//! answer, log line or error contains it. A request about a volume affects only items of its frame
//! of reference. Patient mm.

mod apply;
mod asked;
mod author;
mod drawing;
mod edit;
mod files;
mod follow;
mod item;
mod list;
mod log;
mod order;
mod outward;
mod refusal;
mod sets;
mod shapes;
mod snap;
mod snapshot;
mod structures;
mod templates;
mod visible;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use axum::Router;
use axum::http::{StatusCode, Uri};
use axum::routing::{get, post};
use tokio::sync::{Notify, Semaphore, broadcast, watch};

use self::asked::{EditRequest, JsonBody};
use self::shapes::ShapeCache;
use self::snapshot::Snapshots;
use super::problem::Problem;
use super::state::AppState;
use relief_store::Store;

pub(super) use apply::{HistoryStep, Home, Published};
pub(super) use author::{author_of, missing as missing_author};
pub(super) use drawing::draw;
pub(super) use outward::outward_event;
pub(super) use snapshot::Snapshot;
pub(super) use visible::Visible;

/// Most events that a slow listener may lag behind; beyond, it has to read the whole state.
const BEHIND: usize = 256;

/// The annotations of a server.
pub(crate) struct Annotations {
    store: Store,
    snapshots: Mutex<Snapshots>,
    shapes: ShapeCache,
    /// Held while a surface is computed.
    making: tokio::sync::Mutex<()>,
    /// Permit to compute a structure.
    structures: Arc<Semaphore>,
    /// Edits are stored and published one after another, so events are published in the order of
    /// the log. See `follow`.
    turn: tokio::sync::Mutex<Option<u64>>,
    /// Notified when the log has events that could not be published yet.
    behind: Notify,
    told: broadcast::Sender<Arc<Published>>,
    /// Number of the last published event.
    newest: AtomicU64,
    /// Counts whatever changes pictures, sets included.
    changes: watch::Sender<u64>,
}

impl Annotations {
    pub(super) fn new(store: Store) -> Self {
        Self {
            store,
            snapshots: Mutex::default(),
            shapes: ShapeCache::default(),
            making: tokio::sync::Mutex::default(),
            structures: Arc::new(Semaphore::new(1)),
            turn: tokio::sync::Mutex::default(),
            behind: Notify::new(),
            told: broadcast::Sender::new(BEHIND),
            newest: AtomicU64::new(0),
            changes: watch::Sender::new(0),
        }
    }

    /// Receives the events that are published from now on.
    pub(super) fn listen(&self) -> broadcast::Receiver<Arc<Published>> {
        self.told.subscribe()
    }

    /// Number of the last published event.
    pub(super) fn newest(&self) -> u64 {
        self.newest.load(Ordering::Relaxed)
    }

    /// How often anything has changed.
    pub(super) fn changes(&self) -> u64 {
        *self.changes.borrow()
    }
}

/// The annotations of a server.
///
/// # Errors
/// 404 where it has none.
pub(super) fn of(annotations: Option<&Arc<Annotations>>) -> Result<&Arc<Annotations>, Problem> {
    annotations.ok_or_else(|| {
        let detail = "this server keeps no annotations; start it with --annotations PLACE";
        Problem::new(StatusCode::NOT_FOUND, "annotations-off", detail)
    })
}

/// The routes under a volume.
pub(super) fn routes() -> Router<AppState> {
    Router::new()
        .route("/v1/volumes/{id}/annotations", get(list::list).post(edit::post))
        .route("/v1/volumes/{id}/annotations/undo", edit::steps(HistoryStep::Undo))
        .route("/v1/volumes/{id}/annotations/redo", edit::steps(HistoryStep::Redo))
        .route("/v1/volumes/{id}/annotations/log", get(log::log))
        .route("/v1/volumes/{id}/annotations/grow", post(structures::grow))
        .route("/v1/volumes/{id}/annotations/paint", post(structures::paint))
        .route("/v1/volumes/{id}/annotations/fill", post(structures::fill))
        .route("/v1/volumes/{id}/annotations/mesh", post(structures::mesh))
        .route("/v1/volumes/{id}/annotations/import", post(files::import))
        .route("/v1/volumes/{id}/annotations/export", get(files::export))
        .route("/v1/volumes/{id}/annotations/snap", post(snap::snap))
        .route("/v1/volumes/{id}/annotations/templates", get(templates::names))
        .route("/v1/volumes/{id}/annotations/contents/{sha256}", get(files::content))
        .route("/v1/volumes/{id}/annotations/sets/{name}", get(sets::show).put(sets::put))
        .route("/v1/volumes/{id}/annotations/templates/{name}", get(templates::show).put(templates::put))
        .route("/v1/volumes/{id}/annotations/templates/{name}/apply", post(templates::apply))
        .route("/v1/volumes/{id}/annotations/{item}", get(item::show).put(item::put).delete(item::delete))
}

/// A query of named parts, none unknown.
fn query<T: serde::de::DeserializeOwned>(uri: &Uri) -> Result<T, Problem> {
    axum::extract::Query::<T>::try_from_uri(uri)
        .map(|query| query.0)
        .map_err(|error| Problem::new(StatusCode::BAD_REQUEST, "malformed-parameter", error.body_text()))
}
