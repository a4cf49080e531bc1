//! Layouts: the places of the picture and its depth in a frame; packing and unpacking.
//!
//! The names of the layouts, their sizes, [`FrameEncoder`] and [`Layout::decode`]. Files are in
//! `encode`. Pixels are in rows from the top, (x, y) from the top left.
//!
//! [`Layout::TABLE`] lists the layouts.

mod decode;
mod disparity;
pub(super) mod error;
mod frame;
mod given;
mod pack;
pub(super) mod table;

use std::borrow::Cow;
use std::str::FromStr;

use super::filter::DepthFilter;
use super::header::{ExtendedPart, Header};
use super::profile::DisplayProfile;
use super::views::{self, Axis, KeyView, LensPanel, MAX_VIEWS, Parallax, Views, eyes};
use crate::layout::error::LayoutError;
use crate::layout::error::UnknownLayout;
use crate::layout::table::Layout;
use relief_base::DepthLimits;

pub use decode::{DecodedDepth, DecodedFrame};
pub(super) use decode::{depth_problems, odd_and_even_lines};
pub use frame::{DecodedLayer, DisparityLayer, Frame, Picture, Pixels};
pub use table::{BackStart, FrameContent, LayoutInfo, Placement};

/// Default eye separations between the outermost views: of a pair of eyes, and of the cone of views
/// of a display with several viewing places.
const USUAL_SPANS: [f64; 2] = [1.0, 2.0];

/// Views of a wiggle.
const WIGGLE_VIEWS: usize = 9;

/// Packs pictures into the frames of one display: a layout, a profile and a header that fit
/// together, and the depth filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameEncoder {
    layout: Layout,
    profile: DisplayProfile,
    header: Header,
    filter: DepthFilter,
    view_span: Option<f64>,
    tracked: Option<[f64; 2]>,
    panel: LensPanel,
}

impl Layout {
    /// The name in requests and on the command line.
    #[must_use]
    pub fn name(self) -> Cow<'static, str> {
        match self {
            Self::Views(grid) => Cow::Owned(format!("views-{grid}")),
            Self::Lenses(count) => Cow::Owned(format!("lenses-{count}")),
            _ => Cow::Borrowed(self.info().name),
        }
    }

    /// The number of views that a picture is made into; 0 for layouts that carry the picture itself.
    #[must_use]
    pub fn view_count(self) -> usize {
        match self {
            Self::Views(grid) => grid.count() as usize,
            Self::Lenses(count) => count.get() as usize,
            Self::Wiggle => WIGGLE_VIEWS,
            _ if self.arrangement().is_some() => 2,
            _ => 0,
        }
    }

    /// The eyes of its views, with `span` eye separations between the first and the last; `None`
    /// takes 1 for two views and 2 for more.
    #[must_use]
    pub fn eyes(self, span: Option<f64>) -> Vec<f64> {
        eyes(self.view_count(), span.unwrap_or(USUAL_SPANS[usize::from(self.view_count() > 2)]))
    }

    /// Whether a picture of this size can be made into this layout, for those that take any: before
    /// it is rendered.
    ///
    /// # Errors
    /// When its views would have too many pixels, their frame too long a side, or they cannot be
    /// halved.
    pub fn check_size(self, size_px: [u32; 2]) -> Result<(), LayoutError> {
        let Some(arrangement) = self.arrangement() else { return Ok(()) };
        views::check_size(size_px, self.view_count())?;
        let frame_px = arrangement.frame_px(size_px);
        if frame_px.iter().any(|side| *side > super::MAX_FRAME_SIDE_PX) {
            return Err(LayoutError::Size { what: "a quilt", size_px: frame_px });
        }
        let is_odd = |side: u32| !side.is_multiple_of(2);
        match arrangement.even_axis() {
            Some(Axis::Across) if is_odd(size_px[0]) => {
                Err(LayoutError::Odd { layout: self, what: "width", size_px })
            }
            Some(Axis::Down) if is_odd(size_px[1]) => {
                Err(LayoutError::Odd { layout: self, what: "height", size_px })
            }
            _ => Ok(()),
        }
    }

    /// Views in this layout; `panel` is for those of [`Layout::Lenses`].
    ///
    /// # Errors
    /// When the number of views differs from the layout's, the frame is too large, or the
    /// layout is an animation.
    pub fn frame_of_views(self, views: &Views, panel: &LensPanel) -> Result<Frame, LayoutError> {
        pack::pack_views(self, views, panel)
    }

    /// Whether frames carry a header on line 0.
    #[must_use]
    pub fn has_header(self) -> bool {
        self.info().has_header
    }

    /// Whether frames contain a background layer.
    #[must_use]
    pub fn needs_background(self) -> bool {
        self.placement().is_some_and(|placement| placement.back.is_some())
    }

    /// The size at which to render for a display; `None` where the layout takes a picture of any
    /// size.
    #[must_use]
    pub fn render_size_px(self, profile: &DisplayProfile) -> Option<[u32; 2]> {
        let placement = self.placement().filter(|_| self.has_header())?;
        Some(placement.picture_px(profile.frame_px()))
    }

    /// The frame of the displays that this layout is for, where the request names no display.
    pub(super) fn usual_frame_px(self) -> [u32; 2] {
        self.info().frame_px.unwrap_or([1920, 1080])
    }

    /// Whether a display with this profile accepts frames of this layout.
    fn check_profile(self, profile: &DisplayProfile) -> Result<(), LayoutError> {
        let (frame_px, sub_image_px) = (profile.frame_px(), profile.sub_image_px());
        let refuse = |remedy| Err(LayoutError::Profile { layout: self, frame_px, sub_image_px, remedy });
        let Some(placement) = self.placement().filter(|_| self.has_header()) else { return Ok(()) };
        let is_whole = placement.frame_px(placement.picture_px(frame_px)) == frame_px;
        match (self.info().frame_px, placement.frame_lines) {
            (Some(only_px), _) if frame_px != only_px => {
                refuse("it needs frames of 3840x2160, as dimenco-4k has")
            }
            (_, 1) if !is_whole => refuse("it needs an even width"),
            (_, 2) if !is_whole => refuse("it needs an even width and height"),
            (_, 2) if sub_image_px != placement.picture_px(frame_px) => refuse(
                "its sub-images are half as wide and half as high as the frame; use wowvx-4k for dimenco-4k",
            ),
            _ => Ok(()),
        }
    }
}

