//! What a view tells its director: the picture to be made next, or what to wait for.

use std::sync::Arc;
use std::time::Instant;

use super::shot::Echo;
use crate::problem::Problem;
use crate::volumes::Entry;
use relief_display::DisplaySettings;
use relief_live::Quality;
use relief_render::RenderRequest;

/// A picture that was made.
#[derive(Clone, Copy)]
pub(super) struct Published {
    pub(super) number: u64,
    pub(super) revision: u64,
    pub(super) is_still: bool,
}

/// A picture to be made.
pub(super) struct Order {
    pub(super) request: RenderRequest,
    pub(super) entry: Arc<Entry>,
    pub(super) display: DisplaySettings,
    pub(super) number: u64,
    pub(super) revision: u64,
    pub(super) is_still: bool,
    pub(super) arrived: Instant,
    pub(super) shows: Vec<(u64, Echo)>,
    pub(super) state: Arc<str>,
    pub(super) quality: Quality,
    /// Share of width and height that the presenters' connections have room for.
    pub(super) share: f64,
    /// Whether the scene's own overlays have to be drawn at full size.
    pub(super) keeps_size: bool,
}

/// What a director does next.
pub(super) enum Next {
    Render(Box<Order>),
    /// The picture of this revision cannot be made. By now there may be another revision.
    Failed {
        revision: u64,
        problem: Problem,
    },
    /// There is a picture to be made, and nobody has room for it.
    Full,
    /// There is nothing to do, until then at most.
    Idle(Option<Instant>),
    /// Nobody has looked for so long that nobody will.
    End,
}
