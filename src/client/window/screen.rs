//! The window itself.

use std::num::NonZeroU32;
use std::rc::Rc;
use std::time::Instant;

use softbuffer::{Context, Surface};
use winit::application::ApplicationHandler;
use winit::dpi::{PhysicalPosition, PhysicalSize};
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, ControlFlow, OwnedDisplayHandle};
use winit::monitor::MonitorHandle;
use winit::window::{Fullscreen, Window, WindowId};

use super::follow::Followed;
use super::freshness::Freshness;
use super::input::{Input, Meaning};
use super::{SessionEvent, WindowError, WindowOptions, notice};
use crate::handle::Handle;
use crate::link::LinkState;
use crate::marks::Marks;
use crate::place::PicturePlace;
use relief_display::{Frame, Layout, Pixels};
use relief_live::{Intent, PlacePhase};

type Pane = Surface<OwnedDisplayHandle, Rc<Window>>;

/// The state of the window's event loop.
pub(super) struct App {
    options: WindowOptions,
    handle: Handle,
    pane: Option<Pane>,
    input: Input,
    marks: Marks,
    freshness: Freshness,
    layout: Layout,
    frame: Option<Frame>,
    /// The newest frame's connection and number, until it was shown.
    unshown: Option<(u64, u32)>,
    /// When the eyes came that the frame was composed for, until it was shown.
    following: Option<Instant>,
    followed: Followed,
    warned: ShownWarnings,
    outcome: Result<(), WindowError>,
}

/// Warnings that were printed once.
#[derive(Default)]
struct ShownWarnings {
    scale: bool,
    size: Option<[u32; 2]>,
}

impl App {
    pub(super) fn new(options: WindowOptions, handle: Handle) -> Self {
        let layout = options.layout;
        Self {
            options,
            handle,
            pane: None,
            input: Input::default(),
            marks: Marks { tracking: None, offline: true },
            freshness: Freshness::new(),
            layout,
            frame: None,
            unshown: None,
            following: None,
            followed: Followed::default(),
            warned: ShownWarnings::default(),
            outcome: Ok(()),
        }
    }

    pub(super) fn outcome(self) -> Result<Followed, WindowError> {
        self.outcome.map(|()| self.followed)
    }

    fn open(&self, events: &ActiveEventLoop) -> Result<Pane, WindowError> {
        let [width, height] = self.options.frame_px;
        let mut attributes = Window::default_attributes()
            .with_title("Relief")
            .with_inner_size(PhysicalSize::new(width, height))
            .with_resizable(true);
        let monitor = self.monitor(events)?;
        if self.options.fullscreen {
            attributes = attributes.with_fullscreen(Some(Fullscreen::Borderless(monitor)));
        } else if let Some(monitor) = monitor {
            attributes = attributes.with_position(monitor.position());
        }
        let window =
            Rc::new(events.create_window(attributes).map_err(|error| WindowError::Open(error.into()))?);
        // A mouse pointer over the frame would alter its pixels.
        window.set_cursor_visible(!self.options.fullscreen);
        let context = Context::new(events.owned_display_handle()).map_err(|error| unusable(&error))?;
        Surface::new(&context, window).map_err(|error| unusable(&error))
    }

    fn monitor(&self, events: &ActiveEventLoop) -> Result<Option<MonitorHandle>, WindowError> {
        let Some(asked) = self.options.monitor else { return Ok(None) };
        let mut monitors: Vec<_> = events.available_monitors().collect();
        // From left to right, then from the top: the order that people see.
        monitors.sort_by_key(|monitor| {
            let PhysicalPosition { x, y } = monitor.position();
            (x, y)
        });
        let found = monitors.len();
        monitors.into_iter().nth(asked).map(Some).ok_or(WindowError::Monitor { asked, found })
    }

    fn place(&self) -> PicturePlace {
        let frame_px = self.frame.as_ref().map_or(self.options.frame_px, Frame::size_px);
        PicturePlace::of(self.layout, frame_px)
    }

    fn say(&self, intent: Option<Intent>) {
        if let Some(intent) = intent.filter(|_| self.options.presents) {
            self.handle.intent(self.handle.now_ns(), intent);
        }
    }

