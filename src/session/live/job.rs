//! The next step of a view's render loop.

use std::sync::Arc;
use std::time::Instant;

use super::LiveError;
use super::frame::Echo;
use super::steady_limits::Activity;
use crate::volumes::VolumeEntry;
use relief_display::DisplaySettings;
use relief_live::{Quality, StateMessage};
use relief_render::RenderRequest;

/// A frame that has been published.
#[derive(Clone, Copy)]
pub(super) struct Published {
    pub(super) number: u64,
    pub(super) revision: u64,
    pub(super) is_still: bool,
}

/// A frame to render.
pub(super) struct FrameJob {
    pub(super) request: RenderRequest,
    pub(super) entry: Arc<VolumeEntry>,
    pub(super) display: DisplaySettings,
    pub(super) number: u64,
    pub(super) revision: u64,
    /// The value of `audience` of the view when the job was made.
    pub(super) audience: u64,
    pub(super) is_still: bool,
    pub(super) activity: Activity,
    pub(super) arrived: Instant,
    pub(super) shows: Vec<(u64, Echo)>,
    pub(super) state: StateMessage,
    pub(super) quality: Quality,
    /// Share of width and height for which the presenters' connections have bandwidth, 0 to 1.
    pub(super) share: f64,
    /// Whether the scene has overlays, which are drawn at full size.
    pub(super) keeps_size: bool,
}

/// The next step of the render loop.
pub(super) enum NextStep {
    Render(Box<FrameJob>),
    /// The request of this revision is invalid.
    Failed {
        revision: u64,
        error: LiveError,
    },
    /// There is a frame to render, but no viewer has capacity for it.
    Full,
    /// Nothing to render; look again at this time at the latest.
    Idle(Option<Instant>),
    /// The view has had no viewer for so long that it ends.
    End,
}
