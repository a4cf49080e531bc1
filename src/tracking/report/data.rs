//! Data reports 0x30 to 0x37 and 0x3d: which parts each has, and their bytes.

use super::blobs::{self, Blob, IrFormat};
use super::buttons::Buttons;

/// Raw counts of the accelerometer, 0 to 1023 each: x to the left, y to the plug, z up.
pub(crate) type Acceleration = [u16; 3];

/// The parts of a data report. The number is its id.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Layout {
    /// Buttons.
    Buttons = 0x30,
    /// Buttons and acceleration.
    Acceleration = 0x31,
    /// Buttons and 8 extension bytes.
    Extension8 = 0x32,
    /// Buttons, acceleration, blobs with sizes.
    AccelerationIr = 0x33,
    /// Buttons and 19 extension bytes.
    Extension19 = 0x34,
    /// Buttons, acceleration, 16 extension bytes.
    AccelerationExtension16 = 0x35,
    /// Buttons, blobs, 9 extension bytes.
    IrExtension9 = 0x36,
    /// Buttons, acceleration, blobs, 6 extension bytes.
    AccelerationIrExtension6 = 0x37,
    /// 21 extension bytes.
    Extension21 = 0x3d,
}

impl Layout {
    /// All of them.
    pub const ALL: [Self; 9] = [
        Self::Buttons,
        Self::Acceleration,
        Self::Extension8,
        Self::AccelerationIr,
        Self::Extension19,
        Self::AccelerationExtension16,
        Self::IrExtension9,
        Self::AccelerationIrExtension6,
        Self::Extension21,
    ];

    /// The layout of the report with this id.
    #[must_use]
    pub fn of_id(id: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|layout| layout.id() == id)
    }

    /// The report's id.
    #[must_use]
    pub const fn id(self) -> u8 {
        self as u8
    }

    /// Whether it has buttons.
    #[must_use]
    pub const fn has_buttons(self) -> bool {
        !matches!(self, Self::Extension21)
    }

    /// Whether it has acceleration.
    #[must_use]
    pub const fn has_acceleration(self) -> bool {
        matches!(
            self,
            Self::Acceleration
                | Self::AccelerationIr
                | Self::AccelerationExtension16
                | Self::AccelerationIrExtension6
        )
    }

    /// The format of its blobs, if it has any.
    #[must_use]
    pub const fn ir(self) -> Option<IrFormat> {
        match self {
            Self::AccelerationIr => Some(IrFormat::Extended),
            Self::IrExtension9 | Self::AccelerationIrExtension6 => Some(IrFormat::Basic),
            _ => None,
        }
    }

    /// The number of its bytes of an extension.
    #[must_use]
    pub const fn extension_bytes(self) -> usize {
        match self {
            Self::Extension8 => 8,
            Self::Extension19 => 19,
            Self::AccelerationExtension16 => 16,
            Self::IrExtension9 => 9,
            Self::AccelerationIrExtension6 => 6,
            Self::Extension21 => 21,
            _ => 0,
        }
    }

    /// Bytes after the id.
    #[must_use]
    pub const fn payload_bytes(self) -> usize {
        let buttons = if self.has_buttons() { 2 } else { 0 };
        let acceleration = if self.has_acceleration() { 3 } else { 0 };
        let ir = match self.ir() {
            Some(format) => format.bytes(),
            None => 0,
        };
        buttons + acceleration + ir + self.extension_bytes()
    }
}

/// Bytes of whatever is plugged in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extension {
    bytes: [u8; 21],
    length: usize,
}

impl Extension {
    /// The first 21 of these bytes.
    #[must_use]
    pub fn new(source: &[u8]) -> Self {
        let length = source.len().min(21);
        let mut bytes = [0; 21];
        bytes[..length].copy_from_slice(&source[..length]);
        Self { bytes, length }
    }

    /// The bytes.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }
}

