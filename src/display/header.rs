//! The WoWvx header: 10 or 32 bytes in the top bits of the blue channel of a frame's first line.
//!
//! The typed fields, their bytes, their place in the pixels, and a strict reader that names every
//! fault. The rest of the frame is in `layout`.
//!
//! | byte | meaning |
//! |---|---|
//! | H0 | 0xF1 |
//! | H1 | content type |
//! | H2, H3 | factor (64 = 100 %), offset (the D of the screen plane) |
//! | H4 | bit 7: use H2, bit 6: use H3, in place of the display's own optimum; the rest 0 |
//! | H5 | 0 |
//! | H6-H9 | CRC-32 of H0..H5, big-endian |
//! | H10, H11 | 0xF2, 0x14: the extended part |
//! | H12 | 0x00 2D+Z, 0x9A Declipse without redundant data, 0xEF Declipse with the full background |
//! | H13-H27 | 0 |
//! | H28-H31 | CRC-32 of H10..H27, big-endian |
//!
//! Bit y of byte n is the top blue bit of pixel 16n + 2(7-y) of line 0; odd pixels keep the
//! picture.

use crc::{Algorithm, Crc};

/// Bytes of the part every header has.
const BASE_LEN: usize = 10;
/// Bytes of a header with its extended part.
const FULL_LEN: usize = 32;
const MAGIC: u8 = 0xF1;
const EXTENDED_MAGIC: u8 = 0xF2;
/// H11 of every public writer; its meaning is not known.
const EXTENDED_CONSTANT: u8 = 0x14;
const USE_FACTOR: u8 = 0x80;
const USE_OFFSET: u8 = 0x40;

/// CRC-32 with Ethernet's polynomial, but without initial value, reflection and final xor.
static CRC_32: Crc<u32> = Crc::<u32>::new(&Algorithm {
    width: 32,
    poly: 0x04C1_1DB7,
    init: 0,
    refin: false,
    refout: false,
    xorout: 0,
    check: 0x89A1_897F,
    residue: 0,
});

/// The settings of a frame that its display reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// H1: kind of content, for which displays have their own depth settings.
    pub content: ContentType,
    /// H2: depth effect, linear; 64 is 100 % of the display's recommendation.
    pub factor: u8,
    /// H3: the disparity that lies on the screen plane; larger ones stand in front.
    pub offset: u8,
    /// H4 bit 7: the display takes `factor` rather than its own optimum.
    pub use_factor: bool,
    /// H4 bit 6: the display takes `offset` rather than its own optimum.
    pub use_offset: bool,
    /// H10 to H31, which displays with older firmware ignore.
    pub extended: Option<ExtendedPart>,
}

/// H1: kind of content.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ContentType {
    /// 0: a 2D picture; depth is ignored.
    NoDepth,
    /// 1: signage.
    Signage,
    /// 2: movie.
    Movie,
    /// 3: game.
    Game,
    /// 4: computer graphics.
    Cgi,
    /// 5: still picture.
    Still,
}

/// H12: the kind of the extended part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExtendedPart {
    /// 0x00: picture and depth.
    TwoDPlusZ,
    /// 0x9A: picture, depth and background, redundant background removed.
    DeclipseRemoved,
    /// 0xEF: picture, depth and the full background.
    DeclipseFull,
}

/// One of the two parts of a header, each with its own checksum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeaderPart {
    /// H0 to H9.
    Base,
    /// H10 to H31.
    Extended,
}

