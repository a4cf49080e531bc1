//! Views of a picture at rest that a server renders for eyes beside its own: what server and clients
//! agree on.
//!
//! Eyes are in eye separations to the right of the middle.

use serde::{Deserialize, Serialize};

use relief_display::MAX_FRAME_SIDE_PX;

/// How the view of an eye is made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EyeViewQuality {
    /// Of the picture, and a share of it rendered where the picture does not show enough.
    Refined,
    /// All of it rendered.
    #[default]
    True,
}

impl EyeViewQuality {
    /// Its name in requests.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Refined => "refined",
            Self::True => "true",
        }
    }
}

/// The limits of views in one request.
#[derive(Clone, Copy, Debug)]
pub struct EyeViewLimits;

impl EyeViewLimits {
    /// Most eyes.
    pub const EYES: usize = 16;
    /// Farthest eye from the middle, eye separations.
    pub const FARTHEST: f64 = 16.0;
    /// Most pixels of all views together.
    pub const PIXELS: u64 = 1 << 24;
    /// Most rows of all views together.
    pub const ROWS: u32 = MAX_FRAME_SIDE_PX;

    /// Whether there are any eyes, and all of them are allowed.
    #[must_use]
    pub fn allow_eyes(eyes: &[f64]) -> bool {
        let is_near = |eye: &f64| (-Self::FARTHEST..=Self::FARTHEST).contains(eye);
        (1..=Self::EYES).contains(&eyes.len()) && eyes.iter().all(is_near)
    }

    /// Whether views of this size (width, height) for this number of eyes are allowed.
    #[must_use]
    pub fn allow_size([width, height]: [u32; 2], eyes: usize) -> bool {
        let rows = u64::from(height) * eyes as u64;
        rows <= u64::from(Self::ROWS) && u64::from(width) * rows <= Self::PIXELS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eyes_and_sizes_at_the_limits_are_allowed_and_no_others() {
        assert!(EyeViewLimits::allow_eyes(&[-16.0, 16.0]) && EyeViewLimits::allow_eyes(&[0.0; 16]));
        for refused in [&[][..], &[0.0; 17], &[16.1], &[f64::NAN], &[0.0, f64::NEG_INFINITY]] {
            assert!(!EyeViewLimits::allow_eyes(refused), "{refused:?}");
        }
        for (size_px, eyes, is_allowed) in [
            ([1024, 1024], 16, true),
            ([1025, 1024], 16, false),
            ([16, 8192], 2, true),
            ([16, 8193], 2, false),
            ([u32::MAX, u32::MAX], 16, false),
        ] {
            assert_eq!(EyeViewLimits::allow_size(size_px, eyes), is_allowed, "{size_px:?}, {eyes}");
        }
    }

    #[test]
    fn names_are_those_of_queries() {
        for quality in [EyeViewQuality::Refined, EyeViewQuality::True] {
            assert_eq!(serde_json::to_value(quality).unwrap(), quality.name());
        }
    }
}
