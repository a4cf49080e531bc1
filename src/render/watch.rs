//! Progress and cancellation of a picture in progress.

use std::ops::ControlFlow;

use super::error::RenderError;

/// The progress of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// Bands that are done, all passes and the depth of a path-traced picture included.
    pub bands: u64,
    /// Passes that are done, of mode path-traced; those that were there from before count.
    pub passes: u32,
    /// Of those, the passes that were there from before.
    pub continued: u32,
    /// Whether an equal request would continue here, if the picture is cancelled now.
    pub is_kept: bool,
}

/// Follows one picture: counts completed work, and asks after every band whether to continue.
pub(super) struct Watch<'a> {
    progress: Progress,
    goes_on: &'a mut dyn FnMut(Progress) -> ControlFlow<()>,
}

impl<'a> Watch<'a> {
    pub(super) fn new(goes_on: &'a mut dyn FnMut(Progress) -> ControlFlow<()>) -> Self {
        Self { progress: Progress::default(), goes_on }
    }

    /// One more band is done. `is_kept` says whether its pixels are kept if the picture is cancelled.
    pub(super) fn band_done(&mut self, is_kept: bool) -> Result<(), RenderError> {
        self.progress.bands += 1;
        self.progress.is_kept = is_kept;
        self.ask()
    }

    /// Sets the number of passes from before this call.
    pub(super) fn continues(&mut self, passes: u32) {
        self.progress.continued = passes;
    }

    /// Sets the number of passes that are done.
    pub(super) fn passes_done(&mut self, passes: u32) -> Result<(), RenderError> {
        self.progress.passes = passes;
        self.progress.is_kept = true;
        self.ask()
    }

    fn ask(&mut self) -> Result<(), RenderError> {
        match (self.goes_on)(self.progress) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(RenderError::Cancelled),
        }
    }
}
