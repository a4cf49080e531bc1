//! Planes through a volume, seen head-on as radiologists see them, and the letters at a picture's
//! edges.
//!
//! It defines the standard planes, the camera that looks at a plane, and DICOM's letters for
//! patient directions. It cuts nothing: the renderer's mode `slice` cuts through the focal point of
//! such a camera. Patient space (LPS), mm.

use glam::DVec3;

use super::{Camera, CameraError, Projection};
use relief_base::{Patient, Point, Vector};

/// The planes that have names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NamedPlane {
    /// Across the long axis, seen from the feet: the patient's right on the left, anterior up.
    #[default]
    Axial,
    /// Seen from the left side: anterior on the left, the head up.
    Sagittal,
    /// Seen from the front: the patient's right on the left, the head up.
    Coronal,
}

impl NamedPlane {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Axial, Self::Sagittal, Self::Coronal];

    /// The name in requests.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Axial => "axial",
            Self::Sagittal => "sagittal",
            Self::Coronal => "coronal",
        }
    }

    /// The plane of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|plane| plane.name() == name)
    }

    /// How it is looked at.
    #[must_use]
    pub const fn view(self) -> PlaneView {
        let (towards_eye, up) = match self {
            Self::Axial => (DVec3::NEG_Z, DVec3::NEG_Y),
            Self::Sagittal => (DVec3::X, DVec3::Z),
            Self::Coronal => (DVec3::NEG_Y, DVec3::Z),
        };
        PlaneView { towards_eye: Vector::from_xyz(towards_eye), up: Vector::from_xyz(up) }
    }

    /// The patient axis along which slices of this plane are counted: to the head, to the left, to
    /// the back.
    #[must_use]
    pub const fn offset_axis(self) -> Vector<Patient> {
        Vector::from_xyz(match self {
            Self::Axial => DVec3::Z,
            Self::Sagittal => DVec3::X,
            Self::Coronal => DVec3::Y,
        })
    }
}

/// A direction of planes and the side from which they are seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneView {
    /// The plane's normal on the side of the eye; any length above zero.
    pub towards_eye: Vector<Patient>,
    /// The direction that is up in the picture; need not lie in the plane.
    pub up: Vector<Patient>,
}

impl PlaneView {
    /// The parallel camera that sees the plane through `center`, which is in the middle of the
    /// picture.
    ///
    /// The eye is `distance_mm` away: that is the view depth of the whole plane.
    ///
    /// # Errors
    /// As [`Camera::new`]: when the normal has no length, is along `up`, or a length is out of
    /// range.
    pub fn camera(
        &self,
        center: Point<Patient>,
        distance_mm: f64,
        height_mm: f64,
    ) -> Result<Camera, CameraError> {
        let towards_eye = self.towards_eye.normalized().ok_or(CameraError::NoDirection(0.0))?;
        let projection = Projection::Orthographic { height_mm };
        Camera::new(center + towards_eye * distance_mm, center, self.up, projection)
    }

    /// The height in mm of the smallest picture of `size_px` around `center` that shows all of
    /// these points.
    ///
    /// `None` when normal and up do not span a picture.
    #[must_use]
    pub fn fitting_height_mm(
        &self,
        points: &[Point<Patient>],
        center: Point<Patient>,
        [width, height]: [u32; 2],
    ) -> Option<f64> {
        let towards_eye = self.towards_eye.normalized()?;
        let right = self.up.cross(towards_eye).normalized()?;
        let up = towards_eye.cross(right);
        let reach = |axis: Vector<Patient>| {
            points.iter().map(|point| (*point - center).dot(axis).abs()).fold(0.0, f64::max)
        };
        Some(2.0 * reach(up).max(reach(right) * f64::from(height) / f64::from(width)))
    }
}

/// The letters of a patient direction: up to three of L and R, A and P, H and F, the largest
/// component first.
///
/// As in DICOM's Patient Orientation (0020,0020). Components below 1e-4 of the whole have no
/// letter; a direction of no length has none at all.
#[must_use]
pub(crate) fn orientation_label(direction: Vector<Patient>) -> String {
    const LEAST: f64 = 1e-4;
    let Some(direction) = direction.normalized() else { return String::new() };
    let mut parts: Vec<(f64, char)> = direction
        .xyz
        .to_array()
        .into_iter()
        .zip([('L', 'R'), ('P', 'A'), ('H', 'F')])
        .map(|(part, (positive, negative))| (part.abs(), if part > 0.0 { positive } else { negative }))
        .filter(|(size, _)| *size >= LEAST)
        .collect();
    parts.sort_by(|a, b| b.0.total_cmp(&a.0)); // stable: equal parts keep the order x, y, z
    parts.into_iter().map(|(_, letter)| letter).collect()
}

