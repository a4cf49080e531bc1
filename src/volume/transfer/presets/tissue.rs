//! Skin, muscle, fat and brain. Values in HU, opacities per mm.

use super::preset::{Preset, PresetGroup, PresetMode};

pub(super) const SKIN: Preset = Preset {
    name: "skin",
    purpose: "the outer surface, opaque",
    group: PresetGroup::Tissue,
    mode: PresetMode::Composite,
    points: &[
        [-1000.0, 0.0, 0.0, 0.0, 0.0],
        [-560.0, 0.72, 0.46, 0.38, 0.0],
        [-330.0, 0.86, 0.64, 0.54, 0.45],
        [-100.0, 0.92, 0.72, 0.62, 0.8],
        [3000.0, 0.98, 0.84, 0.75, 0.95],
    ],
    light: [0.22, 0.74, 0.14],
    shininess: 14.0,
};

pub(super) const SOFT_TISSUE: Preset = Preset {
    name: "soft-tissue",
    purpose: "muscle and organs under faint fat, bone behind them",
    group: PresetGroup::Tissue,
    mode: PresetMode::Composite,
    points: &[
        [-1000.0, 0.0, 0.0, 0.0, 0.0],
        [-180.0, 0.85, 0.7, 0.45, 0.0],
        [-90.0, 0.88, 0.74, 0.5, 0.015],
        [-20.0, 0.8, 0.45, 0.36, 0.04],
        [45.0, 0.74, 0.26, 0.2, 0.3],
        [130.0, 0.84, 0.42, 0.32, 0.45],
        [320.0, 0.94, 0.84, 0.7, 0.65],
        [3000.0, 1.0, 1.0, 0.96, 0.9],
    ],
    light: [0.2, 0.76, 0.18],
    shininess: 16.0,
};

pub(super) const SKIN_AND_BONE: Preset = Preset {
    name: "skin-and-bone",
    purpose: "skin as a thin veil around the skeleton",
    group: PresetGroup::Tissue,
    mode: PresetMode::Composite,
    points: &[
        [-620.0, 0.8, 0.58, 0.48, 0.0],
        [-420.0, 0.92, 0.7, 0.6, 0.16],
        [-230.0, 0.94, 0.72, 0.6, 0.1],
        [-60.0, 0.9, 0.6, 0.48, 0.0],
        [160.0, 0.8, 0.55, 0.42, 0.0],
        [290.0, 0.92, 0.78, 0.6, 0.3],
        [650.0, 0.98, 0.95, 0.86, 0.8],
        [3000.0, 1.0, 1.0, 1.0, 0.95],
    ],
    light: [0.22, 0.76, 0.18],
    shininess: 20.0,
};

pub(super) const MUSCLE: Preset = Preset {
    name: "muscle",
    purpose: "muscle, with fat and skin clear",
    group: PresetGroup::Tissue,
    mode: PresetMode::Composite,
    points: &[
        [-25.0, 0.5, 0.12, 0.1, 0.0],
        [15.0, 0.62, 0.16, 0.13, 0.1],
        [55.0, 0.76, 0.24, 0.19, 0.45],
        [110.0, 0.84, 0.4, 0.32, 0.55],
        [220.0, 0.92, 0.8, 0.68, 0.65],
        [3000.0, 1.0, 1.0, 0.97, 0.95],
    ],
    light: [0.2, 0.78, 0.16],
    shininess: 16.0,
};

pub(super) const FAT: Preset = Preset {
    name: "fat",
    purpose: "fat in yellow, other tissue clear, bone as a shade",
    group: PresetGroup::Tissue,
    mode: PresetMode::Composite,
    points: &[
        [-170.0, 0.8, 0.62, 0.22, 0.0],
        [-125.0, 0.94, 0.78, 0.34, 0.05],
        [-85.0, 0.98, 0.86, 0.46, 0.07],
        [-45.0, 0.94, 0.74, 0.4, 0.01],
        [-20.0, 0.9, 0.7, 0.4, 0.0],
        [200.0, 0.85, 0.82, 0.8, 0.0],
        [400.0, 0.86, 0.86, 0.88, 0.12],
        [3000.0, 1.0, 1.0, 1.0, 0.5],
    ],
    light: [0.24, 0.74, 0.14],
    shininess: 14.0,
};

pub(super) const BRAIN: Preset = Preset {
    name: "brain",
    purpose: "brain tissue through scalp and skull; fluid dark, muscle left out",
    group: PresetGroup::Tissue,
    mode: PresetMode::Composite,
    points: &[
        [-2.0, 0.2, 0.28, 0.5, 0.0],
        [10.0, 0.3, 0.38, 0.6, 0.006],
        [22.0, 0.8, 0.62, 0.58, 0.04],
        [34.0, 0.94, 0.78, 0.72, 0.07],
        [44.0, 0.94, 0.66, 0.6, 0.03],
        [54.0, 0.85, 0.45, 0.4, 0.0],
    ],
    light: [0.3, 0.72, 0.12],
    shininess: 12.0,
};
