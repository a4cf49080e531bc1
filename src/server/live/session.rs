//! Sessions: what outlives a connection, so that it can be resumed by its token.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use parking_lot::Mutex;
use tokio::sync::watch;

use super::remote::Remote;
use crate::identity::Caller;
use relief_annotation::LandmarkTask;
use relief_live::Role;
use relief_session::View;

/// A session; its token resumes it.
pub(super) struct Session {
    pub(super) token: String,
    pub(super) view: Arc<View>,
    pub(super) role: Role,
    pub(super) remote: Mutex<Remote>,
    /// The author of changes.
    pub(super) author: Option<String>,
    pub(super) caller: Caller,
    /// The state of the hand: the next label and the held point.
    pub(super) task: Mutex<LandmarkTask>,
    /// Counts the connections; all but the newest end.
    pub(super) connection: watch::Sender<u64>,
    /// Since when it has no connection.
    lost: Mutex<Option<Instant>>,
}

/// All sessions, those that wait to be resumed among them.
pub(super) struct Sessions {
    by_token: HashMap<String, Arc<Session>>,
    resume: Duration,
    most: usize,
}

impl Session {
    pub(super) fn new(
        token: String,
        view: Arc<View>,
        role: Role,
        author: Option<String>,
        caller: Caller,
        remote: Remote,
    ) -> Arc<Self> {
        let (connection, lost) = (watch::Sender::new(1), Mutex::new(None));
        let (remote, task) = (Mutex::new(remote), Mutex::default());
        Arc::new(Self { token, view, role, remote, author, caller, task, connection, lost })
    }

    /// The connection of this number is gone; nothing if a newer one continues.
    pub(super) fn lose(&self, connection: u64, now: Instant) {
        if *self.connection.borrow() == connection {
            *self.lost.lock() = Some(now);
        }
    }
}

impl Sessions {
    pub(super) fn new(resume: Duration, most: usize) -> Self {
        Self { by_token: HashMap::new(), resume, most }
    }

    pub(super) fn add(&mut self, session: &Arc<Session>, now: Instant) {
        self.forget(now);
        self.by_token.insert(session.token.clone(), Arc::clone(session));
    }

    /// The session of a token for a new connection of the same caller, whose number is the second
    /// part.
    pub(super) fn resume(
        &mut self,
        token: &str,
        caller: &Caller,
        now: Instant,
    ) -> Option<(Arc<Session>, u64)> {
        self.forget(now);
        let session = self.by_token.get(token)?;
        if *session.view.ended.borrow() || !session.caller.is_same_as(caller) {
            return None;
        }
        *session.lost.lock() = None;
        session.connection.send_modify(|connection| *connection += 1);
        let connection = *session.connection.borrow();
        Some((Arc::clone(session), connection))
    }

    /// Lets go of those that waited too long, and of the longest lost where there are too many.
    fn forget(&mut self, now: Instant) {
        let resume = self.resume;
        let lost_for =
            |session: &Session| session.lost.lock().map(|lost| now.saturating_duration_since(lost));
        self.by_token.retain(|_, session| lost_for(session).is_none_or(|lost| lost < resume));
        while self.by_token.len() >= self.most {
            let lost = self.by_token.iter().filter_map(|(token, session)| Some((lost_for(session)?, token)));
            let Some(longest) = lost.max().map(|(_, token)| token.clone()) else { break };
            self.by_token.remove(&longest);
        }
    }
}
