//! The pause before the next attempt to connect.

use std::time::Duration;

/// Waits that double from [`Backoff::FIRST`] to [`Backoff::LAST`]: a server that was away for long
/// is found again within a second.
#[derive(Clone, Copy, Debug)]
pub(super) struct Backoff {
    next: Duration,
}

impl Backoff {
    pub(super) const FIRST: Duration = Duration::from_millis(100);
    /// With the time of an attempt, a server is found within a second of its return.
    pub(super) const LAST: Duration = Duration::from_millis(800);

    pub(super) const fn new() -> Self {
        Self { next: Self::FIRST }
    }

    pub(super) fn next(&mut self) -> Duration {
        let wait = self.next;
        self.next = (2 * self.next).min(Self::LAST);
        wait
    }

    /// The connection was good: the next loss is a new one.
    pub(super) fn reset(&mut self) {
        *self = Self::new();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_double_to_a_limit_and_begin_anew() {
        let mut backoff = Backoff::new();
        let waits: Vec<_> = (0..6).map(|_| backoff.next().as_millis()).collect();
        assert_eq!(waits, [100, 200, 400, 800, 800, 800]);
        backoff.reset();
        assert_eq!(backoff.next().as_millis(), 100);
    }
}
