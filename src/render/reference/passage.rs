//! Pre-integrated classification; twin of `shaders/lib/passage.wgsl`. Values in HU, distances along
//! the ray in mm.

use glam::{DVec3, DVec4};

use super::cast::Caster;
use super::classify::classify;
use super::field::sample_hu;
use super::ray::Ray;
use relief_volume::{IntegralTable, TransferTable};

const ALIKE_ENTRIES: f64 = 8.0;
const LITTLE: f64 = 0.125;

/// A sample's path as two consecutive samples, each half of it: colour, and added opacity.
struct Passed {
    front: DVec4,
    back: DVec4,
}

/// A table and its integrals.
#[derive(Clone, Copy)]
struct Integrals<'a> {
    table: &'a TransferTable,
    integral: &'a IntegralTable,
}

impl Caster<'_> {
    /// Lit colour and opacity of sample k by all values that its path passes.
    pub(super) fn passage_sample(&self, integral: &IntegralTable, ray: &Ray, k: i32) -> DVec4 {
        let Passed { front, back } = self.passed(integral, ray, k);
        let opacity = front.w + back.w;
        if opacity <= 0.0 {
            return DVec4::ZERO;
        }
        let front_place = if front.w < LITTLE * opacity { 0.25 } else { -0.25 };
        let back_place = if back.w < LITTLE * opacity { -0.25 } else { 0.25 };
        let lit =
            |rgb: DVec3, place: f64| self.lit(rgb, ray.voxel_at(ray.sample_t(f64::from(k) + place)), ray);
        let (lit_front, lit_back) = (lit(front.truncate(), front_place), lit(back.truncate(), back_place));
        ((front.w * lit_front + back.w * lit_back) / opacity).extend(opacity)
    }

    /// The opacity of sample k by itself.
    pub(super) fn passage_opacity(&self, integral: &IntegralTable, ray: &Ray, k: i32) -> f64 {
        let Passed { front, back } = self.passed(integral, ray, k);
        front.w + back.w
    }

    fn passed(&self, integral: &IntegralTable, ray: &Ray, k: i32) -> Passed {
        let hu_along = |k: f64| {
            let t = ray.sample_t(k).max(ray.entry).min(ray.exit);
            sample_hu(self.volume, ray.voxel_at(t))
        };
        let values = [-0.5, 0.0, 0.5].map(|place| hu_along(f64::from(k) + place));
        Integrals { table: &self.tables.own, integral }.classify_passage(values)
    }
}

impl Integrals<'_> {
    fn classify_passage(self, [front, middle, back]: [f64; 3]) -> Passed {
        let (low, high) = (front.min(middle).min(back), front.max(middle).max(back));
        if !self.is_visible_between(low, high) {
            return Passed { front: DVec4::ZERO, back: DVec4::ZERO };
        }
        let bend = (front - 2.0 * middle + back) / 12.0;
        let [front, middle, back] = [front, middle, back].map(|hu| hu - bend);
        let halves = [self.half_passed(front, middle), self.half_passed(middle, back)];
        let through = (-halves[0].w).exp();
        let color = |half: DVec4| half.truncate() / half.w.max(1e-12);
        Passed {
            front: color(halves[0]).extend(1.0 - through),
            back: color(halves[1]).extend(through * (1.0 - (-halves[1].w).exp())),
        }
    }

    fn is_visible_between(self, low: f64, high: f64) -> bool {
        let last = self.last();
        let first = (self.position(low).floor() as usize).min(last - 1);
        let end = (self.position(high).ceil() as usize).min(last).max(first + 1);
        self.integral.entries[end][3] > self.integral.entries[first][3]
    }

    /// Half a sample's path from one value to another: colour times optical depth, and optical
    /// depth.
    fn half_passed(self, front: f64, back: f64) -> DVec4 {
        let change = back - front;
        if change.abs() < ALIKE_ENTRIES * f64::from(self.table.step_hu) {
            let sample = classify(self.table, 0.5 * (front + back));
            let depth = 0.5 * optical_depth(sample.w);
            return (sample.truncate() * depth).extend(depth);
        }
        0.5 * (self.integral_to(back) - self.integral_to(front)) / change
    }

    /// The integral up to a value. Beyond the table its last value is repeated.
    fn integral_to(self, hu: f64) -> DVec4 {
        let last = self.last();
        let x = self.position(hu);
        let inside = x.clamp(0.0, last as f64);
        let i = (inside as usize).min(last - 1);
        let entry = |i: usize| DVec4::from(self.integral.entries[i].map(f64::from));
        let end = DVec4::from(self.table.entries[if x > inside { last } else { 0 }].map(f64::from));
        let depth = optical_depth(end.w);
        let beyond = (x - inside) * f64::from(self.table.step_hu) * (end.truncate() * depth).extend(depth);
        entry(i).lerp(entry(i + 1), inside - i as f64) + beyond
    }

    fn last(self) -> usize {
        self.table.entries.len() - 1
    }

    fn position(self, hu: f64) -> f64 {
        (hu - f64::from(self.table.first_hu)) / f64::from(self.table.step_hu)
    }
}

fn optical_depth(opacity: f64) -> f64 {
    (-(1.0 - opacity).max(1e-30).ln()).min(IntegralTable::OPAQUE_DEPTH)
}
