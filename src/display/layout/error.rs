//! Why a layout does not fit.

use crate::layout::table::Layout;

/// A name that is no layout.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct UnknownLayout(pub(super) String);

/// A layout that does not fit its input.
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
        /// A remedy.
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
    /// The layout needs a background layer.
    #[error("layout {layout} needs a back layer: render with depth rule views or two-layer")]
    NoBackground {
        /// The layout.
        layout: Layout,
    },
    /// The layout carries no disparity.
    #[error("layout {layout} stores Z, not disparity, so disparity cannot be packed into it")]
    NoDisparity {
        /// The layout.
        layout: Layout,
    },
    /// A picture or frame whose pixels do not fill its size, or with no pixels, or too many.
    #[error("{what} of {}x{} has {found} values, expected {expected}", size_px[0], size_px[1])]
    PixelCount {
        /// The value.
        what: &'static str,
        /// Its size.
        size_px: [u32; 2],
        /// Values there.
        found: usize,
        /// Values for this size.
        expected: usize,
    },
    /// More pixels than the limit.
    #[error(
        "{count} views of {}x{}; allowed: 1 to 128 views, 67108864 pixels in all", size_px[0], size_px[1]
    )]
    ViewPixels {
        /// The number of views.
        count: usize,
        /// The size of each.
        size_px: [u32; 2],
    },
    /// A number of views that differs from the layout's.
    #[error("layout {layout} has {} views, found {found}", layout.view_count())]
    ViewCount {
        /// The layout.
        layout: Layout,
        /// The number found.
        found: usize,
    },
    /// Views that the layout halves, or that take turns, with an odd side.
    #[error("layout {layout} needs an even {what}, found {}x{}", size_px[0], size_px[1])]
    Odd {
        /// The layout.
        layout: Layout,
        /// Width or height.
        what: &'static str,
        /// The size of a view.
        size_px: [u32; 2],
    },
    /// An animation is no frame.
    #[error("layout wiggle is an animation: write its views to a file, not to a frame")]
    Animation,
    /// A side of 0 or above the limit.
    #[error("{what} is {}x{}; allowed: 1 to 16384 pixels each way", size_px[0], size_px[1])]
    Size {
        /// The value.
        what: &'static str,
        /// Its size.
        size_px: [u32; 2],
    },
}
