//! Depth filters: applied to a picture's view depth before it becomes Z or D.
//!
//! Medians against outliers. Filters do not change measurements: picks, OpenEXR and raw depth contain
//! the depth as rendered; only frames are filtered.
//!
//! | filter | a pixel's depth becomes |
//! |---|---|
//! | `none` | unchanged |
//! | `median-3`, `median-5` | the median of the 3x3 or 5x5 pixels around it |
//!
//! View depth in mm, in rows from the top left; a miss is `+inf` and so the farthest of all. Pixels
//! beyond the picture's border are those on it. Every filter gives values that were there before:
//! none is made up.

mod grounded;
mod median;
mod padded;

use std::borrow::Cow;

use super::layout::Picture;
pub use grounded::grounded_depth;
use padded::miss_if_unknown;

/// The filter of depth before it becomes Z or D.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum DepthFilter {
    /// Nothing.
    #[default]
    #[serde(rename = "none")]
    None,
    /// The median of 3x3 pixels: removes single outliers.
    #[serde(rename = "median-3")]
    Median3,
    /// The median of 5x5 pixels: removes specks of up to twelve pixels.
    #[serde(rename = "median-5")]
    Median5,
}

impl DepthFilter {
    /// All of them, in the order of lists shown to users.
    pub const ALL: [Self; 3] = [Self::None, Self::Median3, Self::Median5];

    /// The name in requests and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Median3 => "median-3",
            Self::Median5 => "median-5",
        }
    }

    /// The filter with this name, if there is one.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|filter| filter.name() == name)
    }

    /// View depth of every pixel after this filter, mm; `+inf` for a miss.
    #[must_use]
    pub fn apply<'a>(self, picture: &Picture<'a>) -> Cow<'a, [f32]> {
        match self {
            Self::None => Cow::Borrowed(picture.depth_mm()),
            Self::Median3 => Cow::Owned(median::median::<3, 9>(&known(picture.depth_mm()), width(picture))),
            Self::Median5 => Cow::Owned(median::median::<5, 25>(&known(picture.depth_mm()), width(picture))),
        }
    }
}

impl std::fmt::Display for DepthFilter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

/// Depths in mm without NaN, which is a miss.
fn known(depth_mm: &[f32]) -> Vec<f32> {
    depth_mm.iter().map(|&mm| miss_if_unknown(mm)).collect()
}

fn width(picture: &Picture<'_>) -> usize {
    picture.size_px()[0] as usize
}
