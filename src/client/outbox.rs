//! Messages that wait to be sent: the newest pose wins, all else keeps its order and its place.

use std::collections::VecDeque;

use relief_live::{Ack, ClientMessage, Eyes, Intent, IntentMessage, Pose, PoseKind, RawReport, Settings};

/// Most messages that wait; a connection that is this far behind is stalled, and takes no more.
pub(crate) const MAX_QUEUED: usize = 512;

/// Messages of one session, numbered in one row.
///
/// Without a connection nothing is queued: input made while the picture stood still is not applied
/// later.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    queue: VecDeque<ClientMessage>,
    ack: Option<Ack>,
    seq: u64,
    /// The number of the connection; 0 before the first.
    connection: u64,
    connections: u64,
    /// The newest pose of a Wiimote, with which a new connection begins, because buttons may have
    /// been released meanwhile.
    remote: Option<PoseKind>,
}

impl Outbox {
    /// There is a connection from now on; gives its number.
    pub(super) fn open(&mut self) -> u64 {
        self.connections += 1;
        self.connection = self.connections;
        self.connection
    }

    /// The session has ended.
    pub(super) fn close(&mut self) {
        self.connection = 0;
        self.queue.clear();
        self.ack = None;
    }

    pub(super) fn is_open(&self) -> bool {
        self.connection != 0
    }

    /// Queues the last state of the Wiimote again.
    pub(super) fn repeat_remote(&mut self, t_ns: u64) {
        if let Some(pose) = self.remote.clone() {
            self.pose(t_ns, pose);
        }
    }

    /// A pose; gives its number, or `None` where it is not going to be sent.
    pub(super) fn pose(&mut self, t_ns: u64, what: PoseKind) -> Option<u64> {
        if matches!(what, PoseKind::Remote(_)) {
            self.remote = Some(what.clone());
        }
        let replaces =
            matches!(self.queue.back(), Some(ClientMessage::Pose(last)) if is_replaced(&last.what, &what));
        if replaces {
            self.queue.pop_back();
        }
        self.push(|seq| ClientMessage::Pose(Pose { seq, t_ns, what }))
    }

    pub(super) fn intent(&mut self, t_ns: u64, intent: Intent) -> Option<u64> {
        self.push(|seq| ClientMessage::Intent(IntentMessage { seq, t_ns, intent }))
    }

    /// A report in hexadecimal digits. Where the connection is behind, those go that change no
    /// button.
    pub(super) fn report(&mut self, t_ns: u64, report: String) -> Option<u64> {
        if self.queue.len() >= MAX_QUEUED / 4 {
            let idle = (1..self.queue.len()).find(|&at| match (&self.queue[at - 1], &self.queue[at]) {
                (ClientMessage::Report(a), ClientMessage::Report(b)) => buttons(a) == buttons(b),
                _ => false,
            });
            if let Some(at) = idle {
                self.queue.remove(at - 1);
            }
        }
        self.push(|seq| ClientMessage::Report(RawReport { seq, t_ns, report }))
    }

    pub(super) fn settings(&mut self, settings: Settings) -> bool {
        self.push(|_| ClientMessage::Settings(Box::new(settings))).is_some()
    }

    /// The eyes; replaces those that still wait. `false` without a connection.
    pub(super) fn eyes(&mut self, eyes: Eyes) -> bool {
        if let Some(ClientMessage::Eyes(last)) = self.queue.back_mut() {
            *last = eyes;
            return true;
        }
        self.push(|_| ClientMessage::Eyes(eyes)).is_some()
    }

    /// A frame of this connection was shown; the newest covers those before it.
    pub(super) fn ack(&mut self, connection: u64, frame: u32, t_ns: u64) {
        if connection == self.connection && self.ack.is_none_or(|ack| ack.frame < frame) {
            self.ack = Some(Ack { frame, t_ns });
        }
    }

    fn push(&mut self, message: impl FnOnce(u64) -> ClientMessage) -> Option<u64> {
        if !self.is_open() || self.queue.len() >= MAX_QUEUED {
            return None;
        }
        self.seq += 1;
        self.queue.push_back(message(self.seq));
        Some(self.seq)
    }

    /// The next message: acknowledgements first, because the next frame waits for them.
    pub(super) fn pop(&mut self) -> Option<ClientMessage> {
        self.ack.take().map(ClientMessage::Ack).or_else(|| self.queue.pop_front())
    }
}

/// Whether the last pose says nothing beside the new one. Edges of buttons are never dropped.
fn is_replaced(last: &PoseKind, new: &PoseKind) -> bool {
    match (last, new) {
        (PoseKind::Remote(last), PoseKind::Remote(new)) => last.buttons == new.buttons,
        (PoseKind::Orbit(last), PoseKind::Orbit(new)) => last.zoom.is_none() || new.zoom.is_some(),
        (PoseKind::Camera(_) | PoseKind::Orbit(_), PoseKind::Camera(_)) => true,
        _ => false,
    }
}

