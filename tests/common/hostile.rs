//! Generators of hostile files: field by field, so that each field may be wrong.
//!
//! The effect of each one on a reader without limits is described where it is used.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::io::{Cursor, Read, Write};

pub(crate) const EXPLICIT: &str = "1.2.840.10008.1.2.1";
pub(crate) const DEFLATED: &str = "1.2.840.10008.1.2.1.99";
pub(crate) const DEFLATED_FRAME: &str = "1.2.840.10008.1.2.8.1";
pub(crate) const RLE: &str = "1.2.840.10008.1.2.5";
pub(crate) const JPEG_2000: &str = "1.2.840.10008.1.2.4.90";
const CT: &str = "1.2.840.10008.5.1.4.1.1.2";

/// An element of explicit VR, little-endian, with an even length.
pub(crate) fn element(tag: [u16; 2], vr: &str, value: &[u8]) -> Vec<u8> {
    let mut value = value.to_vec();
    if value.len() % 2 == 1 {
        value.push(if ["UI", "OB"].contains(&vr) { 0 } else { b' ' });
    }
    let mut bytes = [tag[0].to_le_bytes(), tag[1].to_le_bytes()].concat();
    bytes.extend_from_slice(vr.as_bytes());
    if ["OB", "OW", "OV", "SQ", "UN", "UT"].contains(&vr) {
        bytes.extend_from_slice(&[0, 0]);
        bytes.extend(u32::try_from(value.len()).unwrap().to_le_bytes());
    } else {
        bytes.extend(u16::try_from(value.len()).unwrap().to_le_bytes());
    }
    bytes.extend(value);
    bytes
}

/// Preamble and file meta information.
pub(crate) fn meta(syntax: &str) -> Vec<u8> {
    let mut group = element([2, 1], "OB", &[0, 1]);
    for (number, value) in [(2, CT), (3, "1.2.3.4"), (0x10, syntax), (0x12, "1.2.3")] {
        group.extend(element([2, number], "UI", value.as_bytes()));
    }
    let mut bytes = vec![0; 128];
    bytes.extend_from_slice(b"DICM");
    bytes.extend(element([2, 0], "UL", &u32::try_from(group.len()).unwrap().to_le_bytes()));
    bytes.extend(group);
    bytes
}

/// The parts of a slice's header that vary.
pub(crate) struct Slice {
    pub(crate) rows: u16,
    pub(crate) bits: u16,
    pub(crate) frames: Option<u32>,
    pub(crate) number: usize,
    /// Elements between Modality and the geometry.
    pub(crate) extra: Vec<u8>,
    /// Elements before the pixels.
    pub(crate) late: Vec<u8>,
}

impl Default for Slice {
    fn default() -> Self {
        Self { rows: 64, bits: 16, frames: None, number: 0, extra: Vec::new(), late: Vec::new() }
    }
}

impl Slice {
    /// The data set up to its pixels.
    pub(crate) fn header(&self) -> Vec<u8> {
        let text = |tag, vr, value: &str| element(tag, vr, value.as_bytes());
        let number = |tag, value: u16| element(tag, "US", &value.to_le_bytes());
        let instance = format!("1.2.3.4.{}", self.number + 1);
        let mut bytes = text([8, 8], "CS", "ORIGINAL\\PRIMARY\\AXIAL");
        bytes.extend(text([8, 0x16], "UI", CT));
        bytes.extend(text([8, 0x18], "UI", &instance));
        bytes.extend(text([8, 0x60], "CS", "CT"));
        bytes.extend_from_slice(&self.extra);
        bytes.extend(text([0x18, 0x50], "DS", "1"));
        bytes.extend(text([0x20, 0xd], "UI", "1.2.3.6"));
        bytes.extend(text([0x20, 0xe], "UI", "1.2.3.5"));
        bytes.extend(text([0x20, 0x32], "DS", &format!("0\\0\\{}", self.number)));
        bytes.extend(text([0x20, 0x37], "DS", "1\\0\\0\\0\\1\\0"));
        bytes.extend(number([0x28, 2], 1));
        bytes.extend(text([0x28, 4], "CS", "MONOCHROME2"));
        if let Some(frames) = self.frames {
            bytes.extend(text([0x28, 8], "IS", &frames.to_string()));
        }
        bytes.extend(number([0x28, 0x10], self.rows));
        bytes.extend(number([0x28, 0x11], self.rows));
        bytes.extend(text([0x28, 0x30], "DS", "1\\1"));
        for (tag, value) in [(0x100, self.bits), (0x101, self.bits), (0x102, self.bits - 1), (0x103, 0)] {
            bytes.extend(number([0x28, tag], value));
        }
        bytes.extend(text([0x28, 0x1052], "DS", "-1024"));
        bytes.extend(text([0x28, 0x1053], "DS", "1"));
        bytes.extend_from_slice(&self.late);
        bytes
    }

