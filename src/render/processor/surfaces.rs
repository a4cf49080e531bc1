//! Isosurfaces: where the values along rays pass given values; as
//! `shaders/raycast/isosurface.wgsl`.
//!
//! A crossing lies between two neighbouring samples on different sides of a surface's value. The
//! ray's entry and exit count as samples before the first and behind the last. A body that a clip
//! plane or the volume's faces cut is open there. Values in HU, distances in mm along the rays.

use relief_lanes::{Lanes, Mask as _, Real as _, Triple};

use super::super::request::DepthRule;
use super::ray::Rays;
use super::scene::{Hit, OPAQUE, Scene, SurfaceInLanes, VISIBLE};
use super::walk::Walk;

/// To 1/256 of a sample distance; a straight line through the ends of the remaining interval refines
/// it further.
const HALVINGS: usize = 8;

/// The surfaces that rays have met so far.
struct Trace<L: Lanes> {
    color: Triple<L::Real>,
    opacity: L::Real,
    /// Rays whose opacity reached the target, where, and the opacity behind that surface.
    reached: L::Mask,
    t: L::Real,
    opacity_at_t: L::Real,
}

/// Two neighbouring samples: distance and value.
struct Stretch<L: Lanes> {
    near: [L::Real; 2],
    far: [L::Real; 2],
}

