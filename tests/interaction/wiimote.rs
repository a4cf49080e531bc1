//! A Wiimote's poses and buttons as gestures: made-up ones against closed forms, and recordings
//! from report to view.

use glam::{DQuat, DVec3};
use relief_base::{Patient, Point};
use relief_live::{Gestures, GrabMode, HandOptions, HandPose, HandSample, Intent, IntentEffect};
use relief_tracking::{Buttons, TrackingState};

use super::{Session, assert_near, in_view};

/// A Wiimote and the view that it moves.
pub(super) struct Remote {
    pub(super) session: Session,
    pub(super) gestures: Gestures,
    pub(super) events: Vec<IntentEffect>,
}

impl Remote {
    pub(super) fn new(options: HandOptions) -> Self {
        Self { session: Session::new(), gestures: Gestures::new(options).unwrap(), events: Vec::new() }
    }

    pub(super) fn take(&mut self, t_ns: u64, intents: &[Intent]) {
        for intent in intents {
            let applied = self.session.state.apply(&self.session.stage, t_ns, intent, None).unwrap();
            self.events.extend(applied.event);
        }
    }

    pub(super) fn hold(&mut self, ms: u64, buttons: Buttons) -> Vec<Intent> {
        let intents = self.gestures.hold(ms * 1_000_000, buttons);
        self.take(ms * 1_000_000, &intents);
        intents
    }

    pub(super) fn at(&mut self, ms: u64, position: DVec3, orientation: DQuat) -> Vec<Intent> {
        let pose = HandPose::new(position.to_array(), orientation.to_array()).unwrap();
        self.track(HandSample { t_ns: ms * 1_000_000, state: TrackingState::Tracking, pose: Some(pose) })
    }

    pub(super) fn unseen(&mut self, ms: u64, state: TrackingState) -> Vec<Intent> {
        self.track(HandSample { t_ns: ms * 1_000_000, state, pose: None })
    }

    pub(super) fn track(&mut self, sample: HandSample) -> Vec<Intent> {
        let intents = self.gestures.track(&sample);
        self.take(sample.t_ns, &intents);
        intents
    }

    pub(super) fn cursor(&self) -> Point<Patient> {
        self.session.state.cursor().unwrap()
    }
}

pub(super) fn exact() -> HandOptions {
    HandOptions { dead_zone_deg: 0.0, dead_zone_mm: 0.0, cursor_rest_mm: 0.0, ..HandOptions::default() }
}

/// A camera that looks along -z of the beacon, at `position`.
fn level() -> DQuat {
    DQuat::from_rotation_x(std::f64::consts::PI)
}

fn start() -> DVec3 {
    DVec3::new(20.0, -10.0, 1200.0)
}

/// A point `tip_mm` before the camera.
fn tip(position: DVec3, orientation: DQuat) -> DVec3 {
    position + orientation * DVec3::Z * HandOptions::default().tip_mm
}

#[test]
fn the_cursor_is_the_tip_scaled_by_the_gain() {
    for gain in [1.0, 0.5, 2.0] {
        let mut remote = Remote::new(HandOptions { gain, ..exact() });
        remote.at(0, start(), level());
        assert_near(
            remote.session.in_view(remote.cursor()),
            DVec3::ZERO,
            1e-9,
            "it begins at the focal point",
        );
        let turned = DQuat::from_rotation_y(0.05) * level();
        let position = start() + DVec3::new(11.0, 7.0, -5.0);
        remote.at(10, position, turned);
        let moved = (tip(position, turned) - tip(start(), level())) * gain;
        assert_near(remote.session.in_view(remote.cursor()), moved, 1e-9, "and follows the tip");
    }
    let fixed = HandOptions { tip_center_mm: Some([0.0, 0.0, 1000.0]), ..exact() };
    let mut remote = Remote::new(fixed);
    remote.at(0, start(), level());
    let wanted = tip(start(), level()) - DVec3::new(0.0, 0.0, 1000.0);
    assert_near(remote.session.in_view(remote.cursor()), wanted, 1e-9, "a centre of one's own");
}

