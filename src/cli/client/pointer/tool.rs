//! The tool of a tracker: its poses move the hand of a view, like those of a Wiimote.

use std::path::Path;
use std::time::{Duration, Instant};

use relief_client::Handle;
use relief_live::{PoseKind, RemotePose};
use relief_tracking::{Buttons, SensorPose, ToolPlacement, TrackingState};

use crate::tool_placement::read_placement;

/// After this time without a pose the tool counts as lost.
pub(super) const SILENT: Duration = Duration::from_millis(500);

/// A tool that a tracker reports.
pub(super) struct Tool {
    placement: ToolPlacement,
    handle: Handle,
    /// The newest pose, before the display, and its time.
    seen: Option<(SensorPose, Instant)>,
    has_reported: bool,
}

impl Tool {
    /// A tool with the axes that a file describes, or the default ones.
    pub(super) fn new(geometry: Option<&Path>, handle: &Handle) -> anyhow::Result<Self> {
        let placement = read_placement(geometry)?;
        handle.attach_tool();
        Ok(Self { placement, handle: handle.clone(), seen: None, has_reported: false })
    }

    pub(super) fn is_stopped(&self) -> bool {
        self.handle.is_stopped()
    }

    /// Sends a new pose, in the tracker's axes.
    pub(super) fn moved(&mut self, pose: &SensorPose) {
        self.seen = Some((self.placement.place(pose), Instant::now()));
        self.send();
    }

    /// Sends a lost tool when its last pose is too old. Other tools and messages may go on while this
    /// tool is out of sight.
    pub(super) fn check_silence(&mut self) {
        if self.seen.is_some_and(|(_, since)| since.elapsed() > SILENT) {
            self.lost();
        }
    }

    /// Sends a lost tool.
    pub(super) fn lost(&mut self) {
        self.seen = None;
        self.send();
    }

    /// Prints the first invalid message; later ones are left out silently.
    pub(super) fn report(&mut self, error: &dyn std::error::Error) {
        if !std::mem::replace(&mut self.has_reported, true) {
            eprintln!("{error}; it is ignored, and later invalid ones are ignored without a message");
        }
    }

    fn send(&self) {
        let state = if self.seen.is_some() { TrackingState::Tracking } else { TrackingState::Lost };
        let pose = self.seen.map(|(pose, _)| (pose.position.into(), pose.orientation_xyzw()));
        // The space bar is button A.
        let held = if self.handle.is_tool_held() { Buttons::A } else { Buttons::default() };
        let buttons = held.names().map(str::to_owned).collect();
        self.handle.pose(self.handle.now_ns(), PoseKind::Remote(RemotePose { state, pose, buttons }));
    }
}