    /// A file with one frame in one fragment.
    pub(crate) fn encapsulated(&self, syntax: &str, frame: &[u8]) -> Vec<u8> {
        [meta(syntax), self.header(), fragment(frame)].concat()
    }

    /// A file with pixels as they are.
    pub(crate) fn native(&self, pixels: &[u8]) -> Vec<u8> {
        [meta(EXPLICIT), self.header(), element([0x7fe0, 0x10], "OW", pixels)].concat()
    }
}

fn item(tag: u16, length: u32) -> Vec<u8> {
    let mut bytes = [0xfffe_u16.to_le_bytes(), tag.to_le_bytes()].concat();
    bytes.extend(length.to_le_bytes());
    bytes
}

/// Pixel Data of one fragment, with an empty offset table.
fn fragment(frame: &[u8]) -> Vec<u8> {
    let mut frame = frame.to_vec();
    frame.resize(frame.len().next_multiple_of(2), 0);
    let mut bytes = vec![0xe0, 0x7f, 0x10, 0, b'O', b'B', 0, 0, 0xff, 0xff, 0xff, 0xff];
    bytes.extend(item(0xe000, 0));
    bytes.extend(item(0xe000, u32::try_from(frame.len()).unwrap()));
    bytes.extend(frame);
    bytes.extend(item(0xe0dd, 0));
    bytes
}

/// Zeros, raw deflated.
pub(crate) fn deflated_zeros(bytes: u64) -> Vec<u8> {
    deflated(std::io::repeat(0).take(bytes))
}

fn deflated(source: impl Read) -> Vec<u8> {
    let mut packed = Vec::new();
    flate2::read::DeflateEncoder::new(source, flate2::Compression::fast()).read_to_end(&mut packed).unwrap();
    packed
}

/// A frame of RLE: a header with this number of segments, and the segments.
pub(crate) fn rle_frame(segments: u32, offsets: [u32; 2], packed: &[u8]) -> Vec<u8> {
    let mut frame = segments.to_le_bytes().to_vec();
    frame.extend(offsets.iter().flat_map(|offset| offset.to_le_bytes()));
    frame.resize(64, 0);
    frame.extend_from_slice(packed);
    frame
}

/// A deflated data set: an element or item again and again, `bytes` in all, behind what says that
/// it is CT.
pub(crate) fn repeated(unit: &[u8], is_sequence: bool, bytes: usize) -> Vec<u8> {
    let mut head = element([8, 0x16], "UI", CT.as_bytes());
    head.extend(element([8, 0x60], "CS", b"CT"));
    if is_sequence {
        // Per-frame functional groups of undefined length.
        head.extend([0x00, 0x52, 0x30, 0x92, b'S', b'Q', 0, 0, 0xff, 0xff, 0xff, 0xff]);
    }
    let units = unit.repeat(bytes / unit.len());
    [meta(DEFLATED), deflated(Cursor::new([head, units].concat()))].concat()
}

/// Rows (0028,0010) without a value.
pub(crate) fn empty_rows() -> Vec<u8> {
    element([0x28, 0x10], "US", &[])
}

/// An empty item.
pub(crate) fn empty_item() -> Vec<u8> {
    item(0xe000, 0)
}

