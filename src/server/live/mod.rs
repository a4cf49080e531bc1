//! Live sessions over HTTP: WebSocket connections, MJPEG streams, single frames and intents by
//! POST.
//!
//! What it is: [`Live`], the sessions of a server, and the routes under `/v1/session`. Each
//! connection has a reader and a writer (see `connection`). What it is not: views and their
//! rendering (see `relief_session`), the protocol (see `relief_live`). Names of views and tokens of
//! sessions are keys: they appear in no log and no metric.

mod close;
mod connection;
mod placing;
mod plain;
mod remote;
mod session;
mod socket;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use axum::http::StatusCode;
use data_encoding::HEXLOWER;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

use self::session::Sessions;
use super::problem::Problem;
use super::state::{LiveParts, Server};
use relief_session::{Delays, Presentation, View, Views};
use relief_tracking::{Beacon, Pinhole};

pub(super) use plain::{intent, mjpeg, next_frame};
pub(super) use socket::{connect, protocol};

/// How long a view outlives the last session that may come back to it.
const LINGER_BEYOND: Duration = Duration::from_secs(5);

/// The configuration of live sessions.
#[derive(Clone, Debug)]
pub struct LiveConfig {
    /// Most sessions and plain viewers at a time.
    pub sessions: usize,
    /// Longest wait for `hello`.
    pub hello_timeout: Duration,
    /// Interval of pings.
    pub ping: Duration,
    /// A connection that sends nothing for this time is closed.
    pub silence: Duration,
    /// How long a session can be resumed after its connection was lost.
    pub resume: Duration,
    /// From the last change until a view counts as still; longer where changes arrive slowly.
    pub still_after: Duration,
    /// The infrared camera of Wiimotes whose reports are relayed.
    pub sensor: Pinhole,
    /// The beacon that they see.
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

/// The live sessions of a server.
pub(super) struct Live {
    config: LiveConfig,
    pub(super) views: Arc<Views>,
    sessions: Mutex<Sessions>,
    /// Permits of connections and plain viewers.
    places: Arc<Semaphore>,
    closing: watch::Sender<bool>,
    ids: AtomicU64,
}

impl Live {
    pub(super) fn new(config: LiveConfig) -> Self {
        let patience = Delays { still_after: config.still_after, linger: config.resume + LINGER_BEYOND };
        // One view for each session, and one to which a session may come back.
        Self {
            views: Views::new(2 * config.sessions, patience),
            sessions: Mutex::new(Sessions::new(config.resume, 2 * config.sessions)),
            places: Arc::new(Semaphore::new(config.sessions)),
            closing: watch::Sender::new(false),
            ids: AtomicU64::new(1),
            config,
        }
    }

    /// A permit for one more viewer.
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
}

impl LiveParts {
    /// The view of this name, or a new one with this presentation.
    fn find_or_open(&self, name: &str, presentation: Presentation) -> Result<Arc<View>, Problem> {
        let views = &self.live.views;
        Ok(views.find_or_open(&self.engine, self.annotations.clone(), name, presentation)?)
    }
}

impl Server {
    /// Closes all live sessions and refuses new ones; waits until they have ended, at most
    /// `patience`.
    pub async fn close_sessions(&self, patience: Duration) {
        self.live.closing.send_replace(true);
        let all = u32::try_from(self.live.config.sessions).unwrap_or(u32::MAX);
        let _ = tokio::time::timeout(patience, self.live.places.acquire_many(all)).await;
    }
}

/// 128 random bits in hexadecimal digits.
fn random_name() -> Result<String, Problem> {
    let mut bytes = [0u8; 16];
    getrandom::fill(&mut bytes).map_err(|error| Problem::internal("drawing a random name", error))?;
    Ok(HEXLOWER.encode(&bytes))
}

fn no_such_view() -> Problem {
    let detail = "no view has this name; a session's hello makes it, or a first intent";
    Problem::new(StatusCode::NOT_FOUND, "no-such-view", detail)
}
