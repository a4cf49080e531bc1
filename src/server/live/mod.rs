//! Live sessions over HTTP: WebSocket connections, MJPEG streams, single frames and intents by
//! POST.
//!
//! What it is: [`Live`], the sessions of a server, and the routes under `/v1/session`. Each
//! connection has a reader and a writer (see `connection`). What it is not: views and their
//! rendering (see `relief_session`), the protocol (see `relief_live`). Names of views and tokens of
//! sessions are keys: they appear in no log and no metric.

mod audience;
mod close;
mod connection;
mod eye_views;
mod hub;
mod placing;
mod plain;
mod remote;
mod session;
mod socket;
mod wire;

use std::sync::Arc;
use std::time::Duration;

use super::identity::Caller;
use super::problem::Problem;
use super::shares;
use super::state::{LiveParts, Server};
use relief_session::{Presentation, View};

pub(super) use eye_views::eye_views;
pub(super) use hub::Live;
pub use hub::LiveConfig;
pub(super) use plain::{intent, mjpeg, next_frame};
pub(super) use socket::{connect, protocol};

impl LiveParts {
    /// The view of this name, or a new one with this presentation.
    fn find_or_open(
        &self,
        name: &str,
        presentation: Presentation,
        caller: &Caller,
    ) -> Result<Arc<View>, Problem> {
        let (views, key) = (&self.live.views, shares::key(caller));
        Ok(views.find_or_open(&self.engine, self.annotations.clone(), name, presentation, key.as_ref())?)
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
