//! The way of frames from a session to its window: the newest frame is composed on its own thread,
//! for the newest eyes.

use std::sync::Arc;
use std::time::Instant;

use parking_lot::{Condvar, Mutex};
use tokio::sync::watch;
use winit::event_loop::EventLoopProxy;

use super::SessionEvent;
use super::rest::{self, AtRest};
use crate::compose::{Composed, Composer, PictureError};
use crate::handle::Handle;
use crate::link::{Event, LinkState, Options, Received};
use crate::marks::Marks;
use relief_display::Frame;
use relief_live::{Eyes, ReceivedLayers, ServerMessage};
use relief_tracking::TrackingState;

/// The place in which a session puts its frames for a window.
#[derive(Clone)]
pub struct Screen {
    shared: Arc<WindowState>,
    wake: EventLoopProxy<SessionEvent>,
}

struct WindowState {
    newest: Mutex<Newest>,
    changed: Condvar,
    /// The picture that the window shows, while nothing moves.
    resting: watch::Sender<Option<AtRest>>,
}

#[derive(Default)]
struct Newest {
    frame: Option<Received>,
    eyes: Option<NewEyes>,
    /// Rendered views, and the number of the shown picture that they belong to.
    rendered: Option<(u64, Frame)>,
    /// Name of the live view.
    view: Option<String>,
    /// Whether a tracker of this machine reports the eyes: those of the server are its echo.
    has_tracker: bool,
    marks: Marks,
    stopped: bool,
}

/// The eyes of the viewer, and when they came.
#[derive(Clone, Copy)]
struct NewEyes {
    eyes: Eyes,
    since: Instant,
}

/// The next task: a new frame, the last frame for other eyes, or rendered views of the last frame.
struct Work {
    frame: Option<Received>,
    eyes: Option<NewEyes>,
    rendered: Option<(u64, Frame)>,
    view: Option<String>,
}

impl Screen {
    pub(super) fn new(wake: EventLoopProxy<SessionEvent>) -> Self {
        let shared = Arc::new(WindowState {
            newest: Mutex::default(),
            changed: Condvar::new(),
            resting: watch::Sender::new(None),
        });
        Self { shared, wake }
    }

    /// Takes what happens in a session. Quick: frames are composed elsewhere.
    pub fn take(&self, event: &Event) {
        match event {
            Event::Frame(received) => {
                self.shared.newest.lock().frame = Some(received.clone());
                self.shared.changed.notify_all();
            }
            Event::State(state) => {
                let offline = !matches!(state, LinkState::Connected { .. } | LinkState::Heard);
                self.mark(|marks| marks.offline = offline);
                if let LinkState::Connected { view, .. } = state {
                    self.shared.newest.lock().view = Some(view.clone());
                }
                let _ = self.wake.send_event(SessionEvent::Link(state.clone())); // fails when the window is gone
            }
            Event::Message(message) => match message.as_ref() {
                ServerMessage::Tracking(known) => self.tracking(Some(known.state)),
                ServerMessage::Eyes(eyes) if !self.shared.newest.lock().has_tracker => self.put_eyes(*eyes),
                _ => {}
            },
            Event::Sent(_) | Event::Unreadable(_) => {}
        }
    }

    /// Shows the newest frame for these eyes, which a tracker of this machine reports. They do not
    /// pass through the server.
    pub fn follow(&self, eyes: Eyes) {
        self.shared.newest.lock().has_tracker = true;
        self.put_eyes(eyes);
    }

    /// Replaces the display's own views of a picture at rest with views that the server renders, until
    /// the window is gone. Run it beside the session.
    pub async fn show_rendered_views(&self, options: &Options) {
        let show = |shown, stacked| {
            self.shared.newest.lock().rendered = Some((shown, stacked));
            self.shared.changed.notify_all();
        };
        rest::serve(self.shared.resting.subscribe(), options, show).await;
    }

    fn put_eyes(&self, eyes: Eyes) {
        let mut newest = self.shared.newest.lock();
        // Eyes that were not shown yet give way, and the time from the first of them counts.
        let since = newest.eyes.map_or_else(Instant::now, |waiting| waiting.since);
        newest.eyes = Some(NewEyes { eyes, since });
        drop(newest);
        self.shared.changed.notify_all();
    }

    /// State of the Wiimote's tracking.
    pub fn tracking(&self, state: Option<TrackingState>) {
        self.mark(|marks| marks.tracking = state);
    }

    fn mark(&self, change: impl FnOnce(&mut Marks)) {
        let mut newest = self.shared.newest.lock();
        let before = newest.marks;
        change(&mut newest.marks);
        let after = newest.marks;
        drop(newest);
        if before != after {
            let _ = self.wake.send_event(SessionEvent::Marks(after)); // fails when the window is gone
        }
    }