/// A zip of files, deflated.
pub(crate) fn zip_of(files: impl IntoIterator<Item = (String, Vec<u8>)>) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default().compression_level(Some(1));
    for (name, bytes) in files {
        zip.start_file(name, options).unwrap();
        zip.write_all(&bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

/// A zip whose directory names the same entry `count` times.
pub(crate) fn overlapping_zip(content: &[u8], count: u16) -> Vec<u8> {
    let one = zip_of([("a.dcm".to_owned(), content.to_vec())]);
    let end = one.windows(4).rposition(|four| four == b"PK\x05\x06").unwrap();
    let directory = u32::from_le_bytes(*one[end + 16..].first_chunk::<4>().unwrap()) as usize;
    let (entries, entry) = (&one[..directory], &one[directory..end]);
    let mut zip = entries.to_vec();
    for number in 0..count {
        // The same local header under another name of the same length.
        let mut entry = entry.to_vec();
        entry[46..51].copy_from_slice(format!("{number:05}").as_bytes());
        zip.extend(entry);
    }
    let length = u32::try_from(zip.len() - directory).unwrap();
    zip.extend_from_slice(b"PK\x05\x06\0\0\0\0");
    zip.extend([count.to_le_bytes(), count.to_le_bytes()].concat());
    zip.extend(length.to_le_bytes());
    zip.extend(u32::try_from(directory).unwrap().to_le_bytes());
    zip.extend([0, 0]);
    zip
}

/// A NIfTI label map of bytes, gzipped: what its header claims, and `present` zeros.
pub(crate) fn nifti_labels(dims: [i16; 3], present: u64) -> Vec<u8> {
    let mut header = vec![0; 352];
    header[..4].copy_from_slice(&348i32.to_le_bytes());
    for (at, value) in [3, dims[0], dims[1], dims[2], 1, 1, 1, 1].into_iter().enumerate() {
        header[40 + 2 * at..42 + 2 * at].copy_from_slice(&value.to_le_bytes());
    }
    header[70..72].copy_from_slice(&2i16.to_le_bytes()); // unsigned bytes
    header[72..74].copy_from_slice(&8i16.to_le_bytes());
    for at in 0..4 {
        header[76 + 4 * at..80 + 4 * at].copy_from_slice(&1f32.to_le_bytes());
    }
    header[108..112].copy_from_slice(&352f32.to_le_bytes());
    header[254..256].copy_from_slice(&1i16.to_le_bytes()); // sform
    for (row, at) in [280, 296, 312].into_iter().enumerate() {
        header[at + 4 * row..at + 4 * row + 4].copy_from_slice(&1f32.to_le_bytes());
    }
    header[344..348].copy_from_slice(b"n+1\0");
    let source = Cursor::new(header).chain(std::io::repeat(0).take(present));
    let mut packed = Vec::new();
    flate2::read::GzEncoder::new(source, flate2::Compression::fast()).read_to_end(&mut packed).unwrap();
    packed
}

/// A JP2 file: a box of another kind that begins like a codestream of `decoy` pixels, and behind it
/// the codestream, which claims `large` pixels along each side.
pub(crate) fn jp2_with_decoy(decoy: u32, large: u32) -> Vec<u8> {
    let codestream = |side: u32| {
        let mut siz = vec![0, 41, 0, 0];
        for value in [side, side, 0, 0, side, side, 0, 0] {
            siz.extend(value.to_be_bytes());
        }
        siz.extend([0, 1, 15, 1, 1]);
        [&[0xff, 0x4f, 0xff, 0x51][..], &siz, &[0xff, 0xd9]].concat()
    };
    let boxed = |kind: &[u8; 4], content: &[u8]| {
        [&u32::try_from(content.len() + 8).unwrap().to_be_bytes()[..], kind, content].concat()
    };
    [
        boxed(b"jP  ", &[0x0d, 0x0a, 0x87, 0x0a]),
        boxed(b"ftyp", b"jp2 \0\0\0\0jp2 "),
        boxed(b"uuid", &codestream(decoy)),
        boxed(b"jp2c", &codestream(large)),
    ]
    .concat()
}
