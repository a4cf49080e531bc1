//! The views that a glasses-free display makes of a picture and its disparity, for people without
//! the display.
//!
//! The parallax of a disparity for an eye ([`Parallax`]), views by depth-image-based rendering
//! ([`synthesize`]), views between rendered ones ([`interpolate`]), their grids, anaglyphs, and
//! their distance from true renders ([`psnr_db`]). No maker has published the renderer of a
//! display; this is the displays' geometry with the usual way to fill holes.
//!
//! **Eyes** are places along the viewers' eye line, counted in eye separations to the right of the
//! middle: -0.5 and 0.5 are a pair of eyes before the middle of the screen. Shifts are in pixels of
//! the picture, to the right.

mod anaglyph;
mod arrange;
mod arrangement;
mod between;
mod compare;
mod cone;
mod grid;
mod panel;
mod parallax;
mod pictures;
mod quilt_name;
mod warp;

pub use anaglyph::anaglyph;
pub use arrangement::{Arrangement, Axis, Turns};
pub use between::{KeyView, interpolate};
pub use compare::psnr_db;
pub(crate) use cone::check_cone;
pub use cone::{USUAL_VIEW_CONE_DEG, VIEW_CONES_DEG};
pub use grid::{MAX_VIEWS, ViewCount, ViewGrid};
pub use panel::{LensPanel, PanelError, Subpixels};
pub use parallax::{Parallax, TrueViews};
pub(crate) use pictures::check_size;
pub use pictures::{Views, check_layers};
pub use quilt_name::QuiltName;
pub(crate) use warp::{LinePiece, Span, cut, is_one_surface, place};
pub use warp::{ProcessorViews, Synthesize, synthesize};

/// The places of the eyes of a tracked viewer, in eye separations: those from which a viewer at
/// `distance_mm` sees the same. Points near the screen move against it in proportion to the way of
/// the eye, and inversely to its distance.
///
/// Left and right eye are in the space of the screen, mm: x to the right, z towards the viewer and
/// positive. Places farther than 16 eye separations from the middle are moved there.
#[must_use]
pub fn tracked_eyes(left_mm: [f64; 3], right_mm: [f64; 3], distance_mm: f64) -> [f64; 2] {
    let seen = |[x, _, z]: [f64; 3]| x / parallax::EYE_SEPARATION_MM * (distance_mm / z);
    [left_mm, right_mm].map(|eye| seen(eye).clamp(-FARTHEST_EYE, FARTHEST_EYE))
}

/// Farthest place of an eye that is followed, in eye separations.
const FARTHEST_EYE: f64 = 16.0;

/// The places of `count` eyes that are `span` eye separations apart from the first to the last,
/// from left to right and even.
#[must_use]
pub fn eyes(count: usize, span: f64) -> Vec<f64> {
    let last = count.saturating_sub(1).max(1) as f64;
    // Measured from the middle, so that left and right eyes differ only by the sign.
    (0..count).map(|i| (2.0 * i as f64 - (count.max(1) - 1) as f64) / (2.0 * last) * span).collect()
}
