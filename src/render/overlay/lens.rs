//! The camera as the overlay uses it: between view space, pixels and depth, in f64.
//!
//! A position in view space is `(x, y, depth)`: x right and y up in mm, depth the view depth in mm,
//! positive in front of the eye. Pixels are (u right, v down), centres at +0.5. In the picture,
//! 1/depth (perspective) or depth (parallel) is linear along lines and over planes. This number is
//! called the slope here, and it is interpolated.

use glam::{DVec2, DVec3};

use relief_base::{Patient, Point, Transform, Vector, View};
use relief_volume::{Camera, Projection};

/// Nothing nearer to the eye's plane is drawn, mm.
pub(super) const NEAR_MM: f64 = 0.1;

/// A camera and the size of its picture.
#[derive(Clone, Debug)]
pub(super) struct Lens {
    view_from_patient: Transform<View, Patient>,
    pub(super) is_perspective: bool,
    half_extent: DVec2,
    /// Middle of the picture at depth 1, mm; 0 in a parallel projection.
    shift: DVec2,
    pub(super) size_px: DVec2,
    /// View depth of the focal point, mm.
    pub(super) focal_mm: f64,
}

impl Lens {
    pub(super) fn new(camera: &Camera, size_px: [u32; 2]) -> Self {
        Self {
            view_from_patient: camera.view_from_patient(),
            is_perspective: matches!(camera.projection(), Projection::Perspective { .. }),
            half_extent: camera.half_extent(size_px).into(),
            shift: camera.lens_shift().into(),
            size_px: DVec2::from(size_px.map(f64::from)),
            focal_mm: camera.distance_mm(),
        }
    }

    /// The place of a patient position in view: (x, y, depth).
    pub(super) fn place(&self, point: Point<Patient>) -> DVec3 {
        let DVec3 { x, y, z } = (self.view_from_patient * point).xyz;
        DVec3::new(x, y, -z)
    }

    /// A patient direction in view space: x right, y up, z towards the viewer.
    pub(super) fn turn(&self, direction: DVec3) -> DVec3 {
        (self.view_from_patient * Vector::from_xyz(direction)).xyz
    }

    /// The pixel that shows a place before the near plane.
    pub(super) fn pixel(&self, place: DVec3) -> DVec2 {
        let across = (place.truncate() / self.spread(place.z) - self.shift) / self.half_extent;
        (DVec2::new(across.x, -across.y) + 1.0) / 2.0 * self.size_px
    }

    /// The position of a pixel's ray at depth 1 (perspective) or at every depth (parallel): x and y
    /// in mm.
    pub(super) fn across(&self, pixel: DVec2) -> DVec2 {
        let ndc = pixel / self.size_px * 2.0 - 1.0;
        DVec2::new(ndc.x, -ndc.y) * self.half_extent + self.shift
    }

    /// Pixels to 1 of [`Lens::across`], to the right and downwards.
    pub(super) fn px_across(&self) -> DVec2 {
        DVec2::new(self.size_px.x, -self.size_px.y) / (2.0 * self.half_extent)
    }

    /// Length of a pixel's side at a depth, mm.
    pub(super) fn mm_per_px(&self, depth_mm: f64) -> f64 {
        2.0 * self.half_extent.y / self.size_px.y * self.spread(depth_mm)
    }

    /// The slope of a depth: linear in the picture.
    pub(super) fn slope(&self, depth_mm: f64) -> f64 {
        if self.is_perspective { 1.0 / depth_mm } else { depth_mm }
    }

    /// The depth of a slope, mm.
    pub(super) fn depth_mm(&self, slope: f64) -> f64 {
        if self.is_perspective { 1.0 / slope } else { slope }
    }

    /// The width of the view at a depth over that at depth 1.
    fn spread(&self, depth_mm: f64) -> f64 {
        if self.is_perspective { depth_mm } else { 1.0 }
    }

    /// The part of a segment that is before the near plane.
    pub(super) fn clip_segment(a: DVec3, b: DVec3) -> Option<[DVec3; 2]> {
        match (a.z >= NEAR_MM, b.z >= NEAR_MM) {
            (true, true) => Some([a, b]),
            (false, false) => None,
            (true, false) => Some([a, crossing(a, b)]),
            (false, true) => Some([crossing(a, b), b]),
        }
    }

    /// The part of a triangle that is before the near plane: three or four corners in order, or
    /// none.
    pub(super) fn clip_triangle(corners: [DVec3; 3]) -> Vec<DVec3> {
        let mut kept = Vec::with_capacity(4);
        for (i, &a) in corners.iter().enumerate() {
            let b = corners[(i + 1) % 3];
            if a.z >= NEAR_MM {
                kept.push(a);
            }
            if (a.z >= NEAR_MM) != (b.z >= NEAR_MM) {
                kept.push(crossing(a, b));
            }
        }
        kept
    }
}

/// The crossing of a segment and the near plane.
fn crossing(a: DVec3, b: DVec3) -> DVec3 {
    a.lerp(b, (NEAR_MM - a.z) / (b.z - a.z)).with_z(NEAR_MM)
}
