//! Rays of neighbouring pixels, one in each lane; as `shaders/lib/frame.wgsl`.
//!
//! Spaces: view space moved to the near limit of the volume ("start"), voxel index, and mm along the
//! ray.

use glam::{DAffine3, DVec3};
use relief_lanes::{Lanes, Real as _, Triple};

use super::super::limits::depth_limits;
use super::super::request::RenderRequest;
use super::super::uniform::{clip_planes_in_view, face_fade_mm, voxel_from_view};
use crate::gradients::patient_from_voxel_gradient;
use relief_volume::{Grid, Projection};

/// A sample that lies on a face but for rounding, in sample distances: it counts as outside.
const ON_FACE: f64 = 1e-3;
/// A ray along a face never meets the box of voxel centres, or only this far away, mm.
const FAR_OFF: f64 = 1e4;
/// A ray whose slope against a clip plane is below this runs along it.
const ALONG_PLANE: f64 = 1e-12;
/// An interval without any distance: its start, and minus its end, mm.
const NOWHERE_MM: f64 = 1e30;

/// The common values of a picture's rays.
pub(super) struct View<L: Lanes> {
    lanes: L,
    voxel_from_start: [Triple<L::Real>; 4],
    patient_from_view: [Triple<L::Real>; 3],
    half_extent: [L::Real; 2],
    size_px: [L::Real; 2],
    lens_shift: Option<[L::Real; 2]>,
    near_mm: L::Real,
    last_voxel: Triple<L::Real>,
    /// The patient axes of a normal that is given along voxel axes: columns of unit length.
    normal_of_axis: [Triple<L::Real>; 3],
    clip_planes: Vec<(Triple<L::Real>, L::Real)>,
    /// Centre and squared radius.
    cut: Option<(Triple<L::Real>, L::Real)>,
    distance_mm: L::Real,
    face_fade_mm: L::Real,
    per_face_fade: L::Real,
}

/// The rays of the lanes: points at t mm between `entry` and `exit`.
pub(super) struct Rays<L: Lanes> {
    /// Along the patient axes, unit length.
    pub(super) direction: Triple<L::Real>,
    origin_voxel: Triple<L::Real>,
    step_voxel: Triple<L::Real>,
    pub(super) entry: L::Real,
    pub(super) exit: L::Real,
    /// Between them the sphere cuts away.
    pub(super) cut: [L::Real; 2],
    /// Distance of sample 0, mm.
    pub(super) first: L::Real,
    first_voxel: Triple<L::Real>,
    sample_voxels: Triple<L::Real>,
    depth_step: L::Real,
    /// Normals along the patient axes, towards the eye, of the faces through which the rays enter,
    /// and of the sphere where they leave it.
    pub(super) face_normals: [Triple<L::Real>; 2],
}

