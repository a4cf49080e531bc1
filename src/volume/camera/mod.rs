//! Cameras: the place of the eye in patient space, and its projection.
//!
//! View space: x right, y up, looking along -z, mm. Image space: pixels, u right, v down, centres
//! at +0.5. Angles are radians inside; names that end in `_deg` are degrees. The camera of a
//! request says nothing of picture size: the vertical extent is fixed, the horizontal one follows
//! from the aspect ratio.

mod framing;
mod orbit;
mod screen;
mod slice;
mod written;

use glam::DVec3;

use relief_base::{Patient, Point, Transform, Vector, View};

pub use framing::Framing;
pub use orbit::Orbit;
pub use slice::{EdgeLabels, NamedPlane, PlaneView};
pub use written::{CameraFile, ProjectionFile, head_up};

/// How view space becomes a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Rays from the eye through a picture whose height subtends this angle, radians.
    Perspective {
        /// Full vertical field of view, radians.
        vertical_fov: f64,
    },
    /// Parallel rays; the picture's height in mm.
    Orthographic {
        /// Height of the picture, mm.
        height_mm: f64,
    },
}

/// An eye that looks at a focal point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    eye: Point<Patient>,
    look_at: Point<Patient>,
    up: Vector<Patient>,
    projection: Projection,
    lens_shift: [f64; 2],
}

/// Why a camera cannot show anything.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// A coordinate is not finite or absurdly far away.
    #[error("{what} has a coordinate of {found}, allowed: -1000000 to 1000000 mm")]
    Coordinate {
        /// The name of the point.
        what: &'static str,
        /// The coordinate.
        found: f64,
    },
    /// Eye and focal point coincide.
    #[error("eye and look_at are {0} mm apart, allowed: at least 0.001 mm")]
    NoDirection(f64),
    /// The up vector has no part across the viewing direction.
    #[error("up {0:?} is parallel to the viewing direction or zero, allowed: any direction across it")]
    NoUp([f64; 3]),
    /// The field of view is not an angle one can see through.
    #[error("vertical field of view is {0} degrees, allowed: 0.1 to 170")]
    FieldOfView(f64),
    /// A parallel projection has no eye that could look through a screen.
    #[error("a parallel projection has no eye: set projection to perspective (--fov-deg above 0)")]
    Parallel,
    /// The height of an orthographic picture is outside of its range.
    #[error("orthographic height is {0} mm, allowed: 0.001 to 1000000")]
    Height(f64),
    /// The middle of the picture is too far from the viewing axis, or there is no eye that it could
    /// be seen from.
    #[error("lens_shift is {0:?}, allowed: -10 to 10 each way in a perspective, 0 in a parallel projection")]
    LensShift([f64; 2]),
}

impl Camera {
    /// A camera at `eye` that looks at `look_at` with `up` upwards in the picture.
    ///
    /// # Errors
    /// When a coordinate is not finite, the direction or the up vector vanishes, or the projection
    /// is out of range.
    pub fn new(
        eye: Point<Patient>,
        look_at: Point<Patient>,
        up: Vector<Patient>,
        projection: Projection,
    ) -> Result<Self, CameraError> {
        for (what, xyz) in [("eye", eye.xyz), ("look_at", look_at.xyz), ("up", up.xyz)] {
            if let Some(&found) = xyz.to_array().iter().find(|c| !c.is_finite() || c.abs() > 1e6) {
                return Err(CameraError::Coordinate { what, found });
            }
        }
        let distance = eye.distance(look_at);
        if distance < 1e-3 {
            return Err(CameraError::NoDirection(distance));
        }
        let across = (look_at - eye).normalized().zip(up.normalized()).map(|(d, u)| d.cross(u).length());
        if across.is_none_or(|sine| sine < 1e-6) {
            return Err(CameraError::NoUp(up.xyz.to_array()));
        }
        match projection {
            Projection::Perspective { vertical_fov }
                if !(0.1..=170.0).contains(&vertical_fov.to_degrees()) =>
            {
                Err(CameraError::FieldOfView(vertical_fov.to_degrees()))
            }
            Projection::Orthographic { height_mm } if !(1e-3..=1e6).contains(&height_mm) => {
                Err(CameraError::Height(height_mm))
            }
            _ => Ok(Self { eye, look_at, up, projection, lens_shift: [0.0; 2] }),
        }
    }

