//! When a moving view counts as still, how long to wait for the next change, and when to retry a
//! failed frame.
//!
//! What it is: arithmetic on times that the caller passes. What it is not: a clock, or a view.

use std::time::{Duration, Instant};

/// A change after a longer gap starts a new motion.
const STANDS_ALONE: Duration = Duration::from_millis(250);
/// Longest time after the last change until a view counts as still.
const LONGEST_STILL: Duration = Duration::from_millis(150);
/// The render loop waits for a change that is due within this time.
const NEARLY_DUE: Duration = Duration::from_millis(6);
/// Longest wait for a change.
const LONGEST_HOLD: Duration = Duration::from_millis(30);
/// A quick frame precedes every full-quality frame that takes longer than this.
const QUICK_STILL: Duration = Duration::from_millis(500);
/// First delay before a retry. It doubles with each failure, up to `LONGEST_RETRY`.
const FIRST_RETRY: Duration = Duration::from_millis(250);
const LONGEST_RETRY: Duration = Duration::from_secs(30);

/// Delays of a view.
#[derive(Clone, Copy, Debug)]
pub struct Delays {
    /// From the last change until the view counts as still.
    pub still_after: Duration,
    /// From the leave of the last viewer until the view is removed.
    pub linger: Duration,
}

/// The changes of a view.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion {
    /// When the newest change arrived.
    pub(super) arrived: Instant,
    /// Mean interval between changes; 0 for a single change.
    rhythm: Duration,
}

impl Motion {
    pub(super) fn new(now: Instant) -> Self {
        Self { arrived: now, rhythm: Duration::ZERO }
    }

    pub(super) fn changed(&mut self, now: Instant) {
        let gap = now.saturating_duration_since(self.arrived);
        self.rhythm = if gap > STANDS_ALONE { Duration::ZERO } else { (self.rhythm * 3 + gap) / 4 };
        self.arrived = now;
    }

    /// When the view counts as still: `after` the last change, or later where changes arrive
    /// slowly, so that a view does not count as still between two messages of a moving hand.
    pub(super) fn still_at(&self, after: Duration) -> Instant {
        self.arrived + after.max(self.rhythm * 5 / 2).min(LONGEST_STILL.max(after))
    }

    /// Whether to wait instead of rendering a quick frame: the next change is due, and without it
    /// the view is still soon. A quick frame would be replaced at once, or would delay the
    /// full-quality frame, which takes `still_took`.
    pub(super) fn comes_to_rest(
        &self,
        now: Instant,
        still_at: Instant,
        still_took: Option<Duration>,
    ) -> bool {
        let is_due = !self.rhythm.is_zero() && now + NEARLY_DUE >= self.arrived + self.rhythm;
        let is_soon_still = still_at.saturating_duration_since(now) <= LONGEST_HOLD;
        is_due && is_soon_still && still_took.is_some_and(|took| took <= QUICK_STILL)
    }
}

/// A frame that could not be rendered.
#[derive(Clone, Copy, Debug)]
pub(super) struct Failure {
    pub(super) revision: u64,
    /// Number of failures of this revision.
    pub(super) times: u32,
    /// Time of the next try; `None` for an invalid request.
    pub(super) again: Option<Instant>,
}

impl Failure {
    /// A failure now, after an earlier one. Only temporary failures are retried.
    pub(super) fn new(before: Option<Self>, revision: u64, is_temporary: bool, now: Instant) -> Self {
        let before = before.filter(|known| known.revision == revision).map_or(0, |known| known.times);
        let wait = FIRST_RETRY.saturating_mul(1 << before.min(10)).min(LONGEST_RETRY);
        Self { revision, times: before + 1, again: is_temporary.then(|| now + wait) }
    }

    /// Whether rendering this revision has to wait.
    pub(super) fn blocks(&self, revision: u64, now: Instant) -> bool {
        self.revision == revision && self.again.is_none_or(|again| now < again)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    /// Changes at an even pace, the newest one `arrived`.
    fn moving(every: Duration, count: u32) -> Motion {
        let start = Instant::now();
        let mut motion = Motion::new(start);
        (0..count).for_each(|i| motion.changed(start + ms(1000) + every * i));
        motion
    }

    #[test]
    fn a_view_is_still_after_a_while_that_goes_by_the_rhythm() {
        for (every, still) in [(8, 40), (16, 40), (33, 82), (100, 150)] {
            let motion = moving(ms(every), 60);
            let after = motion.still_at(ms(40)) - motion.arrived;
            assert!(after.abs_diff(ms(still)) <= ms(1), "every {every} ms: {after:?}");
        }
        let alone = moving(ms(16), 1);
        assert_eq!(alone.still_at(ms(40)) - alone.arrived, ms(40));
    }

    #[test]
    fn motion_comes_to_rest_when_a_change_is_due_and_stillness_is_near() {
        let rests = |motion: Motion, age: u64, took: Option<u64>| {
            let still_at = motion.still_at(ms(40));
            motion.comes_to_rest(motion.arrived + ms(age), still_at, took.map(ms))
        };
        let hand = moving(ms(16), 60);
        // Just after a change there is something to show; later one waits for the next, or for the
        // end.
        let waits: Vec<_> = [0, 5, 9, 12, 20, 39, 60].map(|age| rests(hand, age, Some(200))).into();
        assert_eq!(waits, [false, false, false, true, true, true, true]);
        assert!(!rests(hand, 20, None) && !rests(hand, 20, Some(2000)), "slow best pictures have one before");
        // 30 a second: still after 82 ms, which is too long to wait for.
        assert!(!rests(moving(ms(33), 60), 35, Some(200)) && rests(moving(ms(33), 60), 55, Some(200)));
        assert!(!rests(moving(ms(16), 1), 20, Some(200)), "what stands alone is shown at once");
    }

    #[test]
    fn only_temporary_failures_are_retried_with_growing_delays() {
        let now = Instant::now();
        let mut waits = Vec::new();
        let mut failure = None;
        for _ in 0..12 {
            let new = Failure::new(failure, 7, true, now);
            waits.push((new.again.unwrap() - now).as_millis());
            assert!(new.blocks(7, now) && !new.blocks(7, new.again.unwrap()) && !new.blocks(8, now));
            failure = Some(new);
        }
        assert_eq!(waits, [250, 500, 1000, 2000, 4000, 8000, 16000, 30000, 30000, 30000, 30000, 30000]);
        assert_eq!(Failure::new(failure, 8, true, now).times, 1, "another revision");
        assert!(Failure::new(None, 7, false, now).blocks(7, now + ms(1_000_000)));
    }
}
