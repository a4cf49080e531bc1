//! Layouts: where the picture and its depth go in a frame, and how they come out again.
//!
//! What it is: the names of the layouts, the sizes they need, [`FrameEncoder`] and [`Layout::decode`]. What it is
//! not: files; see `encode`. Pixels are in rows from the top, (x, y) from the top left.
//!
//! | layout | frame |
//! |---|---|
//! | `wowvx` | picture and disparity side by side on the even lines, odd lines black, header on line 0 |
//! | `wowvx-full-height` | the same on all lines |
//! | `wowvx-4k` | the same on all lines of 3840x2160 |
//! | `declipse` | four quadrants: picture and disparity above, the same of what lies behind below; header on line 0 |
//! | `declipse-lines` | picture and disparity on the even lines, the same of what lies behind on the odd ones |
//! | `rgbd` | picture and disparity side by side, no header, any size |
//! | `color` | the picture alone |
//! | `depth16` | Z alone in 16 bits of grey, 65535 nearest, 0 farthest |

mod decode;
mod frame;
mod pack;

use std::str::FromStr;

use super::filter::DepthFilter;
use super::header::{ExtendedPart, Header};
use super::profile::DisplayProfile;
use crate::units::DepthLimits;

pub use decode::{DecodedDepth, DecodedFrame, DecodedLayer};
pub(super) use decode::{depth_problems, odd_and_even_lines};
pub use frame::{Frame, Picture, Pixels};

/// The frame that 4K displays take, pixels.
const FRAME_4K_PX: [u32; 2] = [3840, 2160];

/// Layouts that are part of the design and not of this version.
const LATER: [&str; 2] = ["stereo", "views-N"];

/// How a picture and its depth are placed in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Layout {
    /// `wowvx`: halves on the even lines, odd lines black; 960x540 each in 1920x1080.
    #[default]
    Wowvx,
    /// `wowvx-full-height`: halves on all lines; 960x1080 each in 1920x1080.
    WowvxFullHeight,
    /// `wowvx-4k`: halves of 1920x2160 in 3840x2160.
    Wowvx4k,
    /// `declipse`: quadrants of the picture, its disparity and the same of what lies behind; 960x540 each in 1920x1080.
    Declipse,
    /// `declipse-lines`: the same, with what lies behind on the odd lines.
    DeclipseLines,
    /// `rgbd`: picture and disparity side by side without header, of any size.
    Rgbd,
    /// `color`: the picture alone, of any size.
    Color,
    /// `depth16`: Z alone as 16-bit grey, nearest brightest, of any size.
    Depth16,
}

/// A name that is no layout.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct UnknownLayout(String);

/// A layout that cannot take what it was given.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LayoutError {
    /// The display takes frames of another size.
    #[error(
        "layout {layout} does not fit a display with frames of {}x{} and sub-images of {}x{}: {remedy}",
        frame_px[0], frame_px[1], sub_image_px[0], sub_image_px[1]
    )]
    Profile {
        /// The layout.
        layout: Layout,
        /// The display's frame.
        frame_px: [u32; 2],
        /// The display's sub-image.
        sub_image_px: [u32; 2],
        /// What would fit.
        remedy: &'static str,
    },
    /// The header would reach into the depth half.
    #[error("the header takes {needed_px} pixels of line 0, the left half has {half_px}: use a wider frame")]
    HeaderWidth {
        /// Pixels up to the header's last bit.
        needed_px: u32,
        /// Pixels of the left half.
        half_px: u32,
    },
    /// The picture is not of the size that the layout needs.
    #[error(
        "layout {layout} needs a picture of {}x{}, found {}x{}: render at that size",
        needed_px[0], needed_px[1], found_px[0], found_px[1]
    )]
    PictureSize {
        /// The layout.
        layout: Layout,
        /// The size to render at.
        needed_px: [u32; 2],
        /// The picture's size.
        found_px: [u32; 2],
    },
    /// The layout needs what lies behind the first layer.
    #[error("layout {layout} needs what lies behind the first layer: render with depth rule two-layer")]
    NoBackground {
        /// The layout.
        layout: Layout,
    },
    /// A picture or frame whose pixels do not fill its size, or with no pixels, or too many.
    #[error("{what} of {}x{} has {found} values, expected {expected}", size_px[0], size_px[1])]
    PixelCount {
        /// What it is.
        what: &'static str,
        /// Its size.
        size_px: [u32; 2],
        /// Values there.
        found: usize,
        /// Values for this size.
        expected: usize,
    },
    /// A side of 0 or above the limit.
    #[error("{what} is {}x{}; allowed: 1 to 16384 pixels each way", size_px[0], size_px[1])]
    Size {
        /// What it is.
        what: &'static str,
        /// Its size.
        size_px: [u32; 2],
    },
}

