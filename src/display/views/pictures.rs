//! Views of one size, with a limit on their pixels.

use crate::MAX_FRAME_SIDE_PX;
use crate::layout::DecodedLayer;
use crate::layout::error::LayoutError;

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

    /// The views from left to right.
    #[must_use]
    pub fn into_pictures(self) -> Vec<Vec<[u8; 3]>> {
        self.pictures
    }
}

/// Rejects layers that do not fill the size, and too many or too large views, before any work.
///
/// # Errors
/// When a layer does not fill the size, or there are no views or too many.
pub fn check_layers(
    size_px: [u32; 2],
    front: &DecodedLayer,
    back: Option<&DecodedLayer>,
    count: usize,
) -> Result<(), LayoutError> {
    check_size(size_px, count)?;
    let expected = size_px[0] as usize * size_px[1] as usize;
    let counts = [Some(front), back].into_iter().flatten();
    let counts = counts.flat_map(|layer| [layer.color.len(), layer.disparity.len()]);
    match counts.into_iter().find(|found| *found != expected) {
        Some(found) => Err(LayoutError::PixelCount { what: "a layer of a view", size_px, found, expected }),
        None => Ok(()),
    }
}

/// Rejects too many or too large views before any work.
pub(crate) fn check_size(size_px: [u32; 2], count: usize) -> Result<(), LayoutError> {
    let pixels = u64::from(size_px[0]) * u64::from(size_px[1]) * count as u64;
    if count == 0 || pixels > MAX_PIXELS {
        return Err(LayoutError::ViewPixels { count, size_px });
    }
    if size_px.iter().any(|side| !(1..=MAX_FRAME_SIDE_PX).contains(side)) {
        return Err(LayoutError::Size { what: "a view", size_px });
    }
    Ok(())
}
