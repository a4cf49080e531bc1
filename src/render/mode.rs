//! How the samples of a ray become a colour: the modes, their names, and the part that each takes of a
//! transfer function.
//!
//! The modes' formulas are in `shaders/` and in `render::processor`.

use serde::Deserialize;

/// How the samples of a ray become a colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Deserialize)]
#[serde(try_from = "String")]
pub enum Mode {
    /// Samples are shaded and blended front to back.
    Composite,
    /// The largest value along the ray, through the transfer function, unshaded. Depth is where it
    /// lies.
    Mip,
    /// The smallest value along the ray, through the transfer function, unshaded. Depth is where it
    /// lies.
    Minip,
    /// The mean value along the ray, through the transfer function, unshaded. Depth is the mean
    /// depth of the samples, each weighted by its brightness: 0 for the volume's smallest value, 1
    /// for its largest.
    Mean,
    /// A grey: the mean over the ray's samples of brightness times opacity per opacity unit. Depth
    /// is the mean depth of the samples, each weighted by the same product.
    Average,
    /// As [`Mode::Average`], but the sum per opacity unit of path in place of the mean; white at
    /// most.
    Additive,
    /// The request's surfaces, lit at the crossing and blended front to back. Depth is by the rule.
    Isosurface,
    /// The plane through the camera's focal point across the viewing direction, or a slab around
    /// it, through the transfer function, unshaded. Takes a parallel projection.
    Slice(SlabBlend),
    /// Light is followed from the lights to one scattering and the eye; see [`super::PathTrace`].
    /// Depth is as of `Composite`.
    PathTraced,
}

/// The value that a slab shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum SlabBlend {
    /// The mean over the slab's thickness.
    #[default]
    Mean,
    /// The largest value.
    Mip,
    /// The smallest value.
    MinIp,
}

impl SlabBlend {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Mean, Self::Mip, Self::MinIp];

    /// The name in requests.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Mean => "mean",
            Self::Mip => "mip",
            Self::MinIp => "minip",
        }
    }

    /// The blend of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|blend| blend.name() == name)
    }
}

impl Mode {
    /// The modes of the ray caster, in the order in which menus show them.
    pub const RAYS: [Self; 7] = [
        Self::Composite,
        Self::Mip,
        Self::Minip,
        Self::Mean,
        Self::Average,
        Self::Additive,
        Self::Isosurface,
    ];

    /// All modes.
    pub const ALL: [Self; 9] = [
        Self::Composite,
        Self::Mip,
        Self::Minip,
        Self::Mean,
        Self::Average,
        Self::Additive,
        Self::Isosurface,
        Self::Slice(SlabBlend::Mean),
        Self::PathTraced,
    ];

    /// The name in requests and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Composite => "composite",
            Self::Mip => "mip",
            Self::Minip => "minip",
            Self::Mean => "mean",
            Self::Average => "average",
            Self::Additive => "additive",
            Self::Isosurface => "isosurface",
            Self::Slice(_) => "slice",
            Self::PathTraced => "path-traced",
        }
    }

    /// The mode of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|mode| mode.name() == name)
    }

    /// The ray caster's constant of a mode.
    pub(super) const fn constant(self) -> f64 {
        match self {
            // The depth of a path-traced picture is the composite one.
            Self::Composite | Self::PathTraced => 0.0,
            Self::Mip => 1.0,
            Self::Minip => 2.0,
            Self::Mean => 3.0,
            Self::Average => 4.0,
            Self::Additive => 5.0,
            Self::Isosurface => 6.0,
            // No branch of this stage: `slices` has the pipelines of slices.
            Self::Slice(_) => 255.0,
        }
    }
}

/// For serde, which does not look at a slab's blend here.
impl TryFrom<String> for Mode {
    type Error = UnknownMode;

    fn try_from(name: String) -> Result<Self, UnknownMode> {
        Self::from_name(&name).ok_or(UnknownMode { name })
    }
}

/// A name that no mode has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown mode {name:?}, allowed: {}", Mode::ALL.map(Mode::name).join(", "))]
pub struct UnknownMode {
    name: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_to_their_modes_in_requests_too() {
        for mode in Mode::ALL {
            assert_eq!(Mode::from_name(mode.name()), Some(mode));
            let json = format!("\"{}\"", mode.name());
            assert_eq!(serde_json::from_str::<Mode>(&json).unwrap(), mode);
        }
        assert_eq!(Mode::from_name("xray"), None);
    }
}
