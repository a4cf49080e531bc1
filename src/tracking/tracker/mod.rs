//! From reports to poses, one after another.
//!
//! A [`Tracker`] takes timed reports and returns a [`TrackedSample`] for each that contains the
//! camera's picture. It is searching until four blobs are identified, then tracking: blobs are
//! matched to the LEDs where the filter expects them, and one LED is enough to correct it. Without
//! any LED for [`MAX_PREDICTION_S`] it is lost, and searches with the last pose as a hint. An
//! ambiguous view has no pose.
//!
//! Reports may come twice, late or not at all: a report that is not newer than the last one is
//! dropped, and the filter moves by the time between reports. Every sample carries the time of its
//! report.

mod associate;
mod frames;
mod options;
mod record;
mod sightings;

use crate::filter::error_state::MAX_PREDICTION_S;
pub(crate) use frames::body_from_sensor;
pub use frames::{Frame, Frames};
pub use options::{FilterKind, SolverKind, TrackerOptions};
pub use record::PoseRecord;

use nalgebra::Matrix6;

use super::beacon::Beacon;
use super::correspondence::{Assignment, EarlierPose, Identified, IdentifyHints, identify_blobs};
use super::filter::{ErrorStateFilter, PoseFilter, Verdict};
use super::pose::{Pose, SensorPose};
use super::report::calibration::AccelerometerCalibration;
use super::report::motion_plus::GyroCalibration;
use super::sensor::Pinhole;
use super::solve::{MAX_SEEN, PoseView, Sighting, paper};
use associate::Association;
use sightings::Sightings;

/// A pose older than this is not used as a hint, seconds.
const HINT_S: f64 = 2.0;

/// The time for which an error of the accelerometer's up lasts, seconds.
const GRAVITY_ERROR_S: f64 = 0.15;

/// The tracker's state after a report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TrackingState {
    /// No pose yet.
    Searching,
    /// There is a pose.
    Tracking,
    /// There are blobs, but more than one pose explains them.
    Ambiguous,
    /// The pose was lost.
    Lost,
}

/// The result of a report for the pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackedSample {
    /// Time of the report, ns.
    pub t_ns: u64,
    /// The tracking state.
    pub state: TrackingState,
    /// `beacon_from_sensor`, while tracking.
    pub pose: Option<SensorPose>,
    /// Covariance of position (mm) and turn (radians, beacon axes).
    pub covariance: Option<Matrix6<f64>>,
    /// Root mean square of the matched blobs' errors, px.
    pub rms_px: Option<f64>,
    /// The number of matched blobs.
    pub leds: usize,
}

/// The numbers of dropped reports, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DroppedReports {
    /// Not newer than the last.
    pub late: u64,
    /// The same as the last, within 2 ms.
    pub repeated: u64,
}

/// The pose so far.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "a tracker has one, and nothing is allocated while tracking")]
enum Estimate {
    None,
    Solved { pose: Pose, t_ns: u64 },
    ErrorState { filter: ErrorStateFilter, t_ns: u64, seen_ns: u64 },
    Plain { filter: PoseFilter, t_ns: u64 },
}

/// A pose of this frame with its covariance and residuals.
struct Fix {
    pose: Pose,
    covariance: Matrix6<f64>,
    rms_px: Option<f64>,
    leds: usize,
}

/// See the module.
#[derive(Clone, Debug)]
pub struct Tracker {
    camera: Pinhole,
    beacon: Beacon,
    options: TrackerOptions,
    frames: Frames,
    estimate: Estimate,
    had_pose: bool,
}

impl Tracker {
    /// A tracker that has seen nothing yet.
    #[must_use]
    pub fn new(camera: Pinhole, beacon: Beacon, options: TrackerOptions) -> Self {
        let frames = Frames::new(options.accelerometer, options.gyroscope);
        Self { camera, beacon, options, frames, estimate: Estimate::None, had_pose: false }
    }

    /// Sets the calibration of accelerometer counts: a remote reports its own calibration after it
    /// was connected.
    pub fn calibrate(
        &mut self,
        accelerometer: Option<AccelerometerCalibration>,
        gyroscope: Option<GyroCalibration>,
    ) {
        self.frames.calibrate(accelerometer, gyroscope);
    }

    /// Reports that were dropped so far.
    #[must_use]
    pub fn dropped(&self) -> DroppedReports {
        self.frames.dropped()
    }

    /// Takes a report; gives a sample if it completes a picture of the camera.
    pub fn push(&mut self, t_ns: u64, report: &super::report::InputReport) -> Option<TrackedSample> {
        let frame = self.frames.push(t_ns, report)?;
        Some(self.take(&frame))
    }

