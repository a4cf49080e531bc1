//! Whatever comes, in whatever order: the state stays finite and within its ranges.

use glam::DQuat;
use proptest::prelude::*;
use relief_live::{
    Gestures, GrabMode, HandOptions, HandPose, HandSample, Intent, Pivot, PlacePhase, ViewState,
};
use relief_tracking::{Buttons, TrackingState};

use super::{RADIUS_MM, center, stage};

fn quaternion() -> impl Strategy<Value = [f64; 4]> {
    prop::array::uniform3(-4.0..4.0f64).prop_map(|w| DQuat::from_scaled_axis(w.into()).to_array())
}

fn hand() -> impl Strategy<Value = ([f64; 3], [f64; 4])> {
    (prop::array::uniform3(-1e4..1e4f64), quaternion())
}

fn intent() -> impl Strategy<Value = Intent> {
    let cursor =
        |at_px, at_view_mm, by_view_mm, point_mm| Intent::Cursor { at_px, at_view_mm, by_view_mm, point_mm };
    let preset = |name: Option<&str>, step| Intent::Preset { name: name.map(str::to_owned), step };
    let grab = |((position_mm, orientation_xyzw), mode, pivot)| Intent::Grab {
        position_mm,
        orientation_xyzw,
        mode: [GrabMode::Both, GrabMode::Rotate, GrabMode::Move][mode],
        pivot: if pivot { Pivot::Focal } else { Pivot::Cursor },
    };
    prop_oneof![
        (-3600.0..3600.0, -200.0..200.0)
            .prop_map(|(azimuth_deg, elevation_deg)| Intent::Orbit { azimuth_deg, elevation_deg }),
        quaternion().prop_map(|rotation_xyzw| Intent::Turn { rotation_xyzw }),
        (-3600.0..3600.0, -90.0..90.0, 0.2..40.0, prop_oneof![Just(0.0), 5.0..150.0]).prop_map(
            |(azimuth_deg, elevation_deg, zoom, fov)| Intent::Look {
                azimuth_deg,
                elevation_deg,
                zoom: Some(zoom),
                vertical_fov_deg: Some(fov)
            }
        ),
        (-10.0..10.0, -10.0..10.0).prop_map(|(right, up)| Intent::Pan { right, up }),
        (0.01..100.0).prop_map(|factor| Intent::Zoom { factor }),
        (hand(), 0..3usize, any::<bool>()).prop_map(grab),
        hand().prop_map(|(position_mm, orientation_xyzw)| Intent::Move { position_mm, orientation_xyzw }),
        Just(Intent::Release {}),
        (-2e4..2e4).prop_map(|by| Intent::Clip { by_mm: Some(by), to_mm: None }),
        (-1000..1000i32).prop_map(move |step| preset(None, Some(step))),
        Just(preset(Some("lung"), None)),
        prop::array::uniform2(-1e5..1e5f64).prop_map(move |at| cursor(Some(at), None, None, None)),
        prop::array::uniform3(-1e5..1e5f64).prop_map(move |at| cursor(None, Some(at), None, None)),
        prop::array::uniform3(-1e5..1e5f64).prop_map(move |by| cursor(None, None, Some(by), None)),
        prop::array::uniform3(-1e6..1e6f64).prop_map(move |at| cursor(None, None, None, Some(at))),
        Just(Intent::Place { phase: PlacePhase::Preview }),
        Just(Intent::Place { phase: PlacePhase::Commit }),
        Just(Intent::Undo {}),
        Just(Intent::Reset {}),
        Just(Intent::NextLabel {}),
    ]
}

