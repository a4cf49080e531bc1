//! Shadows and openness in cells; twin of `shaders/illuminate.wgsl`, in patient space, without
//! skipping.
//!
//! Each cell is computed when it is first looked up. Values are not rounded to half floats as the
//! GPU's are.

use std::sync::OnceLock;

use glam::DVec3;

use super::classify::{gradient_factor, modulated};
use super::field::{central_differences, sample_hu};
use super::labels::classify_at;
use crate::gradients::patient_from_voxel_gradient;
use crate::illumination::{Cells, DIRECTIONS, disc_rays, sphere_direction};
use crate::light::InPatient;
use crate::mode::Mode;
use crate::request::RenderRequest;
use crate::tables::Tables;
use relief_base::{Patient, Point, Vector};
use relief_volume::Volume;

/// Samples that lie on a face but for rounding count as outside.
const ON_FACE: f64 = 1e-3;

/// How a ray gathers opacity.
struct March {
    step_mm: f64,
    tables: Tables,
}

/// The cells of a volume under a request.
pub(super) struct CellsOfLight<'a> {
    volume: &'a Volume,
    request: &'a RenderRequest,
    cells: Cells,
    shadow_march: March,
    openness_march: March,
    shadows: Vec<OnceLock<[f64; 4]>>,
    openness: Vec<OnceLock<f64>>,
}

impl<'a> CellsOfLight<'a> {
    pub(super) fn new(volume: &'a Volume, request: &'a RenderRequest) -> Self {
        let cells = Cells::of(volume.grid());
        let count = |is_wanted: bool| if is_wanted { cells.dims.iter().product() } else { 0 };
        let shadows = (0..count(request.casts_shadows())).map(|_| OnceLock::new()).collect();
        let open = request.illumination.occlusion.strength > 0.0;
        let openness = (0..count(open)).map(|_| OnceLock::new()).collect();
        let march = |step_mm| {
            let marched = RenderRequest { sample_distance_mm: step_mm, ..request.clone() };
            March { step_mm, tables: Tables::new(&marched) }
        };
        let shadow_march = march(cells.shadow_step_mm());
        let openness_march = march(cells.openness_step_mm(request.illumination.occlusion.radius_mm));
        Self { volume, request, cells, shadow_march, openness_march, shadows, openness }
    }

    /// Where a sample at voxel index `p` looks up its light: a cell before its surface, whose unit
    /// normal points to the eye's side.
    pub(super) fn position(&self, p: DVec3, normal: DVec3) -> DVec3 {
        self.cells.position(p) + Cells::step_before(self.volume.grid(), normal)
    }

    /// The share of each light that reaches a position in cells.
    pub(super) fn shadows_at(&self, position: DVec3) -> [f64; 4] {
        let mut sum = [0.0; 4];
        for (at, cell, weight) in self.corners(position) {
            let shares = self.shadows[at].get_or_init(|| self.shares_of(self.place(cell)));
            for (sum, share) in sum.iter_mut().zip(shares) {
                *sum += weight * share;
            }
        }
        sum
    }

    /// The share of all directions that is open around a position in cells.
    pub(super) fn openness_at(&self, position: DVec3) -> f64 {
        let radius_mm = self.request.illumination.occlusion.radius_mm;
        let open = |cell| {
            let place = self.place(cell);
            let march = &self.openness_march;
            let all =
                (0..DIRECTIONS).map(|i| self.light_passed(march, place, sphere_direction(i), radius_mm));
            all.sum::<f64>() / DIRECTIONS as f64
        };
        let corners = self.corners(position).into_iter();
        corners.map(|(at, cell, weight)| weight * self.openness[at].get_or_init(|| open(cell))).sum()
    }

    /// Number, index and weight of the eight cells around a position; outside the outermost centres
    /// values go on.
    fn corners(&self, position: DVec3) -> [(usize, [usize; 3], f64); 8] {
        let dims = self.cells.dims;
        let last = DVec3::from(dims.map(|n| (n - 1) as f64));
        let p = (position - 0.5).clamp(DVec3::ZERO, last);
        let (base, share) = (p.floor(), p - p.floor());
        std::array::from_fn(|corner| {
            let mut weight = 1.0;
            let cell: [usize; 3] = std::array::from_fn(|axis| {
                let is_high = corner >> axis & 1 == 1;
                weight *= if is_high { share[axis] } else { 1.0 - share[axis] };
                let low = base[axis] as usize;
                (low + usize::from(is_high)).min(dims[axis] - 1)
            });
            ((cell[2] * dims[1] + cell[1]) * dims[0] + cell[0], cell, weight)
        })
    }

    fn place(&self, cell: [usize; 3]) -> DVec3 {
        let voxel = Point::from_xyz(self.cells.center(cell));
        (self.volume.grid().patient_from_voxel() * voxel).xyz
    }

