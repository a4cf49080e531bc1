//! The ray of a pixel; twin of `shaders/lib/frame.wgsl`. View space and voxel index, mm along the
//! ray.

use glam::{DAffine3, DMat3, DVec3};

use crate::request::{Clip, RenderRequest};
use crate::uniform::{clip_planes_in_view, voxel_from_view};
use relief_volume::{Grid, Projection};

/// A sample that lies on a face but for rounding, in sample distances.
const ON_FACE: f64 = 1e-3;
/// A ray along a face never meets the box of voxel centres, or only this far away, mm.
const FAR_OFF: f64 = 1e4;

/// Points `origin + direction * t` for t in mm between `entry` and `exit`.
pub(super) struct Ray {
    /// Along the patient axes, unit length.
    pub(super) direction: DVec3,
    origin_voxel: DVec3,
    step_voxel: DVec3,
    pub(super) entry: f64,
    pub(super) exit: f64,
    /// Between them the sphere cuts away.
    cut: Option<(f64, f64)>,
    first: f64,
    depth_origin: f64,
    depth_step: f64,
    pub(super) sample_distance_mm: f64,
}

/// Values that the rays of one picture share.
pub(super) struct Rays<'a> {
    request: &'a RenderRequest,
    voxel_from_view: DAffine3,
    patient_from_view: DMat3,
    dims: DVec3,
    clip_planes: [[f64; 4]; Clip::MAX_PLANES],
    /// Centre in view space and radius in mm.
    cut: Option<(DVec3, f64)>,
}

impl<'a> Rays<'a> {
    pub(super) fn new(request: &'a RenderRequest, grid: &Grid) -> Self {
        let dims = DVec3::from(grid.dims().map(|n| n as f64));
        let voxel_from_view = voxel_from_view(&request.camera, grid).affine;
        let clip_planes = clip_planes_in_view(&request.camera, &request.clip);
        let patient_from_view = request.camera.patient_from_view().linear();
        let view_from_patient = request.camera.view_from_patient();
        let cut =
            request.clip.sphere.map(|sphere| ((view_from_patient * sphere.center).xyz, sphere.radius_mm));
        Self { request, voxel_from_view, patient_from_view, dims, clip_planes, cut }
    }

    pub(super) fn ray_of_pixel(&self, [column, row]: [u32; 2]) -> Ray {
        let [width, height] = self.request.size_px.map(f64::from);
        let [half_x, half_y] = self.request.camera.half_extent(self.request.size_px);
        let x = ((f64::from(column) + 0.5) / width * 2.0 - 1.0) * half_x;
        let y = -((f64::from(row) + 0.5) / height * 2.0 - 1.0) * half_y;
        let (origin, direction) = match self.request.camera.projection() {
            Projection::Orthographic { .. } => (DVec3::new(x, y, 0.0), DVec3::NEG_Z),
            Projection::Perspective { .. } => {
                let [shift_x, shift_y] = self.request.camera.lens_shift();
                (DVec3::ZERO, DVec3::new(x + shift_x, y + shift_y, -1.0).normalize())
            }
        };
        let origin_voxel = self.voxel_from_view.transform_point3(origin);
        let step_voxel = self.voxel_from_view.transform_vector3(direction);
        let (box_entry, box_exit) = self.box_interval(origin_voxel, step_voxel, 0.5);
        let (entry, exit) = self.clip_interval(origin, direction, box_entry.max(0.0), box_exit);
        let (inner_entry, _) = self.box_interval(origin_voxel, step_voxel, 0.0);
        let anchor = if (inner_entry - entry).abs() < FAR_OFF { inner_entry } else { entry };
        let distance = self.request.sample_distance_mm;
        let first = anchor + ((entry - anchor) / distance + ON_FACE).ceil() * distance;
        let sample_distance_mm = self.request.sample_distance_mm;
        let (depth_origin, depth_step) = (-origin.z, -direction.z);
        Ray {
            direction: self.patient_from_view * direction,
            origin_voxel,
            step_voxel,
            entry,
            exit,
            cut: self.cut.and_then(|(center, radius_mm)| cut_interval(origin, direction, center, radius_mm)),
            first,
            depth_origin,
            depth_step,
            sample_distance_mm,
        }
    }

    fn box_interval(&self, origin: DVec3, step: DVec3, margin: f64) -> (f64, f64) {
        let safe = step.map(|x| if x.abs() < 1e-20 { 1e-20 } else { x });
        let a = (DVec3::splat(-margin) - origin) / safe;
        let b = (self.dims - 1.0 + margin - origin) / safe;
        (a.min(b).max_element(), a.max(b).min_element())
    }

    fn clip_interval(&self, origin: DVec3, direction: DVec3, entry: f64, exit: f64) -> (f64, f64) {
        let (mut entry, mut exit) = (entry, exit);
        for &[nx, ny, nz, offset] in &self.clip_planes[..self.request.clip.planes.len()] {
            let normal = DVec3::new(nx, ny, nz);
            let (height, slope) = (normal.dot(origin) + offset, normal.dot(direction));
            if slope.abs() < 1e-12 {
                if height < 0.0 {
                    exit = entry - 1.0;
                }
            } else if slope > 0.0 {
                entry = entry.max(-height / slope);
            } else {
                exit = exit.min(-height / slope);
            }
        }
        (entry, exit)
    }
}

/// Where a ray is inside a sphere.
fn cut_interval(origin: DVec3, direction: DVec3, center: DVec3, radius_mm: f64) -> Option<(f64, f64)> {
    let to_center = center - origin;
    let middle = to_center.dot(direction);
    let half_squared = radius_mm * radius_mm - (to_center - middle * direction).length_squared();
    (half_squared > 0.0).then(|| (middle - half_squared.sqrt(), middle + half_squared.sqrt()))
}

impl Ray {
    pub(super) fn is_cut(&self, t: f64) -> bool {
        self.cut.is_some_and(|(cut_in, cut_out)| t > cut_in && t < cut_out)
    }

    pub(super) fn sample_count(&self) -> i32 {
        (((self.exit - self.first) / self.sample_distance_mm - ON_FACE).floor() + 1.0).max(0.0) as i32
    }

    /// Distance along the ray of sample k, mm; fractional k lie between samples.
    pub(super) fn sample_t(&self, k: f64) -> f64 {
        self.first + k * self.sample_distance_mm
    }

    pub(super) fn voxel_at(&self, t: f64) -> DVec3 {
        self.origin_voxel + self.step_voxel * t
    }

    pub(super) fn view_depth(&self, t: f64) -> f64 {
        self.depth_origin + self.depth_step * t
    }
}
