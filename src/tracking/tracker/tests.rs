//! Trackers on simulated recordings with known poses.

use nalgebra::Vector6;

use super::*;
use crate::simulate::{HiddenLed, PointingHand, ReportDelivery, SimulatedReport, Simulation};

struct Outcome {
    samples: Vec<(TrackedSample, SensorPose)>,
    dropped: DroppedReports,
}

fn track(simulation: &Simulation, reports: &[SimulatedReport], options: TrackerOptions) -> Outcome {
    let mut tracker = Tracker::new(simulation.camera, simulation.beacon.clone(), options);
    let mut samples = Vec::new();
    for SimulatedReport { t_ns, report, truth } in reports {
        samples.extend(tracker.push(*t_ns, report).map(|sample| (sample, *truth)));
    }
    Outcome { samples, dropped: tracker.dropped() }
}

/// Difference to the truth: position (mm), turn (radians).
fn error(pose: &SensorPose, truth: &SensorPose) -> Vector6<f64> {
    let turn = (pose.orientation * truth.orientation.inverse()).scaled_axis();
    let shift = pose.position - truth.position;
    Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z)
}

/// Mean squared error over its covariance: 6 for a filter that knows its own errors.
fn mean_chi_square(outcome: &Outcome) -> f64 {
    let chi = |(sample, truth): &(TrackedSample, SensorPose)| {
        let error = error(sample.pose.as_ref()?, truth);
        Some(error.dot(&sample.covariance?.cholesky()?.solve(&error)))
    };
    let all: Vec<f64> = outcome.samples.iter().filter_map(chi).collect();
    all.iter().sum::<f64>() / all.len() as f64
}

fn rms(outcome: &Outcome, rows: std::ops::Range<usize>) -> f64 {
    let errors =
        outcome.samples.iter().filter_map(|(sample, truth)| Some(error(sample.pose.as_ref()?, truth)));
    let (mut sum, mut count) = (0.0, 0);
    for error in errors {
        sum += rows.clone().map(|row| error[row].powi(2)).sum::<f64>();
        count += 1;
    }
    (sum / f64::from(count)).sqrt()
}

fn states(outcome: &Outcome, state: TrackingState) -> usize {
    outcome.samples.iter().filter(|(sample, _)| sample.state == state).count()
}

#[test]
fn a_hand_is_followed_within_the_covariance() {
    let simulation =
        Simulation { delivery: ReportDelivery::RADIO, ..Simulation::new(Beacon::recommended(), 1) };
    let reports = simulation.record(&PointingHand::before(&simulation.beacon, 1300.0, 1), 20.0);
    let outcome = track(&simulation, &reports, TrackerOptions::default());
    assert!(outcome.dropped.late > 5 && outcome.dropped.repeated > 5, "{:?}", outcome.dropped);
    let total = outcome.samples.len();
    assert!(total > 1800, "{total}");
    assert!(states(&outcome, TrackingState::Tracking) * 100 >= total * 98);
    assert_eq!(states(&outcome, TrackingState::Lost), 0);
    let chi_square = mean_chi_square(&outcome);
    assert!((3.0..9.0).contains(&chi_square), "{chi_square}");
    // Against frame by frame: the filter is better in both.
    let single = track(
        &simulation,
        &reports,
        TrackerOptions { filter: FilterKind::None, ..TrackerOptions::default() },
    );
    assert!(rms(&outcome, 0..3) < 0.7 * rms(&single, 0..3), "{} {}", rms(&outcome, 0..3), rms(&single, 0..3));
    assert!(rms(&outcome, 3..6) < 0.7 * rms(&single, 3..6), "{} {}", rms(&outcome, 3..6), rms(&single, 3..6));
    // The paper's filter on poses lies between.
    let plain = track(
        &simulation,
        &reports,
        TrackerOptions { filter: FilterKind::Pose, ..TrackerOptions::default() },
    );
    assert!(rms(&plain, 3..6) < rms(&single, 3..6), "{} {}", rms(&plain, 3..6), rms(&single, 3..6));
}

