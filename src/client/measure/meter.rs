//! Counts of one client.

use parking_lot::{Mutex, MutexGuard};
use tokio::sync::Notify;

use crate::compose::{Composed, Composer};
use crate::handle::Handle;
use crate::link::{Event, LinkState, Received};
use relief_live::ServerMessage;

/// Counts what happens in a session.
pub(super) struct Meter {
    handle: Handle,
    composer: Composer,
    check_every: u32,
    seen: Mutex<Measurements>,
    changed: Notify,
}

/// All that was seen, of the time between [`Meter::begin`] and [`Meter::end`] unless said
/// otherwise.
#[derive(Debug, Default)]
pub(super) struct Measurements {
    begun_ns: Option<u64>,
    pub(super) seconds: f64,
    pub(super) frames: u64,
    pub(super) bytes: u64,
    pub(super) lossless: u64,
    pub(super) full_size: u64,
    pub(super) pixels: Vec<u32>,
    pub(super) overhead_us: Vec<u32>,
    pub(super) render_us: Vec<u32>,
    pub(super) wait_us: Vec<u32>,
    pub(super) encode_us: Vec<u32>,
    pub(super) pose_to_frame_us: Vec<u32>,
    pub(super) compose_us: Vec<u32>,
    /// From here on: of the whole session.
    pub(super) checked: u64,
    pub(super) bad_headers: u64,
    pub(super) malformed: u64,
    pub(super) unreadable: u64,
    pub(super) refusals: u64,
    pub(super) reconnects: u64,
    pub(super) poses: u64,
    pub(super) still_us: Option<u32>,
    pub(super) still_bytes: Option<u64>,
    all_frames: u64,
    shown_seq: u64,
    last_pose: Option<(u64, u64)>,
    moving: bool,
    last: Option<Composed>,
}

impl Meter {
    pub(super) fn new(composer: Composer, check_every: u32) -> Self {
        let (handle, seen, changed) = (Handle::new(), Mutex::default(), Notify::new());
        Self { handle, composer, check_every, seen, changed }
    }

    pub(super) fn handle(&self) -> &Handle {
        &self.handle
    }

    pub(super) fn seen(&self) -> MutexGuard<'_, Measurements> {
        self.seen.lock()
    }

    pub(super) fn begin(&self) {
        let mut seen = self.seen();
        (seen.begun_ns, seen.moving) = (Some(self.handle.now_ns()), true);
    }

    pub(super) fn end(&self) {
        let now = self.handle.now_ns();
        let mut seen = self.seen();
        seen.seconds = seen.begun_ns.map_or(0.0, |begun| (now - begun) as f64 * 1e-9);
        seen.moving = false;
    }

    /// A pose was handed over; without a number it was not.
    pub(super) fn posed(&self, seq: Option<u64>, t_ns: u64) {
        if let Some(seq) = seq {
            let mut seen = self.seen();
            seen.last_pose = Some((seq, t_ns));
            seen.poses += 1;
        }
    }

    pub(super) async fn first_frame(&self) {
        self.until(|seen| seen.all_frames > 0).await;
    }

    /// The lossless frame of the last pose.
    pub(super) async fn still_frame(&self) {
        self.until(|seen| seen.still_us.is_some()).await;
    }

    async fn until(&self, done: impl Fn(&Measurements) -> bool) {
        loop {
            let changed = self.changed.notified();
            if done(&self.seen()) {
                return;
            }
            changed.await;
        }
    }

    /// The last frame that was composed.
    pub(super) fn take_last(&self) -> Option<Composed> {
        self.seen().last.take()
    }

    pub(super) fn take(&self, event: Event) {
        match event {
            Event::Frame(received) => {
                self.frame(&received);
                self.handle.ack(received.connection, received.header.sequence);
            }
            Event::State(LinkState::Lost { .. }) => self.seen().reconnects += 1,
            Event::Message(message) if matches!(*message, ServerMessage::Error(_)) => {
                self.seen().refusals += 1;
            }
            Event::Unreadable(_) => self.seen().unreadable += 1,
            Event::State(_) | Event::Message(_) | Event::Sent(_) => {}
        }
        self.changed.notify_waiters();
    }

    fn frame(&self, received: &Received) {
        let header = &received.header;
        let (number, moving, is_last) = {
            let mut seen = self.seen();
            seen.all_frames += 1;
            seen.count(received);
            let is_last = seen.last_pose.is_none_or(|(seq, _)| header.shows_seq >= seq);
            (seen.all_frames, seen.moving, is_last)
        };
        let is_still = header.still && is_last && !moving;
        let checked =
            self.check_every > 0 && (number.is_multiple_of(u64::from(self.check_every)) || is_still);
        if checked {
            let before = self.handle.now_ns();
            // Others of this thread go on meanwhile.
            let composed = tokio::task::block_in_place(|| self.composer.compose(received));
            let compose_us = micros(self.handle.now_ns() - before);
            let mut seen = self.seen();
            seen.checked += 1;
            match composed {
                Ok(composed) => {
                    seen.bad_headers += u64::from(composed.header_problem.is_some());
                    seen.last = Some(composed);
                    if moving {
                        seen.compose_us.push(compose_us);
                    }
                }
                Err(_) => seen.malformed += 1,
            }
        }
        if is_still {
            let mut seen = self.seen();
            if let (Some((_, posed_ns)), None) = (seen.last_pose, seen.still_us) {
                seen.still_us = Some(micros(received.at_ns.saturating_sub(posed_ns)));
                seen.still_bytes = Some(received.bytes.len() as u64);
            }
        }
    }
}

impl Measurements {
    fn count(&mut self, received: &Received) {
        let header = &received.header;
        let is_newer = header.shows_seq > self.shown_seq;
        self.shown_seq = self.shown_seq.max(header.shows_seq);
        if !self.moving {
            return;
        }
        self.frames += 1;
        self.bytes += received.bytes.len() as u64;
        self.lossless += u64::from(header.lossless());
        self.full_size += u64::from(header.full_size());
        self.pixels.push(u32::from(header.size_px[0]) * u32::from(header.size_px[1]));
        self.overhead_us.push(header.overhead_us());
        self.render_us.push(header.render_us);
        self.wait_us.push(header.wait_us);
        self.encode_us.push(header.encode_us);
        if is_newer && self.begun_ns.is_some_and(|begun| header.shows_t_ns >= begun) {
            self.pose_to_frame_us.push(micros(received.at_ns.saturating_sub(header.shows_t_ns)));
        }
    }
}

fn micros(ns: u64) -> u32 {
    u32::try_from(ns / 1000).unwrap_or(u32::MAX)
}
