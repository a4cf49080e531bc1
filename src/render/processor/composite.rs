//! Samples of rays blended front to back; as `shaders/raycast.wgsl` in mode composite.
//!
//! Opacities are blended at once, because they end rays. Visible samples are collected, and a full
//! vector of them is lit at a time. [`Blend`] says what a sample is: [`Plain`] ones have a value
//! alone, [`Classified`] ones a segment, opacity by gradient or placed lights too, and [`Paths`] the
//! values along a path.

use relief_lanes::{Lanes, Mask as _, Real as _, Triple};

use super::super::request::DepthRule;
use super::face_zone::FaceZone;
use super::history::History;
use super::passage::rgb;
use super::pending::Pending;
use super::ray::Rays;
use super::scene::{Hit, OPAQUE, Scene, VISIBLE};
use super::walk::Walk;

/// Half of a pre-integrated sample that adds less than this share of it is lit like the other half.
const LITTLE: f64 = 0.125;

/// The result of rays.
pub(super) struct Gathered<'h, L: Lanes> {
    /// Premultiplied.
    pub(super) color: Triple<L::Real>,
    pub(super) opacity: L::Real,
    /// The same with the face that ends the rays.
    pub(super) total: L::Real,
    /// The first visible sample.
    pub(super) first: L::Real,
    /// The visible samples.
    pub(super) history: &'h mut History<L>,
}

/// The kind of samples. Waiting ones have N components.
pub(super) trait Blend<L: Lanes, const N: usize> {
    /// Adds samples k of the chosen rays behind those before, with the zone behind their faces; says
    /// whether any of them is visible.
    fn gather(
        scene: &Scene<'_, L>,
        sum: &mut Gathered<'_, L>,
        pending: &mut Pending<L, N>,
        at: (&Rays<L>, &FaceZone<L>),
        k: L::Real,
        chosen: L::Mask,
    ) -> bool;

    /// Colours before light, positions and weights of waiting samples.
    fn waiting(scene: &Scene<'_, L>, sample: [L::Real; N]) -> Waiting<L>;

    /// Lit colours of samples, seen along `direction`; `p` is a position to read the gradient at, and
    /// `turn` gives the direction that lights them for a gradient.
    #[inline(always)]
    fn lit(
        scene: &Scene<'_, L>,
        rgb: Triple<L::Real>,
        direction: Triple<L::Real>,
        p: Triple<L::Real>,
        turn: impl FnOnce(Triple<L::Real>) -> Triple<L::Real>,
    ) -> Triple<L::Real> {
        scene.lights.lit(&scene.field, rgb, direction, p, turn)
    }
}

/// Samples that are to be lit.
pub(super) struct Waiting<L: Lanes> {
    rgb: Triple<L::Real>,
    p: Triple<L::Real>,
    /// Negative in the zone behind a face.
    weight: L::Real,
}

/// Values alone, under the headlight.
pub(super) struct Plain;
/// Values and places.
pub(super) struct Classified;
/// Paths of pre-integrated samples.
pub(super) struct Paths;

impl<L: Lanes> Scene<'_, L> {
    /// Casts the chosen rays. Where the request has a back layer, also casts what lies behind the first
    /// layer, as if that were absent.
    #[inline(always)]
    pub(super) fn layers(
        &self,
        rays: &Rays<L>,
        walk: &Walk<L>,
        history: &mut History<L>,
        mut chosen: L::Mask,
    ) -> (Hit<L>, Option<Hit<L>>) {
        let painted = self.painted_faces(rays, chosen);
        let (mut start, mut rule, mut front) = (self.number(0.0), self.request.depth, None);
        loop {
            // One call for both layers: it is inlined, and a second copy would take as long to compile.
            let faces = painted.as_ref().filter(|_| front.is_none());
            // A value, not one of two references: it stays in registers.
            let (exit, on) = match faces {
                Some(faces) => (faces.exit(rays, self.view.distance_mm()), faces.on),
                None => (rays.exit, self.none()),
            };
            let (hit, first) =
                self.composite(&rays.ending_at(exit), walk, start, rule, history, (chosen, on));
            let hit = match faces {
                Some(faces) => faces.paint(&hit, self.number(1.0)),
                None => hit,
            };
            chosen = chosen & !on; // behind a painted face there is nothing
            if let Some(front) = front {
                return (front, Some(hit));
            }
            if !self.request.has_back_layer() {
                return (hit, None);
            }
            (start, chosen) = self.behind(rays, walk, first, chosen & self.number(0.0).lt(hit.opacity));
            if !chosen.any() {
                return (hit, Some(self.miss()));
            }
            rule = DepthRule::Threshold { fraction: self.request.depth.fraction().unwrap_or(0.0) };
            front = Some(hit);
        }
    }

