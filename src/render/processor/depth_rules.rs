//! Depth rules that look at whole rays once more; as `shaders/lib/depth_rules.wgsl`.
//!
//! Spaces: mm along the rays. The weight of a sample is its contribution to accumulated opacity. A ray
//! is followed as far as the picture shows it: to the point where 1/512 of its light remains.

use relief_lanes::{Lanes, Mask as _, Real as _};

use super::super::request::DepthRule;
use super::composite::Gathered;
use super::crossing::BISECTIONS;
use super::ray::Rays;
use super::scene::{OPAQUE, Scene};
use super::walk::Walk;

/// As great as the greatest: samples inside one material differ by less than this share.
const AS_GREAT: f64 = 1.0 - 1.0 / 256.0;
/// An interval of accumulated opacity ends where its slope has fallen below this share of its
/// greatest, and then rises again by the same factor.
const SLOPE_SHARE: f64 = 0.5;
/// A layer ends where, once this opacity has accumulated, opacity falls below a share of its greatest.
const LAYER_OPACITY: f64 = 0.35;
const LAYER_END_SHARE: f64 = 0.125;

/// One step of rays: sample k, in the rays that have one, and those that take it; the others skip
/// empty space up to `next`.
struct Step<L: Lanes> {
    k: L::Real,
    next: L::Real,
    alive: L::Mask,
    opacity: L::Real,
}

/// Intervals of the curve of accumulated opacity, between two lowest points of its slope.
#[derive(Clone, Copy)]
struct Interval<R> {
    /// The first sample, and the opacity accumulated before it.
    start: R,
    before: R,
    /// The greatest weight.
    greatest: R,
    /// The rise of opacity.
    rise: R,
}

/// The first layer of rays.
pub(super) struct FrontLayer<L: Lanes> {
    /// The first sample behind it; the ray's number of samples where it reaches to the ray's end.
    pub(super) end: L::Real,
    /// The opacity accumulated in it.
    pub(super) opacity: L::Real,
}

impl<R: relief_lanes::Real> Interval<R> {
    #[inline(always)]
    fn or_where_not(self, mask: R::Mask, other: Self) -> Self {
        Self {
            start: self.start.or_where_not(mask, other.start),
            before: self.before.or_where_not(mask, other.before),
            greatest: self.greatest.or_where_not(mask, other.greatest),
            rise: self.rise.or_where_not(mask, other.rise),
        }
    }
}

