//! Headers of compressed images: size, components, precision.
//!
//! Decoders allocate by the codestream's header, so a few hostile bytes could exhaust memory. The
//! header is read here first and compared with the data set.

use std::fmt;

use super::error::Defect;
use super::pixels::PixelLayout;

/// The parts of a codestream's coding that select its decoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Coding {
    /// JPEG by discrete cosine transform and Huffman codes: baseline, extended, progressive.
    JpegDct,
    /// Any other JPEG: lossless, or without a decoder.
    JpegOther,
    JpegLs,
    Jpeg2000,
}

/// The header of a codestream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) coding: Coding,
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) components: u32,
    /// Bits per sample.
    pub(super) precision: u32,
}

impl fmt::Display for Header {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { width, height, components, precision, .. } = self;
        write!(f, "{width} x {height} pixels of {components} x {precision} bits")
    }
}

impl Header {
    /// Checks the header against the data set.
    ///
    /// # Errors
    /// When size or components differ, or samples are wider than 16 bits.
    pub(super) fn check(&self, layout: &PixelLayout) -> Result<(), Defect> {
        let same_size = (self.width, self.height) == (layout.columns, layout.rows);
        if same_size && self.components == 1 && (1..=16).contains(&self.precision) {
            return Ok(());
        }
        let expected =
            format!("{} x {} pixels of 1 x {} bits", layout.columns, layout.rows, layout.bits_stored);
        Err(Defect::Codestream { found: self.to_string(), expected })
    }
}

/// Reads the header of a JPEG, JPEG-LS or JPEG 2000 codestream; `None` when there is no such
/// header.
pub(super) fn read(data: &[u8]) -> Option<Header> {
    match data {
        [0xFF, 0xD8, ..] => read_jpeg(&data[2..]),
        [0xFF, 0x4F, 0xFF, 0x51, ..] => read_jpeg2000(&data[4..]),
        _ => None,
    }
}

/// The codestream of a JP2 file (ITU-T T.800 Annex I); other data as it is.
///
/// The first box of contiguous codestream counts, as it does for decoders of JP2 files. Boxes of
/// other kinds are skipped by their lengths, so a codestream inside of one is not found.
pub(super) fn unwrapped(data: Vec<u8>) -> Vec<u8> {
    if !data.starts_with(&[0, 0, 0, 12, b'j', b'P']) {
        return data;
    }
    let mut rest = data.as_slice();
    while let Some((kind, content, behind)) = next_box(rest) {
        if kind == *b"jp2c" {
            return content.to_vec();
        }
        rest = behind;
    }
    Vec::new()
}

/// The next box: its type, its content, and the bytes behind it (I.4).
fn next_box(data: &[u8]) -> Option<([u8; 4], &[u8], &[u8])> {
    let (length, rest) = data.split_first_chunk::<4>()?;
    let (kind, rest) = rest.split_first_chunk::<4>()?;
    let (length, header) = match u32::from_be_bytes(*length) {
        0 => (data.len() as u64, 8), // up to the end of the file
        1 => (u64::from_be_bytes(*rest.first_chunk::<8>()?), 16),
        length => (u64::from(length), 8),
    };
    let end = usize::try_from(length).ok().filter(|end| (header..=data.len()).contains(end))?;
    Some((*kind, &data[header..end], &data[end..]))
}

/// Looks for the frame header among the marker segments before the scan (ITU-T T.81 B.2.2, T.87
/// C.2.2).
fn read_jpeg(mut data: &[u8]) -> Option<Header> {
    loop {
        let (marker, segment, rest) = segment(data)?;
        let coding = match marker {
            0xC0..=0xC2 => Some(Coding::JpegDct),
            0xF7 => Some(Coding::JpegLs),
            0xC4 | 0xC8 | 0xCC => None, // tables and reserved
            0xC3..=0xCF => Some(Coding::JpegOther),
            0xDA => return None,
            _ => None,
        };
        if let (Some(coding), &[precision, h1, h0, w1, w0, components, ..]) = (coding, segment) {
            let (width, height) = (u16::from_be_bytes([w1, w0]), u16::from_be_bytes([h1, h0]));
            return Some(Header {
                coding,
                width: width.into(),
                height: height.into(),
                components: components.into(),
                precision: precision.into(),
            });
        }
        data = rest;
    }
}

