//! A limit of the pings of a connection. A WebSocket answers each ping with a pong, which stays in memory
//! until the other side reads it. Without a limit, a peer that sends pings and reads nothing fills the
//! memory.

use std::time::{Duration, Instant};

/// The limit of one connection: a burst, and then a rate. A server sends a ping every 10 seconds, `relief
/// client` every 1.5 seconds.
#[derive(Clone, Debug)]
pub struct PingLimit {
    /// Pings that are still accepted.
    left: u32,
    /// When `left` was increased last.
    since: Instant,
}

impl PingLimit {
    /// Pings in a burst.
    pub const AT_ONCE: u32 = 32;
    /// Time after which one more ping is accepted.
    pub const INTERVAL: Duration = Duration::from_millis(500);

    /// The limit of a new connection.
    #[must_use]
    pub const fn new(now: Instant) -> Self {
        Self { left: Self::AT_ONCE, since: now }
    }

    /// Counts a ping. False if it exceeds the limit, and the connection should be closed.
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
