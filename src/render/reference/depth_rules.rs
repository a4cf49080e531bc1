//! Depth rules that look at a whole ray once more; twin of `shaders/lib/depth_rules.wgsl`.
//! Distances along the ray in mm.

use super::cast::{BISECTIONS, Caster, Hit, OPAQUE};
use super::ray::Ray;
use crate::request::DepthRule;

const AS_GREAT: f64 = 1.0 - 1.0 / 256.0;
const SLOPE_SHARE: f64 = 0.5;
const LAYER_OPACITY: f64 = 0.35;
const LAYER_END_SHARE: f64 = 0.125;

/// An interval of the curve of accumulated opacity, between two lowest points of its slope.
#[derive(Clone, Copy)]
struct Interval {
    start: i32,
    before: f64,
    greatest: f64,
    rise: f64,
}

/// The first layer of a ray: the first sample behind it, and its accumulated opacity.
pub(super) struct FrontLayer {
    pub(super) end: i32,
    pub(super) opacity: f64,
}

impl Caster<'_> {
    /// The depth of a ray by the rule of the request, whose first visible sample is `first`, and
    /// which ends in `opacity`.
    pub(super) fn depth_by_rule(&self, rule: DepthRule, ray: &Ray, first: i32, opacity: f64) -> f64 {
        match rule {
            DepthRule::FirstHit => self.first_hit(ray, first),
            DepthRule::Threshold { fraction } => self.threshold_crossing(ray, first, fraction * opacity),
            DepthRule::MaxOpacity => self.max_opacity(ray, first),
            DepthRule::MostContributing => self.most_contributing(ray, first),
            DepthRule::Expected => self.expected(ray, first),
            DepthRule::Wysiwyp => self.wysiwyp(ray, first),
            DepthRule::TwoLayer { fraction } => {
                self.threshold_crossing(ray, first, fraction * self.front_layer(ray, first).opacity)
            }
        }
    }

    pub(super) fn sample_opacity(&self, ray: &Ray, k: i32) -> f64 {
        let t = ray.sample_t(f64::from(k));
        match &self.tables.own.integral {
            Some(integral) if !ray.is_cut(t) => self.passage_opacity(integral, ray, k),
            _ => self.opacity_at(ray, t),
        }
    }

    /// Number, opacity and accumulated opacity before it, of each sample of a ray as far as it is
    /// shown.
    fn shown_samples<'a>(&'a self, ray: &'a Ray, first: i32) -> impl Iterator<Item = (i32, f64, f64)> + 'a {
        let mut accumulated = 0.0;
        (first..ray.sample_count()).map_while(move |k| {
            let before = accumulated;
            let a = self.sample_opacity(ray, k);
            accumulated += (1.0 - before) * a;
            (before < OPAQUE).then_some((k, a, before))
        })
    }

    fn level_crossing(&self, ray: &Ray, k: i32, level: f64) -> f64 {
        let mut outside = ray.entry.max(ray.sample_t(f64::from(k) - 1.0));
        let mut inside = ray.sample_t(f64::from(k));
        if self.opacity_at(ray, outside) >= level {
            return outside;
        }
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (outside + inside);
            if self.opacity_at(ray, middle) >= level { inside = middle } else { outside = middle }
        }
        inside
    }

    fn weight_crossing(&self, ray: &Ray, start: i32, accumulated_before: f64, level: f64) -> f64 {
        let mut accumulated = accumulated_before;
        let mut k = start;
        while k < ray.sample_count() {
            let weight = (1.0 - accumulated) * self.sample_opacity(ray, k);
            if weight >= level {
                break;
            }
            accumulated += weight;
            k += 1;
        }
        self.level_crossing(ray, k.min(ray.sample_count() - 1), level / (1.0 - accumulated))
    }

    fn max_opacity(&self, ray: &Ray, first: i32) -> f64 {
        let greatest = self.shown_samples(ray, first).map(|(_, a, _)| a).fold(0.0, f64::max);
        let level = AS_GREAT * greatest;
        let reaching = self.shown_samples(ray, first).find(|(_, a, _)| *a >= level);
        self.level_crossing(ray, reaching.map_or(first, |(k, ..)| k), level)
    }

    fn most_contributing(&self, ray: &Ray, first: i32) -> f64 {
        let weights = self.shown_samples(ray, first).map(|(_, a, before)| (1.0 - before) * a);
        self.weight_crossing(ray, first, 0.0, AS_GREAT * weights.fold(0.0, f64::max))
    }

    fn expected(&self, ray: &Ray, first: i32) -> f64 {
        let (mut sum, mut moment) = (0.0, 0.0);
        for (k, a, before) in self.shown_samples(ray, first) {
            let weight = (1.0 - before) * a;
            sum += weight;
            moment += weight * ray.sample_t(f64::from(k));
        }
        (moment / sum).clamp(ray.entry, ray.exit)
    }

    fn wysiwyp(&self, ray: &Ray, first: i32) -> f64 {
        let new = |start, before| Interval { start, before, greatest: 0.0, rise: 0.0 };
        let (mut best, mut present, mut next) = (new(first, 0.0), new(first, 0.0), new(first, 0.0));
        let (mut valley, mut falling, mut accumulated) = (0.0, false, 0.0);
        for (k, a, before) in self.shown_samples(ray, first) {
            let weight = (1.0 - before) * a;
            if falling && SLOPE_SHARE * weight > valley {
                present.rise = next.before - present.before;
                if present.rise > best.rise {
                    best = present;
                }
                present = next;
                falling = false;
            }
            present.greatest = present.greatest.max(weight);
            accumulated = before + weight;
            if weight < SLOPE_SHARE * present.greatest && (!falling || weight < valley) {
                falling = true;
                valley = weight;
                next = new(k + 1, accumulated);
            }
        }
        present.rise = accumulated - present.before;
        if present.rise > best.rise {
            best = present;
        }
        self.weight_crossing(ray, best.start, best.before, SLOPE_SHARE * best.greatest)
    }

    fn front_layer(&self, ray: &Ray, first: i32) -> FrontLayer {
        let mut layer = FrontLayer { end: ray.sample_count(), opacity: 0.0 };
        let mut greatest = 0.0f64;
        for k in first..ray.sample_count() {
            let a = self.sample_opacity(ray, k);
            if layer.opacity >= LAYER_OPACITY && a < LAYER_END_SHARE * greatest {
                layer.end = k;
                break;
            }
            greatest = greatest.max(a);
            if layer.opacity < OPAQUE {
                layer.opacity += (1.0 - layer.opacity) * a;
            }
        }
        layer
    }

    /// The background layer; `None` where the first layer extends to the ray's end.
    pub(super) fn back_layer(&self, ray: &Ray, first: i32) -> Option<Hit> {
        let end = self.front_layer(ray, first).end;
        let DepthRule::TwoLayer { fraction } = self.request.depth else { return None };
        (end < ray.sample_count()).then(|| self.composite_from(ray, end, DepthRule::Threshold { fraction }))
    }
}
