//! Composes the display's frame from a received frame, and checks its header.

use std::sync::Arc;

use super::link::Received;
#[cfg(feature = "window")]
use relief_display::Views;
use relief_display::{
    DisplayProfile, Frame, Header, HeaderReading, Layout, Pixels, ProcessorViews, Synthesize, tracked_eyes,
};
#[cfg(feature = "window")]
use relief_live::EyeViewLimits;
use relief_live::{
    ComposeError, Eyes, FrameError, FrameHeader, LiveLayout, ReceiveError, ReceivedFrame, ReceivedLayers,
    ViewsOutput,
};

/// Composes frames of one session.
#[derive(Clone, Debug)]
pub struct Composer {
    curve: DisplayProfile,
    asked: Option<Header>,
    views: Option<ViewsOutput>,
    maker: Arc<dyn Synthesize>,
    /// Whether views that the server renders replace its own while nothing moves.
    #[cfg(feature = "window")]
    rests_true: bool,
    /// From where a viewer sees the display's own parallax, mm.
    distance_mm: f64,
}

/// A frame of the display.
#[derive(Clone, Debug, PartialEq)]
pub struct Composed {
    /// The header before its pictures.
    pub header: FrameHeader,
    /// The layout of the frame.
    pub layout: Layout,
    /// The frame for the display.
    pub frame: Frame,
    /// The defect of the header, read back from the pixels; `None` if it is correct or the layout
    /// has none.
    pub header_problem: Option<String>,
}

