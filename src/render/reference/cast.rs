//! One ray after another; twin of `shaders/raycast.wgsl`, without empty-space skipping, which
//! changes nothing.

use glam::{DMat3, DVec2, DVec3, DVec4};

use super::classify::{gradient_factor, modulated};
use super::field::{central_differences, sample_hu};
use super::labels;
use super::lights::Lights;
use super::ray::{Ray, Rays};
use crate::gradients::patient_from_voxel_gradient;
use crate::mode::Mode;
use crate::request::{DepthRule, RenderRequest};
use crate::tables::Tables;
use relief_volume::Volume;

pub(super) const OPAQUE: f64 = 1.0 - 1.0 / 512.0;
pub(super) const VISIBLE: f64 = 0.5 / 255.0;
const PARTS: i32 = 4;
const LEVELS: i32 = 3;
const PATH_PARTS: i32 = 16;
pub(super) const BISECTIONS: i32 = 12;

/// A volume under a request.
pub(super) struct Caster<'a> {
    pub(super) volume: &'a Volume,
    pub(super) request: &'a RenderRequest,
    pub(super) rays: Rays<'a>,
    pub(super) tables: Tables,
    lights: Lights<'a>,
    patient_from_voxel_gradient: DMat3,
}

/// Colour over the background as bytes, and view depth in mm.
pub(super) type ShownPixel = ([u8; 4], f32);

/// Premultiplied colour and coverage, the first visible sample, and the distance along the ray in
/// mm; `None` when nothing is visible.
pub(super) struct Hit {
    pub(super) color: DVec4,
    pub(super) first: Option<i32>,
    pub(super) t: Option<f64>,
}

impl<'a> Caster<'a> {
    pub(super) fn new(volume: &'a Volume, request: &'a RenderRequest) -> Self {
        let rays = Rays::new(request, volume.grid());
        let patient_from_voxel_gradient = patient_from_voxel_gradient(volume.grid());
        let lights = Lights::new(volume, request);
        let tables = Tables::new(request);
        Self { volume, request, rays, tables, lights, patient_from_voxel_gradient }
    }

    /// Colour and opacity of a value at a position.
    pub(super) fn classify_at(&self, p: DVec3, hu: f64) -> DVec4 {
        labels::classify_at(&self.tables, self.request.labels.as_deref(), p, hu)
    }

    /// Whether the segment at a position is visible.
    pub(super) fn is_shown(&self, p: DVec3) -> bool {
        self.request
            .labels
            .as_ref()
            .is_none_or(|segments| segments.looks[labels::place_at(segments, p)].visible)
    }

    /// Colour over the background as bytes, and view depth in mm, of a ray's layers: one, or two by
    /// rule `two-layer`.
    pub(super) fn raycast(&self, pixel: [u32; 2]) -> [ShownPixel; 2] {
        let ray = self.rays.ray_of_pixel(pixel);
        let hit = match self.request.mode {
            Mode::Composite | Mode::PathTraced => self.composite_from(&ray, 0, self.request.depth),
            Mode::Slice(blend) => self.slice(&ray, blend),
            Mode::Isosurface => self.isosurface(&ray),
            _ => self.project(&ray),
        };
        let back = match (hit.first, self.request.has_back_layer()) {
            (Some(first), true) => self.back_layer(&ray, first),
            _ => None,
        };
        let nothing = Hit { color: DVec4::ZERO, first: None, t: None };
        [self.shown(&ray, &hit), self.shown(&ray, &back.unwrap_or(nothing))]
    }

    fn shown(&self, ray: &Ray, hit: &Hit) -> ShownPixel {
        let over = hit.color.truncate() + (1.0 - hit.color.w) * DVec3::from(self.request.background_rgb);
        let bytes = over.extend(hit.color.w).to_array().map(|x| (x.clamp(0.0, 1.0) * 255.0).round() as u8);
        (bytes, hit.t.map_or(f32::INFINITY, |t| ray.view_depth(t) as f32))
    }