/// The patient directions that lie beyond a picture's edges, as letters.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct EdgeLabels {
    /// Beyond the left edge.
    pub left: String,
    /// Beyond the right edge.
    pub right: String,
    /// Beyond the top edge.
    pub top: String,
    /// Beyond the bottom edge.
    pub bottom: String,
}

impl Camera {
    /// The letters at the edges of this camera's pictures.
    #[must_use]
    pub fn edge_labels(&self) -> EdgeLabels {
        let axes = self.patient_from_view().linear();
        let label = |axis: DVec3| orientation_label(Vector::from_xyz(axis));
        EdgeLabels {
            left: label(-axes.x_axis),
            right: label(axes.x_axis),
            top: label(axes.y_axis),
            bottom: label(-axes.y_axis),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ORIGIN: Point<Patient> = Point::new(0.0, 0.0, 0.0);

    /// Invariant: Slices follow the radiological convention, and their edge labels say so.
    #[test]
    fn named_planes_are_seen_by_the_radiological_convention() {
        for (plane, [left, right, top, bottom], eye) in [
            (NamedPlane::Axial, ["R", "L", "A", "P"], DVec3::NEG_Z),
            (NamedPlane::Coronal, ["R", "L", "H", "F"], DVec3::NEG_Y),
            (NamedPlane::Sagittal, ["A", "P", "H", "F"], DVec3::X),
        ] {
            let camera = plane.view().camera(ORIGIN, 100.0, 50.0).unwrap();
            let labels = camera.edge_labels();
            let found = [&labels.left, &labels.right, &labels.top, &labels.bottom];
            assert_eq!(found, [left, right, top, bottom], "{}", plane.name());
            assert_eq!(camera.eye().xyz, eye * 100.0, "{}", plane.name());
        }
    }

    #[test]
    fn labels_name_the_largest_component_first() {
        for (direction, label) in [
            ([1.0, 0.0, 0.0], "L"),
            ([-2.0, 0.0, 0.0], "R"),
            ([0.0, -1.0, 0.0], "A"),
            ([0.0, 3.0, 0.0], "P"),
            ([0.0, 0.0, 1.0], "H"),
            ([0.0, 0.0, -1.0], "F"),
            ([-0.5, 0.8, 0.0], "PR"),
            ([0.2, -0.3, -0.9], "FAL"),
            ([1.0, 1.0, 0.0], "LP"),
            ([1.0, 1e-6, -1e-6], "L"),
            ([0.0, 0.0, 0.0], ""),
        ] {
            assert_eq!(orientation_label(Vector::from_xyz(direction.into())), label, "{direction:?}");
        }
    }

    #[test]
    fn the_fitting_height_shows_every_point_and_no_more() {
        let points = [Point::new(-30.0, -10.0, -5.0), Point::new(30.0, 20.0, 5.0)];
        let axial = NamedPlane::Axial.view();
        // Half-extents 30 across and 20 up.
        assert_eq!(axial.fitting_height_mm(&points, ORIGIN, [100, 100]), Some(60.0));
        assert_eq!(axial.fitting_height_mm(&points, ORIGIN, [300, 100]), Some(40.0));
        let flat = PlaneView { towards_eye: Vector::new(0.0, 0.0, 1.0), up: Vector::new(0.0, 0.0, 2.0) };
        assert_eq!(flat.fitting_height_mm(&points, ORIGIN, [10, 10]), None);
    }

    #[test]
    fn a_plane_without_a_side_is_refused() {
        let none = PlaneView { towards_eye: Vector::new(0.0, 0.0, 0.0), up: Vector::new(0.0, 0.0, 1.0) };
        assert_eq!(none.camera(ORIGIN, 10.0, 10.0), Err(CameraError::NoDirection(0.0)));
    }
}
