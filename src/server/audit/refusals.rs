//! Selects the refused requests that get a record: a limited number in each minute.

use std::time::{Duration, Instant};

/// The refused requests of the current minute.
#[derive(Debug)]
pub(super) struct Refusals {
    since: Instant,
    recorded: u64,
    /// Refused requests without a record that no record counts yet.
    uncounted: u64,
}

impl Default for Refusals {
    fn default() -> Self {
        Self { since: Instant::now(), recorded: 0, uncounted: 0 }
    }
}

impl Refusals {
    /// Most records of refused requests in a minute. They take at most 60 MB a day.
    pub(super) const PER_MINUTE: u64 = 120;
    const MINUTE: Duration = Duration::from_secs(60);

    /// `None` if a request with this status gets no record. Otherwise the number of refused requests that
    /// its record counts, if there are any.
    #[expect(clippy::option_option, reason = "a record, and a number in it")]
    pub(super) fn before(&mut self, status: Option<u16>) -> Option<Option<u64>> {
        if self.since.elapsed() >= Self::MINUTE {
            (self.since, self.recorded) = (Instant::now(), 0);
        }
        // Unauthorized, forbidden, too many requests, service unavailable.
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

    /// Takes the number of refused requests that no record counts yet.
    pub(super) fn rest(&mut self) -> Option<u64> {
        Some(std::mem::take(&mut self.uncounted)).filter(|count| *count > 0)
    }
}
