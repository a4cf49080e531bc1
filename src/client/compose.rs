//! Composes the display's frame from a received frame, and checks its header.

use super::link::Received;
use relief_display::{DisplayProfile, Frame, Header, HeaderReading, Layout, Pixels};
use relief_live::{
    ComposeError, FrameError, FrameHeader, LiveLayout, ReceiveError, ReceivedFrame, ViewsOutput,
};

/// Composes frames of one session.
#[derive(Clone, Debug)]
pub struct Composer {
    curve: DisplayProfile,
    asked: Option<Header>,
    views: Option<ViewsOutput>,
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
}

impl Composer {
    /// For a display with this curve, which converts Z to D if the server sends Z. `asked` is the
    /// expected header of the display; without it, the header that the server sends counts.
    #[must_use]
    pub const fn new(curve: DisplayProfile, asked: Option<Header>) -> Self {
        Self { curve, asked, views: None }
    }

    /// The same composer for a display that takes views: they are made here.
    #[must_use]
    pub const fn with_views(self, views: Option<ViewsOutput>) -> Self {
        Self { views, ..self }
    }

    /// The frame of the display, its header row read back.
    ///
    /// # Errors
    /// When the received frame is damaged, or has no layout for a display.
    pub fn compose(&self, received: &Received) -> Result<Composed, PictureError> {
        let picture = ReceivedFrame::decode(&received.bytes)?;
        let header = picture.header;
        if let Some(output) = &self.views {
            let frame = picture.compose_views(&self.curve, output)?;
            return Ok(Composed { header, layout: output.layout, frame, header_problem: None });
        }
        let LiveLayout::Of(layout) = header.layout else { return Err(ComposeError::NoLayout.into()) };
        let frame = picture.compose(&self.curve)?;
        let header_problem = layout.has_header().then(|| self.header_problem(&header, &frame)).flatten();
        Ok(Composed { header, layout, frame, header_problem })
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
