//! Transfer functions for common CT purposes, named by purpose, with control points of our own
//! choosing.
//!
//! Each group is a file with its presets; [`PRESETS`] is all of them in the order of menus. A
//! preset decides colours, opacity, light and, where it is made for one, the mode; it knows no
//! camera and no volume, so a purpose that needs contrast medium shows little without it. Values:
//! HU. Opacities: per mm.

mod abdomen;
mod chest;
mod preset;
mod projections;
mod skeleton;
mod tissue;
mod vessels;

pub use preset::{Preset, PresetGroup, PresetMode};

/// All presets, in the order in which menus show them.
pub const PRESETS: &[Preset] = &[
    skeleton::BONE,
    tissue::SKIN,
    chest::LUNG,
    vessels::VESSELS,
    tissue::SOFT_TISSUE,
    skeleton::BONE_TRANSLUCENT,
    skeleton::BONE_DENSE,
    skeleton::SPINE,
    skeleton::TEETH,
    skeleton::METAL,
    tissue::SKIN_AND_BONE,
    tissue::MUSCLE,
    tissue::FAT,
    tissue::BRAIN,
    chest::AIRWAYS,
    chest::PULMONARY_VESSELS,
    chest::HEART,
    chest::CORONARY,
    abdomen::LIVER_VESSELS,
    abdomen::KIDNEYS,
    abdomen::COLON,
    vessels::AORTA,
    vessels::ANGIOGRAPHY,
    projections::MIP,
    projections::MIP_VESSELS,
    projections::X_RAY,
];

/// The preset of this name.
#[must_use]
pub fn preset(name: &str) -> Option<&'static Preset> {
    PRESETS.iter().find(|preset| preset.name == name)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::transfer::TransferFunction;

    #[test]
    fn every_preset_is_a_valid_function_that_leaves_air_clear() {
        for preset in PRESETS {
            let transfer = preset.transfer();
            TransferFunction::new(transfer.points().to_vec(), transfer.opacity_unit_mm()).unwrap();
            assert_eq!(transfer.at(-1024.0)[3], 0.0, "{}", preset.name);
            assert_eq!(super::preset(preset.name).unwrap().name, preset.name);
        }
    }

    #[test]
    fn there_are_presets_for_twenty_purposes_and_no_two_are_alike() {
        assert!(PRESETS.len() >= 20, "{} presets", PRESETS.len());
        let names: BTreeSet<_> = PRESETS.iter().map(|preset| preset.name).collect();
        let purposes: BTreeSet<_> = PRESETS.iter().map(|preset| preset.purpose).collect();
        assert_eq!((names.len(), purposes.len()), (PRESETS.len(), PRESETS.len()));
        for (i, a) in PRESETS.iter().enumerate() {
            for b in &PRESETS[i + 1..] {
                assert_ne!(a.transfer(), b.transfer(), "{} and {}", a.name, b.name);
            }
        }
    }

    #[test]
    fn a_swatch_runs_from_the_first_visible_colour_to_the_last() {
        for preset in PRESETS {
            let swatch = preset.swatch(16);
            assert_eq!(swatch.len(), 16);
            assert!(swatch.iter().any(|color| *color != [0; 3]), "{}", preset.name);
            let (low, high) = preset.visible_hu();
            let seen = |hu: f64| preset.transfer().at(hu)[3] > 0.0;
            assert!(!seen(low) && seen(low + 0.5), "{} from {low} HU", preset.name);
            match high {
                Some(high) => assert!(seen(high - 0.5) && !seen(high), "{} to {high} HU", preset.name),
                None => assert!(seen(5000.0), "{}", preset.name),
            }
        }
        let bone = preset("bone").unwrap();
        let (dark, light) = (bone.swatch(8)[0], bone.swatch(8)[7]);
        assert!(light.iter().zip(dark).all(|(light, dark)| *light > dark), "ivory is lighter than {dark:?}");
    }

    #[test]
    fn names_are_words_that_need_no_quoting() {
        for Preset { name, .. } in PRESETS {
            let plain = |c: char| c.is_ascii_lowercase() || c == '-';
            assert!(name.chars().all(plain) && !name.starts_with('-'), "{name}");
        }
    }
}
