//! Files in memory: PNG for frames and views, JPEG for colours only, OpenEXR for depth in mm.
//!
//! Encoders to `Vec<u8>`; equal input gives equal bytes. Callers write the files.

mod exr;
mod views;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use super::layout::{Frame, Pixels};
use crate::layout::error::LayoutError;

pub use exr::{Attribute, CameraMatrices, DecodedDepthImage, DepthImage, decode_exr, encode_exr};
pub(super) use views::written_layout;
pub use views::{decode_wiggle, encode_views};

/// A picture that could not be made into a file.
#[derive(Debug, thiserror::Error)]
pub enum EncodeError {
    /// The PNG encoder failed.
    #[error("cannot encode a PNG")]
    Png(#[source] image::ImageError),
    /// The encoder of views failed.
    #[error("cannot encode a PNG of views")]
    Views(#[from] png::EncodingError),
    /// An animation that cannot be read.
    #[error("the animated PNG is damaged or cut")]
    Animation(#[from] png::DecodingError),
    /// An animation of another kind, or none.
    #[error(
        "the PNG is not a wiggle; expected an animation of whole 8-bit RGB pictures that goes back and forth"
    )]
    NoWiggle,
    /// The views do not fit their layout.
    #[error(transparent)]
    Layout(#[from] LayoutError),
    /// The JPEG encoder failed.
    #[error("cannot encode a JPEG")]
    Jpeg(#[source] jpeg_encoder::EncodingError),
    /// JPEG stores sizes in 16 bits, its quality is a percentage.
    #[error("a JPEG of {}x{} with quality {quality}; allowed: 1 to 65535 pixels each way, quality 1 to 100",
        size_px[0], size_px[1])]
    JpegRange {
        /// Width and height.
        size_px: [u32; 2],
        /// Quality in percent.
        quality: u8,
    },
    /// The slices do not fill the size.
    #[error("{what} of {}x{} has {found} values, expected {expected}", size_px[0], size_px[1])]
    PixelCount {
        /// The value.
        what: &'static str,
        /// Width and height.
        size_px: [u32; 2],
        /// Values there.
        found: usize,
        /// Values for this size.
        expected: usize,
    },
    /// The OpenEXR encoder failed, or the file is damaged.
    #[error("cannot encode or decode an OpenEXR file")]
    Exr(#[source] ::exr::error::Error),
    /// A file without depth.
    #[error("the OpenEXR file has no channel Z, where view depth in mm is expected")]
    NoDepthChannel,
    /// A file that is larger than any frame, rejected before memory is allocated for it.
    #[error("the OpenEXR picture is {}x{}; allowed: 1 to 16384 pixels each way, 2 GiB in all", .0[0], .0[1])]
    ExrSize([usize; 2]),
    /// The OpenEXR encoder's header is not as the format has it.
    #[error("the OpenEXR encoder wrote a header that cannot be read")]
    ExrHeader,
    /// An attribute that OpenEXR cannot hold.
    #[error(
        "the OpenEXR attribute {0:?} is not allowed: names have 1 to 255 ASCII characters, texts are Latin-1"
    )]
    Attribute(String),
}

/// A PNG of a frame: 8-bit RGB or 16-bit grey, without gAMA, cHRM, iCCP or sRGB chunks, which would
/// let viewers alter the header's bits.
///
/// # Errors
/// When the encoder fails.
pub fn encode_png(frame: &Frame) -> Result<Vec<u8>, EncodeError> {
    let [width, height] = frame.size_px();
    let (samples, kind): (&[u8], _) = match frame.pixels() {
        Pixels::Rgb8(samples) => (samples, ExtendedColorType::Rgb8),
        Pixels::Gray16(samples) => (bytemuck::cast_slice(samples), ExtendedColorType::L16),
    };
    let mut file = Vec::with_capacity(samples.len() / 4);
    // One filter for all lines: a third of the time of a search on each line, and the same size
    // within 10 %. The filter looks along the line, because neighbouring lines of the interleaved
    // layout are black.
    PngEncoder::new_with_quality(&mut file, CompressionType::Fast, FilterType::Sub)
        .write_image(samples, width, height, kind)
        .map_err(EncodeError::Png)?;
    Ok(file)
}

/// A JPEG of the colours, for previews; never for 2D+Z frames, whose header would not survive.
///
/// # Errors
/// When `quality` is not 1..=100, the slice does not fill the size, or the size is not one a JPEG
/// can have.
pub fn encode_jpeg(size_px: [u32; 2], color: &[[u8; 4]], quality: u8) -> Result<Vec<u8>, EncodeError> {
    check_count("the colour", size_px, color.len())?;
    let [Ok(width @ 1..), Ok(height @ 1..)] = size_px.map(u16::try_from) else {
        return Err(EncodeError::JpegRange { size_px, quality });
    };
    if !(1..=100).contains(&quality) {
        return Err(EncodeError::JpegRange { size_px, quality });
    }
    let mut file = Vec::with_capacity(color.len() / 4);
    jpeg_encoder::Encoder::new(&mut file, quality)
        .encode(color.as_flattened(), width, height, jpeg_encoder::ColorType::Rgba)
        .map_err(EncodeError::Jpeg)?;
    Ok(file)
}

fn check_count(what: &'static str, size_px: [u32; 2], found: usize) -> Result<(), EncodeError> {
    let expected = size_px[0] as usize * size_px[1] as usize;
    if found != expected {
        return Err(EncodeError::PixelCount { what, size_px, found, expected });
    }
    Ok(())
}