/// Packs pictures into the frames of one display: a layout, a profile and a header that fit together, and what is
/// done to depth before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameEncoder {
    layout: Layout,
    profile: DisplayProfile,
    header: Header,
    filter: DepthFilter,
}

impl Layout {
    /// All layouts of this version.
    pub const ALL: [Self; 8] = [
        Self::Wowvx,
        Self::WowvxFullHeight,
        Self::Wowvx4k,
        Self::Declipse,
        Self::DeclipseLines,
        Self::Rgbd,
        Self::Color,
        Self::Depth16,
    ];

    /// The name in requests and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Wowvx => "wowvx",
            Self::WowvxFullHeight => "wowvx-full-height",
            Self::Wowvx4k => "wowvx-4k",
            Self::Declipse => "declipse",
            Self::DeclipseLines => "declipse-lines",
            Self::Rgbd => "rgbd",
            Self::Color => "color",
            Self::Depth16 => "depth16",
        }
    }

    /// Whether frames carry a header on line 0.
    #[must_use]
    pub const fn has_header(self) -> bool {
        matches!(self, Self::Wowvx | Self::WowvxFullHeight | Self::Wowvx4k) || self.needs_background()
    }

    /// Whether frames carry what lies behind the first layer as well.
    #[must_use]
    pub const fn needs_background(self) -> bool {
        matches!(self, Self::Declipse | Self::DeclipseLines)
    }

    /// Whether frames carry the picture on the left and its disparity on the right.
    const fn has_halves(self) -> bool {
        !matches!(self, Self::Color | Self::Depth16)
    }

    /// Frame lines from one line of the picture to the next.
    pub(super) const fn line_step(self) -> usize {
        if matches!(self, Self::Wowvx) { 2 } else { 1 }
    }

    /// The size at which to render for a display; `None` where the layout takes a picture of any size.
    #[must_use]
    pub fn render_size_px(self, profile: &DisplayProfile) -> Option<[u32; 2]> {
        let [width, height] = profile.frame_px();
        match self {
            Self::Wowvx | Self::Declipse | Self::DeclipseLines => Some([width / 2, height / 2]),
            Self::WowvxFullHeight | Self::Wowvx4k => Some([width / 2, height]),
            Self::Rgbd | Self::Color | Self::Depth16 => None,
        }
    }

    /// The frame of the displays that this layout is for, where the request names no display.
    pub(super) const fn usual_frame_px(self) -> [u32; 2] {
        if matches!(self, Self::Wowvx4k) { FRAME_4K_PX } else { [1920, 1080] }
    }

    /// Whether frames of this layout are what a display with this profile takes.
    fn check_profile(self, profile: &DisplayProfile) -> Result<(), LayoutError> {
        let (frame_px, sub_image_px) = (profile.frame_px(), profile.sub_image_px());
        let [width, height] = frame_px;
        let refuse = |remedy| Err(LayoutError::Profile { layout: self, frame_px, sub_image_px, remedy });
        match self {
            Self::Wowvx | Self::Declipse | Self::DeclipseLines if height % 2 != 0 || width % 2 != 0 => {
                refuse("it needs an even width and height")
            }
            Self::Wowvx | Self::Declipse | Self::DeclipseLines if sub_image_px != [width / 2, height / 2] => {
                refuse(
                    "its sub-images are half as wide and half as high as the frame; use wowvx-4k for dimenco-4k",
                )
            }
            Self::WowvxFullHeight if width % 2 != 0 => refuse("it needs an even width"),
            Self::Wowvx4k if frame_px != FRAME_4K_PX => {
                refuse("it needs frames of 3840x2160, as dimenco-4k has")
            }
            _ => Ok(()),
        }
    }
}

