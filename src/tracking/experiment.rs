//! The experiment of the 2009 paper, simulated: a robot's arm turns and shifts a Wiimote before a
//! beacon.
//!
//! Five runs: turns about the sensor's own X and Y axes, shifts along the beacon's X, Y and Z. In
//! each the arm goes through a row of stops, half a second on the way and one second at each. The
//! one coordinate that moves is compared with the truth in the last tenth of a second of each stop:
//! the angle about the axis, or the position along it, in the beacon's frame. The paper does not
//! state its beacon and distance; here they are [`ExperimentSetting`]'s.

use nalgebra::{Matrix6, UnitQuaternion, Vector3, Vector6};

use super::beacon::Beacon;
use super::filter::{ErrorStateFilter, MotionDensity};
use super::pose::SensorPose;
use super::sensor::{Pinhole, TYPICAL_FOCAL_PX};
use super::simulate::{ReportDelivery, SensorModel, SensorPath, SimulatedReport, Simulation, SurveyingHand};
use super::solve::bound::quantised_noise;
use super::solve::{PoseView, Sighting};
use super::tracker::{FilterKind, SolverKind, TrackedSample, Tracker, TrackerOptions};
use crate::calibrate::{
    BlobIdentifier, Calibration, CalibrationError, CalibrationModel, calibrate_camera, moving_views,
};

/// The movement of the arm in a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExperimentRun {
    /// Turns about the sensor's X axis.
    TurnX,
    /// Turns about the sensor's Y axis.
    TurnY,
    /// Shifts along the beacon's X axis.
    ShiftX,
    /// Shifts along the beacon's Y axis.
    ShiftY,
    /// Shifts along the beacon's Z axis: towards it and away.
    ShiftZ,
}

impl ExperimentRun {
    /// All five, in the order of the paper's table.
    pub const ALL: [Self; 5] = [Self::TurnX, Self::TurnY, Self::ShiftX, Self::ShiftY, Self::ShiftZ];

    /// A name as in the paper's table, with the unit.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::TurnX => "R x (deg)",
            Self::TurnY => "R y (deg)",
            Self::ShiftX => "T x (cm)",
            Self::ShiftY => "T y (cm)",
            Self::ShiftZ => "T z (cm)",
        }
    }

    /// Mean error of the paper's Table 1: degrees, cm.
    #[must_use]
    pub const fn paper_mean(self) -> f64 {
        match self {
            Self::TurnX => 0.162,
            Self::TurnY => 0.286,
            Self::ShiftX => 0.384,
            Self::ShiftY => 0.411,
            Self::ShiftZ => 4.94,
        }
    }

    /// Standard deviation of the paper's Table 1: degrees, cm.
    #[must_use]
    pub const fn paper_deviation(self) -> f64 {
        match self {
            Self::TurnX => 0.40,
            Self::TurnY => 0.54,
            Self::ShiftX => 0.62,
            Self::ShiftY => 0.64,
            Self::ShiftZ => 2.22,
        }
    }

    const fn is_turn(self) -> bool {
        matches!(self, Self::TurnX | Self::TurnY)
    }

    const fn axis(self) -> usize {
        match self {
            Self::TurnX | Self::ShiftX => 0,
            Self::TurnY | Self::ShiftY => 1,
            Self::ShiftZ => 2,
        }
    }

    /// The moved coordinate of a pose, relative to where the run is centred: degrees or cm.
    fn coordinate(self, pose: &SensorPose, centre: &SensorPose) -> f64 {
        if self.is_turn() {
            (centre.orientation.inverse() * pose.orientation).scaled_axis()[self.axis()].to_degrees()
        } else {
            (pose.position - centre.position)[self.axis()] / 10.0
        }
    }

    /// Standard deviation of that coordinate by a covariance (beacon axes).
    fn deviation(self, covariance: &Matrix6<f64>, centre: &SensorPose) -> f64 {
        let mut direction = Vector6::zeros();
        let mut axis = Vector3::zeros();
        axis[self.axis()] = 1.0;
        if self.is_turn() {
            direction.fixed_rows_mut::<3>(3).copy_from(&(centre.orientation * axis));
        } else {
            direction.fixed_rows_mut::<3>(0).copy_from(&axis);
        }
        let deviation = direction.dot(&(covariance * direction)).max(0.0).sqrt();
        if self.is_turn() { deviation.to_degrees() } else { deviation / 10.0 }
    }
}

/// The arm's path: stops, and smooth ways between.
#[derive(Clone, Debug)]
pub struct Arm {
    run: ExperimentRun,
    centre: SensorPose,
    stops: Vec<f64>,
}

