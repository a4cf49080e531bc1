//! At which depths words can be read on a 3D display.
//!
//! A lenticular or barrier display lets some light of neighbouring views through, so that what
//! stands before or behind the screen has a ghost beside it, as far away as its parallax. Words
//! stay legible while the ghost of a stroke touches the stroke itself: while the parallax between
//! the eyes is no wider than a stroke. Parallax grows with |D - C|, in eye separations `(D - C) /
//! M` (see `display`), so that the rule is a range of D around the screen's, and by the curve a
//! range of view depths. On the 42" display at 960x540 it is about six tenths of the display's
//! range; on the 20" one about a quarter.

use relief_base::{DepthLimits, Disparity};
use relief_display::DisplayProfile;
use relief_render::{Overlays, label_height_px, label_stroke_px};

/// Between the eyes of an adult, mm.
const EYES_MM: f64 = 63.0;

/// The nearest and the farthest view depth at which labels of these overlays can be read, mm.
pub(super) fn label_depths_mm(
    profile: &DisplayProfile,
    limits: DepthLimits,
    overlays: &Overlays,
    size_px: [u32; 2],
) -> [f64; 2] {
    let height_px = overlays.label_height_px.unwrap_or_else(|| label_height_px(size_px[1]));
    let px_per_eyes = EYES_MM / profile.screen_width_mm() * f64::from(size_px[0]);
    let constants = profile.constants();
    let reach = constants.m.abs() * label_stroke_px(height_px) / px_per_eyes;
    [constants.c + reach, constants.c - reach].map(|d| {
        let z = profile.scaled_depth(Disparity(d)).0;
        limits.near_mm + z * (limits.far_mm - limits.near_mm)
    })
}