/// Why there is no frame to show.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The received frame is damaged.
    #[error(transparent)]
    Receive(#[from] ReceiveError),
    /// It is whole, but not for a display.
    #[error(transparent)]
    Compose(#[from] ComposeError),
    /// The size or the number of rendered views differs from the request.
    #[error("the size or the number of the server's views differs from the request")]
    NoViews,
}

impl Composer {
    /// For a display with this curve, which converts Z to D if the server sends Z. `asked` is the
    /// expected header of the display; without it, the header that the server sends counts.
    #[must_use]
    pub fn new(curve: DisplayProfile, asked: Option<Header>) -> Self {
        let distance_mm = 2.0 * curve.screen_width_mm();
        Self {
            curve,
            asked,
            views: None,
            maker: Arc::new(ProcessorViews),
            #[cfg(feature = "window")]
            rests_true: true,
            distance_mm,
        }
    }

    /// The same composer for a display that takes views: `maker` makes them here.
    #[must_use]
    pub fn with_views(self, output: ViewsOutput, maker: Arc<dyn Synthesize>) -> Self {
        Self { views: Some(output), maker, ..self }
    }

    /// The same composer, which keeps synthesised views when the picture is at rest.
    #[cfg(feature = "window")]
    #[must_use]
    pub fn with_synthesised_rest(self) -> Self {
        Self { rests_true: false, ..self }
    }

    /// The same composer for viewers at this distance from the screen, mm; twice the width of the
    /// screen without it.
    #[must_use]
    pub fn with_distance_mm(self, distance_mm: f64) -> Self {
        Self { distance_mm, ..self }
    }

    /// Whether its views follow a tracked viewer: those of two eyes do.
    #[must_use]
    pub fn follows_eyes(&self) -> bool {
        self.views.is_some_and(|output| output.layout.view_count() == 2)
    }

    /// The frame of the display, its header row read back.
    ///
    /// # Errors
    /// When the received frame is damaged, or has no layout for a display.
    pub fn compose(&self, received: &Received) -> Result<Composed, PictureError> {
        if let Some(output) = &self.views {
            return self.views(output, &self.layers(output, received)?, None);
        }
        let picture = ReceivedFrame::decode(&received.bytes)?;
        let header = picture.header;
        let LiveLayout::Of(layout) = header.layout else { return Err(ComposeError::NoLayout.into()) };
        let frame = picture.compose(&self.curve)?;
        let header_problem = layout.has_header().then(|| self.header_problem(&header, &frame)).flatten();
        Ok(Composed { header, layout, frame, header_problem })
    }

    /// The layers that the views of a frame are made of; they are made anew for other eyes.
    pub(crate) fn layers(
        &self,
        output: &ViewsOutput,
        received: &Received,
    ) -> Result<ReceivedLayers, PictureError> {
        Ok(ReceivedFrame::decode(&received.bytes)?.layers(&self.curve, output.layout)?)
    }

    /// The views of a frame for these eyes; for a viewer before the middle of the screen without them.
    pub(crate) fn views(
        &self,
        output: &ViewsOutput,
        layers: &ReceivedLayers,
        eyes: Option<&Eyes>,
    ) -> Result<Composed, PictureError> {
        let output = self.tracked(output, eyes);
        let frame = layers.compose_views(&self.curve, &output, self.maker.as_ref())?;
        Ok(Composed { header: layers.header, layout: output.layout, frame, header_problem: None })
    }

    /// The eyes for which a server renders views of a frame at rest; `None` where the views of this
    /// composer stay.
    #[cfg(feature = "window")]
    pub(crate) fn eyes_at_rest(
        &self,
        output: &ViewsOutput,
        layers: &ReceivedLayers,
        eyes: Option<&Eyes>,
    ) -> Option<Vec<f64>> {
        let eyes = layers.eyes(&self.curve, &self.tracked(output, eyes)).ok()?;
        let size_px = layers.header.full_px.map(u32::from);
        let is_rendered = self.rests_true
            && layers.header.still
            && EyeViewLimits::allow_eyes(&eyes)
            && EyeViewLimits::allow_size(size_px, eyes.len());
        is_rendered.then_some(eyes)
    }

    /// The display's frame of views that the server has rendered: `stacked` has one above the other.
    #[cfg(feature = "window")]
    pub(crate) fn rendered(
        &self,
        output: &ViewsOutput,
        header: FrameHeader,
        stacked: &Frame,
    ) -> Result<Composed, PictureError> {
        let size_px = header.full_px.map(u32::from);
        let Pixels::Rgb8(samples) = stacked.pixels() else { return Err(PictureError::NoViews) };
        let pixels = samples.as_chunks::<3>().0.chunks_exact(size_px[0] as usize * size_px[1] as usize);
        if stacked.size_px()[0] != size_px[0] || pixels.len() != output.layout.view_count() {
            return Err(PictureError::NoViews);
        }
        let views = Views::new(size_px, pixels.map(<[_]>::to_vec).collect()).map_err(ComposeError::from)?;
        let frame = output.layout.frame_of_views(&views, &output.panel).map_err(ComposeError::from)?;
        Ok(Composed { header, layout: output.layout, frame, header_problem: None })
    }

    /// The output for the eyes of a tracked viewer, if there are any.
    fn tracked(&self, output: &ViewsOutput, eyes: Option<&Eyes>) -> ViewsOutput {
        let tracked_eyes = eyes.map(|eyes| tracked_eyes(eyes.left_mm, eyes.right_mm, self.distance_mm));
        ViewsOutput { tracked_eyes, ..*output }
    }

    /// The views that it makes; `None` where the display takes the frames themselves.
    #[cfg(feature = "window")]
    pub(crate) const fn output(&self) -> Option<&ViewsOutput> {
        self.views.as_ref()
    }

    fn header_problem(&self, header: &FrameHeader, frame: &Frame) -> Option<String> {
        let expected = match self.asked.map_or_else(|| header.display_header(), Ok) {
            Ok(expected) => expected,
            Err(error @ FrameError::Display(_)) => return Some(error.to_string()),
            Err(error) => return Some(format!("no header to compare with: {error}")),
        };
        let Pixels::Rgb8(samples) = frame.pixels() else { return Some("the frame has no colour".to_owned()) };
        let half = 3 * (frame.size_px()[0] as usize / 2);
        let reading = HeaderReading::of_line(samples.get(..half).unwrap_or_default());
        if let Some(problem) = reading.problems.first() {
            return Some(problem.to_string());
        }
        match reading.header {
            Some(found) if found.fields() == expected.fields() => None,
            Some(found) => {
                Some(format!("H1 to H4 are {:02x?}, asked: {:02x?}", found.fields(), expected.fields()))
            }
            None => Some("the frame has no header".to_owned()),
        }
    }
}
