//! Vessels that hold contrast medium. Values in HU, opacities per mm.

use super::preset::{Preset, PresetGroup, PresetMode};

pub(super) const VESSELS: Preset = Preset {
    name: "vessels",
    purpose: "contrast-filled vessels with bone for orientation",
    group: PresetGroup::Vessels,
    mode: PresetMode::Composite,
    points: &[
        [-1000.0, 0.0, 0.0, 0.0, 0.0],
        [110.0, 0.55, 0.06, 0.05, 0.0],
        [180.0, 0.74, 0.1, 0.07, 0.2],
        [320.0, 0.88, 0.22, 0.13, 0.65],
        [480.0, 0.93, 0.72, 0.52, 0.55],
        [800.0, 0.97, 0.92, 0.82, 0.75],
        [3000.0, 1.0, 1.0, 0.97, 0.95],
    ],
    light: [0.16, 0.8, 0.3],
    shininess: 30.0,
};

pub(super) const AORTA: Preset = Preset {
    name: "aorta",
    purpose: "aorta and large arteries, solid; muscle as a veil, bone in grey",
    group: PresetGroup::Vessels,
    mode: PresetMode::Composite,
    points: &[
        [30.0, 0.62, 0.4, 0.36, 0.0],
        [70.0, 0.66, 0.4, 0.36, 0.004],
        [140.0, 0.72, 0.12, 0.08, 0.01],
        [200.0, 0.82, 0.12, 0.08, 0.5],
        [380.0, 0.95, 0.3, 0.18, 0.85],
        [520.0, 0.8, 0.78, 0.76, 0.25],
        [900.0, 0.88, 0.88, 0.88, 0.35],
        [3000.0, 1.0, 1.0, 1.0, 0.7],
    ],
    light: [0.18, 0.8, 0.28],
    shininess: 28.0,
};

pub(super) const ANGIOGRAPHY: Preset = Preset {
    name: "angiography",
    purpose: "contrast-filled vessels in white on nothing, as if bone were subtracted",
    group: PresetGroup::Vessels,
    mode: PresetMode::Composite,
    points: &[
        [130.0, 0.6, 0.7, 0.8, 0.0],
        [220.0, 0.85, 0.92, 1.0, 0.03],
        [380.0, 1.0, 1.0, 1.0, 0.06],
        [480.0, 1.0, 1.0, 1.0, 0.02],
        [600.0, 0.7, 0.8, 0.9, 0.0012],
        [3000.0, 0.7, 0.8, 0.9, 0.0012],
    ],
    light: [0.75, 0.25, 0.0],
    shininess: 1.0,
};
