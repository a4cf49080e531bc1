//! The strength of shadows and occlusion, and its ranges.

use crate::light::Light;
use relief_base::OutOfRange;

/// Shadows and occlusion of modes composite and isosurface. Neither changes depth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Illumination {
    /// The strength of the placed lights' shadows, 0..1; at 0 none are made.
    pub shadows: f64,
    /// The light that surroundings take away.
    pub occlusion: Occlusion,
}

/// Ambient occlusion: less light where less than half of all directions is open. It takes from
/// ambient light, and from the headlight, which stands for light from everywhere; placed lights
/// have their own shadows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Occlusion {
    /// Its strength, 0..1; at 0 none is made.
    pub strength: f64,
    /// The distance up to which surroundings take light away, mm.
    pub radius_mm: f64,
}

impl Default for Occlusion {
    fn default() -> Self {
        Self { strength: 0.0, radius_mm: 20.0 }
    }
}

impl Illumination {
    pub(crate) fn validate(&self, lights: &[Light]) -> Result<(), OutOfRange> {
        let Self { shadows, occlusion: Occlusion { strength, radius_mm } } = *self;
        for (key, value, [low, high]) in [
            ("shadows", shadows, [0.0, 1.0]),
            ("occlusion.strength", strength, [0.0, 1.0]),
            ("occlusion.radius_mm", radius_mm, [0.5, 500.0]),
        ] {
            if !(low..=high).contains(&value) {
                let allowed = format!("{low} to {high}");
                return Err(OutOfRange::new(format!("shading.{key}"), value, allowed));
            }
        }
        if shadows > 0.0 && lights.is_empty() {
            let allowed = "0 without lights: what the headlight does not reach, the eye does not see";
            return Err(OutOfRange::new("shading.shadows", shadows, allowed));
        }
        Ok(())
    }
}
