//! Bones, teeth and metal. Values in HU, opacities per mm.

use super::preset::{Preset, PresetGroup, PresetMode};

pub(super) const BONE: Preset = Preset {
    name: "bone",
    purpose: "skeleton, warm at its thin parts and ivory at the dense ones",
    group: PresetGroup::Skeleton,
    mode: PresetMode::Composite,
    points: &[
        [-1000.0, 0.0, 0.0, 0.0, 0.0],
        [150.0, 0.72, 0.42, 0.32, 0.0],
        [280.0, 0.88, 0.68, 0.5, 0.22],
        [650.0, 0.98, 0.93, 0.82, 0.75],
        [3000.0, 1.0, 1.0, 0.98, 0.95],
    ],
    light: [0.18, 0.8, 0.22],
    shininess: 24.0,
};

pub(super) const BONE_TRANSLUCENT: Preset = Preset {
    name: "bone-translucent",
    purpose: "skeleton like frosted glass: what lies behind stays in sight",
    group: PresetGroup::Skeleton,
    mode: PresetMode::Composite,
    points: &[
        [160.0, 0.55, 0.62, 0.72, 0.0],
        [300.0, 0.66, 0.76, 0.86, 0.012],
        [700.0, 0.84, 0.91, 0.96, 0.05],
        [1500.0, 0.97, 0.99, 1.0, 0.14],
        [3000.0, 1.0, 1.0, 1.0, 0.3],
    ],
    light: [0.3, 0.7, 0.2],
    shininess: 20.0,
};

pub(super) const BONE_DENSE: Preset = Preset {
    name: "bone-dense",
    purpose: "compact bone alone; spongy bone and contrast medium left out",
    group: PresetGroup::Skeleton,
    mode: PresetMode::Composite,
    points: &[
        [380.0, 0.7, 0.52, 0.34, 0.0],
        [560.0, 0.88, 0.76, 0.56, 0.25],
        [900.0, 0.97, 0.93, 0.8, 0.8],
        [3000.0, 1.0, 1.0, 0.98, 0.97],
    ],
    light: [0.18, 0.8, 0.25],
    shininess: 28.0,
};

pub(super) const SPINE: Preset = Preset {
    name: "spine",
    purpose: "spongy bone in amber inside a pale shell of compact bone",
    group: PresetGroup::Skeleton,
    mode: PresetMode::Composite,
    points: &[
        [110.0, 0.62, 0.24, 0.1, 0.0],
        [190.0, 0.82, 0.4, 0.14, 0.06],
        [300.0, 0.94, 0.62, 0.24, 0.16],
        [420.0, 0.9, 0.86, 0.78, 0.14],
        [700.0, 0.92, 0.95, 0.96, 0.45],
        [3000.0, 1.0, 1.0, 1.0, 0.95],
    ],
    light: [0.2, 0.78, 0.2],
    shininess: 22.0,
};

pub(super) const TEETH: Preset = Preset {
    name: "teeth",
    purpose: "enamel white, dentine ivory, jaw bone faint",
    group: PresetGroup::Skeleton,
    mode: PresetMode::Composite,
    points: &[
        [500.0, 0.8, 0.6, 0.45, 0.0],
        [800.0, 0.86, 0.7, 0.54, 0.012],
        [1150.0, 0.92, 0.8, 0.58, 0.05],
        [1450.0, 0.96, 0.9, 0.72, 0.5],
        [1900.0, 1.0, 0.99, 0.96, 0.92],
        [3000.0, 1.0, 1.0, 1.0, 0.98],
    ],
    light: [0.16, 0.78, 0.4],
    shininess: 40.0,
};

pub(super) const METAL: Preset = Preset {
    name: "metal",
    purpose: "implants and fillings in steel blue, bone faint around them",
    group: PresetGroup::Skeleton,
    mode: PresetMode::Composite,
    points: &[
        [200.0, 0.85, 0.75, 0.62, 0.0],
        [700.0, 0.92, 0.86, 0.74, 0.008],
        [1900.0, 0.95, 0.92, 0.84, 0.02],
        [2300.0, 0.45, 0.6, 0.74, 0.45],
        [3000.0, 0.72, 0.84, 0.94, 0.97],
    ],
    light: [0.16, 0.7, 0.55],
    shininess: 48.0,
};
