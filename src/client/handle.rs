//! The end of a session that hands hold: poses, intents and acknowledgements go in here, from any
//! thread.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use data_encoding::HEXLOWER;
use parking_lot::{Mutex, MutexGuard};
use tokio::sync::{Notify, watch};

use super::outbox::Outbox;
use relief_live::{ClientMessage, Eyes, Intent, PoseKind, Settings};
use relief_tracking::InputReport;

/// The sending end of a session. Clones are the same end.
#[derive(Clone, Debug)]
pub struct Handle(Arc<HandleState>);

#[derive(Debug)]
struct HandleState {
    outbox: Mutex<Outbox>,
    waiting: Notify,
    stop: watch::Sender<bool>,
    start: Instant,
    /// Whether poses are those of a tool without buttons, and whether its button is held elsewhere.
    has_tool: AtomicBool,
    holds_tool: AtomicBool,
}

impl Default for Handle {
    fn default() -> Self {
        Self::new()
    }
}

impl Handle {
    /// An end without a session yet; its clock begins.
    #[must_use]
    pub fn new() -> Self {
        Self(Arc::new(HandleState {
            outbox: Mutex::default(),
            waiting: Notify::new(),
            stop: watch::Sender::new(false),
            start: Instant::now(),
            has_tool: AtomicBool::new(false),
            holds_tool: AtomicBool::new(false),
        }))
    }

    /// Now, ns of the client's clock; from 1, for 0 stands for no time.
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        u64::try_from(self.0.start.elapsed().as_nanos()).unwrap_or(u64::MAX).max(1)
    }

    /// A pose. It replaces one that still waits. Gives its number, or `None` without a connection,
    /// or with one that takes nothing.
    pub fn pose(&self, t_ns: u64, pose: PoseKind) -> Option<u64> {
        self.put(|outbox| outbox.pose(t_ns, pose))
    }

    /// An intent; kept in its order. `None` as for poses.
    pub fn intent(&self, t_ns: u64, intent: Intent) -> Option<u64> {
        self.put(|outbox| outbox.intent(t_ns, intent))
    }

    /// Sends a Wiimote report for the server to track. `None` as for poses.
    pub fn report(&self, t_ns: u64, report: &InputReport) -> Option<u64> {
        let digits = HEXLOWER.encode(&report.encode());
        self.put(|outbox| outbox.report(t_ns, digits))
    }

    /// Changes the settings of the view; `false` if they will not be sent.
    pub fn settings(&self, settings: Settings) -> bool {
        self.put(|outbox| outbox.settings(settings))
    }

    /// The eyes of the viewer; `false` if they will not be sent.
    pub fn eyes(&self, eyes: Eyes) -> bool {
        self.put(|outbox| outbox.eyes(eyes))
    }

    /// The frame `sequence` of a connection was shown, or is not going to be: the next may come.
    pub fn ack(&self, connection: u64, sequence: u32) {
        let t_ns = self.now_ns();
        self.put(|outbox| outbox.ack(connection, sequence, t_ns));
    }

    /// Says that poses are those of a tracked tool, which has no buttons of its own.
    pub fn attach_tool(&self) {
        self.0.has_tool.store(true, Ordering::Relaxed);
    }

    /// Holds or releases the button of the tracked tool, in its place; `false` without a tool.
    pub fn hold_tool(&self, is_held: bool) -> bool {
        self.0.holds_tool.store(is_held, Ordering::Relaxed);
        self.0.has_tool.load(Ordering::Relaxed)
    }

    /// Whether the button of the tracked tool is held.
    #[must_use]
    pub fn is_tool_held(&self) -> bool {
        self.0.holds_tool.load(Ordering::Relaxed)
    }

    /// Ends the session, for good.
    pub fn stop(&self) {
        self.0.stop.send_replace(true);
    }

    /// Whether [`Handle::stop`] was called.
    #[must_use]
    pub fn is_stopped(&self) -> bool {
        *self.0.stop.borrow()
    }

    /// Done when [`Handle::stop`] was called.
    pub async fn stopped(&self) {
        // The sender is held here: waiting cannot fail.
        let _ = self.0.stop.subscribe().wait_for(|stop| *stop).await;
    }

    /// The next message to send, when there is one.
    pub(super) async fn next(&self) -> ClientMessage {
        loop {
            // Registered before looking, so that nothing is missed between.
            let waiting = self.0.waiting.notified();
            if let Some(message) = self.outbox().pop() {
                return message;
            }
            waiting.await;
        }
    }

    pub(super) fn outbox(&self) -> MutexGuard<'_, Outbox> {
        self.0.outbox.lock()
    }

    pub(super) fn put<T>(&self, put: impl FnOnce(&mut Outbox) -> T) -> T {
        let put = put(&mut self.outbox());
        self.0.waiting.notify_one();
        put
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_tool_that_is_there_is_held() {
        let handle = Handle::new();
        assert!(!handle.hold_tool(true));
        handle.attach_tool();
        assert!(handle.hold_tool(true) && handle.is_tool_held());
        assert!(handle.hold_tool(false) && !handle.is_tool_held());
    }
}
