//! Samples of rays blended front to back; as `shaders/raycast.wgsl` in mode composite.
//!
//! Opacities are blended at once, because they end rays. Colours need gradients, which are slow:
//! visible samples are collected, and a full vector of them is lit at a time.

use relief_lanes::{Lanes, Mask as _, Real as _, Triple};

use super::color::{Colors, Headlight};
use super::field::Field;
use super::ray::{Rays, View};
use super::walk::{Bricks, Walk};

/// Opacity at which a ray ends.
pub(super) const OPAQUE: f64 = 1.0 - 1.0 / 512.0;
/// A ray that changes no byte of the picture hits nothing.
pub(super) const VISIBLE: f64 = 0.5 / 255.0;
/// The number of a sample before all samples.
const NO_SAMPLE: f64 = -2.0;
/// Most lanes that there are.
const MOST_LANES: usize = 8;

/// Everything about a picture that rays look up.
pub(super) struct Scene<'a, L: Lanes> {
    pub(super) lanes: L,
    pub(super) view: View<L>,
    pub(super) field: Field<'a, L>,
    pub(super) bricks: Bricks<'a, L>,
    pub(super) colors: Colors<'a, L>,
    pub(super) light: Headlight<L>,
    /// The share of a ray's opacity at which its depth lies, by rule `threshold`.
    pub(super) depth_fraction: L::Real,
    pub(super) is_cut: bool,
}

/// The result of rays.
pub(super) struct Gathered<L: Lanes> {
    /// Premultiplied.
    pub(super) color: Triple<L::Real>,
    pub(super) opacity: L::Real,
    /// The first visible sample.
    pub(super) first: L::Real,
    /// The last visible sample, and the opacity before it.
    last: L::Real,
    before_last: L::Real,
    /// The sample that takes opacity to the threshold of an opaque ray, and the opacity before the
    /// one before it and before itself.
    pub(super) crossing: L::Real,
    pub(super) before_crossing: [L::Real; 2],
}

impl<L: Lanes> Scene<'_, L> {
    /// Blends all samples of the chosen rays.
    #[inline(always)]
    pub(super) fn composite(&self, rays: &Rays<L>, walk: &Walk<L>, chosen: L::Mask) -> Gathered<L> {
        let number = |x: f64| self.lanes.splat(x);
        let (zero, one, opaque) = (number(0.0), number(1.0), number(OPAQUE));
        let count = self.view.sample_counts(rays);
        let mut sum: Gathered<L> = Gathered {
            color: Triple([zero; 3]),
            opacity: zero,
            first: count,
            last: number(NO_SAMPLE),
            before_last: zero,
            crossing: count,
            before_crossing: [zero; 2],
        };
        let mut pending = Pending::new(self.lanes, rays);
        let mut k = zero;
        loop {
            let mut alive = chosen & k.lt(count) & sum.opacity.lt(opaque);
            if !alive.any() {
                break;
            }
            // Until no ray is in an empty brick, so that samples are taken for all.
            loop {
                let next = self.bricks.next_sample(walk, k);
                let Some(skips) = Bricks::<L>::skipping(k, next, alive) else { break };
                k = next.or_where_not(skips, k);
                alive = alive & k.lt(count);
            }
            // Two samples for each look at the bricks: the second is taken in vain now and then, but
            // shows nothing then.
            for _ in 0..2 {
                self.gather(&mut sum, &mut pending, rays, k, alive & k.lt(count));
                k = (k + one).or_where_not(alive, k);
            }
        }
        while pending.len > 0 {
            self.light_pending(&mut pending);
        }
        sum.color = pending.colors();
        sum
    }

    /// Adds samples k behind those before.
    #[inline(always)]
    fn gather(
        &self,
        sum: &mut Gathered<L>,
        pending: &mut Pending<L>,
        rays: &Rays<L>,
        k: L::Real,
        chosen: L::Mask,
    ) {
        let number = |x: f64| self.lanes.splat(x);
        let p = rays.sample_voxel(k);
        let hu = self.field.hu(p);
        let mut shows = chosen & self.colors.lowest_visible_hu.le(hu) & sum.opacity.lt(number(OPAQUE));
        if self.is_cut {
            shows = shows & !rays.is_cut(self.view.sample_t(rays, k));
        }
        if !shows.any() {
            return;
        }
        let opacity = self.colors.opacity(hu);
        let shows = shows & number(0.0).lt(opacity);
        if !shows.any() {
            return;
        }
        let before = sum.opacity;
        let weight = (number(1.0) - before) * opacity;
        sum.note(self, k, shows);
        sum.opacity = (before + weight).or_where_not(shows, before);
        pending.push([p.0[0], p.0[1], p.0[2], hu, weight], shows);
        if pending.len >= L::COUNT {
            self.light_pending(pending);
        }
    }

    /// Lights the oldest pending samples, one in each lane.
    #[inline(always)]
    fn light_pending(&self, pending: &mut Pending<L>) {
        let ([x, y, z, hu, weight], direction) = pending.front();
        let rgb = self.colors.rgb(hu);
        // Lanes without a sample read the middle of the volume: cells at its edges are slow.
        let is_sample = self.lanes.first(pending.len);
        let p = Triple([x, y, z]).or_where_not([is_sample; 3], self.field.middle());
        let lit = if self.light.needs_gradient {
            self.light.lit(rgb, self.field.gradient(p), direction)
        } else {
            self.light.ambient(rgb)
        };
        pending.add(lit.scaled(weight));
    }
}