    /// Samples from number `start` on, blended front to back; depth by `rule`.
    pub(super) fn composite_from(&self, ray: &Ray, start: i32, rule: DepthRule) -> Hit {
        let (mut color, mut opacity, mut first) = (DVec3::ZERO, 0.0, None);
        for k in start..ray.sample_count() {
            if opacity >= OPAQUE {
                break;
            }
            let t = ray.sample_t(f64::from(k));
            if ray.is_cut(t) {
                continue;
            }
            let sample = match &self.tables.own.integral {
                Some(integral) => self.passage_sample(integral, ray, k),
                None => self.lit_sample(ray, t),
            };
            if sample.w > 0.0 {
                let weight = (1.0 - opacity) * sample.w;
                color += weight * sample.truncate();
                opacity += weight;
                first = first.or(Some(k));
            }
        }
        let visible = first.filter(|_| opacity >= VISIBLE);
        let t = visible.map(|first| self.depth_by_rule(rule, ray, first, opacity));
        Hit { color: color.extend(opacity), first, t }
    }

    pub(super) fn lit(&self, rgb: DVec3, p: DVec3, ray: &Ray) -> DVec3 {
        let light = &self.request.shading;
        if !light.needs_gradient() && !self.lights.is_occluded() {
            return rgb * light.ambient;
        }
        let gradient = self.patient_from_voxel_gradient * central_differences(self.volume, p);
        self.lights.lit(rgb, gradient, ray.direction, p)
    }

    /// Lit colour and opacity of the sample at a distance along a ray.
    fn lit_sample(&self, ray: &Ray, t: f64) -> DVec4 {
        let p = ray.voxel_at(t);
        let sample = self.sample(p);
        if sample.w > 0.0 { self.lit(sample.truncate(), p, ray).extend(sample.w) } else { sample }
    }

    /// Colour and opacity of the sample at a position.
    fn sample(&self, p: DVec3) -> DVec4 {
        let basis = self.opacity_basis(p);
        let mut sample = self.classify_at(p, basis.x);
        sample.w = self.opacity_from(p, basis);
        sample
    }

    /// The inputs of a sample's opacity at a position: its value, HU, and its factor by gradient.
    fn opacity_basis(&self, p: DVec3) -> DVec2 {
        let factor = self.tables.own.gradient.as_ref().map_or(1.0, |table| {
            let gradient = self.patient_from_voxel_gradient * central_differences(self.volume, p);
            gradient_factor(table, gradient)
        });
        DVec2::new(sample_hu(self.volume, p), factor)
    }

    fn opacity_from(&self, p: DVec3, basis: DVec2) -> f64 {
        let opacity = self.classify_at(p, basis.x).w;
        self.tables.own.gradient.as_ref().map_or(opacity, |table| modulated(table, opacity, basis.y))
    }

    pub(super) fn opacity_at(&self, ray: &Ray, t: f64) -> f64 {
        if ray.is_cut(t) { 0.0 } else { self.sample(ray.voxel_at(t)).w }
    }

