//! Light in cells of a coarse grid over the volume: from each placed light, or from everywhere; as
//! `shaders/illuminate.wgsl`.
//!
//! A ray from a cell's centre gathers opacity, or meets isosurfaces, as a ray of the picture does. It
//! begins at a distance from the centre, so that the surface in which a cell lies does not count.
//! Clipped parts cast no shadow. Cells beyond the reach of anything visible are never looked up and
//! stay open.
//!
//! Spaces: start space (see `ray`) of a camera that depends on the volume alone; voxel index. Lengths
//! in mm.

use std::f64::consts::TAU;

use glam::{DAffine3, DVec3};
use relief_lanes::{Kernel, Lanes, MOST_LANES, Mask as _, Real as _, Triple};

use super::super::classification::Classification;
use super::super::light::{InPatient, Light};
use super::super::limits::depth_limits;
use super::super::mode::Mode;
use super::ray::Rays;
use super::scene::{Job, Scene};
use crate::illumination::{Cells, DIRECTIONS, LightQuantity, disc_rays, sphere_direction};

/// Less light than this counts as none.
const DARK: f64 = 1.0 / 512.0;
/// A sample that lies on a face but for rounding, in sample distances: it counts as outside.
const ON_FACE: f64 = 1e-3;
/// Longer than any ray in a volume, mm.
const ENDLESS_MM: f64 = 1e6;

/// A layer of cells that is to be filled, under a request whose camera depends on the volume alone.
pub(super) struct FillLayer<'a> {
    pub(super) job: Job<'a>,
    pub(super) cells: Cells,
    pub(super) quantity: &'a LightQuantity,
    pub(super) layer: usize,
    /// A share for each light, or the openness in the first.
    pub(super) out: &'a mut [[f32; Light::MAX]],
}

/// A light as cells have it, in start space.
struct Source<L: Lanes> {
    /// Unit vector towards a distant light, or the place of a near one.
    toward: Triple<L::Real>,
    is_near: bool,
    /// The cosine and the sine of the angle to the light's middle, and the turn about it, of each
    /// point of its disc.
    points: Vec<[f64; 3]>,
}

/// The common values of a cell's rays.
struct March<'a, L: Lanes> {
    scene: Scene<'a, L>,
    start_from_voxel: DAffine3,
    begin_mm: L::Real,
    has_surfaces: bool,
}