    /// Takes a picture of the camera; its time is newer than that of the last one.
    pub fn take(&mut self, frame: &Frame) -> TrackedSample {
        let sample = match &self.estimate {
            Estimate::ErrorState { .. } => self.follow(frame),
            _ => None,
        };
        let sample = sample.unwrap_or_else(|| self.find(frame));
        self.had_pose |= sample.pose.is_some();
        sample
    }

    /// The pose `seconds` after the last sample, at most 0.05 s; `None` when there is
    /// no sample to predict from.
    #[must_use]
    pub fn predicted(&self, seconds: f64) -> Option<SensorPose> {
        match &self.estimate {
            Estimate::ErrorState { filter, .. } => Some(filter.predicted(seconds).state().pose),
            _ => None,
        }
    }

    /// One step of the error-state filter; `None` when it has lost the LEDs and they must be found
    /// again.
    fn follow(&mut self, frame: &Frame) -> Option<TrackedSample> {
        let Estimate::ErrorState { filter, t_ns, seen_ns } = &mut self.estimate else { return None };
        let seconds = seconds_between(*t_ns, frame.t_ns);
        filter.predict(seconds);
        *t_ns = frame.t_ns;
        if let Some(rates) = frame.rates.filter(|_| self.options.use_gyroscope) {
            filter.update_rates(&rates, self.options.gyroscope_sigma);
        }
        let association =
            associate::associate(filter, &self.camera, &self.beacon, frame.blobs(), &self.options);
        let mut ambiguous = false;
        let mut taken = 0;
        match association {
            Association::Matched(sightings) => {
                let update = filter.update_pixels(&self.camera, sightings.as_slice(), self.options.noise_px);
                if update.verdict == Verdict::Accepted {
                    taken = sightings.as_slice().len();
                    *seen_ns = frame.t_ns;
                }
            }
            Association::Ambiguous => ambiguous = true,
            Association::Nothing => {}
        }
        // Four LEDs say more about the tilt than an accelerometer in a moving hand. Its errors last
        // longer than a frame, so each of its many samples weighs less.
        let slowness = (2.0 * GRAVITY_ERROR_S / seconds.max(1e-3)).sqrt().max(1.0);
        if taken < MAX_SEEN
            && let Some(gravity) = frame.gravity(&self.beacon, self.options.gravity_sigma * slowness)
        {
            filter.update_gravity(&gravity);
        }
        if seconds_between(*seen_ns, frame.t_ns) > MAX_PREDICTION_S {
            let pose = filter.pose();
            self.estimate = Estimate::Solved { pose, t_ns: *seen_ns };
            return None;
        }
        if ambiguous {
            return Some(TrackedSample::without_pose(frame.t_ns, TrackingState::Ambiguous));
        }
        let pose = filter.pose();
        let rms_px = match association {
            Association::Matched(seen) if taken > 0 => {
                let sightings = seen.as_slice();
                let (camera, noise_px) = (&self.camera, self.options.noise_px);
                PoseView { camera, sightings, noise_px, gravity: None }.rms_px(&pose)
            }
            _ => None,
        };
        Some(TrackedSample {
            t_ns: frame.t_ns,
            state: TrackingState::Tracking,
            pose: Some(filter.state().pose),
            covariance: Some(filter.covariance()),
            rms_px,
            leds: taken,
        })
    }

    /// Identifies the blobs of a frame on their own, and begins or corrects the estimate with the
    /// pose.
    fn find(&mut self, frame: &Frame) -> TrackedSample {
        let without = if self.had_pose { TrackingState::Lost } else { TrackingState::Searching };
        let hints = self.hints(frame);
        let enough = frame.blobs().len() >= if hints.earlier.is_some() { 3 } else { 4 };
        if !enough {
            return TrackedSample::without_pose(frame.t_ns, without);
        }
        match identify_blobs(&self.camera, &self.beacon, frame.blobs(), self.options.noise_px, &hints) {
            Identified::Found { assignment, refined, .. } => {
                match self.fix(frame, &assignment, &refined.pose) {
                    Some(fix) => self.accept(frame.t_ns, &fix),
                    None => TrackedSample::without_pose(frame.t_ns, without),
                }
            }
            Identified::Ambiguous { .. } => TrackedSample::without_pose(frame.t_ns, TrackingState::Ambiguous),
            Identified::Unexplained(_) => TrackedSample::without_pose(frame.t_ns, without),
        }
    }