    /// The samples behind the first layer, and the chosen rays that have some; `first` are the first
    /// visible samples.
    #[inline(always)]
    fn behind(&self, rays: &Rays<L>, walk: &Walk<L>, first: L::Real, chosen: L::Mask) -> (L::Real, L::Mask) {
        let end = self.lanes.apart(
            #[inline(always)]
            || self.front_layer(rays, walk, first, chosen).end,
        );
        (end, chosen & end.lt(self.view.sample_counts(rays)))
    }

    /// Casts the chosen rays from samples `start` on; the depth is by `rule`. `history` gets their
    /// visible samples. In lanes of the second mask an opaque face ends the ray; they have a depth
    /// only where it is before the face. Returns the first visible samples too.
    #[inline(always)]
    fn composite(
        &self,
        rays: &Rays<L>,
        walk: &Walk<L>,
        start: L::Real,
        rule: DepthRule,
        history: &mut History<L>,
        (chosen, painted): (L::Mask, L::Mask),
    ) -> (Hit<L>, L::Real) {
        let count = self.view.sample_counts(rays);
        let (start, chosen) = self.past_empty(walk, start, chosen & start.lt(count), count);
        if !chosen.any() {
            return (self.miss(), count);
        }
        history.clear();
        let mut sum = if self.is_plain() {
            self.lanes.apart(
                #[inline(always)]
                || self.blend::<Plain, 5>(rays, walk, start, history, chosen),
            )
        } else if self.integrals.is_some() {
            self.lanes.apart(
                #[inline(always)]
                || self.blend::<Paths, 7>(rays, walk, start, history, chosen),
            )
        } else {
            self.lanes.apart(
                #[inline(always)]
                || self.blend::<Classified, 5>(rays, walk, start, history, chosen),
            )
        };
        sum.total = self.number(1.0).or_where_not(painted, sum.opacity);
        let is_face = painted & sum.opacity.lt(self.depth_fraction * self.number(OPAQUE));
        let hits = chosen & !is_face & self.number(VISIBLE).le(sum.opacity);
        let mut t = self.view.sample_t(rays, sum.first);
        if hits.any() && self.request.applies_depth_rule() {
            t = self.lanes.apart(
                #[inline(always)]
                || self.depth_by_rule(rule, rays, walk, &sum, hits),
            );
        }
        (Hit { color: sum.color, opacity: sum.opacity, hits, t }, sum.first)
    }

