//! Named sets of lights, for pages and the command line.
//!
//! All of them are in view space: they stay beside the viewer while the patient turns.

use super::light::{Light, Placement};
use super::mode::Mode;
use relief_base::Vector;

/// A set of lights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lighting {
    /// The name in requests.
    pub name: &'static str,
    /// Its description.
    pub purpose: &'static str,
    lights: &'static [DistantLight],
}

/// Direction (x right, y up, z towards the viewer), colour, intensity, angle in degrees.
type DistantLight = ([f64; 3], [f64; 3], f64, f64);

impl Lighting {
    /// All sets; the first is the default.
    pub const ALL: [Self; 4] = [
        Self { name: "headlight", purpose: "a light at the eye, without shadows", lights: &[] },
        Self {
            name: "studio",
            purpose: "a warm light from the upper left, a faint cool one from the right",
            lights: &[
                ([-0.75, 0.8, 0.75], [1.0, 0.97, 0.92], 1.0, 12.0),
                ([0.9, 0.1, 0.6], [0.85, 0.93, 1.0], 0.3, 40.0),
            ],
        },
        Self {
            name: "side",
            purpose: "a light from the left that rakes over the surface",
            lights: &[
                ([-1.0, 0.25, 0.3], [1.0, 0.98, 0.95], 1.1, 6.0),
                ([0.3, 0.2, 1.0], [1.0; 3], 0.15, 0.0),
            ],
        },
        Self {
            name: "above",
            purpose: "a light from above, as in an operating theatre",
            lights: &[([0.0, 1.0, 0.5], [1.0; 3], 1.1, 10.0)],
        },
    ];

    /// The set of this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|lighting| lighting.name == name)
    }

    /// All names, with commas between them.
    #[must_use]
    pub fn names() -> String {
        Self::ALL.map(|lighting| lighting.name).join(", ")
    }

    /// The lights of a request in this mode. Mode path-traced has no headlight of its own: there it
    /// is a light like others.
    #[must_use]
    pub fn lights(&self, mode: Mode) -> Vec<Light> {
        const AT_THE_EYE: &[DistantLight] = &[([0.0, 0.0, 1.0], [1.0; 3], 1.0, 0.0)];
        let is_dark = mode == Mode::PathTraced && self.lights.is_empty();
        let lights = if is_dark { AT_THE_EYE } else { self.lights };
        let light = |&([x, y, z], rgb, intensity, size_deg): &DistantLight| Light {
            placement: Placement::ViewDirection(Vector::new(x, y, z)),
            rgb,
            intensity,
            size: size_deg.to_radians(),
        };
        lights.iter().map(light).collect()
    }
}
