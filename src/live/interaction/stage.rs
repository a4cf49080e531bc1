//! The properties of the displayed volume that a view depends on.

use relief_base::{OutOfRange, Patient, Point, Vector};
use relief_volume::{Grid, Orbit};

/// The volume's bounding sphere, the sphere that views are fitted to, the picture, the presets, and the
/// view to begin with.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    pub(super) center: Point<Patient>,
    pub(super) radius_mm: f64,
    pub(super) home_center: Point<Patient>,
    pub(super) home_radius_mm: f64,
    /// Width by height of the narrowest picture in which the home sphere shows all.
    pub(super) narrowest_aspect: f64,
    pub(super) size_px: [u32; 2],
    pub(super) presets: Vec<String>,
    pub(super) home: Home,
}

/// The view that a session begins with, and that a reset returns to.
#[derive(Clone, Debug, PartialEq)]
pub struct Home {
    /// Angles, zoom and field of view.
    pub orbit: Orbit,
    /// One of the stage's presets; `None` where the volume is shown otherwise.
    pub preset: Option<String>,
}

impl Home {
    /// The initial view of the page.
    pub const ORBIT: Orbit =
        Orbit { azimuth_deg: 20.0, elevation_deg: 10.0, zoom: 1.0, vertical_fov_deg: 22.0 };
}

impl Stage {
    /// Radii of bounding spheres, mm: every view of such a sphere has a camera.
    pub const RADII_MM: std::ops::RangeInclusive<f64> = 0.1..=1e4;
    /// Farthest coordinate of its centre, mm.
    pub const MAX_CENTER_MM: f64 = 5e5;

    /// A sphere around `center` in pictures of `size_px`, with the names of the presets in the
    /// order of menus.
    ///
    /// # Errors
    /// When the sphere or the picture is out of range, or the home view is not one of
    /// [`super::ViewState`]'s.
    pub fn new(
        center: Point<Patient>,
        radius_mm: f64,
        size_px: [u32; 2],
        presets: Vec<String>,
        home: Home,
    ) -> Result<Self, OutOfRange> {
        let refuse = |part: &str, found: String, allowed: String| Err(OutOfRange::new(part, found, allowed));
        if !center.xyz.to_array().iter().all(|c| c.abs() <= Self::MAX_CENTER_MM) {
            let allowed = format!("within {} mm", Self::MAX_CENTER_MM);
            return refuse("center", format!("{:?}", center.xyz.to_array()), allowed);
        }
        if !Self::RADII_MM.contains(&radius_mm) {
            let allowed = format!("{} to {} mm", Self::RADII_MM.start(), Self::RADII_MM.end());
            return refuse("radius", radius_mm.to_string(), allowed);
        }
        if size_px.contains(&0) {
            return refuse("size_px", format!("{size_px:?}"), "at least 1 x 1".to_owned());
        }
        home.orbit.validate()?;
        if let Some(name) = home.preset.as_ref().filter(|name| !presets.contains(name)) {
            return refuse("preset", format!("{name:?}"), presets.join(", "));
        }
        let (home_center, home_radius_mm) = (center, radius_mm);
        let narrowest_aspect = 1.0;
        Ok(Self { center, radius_mm, home_center, home_radius_mm, narrowest_aspect, size_px, presets, home })
    }

    /// The stage of a volume on this grid: the sphere of orbits and of depth limits.
    ///
    /// # Errors
    /// As [`Stage::new`].
    pub fn of_grid(
        grid: &Grid,
        size_px: [u32; 2],
        presets: Vec<String>,
        home: Home,
    ) -> Result<Self, OutOfRange> {
        Self::new(grid.center(), grid.bounding_radius_mm(), size_px, presets, home)
    }

    /// The same stage with its views fitted to this sphere in place of the bounding sphere. Views stand
    /// back in pictures that are narrower than `narrowest_aspect`, width by height.
    #[must_use]
    pub fn framed(self, center: Point<Patient>, radius_mm: f64, narrowest_aspect: f64) -> Self {
        Self { home_center: center, home_radius_mm: radius_mm, narrowest_aspect, ..self }
    }

    /// Centre of the bounding sphere.
    #[must_use]
    pub fn center(&self) -> Point<Patient> {
        self.center
    }

    /// Radius of the bounding sphere, mm.
    #[must_use]
    pub fn radius_mm(&self) -> f64 {
        self.radius_mm
    }

    /// Names of the presets, in the order of menus.
    #[must_use]
    pub fn presets(&self) -> &[String] {
        &self.presets
    }

    /// The picture's full size, to which `at_px` refers.
    #[must_use]
    pub fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    /// The same stage in pictures of another size; sides of 0 count as 1.
    #[must_use]
    pub fn resized(mut self, size_px: [u32; 2]) -> Self {
        self.size_px = size_px.map(|side| side.max(1));
        self
    }

    /// The nearest place where a cursor may be: within the bounding sphere.
    pub(super) fn clamped_cursor(&self, point: Point<Patient>) -> Point<Patient> {
        self.clamped(point, self.radius_mm)
    }

    /// The nearest place where the focal point may be: within twice the bounding sphere, which is
    /// as far as turning about a point of it takes its centre.
    pub(super) fn clamped_focus(&self, point: Point<Patient>) -> Point<Patient> {
        self.clamped(point, 2.0 * self.radius_mm)
    }

    fn clamped(&self, point: Point<Patient>, radius_mm: f64) -> Point<Patient> {
        let arm = (point - self.center).xyz;
        if arm.length() <= radius_mm {
            point
        } else {
            self.center + Vector::from_xyz(arm.normalize() * radius_mm)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_without_views_is_refused() {
        let home = |orbit, preset: Option<&str>| Home { orbit, preset: preset.map(str::to_owned) };
        let make = |x, radius_mm, size_px, home| {
            let presets = vec!["bone".to_owned(), "skin".to_owned()];
            Stage::new(Point::new(x, 0.0, 0.0), radius_mm, size_px, presets, home)
        };
        let plain = || home(Home::ORBIT, Some("bone"));
        make(0.0, 100.0, [960, 540], plain()).unwrap();
        for (stage, says) in [
            (make(f64::NAN, 100.0, [960, 540], plain()), "center is [NaN, 0.0, 0.0]"),
            (make(0.0, 0.0, [960, 540], plain()), "radius is 0, allowed: 0.1 to 10000 mm"),
            (make(0.0, 100.0, [960, 0], plain()), "size_px is [960, 0], allowed: at least 1 x 1"),
            (make(0.0, 100.0, [960, 540], home(Orbit { zoom: 0.0, ..Home::ORBIT }, None)), "zoom is 0"),
            (
                make(0.0, 100.0, [960, 540], home(Home::ORBIT, Some("x"))),
                "preset is \"x\", allowed: bone, skin",
            ),
        ] {
            let refused = stage.unwrap_err().to_string();
            assert!(refused.starts_with(says), "{refused}");
        }
    }

    /// The sphere that orbits and depth limits use.
    #[test]
    fn the_stage_of_a_grid_is_its_sphere() {
        let grid = Grid::axis_aligned([10, 20, 30], [1.0, 2.0, 3.0], [5.0, 6.0, 7.0]).unwrap();
        let home = Home { orbit: Home::ORBIT, preset: None };
        let stage = Stage::of_grid(&grid, [960, 540], Vec::new(), home).unwrap().resized([0, 100]);
        assert_eq!((stage.center(), stage.radius_mm()), (grid.center(), grid.bounding_radius_mm()));
        assert_eq!((stage.size_px(), stage.presets()), ([1, 100], &[][..]));
    }
}
