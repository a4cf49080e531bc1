//! A thin lens: how large a dot looks when it is not where the lens is focused.
//!
//! With `1/f = 1/d + 1/v`, the sensor stands at `v` behind the lens when it is focused at `d`. A
//! point at `z` is then blurred into a disc of diameter `A v |1/z - 1/d|`, A being the aperture's
//! diameter. As a pinhole, the camera has the focal length `v`, not `f`: the same number in pixels
//! for every distance, since the sensor does not move.

use super::Pinhole;

/// A lens and the sensor behind it. All lengths in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThinLens {
    focal_mm: f64,
    aperture_mm: f64,
    focus_mm: f64,
    pixel_mm: f64,
}

/// A lens that forms no picture.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum LensError {
    /// A length that is not one.
    #[error("{what} is {found} mm, allowed: more than 0, finite")]
    Length {
        /// Its name.
        what: &'static str,
        /// Its value.
        found: f64,
    },
    /// Focused at or within its focal length.
    #[error("focused at {focus_mm} mm, allowed: more than the focal length of {focal_mm} mm")]
    Focus {
        /// The focused distance.
        focus_mm: f64,
        /// The focal length.
        focal_mm: f64,
    },
}

impl ThinLens {
    /// A lens of `focal_mm` and an aperture of `aperture_mm` across, focused at `focus_mm`;
    /// `pixel_mm` is a pixel's side.
    ///
    /// # Errors
    /// When a length is not positive, or the focused distance is within the focal length.
    pub fn new(focal_mm: f64, aperture_mm: f64, focus_mm: f64, pixel_mm: f64) -> Result<Self, LensError> {
        let lengths = [
            ("the focal length", focal_mm),
            ("the aperture", aperture_mm),
            ("the focused distance", focus_mm),
            ("the pixel", pixel_mm),
        ];
        if let Some((what, found)) = lengths.into_iter().find(|(_, mm)| !(mm.is_finite() && *mm > 0.0)) {
            return Err(LensError::Length { what, found });
        }
        if focus_mm <= focal_mm {
            return Err(LensError::Focus { focus_mm, focal_mm });
        }
        Ok(Self { focal_mm, aperture_mm, focus_mm, pixel_mm })
    }

    /// Distance from lens to sensor, mm.
    #[must_use]
    pub fn sensor_distance_mm(&self) -> f64 {
        self.focal_mm * self.focus_mm / (self.focus_mm - self.focal_mm)
    }

    /// The pinhole camera with the same picture, principal point in the middle.
    #[must_use]
    pub fn pinhole(&self) -> Pinhole {
        Pinhole::simple(self.sensor_distance_mm() / self.pixel_mm)
    }

    /// Diameter in px of the disc into which a point at `depth_mm` is blurred.
    #[must_use]
    pub fn blur_px(&self, depth_mm: f64) -> f64 {
        let defocus = (1.0 / depth_mm - 1.0 / self.focus_mm).abs();
        self.aperture_mm * self.sensor_distance_mm() * defocus / self.pixel_mm
    }

    /// Diameter in px of the picture of a dot of `diameter_mm` at `depth_mm`: its own size and the
    /// blur.
    #[must_use]
    pub fn dot_px(&self, diameter_mm: f64, depth_mm: f64) -> f64 {
        self.sensor_distance_mm() * diameter_mm / depth_mm / self.pixel_mm + self.blur_px(depth_mm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rays through both edges of the aperture, followed to the sensor by the lens equation.
    #[test]
    fn blur_is_where_the_outermost_rays_land() {
        let lens = ThinLens::new(4.0, 2.0, 1500.0, 0.004).unwrap();
        let sensor = lens.sensor_distance_mm();
        assert!((1.0 / 4.0 - 1.0 / 1500.0 - 1.0 / sensor).abs() < 1e-15);
        for depth in [300.0, 1000.0, 1500.0, 5000.0] {
            let image = 1.0 / (1.0 / 4.0 - 1.0 / depth);
            let width = 2.0 * (1.0 - sensor / image).abs() / 0.004; // of the cone of rays at the sensor
            assert!((lens.blur_px(depth) - width).abs() < 1e-9, "{depth} mm");
        }
        assert_eq!(lens.blur_px(1500.0), 0.0);
        assert!((lens.pinhole().fx - sensor / 0.004).abs() < 1e-9);
        assert!((lens.dot_px(5.0, 1500.0) - sensor * 5.0 / 1500.0 / 0.004).abs() < 1e-12);
    }

    #[test]
    fn lenses_that_form_no_picture_are_refused() {
        assert!(ThinLens::new(0.0, 1.0, 1.0, 1.0).unwrap_err().to_string().contains("focal length is 0 mm"));
        assert!(matches!(ThinLens::new(4.0, 1.0, 4.0, 0.1), Err(LensError::Focus { .. })));
    }
}
