//! Values gathered along the ray, without light: maximum projections and the look of a radiograph.
//! Values in HU, opacities per mm.

use super::preset::{Preset, PresetGroup, PresetMode};

pub(super) const MIP: Preset = Preset {
    name: "mip",
    purpose: "largest value along each ray in grey, from fat to bone",
    group: PresetGroup::Projections,
    mode: PresetMode::Maximum,
    points: &[[-200.0, 0.0, 0.0, 0.0, 0.0], [-199.0, 0.0, 0.0, 0.0, 1.0], [1700.0, 1.0, 1.0, 1.0, 1.0]],
    light: [1.0, 0.0, 0.0],
    shininess: 1.0,
};

pub(super) const MIP_VESSELS: Preset = Preset {
    name: "mip-vessels",
    purpose: "largest value along each ray, windowed for contrast medium",
    group: PresetGroup::Projections,
    mode: PresetMode::Maximum,
    points: &[
        [60.0, 0.05, 0.05, 0.1, 0.0],
        [150.0, 0.45, 0.06, 0.1, 0.35],
        [320.0, 0.92, 0.3, 0.1, 0.8],
        [520.0, 1.0, 0.72, 0.3, 0.95],
        [900.0, 1.0, 0.94, 0.78, 1.0],
        [1800.0, 1.0, 1.0, 1.0, 1.0],
    ],
    light: [1.0, 0.0, 0.0],
    shininess: 1.0,
};

pub(super) const X_RAY: Preset = Preset {
    name: "x-ray",
    purpose: "a radiograph's look: tissue adds up along the ray",
    group: PresetGroup::Projections,
    mode: PresetMode::Composite,
    points: &[
        [-950.0, 0.7, 0.8, 0.9, 0.0],
        [-100.0, 0.75, 0.83, 0.92, 0.0007],
        [60.0, 0.8, 0.87, 0.94, 0.0018],
        [300.0, 0.92, 0.95, 0.98, 0.008],
        [1200.0, 1.0, 1.0, 1.0, 0.03],
        [3000.0, 1.0, 1.0, 1.0, 0.06],
    ],
    light: [1.0, 0.0, 0.0],
    shininess: 1.0,
};
