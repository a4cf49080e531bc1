//! Composes the display's frame from a received frame, and checks its header.

use super::link::Received;
use relief_display::{DisplayProfile, Frame, Header, HeaderReading, Pixels};
use relief_live::{ComposeError, FrameError, FrameHeader, LiveLayout, ReceiveError, ReceivedFrame};

/// Composes frames of one session.
#[derive(Clone, Debug)]
pub struct Composer {
    curve: DisplayProfile,
    asked: Option<Header>,
}

/// A frame of the display.
#[derive(Clone, Debug, PartialEq)]
pub struct Composed {
    /// The header before its pictures.
    pub header: FrameHeader,
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
        Self { curve, asked }
    }

    /// The frame of the display, its header row read back.
    ///
    /// # Errors
    /// When the received frame is damaged, or has no layout for a display.
    pub fn compose(&self, received: &Received) -> Result<Composed, PictureError> {
        let picture = ReceivedFrame::decode(&received.bytes)?;
        let frame = picture.compose(&self.curve)?;
        let header = picture.header;
        let header_problem = match header.layout {
            LiveLayout::Of(layout) if layout.has_header() => self.header_problem(&header, &frame),
            _ => None,
        };
        Ok(Composed { header, frame, header_problem })
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
