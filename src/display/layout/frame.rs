//! The two ends of a layout: the picture that goes in and the frame that comes out.

use super::error::LayoutError;
use crate::MAX_FRAME_SIDE_PX;

/// A rendered picture: colour and view depth of every pixel, in rows from the top left. Borrowed,
/// never copied.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    size_px: [u32; 2],
    color: &'a [[u8; 4]],
    depth_mm: &'a [f32],
    back: Option<(&'a [[u8; 4]], &'a [f32])>,
}

/// Colour and disparity of every pixel, in rows from the top left: of a colour its first three
/// bytes count.
#[derive(Clone, Copy, Debug)]
pub struct DisparityLayer<'a, const N: usize> {
    /// Red, green, blue, and whatever follows.
    pub color: &'a [[u8; N]],
    /// D, 255 nearest.
    pub disparity: &'a [u8],
}

/// A frame as a display or a file takes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    size_px: [u32; 2],
    pixels: Pixels,
}

/// The samples of a frame, in rows from the top left without padding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Pixels {
    /// Red, green, blue; 8 bits each.
    Rgb8(Vec<u8>),
    /// Grey; 16 bits.
    Gray16(Vec<u16>),
}

impl<'a> Picture<'a> {
    /// A picture of `size_px` (width, height): display-referred sRGB with alpha, which layouts
    /// leave out, and view depth in mm, `+inf` where the ray hit nothing.
    ///
    /// # Errors
    /// When a side is 0 or above 16384, or the slices do not fill the size.
    pub fn new(size_px: [u32; 2], color: &'a [[u8; 4]], depth_mm: &'a [f32]) -> Result<Self, LayoutError> {
        pixel_count("a picture", size_px)?;
        let picture = Self { size_px, color, depth_mm, back: None };
        picture.check([("the colour", color.len()), ("the depth", depth_mm.len())])?;
        Ok(picture)
    }

    /// The same picture with a background layer: its colour and view depth, in the same format.
    ///
    /// # Errors
    /// When the slices do not fill the picture's size.
    pub fn with_back(self, color: &'a [[u8; 4]], depth_mm: &'a [f32]) -> Result<Self, LayoutError> {
        self.check([
            ("the colour of the background", color.len()),
            ("the depth of the background", depth_mm.len()),
        ])?;
        Ok(Self { back: Some((color, depth_mm)), ..self })
    }

    fn check(&self, counts: [(&'static str, usize); 2]) -> Result<(), LayoutError> {
        let size_px = self.size_px;
        let expected = pixel_count("a picture", size_px)?;
        match counts.into_iter().find(|(_, found)| *found != expected) {
            Some((what, found)) => Err(LayoutError::PixelCount { what, size_px, found, expected }),
            None => Ok(()),
        }
    }

    /// The background layer as a picture of its own.
    #[must_use]
    pub fn back(&self) -> Option<Self> {
        self.back.map(|(color, depth_mm)| Self { color, depth_mm, back: None, ..*self })
    }

    /// Width and height, pixels.
    #[must_use]
    pub const fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    /// Red, green, blue and alpha of every pixel.
    #[must_use]
    pub const fn color(&self) -> &'a [[u8; 4]] {
        self.color
    }

    /// View depth of every pixel, mm; `+inf` for a miss.
    #[must_use]
    pub const fn depth_mm(&self) -> &'a [f32] {
        self.depth_mm
    }
}

impl Frame {
    /// A frame of `size_px` (width, height).
    ///
    /// # Errors
    /// When a side is 0 or above 16384, or the samples do not fill the size.
    pub fn new(size_px: [u32; 2], pixels: Pixels) -> Result<Self, LayoutError> {
        let count = pixel_count("a frame", size_px)?;
        let (found, expected) = match &pixels {
            Pixels::Rgb8(samples) => (samples.len(), 3 * count),
            Pixels::Gray16(samples) => (samples.len(), count),
        };
        if found != expected {
            return Err(LayoutError::PixelCount { what: "a frame", size_px, found, expected });
        }
        Ok(Self { size_px, pixels })
    }

    /// Width and height, pixels.
    #[must_use]
    pub const fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    /// The samples.
    #[must_use]
    pub const fn pixels(&self) -> &Pixels {
        &self.pixels
    }
}

/// The number of pixels of a size within the limits.
pub(super) fn pixel_count(what: &'static str, size_px: [u32; 2]) -> Result<usize, LayoutError> {
    let [width, height] = size_px;
    if !(1..=MAX_FRAME_SIDE_PX).contains(&width) || !(1..=MAX_FRAME_SIDE_PX).contains(&height) {
        return Err(LayoutError::Size { what, size_px });
    }
    Ok(width as usize * height as usize)
}

/// One picture of a decoded frame, with its disparity.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DecodedLayer {
    /// Red, green, blue of every pixel.
    pub color: Vec<[u8; 3]>,
    /// D of every pixel, 255 nearest.
    pub disparity: Vec<u8>,
}