impl Kernel for FillLayer<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { job, cells, quantity, layer, out } = self;
        let (request, grid) = (job.request, job.volume.grid());
        let start = DVec3::new(0.0, 0.0, depth_limits(&request.camera, grid).near_mm);
        let start_from_patient =
            DAffine3::from_translation(start) * request.camera.view_from_patient().affine;
        let march = March {
            scene: job.scene(lanes),
            start_from_voxel: start_from_patient * grid.patient_from_voxel().affine,
            begin_mm: lanes.splat(cells.begin_mm()),
            has_surfaces: request.mode == Mode::Isosurface,
        };
        let (sources, directions, radius_mm) = match quantity {
            LightQuantity::Shadows(lights) => {
                (sources(lanes, lights, start_from_patient), Vec::new(), ENDLESS_MM)
            }
            LightQuantity::Openness { radius_mm } => {
                let direction = |i| start_from_patient.transform_vector3(sphere_direction(i));
                (Vec::new(), (0..DIRECTIONS).map(direction).collect(), *radius_mm)
            }
        };
        let has_paths = request.classification == Classification::PreIntegrated;
        let reach = lanes.splat((cells.reach(job.map.edge) + usize::from(has_paths)) as f64);
        let [nx, ny, _] = cells.dims;
        for row in 0..ny {
            for column in (0..nx).step_by(L::COUNT) {
                let voxel = |lane: usize| cells.center([(column + lane).min(nx - 1), row, layer]);
                let p = Triple([0, 1, 2].map(|axis| lanes.by_lane(|lane| voxel(lane)[axis])));
                let count = (nx - column).min(L::COUNT);
                let looked_up = march.scene.bricks.distance(p).le(reach) & lanes.first(count);
                if !looked_up.any() {
                    continue;
                }
                let shares = if sources.is_empty() {
                    let open = march.openness(p, &directions, radius_mm, looked_up);
                    [open; Light::MAX]
                } else {
                    march.shares(p, &sources, looked_up)
                };
                for (light, share) in shares.into_iter().enumerate() {
                    let mut stored = [lanes.scalar(0.0); MOST_LANES];
                    share.or_where_not(looked_up, lanes.splat(1.0)).store(&mut stored);
                    for (cell, share) in out[row * nx + column..][..count].iter_mut().zip(stored) {
                        cell[light] = share.into() as f32;
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn sources<L: Lanes>(lanes: L, lights: &[(InPatient, f64)], start_from_patient: DAffine3) -> Vec<Source<L>> {
    let mut sources = Vec::new();
    for &(placement, size) in lights {
        let (toward, is_near) = match placement {
            InPatient::Direction(direction) => (start_from_patient.transform_vector3(direction.xyz), false),
            InPatient::Position(place) => (start_from_patient.transform_point3(place.xyz), true),
        };
        let rays = disc_rays(size);
        // Vogel's spiral: as even as a sunflower's seeds.
        let points = (0..rays).map(|i| {
            let turn = (f64::from(i) * 0.618_034).fract() * TAU;
            let cosine = 1.0 + ((size / 2.0).cos() - 1.0) * (f64::from(i) + 0.5) / f64::from(rays);
            [cosine, (1.0 - cosine * cosine).max(0.0).sqrt(), turn]
        });
        let points = if rays > 1 { points.collect() } else { vec![[1.0, 0.0, 0.0]] };
        let toward = Triple(toward.to_array().map(|x| lanes.splat(x)));
        sources.push(Source { toward, is_near, points });
    }
    sources
}

impl<L: Lanes> March<'_, L> {
    /// Cells at voxel indices in start space.
    #[inline(always)]
    fn place(&self, voxel: Triple<L::Real>) -> Triple<L::Real> {
        let columns = self.start_from_voxel.matrix3.to_cols_array_2d();
        let triple =
            |[x, y, z]: [f64; 3]| Triple([self.scene.number(x), self.scene.number(y), self.scene.number(z)]);
        let columns = [triple(columns[0]), triple(columns[1]), triple(columns[2])];
        Triple::of_columns(columns, voxel).plus(triple(self.start_from_voxel.translation.to_array()))
    }

    /// The mean over all directions of the light that comes from the edge of the surroundings.
    #[inline(always)]
    fn openness(
        &self,
        voxel: Triple<L::Real>,
        directions: &[DVec3],
        radius_mm: f64,
        chosen: L::Mask,
    ) -> L::Real {
        let place = self.place(voxel);
        let radius = self.scene.number(radius_mm);
        let mut sum = self.scene.number(0.0);
        for direction in directions {
            let [x, y, z] = direction.to_array();
            let direction = Triple([self.scene.number(x), self.scene.number(y), self.scene.number(z)]);
            sum = sum + self.light_passed(place, direction, radius, chosen);
        }
        sum / self.scene.number(directions.len() as f64)
    }

    /// The mean over the points of each light's disc of the light that comes from there.
    #[inline(always)]
    fn shares(
        &self,
        voxel: Triple<L::Real>,
        sources: &[Source<L>],
        chosen: L::Mask,
    ) -> [L::Real; Light::MAX] {
        let number = |x: f64| self.scene.number(x);
        let place = self.place(voxel);
        let mut shares = [number(1.0); Light::MAX];
        for (source, share) in sources.iter().zip(&mut shares) {
            let (mut toward, mut longest) = (source.toward, number(ENDLESS_MM));
            if source.is_near {
                let arm = toward.minus(place);
                longest = arm.dot(arm).sqrt();
                toward = arm.over(Triple::of(longest.max(number(1e-6))));
            }
            let mut sum = number(0.0);
            for &[cosine, sine, turn] in &source.points {
                let direction = self.around(toward, [cosine, sine], turn);
                sum = sum + self.light_passed(place, direction, longest, chosen);
            }
            *share = sum / number(source.points.len() as f64);
        }
        shares
    }

    /// Directions at an angle to others, turned about them; as `shaders/lib/direction.wgsl`.
    #[inline(always)]
    fn around(&self, toward: Triple<L::Real>, [cosine, sine]: [f64; 2], turn: f64) -> Triple<L::Real> {
        if sine == 0.0 {
            return toward;
        }
        let number = |x: f64| self.scene.number(x);
        let (zero, one) = (number(0.0), number(1.0));
        let is_along_x = number(0.7).lt(toward.0[0].abs());
        let other = Triple([zero.or_where_not(is_along_x, one), one.or_where_not(is_along_x, zero), zero]);
        let x = other.cross(toward);
        let x = x.over(Triple::of(x.dot(x).sqrt()));
        let y = toward.cross(x);
        let across = x.scaled(number(turn.cos())).plus_times(y, number(turn.sin()));
        toward.scaled(number(cosine)).plus_times(across, number(sine))
    }

    /// The share of light that passes on the last `longest` mm to a place, but for the stretch at its
    /// end.
    #[inline(always)]
    fn light_passed(
        &self,
        place: Triple<L::Real>,
        direction: Triple<L::Real>,
        longest: L::Real,
        chosen: L::Mask,
    ) -> L::Real {
        self.scene.lanes.apart(
            #[inline(always)]
            || {
                let step = self.scene.view.distance_mm();
                // Each sample stands for the stretch around it; values at neighbouring samples tell of
                // surfaces between them.
                let half = self.scene.number(if self.has_surfaces { 0.0 } else { 0.5 });
                let begin = self.begin_mm + half * step;
                let rays = self.scene.view.rays_from(place, direction, longest, begin);
                let on_face = self.scene.number(ON_FACE);
                let first = ((rays.entry - begin) / step + on_face).ceil().max(self.scene.number(0.0));
                let last = ((rays.exit - begin) / step - on_face).floor();
                if self.has_surfaces {
                    self.past_surfaces(&rays, [first, last], chosen)
                } else {
                    self.past_samples(&rays, [first, last], chosen)
                }
            },
        )
    }

    #[inline(always)]
    fn past_samples(&self, rays: &Rays<L>, [first, last]: [L::Real; 2], chosen: L::Mask) -> L::Real {
        let Self { scene, .. } = self;
        let (one, dark) = (scene.number(1.0), scene.number(DARK));
        let walk = scene.bricks.walk(rays);
        let (mut share, mut k) = (one, first);
        loop {
            let alive = chosen & k.le(last) & dark.lt(share);
            if !alive.any() {
                return share;
            }
            let next = scene.bricks.next_sample(&walk, k);
            let is_empty = k.lt(next);
            let taken = alive & !is_empty;
            if taken.any() {
                let opacity = scene.opacity_at(rays, scene.view.sample_t(rays, k));
                share = (share * (one - opacity)).or_where_not(taken, share);
            }
            k = next.or_where_not(is_empty, k + one);
        }
    }

    /// Steps are shorter than bricks: see `surfaces` for why nothing is lost between empty ones.
    #[inline(always)]
    fn past_surfaces(&self, rays: &Rays<L>, [first, last]: [L::Real; 2], chosen: L::Mask) -> L::Real {
        let Self { scene, .. } = self;
        let (one, dark) = (scene.number(1.0), scene.number(DARK));
        let walk = scene.bricks.walk(rays);
        let is_cut = |k: L::Real| {
            if scene.is_cut { rays.is_cut(scene.view.sample_t(rays, k)) } else { scene.none() }
        };
        let (mut share, mut k, mut near, mut is_known) = (one, first, one, scene.none());
        loop {
            let alive = chosen & k.le(last) & dark.lt(share);
            if !alive.any() {
                return share;
            }
            // There is no surface between a visible part and a cut one.
            let cut = is_cut(k);
            let next = scene.bricks.next_sample(&walk, k);
            let is_empty = k.lt(next);
            let taken = alive & !cut & (is_known | !is_empty);
            if taken.any() {
                let hu = scene.field.hu(rays.sample_voxel(k));
                let has_before = first.lt(k) & !is_cut(k - one);
                let before = scene.field.hu(rays.sample_voxel(k - one)).or_where_not(has_before, hu);
                near = near.or_where_not(is_known, before);
                let passed = scene.past_levels(near, hu);
                share = (share * passed).or_where_not(taken, share);
                near = hu.or_where_not(taken, near);
            }
            is_known = (taken & !is_empty) | (is_known & !taken & !cut);
            k = next.max(k + one).or_where_not(is_empty & !cut, k + one);
        }
    }
}
