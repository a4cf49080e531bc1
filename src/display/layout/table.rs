//! The one table of layouts: name, summary, parts of the frame, number in live frames.
//!
//! Packing, decoding, the command line, the API description, the live protocol and the kiosk page
//! take everything about a layout from here. `docs/RENDERING.md` is checked against it.

use crate::views::{Arrangement, Axis, Turns, ViewCount, ViewGrid};

/// The frame that 4K displays take, pixels.
pub(super) const FRAME_4K_PX: [u32; 2] = [3840, 2160];

/// One layout.
#[derive(Clone, Copy, Debug)]
pub struct LayoutInfo {
    /// The layout; of quilts the one of nine views.
    pub layout: Layout,
    /// The name in requests and on the command line. Quilts have `views-` and their size.
    pub name: &'static str,
    /// The parts of a frame, in one phrase.
    pub summary: &'static str,
    /// The content of a frame.
    pub content: FrameContent,
    /// Whether line 0 carries the display's header. Frames then have the display's size.
    pub has_header: bool,
    /// The only frame size in pixels, for layouts that have one.
    pub frame_px: Option<[u32; 2]>,
    /// The number in the header of live frames; `None` for layouts that live clients do not
    /// compose.
    pub live_byte: Option<u8>,
}

/// The content of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameContent {
    /// The picture and its disparity.
    Disparity(Placement),
    /// Views that are made of the picture and its disparity.
    Views(Arrangement),
    /// Only the picture.
    Picture,
    /// Only Z in 16 bits.
    Depth,
}

/// The places of a picture and its disparity in a frame: the picture in the left half of its lines, the
/// disparity in the right half. Other lines are black.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Placement {
    /// Lines of the frame per line of the picture.
    pub frame_lines: u32,
    /// Frame lines from one line of the picture to the next; the first is line 0.
    pub line_step: u32,
    /// The start of the background layer, for layouts that have one.
    pub back: Option<BackStart>,
}

/// The first line of the background layer in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BackStart {
    /// Below the picture.
    Below,
    /// On line 1: the layers alternate.
    LineOne,
}

const HALVES: Placement = Placement { frame_lines: 1, line_step: 1, back: None };
/// Views beside and above each other: of a pair above each other the left one is at the top.
const fn tiles(grid: ViewGrid, halved: Option<Axis>) -> Arrangement {
    Arrangement::Tiles { grid, halved, is_from_top: grid.columns() == 1 }
}

const EVEN_LINES: Placement = Placement { frame_lines: 2, line_step: 2, back: None };

impl Placement {
    /// Width and height of the frame of a picture of this size.
    #[must_use]
    pub const fn frame_px(self, [width, height]: [u32; 2]) -> [u32; 2] {
        [2 * width, self.frame_lines * height]
    }

    /// Width and height of the picture in a frame of this size.
    #[must_use]
    pub const fn picture_px(self, [width, height]: [u32; 2]) -> [u32; 2] {
        [width / 2, height / self.frame_lines]
    }

    /// The first frame line of the background layer of a picture with this many lines.
    #[must_use]
    pub fn back_line(self, picture_lines: u32) -> Option<u32> {
        self.back.map(|start| match start {
            BackStart::Below => picture_lines,
            BackStart::LineOne => 1,
        })
    }

    /// Whether every other line is black.
    #[must_use]
    pub const fn has_black_lines(self) -> bool {
        self.line_step > 1 && self.back.is_none()
    }
}

