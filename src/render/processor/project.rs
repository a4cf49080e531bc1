//! Projections: a ray's samples become one value, unshaded; as `shaders/raycast/project.wgsl`.
//!
//! The extremes (MIP, MinIP) and the mean go through the transfer function; average and additive are
//! greys of their own. Values in HU, distances in mm along the rays. Opacities of the table are per
//! opacity unit, whatever the sample distance.

use relief_lanes::{Lanes, Mask as _, Real as _, Triple};

use super::super::mode::Mode;
use super::ray::Rays;
use super::scene::{Hit, Scene, VISIBLE};
use super::walk::Walk;

/// Bending below this, in HU per squared sample distance, is rounding.
pub(super) const FLAT_HU: f64 = 0.05;
/// Below every value of a volume, HU.
const BELOW_ALL_HU: f64 = -1e30;

impl<L: Lanes> Scene<'_, L> {
    #[inline(always)]
    pub(super) fn project(&self, rays: &Rays<L>, walk: &Walk<L>, chosen: L::Mask) -> Hit<L> {
        match self.request.mode {
            Mode::Mip => self.project_extreme(rays, walk, 1.0, chosen),
            // The smallest value is the largest of the negated ones.
            Mode::Minip => self.project_extreme(rays, walk, -1.0, chosen),
            _ => self.project_sum(rays, walk, chosen),
        }
    }

    /// Calls a function with each sample of the chosen rays that is not certain to be invisible, and
    /// the rays that have it.
    #[inline(always)]
    fn each_sample(
        &self,
        walk: &Walk<L>,
        count: L::Real,
        chosen: L::Mask,
        mut sample: impl FnMut(L::Real, L::Mask),
    ) {
        let (one, mut k) = (self.number(1.0), self.number(0.0));
        loop {
            let mut alive = chosen & k.lt(count);
            loop {
                if !alive.any() {
                    return;
                }
                let Some((next, skips)) = self.bricks.past_empty(walk, k, alive) else { break };
                k = next.or_where_not(skips, k);
                alive = chosen & k.lt(count);
            }
            sample(k, alive);
            k = k + one;
        }
    }

    /// The largest value along the rays, or the smallest, through the transfer function; its depth is
    /// where that value lies.
    #[inline(always)]
    fn project_extreme(&self, rays: &Rays<L>, walk: &Walk<L>, sign: f64, chosen: L::Mask) -> Hit<L> {
        let sign = self.number(sign);
        let count = self.view.sample_counts(rays);
        let (mut largest, mut at) = (self.number(BELOW_ALL_HU), self.number(0.0));
        self.each_sample(
            walk,
            count,
            chosen,
            #[inline(always)]
            |k, alive| {
                let p = rays.sample_voxel(k);
                let value = sign * self.field.hu(p);
                let mut is_larger = alive & largest.lt(value);
                if self.is_cut {
                    is_larger = is_larger & !rays.is_cut(self.view.sample_t(rays, k));
                }
                if self.segments.is_some() && is_larger.any() {
                    is_larger = is_larger & self.is_shown(p);
                }
                largest = value.or_where_not(is_larger, largest);
                at = k.or_where_not(is_larger, at);
            },
        );
        let found = chosen & self.number(BELOW_ALL_HU).lt(largest);
        if !found.any() {
            return self.miss();
        }
        let [r, g, b, opacity] = self.classify(rays.sample_voxel(at), sign * largest);
        let opacity = opacity.or_where_not(found, self.number(0.0));
        Hit {
            color: Triple([r, g, b]).scaled(opacity),
            opacity,
            hits: found & self.number(VISIBLE).le(opacity),
            t: self.peak_t(rays, at, largest, sign),
        }
    }

    /// The top of the parabola through the largest sample and its neighbours, at most half a sample
    /// away. Where values are all but linear, the sample itself.
    #[inline(always)]
    fn peak_t(&self, rays: &Rays<L>, at: L::Real, largest: L::Real, sign: L::Real) -> L::Real {
        let (t, distance) = (self.view.sample_t(rays, at), self.view.distance_mm());
        let before = sign * self.field.hu(rays.voxel_at(t - distance));
        let after = sign * self.field.hu(rays.voxel_at(t + distance));
        let top = t + self.top_offset([before, largest, after]) * distance;
        let top = top.clamped(rays.entry, rays.exit);
        if self.is_cut { t.or_where_not(rays.is_cut(top), top) } else { top }
    }

    /// The distance from the middle one of three values to the top of the parabola through them, in
    /// their distances; at most half.
    #[inline(always)]
    pub(super) fn top_offset(&self, [before, largest, after]: [L::Real; 3]) -> L::Real {
        let (zero, half, one) = (self.number(0.0), self.number(0.5), self.number(1.0));
        let curvature = before - largest * self.number(2.0) + after;
        let is_bent = curvature.lt(self.number(-FLAT_HU));
        let offset = half * (before - after) / curvature.or_where_not(is_bent, one);
        offset.clamped(-half, half).or_where_not(is_bent, zero)
    }

    /// The sum of the samples' shares: as the mean over all samples of the ray that the sphere does
    /// not hide, or per opacity unit of path. Its depth is the mean depth of the samples, each
    /// weighted by its share. Samples of empty bricks have no share.
    #[inline(always)]
    fn project_sum(&self, rays: &Rays<L>, walk: &Walk<L>, chosen: L::Mask) -> Hit<L> {
        let (zero, one) = (self.number(0.0), self.number(1.0));
        let count = self.view.sample_counts(rays);
        let [hidden, hidden_end] = self.hidden_samples(rays);
        let hidden_count = (hidden_end.clamped(zero, count) - hidden.clamped(zero, count)).max(zero);
        let is_mean = self.request.mode == Mode::Mean;
        let (mut sum, mut moment) = (zero, zero);
        self.each_sample(
            walk,
            count,
            chosen,
            #[inline(always)]
            |k, alive| {
                let hu = self.field.hu(rays.sample_voxel(k));
                let brightness = self.brightness_of(hu);
                let share = if is_mean { brightness } else { self.colors.opacity(hu) * brightness };
                let is_hidden = hidden.le(k) & k.lt(hidden_end);
                let share = share.or_where_not(alive & !is_hidden, zero);
                sum = sum + share;
                moment = moment + share * k;
            },
        );
        let shown_count = count - hidden_count;
        let has_samples = chosen & zero.lt(shown_count);
        let [r, g, b, opacity] = self.color_of_sum(sum, one.or_where_not(!has_samples, shown_count));
        // A grey is opaque even where it is black.
        let shown = if is_mean { opacity } else { r };
        let is_bright = zero.lt(sum);
        let middle = self.number(0.5) * (count - one);
        let k = (moment / sum.or_where_not(is_bright, one)).or_where_not(is_bright, middle);
        let nothing = Triple::of(zero);
        Hit {
            color: Triple([r, g, b]).or_where_not([has_samples; 3], nothing),
            opacity: opacity.or_where_not(has_samples, zero),
            hits: has_samples & self.number(VISIBLE).le(shown),
            t: self.view.sample_t(rays, k).clamped(rays.entry, rays.exit),
        }
    }

    /// The first sample that the sphere hides, and the first one behind those.
    #[inline(always)]
    fn hidden_samples(&self, rays: &Rays<L>) -> [L::Real; 2] {
        let [cut_in, cut_out] = rays.cut;
        let distance = self.view.distance_mm();
        let first = ((cut_in - rays.first) / distance).floor() + self.number(1.0);
        [first, ((cut_out - rays.first) / distance).ceil()]
    }

    /// How bright values are: 0 for the volume's smallest, 1 for its largest.
    #[inline(always)]
    fn brightness_of(&self, hu: L::Real) -> L::Real {
        let [lowest, span] = self.brightness;
        ((hu - lowest) / span).clamped(self.number(0.0), self.number(1.0))
    }

    /// Premultiplied colour and opacity.
    #[inline(always)]
    fn color_of_sum(&self, sum: L::Real, count: L::Real) -> [L::Real; 4] {
        let one = self.number(1.0);
        let mean = sum / count;
        match self.request.mode {
            Mode::Additive => {
                let request = self.request;
                let units = request.sample_distance_mm / request.transfer.opacity_unit_mm();
                let grey = (sum * self.number(units)).min(one);
                [grey, grey, grey, one]
            }
            Mode::Mean => {
                let [lowest, span] = self.brightness;
                let hu = lowest + mean * span;
                let opacity = self.colors.opacity(hu);
                let Triple([r, g, b]) = self.colors.rgb(hu).scaled(opacity);
                [r, g, b, opacity]
            }
            _ => [mean, mean, mean, one],
        }
    }
}