impl<L: Lanes> Gathered<L> {
    /// Notes samples k, which are visible in the chosen lanes, before they are blended.
    #[inline(always)]
    fn note(&mut self, scene: &Scene<'_, L>, k: L::Real, shows: L::Mask) {
        let number = |x: f64| scene.lanes.splat(x);
        let before = self.opacity;
        self.first = self.first.min(k).or_where_not(shows, self.first);
        let is_early = shows & before.lt(scene.depth_fraction * number(OPAQUE));
        let follows = (k - number(1.0)).le(self.last);
        let before_both = self.before_last.or_where_not(follows, before);
        self.crossing = k.or_where_not(is_early, self.crossing);
        self.before_crossing = [
            before_both.or_where_not(is_early, self.before_crossing[0]),
            before.or_where_not(is_early, self.before_crossing[1]),
        ];
        self.last = k.or_where_not(shows, self.last);
        self.before_last = before.or_where_not(shows, self.before_last);
    }
}

/// Visible samples that are not lit yet, and the colours of those that are.
struct Pending<L: Lanes> {
    lanes: L,
    /// Positions along i, j, k; values; and weights.
    samples: [[L::Scalar; 3 * MOST_LANES]; 5],
    /// The lanes of their rays.
    rays: [u8; 3 * MOST_LANES],
    len: usize,
    directions: [[L::Scalar; MOST_LANES]; 3],
    sums: [[L::Scalar; MOST_LANES]; 3],
}

impl<L: Lanes> Pending<L> {
    #[inline(always)]
    fn new(lanes: L, rays: &Rays<L>) -> Self {
        let zero = lanes.scalar(0.0);
        let mut directions = [[zero; MOST_LANES]; 3];
        rays.direction.0[0].store(&mut directions[0]);
        rays.direction.0[1].store(&mut directions[1]);
        rays.direction.0[2].store(&mut directions[2]);
        let samples = [[zero; 3 * MOST_LANES]; 5];
        let (rays, sums) = ([0; 3 * MOST_LANES], [[zero; MOST_LANES]; 3]);
        Self { lanes, samples, rays, len: 0, directions, sums }
    }

    /// Appends the samples of the chosen lanes. Fewer than there are lanes wait.
    #[inline(always)]
    fn push(&mut self, sample: [L::Real; 5], chosen: L::Mask) {
        let [x, y, z, hu, weight] = sample;
        let [xs, ys, zs, values, weights] = &mut self.samples;
        self.lanes.gathered(x, chosen).store(&mut xs[self.len..]);
        self.lanes.gathered(y, chosen).store(&mut ys[self.len..]);
        self.lanes.gathered(z, chosen).store(&mut zs[self.len..]);
        self.lanes.gathered(hu, chosen).store(&mut values[self.len..]);
        self.lanes.gathered(weight, chosen).store(&mut weights[self.len..]);
        let mut bits = chosen.bits();
        while bits != 0 {
            self.rays[self.len] = bits.trailing_zeros() as u8;
            self.len += 1;
            bits &= bits - 1;
        }
    }

    /// The first samples, one in each lane, and the directions of their rays. Lanes beyond those
    /// that wait hold older samples.
    #[inline(always)]
    fn front(&self) -> ([L::Real; 5], Triple<L::Real>) {
        let load = |component: usize| self.lanes.load(&self.samples[component]);
        let along = |axis: usize| self.lanes.chosen(&self.directions[axis], &self.rays);
        ([load(0), load(1), load(2), load(3), load(4)], Triple([along(0), along(1), along(2)]))
    }

    /// Adds the light of the first samples to their rays, and forgets them.
    #[inline(always)]
    fn add(&mut self, light: Triple<L::Real>) {
        let done = self.len.min(L::COUNT);
        let mut shares = [[self.lanes.scalar(0.0); MOST_LANES]; 3];
        light.0[0].store(&mut shares[0]);
        light.0[1].store(&mut shares[1]);
        light.0[2].store(&mut shares[2]);
        for (sums, shares) in self.sums.iter_mut().zip(&shares) {
            for (share, &ray) in shares[..done].iter().zip(&self.rays) {
                let sum = &mut sums[usize::from(ray) % MOST_LANES];
                *sum = *sum + *share;
            }
        }
        self.len -= done;
        if self.len > 0 {
            for component in &mut self.samples {
                self.lanes.load(&component[L::COUNT..]).store(component);
            }
            for i in 0..self.len {
                self.rays[i] = self.rays[i + L::COUNT];
            }
        }
    }

    /// The colours of the rays.
    #[inline(always)]
    fn colors(&self) -> Triple<L::Real> {
        let [red, green, blue] = &self.sums;
        Triple([self.lanes.load(red), self.lanes.load(green), self.lanes.load(blue)])
    }
}
