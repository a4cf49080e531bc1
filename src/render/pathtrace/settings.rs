//! The settings of mode `path-traced` and their ranges.

use crate::light::{Light, Placement};
use relief_base::{OutOfRange, Vector};

/// The settings of a path-traced picture besides the rest of its request.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathTrace {
    /// Paths through each pixel; noise falls with the square root.
    pub passes: u32,
    /// The seed of random numbers: other seeds give other noise around the same mean.
    pub seed: u32,
    /// Multiplies the extinction that the transfer function's opacity stands for.
    pub density: f64,
    /// Light from everywhere: makes an unshadowed white surface this bright.
    pub environment: f64,
    /// The factor of light before it becomes sRGB.
    pub exposure: f64,
    /// Mean cosine of the medium's scattering (Henyey-Greenstein): above 0 forwards, below
    /// backwards.
    pub anisotropy: f64,
    /// Largest share of a surface at a collision, 0..1; the rest is medium.
    pub surface: f64,
    /// Gradient at which the surface's share is half of that, HU per mm.
    pub surface_hu_per_mm: f64,
    /// Most scatterings of light on its way to the eye. With one scattering, shadows are
    /// as dark as the surroundings leave them; more fill them with light from neighbouring tissue.
    pub scatterings: u32,
    /// Whether noise is removed from the finished picture.
    pub denoise: bool,
}

impl Default for PathTrace {
    fn default() -> Self {
        Self {
            passes: 64,
            seed: 1,
            density: 1.0,
            environment: 0.25,
            exposure: 1.2,
            anisotropy: 0.0,
            surface: 1.0,
            surface_hu_per_mm: 25.0,
            scatterings: 1,
            denoise: false,
        }
    }
}

impl PathTrace {
    /// Most passes of a picture.
    pub const MAX_PASSES: u32 = 16_384;
    /// Largest seed.
    pub const MAX_SEED: u32 = 65_535;
    /// Most scatterings of a path.
    pub const MAX_SCATTERINGS: u32 = 64;
    /// Most collisions of a picture, all passes and scatterings together: minutes of a software
    /// adapter.
    pub const MAX_COLLISIONS: u64 = 1 << 29;

    /// The lights of a request that names none: a large warm one from the upper left, a faint one
    /// from the right.
    #[must_use]
    pub fn default_lights() -> Vec<Light> {
        let light = |[x, y, z]: [f64; 3], rgb, intensity, size: f64| Light {
            placement: Placement::ViewDirection(Vector::new(x, y, z)),
            rgb,
            intensity,
            size: size.to_radians(),
        };
        vec![
            light([-0.8, 0.75, 0.65], [1.0, 0.97, 0.92], 1.7, 16.0),
            light([0.9, 0.1, 0.5], [0.85, 0.93, 1.0], 0.2, 60.0),
        ]
    }

    /// Checks ranges, and that a picture of the given number of pixels is within
    /// [`PathTrace::MAX_COLLISIONS`].
    pub(crate) fn validate(&self, pixels: Option<u64>) -> Result<(), OutOfRange> {
        let within = |key: &str, value: f64, low: f64, high: f64| {
            let path = format!("path_trace.{key}");
            let inside = (low..=high).contains(&value);
            inside.then_some(()).ok_or_else(|| OutOfRange::new(path, value, format!("{low} to {high}")))
        };
        within("passes", f64::from(self.passes), 1.0, f64::from(Self::MAX_PASSES))?;
        within("seed", f64::from(self.seed), 0.0, f64::from(Self::MAX_SEED))?;
        within("density", self.density, 0.001, 1000.0)?;
        within("environment", self.environment, 0.0, 100.0)?;
        within("exposure", self.exposure, 0.001, 1000.0)?;
        within("anisotropy", self.anisotropy, -0.95, 0.95)?;
        within("surface", self.surface, 0.0, 1.0)?;
        within("scatterings", f64::from(self.scatterings), 1.0, f64::from(Self::MAX_SCATTERINGS))?;
        within("surface_hu_per_mm", self.surface_hu_per_mm, 0.01, 100_000_000.0)?;
        let Some(pixels) = pixels else { return Ok(()) };
        let most = Self::MAX_COLLISIONS / (pixels.max(1) * u64::from(self.scatterings));
        if u64::from(self.passes) > most {
            let allowed = match self.scatterings {
                1 => format!("at most {most} for a picture of this size"),
                count => format!("at most {most} for a picture of this size with {count} scatterings"),
            };
            return Err(OutOfRange::new("path_trace.passes", self.passes, allowed));
        }
        Ok(())
    }
}