    /// Position of the eye.
    #[must_use]
    pub fn eye(&self) -> Point<Patient> {
        self.eye
    }

    /// The focal point: in the middle of the picture.
    #[must_use]
    pub fn look_at(&self) -> Point<Patient> {
        self.look_at
    }

    /// The direction that is upwards in the picture, as given.
    #[must_use]
    pub fn up(&self) -> Vector<Patient> {
        self.up
    }

    /// The projection.
    #[must_use]
    pub fn projection(&self) -> Projection {
        self.projection
    }

    /// This camera with the middle of its picture off the viewing axis: `[right, up]` in mm at 1 mm
    /// before the eye.
    ///
    /// The frustum becomes asymmetric and the picture's plane stays across the viewing direction,
    /// as behind a lens that is shifted: whatever lies at one depth stays as it is but for its
    /// place.
    ///
    /// # Errors
    /// When a part is not finite or beyond 10, or a parallel projection, which has no eye, is to be
    /// shifted.
    pub fn with_lens_shift(self, lens_shift: [f64; 2]) -> Result<Self, CameraError> {
        let parallel = matches!(self.projection, Projection::Orthographic { .. });
        let far = |part: &f64| !(-10.0..=10.0).contains(part) || parallel && *part != 0.0;
        if lens_shift.iter().any(far) {
            return Err(CameraError::LensShift(lens_shift));
        }
        Ok(Self { lens_shift, ..self })
    }

    /// The distance of the picture's middle from the viewing axis: `[right, up]` in mm at 1 mm
    /// before the eye.
    #[must_use]
    pub fn lens_shift(&self) -> [f64; 2] {
        self.lens_shift
    }

    /// This camera moved to its right by `right_mm`, looking in the same direction. Its lens is
    /// shifted so that points at the view depth `converging_mm` keep their place in the picture. It
    /// renders one view of a 3D display.
    ///
    /// # Errors
    /// As [`Camera::with_lens_shift`]: always in a parallel projection, whose eye is nowhere.
    pub fn seen_from_beside(&self, right_mm: f64, converging_mm: f64) -> Result<Self, CameraError> {
        let right = Vector::from_xyz(self.patient_from_view().linear().x_axis) * right_mm;
        let [x, y] = self.lens_shift;
        let moved = Self { eye: self.eye + right, look_at: self.look_at + right, ..*self };
        moved.with_lens_shift([x - right_mm / converging_mm, y])
    }

    /// The camera whose rays are those of every second pixel of every second row of a picture of
    /// `size_px`, the first included, and the size of its picture: half, rounded up.
    ///
    /// # Errors
    /// As [`Camera::with_lens_shift`]: always in a parallel projection.
    pub fn every_second_pixel(&self, size_px: [u32; 2]) -> Result<(Self, [u32; 2]), CameraError> {
        let half_px = size_px.map(|side| side.div_ceil(2));
        let [width, height] = size_px.map(f64::from);
        let [half_width, half_height] = half_px.map(f64::from);
        let pixel = 2.0 * self.half_extent(size_px)[1] / height;
        let vertical_fov = 2.0 * (pixel * half_height).atan();
        let [x, y] = self.lens_shift;
        let x = x + pixel * (half_width - (width + 1.0) / 2.0);
        let y = y - pixel * (half_height - (height + 1.0) / 2.0);
        let camera = self.with_lens_shift([x, y])?;
        let projection = Projection::Perspective { vertical_fov };
        Ok((Self { projection, ..camera }, half_px))
    }

