//! The Wiimote of a session: from its reports or poses to commands.

use std::time::{Duration, Instant};

use axum::http::StatusCode;

use crate::problem::Problem;
use relief_annotation::Device;
use relief_live::{
    Gestures, GrabMode, HandOptions, HandPose, HandSample, Intent, RawReport, RemotePose, TrackingMessage,
};
use relief_tracking::{Beacon, Buttons, Pinhole, Tracker, TrackerOptions, TrackingState};

/// Between two messages about an unchanged state of tracking.
const TELL: Duration = Duration::from_millis(250);

/// See the module.
pub(super) struct Remote {
    gestures: Gestures,
    options: HandOptions,
    tracker: Option<Box<Tracker>>,
    reported: Option<(TrackingState, Instant)>,
    /// Where the device was seen last.
    last: Option<HandPose>,
}

impl Remote {
    /// # Errors
    /// None with the present options.
    pub(super) fn new() -> Result<Self, Problem> {
        let options = HandOptions::default();
        let gestures =
            Gestures::new(options.clone()).map_err(|error| Problem::internal("gestures", error))?;
        Ok(Self { gestures, options, tracker: None, reported: None, last: None })
    }

    pub(super) fn set_grab_mode(&mut self, grab_mode: GrabMode) -> Result<(), Problem> {
        self.options.grab_mode = grab_mode;
        self.gestures.configure(self.options.clone()).map_err(Problem::refused_intent)
    }

    /// The intents of a pose and its buttons; of a late pose only those of the buttons.
    ///
    /// # Errors
    /// When the numbers are no pose.
    pub(super) fn pose(
        &mut self,
        t_ns: u64,
        pose: &RemotePose,
        is_newest: bool,
    ) -> Result<Vec<Intent>, Problem> {
        let hand = pose.pose.map(|(position, orientation)| HandPose::new(position, orientation));
        let hand = hand.transpose().map_err(Problem::refused_intent)?;
        self.last = hand.filter(|_| is_newest).or(self.last);
        let mut intents = self.gestures.hold(t_ns, buttons(&pose.buttons));
        if is_newest {
            intents.extend(self.gestures.track(&HandSample { t_ns, state: pose.state, pose: hand }));
        }
        Ok(intents)
    }

    /// The intents of a report, and the message about tracking.
    ///
    /// # Errors
    /// When it is invalid.
    pub(super) fn report(
        &mut self,
        message: &RawReport,
        sensor: &Pinhole,
        beacon: &Beacon,
        now: Instant,
    ) -> Result<(Vec<Intent>, Option<TrackingMessage>), Problem> {
        let malformed = |detail: String| {
            Problem::new(StatusCode::BAD_REQUEST, "malformed-report", detail).with("path", "report")
        };
        let bytes = message.bytes().map_err(|error| malformed(error.to_string()))?;
        let report =
            relief_tracking::InputReport::decode(&bytes).map_err(|error| malformed(error.to_string()))?;
        let tracker = self.tracker.get_or_insert_with(|| {
            Box::new(Tracker::new(*sensor, beacon.clone(), TrackerOptions::default()))
        });
        let held = report.buttons().map(|held| self.gestures.hold(message.t_ns, held));
        let mut intents = held.unwrap_or_default();
        let Some(sample) = tracker.push(message.t_ns, &report) else { return Ok((intents, None)) };
        let hand = HandSample::from(&sample);
        self.last = hand.pose.or(self.last);
        intents.extend(self.gestures.track(&hand));
        let is_due = self.reported.is_none_or(|(state, at)| state != sample.state || now - at >= TELL);
        let tracking = TrackingMessage { state: sample.state, leds: sample.leds, rms_px: sample.rms_px };
        if is_due {
            self.reported = Some((sample.state, now));
        }
        Ok((intents, is_due.then_some(tracking)))
    }

    /// The device as the record of a placement has it.
    pub(super) fn device(&self) -> Device {
        Device {
            kind: "wiimote".to_owned(),
            position_mm: self.last.map(|pose| pose.position_mm()),
            orientation_xyzw: self.last.map(|pose| pose.orientation_xyzw()),
        }
    }

    /// The hand is gone.
    pub(super) fn end(&mut self) -> Vec<Intent> {
        self.tracker = None;
        self.reported = None;
        self.gestures.end()
    }
}

/// Buttons by their names, which the protocol has checked.
fn buttons(names: &[String]) -> Buttons {
    let named = |(_, name): &&(Buttons, &str)| names.iter().any(|given| given == name);
    Buttons::ALL.iter().filter(named).fold(Buttons::default(), |held, (button, _)| held.with(*button))
}