impl std::fmt::Display for Layout {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(&self.name())
    }
}

impl FromStr for Layout {
    type Err = UnknownLayout;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        if let Some(views) = name.strip_prefix("views-") {
            return views.parse().map(Self::Views).map_err(|()| unknown_layout(name));
        }
        if let Some(count) = name.strip_prefix("lenses-") {
            return count.parse().map(Self::Lenses).map_err(|()| unknown_layout(name));
        }
        Self::ALL.into_iter().find(|layout| layout.name() == name).ok_or_else(|| unknown_layout(name))
    }
}

/// The message for an unknown layout name, shortened to a readable length.
fn unknown_layout(name: &str) -> UnknownLayout {
    let names = Layout::ALL.map(Layout::name).join(", ");
    let shown: String = name.chars().take(40).collect();
    if name.starts_with("views-") {
        let allowed = format!(
            "views-N or views-COLUMNSxROWS with 2 to {MAX_VIEWS} views, such as views-9 or views-9x1"
        );
        return UnknownLayout(format!("no layout {shown:?}; allowed: {allowed}"));
    }
    if name.starts_with("lenses-") {
        return UnknownLayout(format!("no layout {shown:?}; allowed: lenses-N with 2 to {MAX_VIEWS} views"));
    }
    UnknownLayout(format!("no layout {shown:?}; available: {names}"))
}

impl serde::Serialize for Layout {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.name())
    }
}

impl<'de> serde::Deserialize<'de> for Layout {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        name.parse().map_err(serde::de::Error::custom)
    }
}

impl FrameEncoder {
    /// An encoder for frames of `layout` on a display with `profile`; layouts without header ignore
    /// `header`, and those with a background announce it there.
    ///
    /// # Errors
    /// When the layout's frame is not the one the display takes, or the header does not fit into
    /// the left half.
    pub fn new(layout: Layout, profile: DisplayProfile, header: Header) -> Result<Self, LayoutError> {
        layout.check_profile(&profile)?;
        let extended = Some(ExtendedPart::DeclipseFull);
        let header = if layout.needs_background() { Header { extended, ..header } } else { header };
        let half_px = profile.frame_px()[0] / 2;
        if layout.has_header() && half_px < header.width_px() {
            return Err(LayoutError::HeaderWidth { needed_px: header.width_px(), half_px });
        }
        Ok(Self {
            layout,
            profile,
            header,
            filter: DepthFilter::None,
            view_span: None,
            tracked: None,
            panel: LensPanel::default(),
        })
    }

