//! How colour and depth are written in a frame, and which frame a client composes: closed sets with
//! names and bytes.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use relief_display::Layout;

/// How colour is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ColorFormat {
    /// JPEG: lossy.
    Jpeg,
    /// Differences along rows, in a Zstandard frame (RFC 8878): lossless.
    RgbZstd,
    /// Differences along rows, in a zlib stream (RFC 1950), which browsers unpack themselves:
    /// lossless.
    RgbDeflate,
}

/// How depth is written; always lossless.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DepthFormat {
    /// Not at all.
    None,
    /// D as the display takes it, 8 bits, 255 nearest: differences along rows, in a Zstandard
    /// frame.
    D8Zstd,
    /// Z, 16 bits, 65535 nearest: differences along rows, in a Zstandard frame.
    Z16Zstd,
    /// As `d8-zstd`, in a zlib stream.
    D8Deflate,
    /// As `z16-zstd`, in a zlib stream.
    Z16Deflate,
}

/// The frame that a client composes from the received pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LiveLayout {
    /// None: colour and depth are shown in another way.
    None,
    /// A layout of frames.
    Of(Layout),
}

/// How differences are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Packing {
    Zstd,
    Deflate,
}

impl ColorFormat {
    /// All of them; the byte in the header is the place in this list, from 1.
    pub const ALL: [Self; 3] = [Self::Jpeg, Self::RgbZstd, Self::RgbDeflate];

    /// The name in messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Jpeg => "jpeg",
            Self::RgbZstd => "rgb-zstd",
            Self::RgbDeflate => "rgb-deflate",
        }
    }

    /// Whether the colours that go in come out.
    #[must_use]
    pub const fn is_lossless(self) -> bool {
        !matches!(self, Self::Jpeg)
    }

    /// The byte in the header.
    #[must_use]
    pub const fn byte(self) -> u8 {
        self as u8 + 1
    }

    /// The format of a byte.
    #[must_use]
    pub fn from_byte(byte: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.byte() == byte)
    }

    pub(super) const fn packing(self) -> Option<Packing> {
        match self {
            Self::Jpeg => None,
            Self::RgbZstd => Some(Packing::Zstd),
            Self::RgbDeflate => Some(Packing::Deflate),
        }
    }
}

impl DepthFormat {
    /// All of them; the byte in the header is the place in this list, from 0.
    pub const ALL: [Self; 5] = [Self::None, Self::D8Zstd, Self::Z16Zstd, Self::D8Deflate, Self::Z16Deflate];

    /// The name in messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::D8Zstd => "d8-zstd",
            Self::Z16Zstd => "z16-zstd",
            Self::D8Deflate => "d8-deflate",
            Self::Z16Deflate => "z16-deflate",
        }
    }

    /// The byte in the header.
    #[must_use]
    pub const fn byte(self) -> u8 {
        self as u8
    }

    /// The format of a byte.
    #[must_use]
    pub fn from_byte(byte: u8) -> Option<Self> {
        Self::ALL.get(usize::from(byte)).copied()
    }

    /// Whether depth is Z in 16 bits.
    #[must_use]
    pub const fn is_z16(self) -> bool {
        matches!(self, Self::Z16Zstd | Self::Z16Deflate)
    }

    pub(super) const fn packing(self) -> Option<Packing> {
        match self {
            Self::None => None,
            Self::D8Zstd | Self::Z16Zstd => Some(Packing::Zstd),
            Self::D8Deflate | Self::Z16Deflate => Some(Packing::Deflate),
        }
    }
}

impl LiveLayout {
    /// `None`, and the layouts with a number in live frames, in the order of their numbers.
    pub fn all() -> impl Iterator<Item = Self> {
        (0..=u8::MAX).map_while(Self::from_byte)
    }

    /// The live layout of a layout: `None` for one that is not composed by clients.
    #[must_use]
    pub fn of(layout: Layout) -> Self {
        layout.info().live_byte.map_or(Self::None, |_| Self::Of(layout))
    }

    /// The name in documents: the layout's, or `none`.
    #[must_use]
    pub fn name(self) -> Cow<'static, str> {
        match self {
            Self::None => Cow::Borrowed("none"),
            Self::Of(layout) => layout.name(),
        }
    }

    /// The byte in the header.
    #[must_use]
    pub fn byte(self) -> u8 {
        match self {
            Self::None => 0,
            Self::Of(layout) => layout.info().live_byte.unwrap_or(0),
        }
    }

    /// The layout of a byte.
    #[must_use]
    pub fn from_byte(byte: u8) -> Option<Self> {
        if byte == 0 {
            return Some(Self::None);
        }
        Layout::ALL.into_iter().find(|layout| layout.info().live_byte == Some(byte)).map(Self::Of)
    }
}
