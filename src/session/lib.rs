//! The live core: one thread that renders, a bounded queue before it, and the frames it made last.
//!
//! What it is: [`RenderService`] owns a [`RenderBackend`] on a named thread and returns
//! [`Ticket`]s, futures of frames; [`Views`] are live views that share it through an [`Engine`].
//! What it is not: a network; a ticket can be awaited in any runtime or waited for. Spaces are
//! those of `relief_render`: patient mm, view depth in mm.

mod backend;
mod blocking;
mod budget;
mod cache;
mod detail;
mod drawn;
mod encode;
mod engine;
mod guard;
mod healing;
mod label_maps;
mod live;
mod service;
mod thumbnail;
mod ticket;
mod volumes;
mod waiting;

use std::ops::ControlFlow;
use std::sync::Arc;

use relief_render::{MemoryUse, Progress, RenderRequest, RenderedFrame};
use relief_volume::{ContentHash, Volume};

pub use backend::{FaultKind, GpuBackend, InjectedFault};
pub use blocking::{JobError, Waiting, on_blocking_thread, while_awaited};
pub use budget::{BudgetedRequest, SpeedBook};
pub use detail::moving_detail;
pub use drawn::{ContentError, Drawables, LeftOutCounts, SurfaceMesh, region_of_content, shape_of_content};
pub use encode::{EncodingError, FileFormat, Product, encode};
pub use engine::Engine;
pub use label_maps::{LabelsError, PlacedLabels, load_labels, most_label_voxels};
pub use live::{
    Delays, DrawableSource, DrawablesWanted, Echo, EditContext, Effect, EncodedParts, EyeViews, Flow,
    HeldPoint, LiveError, OpenError, Outcome, Pace, Presentation, USUAL_QUALITY, View, ViewFrame, Viewer,
    Views, find_phase, micros, search_preview,
};
pub use service::{QueueConfig, RenderService, ServiceCounts};
pub use thumbnail::{THUMBNAIL_SIZE_PX, Thumbnail, contact_sheet, thumbnail_scene};
pub use ticket::Ticket;
pub use volumes::{
    Added, HostMemory, LoadedVolume, MemoryFull, NameSource, ReadError, UploadRefused, UploadedVolumes,
    VolumeEntry, VolumeError, VolumeReader, Volumes,
};

/// Turns requests into frames. Only the service's thread calls it.
pub trait RenderBackend: Send + 'static {
    /// Renders one picture. Call `goes_on` whenever the work can be cancelled, if possible ten
    /// times a second; it breaks once the client has left.
    ///
    /// # Errors
    /// When this request cannot be rendered; the service answers with the error and continues.
    fn render(
        &mut self,
        volume: &Volume,
        request: &RenderRequest,
        goes_on: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<RenderedFrame, BackendError>;

    /// Says before a render whether other callers are there: if so, `goes_on` should be called often,
    /// though that makes a picture slower.
    fn expect_others(&mut self, _are_there: bool) {}

    /// Whether [`RenderBackend::renew`] can help after a failure.
    fn can_be_renewed(&self) -> bool {
        false
    }

    /// Recreates the backend after it failed, and renders a picture to see that it works.
    ///
    /// # Errors
    /// When it still fails.
    fn renew(&mut self) -> Result<(), BackendError> {
        Ok(())
    }

    /// Drops everything that is kept of this volume. A backend that keeps nothing between renders
    /// needs none.
    fn forget(&mut self, _volume: ContentHash) {}

    /// Memory of volumes on the adapter; zero for a backend that keeps nothing.
    fn memory(&self) -> MemoryUse {
        MemoryUse::default()
    }
}

/// Why a backend gave no frame.
#[derive(Debug, thiserror::Error)]
pub enum BackendError {
    /// The request asks for more than this adapter has; the message says which limit and what to
    /// do.
    #[error("{0}")]
    Refused(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The request was cancelled: its ticket was dropped.
    #[error("the picture was cancelled")]
    Cancelled,
    /// The adapter or the driver failed.
    #[error("rendering failed: {0}")]
    Failed(#[source] Box<dyn std::error::Error + Send + Sync>),
}

/// Why the service gave no frame.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError {
    /// The queue is full.
    #[error("{0} pictures are waiting already; try again soon")]
    Busy(usize),
    /// The render thread has ended.
    #[error("the render thread has ended")]
    Stopped,
    /// Rendering this request panicked; the thread continues.
    #[error("rendering panicked: {0}")]
    Panicked(String),
    /// The backend refused or failed.
    #[error(transparent)]
    Backend(#[from] BackendError),
}

/// A frame and where its time went.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// The frame, shared with the service's memory of recent ones.
    pub frame: Arc<RenderedFrame>,
    /// Time from the order to the start of its rendering, ms.
    pub queue_ms: f64,
    /// Whether the frame was rendered for this order.
    pub origin: Origin,
}

/// Whether a frame had to be rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// Rendered for this order.
    Rendered,
    /// Made for an equal order shortly before: another encoding of it, or a pick in it.
    Reused,
}

#[cfg(test)]
mod tests;
