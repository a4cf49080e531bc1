//! The visible samples of a packet's rays, in the order in which they were blended: where accumulated
//! opacity crosses a level is looked up here, and no sample is read again.
//!
//! Spaces: sample numbers, and accumulated opacity.

use relief_lanes::{Lanes, Mask as _, Real as _};

/// The number of a sample before all samples.
const NO_SAMPLE: f64 = -2.0;

/// The visible samples of the rays of a packet.
pub(super) struct History<L: Lanes> {
    lanes: L,
    /// For each step the samples, [`NO_SAMPLE`] in rays without a visible one, and the opacity before.
    steps: Vec<[L::Real; 2]>,
}

/// The samples that take opacity to a level.
pub(super) struct Crossing<L: Lanes> {
    pub(super) k: L::Real,
    /// The opacity before the sample in front of it.
    pub(super) before: L::Real,
}

impl<L: Lanes> History<L> {
    /// Without samples. Its memory serves one packet after another.
    pub(super) fn new(lanes: L) -> Self {
        Self { lanes, steps: Vec::new() }
    }

    /// Forgets all samples.
    #[inline(always)]
    pub(super) fn clear(&mut self) {
        self.steps.clear();
    }

    /// Appends samples k, which are visible in the chosen lanes, and the opacity before them.
    #[inline(always)]
    pub(super) fn push(&mut self, k: L::Real, before: L::Real, shows: L::Mask) {
        self.steps.push([k.or_where_not(shows, self.lanes.splat(NO_SAMPLE)), before]);
    }

    /// The samples of the chosen rays that take opacity to `target`; rays end with `opacity`, which is
    /// no lower.
    #[inline(always)]
    pub(super) fn crossing(&self, opacity: L::Real, target: L::Real, chosen: L::Mask) -> Crossing<L> {
        let (zero, one) = (self.lanes.splat(0.0), self.lanes.splat(1.0));
        let mut crossing: Crossing<L> = Crossing { k: zero, before: zero };
        let mut last = [self.lanes.splat(NO_SAMPLE), zero];
        let mut open = chosen;
        for (at, &[k, before]) in self.steps.iter().enumerate() {
            let after = self.steps.get(at + 1).map_or(opacity, |&[_, after]| after);
            let shows = open & zero.le(k);
            let follows = (k - one).le(last[0]);
            let found = shows & target.le(after);
            crossing.k = k.or_where_not(found, crossing.k);
            crossing.before = last[1].or_where_not(follows, before).or_where_not(found, crossing.before);
            open = open & !found;
            if !open.any() {
                break;
            }
            last = [k.or_where_not(shows, last[0]), before.or_where_not(shows, last[1])];
        }
        crossing
    }
}