/// Invariant: A grabbed volume stays under the hand, and neither release nor new grab moves it.
///
/// With B held, a hand that turns by Q about its tip and moves by d takes the volume along: all of
/// it turns about the tip.
#[test]
fn a_held_volume_goes_with_the_hand() {
    let mut remote = Remote::new(exact());
    remote.at(0, start(), level());
    let reach = start() + DVec3::new(30.0, 15.0, -20.0);
    remote.at(10, reach, level());
    let held = remote.cursor();
    remote.hold(20, Buttons::B);
    remote.at(20, reach, level());
    let before = remote.session.camera();
    let p = in_view(&before, held);
    for (ms, angle) in [(30, 0.1), (40, 0.9), (50, -2.0)] {
        let orientation = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), angle) * level();
        let position = reach + DVec3::new(3.0, -4.0, 5.0) * angle;
        remote.at(ms, position, orientation);
        let d = tip(position, orientation) - tip(reach, level());
        let q = orientation * level().inverse();
        for point in super::points() {
            let wanted = q * (in_view(&before, point) - p) + p + d;
            assert_near(remote.session.in_view(point), wanted, 1e-9, "with the hand");
        }
        assert_near(remote.cursor().xyz, held.xyz, 1e-9, "the cursor stays on what is held");
    }
    let kept = remote.session.camera();
    remote.hold(60, Buttons::default());
    assert!(!remote.session.state.is_grabbed());
    remote.at(70, start(), level());
    assert_eq!(remote.session.camera(), kept, "released");
}

#[test]
fn grab_modes_are_the_options() {
    for mode in [GrabMode::Rotate, GrabMode::Move] {
        let mut remote = Remote::new(HandOptions { grab_mode: mode, ..exact() });
        remote.at(0, start(), level());
        remote.hold(10, Buttons::B);
        remote.at(10, start(), level());
        let before = remote.session.camera();
        remote.at(20, start() + DVec3::new(9.0, 0.0, 0.0), DQuat::from_rotation_z(0.4) * level());
        let after = remote.session.camera();
        let turned = after.up().xyz.angle_between(before.up().xyz);
        let moved = after.look_at().distance(before.look_at());
        let wanted = if mode == GrabMode::Rotate { (0.4, 0.0) } else { (0.0, 9.0) };
        assert!(
            (turned - wanted.0).abs() < 1e-7 && (moved - wanted.1).abs() < 1e-9,
            "{mode:?} {turned} {moved}"
        );
        let hand = DVec3::new(9.0, 0.0, 0.0);
        assert_near(remote.session.in_view(remote.cursor()), hand, 1e-9, "the cursor is at the hand");
    }
}

/// Tremor within the dead zone moves nothing; beyond it the volume follows without a jump of the
/// zone's width.
#[test]
fn a_dead_zone_keeps_tremor_out() {
    let options = HandOptions { dead_zone_deg: 1.0, dead_zone_mm: 2.0, ..HandOptions::default() };
    let mut remote = Remote::new(options);
    remote.at(0, start(), level());
    remote.hold(10, Buttons::B);
    let rest = remote.session.camera();
    for ms in 1..20 {
        let tremor = DVec3::new(0.0, 1.9 * (ms as f64 - 1.0).sin(), 0.0);
        remote.at(ms * 10, start() + tremor, level());
        assert_eq!(remote.session.camera(), rest, "at rest");
    }
    for (ms, way) in [(300, 2.001), (310, 4.0), (320, 4.25)] {
        remote.at(ms, start() + DVec3::Y * way, level());
        let moved = remote.session.camera().look_at().distance(rest.look_at());
        assert!((moved - (way - 2.0)).abs() < 1e-9, "{way} mm moved {moved}: all beyond the zone counts");
    }
}

/// Invariant: An untracked hand moves nothing, and late reports move nothing.
///
/// While the hand is lost or ambiguous the view stands still; seen again, anywhere, it takes hold
/// anew.
#[test]
fn an_untracked_remote_moves_nothing() {
    let mut remote = Remote::new(exact());
    remote.at(0, start(), level());
    remote.hold(10, Buttons::B);
    remote.at(10, start(), level());
    remote.at(20, start() + DVec3::X * 10.0, level());
    remote.at(30, start() + DVec3::X * 12.0, level());
    let frozen = remote.session.camera();
    for (ms, state) in
        [(40, TrackingState::Ambiguous), (50, TrackingState::Lost), (60, TrackingState::Searching)]
    {
        assert!(remote.unseen(ms, state).is_empty());
    }
    let elsewhere = start() + DVec3::new(-200.0, 90.0, 300.0);
    remote.at(70, elsewhere, DQuat::from_rotation_z(1.0) * level());
    assert_eq!(remote.session.camera(), frozen, "no jump");
    remote.at(80, elsewhere + DVec3::X * 5.0, DQuat::from_rotation_z(1.0) * level());
    let moved = remote.session.camera().look_at().distance(frozen.look_at());
    assert!((moved - 5.0).abs() < 1e-9, "{moved}");
    // A pose without the state `tracking` is ignored, and releasing B while nothing is visible
    // releases the volume.
    let pose = HandPose::new([0.0; 3], [0.0, 0.0, 0.0, 1.0]).ok();
    remote.track(HandSample { t_ns: 100_000_000, state: TrackingState::Ambiguous, pose });
    assert_eq!(remote.hold(110, Buttons::default()), [Intent::Release {}]);
}

