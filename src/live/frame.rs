//! Whole frames: header, colour and depth in one message, and out of it again; and the display's
//! frame composed from them.
//!
//! A client composes what its display takes itself, header last, so that no bit of it travels
//! through a lossy codec: [`ReceivedFrame::compose`] gives, for a still frame whose colour is
//! lossless, the pixels that `GET /v1/volumes/{id}/frame` serves as PNG for the same scene.

use super::codec::{self, CodecError};
use super::format::{ColorFormat, DepthFormat, LiveLayout};
use super::header::{FrameError, FrameHeader, HEADER_BYTES};
use relief_base::{DepthLimits, ScaledDepth};
use relief_display::{
    DecodedLayer, DisparityConstants, DisparityLayer, DisplayProfile, Frame, FrameEncoder, Layout,
    LayoutError, LensPanel, MAX_FRAME_SIDE_PX, ProfileError, Synthesize,
};

/// Most pixels of a picture that is received, as sent and enlarged: memory of a client.
pub const MAX_PIXELS: usize = 1 << 24;

/// Colour of a picture, written once and shared by all clients that take this format.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EncodedColor {
    /// How it is written.
    pub format: ColorFormat,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// Depth of a picture, written once.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EncodedDepth {
    /// How it is written.
    pub format: DepthFormat,
    /// Its bytes; none of format `none`.
    pub bytes: Vec<u8>,
}

/// A frame as received: header, and colour and depth unpacked.
#[derive(Clone, Debug, PartialEq)]
pub struct ReceivedFrame {
    /// The frame's header.
    pub header: FrameHeader,
    /// Red, green and blue of every pixel, in rows from the top. The rows of the background layer
    /// follow, where the layout has one.
    pub color: Vec<[u8; 3]>,
    /// Depth of every pixel, in the same rows.
    pub depth: ReceivedDepth,
}

/// The views that a client makes of a picture and its disparity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewsOutput {
    /// Their number, and their places in the frame.
    pub layout: Layout,
    /// The panel, for layouts of lenses.
    pub panel: LensPanel,
    /// Eye separations between the outermost views; `None` is the layout's default.
    pub view_span: Option<f64>,
    /// The view cone, degrees. It replaces the eye separations. `None` is the view cone of the panel, if
    /// it has one.
    pub view_cone_deg: Option<f64>,
    /// The eyes of a tracked viewer, for layouts of two views; `None` stands for a viewer before the
    /// middle of the screen.
    pub tracked_eyes: Option<[f64; 2]>,
}

impl ViewsOutput {
    fn view_cone(&self) -> Option<f64> {
        self.view_cone_deg.or(self.panel.view_cone_deg.filter(|_| self.view_span.is_none()))
    }
}

/// The layers that views are made of: a picture and its disparity in full size, and the background
/// layer where there is one.
#[derive(Clone, Debug, PartialEq)]
pub struct ReceivedLayers {
    /// The frame's header.
    pub header: FrameHeader,
    front: DecodedLayer,
    back: Option<DecodedLayer>,
}

/// Depth as received.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ReceivedDepth {
    /// None was sent.
    None,
    /// D, 255 nearest.
    Disparity(Vec<u8>),
    /// Z, 65535 nearest.
    Scaled16(Vec<u16>),
}

