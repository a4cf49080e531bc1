//! The form of a preset: its purpose, control points, light and mode. The presets are in the other
//! files of this folder.
//!
//! Values: HU. Opacities: per mm.

use crate::transfer::{ControlPoint, TransferFunction};

/// The purpose of a preset: menus put those of one group together.
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
    /// The kind of its purpose.
    pub group: PresetGroup,
    /// How samples become a colour, unless the request says.
    pub mode: PresetMode,
    /// HU, red, green, blue, opacity per mm.
    pub(super) points: &'static [[f64; 5]],
    /// Ambient, diffuse and specular share.
    pub light: [f64; 3],
    /// Exponent of the highlight.
    pub shininess: f64,
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