    /// Distance from the eye to the focal point, mm.
    #[must_use]
    pub fn distance_mm(&self) -> f64 {
        self.eye.distance(self.look_at)
    }

    /// Patient position of a view position. Its columns are right, up and backwards; its origin is
    /// the eye.
    #[must_use]
    pub fn patient_from_view(&self) -> Transform<Patient, View> {
        let backwards = (self.eye.xyz - self.look_at.xyz).normalize();
        let right = self.up.xyz.cross(backwards).normalize();
        let up = backwards.cross(right);
        Transform::from_axes(right, up, backwards, self.eye.xyz)
    }

    /// View position of a patient position.
    #[must_use]
    pub fn view_from_patient(&self) -> Transform<View, Patient> {
        Transform::from_affine(self.patient_from_view().affine.inverse())
    }

    /// Half the picture's extent: at 1 mm before the eye for a perspective, everywhere for a
    /// parallel projection.
    ///
    /// `[horizontal, vertical]`, in mm, for a picture of `size_px` (width, height) square pixels.
    #[must_use]
    pub fn half_extent(&self, [width, height]: [u32; 2]) -> [f64; 2] {
        let vertical = match self.projection {
            Projection::Perspective { vertical_fov } => (vertical_fov / 2.0).tan(),
            Projection::Orthographic { height_mm } => height_mm / 2.0,
        };
        [vertical * f64::from(width) / f64::from(height), vertical]
    }

    /// This camera turned about the axis `up` through its focal point, by an angle in radians,
    /// counter-clockwise as seen from the tip of `up`.
    #[must_use]
    pub fn orbited(&self, angle: f64) -> Self {
        let axis = self.up.xyz.normalize();
        let arm = glam::DQuat::from_axis_angle(axis, angle) * (self.eye.xyz - self.look_at.xyz);
        Self { eye: self.look_at + Vector::from_xyz(arm), ..*self }
    }

