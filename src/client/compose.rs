//! From a received frame to what the display takes, and whether its header came out right.

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
    /// What came before its pictures.
    pub header: FrameHeader,
    /// What the display takes.
    pub frame: Frame,
    /// What is wrong with the header row, read back out of the pixels; `None` where all is well, or where the layout has none.
    pub header_problem: Option<String>,
}

/// Why there is no frame to show.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// What was received is damaged.
    #[error(transparent)]
    Receive(#[from] ReceiveError),
    /// It is whole, but not for a display.
    #[error(transparent)]
    Compose(#[from] ComposeError),
}

impl Composer {
    /// For a display with this curve, which makes D of Z where the server sends Z. `asked` is what the display's header was
    /// asked to say; without it, what the server sends is right.
    #[must_use]
    pub const fn new(curve: DisplayProfile, asked: Option<Header>) -> Self {
        Self { curve, asked }
    }

    /// The frame of the display, its header row read back.
    ///
    /// # Errors
    /// When what was received is damaged, or for no display's layout.
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
            None => Some("there is none".to_owned()),
        }
    }
}
