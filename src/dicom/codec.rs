//! Compressed frames: fragments to frames, frames to samples.
//!
//! Fragments are separated by their lengths, never by scanning for delimiters, which may occur
//! inside of compressed data. JPEG samples come from the decoders of dicom-rs, and from `jpeg_dct`
//! for 12-bit DCT JPEG, which those lack. A codestream's own header is compared with the data set
//! first, since decoders allocate by it. RLE and deflated frames are decoded here, because the
//! decoders of dicom-rs for them grow without limit.

use std::borrow::Cow;
use std::cell::Cell;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Once;

use dicom_dictionary_std::{tags, uids};
use dicom_encoding::adapters::{PixelDataObject, RawPixelData};
use dicom_encoding::transfer_syntax::{Codec, TransferSyntaxIndex};
use dicom_transfer_syntax_registry::TransferSyntaxRegistry;

use super::causes::DecodeError;
use super::codestream::{self, Coding, Header};
use super::dataset::{self, Encoding};
use super::error::Defect;
use super::file_bytes::Bytes;
use super::header::FileHeader;
use super::jpeg_dct;
use super::part10::Syntax;
use super::pixels::PixelLayout;
use super::rle;

/// Retired by the standard, and so deprecated in the dictionary, but not by archives.
const JPEG_SPECTRAL_SELECTION: &str = "1.2.840.10008.1.2.4.53";
const JPEG_FULL_PROGRESSION: &str = "1.2.840.10008.1.2.4.55";

/// The most fragments of a file: sixteen for each of the most frames.
const MOST_FRAGMENTS: usize = 1 << 20;

/// A fragment: where its bytes lie in the file.
type Fragment = Range<u64>;

/// The fragments of each frame.
#[derive(Debug)]
pub(super) struct Frames(Vec<Vec<Fragment>>);

impl Frames {
    /// Finds the fragments of each frame.
    ///
    /// # Errors
    /// When fragments are cut short or cannot be attributed to frames.
    pub(super) fn index(header: &FileHeader, bytes: &Bytes) -> Result<Self, Defect> {
        let (offsets, fragments) = fragments(header, bytes)?;
        let frames = header.layout.frames as usize;
        let starts = match frames {
            1 => Some(vec![0]),
            _ if fragments.len() == frames => Some((0..frames).collect()),
            _ => starts_from_offsets(&extended(&header.extended_offsets), &fragments, frames)
                .or_else(|| starts_from_offsets(&offsets, &fragments, frames))
                .or_else(|| starts_from_markers(bytes, &fragments, frames)),
        };
        let unclear = || Defect::Fragments { fragments: fragments.len(), frames: header.layout.frames };
        let starts = starts.filter(|_| !fragments.is_empty()).ok_or_else(unclear)?;
        let ends = starts.iter().skip(1).copied().chain([fragments.len()]);
        Ok(Self(starts.iter().zip(ends).map(|(&start, end)| fragments[start..end].to_vec()).collect()))
    }

    /// The compressed bytes of a frame.
    ///
    /// # Errors
    /// When they cannot be read.
    pub(super) fn read(&self, frame: u32, bytes: &Bytes) -> Result<Vec<u8>, Defect> {
        let fragments = &self.0[frame as usize];
        // Fragments were checked to lie within the file, so this is no more than its size.
        let total: u64 = fragments.iter().map(|fragment| fragment.end - fragment.start).sum();
        let mut data = vec![0; total as usize];
        let mut rest = data.as_mut_slice();
        for fragment in fragments {
            let (part, behind) = rest.split_at_mut((fragment.end - fragment.start) as usize);
            bytes.read_exact_at(fragment.start, part)?;
            rest = behind;
        }
        Ok(data)
    }
}

/// The Basic Offset Table and the fragments behind it.
fn fragments(header: &FileHeader, bytes: &Bytes) -> Result<(Vec<u64>, Vec<Fragment>), Defect> {
    let (mut reader, end) = bytes.open()?;
    let mut position = header.pixels.position;
    reader.seek(SeekFrom::Start(position))?;
    let mut items = Vec::new();
    // A missing delimiter at the end of the file loses nothing. A file that shrank since its header
    // was read may end before its pixels begin.
    while end.saturating_sub(position) >= 8 {
        let item = dataset::read_header(&mut reader, &mut position, end, Encoding::ExplicitLittle)?;
        if item.tag == dataset::SEQUENCE_DELIMITATION {
            break;
        }
        let (dataset::ITEM, Some(length)) = (item.tag, item.length) else {
            return Err(Defect::NotAnItem { found: item.tag });
        };
        let (found, expected) = (end.saturating_sub(position), u64::from(length));
        if found < expected {
            return Err(Defect::Short { tag: tags::PIXEL_DATA, found, expected });
        }
        if items.len() > MOST_FRAGMENTS {
            return Err(Defect::Fragments { fragments: items.len(), frames: header.layout.frames });
        }
        items.push(position..position + expected);
        position += expected;
        reader.seek_relative(length.into())?;
    }
    if items.is_empty() {
        return Ok((Vec::new(), items));
    }
    let table = items.remove(0);
    // Each frame has an entry of four bytes; a longer table is invalid.
    let length = (table.end - table.start).min(u64::from(header.layout.frames) * 4) as usize;
    let mut offsets = vec![0; length];
    bytes.read_exact_at(table.start, &mut offsets)?;
    let offsets = offsets.as_chunks::<4>().0.iter().map(|bytes| u32::from_le_bytes(*bytes).into());
    Ok((offsets.collect(), items))
}

