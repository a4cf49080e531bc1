//! Simulated recordings of a Wiimote, from report to view.

use glam::DQuat;
use nalgebra::{UnitQuaternion, Vector3};
use relief_live::{Gestures, HandOptions, HandSample, Intent, ViewState};
use relief_tracking::{
    Beacon, Buttons, HiddenLed, InputReport, PressedButton, ReportDelivery, SensorPath, SensorPose,
    SimulatedReport, Simulation, Tracker, TrackerOptions, TrackingState,
};

use super::wiimote::{Remote, exact};

/// A hand that rests, rolls by 30 degrees and moves, rests, and goes away.
struct Twist;

impl SensorPath for Twist {
    fn at(&self, seconds: f64) -> SensorPose {
        let smooth = |from: f64, to: f64| {
            let share = ((seconds - from) / (to - from)).clamp(0.0, 1.0);
            share * share * (3.0 - 2.0 * share)
        };
        let away = smooth(4.0, 5.0);
        let roll = 30f64.to_radians() * smooth(1.5, 2.5) - 0.7 * away;
        let target = Beacon::recommended().centroid();
        let position = target + Vector3::new(40.0 * smooth(1.5, 2.5) - 150.0 * away, 0.0, 1200.0);
        SensorPose::looking_at(position, target, &Vector3::y(), roll).unwrap()
    }
}

/// Reports of the twist with B held from 1 to 3.5 s, after each the state of the view, and the
/// truth.
fn play(simulation: &Simulation, options: &HandOptions) -> Vec<(f64, ViewState, SensorPose, TrackingState)> {
    let mut remote = Remote::new(options.clone());
    let mut tracker = Tracker::new(simulation.camera, simulation.beacon.clone(), TrackerOptions::default());
    let mut states = Vec::new();
    let mut simulation = simulation.clone();
    simulation.pressed = vec![PressedButton { buttons: Buttons::B, seconds: [1.0, 3.5] }];
    for SimulatedReport { t_ns, report, truth } in simulation.record(&Twist, 6.0) {
        let seconds = t_ns as f64 * 1e-9 - 1.0;
        // As bytes, as they come from a remote.
        let report = InputReport::decode(&report.encode()).unwrap();
        let intents = remote.gestures.hold(t_ns, report.buttons().unwrap());
        remote.take(t_ns, &intents);
        if let Some(sample) = tracker.push(t_ns, &report) {
            remote.track(HandSample::from(&sample));
            states.push((seconds, remote.session.state.clone(), truth, sample.state));
        }
    }
    states
}

fn orientation(state: &ViewState) -> DQuat {
    DQuat::from_array(state.record().orientation_xyzw)
}

/// Invariant: Reports of a hand that turns by 30 degrees turn the view by 30 degrees.
///
/// From bytes to a view: the hand turns by 30 degrees with B held, and so does the view, about the
/// axis of the hand, within the noise of tracking and the dead zone.
#[test]
fn a_hand_that_turns_by_30_degrees_turns_the_view_by_30_degrees() {
    for (options, within_deg) in [(exact(), 1.0), (HandOptions::default(), 1.8)] {
        let mut worst_deg = 0f64;
        for seed in 0..10 {
            let simulation = Simulation {
                delivery: ReportDelivery::RADIO,
                ..Simulation::new(Beacon::recommended(), seed)
            };
            let states = play(&simulation, &options);
            let at = |when: f64| states.iter().find(|(seconds, ..)| *seconds >= when).unwrap();
            let [before, after, end] = [0.9, 3.3, 5.9].map(|when| orientation(&at(when).1));
            let [then, now] = [0.9, 3.3].map(|when| at(when).2.orientation);
            // view_from_patient is rotated on its left by the hand's rotation.
            let turned = after.inverse() * before;
            let truth: UnitQuaternion<f64> = now * then.inverse();
            assert!((truth.angle().to_degrees() - 30.0).abs() < 1.0, "{truth}");
            worst_deg =
                worst_deg.max(turned.angle_between(DQuat::from_array(truth.coords.into())).to_degrees());
            assert_eq!(end, orientation(&at(3.6).1), "what is released stays, wherever the hand goes");
        }
        assert!(worst_deg < within_deg, "{worst_deg} degrees from the truth");
    }
}

/// All LEDs are hidden for half a second amid the turn: the view waits, and goes on from where it
/// was.
#[test]
fn hidden_leds_freeze_the_view_and_it_goes_on_without_a_jump() {
    let mut simulation = Simulation::new(Beacon::recommended(), 3);
    simulation.hidden = (0..4).map(|led| HiddenLed { led, seconds: [1.8, 2.2] }).collect();
    let states = play(&simulation, &HandOptions::default());
    let lost: Vec<_> = states.iter().filter(|(.., state)| *state != TrackingState::Tracking).collect();
    assert!(lost.len() > 20, "{}", lost.len());
    let frozen = orientation(&lost[0].1);
    assert!(lost.iter().all(|(_, state, ..)| orientation(state) == frozen && state.is_grabbed()));
    let steps = states.windows(2).map(|pair| orientation(&pair[0].1).angle_between(orientation(&pair[1].1)));
    let largest = steps.fold(0.0, f64::max).to_degrees();
    assert!(largest < 2.0, "a jump of {largest} degrees");
    // Movements of the hand while it was not visible are not applied later.
    let turned = orientation(&states.last().unwrap().1).angle_between(orientation(&states[0].1)).to_degrees();
    assert!((8.0..26.0).contains(&turned), "{turned}");
}

/// As the documentation of the options says: errors of a pose rotate about the beacon, so a tip
/// there is steady.
#[test]
fn a_tip_at_the_beacon_is_ten_times_steadier() {
    struct Rest;
    impl SensorPath for Rest {
        fn at(&self, _: f64) -> SensorPose {
            let target = Beacon::recommended().centroid();
            let position = target + Vector3::new(100.0, 50.0, 1200.0);
            SensorPose::looking_at(position, target, &Vector3::y(), 0.1).unwrap()
        }
    }
    let spread = |tip_mm: f64| {
        let (mut sum, mut count) = (0.0, 0.0);
        for seed in 0..10 {
            let options = HandOptions { tip_mm, tip_center_mm: Some([0.0; 3]), ..exact() };
            let mut gestures = Gestures::new(options).unwrap();
            let simulation = Simulation::new(Beacon::recommended(), seed);
            let mut tracker =
                Tracker::new(simulation.camera, simulation.beacon.clone(), TrackerOptions::default());
            let truth = Rest.at(0.0);
            let truth = truth.position + truth.orientation * Vector3::z() * tip_mm;
            for SimulatedReport { t_ns, report, .. } in simulation.record(&Rest, 2.0) {
                let Some(sample) = tracker.push(t_ns, &report) else { continue };
                for intent in gestures.track(&HandSample::from(&sample)) {
                    let Intent::Cursor { at_view_mm: Some([x, y, _]), .. } = intent else {
                        panic!("{intent:?}")
                    };
                    sum += (x - truth.x).powi(2) + (y - truth.y).powi(2);
                    count += 1.0;
                }
            }
        }
        f64::sqrt(sum / count)
    };
    let (near, at_the_beacon) = (spread(150.0), spread(1200.0));
    assert!((3.0..7.0).contains(&near) && at_the_beacon < 0.15 * near, "{near} {at_the_beacon}");
}