const WAY_S: f64 = 0.5;
const STOP_S: f64 = 1.0;
/// The part of a stop that is compared: its last tenth of a second.
const COMPARED_S: f64 = 0.1;
const TURN_RANGE: f64 = 0.174; // 10 degrees
const SHIFT_RANGE_MM: f64 = 100.0;
const STOPS: usize = 21;

impl Arm {
    /// The arm of this run at this distance before the beacon.
    #[must_use]
    pub fn new(run: ExperimentRun, beacon: &Beacon, distance_mm: f64) -> Self {
        let half_turn = UnitQuaternion::from_scaled_axis(Vector3::x() * std::f64::consts::PI);
        let centre =
            SensorPose { position: beacon.centroid() + Vector3::z() * distance_mm, orientation: half_turn };
        let range = if run.is_turn() { TURN_RANGE } else { SHIFT_RANGE_MM };
        let stops = (0..STOPS).map(|at| range * (2.0 * at as f64 / (STOPS - 1) as f64 - 1.0)).collect();
        Self { run, centre, stops }
    }

    /// The length of the run, seconds.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        self.stops.len() as f64 * (WAY_S + STOP_S)
    }

    /// The stop whose compared part contains a time.
    fn compared(&self, seconds: f64) -> Option<usize> {
        let at = (seconds / (WAY_S + STOP_S)) as usize;
        let inside = seconds - at as f64 * (WAY_S + STOP_S);
        (inside > WAY_S + STOP_S - COMPARED_S && at < self.stops.len()).then_some(at)
    }
}

impl SensorPath for Arm {
    fn at(&self, seconds: f64) -> SensorPose {
        let period = WAY_S + STOP_S;
        let at = ((seconds.max(0.0) / period) as usize).min(self.stops.len() - 1);
        let inside = (seconds - at as f64 * period) / WAY_S;
        let from = self.stops[at.saturating_sub(1)];
        let share = inside.clamp(0.0, 1.0);
        // Speed and acceleration are zero at both ends.
        let smooth = share.powi(3) * (10.0 + share * (6.0 * share - 15.0));
        let value = from + (self.stops[at] - from) * smooth;
        let mut axis = Vector3::zeros();
        axis[self.run.axis()] = value;
        let mut pose = self.centre;
        if self.run.is_turn() {
            pose.orientation *= UnitQuaternion::from_scaled_axis(axis);
        } else {
            pose.position += axis;
        }
        pose
    }
}

/// The simulated arrangement.
#[derive(Clone, Debug)]
pub struct ExperimentSetting {
    /// The beacon.
    pub beacon: Beacon,
    /// From the beacon's middle to the sensor, mm.
    pub distance_mm: f64,
    /// The true camera.
    pub camera: Pinhole,
    /// Noise.
    pub sensing: SensorModel,
    /// The number of repeats of each run.
    pub repeats: u32,
    /// Seed.
    pub seed: u64,
}

impl ExperimentSetting {
    /// The recommended beacon at a metre, half a pixel of noise, blobs as wide as 5 mm LEDs make
    /// them.
    #[must_use]
    pub fn new(camera: Pinhole, seed: u64) -> Self {
        let sensing = SensorModel::TYPICAL;
        Self { beacon: Beacon::recommended(), distance_mm: 1000.0, camera, sensing, repeats: 1, seed }
    }
}

/// A way to track, to be compared with others.
#[derive(Clone, Copy, Debug)]
pub struct TrackingMethod {
    /// Its name.
    pub name: &'static str,
    /// The camera that it believes in.
    pub camera: Pinhole,
    /// Single frames.
    pub solver: SolverKind,
    /// Over time.
    pub filter: FilterKind,
}

/// A point of a plot: the true coordinate and the measured one, degrees or cm.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PlotPoint {
    /// The commanded coordinate.
    pub truth: f64,
    /// Its error.
    pub error: f64,
}

/// The outcome of a run.
#[derive(Clone, Debug, serde::Serialize)]
pub struct ExperimentOutcome {
    /// Mean of the errors' sizes, degrees or cm.
    pub mean: f64,
    /// Standard deviation of the errors.
    pub deviation: f64,
    /// Root mean square of the errors.
    pub rms: f64,
    /// The posterior Cramer-Rao bound of the run, as a root mean square.
    pub bound: f64,
    /// Frames without a pose.
    pub lost: usize,
    /// One for each stop of each repeat: the mean over its compared part.
    pub points: Vec<PlotPoint>,
}

