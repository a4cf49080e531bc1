//! Colour and depth as bytes and back: JPEG, or differences along rows, packed.
//!
//! Each row is written as differences to the pixel on its left, the first pixel of a row to the one
//! above, per channel and wrapping; smooth pictures become small numbers that pack well and
//! quickly. 16-bit numbers are little-endian. Decoders know the number of pixels and give
//! memory for no more, whatever the bytes claim.

use std::io::Cursor;

use flate2::{Compress, Compression, Decompress, FlushCompress, FlushDecompress, Status};
use image::ImageDecoder;

use super::format::{ColorFormat, DepthFormat, Packing};
use relief_display::{EncodeError, encode_jpeg};

/// Packing is to cost less than sending: the quickest levels.
const ZSTD_LEVEL: i32 = 1;
const DEFLATE_LEVEL: Compression = Compression::fast();

/// Colour or depth that could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum CodecError {
    /// The slice's length does not match the size.
    #[error("{what} of {}x{} has {found} values, expected {expected}", size[0], size[1])]
    Count {
        /// The value.
        what: &'static str,
        /// Width and rows.
        size: [usize; 2],
        /// Values there.
        found: usize,
        /// Values for this size.
        expected: usize,
    },
    /// The JPEG encoder refused.
    #[error(transparent)]
    Jpeg(#[from] EncodeError),
    /// A compressor failed, or the compressed data is damaged.
    #[error("the {what} cannot be packed or unpacked: {source}")]
    Packing {
        /// The value.
        what: &'static str,
        /// The error of the compressor.
        source: std::io::Error,
    },
    /// The unpacked data has another length than the header says.
    #[error("the {what} unpacks to {found} bytes, expected {expected}")]
    Unpacked {
        /// The value.
        what: &'static str,
        /// Bytes there; one more than expected stands for more.
        found: usize,
        /// Bytes of this size.
        expected: usize,
    },
    /// The JPEG cannot be decoded.
    #[error("the JPEG of the colour is damaged: {0}")]
    JpegDamaged(#[source] image::ImageError),
    /// The JPEG is another picture.
    #[error(
        "the JPEG of the colour is {}x{} of {kind:?}, expected {}x{} of Rgb8",
        found[0], found[1], expected[0], expected[1]
    )]
    JpegPicture {
        /// Width and height of the JPEG, px.
        found: [u32; 2],
        /// Its channels.
        kind: image::ColorType,
        /// Width and height of the frame, px.
        expected: [usize; 2],
    },
}

/// Colours of `size` (width and rows) in a format; `quality` is that of JPEG, 1 to 100.
///
/// # Errors
/// When the colours do not fill the size, or the encoder refuses.
pub fn encode_color(
    size: [usize; 2],
    color: &[[u8; 4]],
    format: ColorFormat,
    quality: u8,
) -> Result<Vec<u8>, CodecError> {
    check_count("the colour", size, color.len())?;
    match format.packing() {
        None => {
            let side = |side: usize| u32::try_from(side).unwrap_or(u32::MAX);
            Ok(encode_jpeg(size.map(side), color, quality)?)
        }
        Some(packing) => {
            let rgb: Vec<u8> = color.iter().flat_map(|[r, g, b, _]| [*r, *g, *b]).collect();
            pack(&differences::<3>(size[0], &rgb), packing, "colour")
        }
    }
}

/// Colours of `size` (width and rows), red, green and blue.
///
/// # Errors
/// When the bytes are no such picture.
pub fn decode_color(size: [usize; 2], bytes: &[u8], format: ColorFormat) -> Result<Vec<[u8; 3]>, CodecError> {
    let rgb = match format.packing() {
        None => decode_jpeg(size, bytes)?,
        Some(packing) => {
            let mut rgb = unpack(bytes, packing, 3 * size[0] * size[1], "colour")?;
            sums::<3>(size[0], &mut rgb);
            rgb
        }
    };
    Ok(rgb.as_chunks::<3>().0.to_vec())
}

/// D of `size` (width and rows) in a format of 8 bits.
///
/// # Errors
/// When the values do not fill the size.
pub fn encode_d8(size: [usize; 2], disparity: &[u8], format: DepthFormat) -> Result<Vec<u8>, CodecError> {
    check_count("the depth", size, disparity.len())?;
    let Some(packing) = format.packing() else { return Ok(Vec::new()) };
    pack(&differences::<1>(size[0], disparity), packing, "depth")
}

/// Z of `size` (width and rows) in a format of 16 bits.
///
/// # Errors
/// When the values do not fill the size.
pub fn encode_z16(size: [usize; 2], scaled: &[u16], format: DepthFormat) -> Result<Vec<u8>, CodecError> {
    check_count("the depth", size, scaled.len())?;
    let Some(packing) = format.packing() else { return Ok(Vec::new()) };
    let mut bytes = Vec::with_capacity(2 * scaled.len());
    let mut above = 0u16;
    for row in scaled.chunks_exact(size[0]) {
        let lefts = std::iter::once(&above).chain(row);
        bytes.extend(row.iter().zip(lefts).flat_map(|(value, left)| value.wrapping_sub(*left).to_le_bytes()));
        above = row[0];
    }
    pack(&bytes, packing, "depth")
}

