//! Isosurfaces; twin of `shaders/raycast/isosurface.wgsl`. Values in HU, distances along the ray in
//! mm.

use glam::DVec3;

use super::cast::{Caster, Hit, OPAQUE, VISIBLE};
use super::ray::Ray;
use crate::request::DepthRule;
use crate::surface::Surface;

const HALVINGS: i32 = 8;

/// The surfaces that a ray has met so far.
#[derive(Clone, Copy)]
struct Trace {
    color: DVec3,
    opacity: f64,
    /// Where opacity reached the target, and the opacity behind that surface.
    at: Option<(f64, f64)>,
}

/// Distance and value of a sample.
#[derive(Clone, Copy)]
struct Sample {
    t: f64,
    hu: f64,
}

impl Caster<'_> {
    pub(super) fn isosurface(&self, ray: &Ray) -> Hit {
        let whole = self.trace_surfaces(ray, 0.0);
        let first = whole.at.filter(|_| whole.opacity >= VISIBLE);
        let t = first.map(|(first_t, first_opacity)| match self.request.depth {
            DepthRule::Threshold { fraction } if first_opacity < fraction * whole.opacity => {
                self.trace_surfaces(ray, fraction * whole.opacity).at.map_or(first_t, |(t, _)| t)
            }
            _ => first_t,
        });
        Hit { color: whole.color.extend(whole.opacity), first: None, t }
    }

    fn trace_surfaces(&self, ray: &Ray, target: f64) -> Trace {
        let mut trace = Trace { color: DVec3::ZERO, opacity: 0.0, at: None };
        if ray.exit <= ray.entry {
            return trace;
        }
        let sample = |t: f64| Sample { t, hu: self.value_at(ray, t) };
        let mut near = sample(ray.entry);
        let samples = (0..ray.sample_count()).map(|k| ray.sample_t(f64::from(k)));
        for t in samples.chain([ray.exit]) {
            if trace.opacity >= OPAQUE {
                break;
            }
            let far = sample(t);
            self.meet_surfaces(ray, near, far, &mut trace, target);
            near = far;
        }
        trace
    }

    fn meet_surfaces(&self, ray: &Ray, near: Sample, far: Sample, trace: &mut Trace, target: f64) {
        let between = |surface: &&Surface| (near.hu < surface.level_hu()) != (far.hu < surface.level_hu());
        let mut met: Vec<&Surface> = self.request.surfaces.iter().filter(between).collect();
        if far.hu <= near.hu {
            met.reverse();
        }
        let mut rest = near;
        for surface in met {
            let t = self.crossing_t(ray, rest, far, surface.level_hu());
            rest = Sample { t, hu: surface.level_hu() };
            if ray.is_cut(t) {
                continue;
            }
            let [r, g, b] = surface.rgb;
            let lit = self.lit(DVec3::new(r, g, b), ray.voxel_at(t), ray);
            let weight = (1.0 - trace.opacity) * surface.opacity;
            trace.color += weight * lit;
            trace.opacity += weight;
            if trace.at.is_none() && trace.opacity >= target {
                trace.at = Some((t, trace.opacity));
            }
        }
    }

    fn crossing_t(&self, ray: &Ray, near: Sample, far: Sample, level: f64) -> f64 {
        let (mut low, mut high) =
            (Sample { hu: near.hu - level, ..near }, Sample { hu: far.hu - level, ..far });
        let near_is_below = near.hu < far.hu;
        for _ in 0..HALVINGS {
            let t = 0.5 * (low.t + high.t);
            let middle = Sample { t, hu: self.value_at(ray, t) - level };
            if (middle.hu < 0.0) == near_is_below { low = middle } else { high = middle }
        }
        let across = high.hu - low.hu;
        let share = if across == 0.0 { 1.0 } else { (-low.hu / across).clamp(0.0, 1.0) };
        low.t + share * (high.t - low.t)
    }
}
