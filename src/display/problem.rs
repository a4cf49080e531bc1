//! Faults of a frame, as values; the strict decoders and the inspection share them.
//!
//! Every problem has a stable code for programs, a message with the found and the expected value,
//! and advice.

use super::header::HeaderProblem;

/// Something wrong with a frame or with the PNG file that carries it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrameProblem {
    /// The frame's size is not one that displays take.
    #[error(
        "the frame is {}x{}, expected {expected}", found_px[0], found_px[1]
    )]
    FrameSize {
        /// Width and height.
        found_px: [u32; 2],
        /// The expected value.
        expected: &'static str,
    },
    /// The header is missing or wrong.
    #[error("{0}")]
    Header(HeaderProblem),
    /// Lines between those of the sub-images carry something.
    #[error(
        "odd lines that are not black: {lines}, with {pixels} coloured pixels, the first at x {}, y {}",
        first[0], first[1]
    )]
    OddLinesNotBlack {
        /// The number of lines.
        lines: usize,
        /// The number of pixels.
        pixels: usize,
        /// The first one, (x, y) from the top left.
        first: [u32; 2],
    },
    /// The depth half has colours.
    #[error(
        "pixels of the depth half that are not grey: {pixels}, the first at x {}, y {} is {}, {}, {}",
        first[0], first[1], rgb[0], rgb[1], rgb[2]
    )]
    DepthNotGrey {
        /// The number of pixels.
        pixels: usize,
        /// The first one, (x, y) from the top left.
        first: [u32; 2],
        /// Its colour.
        rgb: [u8; 3],
    },
    /// The samples are not of the kind the layout has.
    #[error("the pixels are {found}, expected {expected}")]
    PixelFormat {
        /// The values.
        found: &'static str,
        /// The required values.
        expected: &'static str,
    },
    /// Pixels that are not opaque.
    #[error("pixels that are not opaque: {pixels}; viewers show different backgrounds behind them")]
    Transparent {
        /// The number of pixels.
        pixels: usize,
    },
    /// Views that are present and cannot be decoded.
    #[error("{0}: its views cannot be separated")]
    Inseparable(&'static str),
    /// A PNG chunk that asks viewers to change the pixel values.
    #[error("the file has a {0} chunk: viewers that follow it alter the header's bits and the depth")]
    ColorChunk(&'static str),
}

impl FrameProblem {
    /// A short name that stays the same, for programs.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::FrameSize { .. } => "frame-size",
            Self::Header(HeaderProblem::Magic { .. }) => "no-header",
            Self::Header(HeaderProblem::Length { .. }) => "header-cut",
            Self::Header(HeaderProblem::Crc { .. }) => "header-crc",
            Self::Header(HeaderProblem::UnknownContent { .. }) => "header-content",
            Self::Header(HeaderProblem::Reserved { .. }) => "header-reserved",
            Self::Header(HeaderProblem::ExtendedStart { .. } | HeaderProblem::UnknownExtended { .. }) => {
                "header-extended"
            }
            Self::OddLinesNotBlack { .. } => "odd-lines",
            Self::DepthNotGrey { .. } => "depth-not-grey",
            Self::PixelFormat { .. } => "pixel-format",
            Self::Transparent { .. } => "transparent",
            Self::Inseparable(_) => "inseparable",
            Self::ColorChunk(_) => "color-chunk",
        }
    }

    /// The remedy.
    #[must_use]
    pub const fn advice(&self) -> &'static str {
        match self {
            Self::FrameSize { .. } => "send frames at the panel's own size, 1:1; scaling destroys the header",
            Self::Header(HeaderProblem::Magic { .. }) => {
                "a display shows this as plain 2D; check that nothing scaled, cropped, dithered or colour-managed it"
            }
            Self::Header(HeaderProblem::Crc { .. } | HeaderProblem::Length { .. }) => {
                "some of the header's pixels changed on the way; the link must be RGB 4:4:4, 1:1, without dithering"
            }
            Self::Header(_) => {
                "the program that wrote the header set bits it must not; newer firmware may refuse it"
            }
            Self::OddLinesNotBlack { .. } => {
                "put line i of both halves on line 2i and leave the odd lines black, or use wowvx-full-height"
            }
            Self::DepthNotGrey { .. } => {
                "store the depth half losslessly with R = G = B, without chroma subsampling"
            }
            Self::Inseparable(_) => "write layout stereo or views-N, whose views come back",
            Self::PixelFormat { .. } => "write an 8-bit RGB PNG",
            Self::Transparent { .. } => "write an 8-bit RGB PNG without alpha",
            Self::ColorChunk(_) => "write the PNG without gAMA, cHRM, iCCP, sRGB and cICP chunks",
        }
    }
}

impl From<HeaderProblem> for FrameProblem {
    fn from(problem: HeaderProblem) -> Self {
        Self::Header(problem)
    }
}

/// Problems are `{"code", "message"}` in JSON.
impl serde::Serialize for FrameProblem {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeStruct;
        let mut object = serializer.serialize_struct("Problem", 2)?;
        object.serialize_field("code", self.code())?;
        object.serialize_field("message", &self.to_string())?;
        object.end()
    }
}
