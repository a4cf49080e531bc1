//! From stored pixel values to HU.
//!
//! Uncompressed frames are read from the file straight into their place of the volume and converted
//! there; compressed ones come from `codec`. Stored values are masked and sign-extended to
//! BitsStored (PS3.5 8.1.1), whatever a codec or a writer left in the other bits. MONOCHROME1 asks
//! for an inverted display and does not concern HU.

use std::fmt;

use super::dataset::Encoding;
use super::error::Defect;
use super::file_bytes::Bytes;

/// The most pixels of a frame: 8192 x 8192, far beyond any CT detector's reconstruction.
const LARGEST_FRAME: u64 = 1 << 26;

/// Size and storage of a file's frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PixelLayout {
    pub(super) frames: u32,
    pub(super) rows: u32,
    pub(super) columns: u32,
    /// 8 or 16.
    pub(super) bits_allocated: u32,
    pub(super) bits_stored: u32,
    high_bit: u32,
    signed: bool,
}

/// HU = stored value * slope + intercept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rescale {
    pub(super) slope: f64,
    pub(super) intercept: f64,
    /// PixelPaddingValue as stored, for places that no slice covers.
    pub(super) padding: Option<i32>,
}

impl Default for Rescale {
    fn default() -> Self {
        Self { slope: 1.0, intercept: 0.0, padding: None }
    }
}

impl Rescale {
    /// HU of a stored value and whether it had to be clipped to 16 bits; fractions round to
    /// nearest.
    pub(super) fn hu(self, stored: i32) -> (i16, bool) {
        let hu = (f64::from(stored) * self.slope + self.intercept).round();
        let clipped = hu.clamp(i16::MIN.into(), i16::MAX.into());
        (clipped as i16, hu != clipped)
    }

    /// Whether it gives whole numbers only.
    pub(super) fn is_whole(self) -> bool {
        self.slope.fract() == 0.0 && self.intercept.fract() == 0.0
    }

    /// The intercept, when adding it is all there is to do.
    fn offset(self) -> Option<i32> {
        let whole = self.slope == 1.0 && self.intercept.fract() == 0.0 && self.intercept.abs() < 1e6;
        whole.then_some(self.intercept as i32)
    }
}

impl PixelLayout {
    /// The layout of `frames` images of rows x columns with bits allocated, stored and the high
    /// bit.
    ///
    /// # Errors
    /// When a frame is larger than any that is read.
    pub(super) fn new(
        frames: u32,
        [rows, columns]: [u32; 2],
        [bits_allocated, bits_stored, high_bit]: [u32; 3],
        signed: bool,
    ) -> Result<Self, Defect> {
        if u64::from(rows) * u64::from(columns) > LARGEST_FRAME {
            return Err(Defect::LargeFrame { rows, columns, limit: LARGEST_FRAME });
        }
        Ok(Self { frames, rows, columns, bits_allocated, bits_stored, high_bit, signed })
    }

    /// Pixels of one frame.
    pub(super) fn frame_pixels(&self) -> usize {
        self.rows as usize * self.columns as usize
    }

    /// Bytes of one uncompressed frame.
    pub(super) fn frame_bytes(&self) -> u64 {
        self.frame_pixels() as u64 * u64::from(self.bits_allocated / 8)
    }

    /// Bytes of all frames, uncompressed.
    pub(super) fn native_bytes(&self) -> u64 {
        u64::from(self.frames) * self.frame_bytes()
    }

    /// The value in the stored bits of a native pixel cell.
    pub(super) fn stored_value(&self, cell: u16) -> i32 {
        let Alignment { above, below } = self.native_alignment();
        if self.signed { signed_value(cell, above, below) } else { unsigned_value(cell, above, below) }
    }

    fn native_alignment(&self) -> Alignment {
        Alignment { above: 15 - self.high_bit, below: 16 - self.bits_stored }
    }

    /// Codecs deliver samples aligned to bit 0.
    fn decoded_alignment(&self) -> Alignment {
        Alignment { above: 16 - self.bits_stored, below: 16 - self.bits_stored }
    }
}

/// Shifts that isolate a value of fewer than 16 bits: first the bits above it are shifted out, then
/// those below.
#[derive(Clone, Copy)]
struct Alignment {
    above: u32,
    below: u32,
}

fn signed_value(cell: u16, above: u32, below: u32) -> i32 {
    i32::from(cell.wrapping_shl(above).cast_signed().wrapping_shr(below))
}

fn unsigned_value(cell: u16, above: u32, below: u32) -> i32 {
    i32::from(cell.wrapping_shl(above).wrapping_shr(below))
}

impl fmt::Display for PixelLayout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { frames, rows, columns, bits_allocated, .. } = self;
        write!(f, "{frames} frame(s) of {columns} x {rows} pixels of {bits_allocated} bits")
    }
}

/// Reads an uncompressed frame that begins at `position` into `hu`; returns how many values were
/// clipped.
///
/// # Errors
/// When the bytes cannot be read.
pub(super) fn read_native(
    bytes: &Bytes,
    position: u64,
    encoding: Encoding,
    layout: &PixelLayout,
    rescale: Rescale,
    hu: &mut [i16],
) -> Result<u64, Defect> {
    if layout.bits_allocated == 8 {
        let mut cells = vec![0u8; hu.len()];
        bytes.read_exact_at(position, &mut cells)?;
        hu.iter_mut().zip(cells).for_each(|(value, cell)| *value = i16::from(cell));
    } else {
        bytes.read_exact_at(position, bytemuck::cast_slice_mut(hu))?;
        if (encoding == Encoding::ExplicitBig) != cfg!(target_endian = "big") {
            hu.iter_mut().for_each(|value| *value = value.swap_bytes());
        }
    }
    Ok(convert(hu, rescale, layout.signed, layout.native_alignment()))
}

