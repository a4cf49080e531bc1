//! The depth of rays between samples, by the rules `first-hit` and `threshold`; as
//! `shaders/raycast/crossing.wgsl`.
//!
//! Spaces: mm along the rays.

use relief_lanes::{Lanes, Mask as _, Real as _};

use super::composite::Gathered;
use super::history::Crossing;
use super::ray::Rays;
use super::scene::Scene;

/// Parts into which each level divides the neighbourhood of a crossing.
const PARTS: usize = 4;
/// Levels of parts.
const LEVELS: usize = 3;
/// Halvings of the interval in which a ray becomes visible.
pub(super) const BISECTIONS: usize = 12;
/// Parts of a pre-integrated sample's path in which something visible is looked for.
const PATH_PARTS: usize = 16;

/// A search part by part, that each lane ends at its crossing or behind its last part.
struct Search<L: Lanes> {
    parts: L::Real,
    chosen: L::Mask,
    found: L::Mask,
    /// The part that holds the crossing; the number of parts where none does.
    part: L::Real,
    /// Opacity before the part before it, and before it.
    settled: L::Real,
    accumulated: L::Real,
    /// Opacity of the part that was looked at last.
    opacity: L::Real,
}

impl<L: Lanes> Scene<'_, L> {
    /// The place at which opacity leaves zero between the sample before the first visible one and
    /// that one.
    #[inline(always)]
    pub(super) fn first_hit(&self, rays: &Rays<L>, first: L::Real) -> L::Real {
        let (zero, half) = (self.number(0.0), self.number(0.5));
        let mut outside = rays.entry.max(self.view.sample_t(rays, first - self.number(1.0)));
        let mut inside = self.view.sample_t(rays, first);
        if self.integrals.is_some() {
            // A pre-integrated sample may be visible anywhere on its path.
            let part = self.view.distance_mm() / self.number(PATH_PARTS as f64);
            outside = rays.entry.max(self.view.sample_t(rays, first - half));
            inside = outside;
            for _ in 0..PATH_PARTS {
                let is_invisible = self.opacity_at(rays, inside).le(zero);
                outside = inside.or_where_not(is_invisible, outside);
                inside = (inside + part).min(rays.exit).or_where_not(is_invisible, inside);
            }
        }
        let is_inside = zero.lt(self.opacity_at(rays, outside));
        let at_once = outside;
        for _ in 0..BISECTIONS {
            let middle = half * (outside + inside);
            let is_visible = zero.lt(self.opacity_at(rays, middle));
            inside = middle.or_where_not(is_visible, inside);
            outside = outside.or_where_not(is_visible, middle);
        }
        at_once.or_where_not(is_inside, inside)
    }

    /// The place at which accumulated opacity crosses its share of `opacity`: first the sample
    /// whose slab holds the crossing, then finer and finer parts of that slab and of the one before
    /// it.
    #[inline(always)]
    pub(super) fn threshold_crossing(
        &self,
        rays: &Rays<L>,
        sum: &Gathered<'_, L>,
        opacity: L::Real,
        chosen: L::Mask,
    ) -> L::Real {
        let (zero, one) = (self.number(0.0), self.number(1.0));
        // Opacities of a layer are read anew and may be rounded otherwise.
        let target = (self.depth_fraction * opacity).min(sum.opacity);
        let Crossing { k, before } = sum.history.crossing(sum.opacity, target, chosen);
        let start = (k - one).max(zero);
        let mut begin = self.view.sample_t(rays, start - self.number(0.5));
        let mut slabs = k - start + one;
        let is_first = chosen & start.le(zero);
        if is_first.any() {
            // A cut face: the tissue between it and the first sample counts, so that the depth is
            // the face's.
            let is_face = is_first & zero.lt(self.opacity_at(rays, rays.entry));
            begin = rays.entry.or_where_not(is_face, begin);
            slabs = (slabs + one).or_where_not(is_face, slabs);
        }
        self.refine_crossing(rays, begin, slabs, [before, target], chosen)
    }

    /// The crossing within `slabs` sample distances, one to three, from `begin` (mm) on; with the
    /// opacity before it, and the one that is crossed.
    ///
    /// The inputs of opacity are read every quarter of a sample distance and are linear between: finer
    /// parts read nothing.
    #[inline(always)]
    fn refine_crossing(
        &self,
        rays: &Rays<L>,
        begin: L::Real,
        slabs: L::Real,
        [before, target]: [L::Real; 2],
        chosen: L::Mask,
    ) -> L::Real {
        let number = |x: f64| self.number(x);
        let (zero, one) = (number(0.0), number(1.0));
        let part = self.view.distance_mm() / number(PARTS as f64);
        let end_of = |j: f64| begin + number(j) * part;
        // Inputs at the ends of the part before, and of the part that holds the crossing.
        let nothing = [zero; 2];
        let (mut early, mut middle) = (nothing, nothing);
        let mut late = self.opacity_basis(rays.voxel_at(begin));
        let mut this_middle = late;
        let mut search = self.search(slabs * number(PARTS as f64), before, chosen);
        for j in 0..3 * PARTS {
            if !search.open().any() {
                break;
            }
            let this = this_middle;
            this_middle = self.opacity_basis(rays.voxel_at(end_of((j + 1) as f64)));
            let t = end_of(j as f64 + 0.5);
            let open = search.open();
            let opacity = self.shown_opacity(rays, t, between(this, this_middle, number(0.5)));
            early = chosen_of(open, middle, early);
            middle = chosen_of(open, this, middle);
            late = chosen_of(open, this_middle, late);
            search.look(self, j, part_opacity(self, opacity, 1), target);
        }
        let is_missed = chosen & !search.found;
        let at_end = begin + slabs * self.view.distance_mm();
        // Positions from here on in parts, from the start of the part before; the first has none.
        let origin = begin + (search.part - one) * part;
        let mut start = one.or_where_not(search.part.lt(number(0.5)), zero);
        let mut span = (search.part + one).min(number(2.0));
        let mut settled = search.settled;
        let (mut size, mut s, mut open) = (1.0, start, search.found);
        for level in 2..=LEVELS {
            size /= PARTS as f64;
            let mut finer = self.search(span * number(PARTS as f64), settled, open);
            for j in 0..2 * PARTS {
                if !finer.open().any() {
                    break;
                }
                let place = start + number((j as f64 + 0.5) * size);
                let is_late = one.lt(place);
                let basis =
                    chosen_of(is_late, between(middle, late, place - one), between(early, middle, place));
                let opacity = self.shown_opacity(rays, origin + place * part, basis);
                finer.look(self, j, part_opacity(self, opacity, level), target);
            }
            let share = self.share_of_part(finer.opacity, finer.accumulated, target);
            let share = share.or_where_not(finer.found, zero);
            s = (start + (finer.part + share) * number(size)).or_where_not(open, s);
            open = open & finer.found;
            start = start + (finer.part - one).max(zero) * number(size);
            span = (finer.part + one).min(number(2.0));
            settled = finer.settled;
        }
        at_end.or_where_not(is_missed, origin + s * part).clamped(rays.entry, rays.exit)
    }

    /// The place of the crossing in a part of the given opacity, 0..1: opacity grows exponentially
    /// within it.
    #[inline(always)]
    fn share_of_part(&self, opacity: L::Real, accumulated: L::Real, target: L::Real) -> L::Real {
        let (one, least) = (self.number(1.0), self.number(1e-30));
        let whole = (one - opacity).max(least).log2();
        let needed = ((one - target) / (one - accumulated)).max(least).log2();
        (needed / whole.min(-least)).clamped(self.number(0.0), one)
    }

    #[inline(always)]
    fn search(&self, parts: L::Real, before: L::Real, chosen: L::Mask) -> Search<L> {
        let (zero, found) = (self.number(0.0), !chosen & chosen);
        Search { parts, chosen, found, part: zero, settled: before, accumulated: before, opacity: zero }
    }
}

