//! An open session's connection: a reader executes messages, a writer sends frames while the client
//! has capacity.
//!
//! The queue of the writer is bounded: the newest picture of the view, a few short messages, and
//! the one frame that is being handed over. Frames are encoded only while fewer than two are out,
//! so a connection that takes nothing holds two and no more.

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::extract::ws::{Message, WebSocket};
use axum::http::StatusCode;
use futures_util::stream::SplitStream;
use futures_util::{SinkExt, StreamExt};
use tokio::sync::{broadcast, mpsc};
use tokio_tungstenite::tungstenite;

use super::placing::{self, LandmarkPlacer, apply_effect, next, pointer};
use super::session::Session;
use super::wire::{TOO_LARGE, UNSUPPORTED, Writer, error, expect_annotations, malformed, text};
use crate::annotation_service::Published;
use crate::live::close::End;
use crate::live::close::GOING_AWAY;
use crate::live::close::INTERNAL;
use crate::live::close::POLICY;
use crate::live::close::REMOVED;
use crate::live::close::TAKEN_OVER;
use crate::problem::Problem;
use crate::state::LiveParts;
use crate::volumes::describe;
use relief_live::{
    AnnotationsMessage, ClientMessage, ErrorMessage, Formats, FrameHeader, Intent, MAX_TEXT_BYTES,
    MessageError, MessageFault, PingLimit, Pose, PoseKind, RawReport, Role, ServerMessage, Settings, Welcome,
    assemble,
};
use relief_session::{
    Echo, Effect, LiveError, Outcome, USUAL_QUALITY, ViewFrame, Viewer, find_phase, micros, search_preview,
};

/// Refused messages that end a connection.
const MOST_ERRORS: usize = 20;
/// Quality of a still picture as JPEG, for clients that accept nothing lossless.
const STILL_QUALITY: u8 = 95;

/// Interval at which a session checks that its caller's token is still valid.
const REVOCATION: Duration = Duration::from_secs(2);

/// A WebSocket of a session after its hello.
pub(super) struct Connected {
    pub(super) parts: LiveParts,
    pub(super) session: Arc<Session>,
    pub(super) viewer: Arc<Viewer>,
    pub(super) formats: Formats,
    /// Number of this connection of the session.
    pub(super) number: u64,
}

/// Messages that wait for the writer; one that finds no room is left out.
pub(super) type Outbox = mpsc::Sender<String>;

impl Connected {
    pub(super) fn welcome(&self, resumed: bool) -> String {
        let Session { token, view, role, .. } = &*self.session;
        let welcome = Welcome {
            session: token.clone(),
            view: view.name.clone(),
            volume: describe(&view.entry()),
            role: *role,
            color: self.formats.color,
            depth: self.formats.depth,
            state: view.record(),
            resumed,
        };
        ServerMessage::Welcome(Box::new(welcome)).to_text()
    }

    /// Leaves the view after a lost connection: the session can be resumed, and the hand releases
    /// the volume.
    pub(super) fn leave(&self) {
        let now = Instant::now();
        self.session.view.leave(&self.viewer);
        if *self.session.connection.borrow() == self.number {
            let intents = self.session.remote.lock().end();
            self.session.view.apply_intents(None, &intents, 0, now); // letting go is never refused
            placing::abandon(&self.session.task, &self.session.view);
        }
        self.session.lose(self.number, now);
    }

    /// Sends the next label of this session, if its view draws annotations.
    pub(super) async fn say_next(&self, outbox: &Outbox) {
        let Session { author, caller, task, view, role, .. } = &*self.session;
        if author.is_none() || *role == Role::Watcher || view.shown().is_nothing() {
            return;
        }
        let hand = LandmarkPlacer { author: author.as_deref(), caller, task, device: pointer() };
        if let Ok(message) = next(&self.parts, view, &hand).await {
            let _ = outbox.try_send(placing::text(message));
        }
    }

