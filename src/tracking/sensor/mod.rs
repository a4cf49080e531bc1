//! The Wiimote's camera: from points in `Sensor` space (mm) to pixels (u right, v down) and back.
//!
//! [`Pinhole`] is the model that poses are computed with: `K = (fx, skew, cx; 0, fy, cy; 0, 0, 1)`
//! and OpenCV's `plumb_bob` distortion (k1, k2, p1, p2, k3). A published tracker writes the skew as
//! `-tan(Q) fx`; here it is the number itself. [`ThinLens`] says how distance defocuses a dot.
//! [`mod@file`] reads and writes the YAML of OpenCV and ROS.

pub(crate) mod file;
mod lens;
mod yaml;

pub use lens::{LensError, ThinLens};

use nalgebra::{Matrix2x3, Vector2, Vector3};

use super::report::SENSOR_HEIGHT;
use super::report::calibration::IrCalibration;

/// Focal length that Wiimotes have about, px: published measurements range from 1236 to 1430, with
/// units 2 % apart.
pub const TYPICAL_FOCAL_PX: f64 = 1340.0;

/// A pinhole camera with skew and radial and tangential distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    /// Focal length along u, px.
    pub fx: f64,
    /// Focal length along v, px.
    pub fy: f64,
    /// u per unit of y, px: 0 where rows and columns are perpendicular.
    pub skew: f64,
    /// Principal point, u, px.
    pub cx: f64,
    /// Principal point, v, px.
    pub cy: f64,
    /// k1, k2, p1, p2, k3.
    pub distortion: [f64; 5],
}

/// A camera that cannot be.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{what} is {found}, allowed: {allowed}")]
pub struct PinholeError {
    /// The parameter.
    pub what: &'static str,
    /// Its value.
    pub found: f64,
    /// The permitted values.
    pub allowed: &'static str,
}

impl Pinhole {
    /// A Wiimote without a calibration: 1340 px, the principal point in the middle.
    pub const TYPICAL: Self = Self::simple(TYPICAL_FOCAL_PX);

    /// Square pixels, the principal point in the middle of 1024 x 768, no distortion.
    #[must_use]
    pub const fn simple(focal_px: f64) -> Self {
        Self { fx: focal_px, fy: focal_px, skew: 0.0, cx: 511.5, cy: 383.5, distortion: [0.0; 5] }
    }

    /// A camera from the factory's four points: its focal length from the rectangle's width, and
    /// the principal point in its middle. It is an initial guess for a calibration. The geometry of
    /// the factory's rig is not published, so the guess has no weight against measurements.
    #[must_use]
    pub fn of_factory(factory: &IrCalibration) -> Self {
        /// Of the rectangle that emulators give their remotes, raw units.
        const TYPICAL_WIDTH: f64 = 769.0;
        let ([width, _], [x, y]) = (factory.size(), factory.centre());
        // Greatest difference in width of known units; beyond it the four points are not a
        // rectangle.
        let scale = (width / TYPICAL_WIDTH).clamp(0.95, 1.05);
        let v = f64::from(SENSOR_HEIGHT) - 1.0 - y;
        Self {
            cx: x.clamp(412.0, 612.0),
            cy: v.clamp(284.0, 484.0),
            ..Self::simple(TYPICAL_FOCAL_PX * scale)
        }
    }

    /// This camera, if its parameters are usable.
    ///
    /// # Errors
    /// When a number is not finite or far outside the range of cameras.
    pub fn checked(self) -> Result<Self, PinholeError> {
        let wrong = |what, found, allowed| Err(PinholeError { what, found, allowed });
        for (what, found) in [("fx", self.fx), ("fy", self.fy)] {
            if !(10.0..=1e6).contains(&found) {
                return wrong(what, found, "10 to 1000000 px");
            }
        }
        for (what, found) in [("skew", self.skew), ("cx", self.cx), ("cy", self.cy)] {
            if !found.is_finite() || found.abs() > 1e5 {
                return wrong(what, found, "-100000 to 100000 px");
            }
        }
        match self.distortion.into_iter().find(|k| !k.is_finite() || k.abs() > 1e3) {
            Some(found) => wrong("a distortion coefficient", found, "-1000 to 1000"),
            None => Ok(self),
        }
    }

