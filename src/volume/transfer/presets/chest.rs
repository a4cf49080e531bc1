//! Lung, airways and heart. Values in HU, opacities per mm.

use super::preset::{Preset, PresetGroup, PresetMode};

pub(super) const LUNG: Preset = Preset {
    name: "lung",
    purpose: "aerated lung, airways and the vessels in it; chest wall clear, bone faint",
    group: PresetGroup::Chest,
    mode: PresetMode::Composite,
    points: &[
        [-1024.0, 0.1, 0.2, 0.35, 0.0],
        [-965.0, 0.15, 0.3, 0.5, 0.0],
        [-900.0, 0.28, 0.5, 0.72, 0.004],
        [-760.0, 0.45, 0.62, 0.78, 0.007],
        [-640.0, 0.8, 0.62, 0.55, 0.035],
        [-520.0, 0.96, 0.62, 0.48, 0.11],
        [-420.0, 0.96, 0.56, 0.42, 0.06],
        [-300.0, 0.9, 0.48, 0.36, 0.0],
        [260.0, 0.9, 0.82, 0.7, 0.0],
        [500.0, 0.95, 0.9, 0.8, 0.01],
        [3000.0, 1.0, 1.0, 0.95, 0.03],
    ],
    light: [0.25, 0.75, 0.15],
    shininess: 16.0,
};

pub(super) const AIRWAYS: Preset = Preset {
    name: "airways",
    purpose: "surfaces of air spaces like glass: trachea, bronchi, sinuses",
    group: PresetGroup::Chest,
    mode: PresetMode::Composite,
    points: &[
        [-820.0, 0.3, 0.62, 0.8, 0.0],
        [-700.0, 0.42, 0.76, 0.88, 0.05],
        [-540.0, 0.6, 0.86, 0.92, 0.11],
        [-400.0, 0.7, 0.88, 0.92, 0.05],
        [-280.0, 0.7, 0.88, 0.92, 0.0],
        [350.0, 0.85, 0.85, 0.9, 0.0],
        [800.0, 0.9, 0.92, 0.95, 0.006],
        [3000.0, 1.0, 1.0, 1.0, 0.02],
    ],
    light: [0.16, 0.7, 0.55],
    shininess: 30.0,
};

pub(super) const PULMONARY_VESSELS: Preset = Preset {
    name: "pulmonary-vessels",
    purpose: "vessel trees of the lung, chest wall clear",
    group: PresetGroup::Chest,
    mode: PresetMode::Composite,
    points: &[
        [-720.0, 0.3, 0.08, 0.14, 0.0],
        [-610.0, 0.62, 0.12, 0.18, 0.03],
        [-440.0, 0.92, 0.2, 0.18, 0.13],
        [-270.0, 0.98, 0.45, 0.34, 0.1],
        [-160.0, 0.98, 0.55, 0.42, 0.0],
    ],
    light: [0.2, 0.78, 0.25],
    shininess: 24.0,
};

pub(super) const HEART: Preset = Preset {
    name: "heart",
    purpose: "contrast-filled chambers under translucent heart muscle",
    group: PresetGroup::Chest,
    mode: PresetMode::Composite,
    points: &[
        [20.0, 0.55, 0.22, 0.18, 0.0],
        [90.0, 0.7, 0.28, 0.22, 0.015],
        [150.0, 0.78, 0.3, 0.22, 0.06],
        [240.0, 0.9, 0.34, 0.22, 0.35],
        [380.0, 0.97, 0.62, 0.42, 0.6],
        [600.0, 0.98, 0.92, 0.82, 0.75],
        [3000.0, 1.0, 1.0, 1.0, 0.95],
    ],
    light: [0.18, 0.78, 0.25],
    shininess: 24.0,
};

pub(super) const CORONARY: Preset = Preset {
    name: "coronary",
    purpose: "contrast-filled coronary arteries on a veil of muscle, calcium white",
    group: PresetGroup::Chest,
    mode: PresetMode::Composite,
    points: &[
        [100.0, 0.6, 0.2, 0.16, 0.0],
        [170.0, 0.72, 0.26, 0.2, 0.02],
        [230.0, 0.85, 0.28, 0.16, 0.22],
        [350.0, 0.98, 0.6, 0.3, 0.65],
        [520.0, 0.99, 0.82, 0.6, 0.6],
        [750.0, 1.0, 1.0, 0.98, 0.9],
        [3000.0, 1.0, 1.0, 1.0, 0.98],
    ],
    light: [0.16, 0.8, 0.35],
    shininess: 34.0,
};