/// Calibrates the camera of a setting as a user would: from four simulated minutes of a hand that
/// moves around the beacon.
///
/// # Errors
/// As [`crate::calibrate_camera`].
pub fn simulate_survey(setting: &ExperimentSetting) -> Result<Calibration, CalibrationError> {
    let simulation = Simulation {
        camera: setting.camera,
        sensing: setting.sensing,
        ..Simulation::new(setting.beacon.clone(), setting.seed ^ 0xca1)
    };
    let nominal = Pinhole::simple(TYPICAL_FOCAL_PX);
    let mut identifier = BlobIdentifier::new(setting.beacon.clone(), nominal);
    let reports = simulation.record(&SurveyingHand::around(&setting.beacon, setting.seed), 240.0);
    let views = reports.iter().filter_map(|made| identifier.push(made.t_ns, &made.report)).collect();
    calibrate_camera(&moving_views(views), &nominal, CalibrationModel::Square)
}

/// Does one run in one way, as often as the setting says, each time with other noise.
#[must_use]
pub fn run_experiment(
    setting: &ExperimentSetting,
    run: ExperimentRun,
    way: &TrackingMethod,
) -> ExperimentOutcome {
    let arm = Arm::new(run, &setting.beacon, setting.distance_mm);
    let mut outcome =
        ExperimentOutcome { mean: 0.0, deviation: 0.0, rms: 0.0, bound: 0.0, lost: 0, points: Vec::new() };
    let mut errors = Vec::new();
    for repeat in 0..setting.repeats {
        let simulation = Simulation {
            camera: setting.camera,
            sensing: setting.sensing,
            delivery: ReportDelivery { jitter_ms: 0.4, ..ReportDelivery::PERFECT },
            ..Simulation::new(
                setting.beacon.clone(),
                setting.seed ^ (run as u64) << 32 ^ u64::from(repeat) << 40,
            )
        };
        let reports = simulation.record(&arm, arm.seconds());
        let here = follow(setting, run, &arm, way, &reports, &mut outcome.lost);
        outcome.points.extend(points_of(&here));
        errors.extend(here);
        // The bound depends only on the path and the times, so the first trial's bound holds for
        // all.
        if repeat == 0 {
            outcome.bound = match way.filter {
                FilterKind::ErrorState => bound_of(setting, run, &arm, &reports),
                _ => single_bound(setting, run, &arm),
            };
        }
    }
    summarise(&mut outcome, &errors);
    outcome
}

/// An error in the compared part of a stop.
#[derive(Clone, Copy, Debug)]
struct Compared {
    stop: usize,
    truth: f64,
    error: f64,
}

/// Tracks one recording, and adds the frames without a pose to `lost`.
fn follow(
    setting: &ExperimentSetting,
    run: ExperimentRun,
    arm: &Arm,
    way: &TrackingMethod,
    reports: &[SimulatedReport],
    lost: &mut usize,
) -> Vec<Compared> {
    let options = TrackerOptions {
        solver: way.solver,
        filter: way.filter,
        noise_px: quantised_noise(setting.sensing.noise_px),
        motion: MotionDensity::ARM,
        ..TrackerOptions::default()
    };
    let mut tracker = Tracker::new(way.camera, setting.beacon.clone(), options);
    let mut errors = Vec::new();
    for SimulatedReport { t_ns, report, truth } in reports {
        let Some(sample) = tracker.push(*t_ns, report) else { continue };
        let Some(pose) = sample.pose else {
            *lost += 1;
            continue;
        };
        if let Some(stop) = arm.compared(seconds_of(&sample)) {
            let truth = run.coordinate(truth, &arm.centre);
            errors.push(Compared { stop, truth, error: run.coordinate(&pose, &arm.centre) - truth });
        }
    }
    errors
}

fn seconds_of(sample: &TrackedSample) -> f64 {
    sample.t_ns as f64 * 1e-9 - 1.0
}

fn summarise(outcome: &mut ExperimentOutcome, errors: &[Compared]) {
    let count = errors.len().max(1) as f64;
    let mean = |of: &dyn Fn(f64) -> f64| errors.iter().map(|here| of(here.error)).sum::<f64>() / count;
    outcome.mean = mean(&f64::abs);
    outcome.rms = mean(&|error| error * error).sqrt();
    let bias = mean(&|error| error);
    outcome.deviation = mean(&|error| (error - bias).powi(2)).sqrt();
}

/// One point for each stop: the mean over its compared part.
fn points_of(errors: &[Compared]) -> impl Iterator<Item = PlotPoint> {
    errors.chunk_by(|a, b| a.stop == b.stop).map(|here| PlotPoint {
        truth: here[0].truth,
        error: here.iter().map(|one| one.error).sum::<f64>() / here.len() as f64,
    })
}

fn sightings(setting: &ExperimentSetting, truth: &SensorPose) -> Vec<Sighting> {
    let pose = truth.inverse();
    let leds = setting.beacon.leds().iter().take(super::solve::MAX_SEEN);
    leds.filter_map(|led| Some(Sighting { led: *led, pixel: setting.camera.project(&pose.place(led))? }))
        .collect()
}