impl<L: Lanes> View<L> {
    #[inline(always)]
    pub(super) fn new(lanes: L, request: &RenderRequest, grid: &Grid) -> Self {
        let camera = &request.camera;
        let near_mm = depth_limits(camera, grid).near_mm;
        let start = DVec3::new(0.0, 0.0, -near_mm);
        let voxel_from_start = voxel_from_view(camera, grid).affine * DAffine3::from_translation(start);
        let triple = |value: DVec3| Triple(value.to_array().map(|x| lanes.splat(x)));
        let columns = voxel_from_start.matrix3.to_cols_array_2d();
        let [a, b, c] = columns.map(|column| triple(column.into()));
        let turn = camera.patient_from_view().linear().to_cols_array_2d();
        let planes = &clip_planes_in_view(camera, &request.clip)[..request.clip.planes.len()];
        let cut = request.clip.sphere.map(|sphere| {
            let center = (camera.view_from_patient() * sphere.center).xyz + DVec3::Z * near_mm;
            (triple(center), lanes.splat(sphere.radius_mm * sphere.radius_mm))
        });
        // Gradients and normals are transformed alike.
        let covectors = patient_from_voxel_gradient(grid);
        let normals = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| (covectors * axis).normalize());
        let is_perspective = matches!(camera.projection(), Projection::Perspective { .. });
        Self {
            lanes,
            voxel_from_start: [a, b, c, triple(voxel_from_start.translation)],
            patient_from_view: turn.map(|column| triple(column.into())),
            half_extent: camera.half_extent(request.size_px).map(|mm| lanes.splat(mm)),
            size_px: request.size_px.map(|side| lanes.splat(side.into())),
            lens_shift: is_perspective.then(|| camera.lens_shift().map(|shift| lanes.splat(shift))),
            near_mm: lanes.splat(near_mm),
            normal_of_axis: normals.map(triple),
            last_voxel: triple(DVec3::from(grid.dims().map(|n| (n - 1) as f64))),
            clip_planes: planes
                .iter()
                .map(|&[x, y, z, d]| (triple(DVec3::new(x, y, z)), lanes.splat(d - z * near_mm)))
                .collect(),
            cut,
            distance_mm: lanes.splat(request.sample_distance_mm),
            face_fade_mm: lanes.splat(face_fade_mm(grid)),
            per_face_fade: lanes.splat(1.0 / face_fade_mm(grid)),
        }
    }

    /// The rays through the centres of pixels.
    #[inline(always)]
    pub(super) fn rays(&self, column: L::Real, row: L::Real) -> Rays<L> {
        let number = |x: f64| self.lanes.splat(x);
        let (zero, half, one, two) = (number(0.0), number(0.5), number(1.0), number(2.0));
        let x = ((column + half) / self.size_px[0] * two - one) * self.half_extent[0];
        let y = -((row + half) / self.size_px[1] * two - one) * self.half_extent[1];
        let (origin, direction) = match self.lens_shift {
            None => (Triple([x, y, zero]), Triple([zero, zero, -one])),
            Some([shift_x, shift_y]) => {
                let (x, y) = (x + shift_x, y + shift_y);
                let length = (x * x + y * y + one).sqrt();
                let direction = Triple([x / length, y / length, -one / length]);
                (Triple([x * self.near_mm, y * self.near_mm, zero]), direction)
            }
        };
        let [a, b, c, moved] = self.voxel_from_start;
        let origin_voxel = Triple::of_columns([a, b, c], origin).plus(moved);
        let step_voxel = Triple::of_columns([a, b, c], direction);
        let [box_entry, box_exit] = self.box_interval(origin_voxel, step_voxel, half);
        let [entry, exit] = self.clip_interval(origin, direction, [box_entry.max(zero), box_exit]);
        let [anchor, _] = self.box_interval(origin_voxel, step_voxel, zero);
        let anchor = anchor.or_where_not((anchor - entry).abs().lt(number(FAR_OFF)), entry);
        let distance = self.distance_mm;
        let first = anchor + ((entry - anchor) / distance + number(ON_FACE)).ceil() * distance;
        let cut = self.cut_interval(origin, direction);
        let in_patient = Triple::of_columns(self.patient_from_view, direction);
        let entry_normal = self.entry_normal(origin, direction, [origin_voxel, step_voxel], in_patient);
        Rays {
            direction: in_patient,
            face_normals: [entry_normal, self.wall_normal(origin, direction, cut[1])],
            origin_voxel,
            step_voxel,
            entry,
            exit,
            cut,
            first,
            first_voxel: origin_voxel.plus_times(step_voxel, first),
            sample_voxels: step_voxel.scaled(distance),
            depth_step: -direction.0[2],
        }
    }

    /// Rays from places in start space, at most `longest` mm long, with sample 0 at `first` mm.
    #[inline(always)]
    pub(super) fn rays_from(
        &self,
        origin: Triple<L::Real>,
        direction: Triple<L::Real>,
        longest: L::Real,
        first: L::Real,
    ) -> Rays<L> {
        let (zero, half) = (self.lanes.splat(0.0), self.lanes.splat(0.5));
        let [a, b, c, moved] = self.voxel_from_start;
        let origin_voxel = Triple::of_columns([a, b, c], origin).plus(moved);
        let step_voxel = Triple::of_columns([a, b, c], direction);
        let [entry, exit] = self.box_interval(origin_voxel, step_voxel, half);
        let inside = [entry.max(zero), exit.min(longest)];
        let [entry, exit] = self.clip_interval(origin, direction, inside);
        Rays {
            direction: Triple::of_columns(self.patient_from_view, direction),
            face_normals: [Triple::of(zero); 2],
            origin_voxel,
            step_voxel,
            entry,
            exit,
            cut: self.cut_interval(origin, direction),
            first,
            first_voxel: origin_voxel.plus_times(step_voxel, first),
            sample_voxels: step_voxel.scaled(self.distance_mm),
            depth_step: -direction.0[2],
        }
    }

    /// The stretch of rays inside the box of voxel centres, grown by `margin` voxels.
    #[inline(always)]
    fn box_interval(&self, origin: Triple<L::Real>, step: Triple<L::Real>, margin: L::Real) -> [L::Real; 2] {
        // A component of zero would give 0/0 on a face; a tiny one gives a huge interval.
        let tiny = Triple::of(self.lanes.splat(1e-20));
        let safe = tiny.or_where_not(step.abs().lt(tiny), step);
        let a = Triple::of(-margin).minus(origin).over(safe);
        let b = self.last_voxel.plus(Triple::of(margin)).minus(origin).over(safe);
        [a.min(b).largest(), a.max(b).least()]
    }

    #[inline(always)]
    fn clip_interval(
        &self,
        origin: Triple<L::Real>,
        direction: Triple<L::Real>,
        [mut entry, mut exit]: [L::Real; 2],
    ) -> [L::Real; 2] {
        let zero = self.lanes.splat(0.0);
        for &(normal, offset) in &self.clip_planes {
            let (height, slope) = (normal.dot(origin) + offset, normal.dot(direction));
            let is_along = slope.abs().lt(self.lanes.splat(ALONG_PLANE));
            let at = -height / slope.or_where_not(!is_along, self.lanes.splat(1.0));
            exit = (entry - self.lanes.splat(1.0)).or_where_not(is_along & height.lt(zero), exit);
            let enters = !is_along & zero.lt(slope);
            entry = entry.max(at).or_where_not(enters, entry);
            exit = exit.min(at).or_where_not(!is_along & !enters, exit);
        }
        [entry, exit]
    }

    /// The normals of the faces of the volume's box or the clip planes that rays pass last before
    /// their entry; towards the eye, along the patient axes.
    #[inline(always)]
    fn entry_normal(
        &self,
        origin: Triple<L::Real>,
        direction: Triple<L::Real>,
        [origin_voxel, step_voxel]: [Triple<L::Real>; 2],
        in_patient: Triple<L::Real>,
    ) -> Triple<L::Real> {
        let number = |x: f64| self.lanes.splat(x);
        let (zero, half) = (number(0.0), Triple::of(number(0.5)));
        let tiny = Triple::of(number(1e-20));
        let safe = tiny.or_where_not(step_voxel.abs().lt(tiny), step_voxel);
        let ahead = Triple::of(zero).lt(safe);
        let near = Triple::of(number(-0.5)).or_where_not(ahead, self.last_voxel.plus(half));
        let Triple([x, y, z]) = near.minus(origin_voxel).over(safe);
        let [along_x, along_y, along_z] = self.normal_of_axis;
        let mut entry = x.max(y).max(z);
        let (is_x, is_y) = (entry.le(x), entry.le(y));
        let mut normal = along_x.or_where_not([is_x; 3], along_y.or_where_not([is_y; 3], along_z));
        for &(plane, offset) in &self.clip_planes {
            let slope = plane.dot(direction);
            let enters = self.lanes.splat(ALONG_PLANE).le(slope);
            let at = -(plane.dot(origin) + offset) / slope.or_where_not(enters, number(1.0));
            let is_last = enters & entry.lt(at);
            entry = at.or_where_not(is_last, entry);
            let turned = Triple::of_columns(self.patient_from_view, plane);
            normal = turned.or_where_not([is_last; 3], normal);
        }
        let is_averted = zero.lt(normal.dot(in_patient));
        Triple::of(zero).minus(normal).or_where_not([is_averted; 3], normal)
    }

    /// The normals of the sphere that is cut away where rays leave it, along the patient axes.
    #[inline(always)]
    fn wall_normal(
        &self,
        origin: Triple<L::Real>,
        direction: Triple<L::Real>,
        cut_out: L::Real,
    ) -> Triple<L::Real> {
        let nothing = Triple::of(self.lanes.splat(0.0));
        let Some((center, radius_squared)) = self.cut else { return nothing };
        let is_met = self.lanes.splat(-NOWHERE_MM).lt(cut_out);
        let arm = center.minus(origin).plus_times(direction, -cut_out);
        let inward = arm.over(Triple::of(radius_squared.sqrt()));
        Triple::of_columns(self.patient_from_view, inward).or_where_not([is_met; 3], nothing)
    }

    /// The stretch of rays inside the sphere that is cut away.
    #[inline(always)]
    fn cut_interval(&self, origin: Triple<L::Real>, direction: Triple<L::Real>) -> [L::Real; 2] {
        let nowhere = self.lanes.splat(NOWHERE_MM);
        let Some((center, radius_squared)) = self.cut else { return [nowhere, -nowhere] };
        let to_center = center.minus(origin);
        let middle = to_center.dot(direction);
        // From the distance to the centre: squares of whole distances would lose small differences.
        let beside = to_center.plus_times(direction, -middle);
        let half_squared = radius_squared - beside.dot(beside);
        let zero = self.lanes.splat(0.0);
        let is_met = zero.lt(half_squared);
        let half = half_squared.max(zero).sqrt();
        [(middle - half).or_where_not(is_met, nowhere), (middle + half).or_where_not(is_met, -nowhere)]
    }

    /// Samples of each ray.
    #[inline(always)]
    pub(super) fn sample_counts(&self, rays: &Rays<L>) -> L::Real {
        let (zero, one) = (self.lanes.splat(0.0), self.lanes.splat(1.0));
        let last = (rays.exit - rays.first) / self.distance_mm - self.lanes.splat(ON_FACE);
        (last.floor() + one).max(zero)
    }

    /// Distance along the rays of samples k, mm; fractional k lie between samples.
    #[inline(always)]
    pub(super) fn sample_t(&self, rays: &Rays<L>, k: L::Real) -> L::Real {
        rays.first + k * self.distance_mm
    }

    /// View depth, mm.
    #[inline(always)]
    pub(super) fn depth(&self, rays: &Rays<L>, t: L::Real) -> L::Real {
        self.near_mm + rays.depth_step * t
    }

    /// One over [`Self::face_fade_mm`].
    #[inline(always)]
    pub(super) fn per_face_fade(&self) -> L::Real {
        self.per_face_fade
    }

    /// Distance over which the light of a cut face fades into that of gradients, mm.
    #[inline(always)]
    pub(super) fn face_fade_mm(&self) -> L::Real {
        self.face_fade_mm
    }

    /// Distance between samples, mm.
    #[inline(always)]
    pub(super) fn distance_mm(&self) -> L::Real {
        self.distance_mm
    }
}