/// Without a filter a frame's pose is the same whatever frames came before it, also after frames
/// without a pose. Earlier reports of the accelerometer change where the solver starts, and so
/// the last bits.
#[test]
fn frames_without_a_filter_depend_on_no_other_frame() {
    let mut simulation = Simulation::new(Beacon::recommended(), 5);
    simulation.hidden =
        vec![HiddenLed { led: 1, seconds: [0.5, 1.0] }, HiddenLed { led: 2, seconds: [1.0, 1.6] }];
    let reports = simulation.record(&PointingHand::before(&simulation.beacon, 1300.0, 5), 3.0);
    let options = TrackerOptions { filter: FilterKind::None, ..TrackerOptions::default() };
    let all = track(&simulation, &reports, options);
    let missed = all.samples.iter().filter(|(sample, _)| sample.pose.is_none()).count();
    assert!((50..150).contains(&missed), "{missed}: frames of three LEDs on their own");
    let third: Vec<_> = reports.iter().skip(1).step_by(3).cloned().collect();
    let alone = track(&simulation, &third, options);
    for (sample, _) in &alone.samples {
        let (same, _) = all.samples.iter().find(|(other, _)| other.t_ns == sample.t_ns).unwrap();
        assert_eq!((sample.state, sample.leds), (same.state, same.leds));
        let difference = sample.pose.zip(same.pose).map_or(0.0, |(a, b)| error(&a, &b).norm());
        assert!(difference < 1e-6, "{difference}");
    }
    assert!(alone.samples.len() > 80, "{}", alone.samples.len());
}

#[test]
fn a_gyroscope_steadies_the_turn() {
    let simulation = Simulation { gyroscope: true, ..Simulation::new(Beacon::recommended(), 2) };
    let reports = simulation.record(&PointingHand::before(&simulation.beacon, 1500.0, 2), 10.0);
    let without = track(&simulation, &reports, TrackerOptions::default());
    let with =
        track(&simulation, &reports, TrackerOptions { use_gyroscope: true, ..TrackerOptions::default() });
    assert!(rms(&with, 3..6) < 0.8 * rms(&without, 3..6), "{} {}", rms(&with, 3..6), rms(&without, 3..6));
    assert!((2.5..9.0).contains(&mean_chi_square(&with)), "{}", mean_chi_square(&with));
}

/// Two LEDs are hidden for a second, then three, then all: the pose goes on, goes on, and is lost,
/// and comes back.
#[test]
fn hidden_leds_make_the_pose_less_certain_until_it_is_lost() {
    let mut simulation = Simulation::new(Beacon::recommended(), 3);
    let hide = |led, from, to| HiddenLed { led, seconds: [from, to] };
    simulation.hidden = vec![
        hide(0, 2.0, 3.0),
        hide(1, 2.5, 3.0),
        hide(0, 4.0, 5.0),
        hide(1, 4.0, 5.0),
        hide(2, 4.0, 5.0),
        hide(3, 4.0, 5.0),
    ];
    let reports = simulation.record(&PointingHand::before(&simulation.beacon, 1300.0, 3), 8.0);
    let outcome = track(&simulation, &reports, TrackerOptions::default());
    let during = |from: f64, to: f64| -> Vec<&TrackedSample> {
        let inside = |s: &&TrackedSample| (from..to).contains(&(s.t_ns as f64 * 1e-9 - 1.0));
        outcome.samples.iter().map(|(sample, _)| sample).filter(inside).collect()
    };
    assert!(during(0.2, 4.0).iter().all(|s| s.state == TrackingState::Tracking));
    assert!(during(2.6, 2.9).iter().all(|s| s.leds == 2));
    let spread = |s: &TrackedSample| s.covariance.unwrap().trace();
    assert!(spread(during(2.9, 3.0)[0]) > spread(during(1.9, 2.0)[0]));
    assert!(during(4.0, 4.04).iter().all(|s| s.state == TrackingState::Tracking), "50 ms are predicted");
    assert!(during(4.07, 5.0).iter().all(|s| s.state == TrackingState::Lost && s.pose.is_none()));
    assert!(during(5.1, 8.0).iter().all(|s| s.state == TrackingState::Tracking));
    assert!(mean_chi_square(&outcome) < 9.0, "{}", mean_chi_square(&outcome));
}

