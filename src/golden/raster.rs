//! Pictures in memory, and as the small files of a golden.
//!
//! Rows run from the top left. Colour is display-referred sRGB with coverage as the fourth byte; a
//! frame's fourth byte is 255. Depth is view depth in mm, `+inf` where the ray hit nothing.

use std::io::{Cursor, Read};
use std::path::Path;

use image::codecs::png::{CompressionType, FilterType, PngDecoder, PngEncoder};
use image::{ColorType, DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder};
use serde::{Deserialize, Serialize};

use super::error::{GoldenError, PictureError};
use super::limits::{MAX_DECODED_BYTES, MAX_FILE_BYTES};
use relief_display::decode_exr;

/// A picture that can be compared.
#[derive(Clone, Debug, PartialEq)]
pub struct Raster {
    /// Width and height, pixels.
    pub size_px: [u32; 2],
    /// One value for each pixel, in rows from the top.
    pub samples: Samples,
}

/// The meaning of the pixels of a [`Raster`].
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// Red, green, blue and coverage.
    Color(Vec<[u8; 4]>),
    /// View depth in mm, `+inf` for a miss.
    DepthMm(Vec<f32>),
}

impl Raster {
    /// The golden in `folder`; `None` when it is missing.
    pub(super) fn read(folder: &Path, aspect: Aspect) -> Result<Option<Self>, GoldenError> {
        let path = folder.join(aspect.file_name());
        let Some(bytes) = read_bounded(&path)? else { return Ok(None) };
        let decoded = match aspect {
            Aspect::Color => decode_png(&bytes, ColorType::Rgba8),
            Aspect::Frame => decode_png(&bytes, ColorType::Rgb8),
            Aspect::Depth => decode_depth(&bytes),
        };
        decoded.map(Some).map_err(|source| GoldenError::Decode { path, source })
    }

    /// Number of pixels.
    pub(super) fn pixels(&self) -> usize {
        match &self.samples {
            Samples::Color(pixels) => pixels.len(),
            Samples::DepthMm(pixels) => pixels.len(),
        }
    }

    /// Column and row of a pixel.
    pub(super) fn position(&self, index: usize) -> [usize; 2] {
        let width = self.size_px[0] as usize;
        [index % width, index / width]
    }
}

/// The bytes of a file of at most [`MAX_FILE_BYTES`]; `None` when it is missing.
pub(super) fn read_bounded(path: &Path) -> Result<Option<Vec<u8>>, GoldenError> {
    let failed = |source| GoldenError::Read { path: path.to_owned(), source };
    let file = match std::fs::File::open(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        opened => opened.map_err(failed)?,
    };
    let mut bytes = Vec::new();
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(failed)?;
    check_size(path, &bytes)?;
    Ok(Some(bytes))
}

/// Rejects a picture that is too large for a golden.
pub(super) fn check_size(path: &Path, file: &[u8]) -> Result<(), GoldenError> {
    let bytes = file.len() as u64;
    if bytes > MAX_FILE_BYTES {
        return Err(GoldenError::FileTooLarge { path: path.to_owned(), bytes });
    }
    Ok(())
}

/// A PNG of exactly this colour type.
pub(super) fn decode_png(file: &[u8], expected: ColorType) -> Result<Raster, PictureError> {
    let decoder = PngDecoder::new(Cursor::new(file))?;
    let (found, bytes) = (decoder.color_type(), decoder.total_bytes());
    if found != expected {
        return Err(PictureError::ColorType { found, expected });
    }
    if bytes > MAX_DECODED_BYTES {
        return Err(PictureError::TooLarge { bytes });
    }
    let picture = DynamicImage::from_decoder(decoder)?;
    let size_px = [picture.width(), picture.height()];
    let pixels = picture.into_rgba8().pixels().map(|pixel| pixel.0).collect();
    Ok(Raster { size_px, samples: Samples::Color(pixels) })
}

fn decode_depth(file: &[u8]) -> Result<Raster, PictureError> {
    let decoded = decode_exr(file)?;
    Ok(Raster { size_px: decoded.size_px, samples: Samples::DepthMm(decoded.depth_mm) })
}

/// A PNG with coverage.
pub(super) fn rgba_png(size_px: [u32; 2], pixels: &[[u8; 4]]) -> Result<Vec<u8>, GoldenError> {
    png(size_px, pixels.as_flattened(), ExtendedColorType::Rgba8)
}

/// A PNG of the colours as displayed, without coverage.
pub(super) fn rgb_png(size_px: [u32; 2], pixels: &[[u8; 4]]) -> Result<Vec<u8>, GoldenError> {
    let rgb: Vec<u8> = pixels.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect();
    png(size_px, &rgb, ExtendedColorType::Rgb8)
}

fn png([width, height]: [u32; 2], samples: &[u8], kind: ExtendedColorType) -> Result<Vec<u8>, GoldenError> {
    let mut file = Vec::new();
    PngEncoder::new_with_quality(&mut file, CompressionType::Best, FilterType::Adaptive)
        .write_image(samples, width, height, kind)?;
    Ok(file)
}

/// One of the pictures that a case compares.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Aspect {
    /// Colour and coverage, as rendered.
    Color,
    /// View depth in mm.
    Depth,
    /// The frame that a display takes: layout, disparity and header by the scene's `display`.
    Frame,
}

impl Aspect {
    /// All aspects.
    pub const ALL: [Self; 3] = [Self::Color, Self::Depth, Self::Frame];

    /// The name in `case.toml`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Color => "color",
            Self::Depth => "depth",
            Self::Frame => "frame",
        }
    }

    /// The file with the expected picture.
    #[must_use]
    pub const fn file_name(self) -> &'static str {
        match self {
            Self::Color => "color.png",
            Self::Depth => "depth.exr",
            Self::Frame => "frame.png",
        }
    }
}
