//! Transfer functions for common CT purposes, with control points of our own choosing.

use super::{ControlPoint, TransferFunction};

/// A named transfer function and the lighting that suits it.
#[derive(Clone, Copy, Debug)]
pub struct Preset {
    /// Name in requests and on the command line.
    pub name: &'static str,
    /// What it is for, in a few words.
    pub purpose: &'static str,
    /// HU, red, green, blue, opacity per mm.
    points: &'static [[f64; 5]],
    /// Ambient, diffuse and specular share.
    pub light: [f64; 3],
    /// Exponent of the highlight.
    pub shininess: f64,
}

/// All presets, in the order in which menus show them.
pub const PRESETS: &[Preset] = &[
    Preset {
        name: "bone",
        purpose: "skeleton, warm at its thin parts and ivory at the dense ones",
        points: &[
            [-1000.0, 0.0, 0.0, 0.0, 0.0],
            [150.0, 0.72, 0.42, 0.32, 0.0],
            [280.0, 0.88, 0.68, 0.50, 0.22],
            [650.0, 0.98, 0.93, 0.82, 0.75],
            [3000.0, 1.0, 1.0, 0.98, 0.95],
        ],
        light: [0.18, 0.80, 0.22],
        shininess: 24.0,
    },
    Preset {
        name: "skin",
        purpose: "the outer surface, opaque",
        points: &[
            [-1000.0, 0.0, 0.0, 0.0, 0.0],
            [-560.0, 0.72, 0.46, 0.38, 0.0],
            [-330.0, 0.86, 0.64, 0.54, 0.45],
            [-100.0, 0.92, 0.72, 0.62, 0.80],
            [3000.0, 0.98, 0.84, 0.75, 0.95],
        ],
        light: [0.22, 0.74, 0.14],
        shininess: 14.0,
    },
    Preset {
        name: "lung",
        purpose: "aerated lung, airways and the vessels in it; chest wall clear, bone faint",
        points: &[
            [-1024.0, 0.10, 0.20, 0.35, 0.0],
            [-965.0, 0.15, 0.30, 0.50, 0.0],
            [-900.0, 0.28, 0.50, 0.72, 0.004],
            [-760.0, 0.45, 0.62, 0.78, 0.007],
            [-640.0, 0.80, 0.62, 0.55, 0.035],
            [-520.0, 0.96, 0.62, 0.48, 0.110],
            [-420.0, 0.96, 0.56, 0.42, 0.060],
            [-300.0, 0.90, 0.48, 0.36, 0.0],
            [260.0, 0.90, 0.82, 0.70, 0.0],
            [500.0, 0.95, 0.90, 0.80, 0.010],
            [3000.0, 1.0, 1.0, 0.95, 0.030],
        ],
        light: [0.25, 0.75, 0.15],
        shininess: 16.0,
    },
    Preset {
        name: "vessels",
        purpose: "contrast-filled vessels with bone for orientation",
        points: &[
            [-1000.0, 0.0, 0.0, 0.0, 0.0],
            [110.0, 0.55, 0.06, 0.05, 0.0],
            [180.0, 0.74, 0.10, 0.07, 0.20],
            [320.0, 0.88, 0.22, 0.13, 0.65],
            [480.0, 0.93, 0.72, 0.52, 0.55],
            [800.0, 0.97, 0.92, 0.82, 0.75],
            [3000.0, 1.0, 1.0, 0.97, 0.95],
        ],
        light: [0.16, 0.80, 0.30],
        shininess: 30.0,
    },
    Preset {
        name: "soft-tissue",
        purpose: "muscle and organs under faint fat, bone behind them",
        points: &[
            [-1000.0, 0.0, 0.0, 0.0, 0.0],
            [-180.0, 0.85, 0.70, 0.45, 0.0],
            [-90.0, 0.88, 0.74, 0.50, 0.015],
            [-20.0, 0.80, 0.45, 0.36, 0.04],
            [45.0, 0.74, 0.26, 0.20, 0.30],
            [130.0, 0.84, 0.42, 0.32, 0.45],
            [320.0, 0.94, 0.84, 0.70, 0.65],
            [3000.0, 1.0, 1.0, 0.96, 0.90],
        ],
        light: [0.20, 0.76, 0.18],
        shininess: 16.0,
    },
];

/// The preset of this name.
#[must_use]
pub fn preset(name: &str) -> Option<&'static Preset> {
    PRESETS.iter().find(|preset| preset.name == name)
}

impl Preset {
    /// The preset's transfer function; its opacities are per mm.
    #[must_use]
    pub fn transfer(&self) -> TransferFunction {
        let point = |&[hu, r, g, b, opacity]: &[f64; 5]| ControlPoint { hu, rgba: [r, g, b, opacity] };
        TransferFunction { points: self.points.iter().map(point).collect(), opacity_unit_mm: 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_is_a_valid_function_that_leaves_air_clear() {
        for preset in PRESETS {
            let transfer = preset.transfer();
            TransferFunction::new(transfer.points().to_vec(), transfer.opacity_unit_mm()).unwrap();
            assert_eq!(transfer.at(-1024.0)[3], 0.0, "{}", preset.name);
            assert_eq!(super::preset(preset.name).unwrap().name, preset.name);
        }
    }
}
