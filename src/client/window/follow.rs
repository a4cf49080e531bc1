//! How quickly the window shows views for tracked eyes.

use std::time::{Duration, Instant};

/// Views that followed a tracked viewer, from the arrival of the eyes to the window's surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Followed {
    /// The number of shown frames.
    pub views: u32,
    /// The sum of their times.
    pub total: Duration,
    /// The longest.
    pub longest: Duration,
}

impl Followed {
    /// The mean time, if there were any.
    #[must_use]
    pub fn mean(&self) -> Option<Duration> {
        self.total.checked_div(self.views)
    }

    pub(super) fn shown(&mut self, since: Instant) {
        let took = since.elapsed();
        self.views += 1;
        self.total += took;
        self.longest = self.longest.max(took);
    }
}
