//! `relief client` without a window: prints and records events, and keeps the newest still frame.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use parking_lot::Mutex;
use tokio::sync::Notify;
use tokio::time::timeout;

use crate::client::arguments::RecordArguments;
use crate::client::film::FilmRecorder;
use crate::client::session::Session;
use crate::output::GrowingFile;
use relief_base::printable;
use relief_client::{Event, Handle, LinkState, Received};
use relief_live::{OrbitPose, PoseKind, ServerMessage};

/// A recording that grows, or none: messages as JSON lines, or frames as a film.
pub(crate) struct Recorder(Mutex<Recording>);

#[derive(Default)]
struct Recording {
    file: Option<GrowingFile>,
    film: Option<FilmRecorder>,
    failed: Option<anyhow::Error>,
}

impl Recorder {
    /// The recording that the arguments ask for.
    pub(crate) fn create(arguments: &RecordArguments, session: &Session) -> anyhow::Result<Self> {
        let Some(path) = &arguments.record else { return Ok(Self::none()) };
        if FilmRecorder::is_film(path) {
            let composer = session.composer.clone();
            let film = FilmRecorder::start(path, composer, &arguments.ffmpeg, arguments.codec)?;
            return Ok(Self(Mutex::new(Recording { film: Some(film), ..Recording::default() })));
        }
        let mut file = GrowingFile::create(path)?;
        file.line(&relief_client::journal_head(&session.options.hello))?;
        Ok(Self(Mutex::new(Recording { file: Some(file), ..Recording::default() })))
    }

    /// A recorder that records nothing.
    pub(crate) fn none() -> Self {
        Self(Mutex::new(Recording::default()))
    }

    /// Records events. After a failure it records no more, and [`Recorder::finish`] returns the
    /// error.
    pub(crate) fn keep(&self, t_ns: u64, event: &Event) {
        let mut recording = self.0.lock();
        if let (Some(film), Event::Frame(received)) = (&recording.film, event) {
            film.take(received);
        }
        if recording.file.is_none() {
            return;
        }
        let Some(line) = relief_client::journal_line(t_ns, event) else { return };
        if let Some(Err(error)) = recording.file.as_mut().map(|file| file.line(&line)) {
            (recording.file, recording.failed) = (None, Some(error));
        }
    }

    /// Makes a whole file of it.
    pub(crate) fn finish(&self) -> anyhow::Result<()> {
        let mut recording = self.0.lock();
        if let Some(film) = recording.film.take() {
            return film.finish();
        }
        match (recording.file.take(), recording.failed.take()) {
            (_, Some(error)) => Err(error),
            (Some(file), None) => file.finish(),
            (None, None) => Ok(()),
        }
    }
}

/// Prints changes of the connection and refusals of the server to stderr, each text once, without data of
/// patients.
#[derive(Debug, Default)]
pub(crate) struct LinkLog {
    /// Texts that were printed since the last connection. Without it, each attempt (every 800 ms) would
    /// print them again.
    printed: Mutex<BTreeSet<String>>,
}

impl LinkLog {
    /// Most texts of one connection.
    const MOST: usize = 100;

    pub(crate) fn take(&self, event: &Event) {
        match event {
            Event::State(LinkState::Connected { resumed, view, .. }) => {
                self.printed.lock().clear();
                let how = if *resumed { "resumed" } else { "connected" };
                self.print(&format!("{how}: view {view}"));
            }
            Event::State(LinkState::Lost { reason, .. }) => {
                self.print(&format!("{reason}; trying again until the server answers"));
            }
            Event::State(LinkState::Silent) => eprintln!("the server is silent"),
            Event::State(LinkState::Heard) => eprintln!("the server answers again"),
            Event::Message(message) => {
                if let ServerMessage::Error(error) = message.as_ref() {
                    let detail = error.problem.get("detail").and_then(serde_json::Value::as_str);
                    self.print(&format!("the server refuses: {}", detail.unwrap_or("something")));
                }
            }
            Event::Unreadable(reason) => {
                self.print(&format!("a message of the server cannot be read: {reason}"));
            }
            Event::State(LinkState::Connecting) | Event::Sent(_) | Event::Frame(_) => {}
        }
    }

    /// Prints a text that may contain words of the server.
    fn print(&self, text: &str) {
        let text: String = printable(text).chars().take(LONGEST_TEXT).collect();
        let mut printed = self.printed.lock();
        if printed.len() < Self::MOST && printed.insert(text.clone()) {
            eprintln!("{text}");
            if printed.len() == Self::MOST {
                eprintln!("further messages of this connection are not printed");
            }
        }
    }
}

/// Longest text, characters; the rest is cut off.
const LONGEST_TEXT: usize = 500;

/// A view that changes shows it within this, if only in a small picture.
const QUIET: Duration = Duration::from_secs(2);

/// Takes frames without showing them.
pub(crate) struct FrameCounter<'a> {
    handle: &'a Handle,
    recorder: &'a Recorder,
    log: LinkLog,
    still: Mutex<Option<Received>>,
    connected: Mutex<bool>,
    /// When the last frame or state came.
    moved: Mutex<Instant>,
    changed: Notify,
}

impl<'a> FrameCounter<'a> {
    pub(crate) fn new(handle: &'a Handle, recorder: &'a Recorder) -> Self {
        let (still, connected) = (Mutex::new(None), Mutex::new(false));
        let (moved, changed) = (Mutex::new(Instant::now()), Notify::new());
        let log = LinkLog::default();
        Self { handle, recorder, log, still, connected, moved, changed }
    }

    pub(crate) fn take(&self, event: Event) {
        self.log.take(&event);
        self.recorder.keep(self.handle.now_ns(), &event);
        match event {
            Event::Frame(received) => {
                self.handle.ack(received.connection, received.header.sequence);
                *self.still.lock() = received.header.still.then_some(received);
            }
            Event::State(LinkState::Silent | LinkState::Heard) => {}
            Event::State(state) => {
                *self.connected.lock() = matches!(state, LinkState::Connected { .. });
            }
            Event::Message(_) => {}
            Event::Sent(_) | Event::Unreadable(_) => return,
        }
        *self.moved.lock() = Instant::now();
        self.changed.notify_waiters();
    }

    /// Waits for an event.
    async fn until<T>(&self, look: impl Fn(&Self) -> Option<T>) -> T {
        loop {
            let changed = self.changed.notified();
            if let Some(found) = look(self) {
                return found;
            }
            changed.await;
        }
    }

    /// Waits for a connection and sends the pose; gives its number, 0 without a pose.
    pub(crate) async fn look(&self, look: Option<OrbitPose>) -> u64 {
        self.until(|watch| watch.connected.lock().then_some(())).await;
        let pose = look.map(PoseKind::Orbit);
        pose.and_then(|pose| self.handle.pose(self.handle.now_ns(), pose)).unwrap_or(0)
    }

    /// The still frame that shows message `seq`. A message that changes nothing is shown by none:
    /// after a while without frames and messages the newest frame counts, if it is still; what
    /// moves is shown at once, so it would not be.
    pub(crate) async fn still_after(&self, seq: u64) -> Received {
        *self.moved.lock() = Instant::now();
        loop {
            let newest = self.until(|watch| watch.still.lock().clone());
            if let Ok(still) = timeout(QUIET, newest).await {
                let quiet = self.moved.lock().elapsed() > QUIET;
                if quiet || still.header.shows_seq >= seq {
                    return still;
                }
            }
            tokio::time::sleep(QUIET / 50).await;
        }
    }
}
