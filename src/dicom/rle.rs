//! Frames of RLE Lossless (PS3.5 Annex G): byte planes, most significant first, each in PackBits.
//!
//! Memory is that of the decoded frame, whatever the header says: a plane ends when it is full.

/// Bytes of the header: the number of segments, and the offsets of up to fifteen.
const HEADER_BYTES: usize = 64;

/// Why a frame cannot be decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum RleError {
    /// The frame ends inside its header.
    #[error("found {found} bytes, expected a header of {HEADER_BYTES}")]
    Header {
        /// Bytes of the frame.
        found: usize,
    },
    /// A header of another kind of image.
    #[error("found {found} segments, expected {expected}")]
    Segments {
        /// Segments as the header counts them.
        found: u32,
        /// One for each byte of a sample.
        expected: usize,
    },
    /// Segments that overlap, or lie outside of the frame.
    #[error("segment {segment} begins at byte {offset}, outside of its place in the frame")]
    Offset {
        /// The segment, from 1.
        segment: usize,
        /// Its offset in the header.
        offset: u32,
    },
    /// A segment that ends before its plane is full.
    #[error("segment {segment} holds {found} bytes, expected {expected}")]
    Short {
        /// The segment, from 1.
        segment: usize,
        /// Bytes unpacked.
        found: usize,
        /// Pixels of the frame.
        expected: usize,
    },
}

/// Decodes a frame of `pixels` samples of `sample_bytes` bytes, 1 or 2, to little-endian samples.
///
/// # Errors
/// When the header does not fit the image, or a segment is cut short.
pub(super) fn decode(data: &[u8], pixels: usize, sample_bytes: usize) -> Result<Vec<u8>, RleError> {
    let short = || RleError::Header { found: data.len() };
    let (header, _) = data.split_first_chunk::<HEADER_BYTES>().ok_or_else(short)?;
    let word = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
    let found = word(0);
    if found as usize != sample_bytes {
        return Err(RleError::Segments { found, expected: sample_bytes });
    }
    let offset = |segment: usize| word(4 * (segment + 1));
    let mut samples = vec![0; pixels * sample_bytes];
    for segment in 0..sample_bytes {
        let start = offset(segment) as usize;
        let end = if segment + 1 < sample_bytes { offset(segment + 1) as usize } else { data.len() };
        let outside = || RleError::Offset { segment: segment + 1, offset: offset(segment) };
        let packed = data.get(start..end).filter(|_| start >= HEADER_BYTES).ok_or_else(outside)?;
        // The most significant plane comes first; samples are little-endian.
        let plane = samples.iter_mut().skip(sample_bytes - 1 - segment).step_by(sample_bytes);
        let found = unpack(packed, plane);
        if found < pixels {
            return Err(RleError::Short { segment: segment + 1, found, expected: pixels });
        }
    }
    Ok(samples)
}

/// Unpacks PackBits into a plane until the plane is full; returns the number of bytes.
fn unpack<'a>(mut packed: &[u8], plane: impl Iterator<Item = &'a mut u8>) -> usize {
    let (mut count, mut plane) = (0, plane.fuse());
    while let Some((&code, rest)) = packed.split_first() {
        packed = rest;
        let (run, is_literal) = match code.cast_signed() {
            i8::MIN => continue, // no operation
            length @ 0.. => (usize::from(length.unsigned_abs()) + 1, true),
            repeat => (usize::from(repeat.unsigned_abs()) + 1, false),
        };
        for at in 0..run {
            let Some(&byte) = packed.get(if is_literal { at } else { 0 }) else { return count };
            let Some(place) = plane.next() else { return count };
            *place = byte;
            count += 1;
        }
        packed = packed.get(if is_literal { run } else { 1 }..).unwrap_or_default();
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(segments: u32, offsets: [u32; 2], packed: &[u8]) -> Vec<u8> {
        let mut frame = segments.to_le_bytes().to_vec();
        frame.extend(offsets.iter().flat_map(|offset| offset.to_le_bytes()));
        frame.resize(HEADER_BYTES, 0);
        frame.extend_from_slice(packed);
        frame
    }

    #[test]
    fn literal_and_repeated_runs_fill_both_planes() {
        // High bytes: 1 four times. Low bytes: 2, 3, no operation, then 9 twice.
        let frame = frame(2, [64, 66], &[0xFD, 1, 1, 2, 3, 0x80, 0xFF, 9]);
        let samples = decode(&frame, 4, 2).unwrap();
        assert_eq!(samples, [2, 1, 3, 1, 9, 1, 9, 1]);
    }

    #[test]
    fn headers_that_do_not_fit_are_refused_before_anything_is_allocated() {
        for segments in [0, 1, 3, 15, 16, u32::MAX - 1, u32::MAX] {
            let refused = decode(&frame(segments, [64, 64], &[0; 64]), 16, 2);
            assert_eq!(refused, Err(RleError::Segments { found: segments, expected: 2 }));
        }
        assert_eq!(decode(&[2, 0], 16, 2), Err(RleError::Header { found: 2 }));
        for (offsets, segment) in [([128, 64], 1), ([0, 64], 1), ([64, u32::MAX], 1), ([64, 70], 1)] {
            let refused = decode(&frame(2, offsets, &[0xFD, 1]), 4, 2).unwrap_err();
            assert!(
                matches!(refused, RleError::Offset { segment: found, .. } if found == segment),
                "{offsets:?}"
            );
        }
    }

    #[test]
    fn a_plane_ends_when_it_is_full_and_a_short_one_is_refused() {
        let long = [0x81u8, 7].repeat(1 << 16);
        assert_eq!(decode(&frame(1, [64, 0], &long), 5, 1).unwrap(), [7; 5]);
        let short = decode(&frame(1, [64, 0], &[0xFE, 7, 3, 1]), 5, 1);
        assert_eq!(short, Err(RleError::Short { segment: 1, found: 4, expected: 5 }));
    }
}
