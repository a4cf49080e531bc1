//! A window that shows frames, one pixel of a frame on one pixel of the display.
//!
//! What it is: composing the newest frame on its own thread, showing it unscaled from the window's
//! upper left corner, acknowledging it, and mouse and keys as intents. What it is not: a
//! compositor; where the system scales windows, no header survives, and `show` reports it.
//!
//! Marks of state are drawn only into the shown pixels; see [`Marks`]. Without a connection a line of
//! text takes the picture's place within 5 s: an old picture may be of another patient.

mod feed;
mod follow;
mod freshness;
mod input;
mod notice;
mod rest;
mod screen;

use std::time::Instant;

use winit::error::EventLoopError;
use winit::event_loop::EventLoop;

pub use feed::Screen;
pub use follow::Followed;
pub use notice::Lettering;
pub(crate) use notice::LetteringFn;

use super::compose::{Composed, Composer};
use super::handle::Handle;
use super::link::LinkState;
use super::marks::Marks;
use relief_display::Layout;

/// How the window is.
#[derive(Clone, Debug)]
pub struct WindowOptions {
    /// All of a monitor, without borders.
    pub fullscreen: bool,
    /// The monitor, from 0, in the order of the system; `None` is the one that the system takes.
    pub monitor: Option<usize>,
    /// No marks of state.
    pub clean: bool,
    /// Requested layout of frames.
    pub layout: Layout,
    /// Size of a frame to begin with, pixels.
    pub frame_px: [u32; 2],
    /// Whether mouse and keys move the view.
    pub presents: bool,
    /// The text in place of a picture that is out of date.
    pub waiting: String,
    /// Makes that text.
    pub lettering: LetteringFn,
}

/// Why there is no window.
#[derive(Debug, thiserror::Error)]
pub enum WindowError {
    /// The environment names no display.
    #[error(
        "no window can be opened: DISPLAY is not set; start the client in the session of the display, or set DISPLAY to it, such as :0; --headless works without a window"
    )]
    NoDisplay,
    /// No display of the system can be opened.
    #[error("no window can be opened: {0}; is there a display at DISPLAY? --headless works without one")]
    Open(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The system lost the window.
    #[error("the window was lost: {0}")]
    Lost(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// There are fewer monitors.
    #[error("no monitor has the number {asked}; {found} are connected, numbered from 0")]
    Monitor {
        /// The requested number.
        asked: usize,
        /// The number found.
        found: usize,
    },
}

/// Events from other threads.
#[derive(Debug)]
enum SessionEvent {
    /// A frame of this connection was composed.
    Frame(u64, Box<Composed>),
    /// The newest frame was composed of views that the server has rendered.
    Rendered(Box<Composed>),
    /// The newest frame was composed anew for eyes that came then.
    Followed(Instant, Box<Composed>),
    /// Marks may have changed.
    Marks(Marks),
    /// The connection changed.
    Link(LinkState),
    /// The session is over.
    Stop,
}

/// A window that is not open yet.
pub struct Window {
    events: EventLoop<SessionEvent>,
    screen: Screen,
}

impl Window {
    /// Connects to the system's display.
    ///
    /// # Errors
    /// When there is no display.
    pub fn new() -> Result<Self, WindowError> {
        let is_set = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
        if cfg!(target_os = "linux") && !is_set("DISPLAY") && !is_set("WAYLAND_DISPLAY") {
            return Err(WindowError::NoDisplay);
        }
        let events = EventLoop::with_user_event().build();
        let events = events.map_err(|error| WindowError::Open(reason(&error).into()))?;
        let screen = Screen::new(events.create_proxy());
        Ok(Self { events, screen })
    }

    /// The receiver of frames.
    #[must_use]
    pub fn screen(&self) -> Screen {
        self.screen.clone()
    }

    /// Shows frames until the window is closed or the session ends, and says how quickly views
    /// followed a tracked viewer. Call it on the main thread.
    ///
    /// # Errors
    /// When the window cannot be opened, or is lost.
    pub fn show(
        self,
        options: WindowOptions,
        handle: &Handle,
        composer: Composer,
    ) -> Result<Followed, WindowError> {
        let compose = {
            let (screen, handle) = (self.screen.clone(), handle.clone());
            move || screen.compose_all(&composer, &handle)
        };
        let composing = std::thread::Builder::new().name("compose".to_owned()).spawn(compose);
        let composing = composing.map_err(|error| WindowError::Open(error.into()))?;
        let mut app = screen::App::new(options, handle.clone());
        let ran = self.events.run_app(&mut app).map_err(|error| WindowError::Lost(error.into()));
        handle.stop();
        self.screen.stop();
        let _ = composing.join(); // its panic was reported already
        ran.and(app.outcome())
    }
}

/// The system's reason without the place in the source code of the library that reports it.
fn reason(error: &EventLoopError) -> String {
    let text = error.to_string();
    match text.strip_prefix("os error at ").and_then(|place_and_reason| place_and_reason.split_once(": ")) {
        Some((_, reason)) => reason.to_owned(),
        None => text,
    }
}