/// Something wrong with a header.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum HeaderProblem {
    /// Fewer or more bytes than the header has.
    #[error("the header has {found} bytes, expected {expected}")]
    Length {
        /// Bytes there.
        found: usize,
        /// Bytes of this kind of header.
        expected: usize,
    },
    /// H0 is not 0xF1: most likely no header at all.
    #[error("no header: H0 is {found:#04X}, expected {MAGIC:#04X}")]
    Magic {
        /// H0.
        found: u8,
    },
    /// The bytes and their checksum disagree.
    #[error("the CRC-32 of {part} is {found:#010X}, expected {expected:#010X}")]
    Crc {
        /// The part that the checksum covers.
        part: HeaderPart,
        /// The checksum in the header.
        found: u32,
        /// The checksum of the header's bytes.
        expected: u32,
    },
    /// H1 is not a known content type.
    #[error("the content type H1 is {found}, expected 0 to 5")]
    UnknownContent {
        /// H1.
        found: u8,
    },
    /// Bits that have to be 0 are set.
    #[error("H{byte} is {found:#04X}: its reserved bits {:#04X} are set, expected 0", found & reserved)]
    Reserved {
        /// Number of the byte.
        byte: usize,
        /// Its value.
        found: u8,
        /// The bits of it that have to be 0.
        reserved: u8,
    },
    /// H10 or H11 does not begin an extended part.
    #[error("the extended part's H{byte} is {found:#04X}, expected {expected:#04X}")]
    ExtendedStart {
        /// Number of the byte.
        byte: usize,
        /// Its value.
        found: u8,
        /// The value of every valid extended part.
        expected: u8,
    },
    /// H12 is not a known kind.
    #[error("the extended part's kind H12 is {found:#04X}, expected 0x00, 0x9A or 0xEF")]
    UnknownExtended {
        /// H12.
        found: u8,
    },
}

/// The result of reading a header: the readable fields, and all faults.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HeaderReading {
    /// The bytes: 10, or 32 with the extended part, or fewer when cut.
    pub bytes: Vec<u8>,
    /// The fields, when H0 and the content type are right. Trust them only when there are no
    /// problems.
    pub header: Option<Header>,
    /// Everything wrong, in the order of the bytes.
    pub problems: Vec<HeaderProblem>,
}

impl Default for Header {
    /// Computer graphics with the display's own optimum, announcing 2D+Z.
    fn default() -> Self {
        Self {
            content: ContentType::Cgi,
            factor: 64,
            offset: 128,
            use_factor: false,
            use_offset: false,
            extended: Some(ExtendedPart::TwoDPlusZ),
        }
    }
}

impl std::fmt::Display for HeaderPart {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Base => "H0 to H5",
            Self::Extended => "H10 to H27",
        })
    }
}

impl std::fmt::Display for ContentType {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

impl ContentType {
    /// All of them; the index is the byte in the header.
    pub const ALL: [Self; 6] =
        [Self::NoDepth, Self::Signage, Self::Movie, Self::Game, Self::Cgi, Self::Still];

    /// The name in requests and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NoDepth => "no-depth",
            Self::Signage => "signage",
            Self::Movie => "movie",
            Self::Game => "game",
            Self::Cgi => "cgi",
            Self::Still => "still",
        }
    }

    const fn byte(self) -> u8 {
        self as u8
    }

    fn from_byte(byte: u8) -> Option<Self> {
        Self::ALL.get(usize::from(byte)).copied()
    }
}

impl ExtendedPart {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::TwoDPlusZ, Self::DeclipseRemoved, Self::DeclipseFull];

    const fn byte(self) -> u8 {
        match self {
            Self::TwoDPlusZ => 0x00,
            Self::DeclipseRemoved => 0x9A,
            Self::DeclipseFull => 0xEF,
        }
    }

    fn from_byte(byte: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|part| part.byte() == byte)
    }
}

impl Header {
    /// H1 to H4: content type, factor, offset, and which of the two the display takes.
    #[must_use]
    pub const fn fields(&self) -> [u8; 4] {
        let select =
            if self.use_factor { USE_FACTOR } else { 0 } | if self.use_offset { USE_OFFSET } else { 0 };
        [self.content.byte(), self.factor, self.offset, select]
    }

    /// The header with these H1 to H4, announcing 2D+Z.
    ///
    /// # Errors
    /// When the content type is unknown or a reserved bit of H4 is set.
    pub fn from_fields([content, factor, offset, select]: [u8; 4]) -> Result<Self, HeaderProblem> {
        let known = ContentType::from_byte(content);
        let content = known.ok_or(HeaderProblem::UnknownContent { found: content })?;
        let reserved = !(USE_FACTOR | USE_OFFSET);
        if select & reserved != 0 {
            return Err(HeaderProblem::Reserved { byte: 4, found: select, reserved });
        }
        let (use_factor, use_offset) = (select & USE_FACTOR != 0, select & USE_OFFSET != 0);
        Ok(Self { content, factor, offset, use_factor, use_offset, ..Self::default() })
    }

