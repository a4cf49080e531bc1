//! Reports 0x3e and 0x3f: a full description of the blobs, in two halves that belong together.
//!
//! The first half has the x byte of the acceleration, bits 4 to 7 of z and blobs 0 and 1; the
//! second the y byte, bits 0 to 3 of z and blobs 2 and 3. Acceleration has 8 bits here, which
//! [`Interleaver`] scales to the usual 10.

use super::blobs::{self, Blob};
use super::buttons::Buttons;
use super::data::Acceleration;

/// One of the two halves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Half {
    /// 0x3e.
    First,
    /// 0x3f.
    Second,
}

impl Half {
    /// The report's id.
    #[must_use]
    pub const fn id(self) -> u8 {
        match self {
            Self::First => 0x3e,
            Self::Second => 0x3f,
        }
    }
}

/// One half.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InterleavedHalf {
    /// The half.
    pub half: Half,
    /// Buttons held.
    pub buttons: Buttons,
    /// 8-bit acceleration: x in the first half, y in the second.
    pub acceleration: u8,
    /// Four bits of the 8-bit acceleration along z: 4 to 7 in the first half, 0 to 3 in the second.
    pub z_bits: u8,
    /// Blobs 0 and 1, or 2 and 3.
    pub blobs: [Option<Blob>; 2],
}

impl InterleavedHalf {
    /// `payload` has at least 21 bytes.
    pub(super) fn decode(id: u8, payload: &[u8]) -> Self {
        let (b0, b1) = (payload[0], payload[1]);
        let mut found = [None; 2];
        for (blob, bytes) in found.iter_mut().zip(payload[3..].as_chunks::<9>().0) {
            *blob = blobs::decode_full(*bytes);
        }
        Self {
            half: if id == Half::First.id() { Half::First } else { Half::Second },
            buttons: Buttons::from_bytes([b0, b1]),
            acceleration: payload[2],
            z_bits: (b1 >> 5 & 3) << 2 | b0 >> 5 & 3,
            blobs: found,
        }
    }

    pub(super) fn encode(&self, bytes: &mut Vec<u8>) {
        let [b0, b1] = self.buttons.to_bytes();
        bytes.extend([b0 | (self.z_bits & 3) << 5, b1 | (self.z_bits >> 2 & 3) << 5, self.acceleration]);
        bytes.extend(self.blobs.into_iter().flat_map(blobs::encode_full));
    }
}

/// Puts halves together. A second half without its first is dropped: its other blobs were seen at
/// another time.
#[derive(Clone, Debug, Default)]
pub(crate) struct Interleaver {
    first: Option<InterleavedHalf>,
}

impl Interleaver {
    /// Takes the next half; gives acceleration (10-bit counts) and blobs when it completes a pair.
    pub(crate) fn push(&mut self, half: InterleavedHalf) -> Option<(Acceleration, [Option<Blob>; 4])> {
        if half.half == Half::First {
            self.first = Some(half);
            return None;
        }
        let first = self.first.take()?;
        let z = first.z_bits << 4 | half.z_bits;
        let acceleration = [first.acceleration, half.acceleration, z].map(|count| u16::from(count) << 2);
        let ([a, b], [c, d]) = (first.blobs, half.blobs);
        Some((acceleration, [a, b, c, d]))
    }
}
