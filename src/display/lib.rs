//! From a picture with view depth to the bytes that a glasses-free 3D display takes, and back.
//!
//! Display profiles and their curve D(Z), the WoWvx header, layouts with their encoders and
//! decoders, PNG, JPEG and OpenEXR files, and a strict inspection of frames. This crate renders
//! nothing and has no GPU, camera or volume; it converts slices to bytes.
//!
//! [`DisplaySettings`] (the request's JSON) becomes a [`FrameEncoder`]. The encoder gives the size
//! to render, filters the depth ([`DepthFilter`]) and packs a [`Picture`] into a [`Frame`].
//! [`encode_png`] makes a file of the frame, [`inspect_png`] reports a file's content. Layouts of
//! views show the effect of a 3D display on an ordinary one. Depth enters as view depth in mm, is
//! scaled to Z between [`relief_base::DepthLimits`], and leaves as disparity bytes D (255 nearest)
//! or as 16-bit Z.

mod depth_range;
mod encode;
mod filter;
mod header;
mod inspect;
mod layout;
mod limits;
mod matching;
mod problem;
mod profile;
mod screen_plane;
mod settings;
mod shrink;
mod views;

pub use crate::layout::error::LayoutError;
pub use crate::layout::error::UnknownLayout;
pub use crate::layout::table::Layout;
pub use crate::limits::MAX_FRAME_SIDE_PX;
pub use depth_range::{DepthRange, visible_limits};
pub use encode::{
    Attribute, CameraMatrices, DecodedDepthImage, DepthImage, EncodeError, decode_exr, decode_wiggle,
    encode_exr, encode_jpeg, encode_png, encode_views,
};
pub use filter::{DepthFilter, grounded_depth};
pub use header::{ContentType, ExtendedPart, Header, HeaderPart, HeaderProblem, HeaderReading};
pub use inspect::{
    DepthExtent, FrameReport, InspectError, Select, ViewsReport, inspect_frame, inspect_png, read_png,
};
pub use layout::{
    BackStart, DecodedDepth, DecodedFrame, DecodedLayer, DisparityLayer, Frame, FrameContent, FrameEncoder,
    LayoutInfo, Picture, Pixels, Placement,
};
pub use matching::{HiddenLayer, SideView, disparity_for_views, hidden_layer, side_size_px};
pub use problem::FrameProblem;
pub use profile::{DisparityConstants, DisplayProfile, ProfileError, ProfileName};
pub use screen_plane::ScreenPlane;
pub use settings::{DisplaySettings, ProfileSetting, VIEW_SPANS};
pub use shrink::shrunk_rgb;
pub use views::{
    Arrangement, Axis, KeyView, LensPanel, MAX_VIEWS, PanelError, Parallax, ProcessorViews, QuiltName,
    Subpixels, Synthesize, TrueViews, Turns, USUAL_VIEW_CONE_DEG, VIEW_CONES_DEG, ViewCount, ViewGrid, Views,
    anaglyph, check_layers, eyes, interpolate, psnr_db, synthesize, tracked_eyes,
};