    /// The reason to end a connection from outside.
    pub(super) async fn interrupted(&self) -> End {
        let mut closing = self.parts.live.closing.subscribe();
        let mut ended = self.session.view.ended.subscribe();
        let mut connection = self.session.connection.subscribe();
        tokio::select! {
            _ = closing.wait_for(|closing| *closing) => Some((GOING_AWAY, "the server stops")),
            _ = ended.wait_for(|ended| *ended) => Some((REMOVED, "the volume was removed")),
            _ = connection.wait_for(|newest| *newest != self.number) => {
                Some((TAKEN_OVER, "another connection resumed this session"))
            }
            () = self.revoked() => Some((POLICY, "the token was removed or has expired")),
        }
    }

    /// Waits until the caller is accepted no longer.
    async fn revoked(&self) {
        while self.parts.config.admission.still_accepts(&self.session.caller) {
            tokio::time::sleep(REVOCATION).await;
        }
    }

    /// Obeys messages until the connection ends.
    pub(super) async fn read(&self, reader: &mut SplitStream<WebSocket>, outbox: &Outbox) -> End {
        let (mut errors, mut pings) = (0, PingLimit::new(Instant::now()));
        loop {
            let next = tokio::time::timeout(self.parts.live.config.silence, reader.next()).await;
            let message = match next {
                Err(_) | Ok(None) => return None,
                // The only error after which the client can still receive a reason.
                Ok(Some(Err(error))) if is_too_large(&error) => {
                    return Some((TOO_LARGE, "a message is too large"));
                }
                Ok(Some(Err(_))) => return None,
                Ok(Some(Ok(message))) => message,
            };
            let outcome = match message {
                Message::Text(text) if text.len() > MAX_TEXT_BYTES => {
                    return Some((TOO_LARGE, "a message is too large"));
                }
                Message::Text(text) => match ClientMessage::parse(&text) {
                    Ok(message) => {
                        let outcome = self.handle_message(&message, outbox).await;
                        search_preview(&self.parts.engine, &self.session.view);
                        outcome
                    }
                    Err(error) => Err(malformed(&error)),
                },
                Message::Binary(_) => return Some((UNSUPPORTED, "binary messages are the server's alone")),
                Message::Close(_) => return None,
                Message::Ping(_) if !pings.accepts(Instant::now()) => {
                    return Some((POLICY, "too many pings"));
                }
                Message::Ping(_) | Message::Pong(_) => Ok(()),
            };
            if let Err(problem) = outcome {
                errors += 1;
                let _ = outbox.try_send(error(&problem, errors == MOST_ERRORS));
                if errors == MOST_ERRORS {
                    return Some((POLICY, "too many errors"));
                }
            }
        }
    }

    /// Executes a message and its effects on annotations. All effects are applied; the first
    /// refusal is returned.
    async fn handle_message(&self, message: &ClientMessage, outbox: &Outbox) -> Result<(), Problem> {
        let outcome = self.handle(message, outbox)?;
        let is_shown = matches!(message, ClientMessage::Settings(settings)
            if settings.annotations.as_ref().is_some_and(|shown| !shown.is_nothing()));
        let is_done = outcome.as_ref().is_none_or(|outcome| outcome.effects.is_empty());
        if is_done && !is_shown {
            return outcome.and_then(|outcome| outcome.refused).map_or(Ok(()), |error| Err(error.into()));
        }
        let Session { author, caller, task, view, .. } = &*self.session;
        let device = match message {
            ClientMessage::Pose(_) | ClientMessage::Report(_) => self.session.remote.lock().device(),
            _ => pointer(),
        };
        let hand = LandmarkPlacer { author: author.as_deref(), caller, task, device };
        let (mut said, mut refused) = (None, None);
        if let Some(Outcome { effects, context, refused: first, .. }) = outcome {
            for effect in effects {
                let is_taking = matches!(effect, Effect::Take { .. });
                match apply_effect(&self.parts, view, &hand, effect, &context).await {
                    Ok(message) => said = Some(message),
                    Err(problem) => {
                        refused = refused.or(Some(problem));
                        if is_taking {
                            break; // what follows would set a new landmark down in place of the point that was meant
                        }
                    }
                }
            }
            refused = refused.or(first.map(Problem::from));
        }
        if is_shown {
            said = Some(next(&self.parts, view, &hand).await?);
        }
        if let Some(said) = said {
            let _ = outbox.try_send(placing::text(said));
        }
        refused.map_or(Ok(()), Err)
    }