fn extended(table: &[u8]) -> Vec<u64> {
    table.as_chunks::<8>().0.iter().map(|bytes| u64::from_le_bytes(*bytes)).collect()
}

/// The first fragment of each frame by an offset table: offsets of item tags from the first
/// fragment's.
fn starts_from_offsets(offsets: &[u64], fragments: &[Fragment], frames: usize) -> Option<Vec<usize>> {
    let origin = fragments.first()?.start;
    let starts: Option<Vec<usize>> = offsets
        .iter()
        .map(|offset| fragments.binary_search_by_key(&offset.checked_add(origin)?, |f| f.start).ok())
        .collect();
    starts.filter(|starts| {
        starts.len() == frames && starts.first() == Some(&0) && starts.is_sorted_by(|a, b| a < b)
    })
}

/// The first fragment of each frame by the marker that begins a JPEG (FFD8) or JPEG 2000 (FF4F)
/// codestream.
fn starts_from_markers(bytes: &Bytes, fragments: &[Fragment], frames: usize) -> Option<Vec<usize>> {
    let mut starts = Vec::new();
    for (index, fragment) in fragments.iter().enumerate() {
        let mut marker = [0; 2];
        if fragment.end - fragment.start >= 2 {
            bytes.read_exact_at(fragment.start, &mut marker).ok()?;
        }
        if matches!(marker, [0xFF, 0xD8 | 0x4F]) {
            starts.push(index);
        }
    }
    (starts.len() == frames && starts.first() == Some(&0)).then_some(starts)
}

/// How the frames of a transfer syntax are decoded. Others are refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FrameCoding {
    Rle,
    Deflated,
    /// Samples as they are, in fragments.
    Encapsulated,
    /// A JPEG, JPEG-LS or JPEG 2000 codestream.
    Codestream,
}

impl FrameCoding {
    fn of(syntax: &Syntax) -> Option<Self> {
        Some(match syntax.uid.as_str() {
            uids::RLE_LOSSLESS => Self::Rle,
            uids::DEFLATED_IMAGE_FRAME_COMPRESSION => Self::Deflated,
            uids::ENCAPSULATED_UNCOMPRESSED_EXPLICIT_VR_LITTLE_ENDIAN => Self::Encapsulated,
            uids::JPEG_BASELINE8_BIT
            | uids::JPEG_EXTENDED12_BIT
            | JPEG_SPECTRAL_SELECTION
            | JPEG_FULL_PROGRESSION
            | uids::JPEG_LOSSLESS
            | uids::JPEG_LOSSLESS_SV1
            | uids::JPEGLS_LOSSLESS
            | uids::JPEGLS_NEAR_LOSSLESS
            | uids::JPEG2000_LOSSLESS
            | uids::JPEG2000
            | uids::HTJ2K_LOSSLESS
            | uids::HTJ2K_LOSSLESS_RPCL
            | uids::HTJ2K => Self::Codestream,
            _ => return None,
        })
    }
}

/// Decodes one compressed frame to samples of 8 or 16 bits, little-endian.
///
/// # Errors
/// When there is no decoder for the transfer syntax, or the decoder fails.
pub(super) fn decode(data: Vec<u8>, syntax: &Syntax, layout: &PixelLayout) -> Result<Vec<u8>, Defect> {
    let refused = |source| Defect::Codec { codec: syntax.name(), source };
    let pixels = layout.frame_pixels();
    match FrameCoding::of(syntax) {
        None => {
            let found = format!("{:.64} ({})", syntax.uid, syntax.name());
            Err(Defect::TransferSyntax { found, why: "is not decoded here" })
        }
        Some(FrameCoding::Rle) => rle::decode(&data, pixels, layout.bits_allocated as usize / 8)
            .map_err(|error| refused(DecodeError::decoder(error))),
        Some(FrameCoding::Deflated) => inflate(&data, layout).map_err(refused),
        Some(FrameCoding::Encapsulated) => {
            let mut data = data;
            data.truncate(layout.frame_bytes() as usize); // a frame of an odd length is padded
            Ok(data)
        }
        Some(FrameCoding::Codestream) => decode_codestream(data, syntax, layout),
    }
}

/// A deflated frame (PS3.5 Annex H): as many bytes as the image has, and none beyond.
fn inflate(data: &[u8], layout: &PixelLayout) -> Result<Vec<u8>, DecodeError> {
    let expected = layout.frame_bytes();
    let mut samples = Vec::new();
    // One byte more than an even length tells a longer frame.
    let most = expected.next_multiple_of(2) + 1;
    flate2::read::DeflateDecoder::new(data)
        .take(most)
        .read_to_end(&mut samples)
        .map_err(DecodeError::decoder)?;
    if samples.len() as u64 == most {
        return Err(DecodeError::TooLong { expected });
    }
    samples.truncate(expected as usize);
    Ok(samples)
}

