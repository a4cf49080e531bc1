//! Holding the volume, by intents: the grabbed point stays under the hand.

use glam::{DQuat, DVec3, EulerRot};
use relief_base::{Patient, Point};
use relief_live::{GrabMode, Intent, Pivot};

use super::{Session, assert_near, center, grab, movement, points};

/// A volume around the origin of view space that was turned and shifted before.
fn session() -> Session {
    let mut session = Session::new();
    session.json(r#"{"intent":"orbit","azimuth_deg":47,"elevation_deg":-31}"#);
    session.json(r#"{"intent":"pan","right":0.02,"up":0.03}"#);
    session
}

fn hands() -> [(DVec3, DQuat); 3] {
    [(0.1, 0.2, -0.3, 12.0), (-0.7, 0.3, 1.2, -9.0), (3.0, -0.2, 0.1, 3.0)].map(|(a, b, c, shift)| {
        (
            DVec3::new(400.0 + shift, -30.0 + shift / 2.0, 900.0 - shift),
            DQuat::from_euler(EulerRot::XYZ, a, b, c),
        )
    })
}

fn cursor_at(session: &mut Session, point: Point<Patient>) {
    let point_mm = Some(point.xyz.to_array());
    session.apply(&Intent::Cursor { at_px: None, at_view_mm: None, by_view_mm: None, point_mm });
}

/// Invariant: A grabbed volume stays under the hand, and neither release nor new grab moves it.
///
/// With hands that turn by Q and move by d, every point x of the volume goes to Q (x - p) + p + d:
/// that under the hand, p, stays under it.
#[test]
fn a_grabbed_point_follows_the_hand() {
    let from = (DVec3::new(400.0, -30.0, 900.0), DQuat::from_euler(EulerRot::XYZ, 0.5, 0.1, -0.2));
    for held in points() {
        let mut session = session();
        cursor_at(&mut session, held);
        let p = session.in_view(held);
        let before: Vec<DVec3> = points().iter().map(|point| session.in_view(*point)).collect();
        session.apply(&grab(from.0, from.1));
        for (position, orientation) in hands() {
            session.apply(&movement(position, orientation));
            let (d, q) = (position - from.0, orientation * from.1.inverse());
            assert_near(session.in_view(held), p + d, 1e-9, "under the hand");
            for (point, x) in points().into_iter().zip(&before) {
                assert_near(session.in_view(point), q * (*x - p) + p + d, 1e-9, "turned about the hand");
            }
        }
        // A hand that comes back brings the volume back.
        session.apply(&movement(from.0, from.1));
        for (point, x) in points().into_iter().zip(&before) {
            assert_near(session.in_view(point), *x, 1e-9, "back");
        }
    }
}

#[test]
fn modes_turn_or_move_alone() {
    let from = (DVec3::new(1.0, 2.0, 3.0), DQuat::IDENTITY);
    for mode in [GrabMode::Rotate, GrabMode::Move, GrabMode::Both] {
        let mut session = session();
        cursor_at(&mut session, points()[1]);
        let focal = session.camera().look_at();
        let before: Vec<DVec3> = points().iter().map(|point| session.in_view(*point)).collect();
        let (position_mm, orientation_xyzw) = (from.0.to_array(), from.1.to_array());
        session.apply(&Intent::Grab { position_mm, orientation_xyzw, mode, pivot: Pivot::Focal });
        let (d, q) = (DVec3::new(7.0, -4.0, 5.0), DQuat::from_rotation_y(0.6));
        session.apply(&movement(from.0 + d, q));
        let (d, q) = match mode {
            GrabMode::Rotate => (DVec3::ZERO, q),
            GrabMode::Move => (d, DQuat::IDENTITY),
            GrabMode::Both => (d, q),
        };
        for (point, x) in points().into_iter().zip(before) {
            assert_near(session.in_view(point), q * x + d, 1e-9, &format!("{mode:?}"));
        }
        if mode == GrabMode::Rotate {
            assert_near(session.camera().look_at().xyz, focal.xyz, 1e-9, "about the focal point");
        }
    }
}

/// Invariant: A grabbed volume stays under the hand, and neither release nor new grab moves it.
#[test]
fn releases_keep_and_grabs_do_not_jump() {
    let mut session = session();
    let [first, second, third] = hands();
    session.apply(&grab(first.0, first.1));
    session.apply(&movement(second.0, second.1));
    let kept = session.camera();
    session.json(r#"{"intent":"release"}"#);
    session.apply(&movement(third.0, third.1));
    assert_eq!(session.camera(), kept, "an open hand moves nothing");
    session.apply(&grab(third.0, third.1));
    assert_eq!(session.camera(), kept, "taking hold moves nothing");
    session.apply(&movement(third.0 + DVec3::X * 5.0, third.1));
    let moved = (kept.look_at() - session.camera().look_at()).xyz;
    assert_near(moved, kept.patient_from_view().linear() * DVec3::X * 5.0, 1e-9, "on from there");
    session.json(r#"{"intent":"undo"}"#);
    assert_eq!(session.camera(), kept, "a grab is one step");
}

/// The mouse turns the view while a hand holds it: the hand continues from there.
#[test]
fn others_may_change_what_a_hand_holds() {
    let mut session = session();
    let [first, second, _] = hands();
    session.apply(&grab(first.0, first.1));
    session.apply(&movement(second.0, second.1));
    session.json(r#"{"intent":"orbit","azimuth_deg":25}"#);
    let turned = session.camera();
    session.apply(&movement(second.0, second.1));
    assert_near(session.camera().eye().xyz, turned.eye().xyz, 1e-9, "no jump");
    session.apply(&movement(second.0 + DVec3::Y * 3.0, second.1));
    let moved = (turned.look_at() - session.camera().look_at()).xyz;
    assert_near(moved, turned.patient_from_view().linear() * DVec3::Y * 3.0, 1e-9, "on from there");
}

/// The focal point stays within twice the sphere, and a hand that comes back finds the volume where
/// it was.
#[test]
fn a_volume_cannot_be_thrown_away() {
    let mut session = session();
    let before = session.camera();
    session.apply(&grab(DVec3::ZERO, DQuat::IDENTITY));
    session.apply(&movement(DVec3::X * 5000.0, DQuat::IDENTITY));
    assert!(session.camera().look_at().distance(center()) < 2.0 * super::RADIUS_MM + 1e-9);
    session.apply(&movement(DVec3::ZERO, DQuat::IDENTITY));
    assert_near(session.camera().look_at().xyz, before.look_at().xyz, 1e-9, "back");
}
