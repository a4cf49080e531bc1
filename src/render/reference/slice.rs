//! Slices and slabs; twin of `shaders/slice.wgsl`.

use glam::{DVec3, DVec4};

use super::cast::{Caster, Hit};
use super::field::sample_hu;
use super::ray::Ray;
use crate::mode::SlabBlend;
use crate::slices::SlabSamples;

const FLAT_HU: f64 = 0.05;

/// The result of a ray in the slab: value, distance along the ray in mm, and the voxel index whose
/// segment it has.
struct Cut {
    hu: f64,
    t: f64,
    p: DVec3,
}

impl Caster<'_> {
    pub(super) fn slice(&self, ray: &Ray, blend: SlabBlend) -> Hit {
        let cut = match blend {
            SlabBlend::Mean => self.mean_of_slab(ray),
            SlabBlend::Mip => self.extreme_of_slab(ray, 1.0),
            SlabBlend::MinIp => self.extreme_of_slab(ray, -1.0),
        };
        let Some(Cut { hu, t, p }) = cut else { return Hit { color: DVec4::ZERO, first: None, t: None } };
        let color = self.classify_at(p, hu);
        Hit { color: (color.truncate() * color.w).extend(color.w), first: None, t: Some(t) }
    }

    /// Distances of the samples inside the volume, each with its number counted from the plane.
    fn slab_t(&self, k: i64) -> f64 {
        // The plane goes through the focal point; here rays start at the eye.
        self.request.camera.distance_mm() + k as f64 * SlabSamples::of(self.request).spacing_mm
    }

    fn is_counted(&self, ray: &Ray, t: f64) -> bool {
        (ray.entry..=ray.exit).contains(&t) && !ray.is_cut(t) && self.is_shown(ray.voxel_at(t))
    }

    fn mean_of_slab(&self, ray: &Ray) -> Option<Cut> {
        let pairs = i64::from(SlabSamples::of(self.request).pairs);
        let (mut sum, mut weights) = (0.0, 0.0);
        for k in -pairs..=pairs {
            let t = self.slab_t(k);
            if self.is_counted(ray, t) {
                let weight = if pairs > 0 && k.abs() == pairs { 0.5 } else { 1.0 };
                sum += weight * sample_hu(self.volume, ray.voxel_at(t));
                weights += weight;
            }
        }
        (weights > 0.0).then(|| {
            let t = self.slab_t(0).clamp(ray.entry, ray.exit);
            Cut { hu: sum / weights, t, p: ray.voxel_at(t) }
        })
    }

    fn extreme_of_slab(&self, ray: &Ray, sign: f64) -> Option<Cut> {
        let pairs = i64::from(SlabSamples::of(self.request).pairs);
        let outwards = std::iter::once(0).chain((1..=pairs).flat_map(|k| [-k, k]));
        let mut best: Option<(f64, f64)> = None;
        for t in outwards.map(|k| self.slab_t(k)).filter(|t| self.is_counted(ray, *t)) {
            let value = sign * sample_hu(self.volume, ray.voxel_at(t));
            if best.is_none_or(|(largest, _)| value > largest) {
                best = Some((value, t));
            }
        }
        let (largest, t) = best?;
        Some(Cut { hu: sign * largest, t: self.top_t(ray, t, largest, sign), p: ray.voxel_at(t) })
    }

    fn top_t(&self, ray: &Ray, t: f64, best: f64, sign: f64) -> f64 {
        let SlabSamples { spacing_mm, pairs } = SlabSamples::of(self.request);
        let value = |t: f64| sign * sample_hu(self.volume, ray.voxel_at(t));
        let (before, after) = (value(t - spacing_mm), value(t + spacing_mm));
        let curvature = before - 2.0 * best + after;
        let offset =
            if curvature < -FLAT_HU { (0.5 * (before - after) / curvature).clamp(-0.5, 0.5) } else { 0.0 };
        let pairs = i64::from(pairs);
        let (low, high) = (ray.entry.max(self.slab_t(-pairs)), ray.exit.min(self.slab_t(pairs)));
        (t + offset * spacing_mm).clamp(low, high)
    }
}