#[inline(always)]
fn between<R: relief_lanes::Real>([hu, factor]: [R; 2], to: [R; 2], share: R) -> [R; 2] {
    [hu.lerp(to[0], share), factor.lerp(to[1], share)]
}

/// One where the mask holds, and the other elsewhere.
#[inline(always)]
fn chosen_of<R: relief_lanes::Real>(mask: R::Mask, one: [R; 2], other: [R; 2]) -> [R; 2] {
    [one[0].or_where_not(mask, other[0]), one[1].or_where_not(mask, other[1])]
}

/// Opacity of 1/4^level of a sample's path: `1 - (1 - a)^(1 / 4^level)`, by square roots.
#[inline(always)]
fn part_opacity<L: Lanes>(scene: &Scene<'_, L>, opacity: L::Real, level: usize) -> L::Real {
    let one = scene.lanes.splat(1.0);
    let transparency = (one - opacity).max(scene.lanes.splat(0.0));
    let mut root = transparency;
    for _ in 0..2 * level {
        root = root.sqrt();
    }
    one - root
}

impl<L: Lanes> Search<L> {
    /// Lanes that search on.
    #[inline(always)]
    fn open(&self) -> L::Mask {
        self.chosen & !self.found & self.part.lt(self.parts)
    }

    /// Looks at part j, of the given opacity, in the lanes that search on.
    #[inline(always)]
    fn look(&mut self, scene: &Scene<'_, L>, j: usize, opacity: L::Real, target: L::Real) {
        let open = self.open();
        let before = self.accumulated;
        let next = before + (scene.lanes.splat(1.0) - before) * opacity;
        let found = open & target.le(next);
        let goes_on = open & !found;
        self.part = scene.lanes.splat((j + 1) as f64).or_where_not(goes_on, self.part);
        self.settled = before.or_where_not(goes_on, self.settled);
        self.accumulated = next.or_where_not(goes_on, before);
        self.opacity = opacity.or_where_not(open, self.opacity);
        self.found = self.found | found;
    }
}
