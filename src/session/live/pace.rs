//! Flow control of one connection: frames in flight, their delay, and the size and quality that the
//! connection carries.
//!
//! What it is: arithmetic on the times of sent frames and acknowledgements. When an acknowledgement
//! is later than the fastest one by more than two frame intervals, the connection is the
//! bottleneck: frames become smaller, then coarser. What it is not: a clock or a socket; the caller
//! passes all times.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use relief_live::MAX_IN_FLIGHT;

/// JPEG quality of a moving view on a fast connection. From 90 on the encoder keeps full chroma, at
/// twice the time.
pub const USUAL_QUALITY: u8 = LEVELS[0].1;

/// Levels of a moving view: share of width and height, JPEG quality. Resolution drops first,
/// because blur disturbs less than blocks in a moving picture.
const LEVELS: [(f64, u8); 9] =
    [(1.0, 85), (0.84, 85), (0.71, 85), (0.59, 85), (0.5, 85), (0.5, 75), (0.5, 65), (0.5, 55), (0.5, 45)];

/// Delay beyond the fastest acknowledgement from which a connection counts as slow, ms: two frames
/// at 20 per second.
const SLOW_MS: f64 = 100.0;
/// Delay beyond the fastest acknowledgement below which a connection has spare bandwidth, ms.
const ROOMY_MS: f64 = 40.0;
/// Shortest time between two steps down.
const STEP_DOWN: Duration = Duration::from_millis(250);
/// Time with spare bandwidth before a step up.
const STEP_UP: Duration = Duration::from_secs(1);
/// Weight of a new measurement in the smoothed delay.
const SMOOTHING: f64 = 0.3;
/// Growth of the fastest delay per frame, because network paths change.
const FORGETTING: f64 = 1.002;

#[derive(Clone, Copy, Debug)]
struct Sent {
    sequence: u32,
    at: Instant,
    is_still: bool,
}

/// Flow control of one connection.
#[derive(Debug)]
pub struct Pace {
    out: VecDeque<Sent>,
    last_sequence: u32,
    quickest_ms: Option<f64>,
    excess_ms: f64,
    level: usize,
    changed: Instant,
    roomy_since: Option<Instant>,
}

impl Pace {
    pub(super) fn new(now: Instant) -> Self {
        Self {
            out: VecDeque::with_capacity(MAX_IN_FLIGHT),
            last_sequence: 0,
            quickest_ms: None,
            excess_ms: 0.0,
            level: 0,
            changed: now,
            roomy_since: None,
        }
    }

    /// Number of frames in flight.
    #[must_use]
    pub fn in_flight(&self) -> usize {
        self.out.len()
    }

    /// Share of width and height, and JPEG quality, of a moving view.
    #[must_use]
    pub fn level(&self) -> (f64, u8) {
        LEVELS[self.level]
    }

    /// Records a sent frame; returns its sequence number.
    pub fn sent(&mut self, now: Instant, is_still: bool) -> u32 {
        self.last_sequence = self.last_sequence.wrapping_add(1).max(1);
        self.out.push_back(Sent { sequence: self.last_sequence, at: now, is_still });
        self.last_sequence
    }

    /// Records that a frame was shown, and all frames before it; false when no such frame is in
    /// flight.
    pub fn acknowledged(&mut self, sequence: u32, now: Instant) -> bool {
        let Some(at) = self.out.iter().position(|sent| sent.sequence == sequence) else { return false };
        let shown = self.out.drain(..=at).next_back();
        if let Some(Sent { at, is_still: false, .. }) = shown {
            self.measure(now.saturating_duration_since(at).as_secs_f64() * 1e3, now);
        }
        true
    }

    fn measure(&mut self, ms: f64, now: Instant) {
        let quickest = self.quickest_ms.map_or(ms, |quickest| (quickest * FORGETTING).min(ms));
        self.quickest_ms = Some(quickest);
        self.excess_ms += SMOOTHING * (ms - quickest - self.excess_ms);
        if self.excess_ms < ROOMY_MS {
            let since = *self.roomy_since.get_or_insert(now);
            if self.level > 0 && now.duration_since(since) >= STEP_UP {
                self.level -= 1;
                self.roomy_since = Some(now);
                self.changed = now;
            }
            return;
        }
        self.roomy_since = None;
        let is_due = now.saturating_duration_since(self.changed) >= STEP_DOWN;
        if self.excess_ms > SLOW_MS && is_due && self.level + 1 < LEVELS.len() {
            self.level += 1;
            self.changed = now;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sends frames one after another, each acknowledged after `ms`.
    fn run(pace: &mut Pace, now: &mut Instant, frames: usize, ms: u64) {
        for _ in 0..frames {
            let sequence = pace.sent(*now, false);
            *now += Duration::from_millis(ms);
            assert!(pace.acknowledged(sequence, *now));
        }
    }

    #[test]
    fn a_slow_connection_loses_resolution_then_quality_and_gets_both_back() {
        let mut now = Instant::now();
        let mut pace = Pace::new(now);
        run(&mut pace, &mut now, 20, 10);
        assert_eq!(pace.level(), (1.0, USUAL_QUALITY), "a quick one has all");
        let mut seen = vec![pace.level()];
        for _ in 0..60 {
            run(&mut pace, &mut now, 1, 300);
            if seen.last() != Some(&pace.level()) {
                seen.push(pace.level());
            }
        }
        assert_eq!(seen, LEVELS, "each step in its job");
        run(&mut pace, &mut now, 1500, 12);
        assert_eq!(pace.level(), (1.0, USUAL_QUALITY), "quick again");
    }

    #[test]
    fn a_long_way_is_not_a_slow_one() {
        let mut now = Instant::now();
        let mut pace = Pace::new(now);
        run(&mut pace, &mut now, 50, 180);
        assert_eq!(pace.level(), (1.0, USUAL_QUALITY));
    }

    #[test]
    fn acknowledgements_count_for_those_before_and_only_for_what_is_out() {
        let now = Instant::now();
        let mut pace = Pace::new(now);
        let [first, second] = [pace.sent(now, false), pace.sent(now, true)];
        assert_eq!((first, second, pace.in_flight()), (1, 2, 2));
        assert!(!pace.acknowledged(3, now) && !pace.acknowledged(0, now));
        assert!(pace.acknowledged(second, now));
        assert_eq!(pace.in_flight(), 0);
        assert!(!pace.acknowledged(first, now));
    }
}
