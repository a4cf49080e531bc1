//! A Wiimote's reports: bytes to values and back.
//!
//! Input reports come from the remote ([`InputReport`]), output reports go to it
//! ([`output::Output`]). A report begins with its id, as Linux' hidraw gives it; the Bluetooth
//! header (`a1`, `a2`, `52`) is no part of it. Decoding takes any bytes and never panics;
//! `decode(encode(report))` is the report again.
//!
//! Raw numbers stay raw: infrared positions are in units of 1/8 sensor pixel, x right and **y up**,
//! 1024 x 768; acceleration is in 10-bit counts, x to the left, y to the plug, z up.
//! [`calibration`] has what makes them physical.

mod blobs;
mod buttons;
pub(crate) mod calibration;
mod data;
mod interleaved;
pub(crate) mod motion_plus;
pub(crate) mod output;
pub(crate) mod recording;

pub use blobs::{Blob, BlobExtent, IrFormat};
pub(crate) use blobs::{SENSOR_HEIGHT, SENSOR_WIDTH};
pub use buttons::Buttons;
pub(crate) use data::Acceleration;
pub use data::{DataReport, Extension, Layout};
pub(crate) use interleaved::Interleaver;
pub use interleaved::{Half, InterleavedHalf};

/// The longest input report, its id included.
pub const MAX_REPORT_BYTES: usize = 22;

/// An input report.
#[derive(Clone, Debug, PartialEq)]
pub enum InputReport {
    /// 0x20: battery, LEDs, extension. An unrequested one means that the remote stopped reporting.
    Status(Status),
    /// 0x21: the requested memory.
    Memory(Memory),
    /// 0x22: the answer to an output report.
    Acknowledge(Acknowledge),
    /// 0x30 to 0x37 and 0x3d: what buttons, accelerometer, camera and extension say.
    Data(DataReport),
    /// 0x3e and 0x3f: half of a full data report.
    Interleaved(InterleavedHalf),
}

/// 0x20.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status {
    /// Buttons held.
    pub buttons: Buttons,
    /// The battery is nearly empty.
    pub battery_low: bool,
    /// An extension is plugged in.
    pub extension: bool,
    /// The speaker is on.
    pub speaker: bool,
    /// The infrared camera is on.
    pub camera: bool,
    /// The four player LEDs, bit 0 the leftmost.
    pub leds: u8,
    /// Battery level, 0 to 255.
    pub battery: u8,
}

/// 0x21.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Memory {
    /// Buttons held.
    pub buttons: Buttons,
    /// 0, or why there is no data: 7 write-only, 8 no such address.
    pub error: u8,
    /// The lower 16 bits of the address of the first byte.
    pub address: u16,
    /// The number of bytes of `data` that were read, 1 to 16.
    pub length: u8,
    /// The bytes; those after `length` mean nothing.
    pub data: [u8; 16],
}

impl Memory {
    /// The bytes that were read.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.data[..usize::from(self.length).min(self.data.len())]
    }
}

/// 0x22.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Acknowledge {
    /// Buttons held.
    pub buttons: Buttons,
    /// The id of the output report that this answers.
    pub of: u8,
    /// 0 when it was done.
    pub error: u8,
}

/// Bytes that are no report.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReportError {
    /// Nothing at all.
    #[error("an empty report; a report begins with its id")]
    Empty,
    /// An id that no Wiimote sends.
    #[error("unknown report id 0x{0:02x}, expected 0x20 to 0x22, 0x30 to 0x37 or 0x3d to 0x3f")]
    UnknownId(u8),
    /// Fewer or more bytes than a report of this id has.
    #[error("report 0x{id:02x} has {found} bytes with its id, expected {expected} (22 at most, if padded)")]
    Length {
        /// The report's id.
        id: u8,
        /// Bytes found.
        found: usize,
        /// Bytes that such a report has.
        expected: usize,
    },
}

