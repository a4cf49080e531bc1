//! Somebody who looks at a view: what was heard from there, and how much room there is.

use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Instant;

use tokio::sync::Notify;

use super::pace::Pace;
use super::shot::Echo;
use super::view::lock;
use relief_live::{MAX_IN_FLIGHT, Role};

/// Somebody who looks at a view.
pub(super) struct Slot {
    pub(super) id: u64,
    pub(super) role: Role,
    /// Without acknowledgements: plain viewers.
    pub(super) is_plain: bool,
    flow: Mutex<Flow>,
    /// Tells the writer that there is room.
    pub(super) freed: Notify,
}

pub(super) struct Flow {
    pub(super) pace: Pace,
    /// Number of the newest picture that was taken.
    pub(super) taken: u64,
    /// Whether one is being encoded or handed over.
    pub(super) is_busy: bool,
    pub(super) echo: Option<Echo>,
    /// Whether a picture has shown the newest message.
    pub(super) is_shown: bool,
    last_pose: Option<u64>,
}

impl Slot {
    pub(super) fn new(id: u64, role: Role, is_plain: bool, now: Instant) -> Arc<Self> {
        let flow = Flow {
            pace: Pace::new(now),
            taken: 0,
            is_busy: false,
            echo: None,
            is_shown: true,
            last_pose: None,
        };
        Arc::new(Self { id, role, is_plain, flow: Mutex::new(flow), freed: Notify::new() })
    }

    pub(super) fn flow(&self) -> MutexGuard<'_, Flow> {
        lock(&self.flow)
    }

    /// Remembers the newest message; true where no picture showed the one before it.
    pub(super) fn heard(&self, echo: Echo) -> bool {
        let mut flow = self.flow();
        flow.echo = Some(echo);
        !std::mem::replace(&mut flow.is_shown, false)
    }

    /// Whether a pose is newer than all before it.
    pub(super) fn is_newer(&self, seq: u64) -> bool {
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
    pub(super) fn has_room(&self) -> bool {
        self.pace.in_flight() + usize::from(self.is_busy) < MAX_IN_FLIGHT
    }
}
