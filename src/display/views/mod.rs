//! The views that a glasses-free display makes of a picture and its disparity, for people without
//! the display.
//!
//! The parallax of a disparity for an eye ([`Parallax`]), views by depth-image-based rendering
//! ([`synthesize`]), views between rendered ones ([`interpolate`]), their grids, anaglyphs, and their distance from true renders ([`psnr_db`]). No
//! maker has published the renderer of a display; this is the displays' geometry with the usual way
//! to fill holes.
//!
//! **Eyes** are places along the viewers' eye line, counted in eye separations to the right of the
//! middle: -0.5 and 0.5 are a pair of eyes before the middle of the screen. Shifts are in pixels of
//! the picture, to the right.

mod anaglyph;
mod between;
mod compare;
mod grid;
mod parallax;
mod warp;

use super::MAX_FRAME_SIDE_PX;
use crate::layout::error::LayoutError;

pub use anaglyph::anaglyph;
pub use between::{KeyView, interpolate};
pub use compare::psnr_db;
pub use grid::{MAX_VIEWS, ViewGrid};
pub use parallax::{Parallax, TrueViews};
pub use warp::synthesize;

/// Pixels that all views of a picture may have together.
const MAX_PIXELS: u64 = 1 << 26;

/// Pictures of one size, from the leftmost eye to the rightmost. Red, green, blue in rows from the
/// top left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Views {
    size_px: [u32; 2],
    pictures: Vec<Vec<[u8; 3]>>,
}

impl Views {
    /// Views of `size_px` (width, height) each.
    ///
    /// # Errors
    /// When there are no views, the size is out of range, or a picture does not fill it.
    pub fn new(size_px: [u32; 2], pictures: Vec<Vec<[u8; 3]>>) -> Result<Self, LayoutError> {
        check_size(size_px, pictures.len())?;
        let expected = size_px[0] as usize * size_px[1] as usize;
        match pictures.iter().map(Vec::len).find(|found| *found != expected) {
            Some(found) => Err(LayoutError::PixelCount { what: "a view", size_px, found, expected }),
            None => Ok(Self { size_px, pictures }),
        }
    }

    /// Width and height of each view, pixels.
    #[must_use]
    pub const fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    /// The views from left to right.
    #[must_use]
    pub fn pictures(&self) -> &[Vec<[u8; 3]>] {
        &self.pictures
    }
}

/// Rejects too many or too large views before any work.
pub(super) fn check_size(size_px: [u32; 2], count: usize) -> Result<(), LayoutError> {
    let pixels = u64::from(size_px[0]) * u64::from(size_px[1]) * count as u64;
    if count == 0 || pixels > MAX_PIXELS {
        return Err(LayoutError::ViewPixels { count, size_px });
    }
    if size_px.iter().any(|side| !(1..=MAX_FRAME_SIDE_PX).contains(side)) {
        return Err(LayoutError::Size { what: "a view", size_px });
    }
    Ok(())
}

/// The places of `count` eyes that are `span` eye separations apart from the first to the last,
/// from left to right and even.
#[must_use]
pub fn eyes(count: usize, span: f64) -> Vec<f64> {
    let last = count.saturating_sub(1).max(1) as f64;
    // Measured from the middle, so that left and right eyes differ only by the sign.
    (0..count).map(|i| (2.0 * i as f64 - (count.max(1) - 1) as f64) / (2.0 * last) * span).collect()
}