    /// The same encoder with a filter for the depth of its pictures.
    #[must_use]
    pub const fn with_depth_filter(self, filter: DepthFilter) -> Self {
        Self { filter, ..self }
    }

    /// The same encoder with this number of eye separations between the outermost views; `None` is
    /// the layout's default.
    #[must_use]
    pub const fn with_view_span(self, view_span: Option<f64>) -> Self {
        Self { view_span, ..self }
    }

    /// The same encoder for the eyes of a tracked viewer ([`tracked_eyes`](crate::tracked_eyes)).
    /// Layouts of more than two views are seen from several places, and keep theirs.
    #[must_use]
    pub const fn with_tracked_eyes(self, tracked: Option<[f64; 2]>) -> Self {
        Self { tracked, ..self }
    }

    /// The same encoder for the lenses of this panel.
    #[must_use]
    pub const fn with_panel(self, panel: LensPanel) -> Self {
        Self { panel, ..self }
    }

    /// The panel whose lenses views are interlaced for.
    #[must_use]
    pub const fn panel(&self) -> &LensPanel {
        &self.panel
    }

    /// The eyes of the layout's views; none for other layouts.
    #[must_use]
    pub fn eyes(&self) -> Vec<f64> {
        match self.tracked {
            Some(pair) if self.layout.view_count() == 2 => pair.to_vec(),
            _ => self.layout.eyes(self.view_span),
        }
    }

    /// The parallax of pictures of this width.
    #[must_use]
    pub fn parallax(&self, width_px: u32) -> Parallax {
        Parallax::new(&self.profile, self.header.factor, self.header.offset, width_px)
    }

    /// The filter of depth before packing.
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

    /// The views that a display makes of a picture and its disparity, in bytes as it is sent, for
    /// the layout's eyes.
    ///
    /// # Errors
    /// When the layout has no views, or the picture has too many pixels for them.
    pub fn views(&self, picture: &Picture<'_>, limits: DepthLimits) -> Result<Views, LayoutError> {
        let behind = picture.back();
        let disparity = behind.as_ref().map(|back| self.disparity(back, limits)).unwrap_or_default();
        let back = behind.map(|back| DisparityLayer { color: back.color(), disparity: &disparity });
        let front = DisparityLayer { color: picture.color(), disparity: &self.disparity(picture, limits) };
        self.views_of(picture.size_px(), front, back)
    }

    /// A rendered picture as a view of its own, for [`crate::interpolate`]: colour and disparity,
    /// with the eye that it was rendered for (eye separations to the right of the middle).
    #[must_use]
    pub fn key_view(&self, eye: f64, picture: &Picture<'_>, limits: DepthLimits) -> KeyView {
        let color = picture.color().iter().map(|[r, g, b, _]| [*r, *g, *b]).collect();
        KeyView { eye, layer: DecodedLayer { color, disparity: self.disparity(picture, limits) } }
    }

    /// Packs a picture into a frame, its depth filtered and scaled between the limits; a miss
    /// becomes the far limit.
    ///
    /// # Errors
    /// When the picture is not of the size that the layout needs (see
    /// [`FrameEncoder::render_size_px`]), or has no background where the layout needs one.
    pub fn encode(&self, picture: &Picture<'_>, limits: DepthLimits) -> Result<Frame, LayoutError> {
        let size_px = picture.size_px();
        self.expect_size(size_px)?;
        if self.layout == Layout::Depth16 {
            let samples = self.scaled16(picture, limits);
            return Frame::new(size_px, Pixels::Gray16(samples));
        }
        let of = |picture: &Picture<'_>| match self.layout {
            Layout::Color => Vec::new(),
            _ => self.disparity(picture, limits),
        };
        let behind = picture.back().filter(|_| self.takes_background());
        let disparity = behind.as_ref().map(of).unwrap_or_default();
        let back = behind.map(|back| DisparityLayer { color: back.color(), disparity: &disparity });
        let front = DisparityLayer { color: picture.color(), disparity: &of(picture) };
        pack::pack(self, size_px, front, back)
    }

    /// Whether the background layer changes the frames.
    fn takes_background(&self) -> bool {
        self.layout.needs_background() || self.layout.view_count() > 0
    }
}