/// Checks the invariants of every state.
fn check(state: &ViewState) {
    let record = state.record();
    let norm = record.orientation_xyzw.iter().map(|c| c * c).sum::<f64>().sqrt();
    assert!((norm - 1.0).abs() < 1e-12, "{record:?}");
    let camera = state.camera(&stage()).unwrap();
    assert!(camera.look_at().distance(center()) <= 2.0 * RADIUS_MM + 1e-9, "{record:?}");
    assert!((0.2..=40.0).contains(&record.zoom), "{record:?}");
    assert!(record.clip_mm.is_none_or(|cut| cut > 0.0 && cut <= 2.0 * RADIUS_MM), "{record:?}");
    assert!(record.undo <= 64);
    assert!(state.cursor().is_none_or(|at| at.distance(center()) <= RADIUS_MM + 1e-9), "{record:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// Invariant: Any intents and any hand leave a finite view within its ranges, and undo restores
    /// the view.
    #[test]
    fn any_intents_leave_a_view(intents in prop::collection::vec((intent(), 0..2_000_000_000u64), 1..80)) {
        let stage = stage();
        let mut state = ViewState::home(&stage);
        for (intent, t_ns) in intents {
            let before = state.clone();
            match state.apply(&stage, t_ns, &intent, None) {
                Ok(applied) => {
                    prop_assert_eq!(applied.changed, state.revision() != before.revision());
                    prop_assert!(applied.changed || state.record() == before.record());
                }
                Err(_) => prop_assert_eq!(&state, &before),
            }
            check(&state);
        }
    }

    /// Invariant: Any intents and any hand leave a finite view within its ranges, and undo restores
    /// the view.
    ///
    /// One step and one step back is nothing, but for the cursor, which is no step.
    #[test]
    fn undo_restores(earlier in prop::collection::vec(intent(), 0..20), last in intent()) {
        let stage = stage();
        let mut state = ViewState::home(&stage);
        let mut t_ns = 0;
        let mut apply = |state: &mut ViewState, intent: &Intent| {
            t_ns += 2_000_000_000;
            state.apply(&stage, t_ns, intent, None).is_ok_and(|applied| applied.changed)
        };
        for intent in earlier {
            apply(&mut state, &intent);
        }
        apply(&mut state, &Intent::Release {});
        let before = state.record();
        apply(&mut state, &last);
        if state.record().undo == before.undo + 1 {
            apply(&mut state, &Intent::Undo {});
            let after = state.record();
            prop_assert_eq!(after.look_at_mm, before.look_at_mm);
            prop_assert_eq!(after.orientation_xyzw, before.orientation_xyzw);
            prop_assert_eq!((after.zoom, after.vertical_fov_deg), (before.zoom, before.vertical_fov_deg));
            prop_assert_eq!((after.preset, after.clip_mm), (before.preset, before.clip_mm));
        }
    }

    /// Invariant: Any intents and any hand leave a finite view within its ranges, and undo restores
    /// the view.
    ///
    /// Samples and buttons at any times, in any order, in any state.
    #[test]
    fn any_hand_leaves_a_view(
        events in prop::collection::vec((0..5_000_000_000u64, any::<u16>(), hand(), 0..5usize), 1..120)
    ) {
        let stage = stage();
        let mut state = ViewState::home(&stage);
        let mut gestures = Gestures::new(HandOptions::default()).unwrap();
        for (t_ns, bits, (position_mm, orientation_xyzw), known) in events {
            let buttons = Buttons::from_bytes(bits.to_be_bytes());
            let pose = HandPose::new(position_mm, orientation_xyzw).ok();
            let tracking = [TrackingState::Searching, TrackingState::Ambiguous, TrackingState::Lost];
            let found = tracking.get(known).copied().unwrap_or(TrackingState::Tracking);
            let mut intents = gestures.hold(t_ns, buttons);
            intents.extend(gestures.track(&HandSample { t_ns, state: found, pose }));
            for intent in intents {
                state.apply(&stage, t_ns, &intent, None).unwrap();
                check(&state);
            }
        }
        for intent in gestures.end() {
            state.apply(&stage, 0, &intent, None).unwrap();
        }
        prop_assert!(!state.is_grabbed() && !state.is_placing());
    }
}