/// The content of a data report. Parts that its layout does not have are `None`.
#[derive(Clone, Debug, PartialEq)]
pub struct DataReport {
    /// The parts that there are.
    pub layout: Layout,
    /// Buttons held.
    pub buttons: Option<Buttons>,
    /// Acceleration in raw counts; the lowest bit of y and z is not transmitted.
    pub acceleration: Option<Acceleration>,
    /// The camera's four slots.
    pub blobs: Option<[Option<Blob>; 4]>,
    /// Extension bytes.
    pub extension: Option<Extension>,
}

impl DataReport {
    /// `payload` has at least the layout's bytes.
    pub(super) fn decode(layout: Layout, payload: &[u8]) -> Self {
        let mut rest = payload;
        let mut take = |count: usize| {
            let (taken, left) = rest.split_at(count.min(rest.len()));
            rest = left;
            taken
        };
        let held = layout.has_buttons().then(|| take(2)).and_then(|b| <[u8; 2]>::try_from(b).ok());
        let acceleration =
            layout.has_acceleration().then(|| take(3)).and_then(|b| <[u8; 3]>::try_from(b).ok());
        let ir = layout.ir().map(|format| (format, take(format.bytes())));
        let extension = take(layout.extension_bytes());
        Self {
            layout,
            buttons: held.map(Buttons::from_bytes),
            acceleration: acceleration.map(|a| decode_acceleration(held.unwrap_or_default(), a)),
            blobs: ir.map(|(format, bytes)| decode_blobs(format, bytes)),
            extension: (!extension.is_empty()).then(|| Extension::new(extension)),
        }
    }

    pub(super) fn encode(&self, bytes: &mut Vec<u8>) {
        let layout = self.layout;
        let mut held = self.buttons.unwrap_or_default().to_bytes();
        let acceleration = self.acceleration.unwrap_or_default();
        if layout.has_acceleration() {
            let [x, y, z] = acceleration;
            held[0] |= ((x & 3) << 5) as u8;
            held[1] |= ((y & 2) << 4) as u8 | ((z & 2) << 5) as u8;
        }
        if layout.has_buttons() {
            bytes.extend(held);
        }
        if layout.has_acceleration() {
            bytes.extend(acceleration.map(|count| (count >> 2) as u8));
        }
        let blobs = self.blobs.unwrap_or_default();
        match layout.ir() {
            Some(IrFormat::Basic) => {
                bytes.extend(blobs::encode_basic_pair([blobs[0], blobs[1]]));
                bytes.extend(blobs::encode_basic_pair([blobs[2], blobs[3]]));
            }
            Some(IrFormat::Extended) => bytes.extend(blobs.into_iter().flat_map(blobs::encode_extended)),
            Some(IrFormat::Full) | None => {}
        }
        let end = bytes.len() + layout.extension_bytes();
        bytes.extend(self.extension.as_ref().map_or(&[][..], Extension::bytes));
        bytes.resize(end, 0);
    }
}

fn decode_acceleration(held: [u8; 2], bytes: [u8; 3]) -> Acceleration {
    let [b0, b1] = held.map(u16::from);
    let [x, y, z] = bytes.map(u16::from);
    [x << 2 | b0 >> 5 & 3, y << 2 | b1 >> 4 & 2, z << 2 | b1 >> 5 & 2]
}

fn decode_blobs(format: IrFormat, bytes: &[u8]) -> [Option<Blob>; 4] {
    let mut blobs = [None; 4];
    match format {
        IrFormat::Basic => {
            for (pair, bytes) in blobs.chunks_mut(2).zip(bytes.as_chunks::<5>().0) {
                pair.copy_from_slice(&blobs::decode_basic_pair(*bytes));
            }
        }
        IrFormat::Extended => {
            for (blob, bytes) in blobs.iter_mut().zip(bytes.as_chunks::<3>().0) {
                *blob = blobs::decode_extended(*bytes);
            }
        }
        IrFormat::Full => {}
    }
    blobs
}
