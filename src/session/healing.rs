//! When a backend that failed is recreated: at once, and then after pauses that double.

use std::time::{Duration, Instant};

use super::RenderBackend;
use super::guard::guarded;

/// The first pause after an attempt that failed, and the longest.
const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LONGEST_PAUSE: Duration = Duration::from_secs(5);

/// The state of a backend.
#[derive(Debug, Default)]
pub(super) struct Healing {
    /// After a failure, when the next attempt is due, and the pause after it.
    due: Option<(Instant, Duration)>,
}

impl Healing {
    /// The backend has failed: an attempt is due now, unless one failed a moment ago.
    pub(super) fn failed(&mut self) {
        self.due.get_or_insert_with(|| (Instant::now(), FIRST_PAUSE));
    }

    /// The time until the next attempt; `None` when the backend works.
    pub(super) fn wait(&self) -> Option<Duration> {
        self.due.map(|(due, _)| due.saturating_duration_since(Instant::now()))
    }

    /// Recreates the backend if that is due; whether it works now.
    pub(super) fn attempt(&mut self, backend: &mut impl RenderBackend) -> bool {
        let Some((due, pause)) = self.due else { return true };
        if !backend.can_be_renewed() || due > Instant::now() {
            return false;
        }
        let outcome = match guarded(|| backend.renew()) {
            Ok(Ok(())) => {
                tracing::warn!("the graphics device failed and was opened again");
                self.due = None;
                return true;
            }
            Ok(Err(error)) => error.to_string(),
            Err(panic) => panic,
        };
        tracing::error!(cause = outcome, "the graphics device failed and cannot be opened; trying again");
        self.due = Some((Instant::now() + pause, (pause * 2).min(LONGEST_PAUSE)));
        false
    }
}