/// Converts a decoded frame, 8 or 16 bits per sample in little-endian order, into `hu`; returns how
/// many were clipped.
///
/// # Errors
/// When the decoder delivered another number of samples.
pub(super) fn take_decoded(
    decoded: &[u8],
    layout: &PixelLayout,
    rescale: Rescale,
    hu: &mut [i16],
) -> Result<u64, Defect> {
    if decoded.len() == hu.len() {
        hu.iter_mut().zip(decoded).for_each(|(value, &sample)| *value = i16::from(sample));
    } else if decoded.len() == hu.len() * 2 {
        let samples = decoded.chunks_exact(2).map(|pair| i16::from_le_bytes([pair[0], pair[1]]));
        hu.iter_mut().zip(samples).for_each(|(value, sample)| *value = sample);
    } else {
        return Err(Defect::FewPixels { found: decoded.len() as u64, expected: layout.frame_bytes() });
    }
    Ok(convert(hu, rescale, layout.signed, layout.decoded_alignment()))
}

/// Turns cells into HU in place; returns the number of clipped values.
///
/// Four loops rather than one, so that each is plain arithmetic that the compiler turns into vector
/// instructions: this and the copy out of the file are nearly all of the time that an uncompressed
/// series takes. The arithmetic is wrapping for the same reason: shifts are below 16 and offsets
/// below a million, but the compiler cannot know.
fn convert(hu: &mut [i16], rescale: Rescale, signed: bool, Alignment { above, below }: Alignment) -> u64 {
    match (rescale.offset(), signed) {
        (Some(offset), true) => each(hu, |cell| clip(signed_value(cell, above, below).wrapping_add(offset))),
        (Some(offset), false) => {
            each(hu, |cell| clip(unsigned_value(cell, above, below).wrapping_add(offset)))
        }
        (None, true) => each(hu, |cell| rescale.hu(signed_value(cell, above, below))),
        (None, false) => each(hu, |cell| rescale.hu(unsigned_value(cell, above, below))),
    }
}

#[inline(always)]
fn each(hu: &mut [i16], value: impl Fn(u16) -> (i16, bool)) -> u64 {
    let mut clipped = 0;
    for run in hu.chunks_mut(1 << 12) {
        let mut clipped_in_run = 0u16; // as wide as a voxel, so that both fit the same vector
        for cell in run {
            let (hu, was_clipped) = value(cell.cast_unsigned());
            clipped_in_run = clipped_in_run.wrapping_add(was_clipped.into()); // at most the run's length
            *cell = hu;
        }
        clipped += u64::from(clipped_in_run);
    }
    clipped
}

#[inline(always)]
fn clip(exact: i32) -> (i16, bool) {
    let clamped = exact.clamp(i16::MIN.into(), i16::MAX.into());
    (clamped as i16, clamped != exact)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout(bits: [u32; 3], signed: bool) -> PixelLayout {
        PixelLayout::new(1, [1, 2], bits, signed).unwrap()
    }

    #[test]
    fn stored_values_are_masked_and_sign_extended() {
        for (bits, signed, cell, value) in [
            ([16, 12, 11], false, 0xF123, 0x123), // overlay bits above
            ([16, 12, 11], true, 0x0FFF, -1),
            ([16, 12, 15], true, 0xFFF7, -1), // aligned to the top, bits below unused
            ([16, 16, 15], true, 0x8000, -32768),
            ([16, 16, 15], false, 0x8000, 32768),
            ([8, 8, 7], true, 0x00FF, -1),
            ([8, 8, 7], false, 0x00FF, 255),
        ] {
            assert_eq!(layout(bits, signed).stored_value(cell), value, "{bits:?} {signed} {cell:#06x}");
        }
    }

    #[test]
    fn a_fractional_slope_rounds_to_nearest_and_clips() {
        let rescale = Rescale { slope: 2.000_244_2, intercept: -4047.0, padding: None };
        assert_eq!(rescale.hu(498), (-3051, false)); // -3050.878...
        assert_eq!(rescale.hu(65535), (i16::MAX, true));
    }

    #[test]
    fn native_frames_of_both_byte_orders_become_hu() {
        let rescale = Rescale { slope: 1.0, intercept: -1024.0, padding: None };
        let mut hu = [0; 2];
        for (encoding, bytes) in
            [(Encoding::ImplicitLittle, [0, 4, 0xFF, 0x0F]), (Encoding::ExplicitBig, [4, 0, 0x0F, 0xFF])]
        {
            let source = Bytes::Memory(bytes.to_vec().into());
            let layout = layout([16, 12, 11], false);
            let clipped = read_native(&source, 0, encoding, &layout, rescale, &mut hu).unwrap();
            assert_eq!((hu, clipped), ([0, 3071], 0), "{encoding:?}");
        }
    }

    #[test]
    fn values_beyond_16_bits_are_clipped_and_counted() {
        let rescale = Rescale { slope: 1.0, intercept: -1000.0, padding: None };
        let source = Bytes::Memory(vec![0xFF, 0xFF, 0, 0].into());
        let layout = layout([16, 16, 15], false);
        let mut hu = [0; 2];
        let clipped = read_native(&source, 0, Encoding::ExplicitLittle, &layout, rescale, &mut hu).unwrap();
        assert_eq!((hu, clipped), ([i16::MAX, -1000], 1));
    }
}