impl<L: Lanes> Scene<'_, L> {
    /// The depth of the chosen rays, which end in `sum`, by a rule.
    #[inline(always)]
    pub(super) fn depth_by_rule(
        &self,
        rule: DepthRule,
        rays: &Rays<L>,
        walk: &Walk<L>,
        sum: &Gathered<'_, L>,
        chosen: L::Mask,
    ) -> L::Real {
        match rule {
            DepthRule::FirstHit => self.first_hit(rays, sum.first),
            DepthRule::Threshold { .. } | DepthRule::Views => {
                self.threshold_crossing(rays, sum, sum.total, chosen)
            }
            DepthRule::TwoLayer { .. } => {
                let opacity = self.front_layer(rays, walk, sum.first, chosen).opacity;
                self.threshold_crossing(rays, sum, opacity, chosen)
            }
            DepthRule::MaxOpacity => self.max_opacity(rays, walk, sum.first, chosen),
            DepthRule::MostContributing => self.most_contributing(rays, walk, sum.first, chosen),
            DepthRule::Expected => self.expected(rays, walk, sum.first, chosen),
            DepthRule::Wysiwyp => self.wysiwyp(rays, walk, sum.first, chosen),
        }
    }

    /// Sample k of the rays that are alive; opacity 0 where it is certain to be invisible.
    #[inline(always)]
    fn step(&self, rays: &Rays<L>, walk: &Walk<L>, k: L::Real, alive: L::Mask) -> Step<L> {
        let next = self.bricks.next_sample(walk, k);
        let taken = alive & !k.lt(next);
        let zero = self.number(0.0);
        let opacity = if taken.any() {
            self.lanes.apart(
                #[inline(always)]
                || self.sample_opacity(rays, k).or_where_not(taken, zero),
            )
        } else {
            zero
        };
        Step { k, next: next.max(k + self.number(1.0)), alive, opacity }
    }

    /// The place at which opacity comes up to `level` between the samples before numbers k and
    /// those, which reach it.
    #[inline(always)]
    fn level_crossing(&self, rays: &Rays<L>, k: L::Real, level: L::Real) -> L::Real {
        let half = self.number(0.5);
        let at_once = rays.entry.max(self.view.sample_t(rays, k - self.number(1.0)));
        let (mut outside, mut inside) = (at_once, self.view.sample_t(rays, k));
        let is_inside = level.le(self.opacity_at(rays, outside));
        for _ in 0..BISECTIONS {
            let middle = half * (outside + inside);
            let reaches = level.le(self.opacity_at(rays, middle));
            inside = middle.or_where_not(reaches, inside);
            outside = outside.or_where_not(reaches, middle);
        }
        at_once.or_where_not(is_inside, inside)
    }

    /// The place at which the weight comes up to `level`, from samples `start` on, before which
    /// `accumulated` has accumulated.
    #[inline(always)]
    fn weight_crossing(
        &self,
        rays: &Rays<L>,
        walk: &Walk<L>,
        start: L::Real,
        [mut accumulated, level]: [L::Real; 2],
        chosen: L::Mask,
    ) -> L::Real {
        let one = self.number(1.0);
        let count = self.view.sample_counts(rays);
        let (mut k, mut searching) = (start, chosen);
        loop {
            searching = searching & k.lt(count);
            if !searching.any() {
                break;
            }
            let step = self.step(rays, walk, k, searching);
            let weight = (one - accumulated) * step.opacity;
            searching = searching & weight.lt(level);
            accumulated = (accumulated + weight).or_where_not(searching, accumulated);
            k = step.next.or_where_not(searching, k);
        }
        self.level_crossing(rays, k.min(count - one), level / (one - accumulated))
    }

    /// Calls a function with each sample of the chosen rays as far as they are shown, the opacity
    /// accumulated before it and its weight.
    #[inline(always)]
    fn each_shown(
        &self,
        rays: &Rays<L>,
        walk: &Walk<L>,
        first: L::Real,
        chosen: L::Mask,
        mut shown: impl FnMut(&Step<L>, L::Real, L::Real),
    ) {
        let count = self.view.sample_counts(rays);
        let (mut k, mut accumulated) = (first, self.number(0.0));
        loop {
            let alive = chosen & k.lt(count) & accumulated.lt(self.number(OPAQUE));
            if !alive.any() {
                return;
            }
            let step = self.step(rays, walk, k, alive);
            let weight = (self.number(1.0) - accumulated) * step.opacity;
            shown(&step, accumulated, weight);
            accumulated = (accumulated + weight).or_where_not(alive, accumulated);
            k = step.next.or_where_not(alive, k);
        }
    }

    /// The place at which opacity first comes up to its greatest value, whatever lies before it.
    #[inline(always)]
    fn max_opacity(&self, rays: &Rays<L>, walk: &Walk<L>, first: L::Real, chosen: L::Mask) -> L::Real {
        let mut greatest = self.number(0.0);
        self.each_shown(
            rays,
            walk,
            first,
            chosen,
            #[inline(always)]
            |step, _, _| greatest = greatest.max(step.opacity).or_where_not(step.alive, greatest),
        );
        let level = greatest * self.number(AS_GREAT);
        let last = self.view.sample_counts(rays) - self.number(1.0);
        let (mut k, mut searching) = (first, chosen);
        loop {
            searching = searching & k.lt(last);
            if !searching.any() {
                break;
            }
            let step = self.step(rays, walk, k, searching);
            searching = searching & step.opacity.lt(level);
            k = step.next.or_where_not(searching, k);
        }
        self.level_crossing(rays, k.min(last), level)
    }

    /// The place at which the weight first comes up to its greatest value: the steepest rise of
    /// accumulated opacity.
    #[inline(always)]
    fn most_contributing(&self, rays: &Rays<L>, walk: &Walk<L>, first: L::Real, chosen: L::Mask) -> L::Real {
        let mut greatest = self.number(0.0);
        self.each_shown(
            rays,
            walk,
            first,
            chosen,
            #[inline(always)]
            |step, _, weight| greatest = greatest.max(weight).or_where_not(step.alive, greatest),
        );
        let level = greatest * self.number(AS_GREAT);
        self.weight_crossing(rays, walk, first, [self.number(0.0), level], chosen)
    }

    /// The mean of the samples' places by weight.
    #[inline(always)]
    fn expected(&self, rays: &Rays<L>, walk: &Walk<L>, first: L::Real, chosen: L::Mask) -> L::Real {
        let zero = self.number(0.0);
        let (mut sum, mut moment) = (zero, zero);
        self.each_shown(
            rays,
            walk,
            first,
            chosen,
            #[inline(always)]
            |step, _, weight| {
                let weight = weight.or_where_not(step.alive, zero);
                sum = sum + weight;
                moment = moment + weight * (step.k - first);
            },
        );
        let behind = moment / sum.max(self.number(1e-30)) * self.view.distance_mm();
        (self.view.sample_t(rays, first) + behind).clamped(rays.entry, rays.exit)
    }

    /// What you see is what you pick: the start of the interval with the largest rise of accumulated
    /// opacity.
    #[inline(always)]
    fn wysiwyp(&self, rays: &Rays<L>, walk: &Walk<L>, first: L::Real, chosen: L::Mask) -> L::Real {
        let (zero, share) = (self.number(0.0), self.number(SLOPE_SHARE));
        let begin = Interval { start: first, before: zero, greatest: zero, rise: zero };
        let (mut best, mut present, mut coming) = (begin, begin, begin);
        // The lowest weight since the present interval's greatest, behind which the next one may
        // begin.
        let (mut valley, mut falling, mut accumulated) = (zero, self.none(), zero);
        self.each_shown(
            rays,
            walk,
            first,
            chosen,
            #[inline(always)]
            |step, before, weight| {
                let rises = step.alive & falling & valley.lt(share * weight);
                let ended = Interval { rise: coming.before - present.before, ..present };
                best = ended.or_where_not(rises & best.rise.lt(ended.rise), best);
                present = coming.or_where_not(rises, present);
                falling = falling & !rises;
                let greatest = present.greatest.max(weight);
                present.greatest = greatest.or_where_not(step.alive, present.greatest);
                accumulated = (before + weight).or_where_not(step.alive, accumulated);
                let is_low = weight.lt(share * present.greatest) & (weight.lt(valley) | !falling);
                let falls = step.alive & is_low;
                falling = falling | falls;
                valley = weight.or_where_not(falls, valley);
                let next = Interval { start: step.next, before: accumulated, greatest: zero, rise: zero };
                coming = next.or_where_not(falls, coming);
            },
        );
        let ended = Interval { rise: accumulated - present.before, ..present };
        let best = ended.or_where_not(best.rise.lt(ended.rise), best);
        self.weight_crossing(rays, walk, best.start, [best.before, share * best.greatest], chosen)
    }

    /// The first layer ends where an object ends. The ray behind it is followed beyond the point where
    /// its light is used up.
    #[inline(always)]
    pub(super) fn front_layer(
        &self,
        rays: &Rays<L>,
        walk: &Walk<L>,
        first: L::Real,
        chosen: L::Mask,
    ) -> FrontLayer<L> {
        let number = |x: f64| self.number(x);
        let count = self.view.sample_counts(rays);
        let mut layer = FrontLayer { end: count, opacity: number(0.0) };
        let (mut greatest, mut k, mut inside) = (number(0.0), first, chosen);
        loop {
            inside = inside & k.lt(count);
            if !inside.any() {
                return layer;
            }
            let step = self.step(rays, walk, k, inside);
            let is_faint = step.opacity.lt(greatest * number(LAYER_END_SHARE));
            let ends = inside & is_faint & number(LAYER_OPACITY).le(layer.opacity);
            layer.end = k.or_where_not(ends, layer.end);
            inside = inside & !ends;
            greatest = greatest.max(step.opacity).or_where_not(inside, greatest);
            let grows = inside & layer.opacity.lt(number(OPAQUE));
            let more = layer.opacity + (number(1.0) - layer.opacity) * step.opacity;
            layer.opacity = more.or_where_not(grows, layer.opacity);
            k = step.next.or_where_not(inside, k);
        }
    }
}
