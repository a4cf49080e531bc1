//! The header of a binary frame: 128 bytes, little-endian.
//!
//! [`FIELDS`] is the layout as a table; `docs/LIVE.md` and `protocol.json` have the same one, and a
//! test holds the three together. Decoding takes any bytes: what no encoder of this version writes
//! is refused by name, before a length in it is used.

use crc::{CRC_32_ISO_HDLC, Crc};

use super::format::{ColorFormat, DepthFormat, LiveLayout};
use relief_base::{DepthLimits, Point, Vector};
use relief_display::{Header as DisplayHeader, HeaderProblem, MAX_FRAME_SIDE_PX};
use relief_volume::{Camera, CameraError, Projection};

/// Bytes of the header.
pub const HEADER_BYTES: usize = 128;
/// The first four bytes of a frame.
pub const MAGIC: [u8; 4] = *b"RLIV";
/// The version of the header.
pub const VERSION: u16 = 1;
/// The only kind of binary message there is.
pub(crate) const KIND_FRAME: u8 = 1;

/// The checksum of PNG, zip and Ethernet: reflected, polynomial 0x04C11DB7.
static CRC_32: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// A field of the header: name, offset, type, count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Its name.
    pub name: &'static str,
    /// Its offset in bytes.
    pub offset: usize,
    /// `u8`, `u16`, `u32`, `u64` or `f32`.
    pub kind: &'static str,
    /// The number of its values.
    pub count: usize,
}

const fn field(name: &'static str, offset: usize, kind: &'static str, count: usize) -> Field {
    Field { name, offset, kind, count }
}

/// Every field, in the order of the bytes and without gaps.
pub const FIELDS: [Field; 28] = [
    field("magic", 0, "u8", 4),
    field("version", 4, "u16", 1),
    field("header_bytes", 6, "u16", 1),
    field("kind", 8, "u8", 1),
    field("flags", 9, "u8", 1),
    field("color_format", 10, "u8", 1),
    field("depth_format", 11, "u8", 1),
    field("sequence", 12, "u32", 1),
    field("shows_seq", 16, "u64", 1),
    field("shows_t_ns", 24, "u64", 1),
    field("total_us", 32, "u32", 1),
    field("render_us", 36, "u32", 1),
    field("wait_us", 40, "u32", 1),
    field("encode_us", 44, "u32", 1),
    field("size_px", 48, "u16", 2),
    field("full_px", 52, "u16", 2),
    field("near_mm", 56, "f32", 1),
    field("far_mm", 60, "f32", 1),
    field("display", 64, "u8", 4),
    field("layout", 68, "u8", 1),
    field("reserved", 69, "u8", 3),
    field("color_bytes", 72, "u32", 1),
    field("depth_bytes", 76, "u32", 1),
    field("camera_eye_mm", 80, "f32", 3),
    field("camera_look_at_mm", 92, "f32", 3),
    field("camera_up", 104, "f32", 3),
    field("camera_projection", 116, "f32", 2),
    field("crc_32", 124, "u32", 1),
];

/// The bits of `flags`, lowest first, by name.
pub const FLAGS: [(u8, &str); 4] = [(1, "lossless"), (2, "full_size"), (4, "still"), (8, "back_layer")];

/// Flags of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameHeader {
    /// The picture is of a still view: no better one follows until something changes.
    pub still: bool,
    /// The background layer follows below the picture, with the same number of rows, in colour and
    /// in depth.
    pub back_layer: bool,
    /// How colour is written.
    pub color: ColorFormat,
    /// How depth is written.
    pub depth: DepthFormat,
    /// Number of the frame on this connection, from 1. An `ack` contains it.
    pub sequence: u32,
    /// `seq` of the last message of this connection that the picture shows; 0 for none.
    pub shows_seq: u64,
    /// That message's `t_ns`, as the client gave it.
    pub shows_t_ns: u64,
    /// From the arrival of the newest message that the picture shows, of any client, to the frame's
    /// hand-over to the socket, µs.
    pub total_us: u32,
    /// Of that, rendering, µs.
    pub render_us: u32,
    /// Of that, waiting: for the renderer, for acknowledgements, for stillness, µs.
    pub wait_us: u32,
    /// Of that, encoding, µs.
    pub encode_us: u32,
    /// Width and height of the pictures sent.
    pub size_px: [u16; 2],
    /// Width and height that they stand for: enlarge to these.
    pub full_px: [u16; 2],
    /// View depths that are Z = 0 and Z = 1, mm.
    pub limits_mm: [f32; 2],
    /// H1 to H4 of the display's header.
    pub display: [u8; 4],
    /// The layout to compose.
    pub layout: LiveLayout,
    /// Bytes of colour behind the header.
    pub color_bytes: u32,
    /// Bytes of depth behind the colour.
    pub depth_bytes: u32,
    /// The eye, patient mm.
    pub eye_mm: [f32; 3],
    /// The point in the middle of the picture, patient mm.
    pub look_at_mm: [f32; 3],
    /// The direction that is up in the picture.
    pub up: [f32; 3],
    /// Vertical field of view in degrees, 0 for a parallel projection; and the height of that in
    /// mm, or 0.
    pub projection: [f32; 2],
}