    /// Ends the window: the session is over.
    pub fn stop(&self) {
        self.shared.newest.lock().stopped = true;
        self.shared.changed.notify_all();
        let _ = self.wake.send_event(SessionEvent::Stop); // fails when the window is gone
    }

    /// Composes the newest frame whenever there is one, and anew for other eyes. Frames that were
    /// overtaken are acknowledged with the next.
    pub(super) fn compose_all(&self, composer: &Composer, handle: &Handle) {
        let mut composing = Composing { composer, layers: None, eyes: None, shown: 0 };
        while let Some(Work { frame, eyes, rendered, view }) = self.next_work() {
            composing.eyes = eyes.map(|new| new.eyes).or(composing.eyes);
            let is_other = frame.is_some() || eyes.is_some();
            if is_other {
                composing.shown += 1;
                self.shared.resting.send_replace(None);
            }
            let event = match (frame, eyes, rendered) {
                (Some(received), ..) => composing.frame(&received, handle),
                (None, Some(new), _) => composing.follow(new.since),
                (None, None, Some((shown, stacked))) => composing.rendered(shown, &stacked),
                (None, None, None) => None,
            };
            if is_other && let Some(at_rest) = view.and_then(|view| composing.at_rest(view)) {
                self.shared.resting.send_replace(Some(at_rest));
            }
            if event.is_some_and(|event| self.wake.send_event(event).is_err()) {
                return; // the window is gone
            }
        }
    }

    fn next_work(&self) -> Option<Work> {
        let mut newest = self.shared.newest.lock();
        loop {
            if newest.stopped {
                return None;
            }
            let work = Work {
                frame: newest.frame.take(),
                eyes: newest.eyes.take(),
                rendered: newest.rendered.take(),
                view: newest.view.clone(),
            };
            if work.frame.is_some() || work.eyes.is_some() || work.rendered.is_some() {
                return Some(work);
            }
            self.shared.changed.wait(&mut newest);
        }
    }
}

/// Composes frames for the newest eyes.
struct Composing<'a> {
    composer: &'a Composer,
    /// The layers that the views of the newest frame are made of.
    layers: Option<ReceivedLayers>,
    eyes: Option<Eyes>,
    /// Number of the shown picture; it rises with each frame and with each change of the eyes.
    shown: u64,
}

impl Composing<'_> {
    /// The frame; one that cannot be composed is acknowledged and left out.
    fn frame(&mut self, received: &Received, handle: &Handle) -> Option<SessionEvent> {
        match self.composed(received) {
            Ok(composed) => {
                if let Some(problem) = &composed.header_problem {
                    tracing::warn!(problem, "the header row differs from the requested one");
                }
                Some(SessionEvent::Frame(received.connection, Box::new(composed)))
            }
            Err(error) => {
                tracing::warn!(%error, "a frame is left out");
                handle.ack(received.connection, received.header.sequence);
                None
            }
        }
    }

    fn composed(&mut self, received: &Received) -> Result<Composed, PictureError> {
        let Some(output) = self.composer.output() else { return self.composer.compose(received) };
        self.layers = Some(self.composer.layers(output, received)?);
        let layers = self.layers.as_ref().expect("set above");
        self.composer.views(output, layers, self.followed())
    }

    /// The eyes that views follow.
    fn followed(&self) -> Option<&Eyes> {
        self.eyes.as_ref().filter(|_| self.composer.follows_eyes())
    }

    /// The newest frame, if the server renders its views.
    fn at_rest(&self, view: String) -> Option<AtRest> {
        let (output, layers) = (self.composer.output()?, self.layers.as_ref()?);
        let eyes = self.composer.eyes_at_rest(output, layers, self.followed())?;
        Some(AtRest { view, eyes, shown: self.shown })
    }

    /// Rendered views, if the window still shows the picture that they belong to.
    fn rendered(&self, shown: u64, stacked: &Frame) -> Option<SessionEvent> {
        let (output, layers) = (self.composer.output()?, self.layers.as_ref()?);
        if shown != self.shown {
            return None;
        }
        match self.composer.rendered(output, layers.header, stacked) {
            Ok(composed) => Some(SessionEvent::Rendered(Box::new(composed))),
            Err(error) => {
                tracing::warn!(%error, "rendered views are left out");
                None
            }
        }
    }

    /// The newest frame for other eyes, which came then; `None` before the first frame, and where
    /// views do not follow eyes.
    fn follow(&self, since: Instant) -> Option<SessionEvent> {
        if !self.composer.follows_eyes() {
            return None;
        }
        let views = self.composer.views(self.composer.output()?, self.layers.as_ref()?, self.eyes.as_ref());
        match views {
            Ok(composed) => Some(SessionEvent::Followed(since, Box::new(composed))),
            Err(error) => {
                tracing::warn!(%error, "views do not follow the eyes");
                None
            }
        }
    }
}