    /// Applies a message to the view and returns the outcome of its intents.
    fn handle(&self, message: &ClientMessage, outbox: &Outbox) -> Result<Option<Outcome>, Problem> {
        let now = Instant::now();
        let is_watcher = self.session.role == Role::Watcher;
        match message {
            ClientMessage::Ack(ack) => {
                if self.viewer.flow().pace.acknowledged(ack.frame, now) {
                    self.viewer.freed.notify_one();
                    self.session.view.work.notify_one();
                }
                Ok(None)
            }
            ClientMessage::Hello(_) => {
                Err(Problem::new(StatusCode::CONFLICT, "hello-again", "this session is open already"))
            }
            // They change no view: the box of a display may watch.
            ClientMessage::Eyes(eyes) => {
                self.session.view.eyes.send_replace(Some(*eyes));
                Ok(None)
            }
            _ if is_watcher => {
                let detail =
                    "watchers cannot change the view: open the session with the role presenter to do so";
                Err(Problem::new(StatusCode::FORBIDDEN, "watcher", detail))
            }
            ClientMessage::Pose(pose) => self.pose(pose, now),
            ClientMessage::Report(report) => self.report(report, outbox, now).map(Some),
            ClientMessage::Intent(message) => {
                let echo = Echo { seq: message.seq, t_ns: message.t_ns };
                Ok(Some(self.apply_intents(echo, std::slice::from_ref(&message.intent), now)))
            }
            ClientMessage::Settings(settings) => self.settings(settings, now).map(|()| None),
        }
    }

    fn apply_intents(&self, echo: Echo, intents: &[Intent], now: Instant) -> Outcome {
        self.session.view.apply_intents(Some((&self.viewer, echo)), intents, echo.t_ns, now)
    }

    fn pose(&self, pose: &Pose, now: Instant) -> Result<Option<Outcome>, Problem> {
        let is_newest = self.viewer.is_newer(pose.seq);
        let echo = Echo { seq: pose.seq, t_ns: pose.t_ns };
        let outcome = match &pose.what {
            // Buttons count, however late they come.
            PoseKind::Remote(remote) => {
                let intents = self.session.remote.lock().pose(pose.t_ns, remote, is_newest)?;
                let from = is_newest.then_some((&*self.viewer, echo));
                Some(self.session.view.apply_intents(from, &intents, pose.t_ns, now))
            }
            _ if !is_newest => None,
            PoseKind::Orbit(orbit) => {
                let (azimuth_deg, elevation_deg) = (orbit.azimuth_deg, orbit.elevation_deg);
                let look =
                    Intent::Look { azimuth_deg, elevation_deg, zoom: orbit.zoom, vertical_fov_deg: None };
                Some(self.apply_intents(echo, &[look], now))
            }
            PoseKind::Camera(camera) => {
                if camera.lens_shift != [0.0; 2] {
                    let error = MessageError::new("camera.lens_shift", MessageFault::LensShift);
                    return Err(malformed(&error));
                }
                let camera = camera.resolve().map_err(Problem::refused_intent)?;
                let replaced = self.session.view.set_camera(&self.viewer, echo, camera, now);
                self.note(replaced);
                None
            }
        };
        self.note(outcome.as_ref().is_some_and(|outcome| outcome.replaced && outcome.refused.is_none()));
        Ok(outcome)
    }

