//! Which refused requests have a record of their own: a bounded number in each minute.

use std::time::{Duration, Instant};

/// The refused requests of the current minute.
#[derive(Debug)]
pub(super) struct Refusals {
    since: Instant,
    recorded: u64,
    /// Those that no record counts yet.
    uncounted: u64,
}

impl Default for Refusals {
    fn default() -> Self {
        Self { since: Instant::now(), recorded: 0, uncounted: 0 }
    }
}

impl Refusals {
    /// Records of refused requests in a minute: at most 60 MB in a day.
    pub(super) const PER_MINUTE: u64 = 120;
    const MINUTE: Duration = Duration::from_secs(60);

    /// Whether an answer of this status has a record of its own, and the refused requests that this record
    /// counts; `None` if it has none.
    #[expect(clippy::option_option, reason = "a record, and a number in it")]
    pub(super) fn before(&mut self, status: Option<u16>) -> Option<Option<u64>> {
        if self.since.elapsed() >= Self::MINUTE {
            (self.since, self.recorded) = (Instant::now(), 0);
        }
        // Not identified, not allowed, one too many, or not served for now.
        if matches!(status, Some(401 | 403 | 429 | 503)) {
            if self.recorded >= Self::PER_MINUTE {
                self.count();
                return None;
            }
            self.recorded += 1;
        }
        Some(self.rest())
    }

    /// Counts a refused request that has no record.
    pub(super) fn count(&mut self) {
        self.uncounted += 1;
    }

    /// The refused requests that no record counts yet.
    pub(super) fn rest(&mut self) -> Option<u64> {
        Some(std::mem::take(&mut self.uncounted)).filter(|count| *count > 0)
    }
}