    /// The picture of a patient position: pixel coordinates (u right, v down, centres at +0.5) and
    /// view depth in mm.
    ///
    /// `None` behind the eye of a perspective camera.
    #[must_use]
    pub fn project(&self, point: Point<Patient>, size_px: [u32; 2]) -> Option<(f64, f64, f64)> {
        let DVec3 { x, y, z } = (self.view_from_patient() * point).xyz;
        let scale = match self.projection {
            Projection::Perspective { .. } if -z <= 0.0 => return None,
            Projection::Perspective { .. } => -z,
            Projection::Orthographic { .. } => 1.0,
        };
        let [half_x, half_y] = self.half_extent(size_px);
        let [shift_x, shift_y] = self.lens_shift;
        let u = ((x / scale - shift_x) / half_x + 1.0) / 2.0 * f64::from(size_px[0]);
        let v = (1.0 - (y / scale - shift_y) / half_y) / 2.0 * f64::from(size_px[1]);
        Some((u, v, -z))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn anterior() -> Camera {
        let projection = Projection::Perspective { vertical_fov: 90f64.to_radians() };
        let (eye, at) = (Point::new(0.0, -100.0, 0.0), Point::new(0.0, 0.0, 0.0));
        Camera::new(eye, at, Vector::new(0.0, 0.0, 1.0), projection).unwrap()
    }

    #[test]
    fn from_the_front_the_patients_left_is_on_the_right() {
        let view = anterior().view_from_patient() * Point::new(3.0, 10.0, 5.0);
        assert!((view.xyz - DVec3::new(3.0, 5.0, -110.0)).length() < 1e-12);
        let (u, v, depth) = anterior().project(Point::new(50.0, 0.0, 50.0), [200, 100]).unwrap();
        assert!((u - 125.0).abs() < 1e-9 && (v - 25.0).abs() < 1e-9 && (depth - 100.0).abs() < 1e-9);
    }

    #[test]
    fn useless_cameras_are_refused() {
        let at = Point::new(0.0, 0.0, 0.0);
        let perspective = |deg: f64| Projection::Perspective { vertical_fov: deg.to_radians() };
        let make = |eye, up, projection| Camera::new(eye, at, up, projection);
        let up = Vector::new(0.0, 0.0, 1.0);
        let eye = Point::new(0.0, -1.0, 0.0);
        assert!(matches!(make(at, up, perspective(20.0)), Err(CameraError::NoDirection(_))));
        assert!(matches!(
            make(eye, Vector::new(0.0, 2.0, 0.0), perspective(20.0)),
            Err(CameraError::NoUp(_))
        ));
        assert!(matches!(make(eye, up, perspective(180.0)), Err(CameraError::FieldOfView(_))));
        assert!(matches!(
            make(eye, up, Projection::Orthographic { height_mm: 0.0 }),
            Err(CameraError::Height(_))
        ));
        let far = Point::new(f64::NAN, 0.0, 0.0);
        assert!(matches!(make(far, up, perspective(20.0)), Err(CameraError::Coordinate { .. })));
    }

    /// By similar triangles: an eye moved by t sees a point at depth d moved by t (1/c - 1/d) at 1
    /// mm before it.
    #[test]
    fn a_camera_beside_sees_what_converges_in_place_and_the_rest_moved_by_its_depth() {
        let (size, half_px) = ([200, 100], 50.0); // 90 degrees: half the height is 1 mm at 1 mm
        for (t, depth, converging) in
            [(3.0, 60.0, 100.0), (-8.0, 150.0, 100.0), (5.0, 100.0, 100.0), (2.0, 7.0, 40.0)]
        {
            let point = Point::new(4.0, depth - 100.0, -2.5);
            let (u, v, _) = anterior().project(point, size).unwrap();
            let beside = anterior().seen_from_beside(t, converging).unwrap();
            let (moved_u, moved_v, seen_depth) = beside.project(point, size).unwrap();
            let expected = u + half_px * t * (1.0 / converging - 1.0 / depth);
            assert!((moved_u - expected).abs() < 1e-9, "{t} {depth}: {moved_u} for {expected}");
            assert!((moved_v - v).abs() < 1e-9 && (seen_depth - depth).abs() < 1e-9);
        }
    }

    #[test]
    fn a_lens_shift_moves_the_picture_as_a_whole_and_parallel_cameras_have_none() {
        let shifted = anterior().with_lens_shift([0.3, -0.2]).unwrap();
        for point in [Point::new(10.0, -20.0, 5.0), Point::new(-30.0, 80.0, 0.0)] {
            let (u, v, _) = anterior().project(point, [200, 100]).unwrap();
            let (moved_u, moved_v, _) = shifted.project(point, [200, 100]).unwrap();
            assert!((moved_u - u + 15.0).abs() < 1e-9 && (moved_v - v + 10.0).abs() < 1e-9);
        }
        let at = Point::new(0.0, 0.0, 0.0);
        let parallel = Projection::Orthographic { height_mm: 10.0 };
        let parallel = Camera::new(anterior().eye(), at, anterior().up(), parallel).unwrap();
        assert_eq!(parallel.with_lens_shift([0.0; 2]), Ok(parallel));
        for (camera, shift) in
            [(parallel, [0.1, 0.0]), (anterior(), [f64::NAN, 0.0]), (anterior(), [0.0, 11.0])]
        {
            assert!(matches!(camera.with_lens_shift(shift), Err(CameraError::LensShift(_))), "{shift:?}");
        }
    }

    #[test]
    fn orbiting_keeps_the_distance_and_turns_about_up() {
        let turned = anterior().orbited(90f64.to_radians());
        assert!((turned.eye().xyz - DVec3::new(100.0, 0.0, 0.0)).length() < 1e-9);
    }
}