    /// The pixel of a point; `None` for one that is not before the camera.
    #[must_use]
    pub fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let ray = ray_of(point)?;
        Some(self.pixel_of_ray(ray))
    }

    /// The pixel of a point and its derivative by the point's coordinates (px/mm).
    #[must_use]
    pub fn project_with_jacobian(&self, point: &Vector3<f64>) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        let ray = ray_of(point)?;
        let [dxd, dyd] = self.distortion_jacobian(ray);
        let inverse = 1.0 / point.z;
        // Derivatives of u and v by the undistorted x and y.
        let u = [self.fx * dxd[0] + self.skew * dyd[0], self.fx * dxd[1] + self.skew * dyd[1]];
        let v = [self.fy * dyd[0], self.fy * dyd[1]];
        let by_depth = |d: [f64; 2]| -(d[0] * ray[0] + d[1] * ray[1]) * inverse;
        let jacobian = Matrix2x3::new(
            u[0] * inverse,
            u[1] * inverse,
            by_depth(u),
            v[0] * inverse,
            v[1] * inverse,
            by_depth(v),
        );
        Some((self.pixel_of_ray(ray), jacobian))
    }

    /// The pixel of the ray (x, y, 1).
    #[must_use]
    pub fn pixel_of_ray(&self, ray: [f64; 2]) -> Vector2<f64> {
        let [x, y] = self.distorted(ray);
        Vector2::new(self.fx * x + self.skew * y + self.cx, self.fy * y + self.cy)
    }

    /// The ray (x, y, 1) that a pixel sees; `None` where the distortion cannot be undone.
    #[must_use]
    pub fn ray_of_pixel(&self, pixel: &Vector2<f64>) -> Option<[f64; 2]> {
        let y = (pixel.y - self.cy) / self.fy;
        let target = [(pixel.x - self.cx - self.skew * y) / self.fx, y];
        if self.distortion == [0.0; 5] {
            return Some(target);
        }
        let mut ray = target;
        for _ in 0..20 {
            let [x, y] = self.distorted(ray);
            let (ex, ey) = (x - target[0], y - target[1]);
            if ex.hypot(ey) < 1e-13 {
                return Some(ray);
            }
            let [[a, b], [c, d]] = self.distortion_jacobian(ray);
            let determinant = a * d - b * c;
            if determinant <= 1e-6 {
                return None; // beyond here the model folds over
            }
            ray = [ray[0] - (d * ex - b * ey) / determinant, ray[1] - (a * ey - c * ex) / determinant];
        }
        let [x, y] = self.distorted(ray);
        ((x - target[0]).hypot(y - target[1]) < 1e-9).then_some(ray)
    }

    fn distorted(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ]
    }

    /// Rows: derivatives of the distorted x and y by the undistorted x and y.
    fn distortion_jacobian(&self, [x, y]: [f64; 2]) -> [[f64; 2]; 2] {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3)); // d radial / d x, over x
        let mixed = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
        [
            [radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x, mixed],
            [mixed, radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x],
        ]
    }
}

/// Nearer than this, in mm, nothing is seen.
const NEAREST_MM: f64 = 1e-3;

fn ray_of(point: &Vector3<f64>) -> Option<[f64; 2]> {
    (point.z > NEAREST_MM).then(|| [point.x / point.z, point.y / point.z])
}

#[cfg(test)]
mod tests {
    use super::*;

    const BENT: Pinhole = Pinhole {
        fx: 1300.0,
        fy: 1350.0,
        skew: 4.0,
        cx: 500.0,
        cy: 390.0,
        distortion: [-0.2, 0.1, 0.003, -0.002, 0.05],
    };

    /// By hand: x = 0.1, y = -0.05 at one metre.
    #[test]
    fn a_point_projects_through_k() {
        let plain = Pinhole { distortion: [0.0; 5], ..BENT };
        let pixel = plain.project(&Vector3::new(100.0, -50.0, 1000.0)).unwrap();
        assert!((pixel - Vector2::new(130.0 - 0.2 + 500.0, -67.5 + 390.0)).norm() < 1e-12);
        assert_eq!(plain.project(&Vector3::new(1.0, 1.0, -5.0)), None);
        assert_eq!(plain.project(&Vector3::new(1.0, 1.0, 0.0)), None);
    }

    #[test]
    fn pixels_and_rays_are_inverse_all_over_the_picture() {
        for (u, v) in [(0.0, 0.0), (511.5, 383.5), (1023.0, 0.0), (30.0, 760.0), (1023.0, 767.0)] {
            let pixel = Vector2::new(u, v);
            let ray = BENT.ray_of_pixel(&pixel).unwrap();
            assert!((BENT.pixel_of_ray(ray) - pixel).norm() < 1e-8, "{u} {v}");
        }
    }

    /// The derivative against central differences.
    #[test]
    fn the_jacobian_is_the_derivative() {
        let point = Vector3::new(-180.0, 140.0, 900.0);
        let (_, jacobian) = BENT.project_with_jacobian(&point).unwrap();
        for axis in 0..3 {
            let mut step = Vector3::zeros();
            step[axis] = 1e-3;
            let difference =
                (BENT.project(&(point + step)).unwrap() - BENT.project(&(point - step)).unwrap()) / 2e-3;
            assert!((jacobian.column(axis) - difference).norm() < 1e-7, "axis {axis}");
        }
    }

    #[test]
    fn impossible_cameras_are_refused() {
        let message = |camera: Pinhole| camera.checked().unwrap_err().to_string();
        assert!(message(Pinhole { fx: -1.0, ..BENT }).contains("fx is -1, allowed: 10 to 1000000 px"));
        assert!(message(Pinhole { cy: f64::NAN, ..BENT }).contains("cy is NaN"));
        assert!(message(Pinhole { distortion: [f64::INFINITY; 5], ..BENT }).contains("distortion"));
        assert_eq!(BENT.checked(), Ok(BENT));
    }
}