    /// Says once what keeps pixels from being exact.
    fn warn(&mut self, window_px: [u32; 2], scale: f64) {
        if (scale - 1.0).abs() > 1e-6 && !std::mem::replace(&mut self.warned.scale, true) {
            tracing::warn!(
                scale,
                "the system scales this monitor: where it scales windows too, no header reaches the display; set its scale to 1"
            );
        }
        let Some(frame_px) = self.frame.as_ref().map(Frame::size_px) else { return };
        if window_px != frame_px && self.warned.size.replace(window_px) != Some(window_px) {
            let [window_width, window_height] = window_px;
            let [width, height] = frame_px;
            tracing::warn!(
                "the window is {window_width}x{window_height} and the frame {width}x{height}: it is shown unscaled, from the upper left"
            );
        }
    }

    fn draw(&mut self) -> Result<(), WindowError> {
        let Some(mut pane) = self.pane.take() else { return Ok(()) };
        let drawn = self.draw_on(&mut pane);
        self.pane = Some(pane);
        drawn
    }

    fn draw_on(&mut self, pane: &mut Pane) -> Result<(), WindowError> {
        let lost = |error: softbuffer::SoftBufferError| WindowError::Lost(error.to_string().into());
        let (size, scale) = (pane.window().inner_size(), pane.window().scale_factor());
        let (Some(width), Some(height)) = (NonZeroU32::new(size.width), NonZeroU32::new(size.height)) else {
            return Ok(()); // minimised
        };
        self.warn([size.width, size.height], scale);
        pane.resize(width, height).map_err(lost)?;
        pane.window().pre_present_notify();
        let mut buffer = pane.buffer_mut().map_err(lost)?;
        if self.freshness.is_stale(Instant::now()) {
            let WindowOptions { waiting, lettering, .. } = &self.options;
            notice::draw(waiting, *lettering, &mut buffer, [size.width, size.height]);
            return buffer.present().map_err(lost);
        }
        let marks = if self.options.clean { Marks::default() } else { self.marks };
        let frame = self.frame.clone().and_then(|frame| marks.draw(self.layout, frame).ok());
        put(frame.as_ref(), &mut buffer, size.width as usize);
        buffer.present().map_err(lost)?;
        if let Some((connection, sequence)) = self.unshown.take() {
            self.handle.ack(connection, sequence);
        }
        if let Some(since) = self.following.take() {
            self.followed.shown(since);
        }
        Ok(())
    }

    fn request_draw(&self) {
        if let Some(pane) = &self.pane {
            pane.window().request_redraw();
        }
    }

    /// The window takes the size of frames, unless it is all of a monitor.
    fn fit(&self, frame_px: [u32; 2]) {
        let Some(window) = self.pane.as_ref().map(Surface::window) else { return };
        let [width, height] = frame_px;
        let size = PhysicalSize::new(width, height);
        if window.fullscreen().is_none() && window.inner_size() != size {
            let _ = window.request_inner_size(size); // what the system makes of it comes as an event
        }
    }

    fn end(&mut self, events: &ActiveEventLoop, outcome: Result<(), WindowError>) {
        if self.outcome.is_ok() {
            self.outcome = outcome;
        }
        events.exit();
    }

    fn toggle_fullscreen(&self) {
        let Some(window) = self.pane.as_ref().map(Surface::window) else { return };
        let fullscreen = window.fullscreen().is_none();
        window.set_fullscreen(fullscreen.then_some(Fullscreen::Borderless(None)));
        window.set_cursor_visible(!fullscreen);
    }
}

