//! [`Live`]: the live sessions of a server, their views and their limits.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use axum::http::StatusCode;
use data_encoding::HEXLOWER;
use parking_lot::Mutex;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

use super::session::Sessions;
use crate::identity::Caller;
use crate::problem::Problem;
use crate::shares::{Share, Shares};
use relief_session::{Delays, Views};
use relief_tracking::{Beacon, Pinhole};

/// The lifetime of a view after the last session that may come back to it.
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
    /// The time after a lost connection in which a session can be resumed.
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

/// A place among the viewers, until it is dropped.
pub(super) struct Place {
    _permit: OwnedSemaphorePermit,
    _share: Option<Share>,
}

/// The live sessions of a server.
pub(crate) struct Live {
    pub(super) config: LiveConfig,
    pub(crate) views: Arc<Views>,
    pub(super) sessions: Mutex<Sessions>,
    /// Permits of connections and plain viewers.
    pub(super) places: Arc<Semaphore>,
    /// Half of the places are one caller's at most.
    shares: Arc<Shares>,
    pub(super) closing: watch::Sender<bool>,
    ids: AtomicU64,
}

impl Live {
    pub(crate) fn new(config: LiveConfig) -> Self {
        let patience = Delays { still_after: config.still_after, linger: config.resume + LINGER_BEYOND };
        // One view for each session, and one to which a session may come back.
        Self {
            views: Views::new(2 * config.sessions, patience),
            sessions: Mutex::new(Sessions::new(config.resume, 2 * config.sessions)),
            places: Arc::new(Semaphore::new(config.sessions)),
            shares: Arc::new(Shares::new(config.sessions.div_ceil(2))),
            closing: watch::Sender::new(false),
            ids: AtomicU64::new(1),
            config,
        }
    }

    /// A place for one more viewer.
    ///
    /// # Errors
    /// 503 when all places are taken, 429 when the caller has its share of them.
    pub(super) fn place(&self, caller: &Caller) -> Result<Place, Problem> {
        if *self.closing.borrow() {
            return Err(Problem::unavailable("stopping", "the server stops"));
        }
        let full = |_| {
            let detail = format!("{} live sessions are open, as many as allowed", self.config.sessions);
            Problem::unavailable("sessions-full", detail)
        };
        let share = self.shares.take(caller).map_err(|most| {
            let detail = format!("{most} of your live sessions are open, as many as one caller may have");
            Problem::new(StatusCode::TOO_MANY_REQUESTS, "too-many-sessions", detail).with("allowed", most)
        })?;
        let permit = Arc::clone(&self.places).try_acquire_owned().map_err(full)?;
        Ok(Place { _permit: permit, _share: share })
    }

    pub(super) fn next_id(&self) -> u64 {
        self.ids.fetch_add(1, Ordering::Relaxed)
    }
}

/// 128 random bits in hexadecimal digits.
pub(super) fn random_name() -> Result<String, Problem> {
    let mut bytes = [0u8; 16];
    getrandom::fill(&mut bytes).map_err(|error| Problem::internal("drawing a random name", error))?;
    Ok(HEXLOWER.encode(&bytes))
}

pub(super) fn no_such_view() -> Problem {
    let detail = "no view has this name; a session's hello makes it, or a first intent";
    Problem::new(StatusCode::NOT_FOUND, "no-such-view", detail)
}
