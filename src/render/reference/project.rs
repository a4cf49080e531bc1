//! Projections; twin of `shaders/raycast/project.wgsl`. Values in HU, distances along the ray in
//! mm.

use glam::{DVec3, DVec4};

use super::cast::{Caster, Hit, VISIBLE};
use super::classify::classify;
use super::field::sample_hu;
use super::ray::Ray;
use crate::mode::Mode;
use crate::uniform::brightness_range;

const FLAT_HU: f64 = 0.05;

impl Caster<'_> {
    pub(super) fn project(&self, ray: &Ray) -> Hit {
        match self.request.mode {
            Mode::Mip => self.project_extreme(ray, 1.0),
            Mode::Minip => self.project_extreme(ray, -1.0),
            _ => self.project_sum(ray),
        }
    }

    pub(super) fn value_at(&self, ray: &Ray, t: f64) -> f64 {
        sample_hu(self.volume, ray.voxel_at(t))
    }

    fn project_extreme(&self, ray: &Ray, sign: f64) -> Hit {
        let (mut largest, mut at) = (f64::NEG_INFINITY, 0);
        for k in 0..ray.sample_count() {
            let t = ray.sample_t(f64::from(k));
            let value = sign * self.value_at(ray, t);
            if value > largest && !ray.is_cut(t) && self.is_shown(ray.voxel_at(t)) {
                (largest, at) = (value, k);
            }
        }
        if largest == f64::NEG_INFINITY {
            return Hit { color: DVec4::ZERO, first: None, t: None };
        }
        let p = ray.voxel_at(ray.sample_t(f64::from(at)));
        let sample = self.classify_at(p, sign * largest);
        let t = (sample.w >= VISIBLE).then(|| self.peak_t(ray, at, largest, sign));
        Hit { color: (sample.truncate() * sample.w).extend(sample.w), first: None, t }
    }

    fn peak_t(&self, ray: &Ray, at: i32, largest: f64, sign: f64) -> f64 {
        let t = ray.sample_t(f64::from(at));
        let before = sign * self.value_at(ray, t - ray.sample_distance_mm);
        let after = sign * self.value_at(ray, t + ray.sample_distance_mm);
        let curvature = before - 2.0 * largest + after;
        let offset =
            if curvature < -FLAT_HU { (0.5 * (before - after) / curvature).clamp(-0.5, 0.5) } else { 0.0 };
        let top = (t + offset * ray.sample_distance_mm).clamp(ray.entry, ray.exit);
        if ray.is_cut(top) { t } else { top }
    }

    fn share_of_sample(&self, hu: f64) -> f64 {
        let (lowest_hu, span_hu) = brightness_range(self.volume);
        let brightness = ((hu - lowest_hu) / span_hu).clamp(0.0, 1.0);
        if self.request.mode == Mode::Mean {
            brightness
        } else {
            classify(&self.tables.own, hu).w * brightness
        }
    }

    fn project_sum(&self, ray: &Ray) -> Hit {
        let is_shown = |k: &f64| !ray.is_cut(ray.sample_t(*k));
        let shown: Vec<f64> = (0..ray.sample_count()).map(f64::from).filter(is_shown).collect();
        if shown.is_empty() {
            return Hit { color: DVec4::ZERO, first: None, t: None };
        }
        let (mut sum, mut moment) = (0.0, 0.0);
        for &k in &shown {
            let share = self.share_of_sample(self.value_at(ray, ray.sample_t(k)));
            sum += share;
            moment += share * k;
        }
        let color = self.color_of_sum(sum, shown.len());
        let brightness = if self.request.mode == Mode::Mean { color.w } else { color.x };
        let middle = 0.5 * f64::from(ray.sample_count() - 1);
        let t = ray.sample_t(if sum > 0.0 { moment / sum } else { middle }).clamp(ray.entry, ray.exit);
        Hit { color, first: None, t: (brightness >= VISIBLE).then_some(t) }
    }

    fn color_of_sum(&self, sum: f64, count: usize) -> DVec4 {
        let mean = sum / count as f64;
        match self.request.mode {
            Mode::Additive => {
                let units = self.request.sample_distance_mm / self.request.transfer.opacity_unit_mm();
                DVec3::splat((sum * units).min(1.0)).extend(1.0)
            }
            Mode::Mean => {
                let (lowest_hu, span_hu) = brightness_range(self.volume);
                let sample = classify(&self.tables.own, lowest_hu + mean * span_hu);
                (sample.truncate() * sample.w).extend(sample.w)
            }
            _ => DVec3::splat(mean).extend(1.0),
        }
    }
}