    /// Counts a pose that no picture showed.
    fn note(&self, replaced: bool) {
        if replaced {
            self.parts.metrics.live.pose_dropped();
        }
    }

    fn report(&self, report: &RawReport, outbox: &Outbox, now: Instant) -> Result<Outcome, Problem> {
        let config = &self.parts.live.config;
        let tracked = self.session.remote.lock().report(report, &config.sensor, &config.beacon, now)?;
        let (intents, tracking) = tracked;
        if let Some(tracking) = tracking {
            let _ = outbox.try_send(ServerMessage::Tracking(tracking).to_text());
        }
        Ok(self.apply_intents(Echo { seq: report.seq, t_ns: report.t_ns }, &intents, now))
    }

    fn settings(&self, settings: &Settings, now: Instant) -> Result<(), Problem> {
        let volumes = &self.parts.engine.volumes;
        let mut entry = settings.volume.as_ref().map(|id| volumes.find(id)).transpose()?;
        if let Some(number) = settings.phase {
            let of = entry.unwrap_or_else(|| self.session.view.entry());
            entry = Some(find_phase(volumes, &of, number)?);
        }
        expect_annotations(&self.parts, Some(settings))?;
        self.session.view.configure(settings, entry.as_ref(), self.session.author.as_deref(), now)?;
        match settings.grab_mode {
            Some(grab_mode) => self.session.remote.lock().set_grab_mode(grab_mode),
            None => Ok(()),
        }
    }

    /// Sends messages and frames until the connection ends.
    pub(super) async fn write(&self, writer: &mut Writer, mut messages: mpsc::Receiver<String>) -> End {
        let view = &self.session.view;
        let (mut frames, mut failures) = (view.frames.subscribe(), view.failures.subscribe());
        let mut peers = view.peers.subscribe();
        let mut edits = self.parts.annotations.as_ref().map(|annotations| annotations.listen());
        let mut eyes = view.eyes.subscribe();
        peers.mark_changed();
        frames.mark_changed();
        let mut ping = tokio::time::interval(self.parts.live.config.ping);
        ping.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let mut sent_state = None;
        loop {
            let has_capacity = self.viewer.flow().has_capacity();
            let sent = tokio::select! {
                biased;
                message = messages.recv() => match message {
                    Some(message) => writer.send(text(&message)).await,
                    None => return None,
                },
                _ = ping.tick() => writer.send(Message::Ping(Vec::new().into())).await,
                _ = peers.changed() => {
                    let message = ServerMessage::Peers(*peers.borrow_and_update());
                    writer.send(text(&message.to_text())).await
                }
                _ = eyes.changed() => {
                    let newest = *eyes.borrow_and_update();
                    match newest {
                        Some(eyes) => writer.send(text(&ServerMessage::Eyes(eyes).to_text())).await,
                        None => Ok(()),
                    }
                }
                heard = heard(&mut edits) => match self.event_message(heard) {
                    Some(message) => writer.send(text(&message)).await,
                    None => Ok(()),
                },
                _ = failures.changed() => {
                    let failure = failures.borrow_and_update().clone();
                    match failure {
                        Some(failure) => writer.send(text(&failure_message(&failure))).await,
                        None => Ok(()),
                    }
                }
                () = self.viewer.freed.notified(), if !has_capacity => Ok(()),
                _ = frames.changed(), if has_capacity => {
                    let view_frame = frames.borrow_and_update().clone();
                    match view_frame {
                        Some(view_frame) => match self.send_frame(writer, view_frame, &mut sent_state).await {
                            Ok(sent) => sent,
                            Err(problem) => {
                                let _ = writer.send(text(&error(&problem, true))).await;
                                return Some((INTERNAL, "a frame could not be encoded"));
                            }
                        },
                        None => Ok(()),
                    }
                }
            };
            if sent.is_err() {
                return None;
            }
        }
    }