impl std::fmt::Display for Layout {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Layout {
    type Err = UnknownLayout;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL.into_iter().find(|layout| layout.name() == name).ok_or_else(|| unknown_layout(name))
    }
}

/// The message for a name that is no layout, shortened should somebody send a book.
fn unknown_layout(name: &str) -> UnknownLayout {
    let names = Layout::ALL.map(Layout::name).join(", ");
    let views = name.strip_prefix("views-").is_some_and(|count| count.bytes().all(|c| c.is_ascii_digit()));
    if LATER.contains(&name) || views {
        return UnknownLayout(format!("layout {name} is not in this version; available: {names}"));
    }
    let shown: String = name.chars().take(40).collect();
    UnknownLayout(format!("no layout {shown:?}; available: {names}"))
}

impl serde::Serialize for Layout {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl<'de> serde::Deserialize<'de> for Layout {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        name.parse().map_err(serde::de::Error::custom)
    }
}

impl FrameEncoder {
    /// An encoder for frames of `layout` on a display with `profile`; layouts without header ignore `header`, and those with
    /// a background announce it there.
    ///
    /// # Errors
    /// When the layout's frame is not the one the display takes, or the header does not fit into the left half.
    pub fn new(layout: Layout, profile: DisplayProfile, header: Header) -> Result<Self, LayoutError> {
        layout.check_profile(&profile)?;
        let extended = Some(ExtendedPart::DeclipseFull);
        let header = if layout.needs_background() { Header { extended, ..header } } else { header };
        let half_px = profile.frame_px()[0] / 2;
        if layout.has_header() && half_px < header.width_px() {
            return Err(LayoutError::HeaderWidth { needed_px: header.width_px(), half_px });
        }
        Ok(Self { layout, profile, header, filter: DepthFilter::None })
    }

    /// The same encoder with a filter for the depth of its pictures.
    #[must_use]
    pub const fn with_depth_filter(self, filter: DepthFilter) -> Self {
        Self { filter, ..self }
    }

    /// What is done to depth before it is packed.
    #[must_use]
    pub const fn depth_filter(&self) -> DepthFilter {
        self.filter
    }

    /// The layout of the frames.
    #[must_use]
    pub const fn layout(&self) -> Layout {
        self.layout
    }

    /// The display the frames are for.
    #[must_use]
    pub const fn profile(&self) -> &DisplayProfile {
        &self.profile
    }

    /// The header the frames carry; `None` for layouts without one.
    #[must_use]
    pub fn header(&self) -> Option<Header> {
        self.layout.has_header().then_some(self.header)
    }

    /// The size at which to render; `None` where any size will do.
    #[must_use]
    pub fn render_size_px(&self) -> Option<[u32; 2]> {
        self.layout.render_size_px(&self.profile)
    }

    /// Packs a picture into a frame, its depth filtered and scaled between the limits; a miss becomes the far limit.
    ///
    /// # Errors
    /// When the picture is not of the size that the layout needs (see [`FrameEncoder::render_size_px`]), or has no
    /// background where the layout needs one.
    pub fn encode(&self, picture: &Picture<'_>, limits: DepthLimits) -> Result<Frame, LayoutError> {
        let found_px = picture.size_px();
        match self.render_size_px() {
            Some(needed_px) if needed_px != found_px => {
                Err(LayoutError::PictureSize { layout: self.layout, needed_px, found_px })
            }
            _ if self.layout == Layout::Color => pack::pack(self, picture, limits),
            _ => {
                let depth_mm = self.filter.apply(picture, limits);
                let filtered = Picture::new(found_px, picture.color(), &depth_mm)?;
                match picture.back() {
                    Some(back) => {
                        let depth_mm = self.filter.apply(&back, limits);
                        pack::pack(self, &filtered.with_back(back.color(), &depth_mm)?, limits)
                    }
                    None => pack::pack(self, &filtered, limits),
                }
            }
        }
    }
}