impl Layout {
    /// All layouts.
    pub const TABLE: [LayoutInfo; 19] = [
        LayoutInfo {
            layout: Self::Wowvx,
            name: "wowvx",
            summary: "picture and disparity side by side on the even lines, odd lines black, header on line 0",
            content: FrameContent::Disparity(EVEN_LINES),
            has_header: true,
            frame_px: None,
            live_byte: Some(1),
        },
        LayoutInfo {
            layout: Self::WowvxFullHeight,
            name: "wowvx-full-height",
            summary: "picture and disparity side by side on all lines, header on line 0",
            content: FrameContent::Disparity(HALVES),
            has_header: true,
            frame_px: None,
            live_byte: Some(2),
        },
        LayoutInfo {
            layout: Self::Wowvx4k,
            name: "wowvx-4k",
            summary: "picture and disparity side by side on all lines of 3840x2160, header on line 0",
            content: FrameContent::Disparity(HALVES),
            has_header: true,
            frame_px: Some(FRAME_4K_PX),
            live_byte: Some(3),
        },
        LayoutInfo {
            layout: Self::Declipse,
            name: "declipse",
            summary: "picture and disparity above, those of the background layer below, header on line 0",
            content: FrameContent::Disparity(Placement {
                frame_lines: 2,
                line_step: 1,
                back: Some(BackStart::Below),
            }),
            has_header: true,
            frame_px: None,
            live_byte: Some(4),
        },
        LayoutInfo {
            layout: Self::DeclipseLines,
            name: "declipse-lines",
            summary: "picture and disparity on the even lines, those of the background layer on the odd lines, \
                      header on line 0",
            content: FrameContent::Disparity(Placement {
                frame_lines: 2,
                line_step: 2,
                back: Some(BackStart::LineOne),
            }),
            has_header: true,
            frame_px: None,
            live_byte: Some(5),
        },
        LayoutInfo {
            layout: Self::Rgbd,
            name: "rgbd",
            summary: "picture and disparity side by side, no header: WoWvx displays show it as 2D",
            content: FrameContent::Disparity(HALVES),
            has_header: false,
            frame_px: None,
            live_byte: Some(6),
        },
        LayoutInfo {
            layout: Self::Stereo,
            name: "stereo",
            summary: "two views side by side, the left one on the left",
            content: FrameContent::Views(tiles(ViewGrid::PAIR, None)),
            has_header: false,
            frame_px: None,
            live_byte: None,
        },
        LayoutInfo {
            layout: Self::StereoHalf,
            name: "stereo-half",
            summary: "two views side by side, each half as wide: the frame has the size of one",
            content: FrameContent::Views(tiles(ViewGrid::PAIR, Some(Axis::Across))),
            has_header: false,
            frame_px: None,
            live_byte: None,
        },
        LayoutInfo {
            layout: Self::TopBottom,
            name: "top-bottom",
            summary: "two views above each other, the left one above",
            content: FrameContent::Views(tiles(ViewGrid::STACK, None)),
            has_header: false,
            frame_px: None,
            live_byte: None,
        },
        LayoutInfo {
            layout: Self::TopBottomHalf,
            name: "top-bottom-half",
            summary: "two views above each other, each half as high: the frame has the size of one",
            content: FrameContent::Views(tiles(ViewGrid::STACK, Some(Axis::Down))),
            has_header: false,
            frame_px: None,
            live_byte: None,
        },
        LayoutInfo {
            layout: Self::Lines,
            name: "lines",
            summary: "two views line by line, the left one on the even lines",
            content: FrameContent::Views(Arrangement::Turns(Turns::Lines)),
            has_header: false,
            frame_px: None,
            live_byte: None,
        },
        LayoutInfo {
            layout: Self::Columns,
            name: "columns",
            summary: "two views column by column, the left one on the even columns",
            content: FrameContent::Views(Arrangement::Turns(Turns::Columns)),
            has_header: false,
            frame_px: None,
            live_byte: None,
        },
        LayoutInfo {
            layout: Self::Checkerboard,
            name: "checkerboard",
            summary: "two views as a checkerboard, the left one at the top left",
            content: FrameContent::Views(Arrangement::Turns(Turns::Checkerboard)),
            has_header: false,
            frame_px: None,
            live_byte: None,
        },
        LayoutInfo {
            layout: Self::Views(ViewGrid::NINE),
            name: "views-9",
            summary: "a quilt of views, views-N or views-COLUMNSxROWS: the leftmost at the bottom left, rows upwards",
            content: FrameContent::Views(tiles(ViewGrid::NINE, None)),
            has_header: false,
            frame_px: None,
            live_byte: None,
        },
        LayoutInfo {
            layout: Self::Lenses(ViewCount::NINE),
            name: "lenses-9",
            summary: "N views interlaced for a panel with slanted lenses, lenses-N: each third of a pixel belongs to a view",
            content: FrameContent::Views(Arrangement::Lenses),
            has_header: false,
            frame_px: None,
            live_byte: None,
        },
        LayoutInfo {
            layout: Self::Anaglyph,
            name: "anaglyph",
            summary: "two views in one picture, for red-cyan glasses",
            content: FrameContent::Views(Arrangement::RedCyan),
            has_header: false,
            frame_px: None,
            live_byte: None,
        },
        LayoutInfo {
            layout: Self::Wiggle,
            name: "wiggle",
            summary: "an animated PNG of nine views, forwards and backwards",
            content: FrameContent::Views(Arrangement::Animation),
            has_header: false,
            frame_px: None,
            live_byte: None,
        },
        LayoutInfo {
            layout: Self::Color,
            name: "color",
            summary: "only the picture",
            content: FrameContent::Picture,
            has_header: false,
            frame_px: None,
            live_byte: Some(7),
        },
        LayoutInfo {
            layout: Self::Depth16,
            name: "depth16",
            summary: "only Z, in 16 bits of grey: 65535 nearest, 0 farthest",
            content: FrameContent::Depth,
            has_header: false,
            frame_px: None,
            live_byte: None,
        },
    ];