    /// The header's bytes: 10, or 32 with the extended part.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let [content, factor, offset, select] = self.fields();
        let mut bytes = vec![MAGIC, content, factor, offset, select, 0];
        bytes.extend(CRC_32.checksum(&bytes).to_be_bytes());
        if let Some(extended) = self.extended {
            bytes.extend([EXTENDED_MAGIC, EXTENDED_CONSTANT, extended.byte()]);
            bytes.resize(FULL_LEN - 4, 0);
            let crc = CRC_32.checksum(bytes.get(BASE_LEN..).unwrap_or_default());
            bytes.extend(crc.to_be_bytes());
        }
        bytes
    }

    /// The header in these bytes, only when nothing is wrong with it.
    ///
    /// # Errors
    /// Everything that is wrong, in the order of the bytes.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Vec<HeaderProblem>> {
        let reading = HeaderReading::of_bytes(bytes);
        match reading.header {
            Some(header) if reading.problems.is_empty() => Ok(header),
            _ => Err(reading.problems),
        }
    }

    /// Pixels of line 0 from the left edge to the header's last bit.
    #[must_use]
    pub const fn width_px(&self) -> u32 {
        if self.extended.is_some() { 511 } else { 159 }
    }

    /// Writes the header into the left half of a frame's first line (RGB, 8 bits): top blue bits of
    /// even pixels, nothing else.
    ///
    /// Where the picture's own bits behind a header of ten bytes would read as an extended part,
    /// two of them (pixels 160 and 510) change as well. A line of fewer than [`Header::width_px`]
    /// pixels gets only the bits that fit; layouts refuse such frames.
    pub(super) fn write_into_line(&self, line_rgb: &mut [u8]) {
        let bytes = self.to_bytes();
        let bits = bytes.iter().flat_map(|byte| (0..8).rev().map(move |y| byte >> y & 1));
        for (blue, bit) in line_rgb.iter_mut().skip(2).step_by(6).zip(bits) {
            *blue = *blue & 0x7F | bit << 7;
        }
        if self.extended.is_none() && has_extended_part(&bytes_of_line(line_rgb)) {
            let mut blues = line_rgb.iter_mut().skip(2).step_by(6);
            blues.nth(8 * BASE_LEN).into_iter().for_each(|first_bit| *first_bit &= 0x7F);
            blues.nth(8 * (FULL_LEN - BASE_LEN) - 2).into_iter().for_each(|last_bit| *last_bit ^= 0x80);
        }
    }
}

impl HeaderReading {
    /// Reads the first line of a frame (RGB, 8 bits). A blue channel of 128 or more is a set bit.
    #[must_use]
    pub fn of_line(line_rgb: &[u8]) -> Self {
        let bytes = bytes_of_line(line_rgb);
        match bytes.get(..BASE_LEN) {
            Some(base) if !has_extended_part(&bytes) => Self::of_bytes(base),
            _ => Self::of_bytes(&bytes),
        }
    }

    /// Reads the bytes of a header: 10, or 32 with the extended part.
    #[must_use]
    pub fn of_bytes(bytes: &[u8]) -> Self {
        let mut problems = Vec::new();
        let mut header = None;
        if let Some(base) = bytes.first_chunk::<BASE_LEN>() {
            header = read_base(base, &mut problems);
            match bytes.get(BASE_LEN..).unwrap_or_default() {
                [] => {}
                extended => {
                    let part = read_extended(extended, &mut problems);
                    header = header.map(|header| Header { extended: part, ..header });
                }
            }
        } else {
            problems.push(HeaderProblem::Length { found: bytes.len(), expected: BASE_LEN });
        }
        Self { bytes: bytes.to_vec(), header, problems }
    }

    /// Whether H0 announces a header, valid or not.
    #[must_use]
    pub fn is_present(&self) -> bool {
        self.bytes.len() >= BASE_LEN && self.bytes.first() == Some(&MAGIC)
    }
}

/// The bytes in the top blue bits of a line: 32, or fewer where the line is narrow.
fn bytes_of_line(line_rgb: &[u8]) -> Vec<u8> {
    let bits: Vec<u8> = line_rgb.iter().skip(2).step_by(6).take(8 * FULL_LEN).map(|blue| blue >> 7).collect();
    bits.chunks_exact(8).map(|bits| bits.iter().fold(0, |byte, bit| byte << 1 | bit)).collect()
}