/// The digits of a report's buttons. Every report has them but 0x3d, which is never equal to
/// another kind.
fn buttons(report: &RawReport) -> Option<(&str, &str)> {
    Some((report.report.get(..2)?, report.report.get(2..6)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use relief_live::{OrbitPose, RemotePose};
    use relief_tracking::TrackingState;

    fn orbit(azimuth_deg: f64) -> PoseKind {
        PoseKind::Orbit(OrbitPose { azimuth_deg, elevation_deg: 0.0, zoom: None })
    }

    fn remote(buttons: &[&str]) -> PoseKind {
        let buttons = buttons.iter().map(|&name| name.to_owned()).collect();
        PoseKind::Remote(RemotePose { state: TrackingState::Lost, pose: None, buttons })
    }

    fn rest(outbox: &mut Outbox) -> Vec<ClientMessage> {
        std::iter::from_fn(|| outbox.pop()).collect()
    }

    /// Invariant: No button event is lost on its way to the server, and input made while
    /// disconnected is dropped.
    #[test]
    fn the_newest_pose_wins_and_buttons_are_kept() {
        let mut outbox = Outbox::default();
        assert_eq!(outbox.pose(1, orbit(1.0)), None, "there is no connection");
        outbox.open();
        for (t_ns, pose) in [(1, orbit(1.0)), (2, orbit(2.0)), (3, remote(&[])), (4, remote(&["b"]))] {
            outbox.pose(t_ns, pose);
        }
        outbox.pose(5, remote(&["b"]));
        outbox.pose(6, remote(&[]));
        let times: Vec<_> = rest(&mut outbox)
            .into_iter()
            .map(|message| match message {
                ClientMessage::Pose(pose) => pose.t_ns,
                other => panic!("{other:?}"),
            })
            .collect();
        assert_eq!(times, [2, 3, 5, 6]);
    }

    #[test]
    fn intents_keep_their_order_between_poses_and_acks_go_first() {
        let mut outbox = Outbox::default();
        let connection = outbox.open();
        outbox.pose(1, orbit(1.0));
        outbox.intent(2, Intent::Undo {});
        outbox.pose(3, orbit(3.0));
        outbox.ack(connection, 4, 9);
        outbox.ack(connection, 3, 9);
        outbox.ack(connection + 1, 5, 9);
        let messages = rest(&mut outbox);
        assert_eq!(messages.len(), 4, "{messages:?}");
        assert_eq!(messages[0], ClientMessage::Ack(Ack { frame: 4, t_ns: 9 }));
        assert!(matches!(messages[2], ClientMessage::Intent(_)));
    }

    /// Invariant: No button event is lost on its way to the server, and input made while
    /// disconnected is dropped.
    #[test]
    fn nothing_of_a_lost_connection_reaches_the_next_but_the_hand() {
        let mut outbox = Outbox::default();
        let first = outbox.open();
        outbox.pose(1, orbit(7.0));
        outbox.pose(1, remote(&["b"]));
        outbox.intent(2, Intent::Undo {});
        outbox.close();
        outbox.pose(3, remote(&[]));
        outbox.intent(3, Intent::Undo {});
        let second = outbox.open();
        outbox.ack(first, 9, 0);
        outbox.repeat_remote(5);
        assert_ne!(first, second);
        match rest(&mut outbox).as_slice() {
            [ClientMessage::Pose(Pose { seq: 4, t_ns: 5, what })] => assert_eq!(*what, remote(&[])),
            other => panic!("{other:?}"),
        }
    }

    /// Invariant: No button event is lost on its way to the server, and input made while
    /// disconnected is dropped.
    #[test]
    fn a_stalled_connection_holds_a_bounded_queue_and_every_edge_of_a_button() {
        let mut outbox = Outbox::default();
        outbox.open();
        let digits = |held: bool| format!("33{}086789a1", if held { "4004" } else { "4000" });
        for t_ns in 0..10_000 {
            outbox.report(t_ns, digits((5000..5003).contains(&t_ns)));
        }
        let reports: Vec<bool> = rest(&mut outbox)
            .into_iter()
            .map(|message| match message {
                ClientMessage::Report(report) => report.report.starts_with("334004"),
                other => panic!("{other:?}"),
            })
            .collect();
        assert!(reports.len() <= MAX_QUEUED / 4 + 1, "{}", reports.len());
        let edges = reports.windows(2).filter(|two| two[0] != two[1]).count();
        assert_eq!(edges, 2, "pressed once and let go once");
        for _ in 0..2 * MAX_QUEUED {
            outbox.intent(0, Intent::Undo {});
        }
        assert_eq!(rest(&mut outbox).len(), MAX_QUEUED);
    }
}