/// A reflection appears beside the LEDs: it is no LED, and the pose stays.
#[test]
fn a_stray_blob_is_left_out() {
    use crate::report::{Blob, InputReport};
    let mut simulation = Simulation::new(Beacon::recommended(), 4);
    simulation.hidden = vec![HiddenLed { led: 2, seconds: [1.0, 3.0] }];
    let mut reports = simulation.record(&PointingHand::before(&simulation.beacon, 1300.0, 4), 3.0);
    for SimulatedReport { t_ns, report, .. } in &mut reports {
        if let InputReport::Data(data) = report
            && let Some(slot) = data.blobs.iter_mut().flatten().find(|slot| slot.is_none())
            && *t_ns > 2_000_000_000
        {
            *slot = Some(Blob { size: Some(2), ..Blob::at(60, 700) });
        }
    }
    let outcome = track(&simulation, &reports, TrackerOptions::default());
    let late = outcome.samples.iter().filter(|(sample, _)| sample.t_ns > 2_000_000_000);
    assert!(late.clone().count() > 150);
    for (sample, truth) in late {
        assert_eq!((sample.state, sample.leds), (TrackingState::Tracking, 3));
        let error = error(&sample.pose.unwrap(), truth);
        assert!(error.fixed_rows::<3>(0).norm() < 60.0, "{error}");
    }
}

/// No prediction goes further than 50 ms, and none is made without a pose.
#[test]
fn predictions_are_short() {
    let simulation = Simulation::new(Beacon::recommended(), 5);
    let path = PointingHand::before(&simulation.beacon, 1300.0, 5);
    let mut tracker = Tracker::new(simulation.camera, simulation.beacon.clone(), TrackerOptions::default());
    assert_eq!(tracker.predicted(0.01), None);
    let mut last = None;
    for SimulatedReport { t_ns, report, truth } in simulation.record(&path, 3.0) {
        last = tracker.push(t_ns, &report).map(|sample| (sample, truth));
    }
    assert_eq!(tracker.predicted(0.05), tracker.predicted(9.0));
    let (sample, _) = last.unwrap();
    let seconds = sample.t_ns as f64 * 1e-9 - 1.0 + 0.04;
    let ahead = crate::simulate::SensorPath::at(&path, seconds);
    let [with, without] = [tracker.predicted(0.04), sample.pose].map(|pose| error(&pose.unwrap(), &ahead));
    assert!(with.fixed_rows::<3>(0).norm() < 30.0 && with != without, "{with} {without}");
}

#[test]
fn records_are_the_documented_json() {
    let simulation = Simulation::new(Beacon::recommended(), 6);
    let reports = simulation.record(&PointingHand::before(&simulation.beacon, 1300.0, 6), 0.5);
    let outcome = track(&simulation, &reports, TrackerOptions::default());
    let (sample, _) = outcome.samples.last().unwrap();
    let json = serde_json::to_value(PoseRecord::new(sample, 12.5)).unwrap();
    assert_eq!(json["state"], "tracking");
    assert_eq!(json["covariance"].as_array().unwrap().len(), 36);
    let position = sample.pose.unwrap().position;
    assert_eq!(json["position_mm"][2], position.z);
    let none = PoseRecord::new(&TrackedSample::without_pose(7, TrackingState::Ambiguous), 0.5);
    let text = serde_json::to_string(&none).unwrap();
    assert_eq!(
        text,
        r#"{"t_ns":7,"state":"ambiguous","position_mm":null,"orientation_xyzw":null,"covariance":null,"rms_px":null,"leds":0,"solve_us":0.5}"#
    );
}