/// Whether an extended part follows H9. After a header of ten bytes the same pixels are plain
/// picture.
///
/// An extended part begins with 0xF2 0x14, or would have the right checksum if it did (a damaged
/// one).
fn has_extended_part(bytes: &[u8]) -> bool {
    let extended = bytes.get(BASE_LEN..).unwrap_or_default();
    if extended.starts_with(&[EXTENDED_MAGIC, EXTENDED_CONSTANT]) {
        return true;
    }
    let Some((rest, crc)) = extended.split_last_chunk::<4>() else {
        return false;
    };
    let mut repaired = rest.to_vec();
    for (byte, start) in repaired.iter_mut().zip([EXTENDED_MAGIC, EXTENDED_CONSTANT]) {
        *byte = start;
    }
    bytes.len() == FULL_LEN && CRC_32.checksum(&repaired) == u32::from_be_bytes(*crc)
}

/// The fields of H0 to H9; `None` where there is no header or its content type is unknown.
fn read_base(bytes: &[u8; BASE_LEN], problems: &mut Vec<HeaderProblem>) -> Option<Header> {
    let [magic, content, factor, offset, select, reserved, crc @ ..] = *bytes;
    if magic != MAGIC {
        problems.push(HeaderProblem::Magic { found: magic });
        return None;
    }
    let known = ContentType::from_byte(content);
    if known.is_none() {
        problems.push(HeaderProblem::UnknownContent { found: content });
    }
    check_reserved(4, select, !(USE_FACTOR | USE_OFFSET), problems);
    check_reserved(5, reserved, 0xFF, problems);
    check_crc(HeaderPart::Base, &bytes[..6], crc, problems);
    known.map(|content| Header {
        content,
        factor,
        offset,
        use_factor: select & USE_FACTOR != 0,
        use_offset: select & USE_OFFSET != 0,
        extended: None,
    })
}

/// H14 to H17 as one writer for Dimenco displays sets them; their meaning is unknown (0x21C is
/// 540). Others write 0.
const DIMENCO_H14: [u8; 4] = [0x00, 0x3C, 0x02, 0x1C];

/// The kind that H10 to H31 announce; `None` where it is cut or unknown.
fn read_extended(bytes: &[u8], problems: &mut Vec<HeaderProblem>) -> Option<ExtendedPart> {
    let Ok(bytes) = <&[u8; FULL_LEN - BASE_LEN]>::try_from(bytes) else {
        problems.push(HeaderProblem::Length { found: BASE_LEN + bytes.len(), expected: FULL_LEN });
        return None;
    };
    let [magic, constant, kind, reserved @ .., c0, c1, c2, c3] = bytes;
    for (byte, found, expected) in [(10, *magic, EXTENDED_MAGIC), (11, *constant, EXTENDED_CONSTANT)] {
        if found != expected {
            problems.push(HeaderProblem::ExtendedStart { byte, found, expected });
        }
    }
    let part = ExtendedPart::from_byte(*kind);
    if part.is_none() {
        problems.push(HeaderProblem::UnknownExtended { found: *kind });
    }
    let is_dimenco = reserved[1..5] == DIMENCO_H14;
    for (byte, &found) in (13..).zip(reserved).filter(|(byte, _)| !(is_dimenco && (14..18).contains(byte))) {
        check_reserved(byte, found, 0xFF, problems);
    }
    check_crc(HeaderPart::Extended, &bytes[..18], [*c0, *c1, *c2, *c3], problems);
    part
}

fn check_reserved(byte: usize, found: u8, reserved: u8, problems: &mut Vec<HeaderProblem>) {
    if found & reserved != 0 {
        problems.push(HeaderProblem::Reserved { byte, found, reserved });
    }
}

fn check_crc(part: HeaderPart, bytes: &[u8], crc: [u8; 4], problems: &mut Vec<HeaderProblem>) {
    let (found, expected) = (u32::from_be_bytes(crc), CRC_32.checksum(bytes));
    if found != expected {
        problems.push(HeaderProblem::Crc { part, found, expected });
    }
}