    fn hints(&self, frame: &Frame) -> IdentifyHints {
        let last = match &self.estimate {
            Estimate::None => None,
            Estimate::Solved { pose, t_ns } => Some((*pose, *t_ns)),
            Estimate::ErrorState { filter, t_ns, .. } => Some((filter.pose(), *t_ns)),
            Estimate::Plain { filter, t_ns } => Some((filter.pose().inverse(), *t_ns)),
        };
        let earlier = last.map(|(pose, t_ns)| (pose, seconds_between(t_ns, frame.t_ns)));
        // Without a filter a frame depends on no other one.
        let is_hint = |seconds: f64| seconds < HINT_S && self.options.filter != FilterKind::None;
        let earlier = earlier.filter(|(_, seconds)| is_hint(*seconds)).map(|(pose, seconds)| EarlierPose {
            pose,
            // A single view is known to a degree and 20 mm, and a hand turns by a radian and moves
            // by 0.5 m in a second.
            sigma_angle: 0.02 + seconds,
            sigma_mm: 20.0 + 500.0 * seconds,
            reach_px: 10.0 + 2.0 * self.camera.fx * seconds, // and it turns by 2 radians at most
        });
        IdentifyHints { gravity: frame.gravity(&self.beacon, self.options.search_gravity_sigma), earlier }
    }

    /// The pose of identified blobs by the chosen solver; from pixels alone where four are visible.
    fn fix(&self, frame: &Frame, assignment: &Assignment, found: &Pose) -> Option<Fix> {
        let mut sightings = Sightings::default();
        for (blob, led) in frame.blobs().iter().zip(assignment) {
            sightings.push(Sighting { led: self.beacon.leds()[(*led)?], pixel: *blob });
        }
        let mut view = self.view(sightings.as_slice());
        if sightings.as_slice().len() < MAX_SEEN {
            view.gravity = frame.gravity(&self.beacon, self.options.gravity_sigma);
        }
        let pose = match self.options.solver {
            SolverKind::Lm => view.refine(found)?.pose,
            SolverKind::Paper => paper::solve_as_published(&view, found)?.pose,
            #[cfg(feature = "ipopt")]
            SolverKind::Ipopt => super::solve::ipopt::solve_with_ipopt(&view, found)?.pose,
        };
        Some(Fix {
            pose,
            covariance: view.bound(&pose)?,
            rms_px: view.rms_px(&pose),
            leds: sightings.as_slice().len(),
        })
    }

    fn accept(&mut self, t_ns: u64, fix: &Fix) -> TrackedSample {
        let motion = self.options.motion;
        let (mut pose, mut covariance) = (fix.pose.inverse(), fix.covariance);
        self.estimate = match (self.options.filter, std::mem::replace(&mut self.estimate, Estimate::None)) {
            (FilterKind::None, _) => Estimate::Solved { pose: fix.pose, t_ns },
            (FilterKind::ErrorState, _) => {
                let filter = ErrorStateFilter::new(&fix.pose, &fix.covariance, motion);
                Estimate::ErrorState { filter, t_ns, seen_ns: t_ns }
            }
            (FilterKind::Pose, Estimate::Plain { mut filter, t_ns: then })
                if seconds_between(then, t_ns) <= MAX_PREDICTION_S =>
            {
                filter.predict(seconds_between(then, t_ns));
                filter.update(&pose, &fix.covariance);
                (pose, covariance) = (filter.pose(), filter.covariance());
                Estimate::Plain { filter, t_ns }
            }
            (FilterKind::Pose, _) => {
                Estimate::Plain { filter: PoseFilter::new(&pose, &fix.covariance, motion), t_ns }
            }
        };
        TrackedSample {
            t_ns,
            state: TrackingState::Tracking,
            pose: Some(pose),
            covariance: Some(covariance),
            rms_px: fix.rms_px,
            leds: fix.leds,
        }
    }

    fn view<'a>(&'a self, sightings: &'a [Sighting]) -> PoseView<'a> {
        PoseView { camera: &self.camera, sightings, noise_px: self.options.noise_px, gravity: None }
    }
}

impl TrackedSample {
    fn without_pose(t_ns: u64, state: TrackingState) -> Self {
        Self { t_ns, state, pose: None, covariance: None, rms_px: None, leds: 0 }
    }
}

fn seconds_between(earlier_ns: u64, later_ns: u64) -> f64 {
    later_ns.saturating_sub(earlier_ns) as f64 * 1e-9
}

#[cfg(test)]
mod tests;