#[test]
fn a_places_and_leaving_tracking_cancels() {
    let mut remote = Remote::new(exact());
    assert!(remote.hold(0, Buttons::A).is_empty(), "nobody knows where");
    assert!(remote.hold(5, Buttons::default()).is_empty());
    remote.at(10, start(), level());
    remote.hold(20, Buttons::A);
    assert!(matches!(remote.events[..], [IntentEffect::Taking(at)] if at == remote.cursor()));
    remote.at(30, start() + DVec3::Y * 8.0, level());
    assert!(matches!(remote.events[..], [_, .., IntentEffect::Placing(at)] if at == remote.cursor()));
    remote.hold(40, Buttons::default());
    assert_eq!(remote.events.last(), Some(&IntentEffect::Placed(remote.cursor())));
    remote.hold(50, Buttons::A);
    remote.unseen(60, TrackingState::Lost);
    assert_eq!(remote.events.last(), Some(&IntentEffect::PlacingCancelled));
    let count = remote.events.len();
    remote.at(70, start(), level());
    remote.hold(80, Buttons::default());
    assert_eq!(remote.events.len(), count, "the release of a cancelled press means nothing");
}

/// While A is held the cursor goes a part of the way of the hand's mean, from the mean of where the
/// hand was.
#[test]
fn a_leads_the_cursor_with_care() {
    let options = HandOptions { precise_gain: 0.25, steady_s: 0.2, dead_zone_mm: 10.0, ..exact() };
    let mut remote = Remote::new(options);
    // A hand that shakes by 4 mm to both sides of its place, 100 times a second, has its mean
    // there.
    let shaken = |ms: u64| start() + DVec3::X * if (ms / 10).is_multiple_of(2) { 4.0 } else { -4.0 };
    let home = tip(shaken(0), level());
    for ms in (0..3000).step_by(10) {
        remote.at(ms, shaken(ms), level());
    }
    let loose = remote.session.in_view(remote.cursor());
    assert!((loose.x - (tip(shaken(2990), level()) - home).x).abs() < 1e-9, "without A it is the tip");
    remote.hold(3000, Buttons::A);
    let rest = tip(start(), level()) - home;
    assert!((remote.session.in_view(remote.cursor()) - rest).length() < 0.15, "the mean of a hand at rest");
    // 12 mm up, and time for the mean to come after.
    let pressed = remote.session.in_view(remote.cursor());
    let mut most: f64 = 0.0;
    for ms in (3010..6000).step_by(10) {
        remote.at(ms, shaken(ms) + DVec3::Y * 12.0, level());
        if ms > 5000 {
            most = most.max((remote.session.in_view(remote.cursor()) - pressed - DVec3::Y * 3.0).length());
        }
    }
    assert!(most < 0.06, "a quarter of the way, and of a quarter of the shaking: {most} mm off");
    remote.hold(6000, Buttons::default());
    assert!(matches!(remote.events.last(), Some(IntentEffect::Placed(_))));
    remote.at(6010, shaken(6010), level());
    let loose = remote.session.in_view(remote.cursor());
    assert_near(loose, tip(shaken(6010), level()) - home, 1e-9, "the tip again");
    // A hand on its way sets down where it is, not where it was.
    remote.at(6020, start() + DVec3::Y * 60.0, level());
    remote.hold(6030, Buttons::A);
    let there = tip(start() + DVec3::Y * 60.0, level()) - home;
    assert_near(remote.session.in_view(remote.cursor()), there, 1e-9, "on its way");
}