impl<L: Lanes> Scene<'_, L> {
    #[inline(always)]
    pub(super) fn isosurface(&self, rays: &Rays<L>, walk: &Walk<L>, chosen: L::Mask) -> Hit<L> {
        // The first surface, and all that is behind it.
        let whole = self.trace_surfaces(rays, walk, self.number(0.0), chosen);
        let hits = whole.reached & self.number(VISIBLE).le(whole.opacity);
        let mut t = whole.t;
        if matches!(self.request.depth.of_rays(), DepthRule::Threshold { .. }) {
            let target = self.depth_fraction * whole.opacity;
            let is_deeper = hits & whole.opacity_at_t.lt(target);
            if is_deeper.any() {
                let deeper = self.trace_surfaces(rays, walk, target, is_deeper);
                t = deeper.t.or_where_not(is_deeper & deeper.reached, t);
            }
        }
        Hit { color: whole.color, opacity: whole.opacity, hits, t }
    }

    /// The place of samples k among the samples: their own numbers, but the ray's entry for -1 and its
    /// exit from `count` on.
    #[inline(always)]
    fn place_of(&self, rays: &Rays<L>, k: L::Real, count: L::Real) -> L::Real {
        let distance = self.view.distance_mm();
        let entry = (rays.entry - rays.first) / distance;
        let exit = (rays.exit - rays.first) / distance;
        entry.or_where_not(k.lt(self.number(0.0)), k.or_where_not(k.lt(count), exit))
    }

    /// Follows rays through all surfaces; `t` is that of the first one at which opacity reaches the
    /// target.
    ///
    /// An empty brick lies on one side of every surface, and so do two that touch, since they share
    /// voxels. Neighbouring samples in empty bricks thus have no crossing between them, as long as a
    /// step is shorter than a brick. A sample before or behind a visible brick is taken, whatever
    /// brick it is in.
    #[inline(always)]
    fn trace_surfaces(&self, rays: &Rays<L>, walk: &Walk<L>, target: L::Real, chosen: L::Mask) -> Trace<L> {
        let (zero, one) = (self.number(0.0), self.number(1.0));
        let mut trace: Trace<L> = Trace {
            color: Triple::of(zero),
            opacity: zero,
            reached: self.none(),
            t: zero,
            opacity_at_t: zero,
        };
        let count = self.view.sample_counts(rays);
        let may_skip = self.bricks.are_longer_than_steps(walk);
        let (mut near_hu, mut is_known, mut k) = (zero, self.none(), -one);
        loop {
            let has_way = rays.entry.lt(rays.exit);
            let alive = chosen & has_way & k.le(count) & trace.opacity.lt(self.number(OPAQUE));
            if !alive.any() {
                return trace;
            }
            let place = self.place_of(rays, k, count);
            // Hidden samples count: a surface may lie before the sphere, behind the sample before.
            let next = self.bricks.next_sample(walk, place).or_where_not(may_skip, place);
            let is_empty = place.lt(next);
            let taken = alive & (is_known | !is_empty);
            if taken.any() {
                let hu = self.field.hu(rays.sample_voxel(place));
                let has_before = taken & zero.le(k);
                if has_before.any() {
                    let near = self.place_of(rays, k - one, count);
                    let unknown = has_before & !is_known;
                    if unknown.any() {
                        near_hu = self.field.hu(rays.sample_voxel(near)).or_where_not(unknown, near_hu);
                    }
                    let stretch = Stretch {
                        near: [self.view.sample_t(rays, near), near_hu],
                        far: [self.view.sample_t(rays, place), hu],
                    };
                    self.meet_surfaces(rays, &stretch, &mut trace, target, has_before);
                }
                near_hu = hu.or_where_not(taken, near_hu);
                is_known = (taken & !is_empty) | (is_known & !taken);
            }
            // A position between samples belongs to the sample before it, and the search continues at
            // least at the next sample.
            let behind = k + one;
            k = behind.max(next.floor()).or_where_not(is_empty, behind);
        }
    }

    /// The surfaces within stretches, in their order along the rays: values rise or fall through them
    /// one after another.
    #[inline(always)]
    fn meet_surfaces(
        &self,
        rays: &Rays<L>,
        stretch: &Stretch<L>,
        trace: &mut Trace<L>,
        target: L::Real,
        chosen: L::Mask,
    ) {
        let ([mut near_t, mut near_hu], [_, far_hu]) = (stretch.near, stretch.far);
        let rises = stretch.near[1].lt(far_hu);
        for (rising, falling) in self.surfaces.iter().zip(self.surfaces.iter().rev()) {
            let level = rising.level.or_where_not(rises, falling.level);
            let (is_below, ends_below) = (stretch.near[1].lt(level), far_hu.lt(level));
            let meets = chosen & ((is_below & !ends_below) | (ends_below & !is_below));
            if !meets.any() {
                continue;
            }
            let rest = Stretch { near: [near_t, near_hu], far: stretch.far };
            let surface = SurfaceInLanes {
                level,
                rgb: rising.rgb.or_where_not([rises; 3], falling.rgb),
                opacity: rising.opacity.or_where_not(rises, falling.opacity),
            };
            let t = self.lanes.apart(
                #[inline(always)]
                || {
                    let t = self.crossing_t(rays, &rest, level);
                    self.blend_surface(rays, t, surface, trace, target, meets);
                    t
                },
            );
            // The next surface lies behind this one.
            near_t = t.or_where_not(meets, near_t);
            near_hu = level.or_where_not(meets, near_hu);
        }
    }

    /// The part inside the sphere is absent. Its wall is not a surface, and neither is a clip plane.
    #[inline(always)]
    fn blend_surface(
        &self,
        rays: &Rays<L>,
        t: L::Real,
        surface: SurfaceInLanes<L>,
        trace: &mut Trace<L>,
        target: L::Real,
        meets: L::Mask,
    ) {
        let shown = if self.is_cut { meets & !rays.is_cut(t) } else { meets };
        let p = rays.voxel_at(t);
        let lit = self.lights.lit(&self.field, surface.rgb, rays.direction, p, |gradient| gradient);
        let weight = (self.number(1.0) - trace.opacity) * surface.opacity;
        let weight = weight.or_where_not(shown, self.number(0.0));
        trace.color = trace.color.plus_times(lit, weight);
        trace.opacity = trace.opacity + weight;
        let reaches = shown & !trace.reached & target.le(trace.opacity);
        trace.t = t.or_where_not(reaches, trace.t);
        trace.opacity_at_t = trace.opacity.or_where_not(reaches, trace.opacity_at_t);
        trace.reached = trace.reached | reaches;
    }

    /// The share of light that passes all surfaces between two values.
    #[inline(always)]
    pub(super) fn past_levels(&self, near: L::Real, far: L::Real) -> L::Real {
        let one = self.number(1.0);
        let mut share = one;
        for surface in &self.surfaces {
            let (is_below, ends_below) = (near.lt(surface.level), far.lt(surface.level));
            let meets = (is_below & !ends_below) | (ends_below & !is_below);
            share = share * (one - surface.opacity).or_where_not(meets, one);
        }
        share
    }

    /// The places at which the value passes `level` within stretches whose ends are on different
    /// sides of it.
    #[inline(always)]
    fn crossing_t(&self, rays: &Rays<L>, stretch: &Stretch<L>, level: L::Real) -> L::Real {
        let (zero, half) = (self.number(0.0), self.number(0.5));
        let ([mut near_t, near_hu], [mut far_t, far_hu]) = (stretch.near, stretch.far);
        let (mut near, mut far) = (near_hu - level, far_hu - level);
        let near_is_below = near_hu.lt(far_hu);
        for _ in 0..HALVINGS {
            let middle = half * (near_t + far_t);
            let value = self.field.hu(rays.voxel_at(middle)) - level;
            let is_below = value.lt(zero);
            let is_near = (is_below & near_is_below) | !(is_below | near_is_below);
            near_t = middle.or_where_not(is_near, near_t);
            near = value.or_where_not(is_near, near);
            far_t = far_t.or_where_not(is_near, middle);
            far = far.or_where_not(is_near, value);
        }
        let across = far - near;
        let is_flat = across.le(zero) & zero.le(across);
        let share = (-near / self.number(1.0).or_where_not(is_flat, across)).clamped(zero, self.number(1.0));
        far_t.or_where_not(is_flat, near_t + share * (far_t - near_t))
    }
}
