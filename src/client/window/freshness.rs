//! Whether the picture of the window is up to date: an old one may be of another patient.

use std::time::{Duration, Instant};

/// Time without a connection after which the picture counts as out of date.
const AWAY: Duration = Duration::from_secs(3);

/// State of the shown picture, by the connection's events.
#[derive(Clone, Copy, Debug)]
pub(super) struct Freshness {
    /// Since when there is no connection.
    away_since: Option<Instant>,
    /// The newest connection; 0 before the first.
    connection: u64,
    is_stale: bool,
}

impl Freshness {
    /// Before the first connection: there is no picture.
    pub(super) const fn new() -> Self {
        Self { away_since: None, connection: 0, is_stale: true }
    }

    pub(super) fn connected(&mut self, connection: u64, resumed: bool) {
        (self.away_since, self.connection) = (None, connection);
        // A new session may show another volume: its first frame is on its way.
        self.is_stale |= !resumed;
    }

    pub(super) fn lost(&mut self, now: Instant) {
        self.away_since.get_or_insert(now);
    }

    /// Nothing came for some seconds.
    pub(super) fn silent(&mut self) {
        self.is_stale = true;
    }

    /// The connection works again; frames that it delayed came before this.
    pub(super) fn heard(&mut self) {
        self.is_stale = self.away_since.is_some();
    }

    /// A frame of this connection is shown.
    pub(super) fn frame(&mut self, connection: u64) {
        if connection == self.connection && self.away_since.is_none() {
            self.is_stale = false;
        }
    }

    pub(super) fn is_stale(&self, now: Instant) -> bool {
        self.is_stale || self.away_since.is_some_and(|since| now >= since + AWAY)
    }

    /// When the picture becomes out of date without another event.
    pub(super) fn deadline(&self) -> Option<Instant> {
        self.away_since.filter(|_| !self.is_stale).map(|since| since + AWAY)
    }

    /// Remembers that the picture became out of date: a connection alone does not make it new.
    pub(super) fn update(&mut self, now: Instant) {
        self.is_stale = self.is_stale(now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_out_of_date_after_three_seconds_without_a_connection() {
        let start = Instant::now();
        let at = |seconds: u64| start + Duration::from_secs(seconds);
        let mut picture = Freshness::new();
        assert!(picture.is_stale(start), "no picture yet");
        picture.connected(1, false);
        assert!(picture.is_stale(start), "the first frame has not come");
        picture.frame(1);
        assert!(!picture.is_stale(at(100)));
        picture.lost(at(100));
        picture.lost(at(102)); // a failed attempt
        assert_eq!(picture.deadline(), Some(at(103)));
        assert!(!picture.is_stale(at(102)) && picture.is_stale(at(103)));
        // A late frame of the lost connection does not make it new.
        picture.update(at(103));
        picture.frame(1);
        assert!(picture.is_stale(at(103)));
        picture.connected(2, true);
        assert!(picture.is_stale(at(104)), "until a frame comes");
        picture.frame(2);
        assert!(!picture.is_stale(at(200)));
    }

    #[test]
    fn a_short_loss_keeps_the_picture_of_a_resumed_session_alone() {
        let now = Instant::now();
        let mut picture = Freshness::new();
        picture.connected(1, false);
        picture.frame(1);
        picture.lost(now);
        picture.connected(2, true);
        assert!(!picture.is_stale(now + AWAY));
        picture.lost(now);
        picture.connected(3, false);
        assert!(picture.is_stale(now));
    }

    #[test]
    fn silence_hides_the_picture_until_the_server_is_heard() {
        let now = Instant::now();
        let mut picture = Freshness::new();
        picture.connected(1, false);
        picture.frame(1);
        picture.silent();
        assert!(picture.is_stale(now));
        picture.heard();
        assert!(!picture.is_stale(now));
    }
}