/// Why a frame could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ReceiveError {
    /// The header is invalid, or does not match the data after it.
    #[error(transparent)]
    Header(#[from] FrameError),
    /// Colour or depth is damaged.
    #[error(transparent)]
    Codec(#[from] CodecError),
}

/// Why there is no frame for a display.
#[derive(Debug, thiserror::Error)]
pub enum ComposeError {
    /// The frame is for no display's layout.
    #[error("the layout of the frame cannot be composed")]
    NoLayout,
    /// The layout needs depth.
    #[error("layout {0} needs depth, and the frame has none: accept a depth format in hello")]
    NoDepth(Layout),
    /// The display's frame would be larger than any.
    #[error(transparent)]
    Profile(#[from] ProfileError),
    /// The picture does not fit the layout.
    #[error(transparent)]
    Layout(#[from] LayoutError),
    /// The display's header is invalid.
    #[error(transparent)]
    Header(#[from] FrameError),
}

/// The bytes of a frame. The header's formats and lengths are set here.
#[must_use]
pub fn assemble(header: &FrameHeader, color: &EncodedColor, depth: &EncodedDepth) -> Vec<u8> {
    let length = |bytes: &[u8]| u32::try_from(bytes.len()).unwrap_or(u32::MAX);
    let header = FrameHeader {
        color: color.format,
        depth: depth.format,
        color_bytes: length(&color.bytes),
        depth_bytes: length(&depth.bytes),
        ..*header
    };
    let mut frame = Vec::with_capacity(HEADER_BYTES + color.bytes.len() + depth.bytes.len());
    frame.extend(header.encode());
    frame.extend(&color.bytes);
    frame.extend(&depth.bytes);
    frame
}

/// Colour and depth of a frame as they lie in its bytes.
#[derive(Clone, Copy, Debug)]
pub struct Parts<'a> {
    /// The bytes before them.
    pub header: FrameHeader,
    /// Colour, packed.
    pub color: &'a [u8],
    /// Depth, packed.
    pub depth: &'a [u8],
}

impl<'a> Parts<'a> {
    /// Takes a frame apart without unpacking anything: all that a client that only counts needs.
    ///
    /// # Errors
    /// When the header is invalid, or the number of bytes differs from the header's
    /// lengths.
    pub fn of(frame: &'a [u8]) -> Result<Self, FrameError> {
        let header = FrameHeader::decode(frame)?;
        let wrong = FrameError::Length { found: frame.len() as u64, expected: header.frame_bytes() };
        if frame.len() as u64 != header.frame_bytes() {
            return Err(wrong);
        }
        let payload = frame.get(HEADER_BYTES..).unwrap_or_default();
        let (color, depth) = payload.split_at_checked(header.color_bytes as usize).ok_or(wrong)?;
        Ok(Self { header, color, depth })
    }
}

impl ReceivedFrame {
    /// Reads a frame.
    ///
    /// # Errors
    /// When the frame is invalid or damaged. Accepts any bytes, and allocates memory for
    /// at most [`MAX_PIXELS`].
    pub fn decode(frame: &[u8]) -> Result<Self, ReceiveError> {
        let Parts { header, color, depth } = Parts::of(frame)?;
        for (field, pixels) in [("size_px", header.pixels()), ("full_px", header.full_pixels())] {
            if pixels > MAX_PIXELS {
                let (found, allowed) = (pixels as u64, "at most 16777216 pixels");
                return Err(FrameError::Field { field, found, allowed }.into());
            }
        }
        let size = [usize::from(header.size_px[0]), header.rows()];
        let color = codec::decode_color(size, color, header.color)?;
        let depth = match header.depth {
            DepthFormat::None => ReceivedDepth::None,
            format if format.is_z16() => ReceivedDepth::Scaled16(codec::decode_z16(size, depth, format)?),
            format => ReceivedDepth::Disparity(codec::decode_d8(size, depth, format)?),
        };
        Ok(Self { header, color, depth })
    }

    /// The frame of the display: picture and disparity placed by the layout, with the header on
    /// top. A reduced picture is first enlarged to its full size by nearest-pixel sampling, in
    /// colour and in depth.
    ///
    /// `curve` makes D of Z where Z was sent; D that was sent is used unchanged.
    ///
    /// # Errors
    /// When the frame is for no layout, has no depth where that needs one, or does not fit it.
    pub fn compose(&self, curve: &DisplayProfile) -> Result<Frame, ComposeError> {
        let LiveLayout::Of(layout) = self.header.layout else { return Err(ComposeError::NoLayout) };
        let full_px = self.header.full_px.map(u32::from);
        let encoder = FrameEncoder::new(layout, profile_of(layout, full_px)?, self.header.display_header()?)?;
        self.pack(&encoder, curve)
    }

    /// The layers that a display's views are made of. `layout` is named in the error.
    ///
    /// # Errors
    /// When the frame has no depth where the layout needs one.
    pub fn layers(&self, curve: &DisplayProfile, layout: Layout) -> Result<ReceivedLayers, ComposeError> {
        let disparity = match &self.depth {
            ReceivedDepth::Disparity(disparity) => disparity.clone(),
            ReceivedDepth::Scaled16(scaled) => scaled.iter().map(|z| disparity_of(*z, curve)).collect(),
            ReceivedDepth::None if layout == Layout::Color => vec![0; self.color.len()],
            ReceivedDepth::None => return Err(ComposeError::NoDepth(layout)),
        };
        let count = if self.header.back_layer { 2 } else { 1 };
        let each = self.color.len() / count;
        let layer = |at: usize| {
            let part = at * each..(at + 1) * each;
            DecodedLayer {
                color: self.enlarged(&self.color[part.clone()]),
                disparity: self.enlarged(&disparity[part]),
            }
        };
        Ok(ReceivedLayers { header: self.header, front: layer(0), back: (count > 1).then(|| layer(1)) })
    }

    fn pack(&self, encoder: &FrameEncoder, curve: &DisplayProfile) -> Result<Frame, ComposeError> {
        let ReceivedLayers { header, front, back } = self.layers(curve, encoder.layout())?;
        fn of(layer: &DecodedLayer) -> DisparityLayer<'_, 3> {
            DisparityLayer { color: &layer.color, disparity: &layer.disparity }
        }
        Ok(encoder.pack(header.full_px.map(u32::from), of(&front), back.as_ref().map(of))?)
    }

    /// Rows of the size sent, as rows of the full size.
    fn enlarged<T: Copy>(&self, values: &[T]) -> Vec<T> {
        let [from, to] = [self.header.size_px, self.header.full_px].map(|size| size.map(usize::from));
        if from == to {
            return values.to_vec();
        }
        // The pixel that the centre lies in.
        let place = |at: usize, axis: usize| (2 * at + 1) * from[axis] / (2 * to[axis]);
        let columns: Vec<usize> = (0..to[0]).map(|x| place(x, 0)).collect();
        let mut out = Vec::with_capacity(to[0] * to[1]);
        for y in 0..to[1] {
            // Rows that come of one row are equal: they are copied, not looked up again.
            if y > 0 && place(y, 1) == place(y - 1, 1) {
                out.extend_from_within(out.len() - to[0]..);
            } else {
                let row = &values[place(y, 1) * from[0]..][..from[0]];
                out.extend(columns.iter().map(|&x| row[x]));
            }
        }
        out
    }
}

impl ReceivedLayers {
    /// The frame of a display that takes views: made by `maker` of the picture and its disparity, and
    /// of the back layer if there is one. `curve` is the display whose parallax they have.
    ///
    /// # Errors
    /// When `output` has no views or is an animation, the picture does not fit it, or the display's
    /// header is invalid.
    pub fn compose_views(
        &self,
        curve: &DisplayProfile,
        output: &ViewsOutput,
        maker: &dyn Synthesize,
    ) -> Result<Frame, ComposeError> {
        let encoder = self.encoder(curve, output)?;
        let size_px = self.header.full_px.map(u32::from);
        output.layout.check_size(size_px)?;
        let parallax = encoder.parallax(size_px[0]);
        let views = maker.views(size_px, &self.front, self.back.as_ref(), &parallax, &encoder.eyes())?;
        Ok(output.layout.frame_of_views(&views, &output.panel)?)
    }

    /// The eyes of the output's views, in eye separations to the right of the middle.
    ///
    /// # Errors
    /// When the display's header is invalid.
    pub fn eyes(&self, curve: &DisplayProfile, output: &ViewsOutput) -> Result<Vec<f64>, ComposeError> {
        Ok(self.encoder(curve, output)?.eyes())
    }

    fn encoder(&self, curve: &DisplayProfile, output: &ViewsOutput) -> Result<FrameEncoder, ComposeError> {
        let encoder = FrameEncoder::new(output.layout, *curve, self.header.display_header()?)?;
        let span = output.view_cone().map_or(output.view_span, |cone_deg| self.span_of(&encoder, cone_deg));
        Ok(encoder.with_view_span(span).with_tracked_eyes(output.tracked_eyes))
    }

    /// The eye separations between the outermost views of a cone; `None` if the screen is behind the
    /// camera.
    fn span_of(&self, encoder: &FrameEncoder, cone_deg: f64) -> Option<f64> {
        let size_px = self.header.full_px.map(u32::from);
        let [near_mm, far_mm] = self.header.limits_mm.map(f64::from);
        let [half_width, _] = self.header.camera().ok()?.half_extent(size_px);
        let limits = DepthLimits { near_mm, far_mm };
        let setup = encoder.parallax(size_px[0]).true_views(limits, half_width, size_px[0])?;
        Some(setup.span_of_cone(cone_deg))
    }
}

/// A display whose frame holds pictures of this size in this layout. Its curve is of no use: D is
/// known.
fn profile_of(layout: Layout, [width, height]: [u32; 2]) -> Result<DisplayProfile, ProfileError> {
    let picture_px = [width, height];
    let frame_px = layout.placement().map_or(picture_px, |placement| placement.frame_px(picture_px));
    // The layouts `rgbd` and `color` accept any size.
    let frame_px =
        if layout.has_header() { frame_px } else { frame_px.map(|side| side.min(MAX_FRAME_SIDE_PX)) };
    DisplayProfile::new(frame_px, [width, height], DisparityConstants::PHILIPS_42)
}

/// D of Z in 16 bits.
fn disparity_of(z: u16, curve: &DisplayProfile) -> u8 {
    curve.disparity(ScaledDepth(1.0 - f64::from(z) / 65535.0)).to_byte()
}