    /// The message about an edit; if the client missed edits, the request to read the whole state.
    fn event_message(&self, heard: Option<Arc<Published>>) -> Option<String> {
        let message = match heard {
            Some(published) => {
                let frame = self.session.view.entry().frame_of_reference();
                placing::event_message(&published, &frame, self.session.author.as_deref())?
            }
            None => {
                let seq = self.parts.annotations.as_ref().map_or(0, |annotations| annotations.newest());
                AnnotationsMessage { seq, events: Vec::new(), more: true, next: None }
            }
        };
        Some(placing::text(message))
    }

    /// Encodes a frame, or reuses an encoding, and sends it after the state that it shows.
    async fn send_frame(
        &self,
        writer: &mut Writer,
        view_frame: Arc<ViewFrame>,
        sent_state: &mut Option<Arc<str>>,
    ) -> Result<Result<(), axum::Error>, Problem> {
        let quality = {
            let mut flow = self.viewer.flow();
            flow.is_busy = true;
            flow.taken = view_frame.number;
            match (view_frame.is_still, view_frame.adapts) {
                (true, _) => STILL_QUALITY,
                (false, true) => flow.pace.level().1,
                (false, false) => USUAL_QUALITY,
            }
        };
        // There may be room for one more, which can be rendered while this one is encoded.
        self.session.view.work.notify_one();
        let colors = self.formats.color;
        let format = if view_frame.is_still { colors.still } else { colors.moving };
        let parts = view_frame.parts(&self.parts.engine, format, quality, self.formats.depth).await;
        let header = {
            let mut flow = self.viewer.flow();
            flow.is_busy = false;
            let now = Instant::now();
            match &parts {
                Ok(parts) => FrameHeader {
                    sequence: flow.pace.sent(now, view_frame.is_still),
                    total_us: micros(now.saturating_duration_since(view_frame.arrived)),
                    encode_us: micros(parts.took()),
                    ..view_frame.header(self.viewer.id)
                },
                Err(_) => view_frame.header(self.viewer.id),
            }
        };
        let parts = parts?;
        let (color, depth) = parts.get().ok_or_else(|| Problem::internal("encoding", "nothing was made"))?;
        let frame = assemble(&header, color, depth);
        let metrics = &self.parts.metrics.live;
        metrics.sent(view_frame.is_still, frame.len());
        if !view_frame.is_still {
            metrics.overhead(f64::from(header.overhead_us()) / 1e3);
        }
        if sent_state.as_ref() != Some(&view_frame.state) {
            *sent_state = Some(Arc::clone(&view_frame.state));
            if let Err(error) = writer.feed(text(&view_frame.state)).await {
                return Ok(Err(error));
            }
        }
        // A stalled connection keeps only the bytes of its frame in memory.
        drop((parts, view_frame));
        Ok(writer.send(Message::Binary(frame.into())).await)
    }
}

/// The message about a frame that could not be rendered. The view has logged the cause.
fn failure_message(failure: &LiveError) -> String {
    let problem = Problem::from(failure).document();
    ServerMessage::Error(ErrorMessage { problem, fatal: false }).to_text()
}

/// Whether an error says that a message was larger than allowed.
fn is_too_large(error: &axum::Error) -> bool {
    let cause = std::error::Error::source(error).and_then(|cause| cause.downcast_ref::<tungstenite::Error>());
    matches!(cause, Some(tungstenite::Error::Capacity(_)))
}

/// The next edit; `None` where some were missed. Never ends where there are no annotations.
async fn heard(edits: &mut Option<broadcast::Receiver<Arc<Published>>>) -> Option<Arc<Published>> {
    match edits {
        Some(edits) => match edits.recv().await {
            Ok(published) => Some(published),
            Err(broadcast::error::RecvError::Lagged(_)) => None,
            Err(broadcast::error::RecvError::Closed) => std::future::pending().await,
        },
        None => std::future::pending().await,
    }
}