/// D of `size` (width and rows).
///
/// # Errors
/// When the bytes are no such depth.
pub fn decode_d8(size: [usize; 2], bytes: &[u8], format: DepthFormat) -> Result<Vec<u8>, CodecError> {
    let Some(packing) = format.packing() else { return Ok(Vec::new()) };
    let mut disparity = unpack(bytes, packing, size[0] * size[1], "depth")?;
    sums::<1>(size[0], &mut disparity);
    Ok(disparity)
}

/// Z of `size` (width and rows).
///
/// # Errors
/// When the bytes are no such depth.
pub fn decode_z16(size: [usize; 2], bytes: &[u8], format: DepthFormat) -> Result<Vec<u16>, CodecError> {
    let Some(packing) = format.packing() else { return Ok(Vec::new()) };
    let packed = unpack(bytes, packing, 2 * size[0] * size[1], "depth")?;
    let mut scaled: Vec<u16> =
        packed.as_chunks::<2>().0.iter().map(|pair| u16::from_le_bytes(*pair)).collect();
    let mut above = 0u16;
    for row in scaled.chunks_exact_mut(size[0]) {
        let mut left = above;
        for value in row.iter_mut() {
            *value = value.wrapping_add(left);
            left = *value;
        }
        above = row[0];
    }
    Ok(scaled)
}

fn check_count(what: &'static str, size: [usize; 2], found: usize) -> Result<(), CodecError> {
    let expected = size[0] * size[1];
    if found == expected && size[0] > 0 {
        return Ok(());
    }
    Err(CodecError::Count { what, size, found, expected })
}

/// Differences of rows of `width` pixels of `N` bytes.
fn differences<const N: usize>(width: usize, values: &[u8]) -> Vec<u8> {
    let line = N * width;
    let mut out = vec![0; values.len()];
    for (y, (out, row)) in out.chunks_exact_mut(line).zip(values.chunks_exact(line)).enumerate() {
        for channel in 0..N {
            let above = if y == 0 { 0 } else { values[(y - 1) * line + channel] };
            out[channel] = row[channel].wrapping_sub(above);
        }
        for ((out, value), left) in out[N..].iter_mut().zip(&row[N..]).zip(row) {
            *out = value.wrapping_sub(*left);
        }
    }
    out
}

/// The inverse of [`differences`], in place.
fn sums<const N: usize>(width: usize, values: &mut [u8]) {
    let mut above = [0u8; N];
    for row in values.chunks_exact_mut(N * width) {
        let mut left = above;
        for pixel in row.as_chunks_mut::<N>().0 {
            for (value, left) in pixel.iter_mut().zip(&mut left) {
                *value = value.wrapping_add(*left);
                *left = *value;
            }
        }
        above.copy_from_slice(&row[..N]);
    }
}

fn pack(bytes: &[u8], packing: Packing, what: &'static str) -> Result<Vec<u8>, CodecError> {
    let failed = |source| CodecError::Packing { what, source };
    match packing {
        Packing::Zstd => zstd::bulk::compress(bytes, ZSTD_LEVEL).map_err(failed),
        Packing::Deflate => {
            let mut packed = Vec::with_capacity(bytes.len() / 4 + 1024);
            let mut packer = Compress::new(DEFLATE_LEVEL, true);
            loop {
                let taken = packer.total_in() as usize;
                let status = packer.compress_vec(&bytes[taken..], &mut packed, FlushCompress::Finish);
                match status.map_err(|error| failed(error.into()))? {
                    Status::StreamEnd => return Ok(packed),
                    _ => packed.reserve(packed.capacity().max(1024)),
                }
            }
        }
    }
}

/// Exactly `expected` bytes, or an error; memory for no more than those.
fn unpack(
    bytes: &[u8],
    packing: Packing,
    expected: usize,
    what: &'static str,
) -> Result<Vec<u8>, CodecError> {
    let failed = |source| CodecError::Packing { what, source };
    let mut unpacked = vec![0; expected];
    let found = match packing {
        Packing::Zstd => zstd::bulk::decompress_to_buffer(bytes, &mut unpacked).map_err(failed)?,
        Packing::Deflate => {
            let mut unpacker = Decompress::new(true);
            let status = unpacker.decompress(bytes, &mut unpacked, FlushDecompress::Finish);
            let found = unpacker.total_out() as usize;
            match status.map_err(|error| failed(error.into()))? {
                Status::StreamEnd => found,
                // Full before the end of the stream, or empty before the end of the picture.
                _ if found == expected => expected + 1,
                _ => found,
            }
        }
    };
    if found != expected {
        return Err(CodecError::Unpacked { what, found, expected });
    }
    Ok(unpacked)
}

fn decode_jpeg(size: [usize; 2], bytes: &[u8]) -> Result<Vec<u8>, CodecError> {
    let decoder = image::codecs::jpeg::JpegDecoder::new(Cursor::new(bytes));
    let decoder = decoder.map_err(CodecError::JpegDamaged)?;
    let (width, height) = decoder.dimensions();
    if [width as usize, height as usize] != size || decoder.color_type() != image::ColorType::Rgb8 {
        let kind = decoder.color_type();
        return Err(CodecError::JpegPicture { found: [width, height], kind, expected: size });
    }
    let mut rgb = vec![0; 3 * size[0] * size[1]];
    decoder.read_image(&mut rgb).map_err(CodecError::JpegDamaged)?;
    Ok(rgb)
}