impl ApplicationHandler<SessionEvent> for App {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.pane.is_none() {
            match self.open(events) {
                Ok(pane) => self.pane = Some(pane),
                Err(error) => self.end(events, Err(error)),
            }
        }
    }

    fn user_event(&mut self, events: &ActiveEventLoop, wake: SessionEvent) {
        match wake {
            SessionEvent::Frame(connection, composed) => {
                self.layout = composed.layout;
                let is_resized = self.frame.as_ref().map(Frame::size_px) != Some(composed.frame.size_px());
                self.freshness.frame(connection);
                self.unshown = Some((connection, composed.header.sequence));
                self.frame = Some(composed.frame);
                if let Some(frame_px) = self.frame.as_ref().map(Frame::size_px).filter(|_| is_resized) {
                    self.fit(frame_px);
                }
            }
            SessionEvent::Rendered(composed) => self.frame = Some(composed.frame),
            SessionEvent::Followed(since, composed) => {
                self.frame = Some(composed.frame);
                self.following.get_or_insert(since);
            }
            SessionEvent::Marks(marks) => self.marks = marks,
            SessionEvent::Link(state) => match state {
                LinkState::Connected { connection, resumed, .. } => {
                    self.freshness.connected(connection, resumed);
                }
                LinkState::Lost { .. } => self.freshness.lost(Instant::now()),
                LinkState::Silent => self.freshness.silent(),
                LinkState::Heard => self.freshness.heard(),
                LinkState::Connecting => {}
            },
            SessionEvent::Stop => return events.exit(),
        }
        self.request_draw();
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let now = Instant::now();
        match self.freshness.deadline() {
            Some(deadline) if deadline > now => events.set_control_flow(ControlFlow::WaitUntil(deadline)),
            Some(_) => {
                self.freshness.update(now);
                events.set_control_flow(ControlFlow::Wait);
                self.request_draw();
            }
            None => events.set_control_flow(ControlFlow::Wait),
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::RedrawRequested => {
                if let Err(error) = self.draw() {
                    self.end(events, Err(error));
                }
            }
            WindowEvent::Resized(_) | WindowEvent::ScaleFactorChanged { .. } => self.request_draw(),
            WindowEvent::ModifiersChanged(modifiers) => self.input.modifiers(modifiers.state()),
            WindowEvent::CursorMoved { position, .. } => {
                let place = self.place();
                let intent = self.input.moved([position.x, position.y], place);
                self.say(intent);
            }
            WindowEvent::MouseInput { state, button, .. } => {
                let place = self.place();
                let intent = self.input.button(button, state, place);
                self.say(intent);
            }
            WindowEvent::MouseWheel { delta, .. } => self.say(Input::wheel(delta)),
            WindowEvent::KeyboardInput { event, .. } => {
                match Input::key(&event.logical_key, event.state, event.repeat) {
                    // A tracked tool is steadied while its button is held.
                    Some(Meaning::Intent(Intent::Place { phase }))
                        if self.handle.hold_tool(phase == PlacePhase::Take) => {}
                    Some(Meaning::Intent(intent)) => self.say(Some(intent)),
                    Some(Meaning::Fullscreen) => self.toggle_fullscreen(),
                    Some(Meaning::Quit) => events.exit(),
                    None => {}
                }
            }
            _ => {}
        }
    }
}

/// The frame from the upper left corner, pixel by pixel; black beside it. The buffer's pixels are
/// 0x00RRGGBB.
fn put(frame: Option<&Frame>, buffer: &mut [u32], width: usize) {
    buffer.fill(0);
    let Some((size_px, Pixels::Rgb8(samples))) = frame.map(|frame| (frame.size_px(), frame.pixels())) else {
        return;
    };
    let row_samples = 3 * size_px[0] as usize;
    for (row, samples) in buffer.chunks_exact_mut(width.max(1)).zip(samples.chunks_exact(row_samples.max(1)))
    {
        for (pixel, [red, green, blue]) in row.iter_mut().zip(samples.as_chunks::<3>().0) {
            *pixel = u32::from_be_bytes([0, *red, *green, *blue]);
        }
    }
}

/// The surface's error as text: it holds raw handles and cannot leave its thread.
fn unusable(error: &softbuffer::SoftBufferError) -> WindowError {
    WindowError::Open(error.to_string().into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_put_pixel_by_pixel_whatever_the_windows_size() {
        let samples: Vec<u8> = (0..2 * 2 * 3).collect();
        let frame = Frame::new([2, 2], Pixels::Rgb8(samples)).unwrap();
        let mut larger = vec![7; 3 * 3];
        put(Some(&frame), &mut larger, 3);
        assert_eq!(larger, [0x000102, 0x030405, 0, 0x060708, 0x090a0b, 0, 0, 0, 0]);
        let mut smaller = vec![7; 1];
        put(Some(&frame), &mut smaller, 1);
        assert_eq!(smaller, [0x000102]);
        put(None, &mut smaller, 1);
        assert_eq!(smaller, [0]);
    }
}