    pub(super) fn first_hit(&self, ray: &Ray, first: i32) -> f64 {
        let mut outside = ray.entry.max(ray.sample_t(f64::from(first) - 1.0));
        let mut inside = ray.sample_t(f64::from(first));
        if self.tables.own.integral.is_some() {
            let part = ray.sample_distance_mm / f64::from(PATH_PARTS);
            outside = ray.entry.max(ray.sample_t(f64::from(first) - 0.5));
            inside = outside;
            for _ in 0..PATH_PARTS {
                if self.opacity_at(ray, inside) > 0.0 {
                    break;
                }
                (outside, inside) = (inside, (inside + part).min(ray.exit));
            }
        }
        if self.opacity_at(ray, outside) > 0.0 {
            return outside;
        }
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (outside + inside);
            if self.opacity_at(ray, middle) > 0.0 { inside = middle } else { outside = middle }
        }
        inside
    }

    pub(super) fn threshold_crossing(&self, ray: &Ray, first: i32, target: f64) -> f64 {
        let (mut before, mut accumulated, mut k) = (0.0, 0.0, first);
        while k < ray.sample_count() {
            let next = accumulated + (1.0 - accumulated) * self.sample_opacity(ray, k);
            if next >= target {
                break;
            }
            (before, accumulated) = (accumulated, next);
            k += 1;
        }
        let start = (k - 1).max(0);
        let begin = ray.sample_t(f64::from(start) - 0.5);
        self.refine_crossing(ray, begin, k + 1 - start, before, target)
    }

    /// What opacity depends on is taken every quarter of a sample distance and is linear between.
    fn refine_crossing(&self, ray: &Ray, begin: f64, slabs: i32, before: f64, target: f64) -> f64 {
        let (count, part) = (slabs * PARTS, ray.sample_distance_mm / f64::from(PARTS));
        let end_of = |part_number: i32| begin + f64::from(part_number) * part;
        let basis_at = |t: f64| self.opacity_basis(ray.voxel_at(t));
        let shown =
            |t: f64, basis| if ray.is_cut(t) { 0.0 } else { self.opacity_from(ray.voxel_at(t), basis) };
        let (mut early, mut middle, mut late) = (DVec2::ZERO, DVec2::ZERO, basis_at(begin));
        let (mut settled, mut accumulated, mut j) = (before, before, 0);
        while j < count {
            (early, middle, late) = (middle, late, basis_at(end_of(j + 1)));
            let a = part_opacity(shown(end_of(j) + 0.5 * part, middle.lerp(late, 0.5)), 1);
            let next = accumulated + (1.0 - accumulated) * a;
            if next >= target {
                break;
            }
            (settled, accumulated) = (accumulated, next);
            j += 1;
        }
        if j == count {
            return end_of(count).clamp(ray.entry, ray.exit);
        }
        // Positions along the rest of the ray by parts, from the start of the previous part; the
        // first part has no previous one.
        let origin = end_of(j - 1);
        let opacity_at = |s: f64, level| {
            let basis = if s > 1.0 { middle.lerp(late, s - 1.0) } else { early.lerp(middle, s) };
            part_opacity(shown(origin + s * part, basis), level)
        };
        let (start, span) = if j == 0 { (1.0, 1) } else { (0.0, 2) };
        let s = finer_crossing(opacity_at, start, span, settled, target);
        (origin + s * part).clamp(ray.entry, ray.exit)
    }
}

/// The crossing in parts, by levels 2 and 3 of parts of parts; `opacity_at` of a place and a level.
fn finer_crossing(
    opacity_at: impl Fn(f64, i32) -> f64,
    mut start: f64,
    mut span: i32,
    mut settled: f64,
    target: f64,
) -> f64 {
    let (mut size, mut s) = (1.0, start);
    for level in 2..=LEVELS {
        size /= f64::from(PARTS);
        let (mut previous, mut accumulated, mut a, mut j) = (settled, settled, 0.0, 0);
        while j < span * PARTS {
            a = opacity_at(start + (f64::from(j) + 0.5) * size, level);
            let next = accumulated + (1.0 - accumulated) * a;
            if next >= target {
                break;
            }
            (previous, accumulated) = (accumulated, next);
            j += 1;
        }
        s = start + (f64::from(j) + share_of_part(a, accumulated, target)) * size;
        if j == span * PARTS {
            s = start + f64::from(j) * size;
            break;
        }
        start += f64::from((j - 1).max(0)) * size;
        span = (j + 1).min(2);
        settled = previous;
    }
    s
}

/// Opacity of 1/4^level of a sample's path.
fn part_opacity(opacity: f64, level: i32) -> f64 {
    1.0 - (1.0 - opacity).max(0.0).powf(0.25f64.powi(level))
}

/// How far into a part of opacity `a` the crossing lies, 0..1.
fn share_of_part(a: f64, accumulated: f64, target: f64) -> f64 {
    let whole = (1.0 - a).max(1e-30).ln();
    let needed = ((1.0 - target) / (1.0 - accumulated)).max(1e-30).ln();
    (needed / whole.min(-1e-30)).clamp(0.0, 1.0)
}
