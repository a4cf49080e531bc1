//! The view of an eye through a screen, as through a window (R. Kooima, "Generalized perspective
//! projection", 2009).

use glam::DVec3;

use super::{Camera, CameraError, Projection};
use relief_base::Point;

impl Camera {
    /// The camera of an eye that looks through a screen.
    ///
    /// The screen is this camera's picture at the view depth `screen_mm`, and `width_mm` wide in
    /// the room: one mm of the room is so much of the patient. `eye_mm` is the eye in the room, from
    /// the middle of the screen: right, up and towards the viewer, mm. Points in the plane of the
    /// screen keep their place in the picture, whatever the eye's place.
    ///
    /// # Errors
    /// When the eye is in or behind the screen, or so near to it that the field of view is out of
    /// range; always in a parallel projection.
    pub fn seen_through_screen(
        &self,
        size_px: [u32; 2],
        screen_mm: f64,
        width_mm: f64,
        eye_mm: [f64; 3],
    ) -> Result<Self, CameraError> {
        let [half_width, half_height] = self.half_extent(size_px).map(|half| half * screen_mm);
        if matches!(self.projection, Projection::Orthographic { .. }) {
            return Err(CameraError::Parallel);
        }
        let [x, y, z] = eye_mm.map(|mm| mm * 2.0 * half_width / width_mm);
        let [shift_x, shift_y] = self.lens_shift.map(|shift| shift * screen_mm);
        let patient_from_view = self.patient_from_view();
        let place = |view: DVec3| Point::from_xyz(patient_from_view.affine.transform_point3(view));
        let (eye, foot) = (
            DVec3::new(shift_x + x, shift_y + y, z - screen_mm),
            DVec3::new(shift_x + x, shift_y + y, -screen_mm),
        );
        let projection = Projection::Perspective { vertical_fov: 2.0 * (half_height / z).atan() };
        Self::new(place(eye), place(foot), self.up, projection)?.with_lens_shift([-x / z, -y / z])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat4, DVec4};
    use relief_base::Vector;

    const SIZE: [u32; 2] = [960, 540];

    fn base() -> Camera {
        let projection = Projection::Perspective { vertical_fov: 22f64.to_radians() };
        let (eye, at) = (Point::new(200.0, -800.0, 120.0), Point::new(10.0, 5.0, -20.0));
        Camera::new(eye, at, Vector::new(0.1, 0.0, 1.0), projection).unwrap()
    }

    /// Kooima's projection of a point, from the corners of the screen and the eye, to pixels.
    fn kooima([lower_left, lower_right, upper_left]: [DVec3; 3], eye: DVec3, point: DVec3) -> [f64; 2] {
        let right = (lower_right - lower_left).normalize();
        let up = (upper_left - lower_left).normalize();
        let normal = right.cross(up).normalize();
        let corners = [lower_left, lower_right, upper_left].map(|corner| corner - eye);
        let distance = -corners[0].dot(normal);
        let (near, far) = (1.0, 1e5);
        let [l, r] = [0, 1].map(|corner: usize| right.dot(corners[corner]) * near / distance);
        let [b, t] = [0, 2].map(|corner: usize| up.dot(corners[corner]) * near / distance);
        let frustum = DMat4::from_cols(
            DVec4::new(2.0 * near / (r - l), 0.0, 0.0, 0.0),
            DVec4::new(0.0, 2.0 * near / (t - b), 0.0, 0.0),
            DVec4::new((r + l) / (r - l), (t + b) / (t - b), -(far + near) / (far - near), -1.0),
            DVec4::new(0.0, 0.0, -2.0 * far * near / (far - near), 0.0),
        );
        let turned =
            DMat4::from_cols(right.extend(0.0), up.extend(0.0), normal.extend(0.0), DVec4::W).transpose();
        let clip = frustum * turned * DMat4::from_translation(-eye) * point.extend(1.0);
        [
            (clip.x / clip.w + 1.0) / 2.0 * f64::from(SIZE[0]),
            (1.0 - clip.y / clip.w) / 2.0 * f64::from(SIZE[1]),
        ]
    }

    #[test]
    fn points_appear_where_kooimas_matrices_have_them() {
        let (base, screen_mm, width_mm) = (base(), 780.0, 930.0);
        let from_view = base.patient_from_view().affine;
        let [half_x, half_y] = base.half_extent(SIZE).map(|half| half * screen_mm);
        let corner =
            |x: f64, y: f64| from_view.transform_point3(DVec3::new(x * half_x, y * half_y, -screen_mm));
        let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(-1.0, 1.0)];
        for eye_mm in [[0.0, 0.0, 1860.0], [-32.5, 0.0, 600.0], [400.0, -150.0, 900.0], [0.0, 300.0, 2500.0]]
        {
            let scale = 2.0 * half_x / width_mm;
            let [x, y, z] = eye_mm.map(|mm| mm * scale);
            let eye = from_view.transform_point3(DVec3::new(x, y, z - screen_mm));
            let seen = base.seen_through_screen(SIZE, screen_mm, width_mm, eye_mm).unwrap();
            assert!((seen.eye().xyz - eye).length() < 1e-9);
            for [x, y, z] in [[0.0, 0.0, 0.0], [60.0, -40.0, 30.0], [-80.0, 20.0, -90.0], [15.0, 70.0, 110.0]]
            {
                let point = Point::new(x, y, z);
                let [u, v] = kooima(corners, eye, point.xyz);
                let (found_u, found_v, _) = seen.project(point, SIZE).unwrap();
                assert!((found_u - u).abs() < 1e-6 && (found_v - v).abs() < 1e-6, "{eye_mm:?} {point:?}");
            }
            // The plane of the screen stays as it is.
            for at in [corner(0.3, -0.7), corner(-0.9, 0.9)] {
                let places = [&base, &seen].map(|camera| camera.project(Point::from_xyz(at), SIZE).unwrap());
                assert!((places[0].0 - places[1].0).abs() < 1e-6 && (places[0].1 - places[1].1).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn eyes_that_see_nothing_through_the_screen_are_refused() {
        let through = |eye_mm| base().seen_through_screen(SIZE, 780.0, 930.0, eye_mm);
        for eye_mm in
            [[0.0, 0.0, 0.0], [0.0, 0.0, -500.0], [0.0, 0.0, 1.0], [f64::NAN, 0.0, 600.0], [1e5, 0.0, 600.0]]
        {
            assert!(through(eye_mm).is_err(), "{eye_mm:?}");
        }
        let projection = Projection::Orthographic { height_mm: 400.0 };
        let parallel = Camera::new(base().eye(), base().look_at(), base().up(), projection).unwrap();
        assert!(matches!(
            parallel.seen_through_screen(SIZE, 780.0, 930.0, [0.0, 0.0, 600.0]),
            Err(CameraError::Parallel)
        ));
    }
}
