//! Calibration data in a remote's EEPROM: accelerometer and infrared camera.
//!
//! Both blocks are stored twice and end in a checksum, the sum of their bytes plus 0x55.
//! [`Calibrations::decode`] takes the first 42 bytes of the EEPROM and of each pair the copy that
//! is whole.

use super::blobs::{self, Blob};
use super::data::Acceleration;

/// Bytes at the beginning of the EEPROM that hold the calibrations.
pub(crate) const EEPROM_BYTES: usize = 42;

const CHECKSUM_START: u8 = 0x55;

/// Counts of the accelerometer at rest and under one g.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AccelerometerCalibration {
    /// Counts at 0 g.
    pub zero: Acceleration,
    /// Counts at 1 g.
    pub one_g: Acceleration,
}

impl AccelerometerCalibration {
    /// A typical remote, for when none was read: 0 g at 512, 1 g at 616.
    pub const TYPICAL: Self = Self { zero: [512; 3], one_g: [616; 3] };

    /// Acceleration in g: at rest it points up, with length 1. x to the left, y to the plug, z up.
    #[must_use]
    pub fn acceleration_g(&self, counts: Acceleration) -> [f64; 3] {
        std::array::from_fn(|axis| {
            let zero = f64::from(self.zero[axis]);
            (f64::from(counts[axis]) - zero) / (f64::from(self.one_g[axis]) - zero)
        })
    }

    /// The inverse: counts of an acceleration in g, rounded and clamped to the range of a remote.
    #[must_use]
    pub fn counts(&self, acceleration_g: [f64; 3]) -> Acceleration {
        std::array::from_fn(|axis| {
            let zero = f64::from(self.zero[axis]);
            let count = zero + acceleration_g[axis] * (f64::from(self.one_g[axis]) - zero);
            count.round().clamp(0.0, 1023.0) as u16
        })
    }
}

/// The factory's pictures of four points: a rectangle, seen through this remote's own camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IrCalibration {
    /// The four corners, in raw camera units, y up.
    pub corners: [Blob; 4],
}

impl IrCalibration {
    /// Mean of the corners, raw units.
    #[must_use]
    pub fn centre(&self) -> [f64; 2] {
        let mean = |of: fn(&Blob) -> u16| self.corners.iter().map(|c| f64::from(of(c))).sum::<f64>() / 4.0;
        [mean(|corner| corner.x), mean(|corner| corner.y)]
    }

    /// Width and height, each the mean of two opposite sides, raw units.
    #[must_use]
    pub fn size(&self) -> [f64; 2] {
        let side = |a: usize, b: usize| {
            let [a, b] = [self.corners[a], self.corners[b]];
            (f64::from(a.x) - f64::from(b.x)).hypot(f64::from(a.y) - f64::from(b.y))
        };
        [(side(0, 1) + side(2, 3)) / 2.0, (side(1, 2) + side(3, 0)) / 2.0]
    }
}

/// Both calibrations; a block of which no copy is whole is `None`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Calibrations {
    /// Of the infrared camera.
    pub ir: Option<IrCalibration>,
    /// Of the accelerometer.
    pub accelerometer: Option<AccelerometerCalibration>,
}

/// An EEPROM that is too short.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{found} bytes of EEPROM, expected at least the first {EEPROM_BYTES}")]
pub struct EepromError {
    /// Bytes given.
    pub found: usize,
}

impl Calibrations {
    /// Reads both blocks from the beginning of the EEPROM.
    ///
    /// # Errors
    /// When there are fewer than 42 bytes.
    pub fn decode(eeprom: &[u8]) -> Result<Self, EepromError> {
        if eeprom.len() < EEPROM_BYTES {
            return Err(EepromError { found: eeprom.len() });
        }
        let ir = [0x00, 0x0b].into_iter().find_map(|at| decode_ir(eeprom.get(at..at + 11)?.as_array()?));
        let accelerometer = [0x16, 0x20]
            .into_iter()
            .find_map(|at| decode_accelerometer(eeprom.get(at..at + 10)?.as_array()?));
        Ok(Self { ir, accelerometer })
    }
}

/// Four points and their checksum; `None` when the checksum does not match or a point is invalid.
#[must_use]
pub fn decode_ir(block: &[u8; 11]) -> Option<IrCalibration> {
    checked(block)?;
    let [pairs @ .., _] = block;
    let [first, second] = [&pairs[..5], &pairs[5..]].map(|pair| pair.as_array::<5>());
    let [a, b] = blobs::decode_basic_pair(*first?);
    let [c, d] = blobs::decode_basic_pair(*second?);
    Some(IrCalibration { corners: [a?, b?, c?, d?] })
}

/// The inverse of [`decode_ir`].
#[must_use]
pub(crate) fn encode_ir(calibration: &IrCalibration) -> [u8; 11] {
    let [a, b, c, d] = calibration.corners.map(Some);
    let mut block = [0; 11];
    block[..5].copy_from_slice(&blobs::encode_basic_pair([a, b]));
    block[5..10].copy_from_slice(&blobs::encode_basic_pair([c, d]));
    with_checksum(block)
}

/// Zero and one g, volume and motor, checksum; `None` when it does not match or an axis has no
/// gain.
#[must_use]
pub(crate) fn decode_accelerometer(block: &[u8; 10]) -> Option<AccelerometerCalibration> {
    checked(block)?;
    let counts = |at: usize| {
        let low = u16::from(block[at + 3]);
        let high = [0, 1, 2].map(|axis| u16::from(block[at + axis]) << 2);
        [high[0] | low >> 4 & 3, high[1] | low >> 2 & 3, high[2] | low & 3]
    };
    let (zero, one_g) = (counts(0), counts(4));
    let has_gain = zero.iter().zip(&one_g).all(|(zero, one)| zero != one);
    has_gain.then_some(AccelerometerCalibration { zero, one_g })
}

/// The inverse of [`decode_accelerometer`], with volume and motor zero.
#[must_use]
pub(crate) fn encode_accelerometer(calibration: &AccelerometerCalibration) -> [u8; 10] {
    let mut block = [0; 10];
    for (at, counts) in [(0, calibration.zero), (4, calibration.one_g)] {
        let [x, y, z] = counts;
        for (axis, count) in counts.into_iter().enumerate() {
            block[at + axis] = (count >> 2) as u8;
        }
        block[at + 3] = ((x & 3) << 4 | (y & 3) << 2 | z & 3) as u8;
    }
    with_checksum(block)
}

fn checked<const N: usize>(block: &[u8; N]) -> Option<()> {
    (with_checksum(*block) == *block).then_some(())
}

fn with_checksum<const N: usize>(mut block: [u8; N]) -> [u8; N] {
    block[N - 1] = block[..N - 1].iter().fold(CHECKSUM_START, |sum, byte| sum.wrapping_add(*byte));
    block
}
