//! A camera that circles a volume, as mouse drags, query strings and the command line describe it.

use std::ops::RangeInclusive;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::{Camera, CameraError, Projection};
use relief_base::{OutOfRange, Patient, Point, Vector};

/// A view of something round from outside: angles, zoom and shift, independent of its size.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Orbit {
    /// Degrees about the patient's long axis: 0 from the front, 90 from the patient's left, 180
    /// from behind.
    pub azimuth_deg: f64,
    /// Degrees above the horizontal: 90 from the head, -90 from the feet.
    pub elevation_deg: f64,
    /// 1 fits the whole into the picture's height; larger is closer.
    pub zoom: f64,
    /// Full vertical field of view in degrees; 0 is a parallel projection.
    pub vertical_fov_deg: f64,
}

impl Default for Orbit {
    fn default() -> Self {
        Self { azimuth_deg: 0.0, elevation_deg: 0.0, zoom: 1.0, vertical_fov_deg: 22.0 }
    }
}

impl Orbit {
    /// Turns either way, degrees.
    pub const AZIMUTHS_DEG: RangeInclusive<f64> = -3600.0..=3600.0;
    /// From the feet to the head, degrees.
    pub const ELEVATIONS_DEG: RangeInclusive<f64> = -90.0..=90.0;
    /// From a speck to a detail.
    pub const ZOOMS: RangeInclusive<f64> = 0.05..=50.0;
    /// Of a perspective; 0 is a parallel projection.
    pub const FIELDS_OF_VIEW_DEG: RangeInclusive<f64> = 5.0..=150.0;

    /// Checks every range.
    ///
    /// # Errors
    /// The first part out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        let within = |name, found: f64, range: RangeInclusive<f64>, also: &str| {
            let allowed = format!("{also}{} to {}", range.start(), range.end());
            if range.contains(&found) { Ok(()) } else { Err(OutOfRange::new(name, found, allowed)) }
        };
        within("azimuth_deg", self.azimuth_deg, Self::AZIMUTHS_DEG, "")?;
        within("elevation_deg", self.elevation_deg, Self::ELEVATIONS_DEG, "")?;
        within("zoom", self.zoom, Self::ZOOMS, "")?;
        if self.vertical_fov_deg == 0.0 {
            return Ok(());
        }
        within("vertical_fov_deg", self.vertical_fov_deg, Self::FIELDS_OF_VIEW_DEG, "0 (parallel) or ")
    }

    /// The camera that sees a sphere of `radius_mm` around `center` this way.
    ///
    /// # Errors
    /// When the resulting camera is out of range; see [`Camera::new`].
    pub fn camera(&self, center: Point<Patient>, radius_mm: f64) -> Result<Camera, CameraError> {
        let zoom = self.zoom;
        let (azimuth, elevation) = (self.azimuth_deg.to_radians(), self.elevation_deg.to_radians());
        let front = DVec3::new(azimuth.sin(), -azimuth.cos(), 0.0);
        let direction = front * elevation.cos() + DVec3::Z * elevation.sin();
        // The derivative by elevation: across the viewing direction even at the poles.
        let up = DVec3::Z * elevation.cos() - front * elevation.sin();
        let (distance, projection) = if self.vertical_fov_deg == 0.0 {
            (3.0 * radius_mm, Projection::Orthographic { height_mm: 2.0 * radius_mm / zoom })
        } else {
            let vertical_fov = self.vertical_fov_deg.to_radians();
            // Zoom narrows the field of view: the eye stays outside, and the perspective as it is.
            let distance = radius_mm / (vertical_fov / 2.0).sin();
            let narrowed = 2.0 * ((vertical_fov / 2.0).tan() / zoom).atan();
            (distance, Projection::Perspective { vertical_fov: narrowed })
        };
        let eye = Point::from_xyz(center.xyz + direction * distance);
        Camera::new(eye, center, Vector::from_xyz(up), projection)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen_from(azimuth_deg: f64, elevation_deg: f64) -> DVec3 {
        let orbit = Orbit { azimuth_deg, elevation_deg, ..Orbit::default() };
        let camera = orbit.camera(Point::new(0.0, 0.0, 0.0), 100.0).unwrap();
        camera.eye().xyz.normalize()
    }

    #[test]
    fn angles_name_the_patients_sides() {
        for (azimuth, elevation, side) in [
            (0.0, 0.0, -DVec3::Y),
            (90.0, 0.0, DVec3::X),
            (180.0, 0.0, DVec3::Y),
            (-90.0, 0.0, -DVec3::X),
            (30.0, 90.0, DVec3::Z),
            (0.0, -90.0, -DVec3::Z),
        ] {
            assert!((seen_from(azimuth, elevation) - side).length() < 1e-9, "{azimuth}, {elevation}");
        }
    }

    #[test]
    fn values_out_of_range_are_named() {
        let plain = Orbit::default();
        for (orbit, what) in [
            (Orbit { azimuth_deg: f64::NAN, ..plain }, "azimuth_deg"),
            (Orbit { elevation_deg: 1e9, ..plain }, "elevation_deg"),
            (Orbit { zoom: 0.0, ..plain }, "zoom"),
            (Orbit { vertical_fov_deg: 1.0, ..plain }, "vertical_fov_deg"),
        ] {
            assert_eq!(orbit.validate().unwrap_err().path, what);
        }
        let widest = Orbit { zoom: 50.0, vertical_fov_deg: 5.0, ..plain };
        widest.validate().unwrap();
        widest.camera(Point::new(0.0, 0.0, 0.0), 300.0).expect("every valid orbit has a camera");
    }

    #[test]
    fn the_sphere_touches_the_pictures_edge_at_zoom_one() {
        let camera = Orbit::default().camera(Point::new(1.0, 2.0, 3.0), 50.0).unwrap();
        let Projection::Perspective { vertical_fov } = camera.projection() else { panic!("a perspective") };
        assert!((camera.distance_mm() * (vertical_fov / 2.0).sin() - 50.0).abs() < 1e-9);
    }
}
