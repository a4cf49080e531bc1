//! Live sessions: views that move, and those who look at them, over WebSockets and without.
//!
//! What it is: [`Live`], the views and sessions of a server, and the routes under `/v1/session`. A view is rendered by its `director`
//! when somebody has room for a picture; each connection has a reader and a writer (`socket`). What it is not: the protocol, which
//! is in `relief_live`. Names of views and tokens of sessions are keys: they appear in no log and no metric.

mod connection;
mod director;
mod look;
mod motion;
mod order;
mod pace;
mod placing;
mod plain;
mod preview;
mod remote;
mod session;
mod shot;
mod slot;
mod socket;
mod view;
mod wished;

use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use axum::http::StatusCode;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

use self::look::Look;
use self::motion::Patience;
use self::session::Sessions;
use self::view::{View, lock};
use super::problem::Problem;
use super::state::Server;
use relief_tracking::{Beacon, Pinhole};

pub(super) use plain::{intent, mjpeg, next_frame};
pub(super) use socket::{connect, protocol};

/// A view is kept so long beyond the sessions that may come back to it.
const LINGER_BEYOND: Duration = Duration::from_secs(5);

/// How live sessions behave.
#[derive(Clone, Debug)]
pub struct LiveConfig {
    /// Sessions and plain viewers at a time.
    pub sessions: usize,
    /// Longest wait for `hello`.
    pub hello_timeout: Duration,
    /// From one ping to the next.
    pub ping: Duration,
    /// A connection from which nothing has come for so long is let go.
    pub silence: Duration,
    /// How long a session may be resumed after its connection was lost.
    pub resume: Duration,
    /// A view is still so long after its last change, or later where changes come slowly.
    pub still_after: Duration,
    /// The camera of Wiimotes whose reports are relayed.
    pub sensor: Pinhole,
    /// The beacon that they look at.
    pub beacon: Beacon,
}

impl Default for LiveConfig {
    fn default() -> Self {
        Self {
            sessions: 128,
            hello_timeout: Duration::from_secs(10),
            ping: Duration::from_secs(10),
            silence: Duration::from_secs(30),
            resume: Duration::from_secs(60),
            still_after: Duration::from_millis(40),
            sensor: Pinhole::TYPICAL,
            beacon: Beacon::recommended(),
        }
    }
}

/// The views and sessions of a server.
pub(super) struct Live {
    config: LiveConfig,
    views: Mutex<HashMap<String, Arc<View>>>,
    sessions: Mutex<Sessions>,
    /// Of connections and plain viewers.
    places: Arc<Semaphore>,
    closing: watch::Sender<bool>,
    ids: AtomicU64,
}

impl Live {
    pub(super) fn new(config: LiveConfig) -> Self {
        let places = Arc::new(Semaphore::new(config.sessions));
        Self {
            views: Mutex::default(),
            sessions: Mutex::new(Sessions::new(config.resume, 2 * config.sessions)),
            places,
            closing: watch::Sender::new(false),
            ids: AtomicU64::new(1),
            config,
        }
    }

    fn patience(&self) -> Patience {
        Patience { still_after: self.config.still_after, linger: self.config.resume + LINGER_BEYOND }
    }

    /// A place for one more who looks.
    fn place(&self) -> Result<OwnedSemaphorePermit, Problem> {
        if *self.closing.borrow() {
            return Err(Problem::unavailable("stopping", "the server stops"));
        }
        let full = |_| {
            let detail = format!("{} live sessions are open, as many as allowed", self.config.sessions);
            Problem::unavailable("sessions-full", detail)
        };
        Arc::clone(&self.places).try_acquire_owned().map_err(full)
    }

    fn next_id(&self) -> u64 {
        self.ids.fetch_add(1, Ordering::Relaxed)
    }

    /// The view of this name, kept for a while from now on.
    fn find(&self, name: &str) -> Option<Arc<View>> {
        let views = lock(&self.views);
        let view = views.get(name)?;
        view.touch(); // under the lock, under which views are removed
        Some(Arc::clone(view))
    }

    /// The view of this name, or a new one with this look.
    fn find_or_open(server: &Arc<Server>, name: &str, look: Look) -> Result<Arc<View>, Problem> {
        let live = &server.live;
        let mut views = lock(&live.views);
        if let Some(view) = views.get(name) {
            view.touch();
            return Ok(Arc::clone(view));
        }
        // As many as can be looked at, and as many that somebody may come back to.
        if views.len() >= 2 * live.config.sessions {
            return Err(Problem::unavailable(
                "views-full",
                "there are as many views as allowed; try again soon",
            ));
        }
        let view = Arc::new(View::new(name.to_owned(), look, Instant::now()));
        views.insert(name.to_owned(), Arc::clone(&view));
        drop(views);
        tokio::spawn(director::direct(Arc::clone(server), Arc::clone(&view)));
        Ok(view)
    }

    /// Removes a view at which nobody has looked for long; false where somebody came back to it.
    fn remove_forgotten(&self, view: &Arc<View>) -> bool {
        let mut views = lock(&self.views);
        let is_forgotten = view.is_forgotten(Instant::now(), self.patience().linger);
        if is_forgotten {
            views.remove(&view.name);
        }
        is_forgotten
    }

    /// Annotations have changed: views that draw them look again.
    pub(super) fn annotations_changed(&self) {
        lock(&self.views).values().for_each(|view| view.work.notify_one());
    }

    /// A volume was removed: views of it end.
    pub(super) fn volume_removed(&self) {
        lock(&self.views).values().for_each(|view| view.work.notify_one());
    }

    fn remove(&self, view: &Arc<View>) {
        let mut views = lock(&self.views);
        if views.get(&view.name).is_some_and(|known| Arc::ptr_eq(known, view)) {
            views.remove(&view.name);
        }
    }
}

impl Server {
    /// Closes all live sessions, and waits for them for so long. From now on none is taken.
    pub async fn close_sessions(&self, patience: Duration) {
        self.live.closing.send_replace(true);
        let all = u32::try_from(self.live.config.sessions).unwrap_or(u32::MAX);
        let _ = tokio::time::timeout(patience, self.live.places.acquire_many(all)).await;
    }
}

/// 128 bits that nobody can guess, in hexadecimal digits.
fn random_name() -> Result<String, Problem> {
    let mut bytes = [0u8; 16];
    getrandom::fill(&mut bytes).map_err(|error| Problem::internal("drawing a random name", error))?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

fn no_such_view() -> Problem {
    let detail = "no view has this name; a session's hello makes it, or a first intent";
    Problem::new(StatusCode::NOT_FOUND, "no-such-view", detail)
}
