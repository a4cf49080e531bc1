//! Output reports: from a host to the remote.
//!
//! Every output report carries the state of the rumble motor in bit 0 of its first byte, so each is
//! encoded with it.

use super::data::Layout;

/// The memory that an address belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MemorySpace {
    /// Calibration and user data, kept without power.
    Eeprom,
    /// Registers of camera (0xb00000), speaker (0xa20000) and extensions (0xa40000, 0xa60000).
    Registers,
}

/// The layout of data reports; 0x3e stands for the pair 0x3e, 0x3f.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataMode {
    /// One of the single reports.
    Single(Layout),
    /// 0x3e and 0x3f in turn.
    Interleaved,
}

impl DataMode {
    /// The id that asks for it.
    #[must_use]
    pub const fn id(self) -> u8 {
        match self {
            Self::Single(layout) => layout.id(),
            Self::Interleaved => 0x3e,
        }
    }
}

/// An output report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// 0x10: nothing but the rumble bit.
    Rumble,
    /// 0x11: the four player LEDs, bit 0 the leftmost.
    Leds(u8),
    /// 0x12: how to report data.
    Mode {
        /// Also when nothing changed.
        continuous: bool,
        /// The report.
        mode: DataMode,
    },
    /// 0x13: the camera's pixel clock.
    CameraClock(bool),
    /// 0x14: the speaker.
    Speaker(bool),
    /// 0x15: ask for a status report.
    Status,
    /// 0x16: write memory; answered by an acknowledgement.
    Write {
        /// The memory.
        space: MemorySpace,
        /// 24-bit address.
        address: u32,
        /// The number of bytes of `data`, 1 to 16.
        length: u8,
        /// The bytes.
        data: [u8; 16],
    },
    /// 0x17: read memory; answered by one memory report for each 16 bytes.
    Read {
        /// The memory.
        space: MemorySpace,
        /// 24-bit address.
        address: u32,
        /// The number of bytes.
        length: u16,
    },
    /// 0x19: mute the speaker.
    Mute(bool),
    /// 0x1a: the camera's logic.
    CameraLogic(bool),
}

/// Bytes that are no output report.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OutputError {
    /// An id that no Wiimote takes, or too few bytes for it.
    #[error("{0:02x?} is not an output report: unknown id, or too short")]
    Malformed(Vec<u8>),
    /// A data report id that does not exist.
    #[error("output report 0x12 requests report 0x{0:02x}, which is not a data report")]
    UnknownMode(u8),
    /// A write of no or of too many bytes.
    #[error("output report 0x16 writes {0} bytes, allowed: 1 to 16")]
    WriteLength(u8),
}

impl Output {
    /// A write to a camera or extension register.
    ///
    /// `bytes` beyond the sixteenth are left out: a report takes no more.
    #[must_use]
    pub fn register(address: u32, bytes: &[u8]) -> Self {
        let length = bytes.len().min(16);
        let mut data = [0; 16];
        data[..length].copy_from_slice(&bytes[..length]);
        Self::Write { space: MemorySpace::Registers, address, length: length as u8, data }
    }

    /// The report's id.
    #[must_use]
    pub const fn id(&self) -> u8 {
        match self {
            Self::Rumble => 0x10,
            Self::Leds(_) => 0x11,
            Self::Mode { .. } => 0x12,
            Self::CameraClock(_) => 0x13,
            Self::Speaker(_) => 0x14,
            Self::Status => 0x15,
            Self::Write { .. } => 0x16,
            Self::Read { .. } => 0x17,
            Self::Mute(_) => 0x19,
            Self::CameraLogic(_) => 0x1a,
        }
    }

    /// The bytes, id first. Camera, speaker and mode reports ask for an acknowledgement.
    #[must_use]
    pub fn encode(&self, rumble: bool) -> Vec<u8> {
        let rumble = u8::from(rumble);
        let switch = |on: bool| 0x02 | if on { 0x04 } else { 0 } | rumble;
        let mut bytes = vec![self.id()];
        match *self {
            Self::Rumble | Self::Status => bytes.push(rumble),
            Self::Leds(leds) => bytes.push(leds << 4 | rumble),
            Self::Mode { continuous, mode } => bytes.extend([switch(continuous), mode.id()]),
            Self::CameraClock(on) | Self::CameraLogic(on) | Self::Speaker(on) | Self::Mute(on) => {
                bytes.push(switch(on));
            }
            Self::Write { space, address, length, data } => {
                bytes.extend(memory_head(space, address, rumble));
                bytes.push(length);
                bytes.extend(data);
            }
            Self::Read { space, address, length } => {
                bytes.extend(memory_head(space, address, rumble));
                bytes.extend(length.to_be_bytes());
            }
        }
        bytes
    }

    /// Decodes an output report and its rumble bit, as a virtual remote has to.
    ///
    /// # Errors
    /// When the bytes are no output report.
    pub fn decode(bytes: &[u8]) -> Result<(Self, bool), OutputError> {
        let malformed = || OutputError::Malformed(bytes.iter().take(22).copied().collect());
        let (Some(&id), Some(&first)) = (bytes.first(), bytes.get(1)) else { return Err(malformed()) };
        let on = first & 0x04 != 0;
        let output = match id {
            0x10 => Self::Rumble,
            0x11 => Self::Leds(first >> 4),
            0x12 => {
                let &id = bytes.get(2).ok_or_else(malformed)?;
                let interleaved = matches!(id, 0x3e | 0x3f).then_some(DataMode::Interleaved);
                let single = || Layout::of_id(id).map(DataMode::Single);
                let mode = interleaved.or_else(single).ok_or(OutputError::UnknownMode(id))?;
                Self::Mode { continuous: on, mode }
            }
            0x13 => Self::CameraClock(on),
            0x14 => Self::Speaker(on),
            0x15 => Self::Status,
            0x16 => {
                let (space, address) = memory_of(bytes).ok_or_else(malformed)?;
                let &length = bytes.get(5).ok_or_else(malformed)?;
                if !(1..=16).contains(&length) {
                    return Err(OutputError::WriteLength(length));
                }
                let source = bytes.get(6..6 + usize::from(length)).ok_or_else(malformed)?;
                let mut data = [0; 16];
                data[..source.len()].copy_from_slice(source);
                Self::Write { space, address, length, data }
            }
            0x17 => {
                let (space, address) = memory_of(bytes).ok_or_else(malformed)?;
                let (Some(&high), Some(&low)) = (bytes.get(5), bytes.get(6)) else { return Err(malformed()) };
                Self::Read { space, address, length: u16::from_be_bytes([high, low]) }
            }
            0x19 => Self::Mute(on),
            0x1a => Self::CameraLogic(on),
            _ => return Err(malformed()),
        };
        Ok((output, first & 0x01 != 0))
    }
}

fn memory_head(space: MemorySpace, address: u32, rumble: u8) -> [u8; 4] {
    let [_, high, middle, low] = address.to_be_bytes();
    let space = if space == MemorySpace::Registers { 0x04 } else { 0 };
    [space | rumble, high, middle, low]
}

fn memory_of(bytes: &[u8]) -> Option<(MemorySpace, u32)> {
    let &[space, high, middle, low] = bytes.get(1..5)?.as_array::<4>()?;
    let kind = if space & 0x04 != 0 { MemorySpace::Registers } else { MemorySpace::Eeprom };
    Some((kind, u32::from_be_bytes([0, high, middle, low])))
}
