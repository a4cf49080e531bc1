//! The pace of one connection: what is out, how long it takes, and what pictures it can have while the view moves.
//!
//! What it is: arithmetic on the times of hand-overs and acknowledgements. A frame whose acknowledgement takes longer than the
//! quickest one by more than two frames' time waits for the connection: pictures become smaller, then coarser. What it is not: a
//! clock or a socket; all times come in.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use relief_live::MAX_IN_FLIGHT;

/// JPEG while the view moves, where the connection has room. From 90 on the encoder keeps all of the colour, at twice the time.
pub(super) const USUAL_QUALITY: u8 = LEVELS[0].1;

/// What a connection gets while the view moves: the share of width and height, and the quality of JPEG. Resolution goes first: a
/// picture that moves is forgiven blur sooner than blocks.
pub(super) const LEVELS: [(f64, u8); 9] =
    [(1.0, 85), (0.84, 85), (0.71, 85), (0.59, 85), (0.5, 85), (0.5, 75), (0.5, 65), (0.5, 55), (0.5, 45)];

/// Longer than the quickest by this: the connection is slow, ms. Two frames at 20 a second.
const SLOW_MS: f64 = 100.0;
/// Longer than the quickest by less than this: there is room, ms.
const ROOMY_MS: f64 = 40.0;
/// One step down at most so often.
const STEP_DOWN: Duration = Duration::from_millis(250);
/// One step up after so long with room.
const STEP_UP: Duration = Duration::from_secs(1);
/// How much of the way to a new measurement the smoothed one goes.
const SMOOTHING: f64 = 0.3;
/// How fast the quickest is forgotten, for each frame: paths change.
const FORGETTING: f64 = 1.002;

#[derive(Clone, Copy, Debug)]
struct Sent {
    sequence: u32,
    at: Instant,
    is_still: bool,
}

/// See the module.
#[derive(Debug)]
pub(super) struct Pace {
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

    /// How many frames are out.
    pub(super) fn in_flight(&self) -> usize {
        self.out.len()
    }

    /// What the connection can have while the view moves.
    pub(super) fn level(&self) -> (f64, u8) {
        LEVELS[self.level]
    }

    /// A frame is handed over; its sequence.
    pub(super) fn sent(&mut self, now: Instant, is_still: bool) -> u32 {
        self.last_sequence = self.last_sequence.wrapping_add(1).max(1);
        self.out.push_back(Sent { sequence: self.last_sequence, at: now, is_still });
        self.last_sequence
    }

    /// A frame was shown, and with it those before; false where no such frame is out.
    pub(super) fn acknowledged(&mut self, sequence: u32, now: Instant) -> bool {
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

    /// Frames one after another, each acknowledged after so many ms.
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
        assert_eq!(seen, LEVELS, "each step in its order");
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