    /// Blends all samples of the chosen rays from samples `start` on.
    #[inline(always)]
    fn blend<'h, B: Blend<L, N>, const N: usize>(
        &self,
        rays: &Rays<L>,
        walk: &Walk<L>,
        start: L::Real,
        history: &'h mut History<L>,
        chosen: L::Mask,
    ) -> Gathered<'h, L> {
        let (zero, one, opaque) = (self.number(0.0), self.number(1.0), self.number(OPAQUE));
        let count = self.view.sample_counts(rays);
        let mut sum: Gathered<'h, L> =
            Gathered { color: Triple([zero; 3]), opacity: zero, total: zero, first: count, history };
        let mut pending = Pending::new(self.lanes, rays);
        let zone = self.face_zone(rays);
        let mut k = start;
        let mut has_shown = false;
        loop {
            let mut alive = chosen & k.lt(count) & sum.opacity.lt(opaque);
            if !alive.any() {
                break;
            }
            // Until no ray is in an empty brick, so that samples are taken for all. Behind visible samples
            // others are likely: a look would cost more than samples that are taken in vain.
            if !has_shown {
                (k, alive) = self.past_empty(walk, k, alive, count);
            }
            // Two samples for each look at the bricks: the second is taken in vain now and then, but
            // shows nothing then.
            has_shown = false;
            for _ in 0..2 {
                let taken = alive & k.lt(count) & sum.opacity.lt(opaque);
                has_shown |= B::gather(self, &mut sum, &mut pending, (rays, &zone), k, taken);
                while pending.len >= L::COUNT {
                    self.light_pending::<B, N>(&mut pending, &zone);
                }
                k = (k + one).or_where_not(alive, k);
            }
        }
        while pending.len > 0 {
            self.light_pending::<B, N>(&mut pending, &zone);
        }
        sum.color = pending.colors();
        sum
    }

    /// The first samples of the chosen rays from k on that are not certain to be invisible, and the
    /// rays that have some.
    #[inline(always)]
    fn past_empty(
        &self,
        walk: &Walk<L>,
        mut k: L::Real,
        mut chosen: L::Mask,
        count: L::Real,
    ) -> (L::Real, L::Mask) {
        while let Some((next, skips)) = self.bricks.past_empty(walk, k, chosen) {
            k = next.or_where_not(skips, k);
            chosen = chosen & k.lt(count);
        }
        (k, chosen)
    }

    /// Lights the oldest pending samples, one in each lane.
    #[inline(always)]
    fn light_pending<B: Blend<L, N>, const N: usize>(&self, pending: &mut Pending<L, N>, zone: &FaceZone<L>) {
        let (sample, direction) = pending.front();
        let Waiting { rgb, p, weight } = B::waiting(self, sample);
        // Lanes without a sample read the middle of the volume: cells at its edges are slow.
        let is_sample = self.lanes.first(pending.len);
        let p = p.or_where_not([is_sample; 3], self.field.middle());
        let marked = is_sample & weight.lt(self.number(0.0));
        // After the gradients: they take most registers.
        let lit = B::lit(
            self,
            rgb,
            direction,
            p,
            #[inline(always)]
            |gradient| self.turned(zone, pending, [p, direction, gradient], marked),
        );
        pending.add(lit.scaled(weight.abs()));
    }

    /// The lanes in which samples k with these values may be visible.
    #[inline(always)]
    fn may_show(&self, rays: &Rays<L>, k: L::Real, hu: L::Real, chosen: L::Mask) -> L::Mask {
        let shows = chosen & self.colors.lowest_visible_hu.le(hu);
        if self.is_cut { shows & !rays.is_cut(self.view.sample_t(rays, k)) } else { shows }
    }
}

impl<L: Lanes> Blend<L, 5> for Plain {
    #[inline(always)]
    fn gather(
        scene: &Scene<'_, L>,
        sum: &mut Gathered<'_, L>,
        pending: &mut Pending<L, 5>,
        (rays, zone): (&Rays<L>, &FaceZone<L>),
        k: L::Real,
        chosen: L::Mask,
    ) -> bool {
        let p = rays.sample_voxel(k);
        let hu = scene.field.hu(p);
        let shows = scene.may_show(rays, k, hu, chosen);
        if !shows.any() {
            return false;
        }
        let opacity = scene.colors.opacity(hu);
        let shows = shows & scene.number(0.0).lt(opacity);
        if !shows.any() {
            return false;
        }
        let weight = sum.add(scene, k, opacity, shows);
        let weight = zone.marked(k, weight);
        pending.push([p.0[0], p.0[1], p.0[2], hu, weight], shows);
        true
    }

    #[inline(always)]
    fn waiting(scene: &Scene<'_, L>, [x, y, z, hu, weight]: [L::Real; 5]) -> Waiting<L> {
        Waiting { rgb: scene.colors.rgb(hu), p: Triple([x, y, z]), weight }
    }

