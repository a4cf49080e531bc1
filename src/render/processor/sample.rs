//! Colours and opacities of samples, by their value and whatever else the request has: segments,
//! opacity by gradient, paths; as `shaders/lib/gradient.wgsl`.
//!
//! Spaces: voxel index, HU, mm along the rays. Opacity is that of one sample.

use relief_lanes::{Lanes, Real as _, Triple};

use super::ray::Rays;
use super::scene::Scene;

impl<L: Lanes> Scene<'_, L> {
    /// The inputs of opacity at a position: its value, and its factor by gradient.
    #[inline(always)]
    pub(super) fn opacity_basis(&self, p: Triple<L::Real>) -> [L::Real; 2] {
        [self.field.hu(p), self.factor_at(p)]
    }

    /// The factor of opacity by gradient at a position.
    #[inline(always)]
    pub(super) fn factor_at(&self, p: Triple<L::Real>) -> L::Real {
        match &self.gradient_opacity {
            None => self.number(1.0),
            Some(table) => self.lanes.apart(
                #[inline(always)]
                || table.factor(self.field.gradient(p)),
            ),
        }
    }

    /// Opacity at a position from its inputs.
    #[inline(always)]
    pub(super) fn opacity_from(&self, p: Triple<L::Real>, [hu, factor]: [L::Real; 2]) -> L::Real {
        let opacity = match &self.segments {
            None => self.colors.opacity(hu),
            Some(segments) => self.lanes.apart(
                #[inline(always)]
                || segments.classify(p, hu)[3],
            ),
        };
        match &self.gradient_opacity {
            None => opacity,
            Some(table) => table.modulated(opacity, factor),
        }
    }

    /// Opacity at t mm from its inputs; none inside the sphere.
    #[inline(always)]
    pub(super) fn shown_opacity(&self, rays: &Rays<L>, t: L::Real, basis: [L::Real; 2]) -> L::Real {
        self.without_cut(rays, t, self.opacity_from(rays.voxel_at(t), basis))
    }

    /// Opacity at t mm.
    #[inline(always)]
    pub(super) fn opacity_at(&self, rays: &Rays<L>, t: L::Real) -> L::Real {
        self.shown_opacity(rays, t, self.opacity_basis(rays.voxel_at(t)))
    }

    /// Opacity of samples k: of their places, or of the paths that they stand for.
    #[inline(always)]
    pub(super) fn sample_opacity(&self, rays: &Rays<L>, k: L::Real) -> L::Real {
        let t = self.view.sample_t(rays, k);
        match &self.integrals {
            None => self.opacity_at(rays, t),
            Some(integrals) => self.lanes.apart(
                #[inline(always)]
                || {
                    let passed = integrals.passed(self.passage(rays, k));
                    self.without_cut(rays, t, passed.opacity())
                },
            ),
        }
    }

    #[inline(always)]
    fn without_cut(&self, rays: &Rays<L>, t: L::Real, opacity: L::Real) -> L::Real {
        if self.is_cut { self.number(0.0).or_where_not(rays.is_cut(t), opacity) } else { opacity }
    }

    /// Colour before light, and opacity, of a value at a position; without the factor by gradient.
    #[inline(always)]
    pub(super) fn classify(&self, p: Triple<L::Real>, hu: L::Real) -> [L::Real; 4] {
        match &self.segments {
            None => {
                let Triple([r, g, b]) = self.colors.rgb(hu);
                [r, g, b, self.colors.opacity(hu)]
            }
            Some(segments) => self.lanes.apart(
                #[inline(always)]
                || segments.classify(p, hu),
            ),
        }
    }

    /// The lanes in which the segment at a position is visible.
    #[inline(always)]
    pub(super) fn is_shown(&self, p: Triple<L::Real>) -> L::Mask {
        match &self.segments {
            None => self.lanes.first(L::COUNT),
            Some(segments) => self.lanes.apart(
                #[inline(always)]
                || segments.is_shown(p),
            ),
        }
    }

    /// The values that the paths of samples k pass.
    #[inline(always)]
    pub(super) fn passage(&self, rays: &Rays<L>, k: L::Real) -> [L::Real; 3] {
        let half = self.number(0.5);
        [self.hu_along(rays, k - half), self.hu_along(rays, k), self.hu_along(rays, k + half)]
    }

    /// Values at fractional sample numbers. Clipped samples do not count.
    #[inline(always)]
    pub(super) fn hu_along(&self, rays: &Rays<L>, k: L::Real) -> L::Real {
        let t = self.view.sample_t(rays, k).clamped(rays.entry, rays.exit);
        self.field.hu(rays.voxel_at(t))
    }
}