impl InputReport {
    /// Decodes a report that begins with its id. Bytes after its end are ignored up to 22: some
    /// stacks pad.
    ///
    /// # Errors
    /// When the id is unknown or the length cannot be that of such a report.
    pub fn decode(bytes: &[u8]) -> Result<Self, ReportError> {
        let (&id, payload) = bytes.split_first().ok_or(ReportError::Empty)?;
        let expected = input_length(id).ok_or(ReportError::UnknownId(id))?;
        if bytes.len() < expected || bytes.len() > MAX_REPORT_BYTES {
            return Err(ReportError::Length { id, found: bytes.len(), expected });
        }
        let buttons = Buttons::from_bytes([payload[0], payload.get(1).copied().unwrap_or(0)]);
        Ok(match id {
            0x20 => Self::Status(decode_status(buttons, payload)),
            0x21 => Self::Memory(decode_memory(buttons, payload)),
            0x22 => Self::Acknowledge(Acknowledge { buttons, of: payload[2], error: payload[3] }),
            0x3e | 0x3f => Self::Interleaved(InterleavedHalf::decode(id, payload)),
            _ => match Layout::of_id(id) {
                Some(layout) => Self::Data(DataReport::decode(layout, payload)),
                None => return Err(ReportError::UnknownId(id)),
            },
        })
    }

    /// The bytes of this report, its id first: the inverse of [`InputReport::decode`].
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes = vec![self.id()];
        match self {
            Self::Status(status) => encode_status(status, &mut bytes),
            Self::Memory(memory) => {
                bytes.extend(memory.buttons.to_bytes());
                bytes.push(((memory.length.clamp(1, 16) - 1) << 4) | (memory.error & 0x0f));
                bytes.extend(memory.address.to_be_bytes());
                bytes.extend(memory.data);
            }
            Self::Acknowledge(ack) => {
                bytes.extend(ack.buttons.to_bytes());
                bytes.extend([ack.of, ack.error]);
            }
            Self::Data(data) => data.encode(&mut bytes),
            Self::Interleaved(half) => half.encode(&mut bytes),
        }
        bytes
    }

    /// The report's id.
    #[must_use]
    pub fn id(&self) -> u8 {
        match self {
            Self::Status(_) => 0x20,
            Self::Memory(_) => 0x21,
            Self::Acknowledge(_) => 0x22,
            Self::Data(data) => data.layout.id(),
            Self::Interleaved(half) => half.half.id(),
        }
    }

    /// Buttons held, where the report carries them: 0x3d does not.
    #[must_use]
    pub fn buttons(&self) -> Option<Buttons> {
        match self {
            Self::Status(status) => Some(status.buttons),
            Self::Memory(memory) => Some(memory.buttons),
            Self::Acknowledge(ack) => Some(ack.buttons),
            Self::Data(data) => data.buttons,
            Self::Interleaved(half) => Some(half.buttons),
        }
    }
}

/// Bytes of an input report with its id, or `None` for an id that no Wiimote sends.
fn input_length(id: u8) -> Option<usize> {
    match id {
        0x20 => Some(7),
        0x22 => Some(5),
        0x21 | 0x3e | 0x3f => Some(22),
        _ => Layout::of_id(id).map(|layout| 1 + layout.payload_bytes()),
    }
}

fn decode_status(buttons: Buttons, payload: &[u8]) -> Status {
    let flags = payload[2];
    Status {
        buttons,
        battery_low: flags & 0x01 != 0,
        extension: flags & 0x02 != 0,
        speaker: flags & 0x04 != 0,
        camera: flags & 0x08 != 0,
        leds: flags >> 4,
        battery: payload[5],
    }
}

fn encode_status(status: &Status, bytes: &mut Vec<u8>) {
    let flags = u8::from(status.battery_low)
        | u8::from(status.extension) << 1
        | u8::from(status.speaker) << 2
        | u8::from(status.camera) << 3
        | status.leds << 4;
    bytes.extend(status.buttons.to_bytes());
    bytes.extend([flags, 0, 0, status.battery]);
}

fn decode_memory(buttons: Buttons, payload: &[u8]) -> Memory {
    let mut data = [0; 16];
    data.copy_from_slice(&payload[5..21]);
    Memory {
        buttons,
        error: payload[2] & 0x0f,
        address: u16::from_be_bytes([payload[3], payload[4]]),
        length: (payload[2] >> 4) + 1,
        data,
    }
}

#[cfg(test)]
mod tests;