    fn shares_of(&self, place: DVec3) -> [f64; 4] {
        let mut shares = [1.0; 4];
        for (light, share) in self.request.lights.iter().zip(&mut shares) {
            let (toward, longest) = match light.in_patient(&self.request.camera) {
                InPatient::Direction(direction) => (direction.xyz, f64::INFINITY),
                InPatient::Position(at) => {
                    let arm = at.xyz - place;
                    (arm / arm.length().max(1e-6), arm.length())
                }
            };
            let rays = disc_rays(light.size);
            let ray = |i: u32| {
                let direction = if rays > 1 { disc_direction(toward, light.size, i, rays) } else { toward };
                self.light_passed(&self.shadow_march, place, direction, longest)
            };
            *share = (0..rays).map(ray).sum::<f64>() / f64::from(rays);
        }
        shares
    }

    /// The share of light that passes on the last `longest` mm to a place, but for the stretch at
    /// its end.
    fn light_passed(&self, march: &March, place: DVec3, direction: DVec3, longest: f64) -> f64 {
        let (begin, step) = (self.cells.begin_mm(), march.step_mm);
        let farthest = longest.min(4.0 * self.volume.grid().bounding_radius_mm());
        let at = |t: f64| place + direction * t;
        let is_surfaces = self.request.mode == Mode::Isosurface;
        let first = if is_surfaces { begin } else { begin + 0.5 * step };
        let (mut share, mut near) = (1.0, None);
        for t in (0..).map(|k| first + f64::from(k) * step).take_while(|t| *t <= farthest - ON_FACE * step) {
            let Some(voxel) = self.shown_voxel(at(t), direction * (ON_FACE * step)) else {
                near = None;
                continue;
            };
            let hu = sample_hu(self.volume, voxel);
            if is_surfaces {
                share *= near.map_or(1.0, |near| self.past_levels(near, hu));
                near = Some(hu);
            } else {
                share *= 1.0 - self.opacity(&march.tables, voxel, hu);
            }
        }
        share
    }

    /// Voxel index of a position inside the volume and the clip region, with a margin along the ray
    /// on either side.
    fn shown_voxel(&self, place: DVec3, margin: DVec3) -> Option<DVec3> {
        let grid = self.volume.grid();
        let voxel = |place: DVec3| (grid.voxel_from_patient() * Point::from_xyz(place)).xyz;
        let clip = &self.request.clip;
        let last = DVec3::from(grid.dims().map(|n| n as f64 - 0.5));
        let is_inside = |place: DVec3| {
            let (p, point) = (voxel(place), Point::<Patient>::from_xyz(place));
            p.cmpge(DVec3::splat(-0.5)).all()
                && p.cmple(last).all()
                && clip.planes.iter().all(|plane| (point - plane.point).dot(plane.normal) >= 0.0)
        };
        let is_cut = clip
            .sphere
            .is_some_and(|s| Vector::<Patient>::length(Point::from_xyz(place) - s.center) < s.radius_mm);
        (is_inside(place - margin) && is_inside(place + margin) && !is_cut).then(|| voxel(place))
    }

    fn opacity(&self, tables: &Tables, voxel: DVec3, hu: f64) -> f64 {
        let opacity = classify_at(tables, self.request.labels.as_deref(), voxel, hu).w;
        match &tables.own.gradient {
            Some(table) if opacity > 0.0 => {
                let along_voxels = central_differences(self.volume, voxel);
                let gradient = patient_from_voxel_gradient(self.volume.grid()) * along_voxels;
                modulated(table, opacity, gradient_factor(table, gradient))
            }
            _ => opacity,
        }
    }

    fn past_levels(&self, near: f64, far: f64) -> f64 {
        let surfaces = self.request.surfaces.iter();
        let met = surfaces.filter(|surface| (near < surface.level_hu()) != (far < surface.level_hu()));
        met.map(|surface| 1.0 - surface.opacity).product()
    }
}

/// Point `i` of a light's disc, by Vogel's spiral. The disc is turned as seen from the front of the
/// patient, where the shader's start space is.
fn disc_direction(toward: DVec3, size: f64, i: u32, rays: u32) -> DVec3 {
    let turn = (f64::from(i) * 0.618_034).fract() * std::f64::consts::TAU;
    let cosine = 1.0 + ((size / 2.0).cos() - 1.0) * (f64::from(i) + 0.5) / f64::from(rays);
    let other = if toward.x.abs() > 0.7 { DVec3::Z } else { DVec3::X };
    let x = other.cross(toward).normalize();
    let y = toward.cross(x);
    toward * cosine + (x * turn.cos() + y * turn.sin()) * (1.0 - cosine * cosine).max(0.0).sqrt()
}
