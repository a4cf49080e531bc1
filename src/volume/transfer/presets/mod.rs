//! Transfer functions for common CT purposes, named by purpose, with control points of our own
//! choosing.
//!
//! Each group is a file with its presets; [`PRESETS`] is all of them in the order of menus. A
//! preset decides colours, opacity, light and, where it is made for one, the mode; it knows no
//! camera and no volume, so a purpose that needs contrast medium shows little without it. Values:
//! HU. Opacities: per mm.

mod abdomen;
mod chest;
mod projections;
mod skeleton;
mod tissue;
mod vessels;

use super::{ControlPoint, TransferFunction};

/// What kind of purpose a preset has: menus put those of one group together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PresetGroup {
    /// Bones, teeth and metal.
    Skeleton,
    /// Skin, muscle, fat and brain.
    Tissue,
    /// Lung, airways and heart.
    Chest,
    /// Liver, kidneys and bowel.
    Abdomen,
    /// Vessels that hold contrast medium.
    Vessels,
    /// Values gathered along the ray, without light.
    Projections,
}

impl PresetGroup {
    /// All groups, in the order of lists.
    pub const ALL: [Self; 6] =
        [Self::Skeleton, Self::Tissue, Self::Chest, Self::Abdomen, Self::Vessels, Self::Projections];

    /// The name in lists.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Skeleton => "skeleton",
            Self::Tissue => "tissue",
            Self::Chest => "chest",
            Self::Abdomen => "abdomen",
            Self::Vessels => "vessels",
            Self::Projections => "projections",
        }
    }
}

/// How the samples of a ray become a colour where a request with a preset does not say.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PresetMode {
    /// Samples are lit and blended front to back.
    Composite,
    /// The largest value along the ray.
    Maximum,
}

impl PresetMode {
    /// The name of the mode in requests.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Composite => "composite",
            Self::Maximum => "mip",
        }
    }
}

/// A named transfer function and the light and mode that suit it.
#[derive(Clone, Copy, Debug)]
pub struct Preset {
    /// Name in requests and on the command line.
    pub name: &'static str,
    /// Its purpose, in a few words.
    pub purpose: &'static str,
    /// What kind of purpose that is.
    pub group: PresetGroup,
    /// How samples become a colour, unless the request says.
    pub mode: PresetMode,
    /// HU, red, green, blue, opacity per mm.
    points: &'static [[f64; 5]],
    /// Ambient, diffuse and specular share.
    pub light: [f64; 3],
    /// Exponent of the highlight.
    pub shininess: f64,
}

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

impl Preset {
    /// The preset's transfer function; its opacities are per mm.
    #[must_use]
    pub fn transfer(&self) -> TransferFunction {
        let point = |&[hu, r, g, b, opacity]: &[f64; 5]| ControlPoint { hu, rgba: [r, g, b, opacity] };
        let points = self.points.iter().map(point).collect();
        TransferFunction { points, opacity_unit_mm: 1.0, gradient_opacity: None }
    }

    /// The HU from which on something is visible, and up to which; `None` where that is everything
    /// above.
    #[must_use]
    pub fn visible_hu(&self) -> (f64, Option<f64>) {
        let visible = |point: &&[f64; 5]| point[4] > 0.0;
        let last = self.points.len() - 1;
        let first_seen = self.points.iter().position(|point| visible(&point)).unwrap_or(last);
        let last_seen = self.points.iter().rposition(|point| visible(&point)).unwrap_or(last);
        (self.points[first_seen.saturating_sub(1)][0], self.points.get(last_seen + 1).map(|point| point[0]))
    }

    /// Colours of `cells` places from the first visible control point to the last: 20 mm of each on
    /// black, fully lit. Lists show them as a preview. Each interval between control points has the
    /// same width.
    #[must_use]
    pub fn swatch(&self, cells: usize) -> Vec<[u8; 3]> {
        const PATH_MM: f64 = 20.0;
        let visible = |point: &[f64; 5]| point[4] > 0.0;
        let first = self.points.iter().position(visible).unwrap_or(0);
        let last = self.points.iter().rposition(visible).unwrap_or(0);
        let transfer = self.transfer();
        let color = |cell: usize| {
            let at = (last - first) as f64 * (cell as f64 + 0.5) / cells as f64;
            let below = first + at as usize;
            let above = (below + 1).min(last);
            let hu = self.points[below][0] + at.fract() * (self.points[above][0] - self.points[below][0]);
            let [r, g, b, _] = transfer.at(hu);
            let seen = transfer.opacity_over(hu, PATH_MM);
            [r, g, b].map(|channel| (255.0 * seen * channel).round() as u8)
        };
        (0..cells).map(color).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

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
