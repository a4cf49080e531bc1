//! Slices and slabs across the viewing axis; as `shaders/slice.wgsl`.
//!
//! Samples lie on the plane and, in pairs, before and behind it up to the faces of the slab; those
//! outside the volume or clipped are left out. Values in HU, distances in mm along the rays.

use relief_lanes::{Lanes, Mask as _, Real as _, Triple};

use super::super::mode::SlabBlend;
use super::super::slices::SlabSamples;
use super::ray::Rays;
use super::scene::{Hit, Scene};

/// Below every value of a volume, HU.
const BELOW_ALL_HU: f64 = -1e30;

/// The result of rays in the slab: value, distance, the voxel index whose segment it has, and the rays
/// that have one.
struct Cut<L: Lanes> {
    hu: L::Real,
    t: L::Real,
    p: Triple<L::Real>,
    found: L::Mask,
}

impl<L: Lanes> Scene<'_, L> {
    #[inline(always)]
    pub(super) fn slice(&self, rays: &Rays<L>, blend: SlabBlend, chosen: L::Mask) -> Hit<L> {
        let cut = match blend {
            SlabBlend::Mean => self.mean_of_slab(rays, chosen),
            SlabBlend::Mip => self.extreme_of_slab(rays, 1.0, chosen),
            SlabBlend::MinIp => self.extreme_of_slab(rays, -1.0, chosen),
        };
        let [r, g, b, opacity] = self.classify(cut.p, cut.hu);
        let opacity = opacity.or_where_not(cut.found, self.number(0.0));
        Hit { color: Triple([r, g, b]).scaled(opacity), opacity, hits: cut.found, t: cut.t }
    }

    /// Distance of sample k, counted from the plane: negative ones are before it. The plane goes
    /// through the focal point.
    #[inline(always)]
    fn slab_t(&self, k: i64) -> L::Real {
        self.number(self.plane_t + k as f64 * self.slab.spacing_mm)
    }

    /// The lanes whose samples are inside the visible part.
    #[inline(always)]
    fn is_counted(&self, rays: &Rays<L>, t: L::Real, chosen: L::Mask) -> L::Mask {
        let mut inside = chosen & rays.entry.le(t) & t.le(rays.exit);
        if self.is_cut {
            inside = inside & !rays.is_cut(t);
        }
        if self.segments.is_some() && inside.any() {
            inside = inside & self.is_shown(rays.voxel_at(t));
        }
        inside
    }

    /// The mean over the part inside the slab, by the trapezoidal rule: samples on its faces count
    /// half.
    #[inline(always)]
    fn mean_of_slab(&self, rays: &Rays<L>, chosen: L::Mask) -> Cut<L> {
        let pairs = i64::from(self.slab.pairs);
        let (zero, one) = (self.number(0.0), self.number(1.0));
        let (mut sum, mut weights) = (zero, zero);
        for k in -pairs..=pairs {
            let t = self.slab_t(k);
            let inside = self.is_counted(rays, t, chosen);
            if inside.any() {
                let weight = self.number(if pairs > 0 && k.abs() == pairs { 0.5 } else { 1.0 });
                let weight = weight.or_where_not(inside, zero);
                sum = sum + weight * self.field.hu(rays.voxel_at(t));
                weights = weights + weight;
            }
        }
        let found = zero.lt(weights);
        // The plane itself, or the part of the slab next to it where the plane is outside.
        let t = self.slab_t(0).clamped(rays.entry, rays.exit);
        Cut { hu: sum / weights.or_where_not(found, one), t, p: rays.voxel_at(t), found }
    }

    /// The largest value in the slab, or the smallest; from the plane outwards, so that of equal ones
    /// the nearest to it.
    #[inline(always)]
    fn extreme_of_slab(&self, rays: &Rays<L>, sign: f64, chosen: L::Mask) -> Cut<L> {
        let SlabSamples { spacing_mm, pairs } = self.slab;
        let (pairs, sign) = (i64::from(pairs), self.number(sign));
        let (mut largest, mut t) = (self.number(BELOW_ALL_HU), self.slab_t(0));
        for step in 0..=2 * pairs {
            // 0, -1, 1, -2, 2 and further on.
            let k = if step % 2 == 1 { -(step + 1) / 2 } else { step / 2 };
            let this = self.slab_t(k);
            let inside = self.is_counted(rays, this, chosen);
            if inside.any() {
                let value = sign * self.field.hu(rays.voxel_at(this));
                let is_larger = inside & largest.lt(value);
                largest = value.or_where_not(is_larger, largest);
                t = this.or_where_not(is_larger, t);
            }
        }
        let found = chosen & self.number(BELOW_ALL_HU).lt(largest);
        let spacing = self.number(spacing_mm);
        let before = sign * self.field.hu(rays.voxel_at(t - spacing));
        let after = sign * self.field.hu(rays.voxel_at(t + spacing));
        let top = t + self.top_offset([before, largest, after]) * spacing;
        let (low, high) = (rays.entry.max(self.slab_t(-pairs)), rays.exit.min(self.slab_t(pairs)));
        let nothing = self.number(0.0);
        let hu = (sign * largest).or_where_not(found, nothing);
        Cut { hu, t: top.clamped(low, high), p: rays.voxel_at(t), found }
    }
}
