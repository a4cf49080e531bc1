//! Liver, kidneys and bowel. Values in HU, opacities per mm.

use super::preset::{Preset, PresetGroup, PresetMode};

pub(super) const LIVER_VESSELS: Preset = Preset {
    name: "liver-vessels",
    purpose: "portal and hepatic veins in a translucent liver",
    group: PresetGroup::Abdomen,
    mode: PresetMode::Composite,
    points: &[
        [60.0, 0.55, 0.28, 0.2, 0.0],
        [100.0, 0.6, 0.3, 0.22, 0.012],
        [135.0, 0.5, 0.3, 0.4, 0.03],
        [165.0, 0.3, 0.42, 0.85, 0.3],
        [230.0, 0.45, 0.62, 0.95, 0.6],
        [320.0, 0.9, 0.85, 0.75, 0.35],
        [3000.0, 1.0, 1.0, 0.96, 0.8],
    ],
    light: [0.2, 0.78, 0.22],
    shininess: 22.0,
};

pub(super) const KIDNEYS: Preset = Preset {
    name: "kidneys",
    purpose: "kidneys under contrast medium: cortex, medulla and pelvis",
    group: PresetGroup::Abdomen,
    mode: PresetMode::Composite,
    points: &[
        [110.0, 0.5, 0.16, 0.12, 0.0],
        [140.0, 0.62, 0.2, 0.14, 0.05],
        [190.0, 0.8, 0.34, 0.18, 0.35],
        [260.0, 0.94, 0.58, 0.26, 0.55],
        [400.0, 0.98, 0.86, 0.62, 0.6],
        [3000.0, 1.0, 1.0, 0.97, 0.9],
    ],
    light: [0.2, 0.78, 0.22],
    shininess: 22.0,
};

pub(super) const COLON: Preset = Preset {
    name: "colon",
    purpose: "walls of air-filled bowel",
    group: PresetGroup::Abdomen,
    mode: PresetMode::Composite,
    points: &[
        [-900.0, 0.8, 0.45, 0.4, 0.0],
        [-760.0, 0.88, 0.52, 0.46, 0.03],
        [-600.0, 0.95, 0.62, 0.52, 0.12],
        [-420.0, 0.95, 0.58, 0.48, 0.06],
        [-250.0, 0.9, 0.5, 0.42, 0.0],
        [250.0, 0.9, 0.85, 0.75, 0.0],
        [700.0, 0.95, 0.92, 0.85, 0.01],
        [3000.0, 1.0, 1.0, 1.0, 0.04],
    ],
    light: [0.24, 0.76, 0.22],
    shininess: 22.0,
};