/// Bytes that are no frame of this version.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FrameError {
    /// Fewer bytes than they have to be, or more.
    #[error("the frame has {found} bytes, expected {expected}")]
    Length {
        /// Bytes there.
        found: u64,
        /// Bytes of the header, and with it of all.
        expected: u64,
    },
    /// Something else than a frame.
    #[error("the frame begins with {0:02x?}, expected {MAGIC:02x?}")]
    Magic([u8; 4]),
    /// A field has a value that this version does not know.
    #[error("the frame's {field} is {found}, allowed: {allowed}")]
    Field {
        /// The field.
        field: &'static str,
        /// Its value.
        found: u64,
        /// The permitted values.
        allowed: &'static str,
    },
    /// A number is infinite or NaN.
    #[error("the frame's {0} has a number that is not finite")]
    NotFinite(&'static str),
    /// The checksum does not match the header.
    #[error("the frame's CRC-32 is {found:#010x}, expected {expected:#010x}")]
    Crc {
        /// The checksum in the header.
        found: u32,
        /// The checksum of the header's bytes.
        expected: u32,
    },
    /// Two fields contradict each other.
    #[error("the frame's {0}")]
    Contradiction(&'static str),
    /// The display's part of the header is invalid.
    #[error("the frame's display: {0}")]
    Display(HeaderProblem),
    /// The camera shows nothing.
    #[error("the frame's camera: {0}")]
    Camera(CameraError),
}

impl FrameHeader {
    /// Whether colour is that of the renderer, bit by bit.
    #[must_use]
    pub const fn lossless(&self) -> bool {
        self.color.is_lossless()
    }

    /// Whether the picture has its full size.
    #[must_use]
    pub fn full_size(&self) -> bool {
        self.size_px == self.full_px
    }

    /// Rows of the transmitted pictures, background layer included.
    #[must_use]
    pub fn rows(&self) -> usize {
        usize::from(self.size_px[1]) * if self.back_layer { 2 } else { 1 }
    }

    /// Pixels of the transmitted pictures, background layer included.
    #[must_use]
    pub fn pixels(&self) -> usize {
        usize::from(self.size_px[0]) * self.rows()
    }

    /// Pixels of the pictures in full size, background layer included.
    #[must_use]
    pub fn full_pixels(&self) -> usize {
        usize::from(self.full_px[0]) * usize::from(self.full_px[1]) * if self.back_layer { 2 } else { 1 }
    }

    /// Bytes of the frame, header included.
    #[must_use]
    pub fn frame_bytes(&self) -> u64 {
        HEADER_BYTES as u64 + u64::from(self.color_bytes) + u64::from(self.depth_bytes)
    }

    /// The time that the server spent on other work than rendering and waiting, µs.
    #[must_use]
    pub const fn overhead_us(&self) -> u32 {
        self.total_us.saturating_sub(self.render_us).saturating_sub(self.wait_us)
    }

    /// The limits of scaled depth; `None` where the header has no valid ones.
    #[must_use]
    pub fn limits(&self) -> Option<DepthLimits> {
        let [near, far] = self.limits_mm.map(f64::from);
        DepthLimits::new(near, far)
    }

    /// The display's header.
    ///
    /// # Errors
    /// When the limits are invalid. A decoded header always has valid ones.
    pub fn display_header(&self) -> Result<DisplayHeader, FrameError> {
        DisplayHeader::from_fields(self.display).map_err(FrameError::Display)
    }

    /// The camera that the picture was made with, rounded to single precision.
    ///
    /// # Errors
    /// When the numbers show nothing.
    pub fn camera(&self) -> Result<Camera, FrameError> {
        let [fov_deg, height_mm] = self.projection.map(f64::from);
        let projection = if fov_deg > 0.0 {
            Projection::Perspective { vertical_fov: fov_deg.to_radians() }
        } else {
            Projection::Orthographic { height_mm }
        };
        let [eye, look_at, up] = [self.eye_mm, self.look_at_mm, self.up].map(|xyz| xyz.map(f64::from).into());
        Camera::new(Point::from_xyz(eye), Point::from_xyz(look_at), Vector::from_xyz(up), projection)
            .map_err(FrameError::Camera)
    }

    /// The same header with this camera.
    #[must_use]
    pub fn with_camera(self, camera: &Camera) -> Self {
        let single = |xyz: glam::DVec3| xyz.to_array().map(|number| number as f32);
        let projection = match camera.projection() {
            Projection::Perspective { vertical_fov } => [vertical_fov.to_degrees() as f32, 0.0],
            Projection::Orthographic { height_mm } => [0.0, height_mm as f32],
        };
        let (eye_mm, look_at_mm) = (single(camera.eye().xyz), single(camera.look_at().xyz));
        Self { eye_mm, look_at_mm, up: single(camera.up().xyz), projection, ..self }
    }

    fn flags(&self) -> u8 {
        let bits = [self.lossless(), self.full_size(), self.still, self.back_layer];
        bits.into_iter().zip(FLAGS).fold(0, |flags, (set, (bit, _))| if set { flags | bit } else { flags })
    }

    /// The bytes.
    #[must_use]
    pub fn encode(&self) -> [u8; HEADER_BYTES] {
        let mut out = Vec::with_capacity(HEADER_BYTES);
        out.extend(MAGIC);
        out.extend(VERSION.to_le_bytes());
        out.extend([HEADER_BYTES as u8, 0, KIND_FRAME, self.flags(), self.color.byte(), self.depth.byte()]);
        out.extend(self.sequence.to_le_bytes());
        out.extend([self.shows_seq, self.shows_t_ns].into_iter().flat_map(u64::to_le_bytes));
        let times = [self.total_us, self.render_us, self.wait_us, self.encode_us];
        out.extend(times.into_iter().flat_map(u32::to_le_bytes));
        out.extend(self.size_px.into_iter().chain(self.full_px).flat_map(u16::to_le_bytes));
        out.extend(self.limits_mm.into_iter().flat_map(f32::to_le_bytes));
        out.extend(self.display);
        out.extend([self.layout.byte(), 0, 0, 0]);
        out.extend([self.color_bytes, self.depth_bytes].into_iter().flat_map(u32::to_le_bytes));
        let camera = self.eye_mm.into_iter().chain(self.look_at_mm).chain(self.up).chain(self.projection);
        out.extend(camera.flat_map(f32::to_le_bytes));
        out.extend(CRC_32.checksum(&out).to_le_bytes());
        let mut bytes = [0; HEADER_BYTES];
        bytes.copy_from_slice(&out); // as long as the table of fields, which a test adds up
        bytes
    }

    /// The header at the beginning of a frame.
    ///
    /// # Errors
    /// Headers that no encoder of this version writes.
    pub fn decode(frame: &[u8]) -> Result<Self, FrameError> {
        let Some(bytes) = frame.first_chunk::<HEADER_BYTES>() else {
            return Err(FrameError::Length { found: frame.len() as u64, expected: HEADER_BYTES as u64 });
        };
        let at = Reader(bytes);
        if at.bytes(0) != MAGIC {
            return Err(FrameError::Magic(at.bytes(0)));
        }
        expect("version", at.u16(4).into(), VERSION.into(), "1")?;
        expect("header_bytes", at.u16(6).into(), HEADER_BYTES as u64, "128")?;
        let (found, expected) = (at.u32(124), CRC_32.checksum(&bytes[..124]));
        if found != expected {
            return Err(FrameError::Crc { found, expected });
        }
        let [kind, flags, color, depth] = at.bytes(8);
        expect("kind", kind.into(), KIND_FRAME.into(), "1")?;
        let unknown = |field, found: u8, allowed| FrameError::Field { field, found: found.into(), allowed };
        let layout = at.bytes::<4>(68);
        let header = Self {
            still: flags & 4 != 0,
            back_layer: flags & 8 != 0,
            color: ColorFormat::from_byte(color).ok_or_else(|| unknown("color_format", color, "1 to 3"))?,
            depth: DepthFormat::from_byte(depth).ok_or_else(|| unknown("depth_format", depth, "0 to 4"))?,
            sequence: at.u32(12),
            shows_seq: at.u64(16),
            shows_t_ns: at.u64(24),
            total_us: at.u32(32),
            render_us: at.u32(36),
            wait_us: at.u32(40),
            encode_us: at.u32(44),
            size_px: [at.u16(48), at.u16(50)],
            full_px: [at.u16(52), at.u16(54)],
            limits_mm: [at.f32(56), at.f32(60)],
            display: at.bytes(64),
            layout: LiveLayout::from_byte(layout[0]).ok_or_else(|| unknown("layout", layout[0], "0 to 7"))?,
            color_bytes: at.u32(72),
            depth_bytes: at.u32(76),
            eye_mm: at.vector(80),
            look_at_mm: at.vector(92),
            up: at.vector(104),
            projection: [at.f32(116), at.f32(120)],
        };
        expect("reserved", u32::from_le_bytes([layout[1], layout[2], layout[3], 0]).into(), 0, "0")?;
        header.check(flags)?;
        Ok(header)
    }

    /// Checks a header whose fields are valid one by one for combinations that no encoder writes.
    fn check(&self, flags: u8) -> Result<(), FrameError> {
        if flags != self.flags() {
            let allowed = "bits 1, 2, 4 and 8; 1 where colour is lossless, 2 where both sizes are equal";
            return Err(FrameError::Field { field: "flags", found: flags.into(), allowed });
        }
        for (field, size) in [("size_px", self.size_px), ("full_px", self.full_px)] {
            let range = 1..=MAX_FRAME_SIDE_PX;
            if let Some(side) = size.into_iter().map(u32::from).find(|side| !range.contains(side)) {
                return Err(FrameError::Field { field, found: side.into(), allowed: "1 to 16384" });
            }
        }
        if self.size_px.iter().zip(self.full_px).any(|(sent, full)| *sent > full) {
            return Err(FrameError::Contradiction("size_px is larger than its full_px"));
        }
        if (self.depth == DepthFormat::None) != (self.depth_bytes == 0) {
            return Err(FrameError::Contradiction("depth_bytes do not go with its depth_format"));
        }
        let numbers = [
            ("limits", &self.limits_mm[..]),
            ("camera_eye_mm", &self.eye_mm),
            ("camera_look_at_mm", &self.look_at_mm),
            ("camera_up", &self.up),
            ("camera_projection", &self.projection),
        ];
        match numbers.into_iter().find(|(_, numbers)| numbers.iter().any(|number| !number.is_finite())) {
            Some((field, _)) => return Err(FrameError::NotFinite(field)),
            None if self.limits().is_none() => {
                return Err(FrameError::Contradiction("near_mm is not below its far_mm"));
            }
            None => {}
        }
        self.display_header().map(|_| ())
    }
}

fn expect(field: &'static str, found: u64, expected: u64, allowed: &'static str) -> Result<(), FrameError> {
    if found == expected { Ok(()) } else { Err(FrameError::Field { field, found, allowed }) }
}

/// Numbers at places of the header; every place is a constant of this file.
struct Reader<'a>(&'a [u8; HEADER_BYTES]);

impl Reader<'_> {
    fn bytes<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut bytes = [0; N];
        bytes.copy_from_slice(&self.0[at..at + N]);
        bytes
    }

    fn u16(&self, at: usize) -> u16 {
        u16::from_le_bytes(self.bytes(at))
    }

    fn u32(&self, at: usize) -> u32 {
        u32::from_le_bytes(self.bytes(at))
    }

    fn u64(&self, at: usize) -> u64 {
        u64::from_le_bytes(self.bytes(at))
    }

    fn f32(&self, at: usize) -> f32 {
        f32::from_le_bytes(self.bytes(at))
    }

    fn vector(&self, at: usize) -> [f32; 3] {
        [self.f32(at), self.f32(at + 4), self.f32(at + 8)]
    }
}
