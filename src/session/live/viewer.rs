//! A viewer of a view: the newest message that came from it, and its capacity for frames.

use std::sync::Arc;
use std::time::Instant;

use parking_lot::{Mutex, MutexGuard};
use tokio::sync::Notify;

use super::frame::Echo;
use super::pace::Pace;
use relief_live::{MAX_IN_FLIGHT, Role};

/// A client that watches a view.
#[derive(Debug)]
pub struct Viewer {
    /// Number of the viewer, unique within the server.
    pub id: u64,
    /// Whether it may change the view.
    pub role: Role,
    /// Whether it sends no acknowledgements (MJPEG, single frames).
    pub is_plain: bool,
    /// The verified name of its user; `None` on an open server.
    pub reader: Option<String>,
    flow: Mutex<Flow>,
    /// Notified when the viewer has capacity again.
    pub freed: Notify,
}

/// Flow control of a viewer.
#[derive(Debug)]
pub struct Flow {
    /// Frames in flight and the quality that the connection carries.
    pub pace: Pace,
    /// Number of the newest frame that was taken.
    pub taken: u64,
    /// Whether a frame is being encoded or handed over.
    pub is_busy: bool,
    pub(super) echo: Option<Echo>,
    /// Whether a frame has shown the newest message.
    pub(super) is_shown: bool,
    last_pose: Option<u64>,
}

impl Viewer {
    /// A viewer without messages.
    #[must_use]
    pub fn new(id: u64, role: Role, is_plain: bool, reader: Option<String>, now: Instant) -> Arc<Self> {
        let flow = Flow {
            pace: Pace::new(now),
            taken: 0,
            is_busy: false,
            echo: None,
            is_shown: true,
            last_pose: None,
        };
        Arc::new(Self { id, role, is_plain, reader, flow: Mutex::new(flow), freed: Notify::new() })
    }

    /// Flow control, locked.
    pub fn flow(&self) -> MutexGuard<'_, Flow> {
        self.flow.lock()
    }

    /// Stores the newest message; true where no frame showed the message before it.
    pub(super) fn received(&self, echo: Echo) -> bool {
        let mut flow = self.flow();
        flow.echo = Some(echo);
        !std::mem::replace(&mut flow.is_shown, false)
    }

    /// Whether a pose is newer than all before it.
    #[must_use]
    pub fn is_newer(&self, seq: u64) -> bool {
        let mut flow = self.flow();
        let newer = flow.last_pose.is_none_or(|last| seq > last);
        if newer {
            flow.last_pose = Some(seq);
        }
        newer
    }
}

impl Flow {
    /// Whether another frame may be encoded.
    #[must_use]
    pub fn has_capacity(&self) -> bool {
        self.pace.in_flight() + usize::from(self.is_busy) < MAX_IN_FLIGHT
    }
}
