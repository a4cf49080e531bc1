//! `relief client` with a window.

use std::time::Duration;

use anyhow::bail;

use crate::client::arguments::{self, ClientArguments, RestChoice};
use crate::client::eyes;
use crate::client::remote::Tracking;
use crate::client::session::Session;
use crate::client::watch::{LinkLog, Recorder};
use crate::stop::stop_signal;
use relief_client::{Composer, Event, Handle, Lettering, LinkState, Screen, Window, WindowOptions};
use relief_live::{OrbitPose, PoseKind, Role};
use relief_render::{TextMask, text_mask};

/// Interval at which the window gets the state of tracking.
const TRACKING: Duration = Duration::from_millis(100);

pub(crate) fn run(
    arguments: &ClientArguments,
    session: &Session,
    handle: &Handle,
    tracking: Tracking,
    recorder: Recorder,
    runtime: &tokio::runtime::Runtime,
) -> anyhow::Result<()> {
    let composer = composer(session, arguments.window.rest)?;
    let window = Window::new()?;
    let screen = window.screen();
    eyes::start(&arguments.eyes, handle, Box::new(move |eyes| screen.follow(eyes)))?;
    let options = window_options(arguments, session);
    let recorder = std::sync::Arc::new(recorder);
    let running = {
        let live = Live {
            screen: window.screen(),
            handle: handle.clone(),
            recorder: std::sync::Arc::clone(&recorder),
            log: LinkLog::default(),
            look: parking_lot::Mutex::new(arguments.look),
        };
        let options = session.options.clone();
        let signal = {
            let _runtime = runtime.enter();
            stop_signal()?
        };
        runtime.spawn(async move {
            let on = |event| live.take(&event);
            let link = relief_client::run(&options, &live.handle, &on);
            let ended = async {
                tokio::select! {
                    () = signal => live.handle.stop(),
                    () = tell_tracking(&tracking, &live.screen) => {}
                    () = live.screen.show_rendered_views(&options) => {}
                }
                std::future::pending::<()>().await;
            };
            let outcome = tokio::select! {
                linked = link => linked,
                () = ended => Ok(()),
            };
            live.screen.stop();
            outcome
        })
    };
    let followed = window.show(options, handle, composer)?;
    if let Some(mean) = followed.mean() {
        let [mean, longest] = [mean, followed.longest].map(|time| 1e3 * time.as_secs_f64());
        eprintln!(
            "views followed the eyes {} times: shown {mean:.1} ms after they came, {longest:.1} ms at most",
            followed.views
        );
    }
    let linked = runtime.block_on(running)?;
    recorder.finish()?;
    Ok(linked?)
}

/// The composer of the window, with the views of a picture at rest that were chosen.
fn composer(session: &Session, rest: Option<RestChoice>) -> anyhow::Result<Composer> {
    if rest.is_some() && session.layout.view_count() == 0 {
        bail!("--rest is for layouts of views, such as stereo or views-9; this one is {}", session.layout);
    }
    let composer = session.composer.clone();
    Ok(if rest == Some(RestChoice::Synthesised) { composer.with_synthesised_rest() } else { composer })
}

fn window_options(arguments: &ClientArguments, session: &Session) -> WindowOptions {
    let &arguments::WindowArguments { fullscreen, windowed, monitor, clean, .. } = &arguments.window;
    let (host, port) = session.options.server.target();
    WindowOptions {
        fullscreen: fullscreen && !windowed,
        monitor,
        clean,
        layout: session.layout,
        frame_px: session.frame_px,
        presents: session.options.hello.role == Role::Presenter,
        waiting: format!("waiting for {host}:{port}"),
        lettering: |text, height_px| {
            let TextMask { size_px, coverage } = text_mask(text, height_px);
            Lettering { size_px, coverage }
        },
    }
}

/// Passes the state of tracking to the window, where the client tracks.
async fn tell_tracking(tracking: &Tracking, screen: &Screen) {
    loop {
        let known = *tracking.lock();
        if known.is_some() {
            screen.tracking(known);
        }
        tokio::time::sleep(TRACKING).await;
    }
}

/// Handles the events of a session with a window.
struct Live {
    screen: Screen,
    handle: Handle,
    recorder: std::sync::Arc<Recorder>,
    log: LinkLog,
    look: parking_lot::Mutex<Option<OrbitPose>>,
}

impl Live {
    fn take(&self, event: &Event) {
        self.log.take(event);
        self.recorder.keep(self.handle.now_ns(), event);
        self.screen.take(event);
        if matches!(event, Event::State(LinkState::Connected { .. })) {
            let look = self.look.lock().take();
            if let Some(look) = look {
                self.handle.pose(self.handle.now_ns(), PoseKind::Orbit(look));
            }
        }
    }
}