fn decode_codestream(data: Vec<u8>, syntax: &Syntax, layout: &PixelLayout) -> Result<Vec<u8>, Defect> {
    // A JP2 file around the codestream, which the standard forbids and some writers make, is
    // unwrapped: a decoder that looked for the codestream itself could find another one.
    let data = codestream::unwrapped(data);
    let refused = |source| Defect::Codec { codec: syntax.name(), source };
    let Some(header) = codestream::read(&data) else {
        return Err(refused(DecodeError::NoHeader));
    };
    header.check(layout)?;
    if header.coding == Coding::JpegDct && header.precision > 8 {
        let samples =
            jpeg_dct::decode(&data, layout.columns as usize, layout.rows as usize, header.precision);
        let samples = samples.map_err(|error| refused(DecodeError::decoder(error)))?;
        return Ok(samples.into_iter().flat_map(u16::to_le_bytes).collect());
    }
    decode_with_registry(data, syntax, layout, bits_per_sample(header))
}

/// The bits that a decoder delivers for each sample.
fn bits_per_sample(header: Header) -> u32 {
    match header {
        // Sixteen bits keep the sign of whatever precision the codestream has.
        Header { coding: Coding::Jpeg2000, .. } => 16,
        Header { precision: 8, .. } => 8,
        _ => 16,
    }
}

fn decode_with_registry(
    data: Vec<u8>,
    syntax: &Syntax,
    layout: &PixelLayout,
    bits_allocated: u32,
) -> Result<Vec<u8>, Defect> {
    let cannot = |why| Defect::TransferSyntax { found: format!("{} ({})", syntax.uid, syntax.name()), why };
    let Some(entry) = TransferSyntaxRegistry.get(&syntax.uid) else {
        return Err(cannot("is not a transfer syntax that is known here"));
    };
    let Codec::EncapsulatedPixelData(Some(reader), _) = entry.codec() else {
        return Err(cannot("cannot be decoded by this build"));
    };
    let refused = |source| Defect::Codec { codec: syntax.name(), source };
    let frame = Frame { data, uid: &syntax.uid, layout, bits_allocated };
    let mut samples = Vec::new();
    match quietly(|| reader.decode_frame(&frame, 0, &mut samples)) {
        Some(Ok(())) => Ok(samples),
        Some(Err(error)) => Err(refused(DecodeError::decoder(error))),
        None => Err(refused(DecodeError::Panicked)),
    }
}

/// Calls a decoder; `None` when it panics.
///
/// Decoders panic on some damaged codestreams; such a panic affects only its frame. The hook keeps
/// it from being reported as a bug on stderr, and passes all others on.
fn quietly<T>(decode: impl FnOnce() -> T) -> Option<T> {
    thread_local! {
        static DECODING: Cell<bool> = const { Cell::new(false) };
    }
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let report = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if !DECODING.get() {
                report(panic);
            }
        }));
    });
    DECODING.set(true);
    // A failed decoder leaves only the sample buffer incomplete, which is dropped.
    let outcome = catch_unwind(AssertUnwindSafe(decode)).ok();
    DECODING.set(false);
    outcome
}

/// One frame as dicom-rs decoders want it: an object of a single frame in a single fragment.
struct Frame<'a> {
    data: Vec<u8>,
    uid: &'a str,
    layout: &'a PixelLayout,
    bits_allocated: u32,
}

impl PixelDataObject for Frame<'_> {
    fn transfer_syntax_uid(&self) -> &str {
        self.uid
    }

    fn rows(&self) -> Option<u16> {
        self.layout.rows.try_into().ok()
    }

    fn cols(&self) -> Option<u16> {
        self.layout.columns.try_into().ok()
    }

    fn samples_per_pixel(&self) -> Option<u16> {
        Some(1)
    }

    fn bits_allocated(&self) -> Option<u16> {
        self.bits_allocated.try_into().ok()
    }

    fn bits_stored(&self) -> Option<u16> {
        self.layout.bits_stored.try_into().ok()
    }

    fn photometric_interpretation(&self) -> Option<&str> {
        Some("MONOCHROME2")
    }

    fn number_of_frames(&self) -> Option<u32> {
        Some(1)
    }

    fn number_of_fragments(&self) -> Option<u32> {
        Some(1)
    }

    fn fragment(&self, fragment: usize) -> Option<Cow<'_, [u8]>> {
        (fragment == 0).then_some(Cow::Borrowed(&self.data))
    }

    fn offset_table(&self) -> Option<Cow<'_, [u32]>> {
        Some(Cow::Borrowed(&[]))
    }

    fn raw_pixel_data(&self) -> Option<RawPixelData> {
        Some(RawPixelData { fragments: vec![self.data.clone()].into(), offset_table: [].as_slice().into() })
    }
}