    #[inline(always)]
    fn lit(
        scene: &Scene<'_, L>,
        rgb: Triple<L::Real>,
        direction: Triple<L::Real>,
        p: Triple<L::Real>,
        turn: impl FnOnce(Triple<L::Real>) -> Triple<L::Real>,
    ) -> Triple<L::Real> {
        let head = scene.lights.head();
        if head.needs_gradient {
            head.lit(rgb, turn(scene.field.gradient(p)), direction)
        } else {
            head.ambient(rgb)
        }
    }
}

impl<L: Lanes> Blend<L, 5> for Classified {
    #[inline(always)]
    fn gather(
        scene: &Scene<'_, L>,
        sum: &mut Gathered<'_, L>,
        pending: &mut Pending<L, 5>,
        (rays, zone): (&Rays<L>, &FaceZone<L>),
        k: L::Real,
        chosen: L::Mask,
    ) -> bool {
        let p = rays.sample_voxel(k);
        let hu = scene.field.hu(p);
        let shows = scene.may_show(rays, k, hu, chosen);
        if !shows.any() {
            return false;
        }
        let opacity = scene.opacity_from(p, [hu, scene.factor_at(p)]);
        let shows = shows & scene.number(0.0).lt(opacity);
        if !shows.any() {
            return false;
        }
        let weight = sum.add(scene, k, opacity, shows);
        let weight = zone.marked(k, weight);
        pending.push([p.0[0], p.0[1], p.0[2], hu, weight], shows);
        true
    }

    #[inline(always)]
    fn waiting(scene: &Scene<'_, L>, [x, y, z, hu, weight]: [L::Real; 5]) -> Waiting<L> {
        let p = Triple([x, y, z]);
        Waiting { rgb: rgb(scene.classify(p, hu)), p, weight }
    }
}

impl<L: Lanes> Blend<L, 7> for Paths {
    #[inline(always)]
    fn gather(
        scene: &Scene<'_, L>,
        sum: &mut Gathered<'_, L>,
        pending: &mut Pending<L, 7>,
        (rays, zone): (&Rays<L>, &FaceZone<L>),
        k: L::Real,
        chosen: L::Mask,
    ) -> bool {
        let Some(integrals) = &scene.integrals else { return false };
        let passage = scene.passage(rays, k);
        let highest = passage[0].max(passage[1]).max(passage[2]);
        let shows = scene.may_show(rays, k, highest, chosen);
        if !shows.any() {
            return false;
        }
        let passed = integrals.passed(passage);
        let opacity = passed.opacity();
        let shows = shows & scene.number(0.0).lt(opacity);
        if !shows.any() {
            return false;
        }
        let before = sum.opacity;
        let _ = sum.add(scene, k, opacity, shows);
        let left = scene.number(1.0) - before;
        let (quarter, little) = (scene.number(0.25), opacity * scene.number(LITTLE));
        let (front, back) = (passed.front, passed.back);
        let front_place = quarter.or_where_not(front[3].lt(little), -quarter);
        let back_place = (-quarter).or_where_not(back[3].lt(little), quarter);
        for (half, place) in [(front, front_place), (back, back_place)] {
            let Triple([x, y, z]) = rays.sample_voxel(k + place);
            let [r, g, b, added] = half;
            pending.push([x, y, z, r, g, b, zone.marked(k, left * added)], shows);
        }
        true
    }

    #[inline(always)]
    fn waiting(_scene: &Scene<'_, L>, [x, y, z, r, g, b, weight]: [L::Real; 7]) -> Waiting<L> {
        Waiting { rgb: Triple([r, g, b]), p: Triple([x, y, z]), weight }
    }
}

impl<L: Lanes> Gathered<'_, L> {
    /// Blends samples k of these opacities, which are visible in the chosen lanes; returns their
    /// weights.
    #[inline(always)]
    fn add(&mut self, scene: &Scene<'_, L>, k: L::Real, opacity: L::Real, shows: L::Mask) -> L::Real {
        let before = self.opacity;
        let weight = (scene.number(1.0) - before) * opacity;
        self.first = self.first.min(k).or_where_not(shows, self.first);
        self.history.push(k, before, shows);
        self.opacity = (before + weight).or_where_not(shows, before);
        weight
    }
}
