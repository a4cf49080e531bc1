//! The Wiimote of a display box: tracked here, or its reports relayed for the server to track.

use std::sync::Arc;
use std::time::{Duration, Instant};

use parking_lot::Mutex;

use crate::track::scene::TrackSceneArguments;
use crate::track::source::{Event, LiveOptions, Source};
use relief_client::Handle;
use relief_live::{PoseKind, RemotePose};
use relief_tracking::{
    Buttons, InputReport, Sensitivity, Tracker, TrackerOptions, TrackingState, quantised_noise,
};

#[derive(Debug, clap::Args)]
pub(crate) struct RemoteArguments {
    /// Wiimote: hidraw (the first one found), /dev/hidrawN, a recording, tcp://HOST:PORT, or none
    #[arg(long, value_name = "SOURCE", default_value = "none")]
    wiimote: String,
    /// Send the Wiimote's reports as they are, for the server to track (relief serve --sensor,
    /// --beacon)
    #[arg(long, conflicts_with_all = ["beacon", "sensor"])]
    relay_reports: bool,
    #[command(flatten)]
    scene: TrackSceneArguments,
    /// Sensitivity of the camera, 1 to 6: the highest that sees no stray light
    #[arg(long, value_name = "LEVEL", default_value_t = 3, value_parser = clap::value_parser!(u8).range(1..=6))]
    sensitivity: u8,
}

impl RemoteArguments {
    /// Whether there is to be a Wiimote.
    pub(crate) fn is_there(&self) -> bool {
        self.wiimote != "none"
    }
}

/// The state of tracking, for display; `None` without a Wiimote, and where the server tracks.
pub(crate) type Tracking = Arc<Mutex<Option<TrackingState>>>;

/// A Wiimote that says nothing for so long is away, and no hand holds its buttons.
const SILENT: Duration = Duration::from_millis(500);
/// The time between two searches for a missing Wiimote.
const LOOK_AGAIN: Duration = Duration::from_secs(1);

/// Starts reading, on a thread that ends with the program.
pub(crate) fn start(arguments: &RemoteArguments, handle: &Handle) -> anyhow::Result<Tracking> {
    let tracking = Tracking::default();
    if !arguments.is_there() {
        return Ok(tracking);
    }
    let scene = &arguments.scene;
    let options = TrackerOptions { noise_px: quantised_noise(scene.noise_px()), ..TrackerOptions::default() };
    let tracker = Tracker::new(scene.camera()?, scene.beacon()?, options);
    let tracker = (!arguments.relay_reports).then_some(tracker);
    let sensitivity = Sensitivity::of_level(arguments.sensitivity).unwrap_or_default();
    let live = LiveOptions { sensitivity, gyroscope: false, full: false, realtime: true, record: None };
    let name = arguments.wiimote.clone();
    let source = match Source::open(&name, &live) {
        Ok(source) => Some(source),
        // It may be paired later.
        Err(error) if name.contains("hidraw") => {
            eprintln!("{error:#}; looking for it");
            None
        }
        Err(error) => return Err(error),
    };
    let hand = Arc::new(Mutex::new(RemoteReader::new(handle, tracker, Arc::clone(&tracking))));
    watch_for_silence(Arc::clone(&hand))?;
    let stopped = handle.clone();
    let read = move || {
        let mut source = source;
        while !stopped.is_stopped() {
            let Some(open) = source.as_mut() else {
                std::thread::sleep(LOOK_AGAIN);
                source = Source::open(&name, &live).ok();
                continue;
            };
            match open.next() {
                Ok(Some(event)) => hand.lock().take(event),
                Ok(None) => return,
                Err(error) => {
                    eprintln!("the Wiimote cannot be read: {error:#}");
                    return;
                }
            }
        }
    };
    std::thread::Builder::new().name("wiimote".to_owned()).spawn(read)?;
    Ok(tracking)
}

/// Releases everything when messages stop.
fn watch_for_silence(hand: Arc<Mutex<RemoteReader>>) -> anyhow::Result<()> {
    let watch = move || {
        loop {
            std::thread::sleep(SILENT / 5);
            let mut hand = hand.lock();
            if hand.handle.is_stopped() {
                return;
            }
            if hand.heard.is_some_and(|heard| heard.elapsed() > SILENT) {
                hand.fall_silent();
            }
        }
    };
    std::thread::Builder::new().name("wiimote-silence".to_owned()).spawn(watch)?;
    Ok(())
}

/// Reads the reports of a Wiimote and sends their effects.
struct RemoteReader {
    handle: Handle,
    /// `None` where the server tracks.
    tracker: Option<Tracker>,
    tracking: Tracking,
    buttons: Buttons,
    pose: RemotePose,
    /// Offset of the client's clock to that of the source, ns, since the first report: intervals
    /// between reports are kept.
    ahead_ns: Option<i128>,
    heard: Option<Instant>,
}

impl RemoteReader {
    fn new(handle: &Handle, tracker: Option<Tracker>, tracking: Tracking) -> Self {
        if tracker.is_some() {
            *tracking.lock() = Some(TrackingState::Searching);
        }
        let pose = RemotePose { state: TrackingState::Searching, pose: None, buttons: Vec::new() };
        let handle = handle.clone();
        Self { handle, tracker, tracking, buttons: Buttons::default(), pose, ahead_ns: None, heard: None }
    }

    fn take(&mut self, event: Event) {
        match event {
            Event::Calibration(accelerometer, gyroscope) => {
                if let Some(tracker) = &mut self.tracker {
                    tracker.calibrate(accelerometer, gyroscope);
                }
            }
            Event::Report(t_ns, report) => {
                self.heard = Some(Instant::now());
                let now = self.handle.now_ns();
                let ahead = *self.ahead_ns.get_or_insert(i128::from(now) - i128::from(t_ns));
                let at_ns = u64::try_from(i128::from(t_ns) + ahead).unwrap_or(now);
                self.report(t_ns, at_ns, &report);
            }
        }
    }

    fn report(&mut self, t_ns: u64, at_ns: u64, report: &InputReport) {
        let buttons = report.buttons().unwrap_or(self.buttons);
        let changed = buttons != self.buttons;
        self.buttons = buttons;
        let Some(tracker) = &mut self.tracker else {
            self.handle.report(at_ns, report);
            return;
        };
        let sample = tracker.push(t_ns, report);
        if let Some(sample) = &sample {
            self.pose.state = sample.state;
            self.pose.pose = sample.pose.map(|pose| (pose.position.into(), pose.orientation_xyzw()));
            *self.tracking.lock() = Some(sample.state);
        }
        if sample.is_some() || changed {
            self.pose.buttons = buttons.names().map(str::to_owned).collect();
            self.handle.pose(at_ns, PoseKind::Remote(self.pose.clone()));
        }
    }

    fn fall_silent(&mut self) {
        (self.heard, self.ahead_ns) = (None, None);
        self.buttons = Buttons::default();
        if self.tracker.is_some() {
            self.pose = RemotePose { state: TrackingState::Lost, pose: None, buttons: Vec::new() };
            *self.tracking.lock() = Some(TrackingState::Lost);
            self.handle.pose(self.handle.now_ns(), PoseKind::Remote(self.pose.clone()));
        }
    }
}