impl<L: Lanes> Rays<L> {
    /// The same rays with another end, mm.
    #[inline(always)]
    pub(super) fn ending_at(&self, exit: L::Real) -> Self {
        Self { exit, ..*self }
    }

    /// Voxel index of samples k.
    #[inline(always)]
    pub(super) fn sample_voxel(&self, k: L::Real) -> Triple<L::Real> {
        self.first_voxel.plus_times(self.sample_voxels, k)
    }

    /// Voxel index of sample 0, and voxels from sample to sample.
    #[inline(always)]
    pub(super) fn line(&self) -> [Triple<L::Real>; 2] {
        [self.first_voxel, self.sample_voxels]
    }

    /// Voxel index at t mm.
    #[inline(always)]
    pub(super) fn voxel_at(&self, t: L::Real) -> Triple<L::Real> {
        self.origin_voxel.plus_times(self.step_voxel, t)
    }

    /// The vectors whose products with voxel indices of points on the rays are distances, mm, and the
    /// products at 0 mm.
    #[inline(always)]
    pub(super) fn along(&self) -> (Triple<L::Real>, L::Real) {
        let along = self.step_voxel.over(Triple::of(self.step_voxel.dot(self.step_voxel)));
        (along, along.dot(self.origin_voxel))
    }

    /// The lanes in which the sphere hides the points at t mm. It hides samples but does not move them.
    #[inline(always)]
    pub(super) fn is_cut(&self, t: L::Real) -> L::Mask {
        let [cut_in, cut_out] = self.cut;
        cut_in.lt(t) & t.lt(cut_out)
    }
}
