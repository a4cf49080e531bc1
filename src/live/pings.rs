//! How many pings a connection answers. A WebSocket answers each ping with a pong, which waits in memory until
//! the other side reads: without a limit, a side that only sends fills the memory of the other.

use std::time::{Duration, Instant};

/// The pings of one connection: a number at once, and then some a second. A server sends one in
/// ten seconds, `relief client` two in three seconds.
#[derive(Clone, Debug)]
pub struct PingLimit {
    /// Pings that may come now.
    left: u32,
    /// When `left` rose last.
    since: Instant,
}

impl PingLimit {
    /// Pings at once.
    pub const AT_ONCE: u32 = 32;
    /// Time after which one more may come.
    pub const INTERVAL: Duration = Duration::from_millis(500);

    /// The limit of a connection that begins now.
    #[must_use]
    pub const fn new(now: Instant) -> Self {
        Self { left: Self::AT_ONCE, since: now }
    }

    /// Counts a ping; false where it is one too many, and the connection should end.
    #[must_use]
    pub fn accepts(&mut self, now: Instant) -> bool {
        let passed = now.saturating_duration_since(self.since).as_millis() / Self::INTERVAL.as_millis();
        let more = u32::try_from(passed).unwrap_or(u32::MAX);
        if more > 0 {
            self.left = self.left.saturating_add(more).min(Self::AT_ONCE);
            self.since = now;
        }
        let accepts = self.left > 0;
        self.left = self.left.saturating_sub(1);
        accepts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pings_have_a_burst_and_a_rate() {
        let start = Instant::now();
        let mut limit = PingLimit::new(start);
        let accepted = |limit: &mut PingLimit, at: Duration| {
            (0..100).filter(|_| limit.accepts(start + at)).count() as u32
        };
        assert_eq!(accepted(&mut limit, Duration::ZERO), PingLimit::AT_ONCE);
        assert_eq!(accepted(&mut limit, Duration::from_secs(5)), 10);
        assert_eq!(accepted(&mut limit, Duration::from_secs(3600)), PingLimit::AT_ONCE);
        let mut usual = PingLimit::new(start);
        assert!((0..1000).all(|ping| usual.accepts(start + Duration::from_millis(1500 * ping))));
    }
}