/// The information of all frames so far at the true poses, under the filter's own model of motion:
/// what no filter with that model can be better than on average.
fn bound_of(setting: &ExperimentSetting, run: ExperimentRun, arm: &Arm, reports: &[SimulatedReport]) -> f64 {
    let noise_px = quantised_noise(setting.sensing.noise_px);
    let mut filter: Option<(ErrorStateFilter, u64)> = None;
    let (mut sum, mut count) = (0.0, 0);
    for SimulatedReport { t_ns, truth, .. } in reports {
        let seen = sightings(setting, truth);
        let view = PoseView { camera: &setting.camera, sightings: &seen, noise_px, gravity: None };
        match &mut filter {
            None => {
                let pose = truth.inverse();
                let first =
                    view.bound(&pose).map(|bound| ErrorStateFilter::new(&pose, &bound, MotionDensity::ARM));
                filter = first.map(|first| (first, *t_ns));
            }
            Some((filter, then)) => {
                filter.predict((t_ns - *then) as f64 * 1e-9);
                filter.relinearise(truth);
                filter.update_pixels(&setting.camera, &seen, noise_px);
                *then = *t_ns;
                if arm.compared(*t_ns as f64 * 1e-9 - 1.0).is_some() {
                    sum += run.deviation(&filter.covariance(), &arm.centre).powi(2);
                    count += 1;
                }
            }
        }
    }
    (sum / f64::from(count.max(1))).sqrt()
}

/// The bound of single frames.
fn single_bound(setting: &ExperimentSetting, run: ExperimentRun, arm: &Arm) -> f64 {
    let noise_px = quantised_noise(setting.sensing.noise_px);
    let mut sum = 0.0;
    for stop in 0..STOPS {
        let truth = arm.at((stop as f64 + 1.0) * (WAY_S + STOP_S) - COMPARED_S / 2.0);
        let seen = sightings(setting, &truth);
        let view = PoseView { camera: &setting.camera, sightings: &seen, noise_px, gravity: None };
        sum += view.bound(&truth.inverse()).map_or(0.0, |bound| run.deviation(&bound, &arm.centre).powi(2));
    }
    (sum / STOPS as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_arm_stops_where_it_says() {
        let beacon = Beacon::recommended();
        let arm = Arm::new(ExperimentRun::ShiftZ, &beacon, 1000.0);
        let stop = arm.at(1.4);
        assert!((ExperimentRun::ShiftZ.coordinate(&stop, &arm.centre) + 10.0).abs() < 1e-12);
        assert_eq!(arm.at(1.4), arm.at(1.1), "it rests");
        assert_eq!((arm.compared(1.2), arm.compared(1.45), arm.compared(2.95)), (None, Some(0), Some(1)));
        let turn = Arm::new(ExperimentRun::TurnX, &beacon, 1000.0);
        assert!((ExperimentRun::TurnX.coordinate(&turn.at(100.0), &turn.centre) - 9.97).abs() < 0.01);
    }

    /// With the true camera: within the project's own limits, and within 1.2 of the bound.
    #[test]
    fn the_filter_keeps_the_limits_of_the_experiment() {
        let setting = ExperimentSetting::new(Pinhole::simple(1360.0), 1);
        let (solver, filter) = (SolverKind::Lm, FilterKind::ErrorState);
        let way = TrackingMethod { name: "ours", camera: setting.camera, solver, filter };
        for (run, limit) in ExperimentRun::ALL.into_iter().zip([0.05, 0.08, 0.1, 0.1, 0.5]) {
            let outcome = run_experiment(&setting, run, &way);
            assert!(outcome.mean <= limit, "{}: {} above {limit}", run.name(), outcome.mean);
            assert!(outcome.rms <= 1.2 * outcome.bound, "{}: {outcome:?}", run.name());
            assert!(outcome.lost <= 2 && outcome.points.len() == STOPS, "{}: {}", run.name(), outcome.lost);
        }
    }

    /// A focal length that is 3 % off is seen as a distance that is 3 % off, whatever the solver.
    #[test]
    fn a_wrong_focal_length_shows_in_the_distance() {
        let setting = ExperimentSetting::new(Pinhole::simple(1320.0 * 1.03), 2);
        let camera = Pinhole::simple(1320.0);
        let way =
            TrackingMethod { name: "paper", camera, solver: SolverKind::Paper, filter: FilterKind::Pose };
        let outcome = run_experiment(&setting, ExperimentRun::ShiftZ, &way);
        assert!((2.0..4.0).contains(&outcome.mean), "{} cm", outcome.mean);
    }
}
