//! MotionPlus: three angular rates in six extension bytes, and their calibration.
//!
//! Each axis has a slow and a fast range. Rates are given about the accelerometer's axes (x to the
//! left, y to the plug, z up) by the right-hand rule: pitch about x, roll about y, yaw about z.

/// Six bytes of a MotionPlus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MotionPlus {
    /// 14-bit counts about x (pitch), y (roll), z (yaw).
    pub counts: [u16; 3],
    /// Whether each axis is in the slow range.
    pub slow: [bool; 3],
    /// Something is plugged into the MotionPlus.
    pub extension: bool,
}

impl MotionPlus {
    /// `None` when the bytes are those of an extension that shares the reports, not of the
    /// MotionPlus.
    #[must_use]
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        let &[yaw, roll, pitch, yaw_high, roll_high, pitch_high] = bytes.get(..6)?.as_array::<6>()?;
        let count = |low: u8, high: u8| u16::from(low) | u16::from(high >> 2) << 8;
        (pitch_high & 0x02 != 0).then(|| Self {
            counts: [count(pitch, pitch_high), count(roll, roll_high), count(yaw, yaw_high)],
            slow: [yaw_high & 0x01 != 0, roll_high & 0x02 != 0, yaw_high & 0x02 != 0],
            extension: roll_high & 0x01 != 0,
        })
    }

    /// The six bytes: the inverse of [`MotionPlus::decode`].
    #[must_use]
    pub fn encode(&self) -> [u8; 6] {
        let [pitch, roll, yaw] = self.counts.map(|count| [(count & 0xff) as u8, (count >> 8 & 0x3f) as u8]);
        let [pitch_slow, roll_slow, yaw_slow] = self.slow.map(u8::from);
        [
            yaw[0],
            roll[0],
            pitch[0],
            yaw[1] << 2 | yaw_slow << 1 | pitch_slow,
            roll[1] << 2 | roll_slow << 1 | u8::from(self.extension),
            pitch[1] << 2 | 0x02,
        ]
    }
}

/// One range of a MotionPlus: counts are 16-bit, in the order x (pitch), y (roll), z (yaw).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GyroRange {
    /// Counts at rest.
    pub zero: [u16; 3],
    /// Counts at `degrees` per second.
    pub scale: [u16; 3],
    /// The rate that `scale` belongs to, degrees per second.
    pub degrees: u16,
}

/// Both ranges, as they are stored at 0xa60020.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GyroCalibration {
    /// Fast range.
    pub fast: GyroRange,
    /// Slow range.
    pub slow: GyroRange,
}

/// Counts rise with turns by the right-hand rule; the stored scales of pitch and yaw say the
/// opposite.
const SIGNS: [f64; 3] = [-1.0, 1.0, -1.0];

const CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

impl GyroCalibration {
    /// A typical MotionPlus, for when none was read.
    pub const TYPICAL: Self = {
        let (zero, scale) = ([0x8000; 3], [0x8000 - 0x4400, 0x8000 + 0x4400, 0x8000 - 0x4400]);
        Self { fast: GyroRange { zero, scale, degrees: 1200 }, slow: GyroRange { zero, scale, degrees: 270 } }
    };

    /// Rates about x, y, z in radians per second. An axis whose range has no gain gives 0.
    #[must_use]
    pub fn rates(&self, reading: &MotionPlus) -> [f64; 3] {
        std::array::from_fn(|axis| {
            let range = if reading.slow[axis] { &self.slow } else { &self.fast };
            let zero = f64::from(range.zero[axis]);
            let gain = f64::from(range.scale[axis]) - zero;
            let counts = f64::from(reading.counts[axis]) * 4.0 - zero; // 14 bits, on a scale of 16
            let degrees = counts / gain * f64::from(range.degrees) * SIGNS[axis];
            if gain == 0.0 { 0.0 } else { degrees.to_radians() }
        })
    }

    /// Counts of these rates (radians per second), in the slow range where it reaches: the inverse.
    #[must_use]
    pub fn reading(&self, rates: [f64; 3]) -> MotionPlus {
        let mut reading = MotionPlus { counts: [0; 3], slow: [true; 3], extension: false };
        for axis in 0..3 {
            for (range, slow) in [(&self.slow, true), (&self.fast, false)] {
                let zero = f64::from(range.zero[axis]);
                let gain = f64::from(range.scale[axis]) - zero;
                let counts = zero + rates[axis].to_degrees() * SIGNS[axis] / f64::from(range.degrees) * gain;
                reading.counts[axis] = (counts / 4.0).round().clamp(0.0, 16383.0) as u16;
                reading.slow[axis] = slow;
                if (0.0..=65_532.0).contains(&counts) {
                    break;
                }
            }
        }
        reading
    }

    /// Reads the 32 bytes at 0xa60020; `None` when their CRC-32 does not match.
    #[must_use]
    pub fn decode(bytes: &[u8; 32]) -> Option<Self> {
        (Self::checksum(bytes) == [bytes[14], bytes[15], bytes[30], bytes[31]])
            .then(|| Self { fast: decode_range(&bytes[..13]), slow: decode_range(&bytes[16..29]) })
    }

    /// The 32 bytes, with `uid` in both halves: the inverse of [`GyroCalibration::decode`].
    #[must_use]
    pub fn encode(&self, uid: [u8; 2]) -> [u8; 32] {
        let mut bytes = [0; 32];
        bytes[..13].copy_from_slice(&encode_range(&self.fast));
        bytes[16..29].copy_from_slice(&encode_range(&self.slow));
        (bytes[13], bytes[29]) = (uid[0], uid[1]);
        let [a, b, c, d] = Self::checksum(&bytes);
        (bytes[14], bytes[15], bytes[30], bytes[31]) = (a, b, c, d);
        bytes
    }

    /// CRC-32 of all but the checksum's own four bytes.
    fn checksum(bytes: &[u8; 32]) -> [u8; 4] {
        let mut digest = CRC.digest();
        digest.update(&bytes[..14]);
        digest.update(&bytes[16..30]);
        digest.finalize().to_be_bytes()
    }
}

/// Stored as yaw, roll, pitch, big-endian; the rate in units of 6 degrees per second.
fn decode_range(bytes: &[u8]) -> GyroRange {
    let word = |at: usize| u16::from_be_bytes([bytes[at], bytes[at + 1]]);
    GyroRange {
        zero: [word(4), word(2), word(0)],
        scale: [word(10), word(8), word(6)],
        degrees: u16::from(bytes[12]) * 6,
    }
}

fn encode_range(range: &GyroRange) -> [u8; 13] {
    let mut bytes = [0; 13];
    for (at, counts) in [(0, range.zero), (6, range.scale)] {
        for (place, axis) in [2, 1, 0].into_iter().enumerate() {
            bytes[at + 2 * place..at + 2 * place + 2].copy_from_slice(&counts[axis].to_be_bytes());
        }
    }
    bytes[12] = (range.degrees / 6).min(255) as u8;
    bytes
}