    /// All layouts; of quilts the one of nine views.
    pub const ALL: [Self; Self::TABLE.len()] = {
        let mut all = [Self::Wowvx; Self::TABLE.len()];
        let mut at = 0;
        while at < all.len() {
            all[at] = Self::TABLE[at].layout;
            at += 1;
        }
        all
    };

    /// The layout's row of the table.
    #[must_use]
    pub fn info(self) -> &'static LayoutInfo {
        const TABLE: &[LayoutInfo] = &Layout::TABLE;
        let kind = std::mem::discriminant(&self);
        let found = TABLE.iter().find(|info| std::mem::discriminant(&info.layout) == kind);
        found.unwrap_or(&TABLE[0]) // a test holds that every layout has its row
    }

    /// The places of picture and disparity, for layouts that carry both.
    #[must_use]
    pub fn placement(self) -> Option<Placement> {
        match self.info().content {
            FrameContent::Disparity(placement) => Some(placement),
            _ => None,
        }
    }

    /// How the views lie in a frame, for layouts of views.
    #[must_use]
    pub fn arrangement(self) -> Option<Arrangement> {
        match (self, self.info().content) {
            (Self::Views(grid), _) => Some(Arrangement::Tiles { grid, halved: None, is_from_top: false }),
            (_, FrameContent::Views(arrangement)) => Some(arrangement),
            _ => None,
        }
    }
}

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
    /// `declipse`: quadrants of the picture, its disparity, and both of the background layer;
    /// 960x540 each in 1920x1080.
    Declipse,
    /// `declipse-lines`: the same, with the background layer on the odd lines.
    DeclipseLines,
    /// `rgbd`: picture and disparity side by side without header, of any size.
    Rgbd,
    /// `stereo`: two views beside each other, of any size.
    Stereo,
    /// `stereo-half`: the same at half the width.
    StereoHalf,
    /// `top-bottom`: two views above each other, of any size.
    TopBottom,
    /// `top-bottom-half`: the same at half the height.
    TopBottomHalf,
    /// `lines`: two views take turns line by line.
    Lines,
    /// `columns`: two views take turns column by column.
    Columns,
    /// `checkerboard`: two views take turns pixel by pixel.
    Checkerboard,
    /// `views-9` and others: a quilt of views, of any size.
    Views(ViewGrid),
    /// `lenses-9` and others: views interlaced for the lenses of a panel, of the panel's size.
    Lenses(ViewCount),
    /// `anaglyph`: two views in one picture for red-cyan glasses, of any size.
    Anaglyph,
    /// `wiggle`: views one after the other, of any size.
    Wiggle,
    /// `color`: only the picture, of any size.
    Color,
    /// `depth16`: only Z as 16-bit grey, nearest brightest, of any size.
    Depth16,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_live_numbers_are_unique_and_every_layout_is_its_own_row() {
        for (at, info) in Layout::TABLE.iter().enumerate() {
            assert_eq!(info.layout.info().name, info.name);
            assert_eq!(info.name.parse(), Ok(info.layout));
            let others = &Layout::TABLE[at + 1..];
            assert!(others.iter().all(|other| other.name != info.name), "{}", info.name);
            let is_same = |other: &LayoutInfo| info.live_byte.is_some() && other.live_byte == info.live_byte;
            assert!(!others.iter().any(is_same), "{} shares its live number", info.name);
        }
    }
}