/// Invariant: Buttons of dropped poses count, and held buttons act by time.
///
/// Held buttons count by time, whatever the number of reports, and a gap in the reports counts as
/// 0.1 s at most.
#[test]
fn rates_are_in_time_not_in_reports() {
    let options = HandOptions { zoom_per_s: 2.0, clip_mm_per_s: 60.0, ..exact() };
    for period in [5, 10, 50] {
        let mut remote = Remote::new(options.clone());
        for ms in (0..=1000).step_by(period) {
            remote.hold(ms, Buttons::PLUS.with(Buttons::UP));
        }
        remote.hold(1000, Buttons::default());
        let record = remote.session.state.record();
        assert!((record.zoom - 2.0).abs() < 1e-9, "{period} ms: {}", record.zoom);
        assert!((record.clip_mm.unwrap() - 60.0).abs() < 1e-9, "{period} ms");
        assert_eq!(record.undo, 2, "{period} ms: they alternate, and are one step each");
    }
    let mut remote = Remote::new(options);
    remote.hold(0, Buttons::MINUS);
    remote.hold(5000, Buttons::default());
    assert!((remote.session.state.record().zoom - 1.0 / 2f64.powf(0.1)).abs() < 1e-9);
    remote.hold(5010, Buttons::MINUS.with(Buttons::PLUS));
    assert!(remote.hold(5050, Buttons::default()).is_empty(), "both are neither");
}

#[test]
fn presses_are_one_each() {
    let mut remote = Remote::new(exact());
    let step = |step| vec![Intent::Preset { name: None, step: Some(step) }];
    for (at, (button, intents)) in [
        (Buttons::LEFT, step(-1)),
        (Buttons::RIGHT, step(1)),
        (Buttons::ONE, vec![Intent::Undo {}]),
        (Buttons::TWO, vec![Intent::NextLabel {}]),
        (Buttons::HOME, vec![Intent::Reset {}]),
    ]
    .into_iter()
    .enumerate()
    {
        let ms = 100 * at as u64;
        assert_eq!(remote.hold(ms, button), intents);
        assert!(remote.hold(ms + 10, button).is_empty(), "held is not pressed again");
        assert!(remote.hold(ms + 20, Buttons::default()).is_empty());
    }
}

/// Home makes the place of the hand the focal point.
#[test]
fn home_centres_the_hand() {
    let mut remote = Remote::new(exact());
    remote.at(0, start(), level());
    remote.at(10, start() + DVec3::X * 50.0, level());
    remote.hold(20, Buttons::HOME);
    remote.at(30, start() + DVec3::X * 50.0, level());
    assert_near(remote.session.in_view(remote.cursor()), DVec3::ZERO, 1e-9, "the focal point");
}

/// Late and repeated reports are skipped; a clock that restarts does not stop the remote.
#[test]
fn time_orders_what_comes() {
    let mut remote = Remote::new(exact());
    remote.at(5000, start(), level());
    remote.hold(5000, Buttons::B);
    remote.at(5010, start(), level());
    remote.at(5020, start() + DVec3::X, level());
    remote.at(5030, start() + DVec3::X * 5.0, level());
    let camera = remote.session.camera();
    assert!(remote.at(5025, start() + DVec3::X * 90.0, level()).is_empty(), "late");
    assert!(remote.at(5030, start() + DVec3::X * 90.0, level()).is_empty(), "twice");
    assert!(remote.hold(4990, Buttons::default()).is_empty(), "B was pressed after that");
    assert_eq!(remote.session.camera(), camera);
    assert!(remote.hold(5040, Buttons::B).is_empty(), "the same again");
    // The remote was reconnected, and its time begins at 0.
    assert_eq!(remote.hold(3, Buttons::ONE), [Intent::Release {}, Intent::Undo {}]);
    assert!(!remote.at(4, start(), level()).is_empty());
}

/// Buttons of poses that are dropped count: a click between two poses that are used places.
#[test]
fn buttons_of_dropped_poses_count() {
    let mut remote = Remote::new(exact());
    remote.at(0, start(), level());
    for (ms, buttons) in
        [(10, Buttons::default()), (20, Buttons::A), (30, Buttons::A), (40, Buttons::default())]
    {
        remote.hold(ms, buttons);
    }
    assert!(
        matches!(remote.events[..], [IntentEffect::Taking(_), IntentEffect::Placed(_)]),
        "{:?}",
        remote.events
    );
}

#[test]
fn options_may_change_while_the_volume_is_held() {
    let mut remote = Remote::new(exact());
    remote.at(0, start(), level());
    remote.hold(10, Buttons::B);
    remote.at(10, start(), level());
    remote.at(20, start() + DVec3::X * 3.0, level());
    remote.at(30, start() + DVec3::X * 6.0, level());
    let camera = remote.session.camera();
    remote.gestures.configure(HandOptions { gain: 4.0, ..exact() }).unwrap();
    remote.at(40, start() + DVec3::X * 6.0, level());
    assert_eq!(remote.session.camera(), camera, "no jump");
    let refused = remote.gestures.configure(HandOptions { gain: f64::NAN, ..exact() }).unwrap_err();
    assert_eq!(refused.to_string(), "gain is NaN, allowed: 0.05 to 20");
}
