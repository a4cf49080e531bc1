//! Blobs of the infrared camera: up to four, in three formats.
//!
//! | format | bytes | carries |
//! |---|---|---|
//! | basic | 10 (two blobs in 5) | position |
//! | extended | 12 (3 each) | position, size 0 to 15 |
//! | full | 36 (9 each) | position, size, extent on the 128 x 96 sensor, brightness |
//!
//! All bits of an empty slot are ones. Only y identifies it: it is 1023 then, and no blob has y
//! above 767. A test of the low bytes alone would drop blobs whose x or y happens to end in 0xff.

/// Width of the camera's pictures in its position units, 1/8 sensor pixel.
pub(crate) const SENSOR_WIDTH: u16 = 1024;
/// Height of the camera's pictures in its position units.
pub(crate) const SENSOR_HEIGHT: u16 = 768;

/// How the camera describes blobs; the number is the mode register's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IrFormat {
    /// Positions only, in 10 bytes (reports 0x36 and 0x37).
    Basic = 1,
    /// Positions and sizes, in 12 bytes (report 0x33).
    Extended = 3,
    /// All there is, in 36 bytes over two reports (0x3e and 0x3f).
    Full = 5,
}

impl IrFormat {
    /// Bytes of four blobs.
    #[must_use]
    pub const fn bytes(self) -> usize {
        match self {
            Self::Basic => 10,
            Self::Extended => 12,
            Self::Full => 36,
        }
    }
}

/// A bright spot as the camera reports it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Blob {
    /// To the right, 0 to 1023.
    pub x: u16,
    /// **Up**, 0 to 767.
    pub y: u16,
    /// Size, 0 to 15; not in the basic format.
    pub size: Option<u8>,
    /// Extent and brightness; only in the full format.
    pub extent: Option<BlobExtent>,
}

/// The place of a blob on the sensor of 128 x 96 pixels, y up, and its brightness.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlobExtent {
    /// Leftmost column, 0 to 127.
    pub x_min: u8,
    /// Lowest row, 0 to 127.
    pub y_min: u8,
    /// Rightmost column.
    pub x_max: u8,
    /// Highest row.
    pub y_max: u8,
    /// Brightness, 0 to 255.
    pub intensity: u8,
}

impl Blob {
    /// A blob of the basic format.
    #[must_use]
    pub const fn at(x: u16, y: u16) -> Self {
        Self { x, y, size: None, extent: None }
    }

    /// Whether it touches the border of the picture: then it is cut, and its centre is not the
    /// LED's.
    #[must_use]
    pub const fn is_cut(&self) -> bool {
        self.x == 0 || self.y == 0 || self.x >= SENSOR_WIDTH - 1 || self.y >= SENSOR_HEIGHT - 1
    }

    /// Its centre in pixels, u right and v **down**.
    #[must_use]
    pub fn pixel(&self) -> [f64; 2] {
        [f64::from(self.x), f64::from(SENSOR_HEIGHT - 1) - f64::from(self.y)]
    }
}

fn position(x: u16, y: u16) -> Option<Blob> {
    (y < SENSOR_HEIGHT).then(|| Blob::at(x, y))
}

/// Two blobs of the basic format from 5 bytes.
pub(super) fn decode_basic_pair(b: [u8; 5]) -> [Option<Blob>; 2] {
    let [b0, b1, b2, b3, b4] = b.map(u16::from);
    [
        position(b0 | (b2 & 0x30) << 4, b1 | (b2 & 0xc0) << 2),
        position(b3 | (b2 & 0x03) << 8, b4 | (b2 & 0x0c) << 6),
    ]
}

/// The inverse of [`decode_basic_pair`].
pub(super) fn encode_basic_pair(blobs: [Option<Blob>; 2]) -> [u8; 5] {
    let [(x1, y1), (x2, y2)] = blobs.map(|blob| blob.map_or((0x3ff, 0x3ff), |b| (b.x & 0x3ff, b.y & 0x3ff)));
    let high = (y1 >> 8) << 6 | (x1 >> 8) << 4 | (y2 >> 8) << 2 | x2 >> 8;
    [low(x1), low(y1), low(high), low(x2), low(y2)]
}

/// A blob of the extended format.
pub(super) fn decode_extended(b: [u8; 3]) -> Option<Blob> {
    let [x, y, high] = b.map(u16::from);
    let blob = position(x | (high & 0x30) << 4, y | (high & 0xc0) << 2)?;
    Some(Blob { size: Some(b[2] & 0x0f), ..blob })
}

/// The inverse of [`decode_extended`].
pub(super) fn encode_extended(blob: Option<Blob>) -> [u8; 3] {
    let Some(blob) = blob else { return [0xff; 3] };
    let (x, y) = (blob.x & 0x3ff, blob.y & 0x3ff);
    [low(x), low(y), low((y >> 8) << 6 | (x >> 8) << 4) | blob.size.unwrap_or(0) & 0x0f]
}

/// A blob of the full format.
pub(super) fn decode_full(b: [u8; 9]) -> Option<Blob> {
    let blob = decode_extended([b[0], b[1], b[2]])?;
    let [x_min, y_min, x_max, y_max] = [b[3], b[4], b[5], b[6]].map(|limit| limit & 0x7f);
    Some(Blob { extent: Some(BlobExtent { x_min, y_min, x_max, y_max, intensity: b[8] }), ..blob })
}

/// The inverse of [`decode_full`].
pub(super) fn encode_full(blob: Option<Blob>) -> [u8; 9] {
    let Some(blob) = blob else { return [0xff; 9] };
    let [x, y, high] = encode_extended(Some(blob));
    let extent = blob.extent.unwrap_or(BlobExtent { x_min: 0, y_min: 0, x_max: 0, y_max: 0, intensity: 0 });
    let [a, b, c, d] = [extent.x_min, extent.y_min, extent.x_max, extent.y_max].map(|limit| limit & 0x7f);
    [x, y, high, a, b, c, d, 0, extent.intensity]
}

fn low(value: u16) -> u8 {
    value as u8
}