/// The next marker segment: its marker, its bytes without the length, and the bytes behind it.
pub(super) fn segment(data: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let start = data.iter().position(|&byte| byte != 0xFF)?;
    // At least one fill byte FF before the marker code.
    let (marker, rest) = (start > 0).then(|| (data[start], &data[start + 1..]))?;
    if matches!(marker, 0x01 | 0xD0..=0xD9) {
        return Some((marker, &[], rest));
    }
    let length = usize::from(u16::from_be_bytes(*rest.first_chunk::<2>()?));
    Some((marker, rest.get(2..length)?, rest.get(length..)?))
}

/// The SIZ segment (ITU-T T.800 A.5.1), from its length on.
fn read_jpeg2000(siz: &[u8]) -> Option<Header> {
    let u32_at = |at: usize| Some(u32::from_be_bytes(*siz.get(at..)?.first_chunk::<4>()?));
    let components = u16::from_be_bytes(*siz.get(36..)?.first_chunk::<2>()?);
    let (precision, subsampling) = (*siz.get(38)?, siz.get(39..41)?);
    if subsampling != [1, 1] {
        return None;
    }
    Some(Header {
        coding: Coding::Jpeg2000,
        width: u32_at(4)?.checked_sub(u32_at(12)?)?,
        height: u32_at(8)?.checked_sub(u32_at(16)?)?,
        components: components.into(),
        precision: u32::from(precision & 0x7F) + 1,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_jpeg_frame_header_is_found_behind_other_segments() {
        let data =
            [0xFF, 0xD8, 0xFF, 0xE0, 0, 4, 1, 2, 0xFF, 0xFF, 0xC1, 0, 11, 12, 2, 0, 1, 0, 1, 1, 0x11, 0];
        let header =
            Header { coding: Coding::JpegDct, width: 256, height: 512, components: 1, precision: 12 };
        assert_eq!(read(&data), Some(header));
        for cut in 0..20 {
            assert_eq!(read(&data[..cut]), None, "{cut} bytes");
        }
    }

    #[test]
    fn the_codestream_of_a_jp2_file_is_that_of_its_own_box() {
        let file = |boxes: &[(&[u8; 4], &[u8])]| {
            let mut file = Vec::new();
            for (kind, content) in boxes {
                file.extend((content.len() as u32 + 8).to_be_bytes());
                file.extend_from_slice(*kind);
                file.extend_from_slice(content);
            }
            file
        };
        let (signature, small, large) = ([0x0D, 0x0A, 0x87, 0x0A], [0xFF, 0x4F, 1], [0xFF, 0x4F, 2]);
        let decoy = file(&[(b"jP  ", &signature), (b"uuid", &small), (b"jp2c", &large), (b"jp2c", &small)]);
        assert_eq!(unwrapped(decoy), large);
        assert_eq!(unwrapped(small.to_vec()), small, "a bare codestream stays");
        assert!(unwrapped(file(&[(b"jP  ", &signature), (b"uuid", &small)])).is_empty());
        let mut endless = file(&[(b"jP  ", &signature), (b"uuid", &small)]);
        endless[12..16].copy_from_slice(&[0; 4]); // a box up to the end
        assert!(unwrapped(endless).is_empty());
        for length in [2u32, 7, 9999] {
            let mut wrong = file(&[(b"jP  ", &signature), (b"jp2c", &small)]);
            wrong[12..16].copy_from_slice(&length.to_be_bytes());
            assert!(unwrapped(wrong).is_empty(), "{length}");
        }
    }

    #[test]
    fn a_codestream_of_another_size_is_refused_with_both_sizes() {
        let header =
            Header { coding: Coding::Jpeg2000, width: 60000, height: 60000, components: 1, precision: 8 };
        let layout = PixelLayout::new(1, [512, 512], [16, 12, 11], false).unwrap();
        assert_eq!(
            header.check(&layout).unwrap_err().to_string(),
            "the compressed image is 60000 x 60000 pixels of 1 x 8 bits, but the data set says 512 x 512 pixels of \
             1 x 12 bits"
        );
    }
}
