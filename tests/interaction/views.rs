//! Each intent that is no hand: orbit, look, turn, pan, zoom, clip, preset, cursor, place, undo.

use glam::{DQuat, DVec3};
use relief_base::{Point, ViewDepth};
use relief_live::{DisplayedPicture, Home, Intent, IntentEffect, IntentError, ViewState};
use relief_volume::Orbit;

use super::{RADIUS_MM, SIZE_PX, Session, assert_near, assert_same_view, center, points, stage, stage_of};

/// Invariant: The home view equals that of the page, and turntable views equal those of `Orbit`.
#[test]
fn the_home_view_is_the_pages() {
    let orbit = Orbit { azimuth_deg: 20.0, elevation_deg: 10.0, zoom: 1.0, vertical_fov_deg: 22.0 };
    let page = orbit.camera(center(), RADIUS_MM).unwrap();
    assert_same_view(&Session::new().camera(), &page, 1e-15, "home");
    let script = include_str!("../../src/server/page/view.js");
    assert!(script.contains("HOME = Object.freeze({ azimuth: 20, elevation: 10, zoom: 1 })"));
    assert_eq!(Home::ORBIT, orbit);
}

/// Invariant: The home view equals that of the page, and turntable views equal those of `Orbit`.
#[test]
fn orbits_are_those_of_the_camera_and_end_at_the_poles() {
    let mut session = Session::new();
    let mut orbit = Home::ORBIT;
    for (azimuth_deg, elevation_deg) in [
        (30.0, 5.0),
        (-250.0, -60.0),
        (700.0, -80.0),
        (11.0, 0.5),
        (-3.0, 45.0),
        (90.0, 3000.0),
        (1.0, -20.0),
    ] {
        session.apply(&Intent::Orbit { azimuth_deg, elevation_deg });
        orbit.azimuth_deg += azimuth_deg;
        orbit.elevation_deg = (orbit.elevation_deg + elevation_deg).clamp(-90.0, 90.0);
        let wanted = orbit.camera(center(), RADIUS_MM).unwrap();
        assert_same_view(&session.camera(), &wanted, 1e-12, &format!("{orbit:?}"));
    }
    session.json(r#"{"intent":"look","azimuth_deg":-90,"elevation_deg":0,"zoom":2,"vertical_fov_deg":0}"#);
    let right = Orbit { azimuth_deg: -90.0, elevation_deg: 0.0, zoom: 2.0, vertical_fov_deg: 0.0 };
    assert_same_view(&session.camera(), &right.camera(center(), RADIUS_MM).unwrap(), 1e-12, "look");
}

/// From upside down a turntable comes back, and goes no further over.
#[test]
fn a_view_that_was_turned_over_comes_back() {
    let mut session = Session::new();
    let over = DQuat::from_rotation_x(150f64.to_radians()).to_array();
    session.apply(&Intent::Look { azimuth_deg: 0.0, elevation_deg: 0.0, zoom: None, vertical_fov_deg: None });
    session.apply(&Intent::Turn { rotation_xyzw: over });
    let upside_down = session.camera().up().xyz;
    assert!(upside_down.z < -0.8, "{upside_down}");
    session.apply(&Intent::Orbit { azimuth_deg: 0.0, elevation_deg: 20.0 });
    assert_near(session.camera().up().xyz, upside_down, 1e-12, "no further");
    session.apply(&Intent::Orbit { azimuth_deg: 0.0, elevation_deg: -3000.0 });
    assert_near((session.camera().eye() - center()).xyz.normalize(), DVec3::NEG_Z, 1e-9, "from the feet");
}

#[test]
fn a_free_turn_turns_the_volume_in_view_by_its_rotation() {
    let mut session = Session::new();
    let rotation = DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.0);
    let before: Vec<DVec3> = points().iter().map(|point| session.in_view(*point)).collect();
    session.apply(&Intent::Turn { rotation_xyzw: rotation.to_array() });
    for (point, before) in points().into_iter().zip(before) {
        assert_near(session.in_view(point), rotation * before, 1e-9, "turned");
    }
}

#[test]
fn zoom_narrows_the_field_of_view_and_ends() {
    let mut session = Session::new();
    let with = |zoom| Orbit { zoom, ..Home::ORBIT }.camera(center(), RADIUS_MM).unwrap();
    for (factor, zoom) in [(1.5, 1.5), (0.5, 0.75), (100.0, 40.0), (0.01, 0.4), (0.01, 0.2)] {
        session.apply(&Intent::Zoom { factor });
        assert_same_view(&session.camera(), &with(zoom), 1e-12, &format!("zoom {zoom}"));
    }
    // A picture taller than wide stands back, as the page's does.
    let tall = Session::on(stage_of([300, 600], Home::ORBIT));
    assert_same_view(&tall.camera(), &with(0.5), 1e-12, "a tall picture");
}

/// The widest field of view, the smallest zoom and a strip of a picture together still have a
/// camera.
#[test]
fn every_view_has_a_camera() {
    for vertical_fov_deg in [0.0, 5.0, 22.0, 150.0] {
        for zoom in [0.2, 1.0, 40.0] {
            for size_px in [[1, 8192], [8192, 1], [960, 540]] {
                let session = Session::on(stage_of(size_px, Orbit { zoom, vertical_fov_deg, ..Home::ORBIT }));
                session.state.camera(&session.stage).unwrap();
            }
        }
    }
}

#[test]
fn a_pan_shifts_the_picture_and_keeps_the_focal_depth() {
    for vertical_fov_deg in [22.0, 0.0] {
        let mut session = Session::on(stage_of(SIZE_PX, Orbit { vertical_fov_deg, ..Home::ORBIT }));
        let focal = session.camera().look_at();
        let distance_mm = session.camera().distance_mm();
        session.json(r#"{"intent":"pan","right":0.25,"up":-0.1}"#);
        let (u, v, depth) = session.camera().project(focal, SIZE_PX).unwrap();
        assert!((u - (480.0 + 0.25 * 540.0)).abs() < 1e-9 && (v - (270.0 + 54.0)).abs() < 1e-9, "{u} {v}");
        assert!((depth - distance_mm).abs() < 1e-9, "{depth}");
    }
    let mut session = Session::new();
    session.json(r#"{"intent":"pan","right":10}"#);
    assert!(session.camera().look_at().distance(center()) < 2.0 * RADIUS_MM + 1e-9, "the volume is not lost");
}

#[test]
fn the_clip_plane_goes_along_the_viewing_axis() {
    let mut session = Session::new();
    assert_eq!(session.state.cut_plane(&session.stage), None);
    session.json(r#"{"intent":"clip","by_mm":40}"#);
    session.json(r#"{"intent":"clip","by_mm":30}"#);
    assert_eq!(session.state.record().clip_mm, Some(70.0));
    for turn in [0.0, 77.0] {
        session.apply(&Intent::Orbit { azimuth_deg: turn, elevation_deg: 0.0 });
        let plane = session.state.cut_plane(&session.stage).unwrap();
        let place = session.in_view(plane.point);
        assert_near(place, DVec3::new(0.0, 0.0, RADIUS_MM - 70.0), 1e-9, "70 mm behind the sphere's front");
        let along = session.camera().look_at() - session.camera().eye();
        assert_near(plane.normal.xyz, along.xyz.normalize(), 1e-12, "away from the eye");
    }
    // Shifting the picture leaves it where it is in the volume.
    let before = session.state.cut_plane(&session.stage).unwrap();
    session.json(r#"{"intent":"pan","up":0.2}"#);
    assert_near(session.state.cut_plane(&session.stage).unwrap().point.xyz, before.point.xyz, 1e-9, "panned");
    session.json(r#"{"intent":"clip","to_mm":5000}"#);
    assert_eq!(session.state.record().clip_mm, Some(2.0 * RADIUS_MM));
    session.json(r#"{"intent":"clip","by_mm":-20000}"#);
    assert_eq!(session.state.record().clip_mm, None);
}

#[test]
fn presets_are_a_ring() {
    let mut session = Session::new();
    for (json, preset) in [
        (r#"{"intent":"preset","step":1}"#, "skin"),
        (r#"{"intent":"preset","step":2}"#, "bone"),
        (r#"{"intent":"preset","step":-1}"#, "lung"),
        (r#"{"intent":"preset","name":"skin"}"#, "skin"),
    ] {
        session.json(json);
        assert_eq!(session.state.preset(), Some(preset), "{json}");
    }
    let none = Intent::Preset { name: Some("teeth".to_owned()), step: None };
    let refused = session.state.apply(&session.stage, 0, &none, None).unwrap_err();
    assert_eq!(refused.to_string(), "name is \"teeth\", allowed: bone, skin, lung");
    assert_eq!(session.state.preset(), Some("skin"));
}

/// A pixel refers to the displayed picture and its camera, also if the view has moved since.
#[test]
fn the_cursor_goes_to_what_is_seen_at_a_pixel() {
    for vertical_fov_deg in [22.0, 0.0] {
        let mut session = Session::on(stage_of(SIZE_PX, Orbit { vertical_fov_deg, ..Home::ORBIT }));
        let camera = session.camera();
        for (azimuth_deg, point) in points().into_iter().enumerate() {
            let (u, v, depth_mm) = camera.project(point, SIZE_PX).unwrap();
            let depth = |_: [f64; 2]| ViewDepth(depth_mm as f32);
            let rounded = f64::from(depth_mm as f32);
            session.apply(&Intent::Orbit { azimuth_deg: azimuth_deg as f64, elevation_deg: 0.0 });
            let at =
                Intent::Cursor { at_px: Some([u, v]), at_view_mm: None, by_view_mm: None, point_mm: None };
            let seen = DisplayedPicture { camera, depth: &depth };
            session.state.apply(&session.stage, 0, &at, Some(&seen)).unwrap();
            let cursor = session.state.cursor().unwrap();
            assert_near(cursor.xyz, point.xyz, (rounded - depth_mm).abs() * 1.1 + 1e-9, "the point seen");
        }
        // Where nothing is seen, the cursor keeps its depth.
        let known = session.state.cursor().unwrap();
        let (u, v, depth_mm) = session.camera().project(known, SIZE_PX).unwrap();
        let aside = format!(r#"{{"intent":"cursor","at_px":[{},{}]}}"#, u + 30.0, v);
        session.json(&aside);
        let moved = session.state.cursor().unwrap();
        let kept = in_depth(&session.camera(), moved);
        assert!((kept - depth_mm).abs() < 1e-9, "{kept}");
        assert!(moved.distance(known) > 1.0);
    }
}

fn in_depth(camera: &relief_volume::Camera, point: Point<relief_base::Patient>) -> f64 {
    camera.project(point, SIZE_PX).unwrap().2
}

#[test]
fn the_cursor_moves_in_view_and_stays_in_the_sphere() {
    let mut session = Session::new();
    session.json(r#"{"intent":"cursor","at_view_mm":[10,20,-30]}"#);
    assert_near(session.in_view(session.state.cursor().unwrap()), DVec3::new(10.0, 20.0, -30.0), 1e-9, "at");
    session.json(r#"{"intent":"cursor","by_view_mm":[1,-2,3]}"#);
    assert_near(session.in_view(session.state.cursor().unwrap()), DVec3::new(11.0, 18.0, -27.0), 1e-9, "by");
    session.json(r#"{"intent":"cursor","point_mm":[12,-19,305]}"#);
    assert_eq!(session.state.record().cursor_mm, Some([12.0, -19.0, 305.0]));
    session.json(r#"{"intent":"cursor","at_view_mm":[100000,0,0]}"#);
    assert_near(session.in_view(session.state.cursor().unwrap()), DVec3::X * RADIUS_MM, 1e-6, "the sphere's");
    let mark = session.state.cursor_mark(&session.stage).unwrap();
    assert!((mark.radius_px - 6.0).abs() < 1e-9 && Some(mark.at) == session.state.cursor());
}

#[test]
fn placing_follows_the_cursor_until_it_is_done() {
    let mut session = Session::new();
    let preview = Intent::from_json(br#"{"intent":"place","phase":"preview"}"#).unwrap();
    let refused = session.state.apply(&session.stage, 0, &preview, None);
    assert!(matches!(refused, Err(IntentError::NoCursor)), "{refused:?}");
    session.json(r#"{"intent":"cursor","point_mm":[10,-20,310]}"#);
    assert_eq!(session.apply(&preview).event, Some(IntentEffect::Placing(Point::new(10.0, -20.0, 310.0))));
    assert!(session.state.is_placing());
    let moved = session.json(r#"{"intent":"cursor","point_mm":[11,-20,310]}"#);
    let there = Point::new(11.0, -20.0, 310.0);
    assert_eq!(moved.event, Some(IntentEffect::Placing(there)));
    assert_eq!(
        session.json(r#"{"intent":"place","phase":"commit"}"#).event,
        Some(IntentEffect::Placed(there))
    );
    assert_eq!(session.json(r#"{"intent":"place","phase":"cancel"}"#).event, None, "nothing is being placed");
    session.apply(&preview);
    let cancelled = session.json(r#"{"intent":"place","phase":"cancel"}"#);
    assert_eq!(cancelled.event, Some(IntentEffect::PlacingCancelled));
    assert_eq!(session.json(r#"{"intent":"next_label"}"#).event, Some(IntentEffect::NextLabel));
}

#[test]
fn undo_takes_back_steps_and_drags_as_one() {
    let (stage, mut state) = (stage(), ViewState::home(&stage()));
    let at = |state: &mut ViewState, ms: u64, json: &str| {
        let intent = Intent::from_json(json.as_bytes()).unwrap();
        state.apply(&stage, ms * 1_000_000, &intent, None).unwrap()
    };
    let home = state.camera(&stage).unwrap();
    for ms in 0..50 {
        at(&mut state, ms * 16, r#"{"intent":"orbit","azimuth_deg":1}"#);
    }
    let dragged = state.camera(&stage).unwrap();
    at(&mut state, 900, r#"{"intent":"zoom","factor":2}"#);
    at(&mut state, 4000, r#"{"intent":"reset"}"#);
    assert_eq!(state.record().undo, 3);
    let undo = r#"{"intent":"undo"}"#;
    at(&mut state, 5000, undo);
    assert!((state.record().zoom - 2.0).abs() < 1e-12);
    at(&mut state, 5001, undo);
    assert_eq!(state.camera(&stage).unwrap(), dragged);
    at(&mut state, 5002, undo);
    assert_eq!(state.camera(&stage).unwrap(), home);
    let revision = state.revision();
    assert!(!at(&mut state, 5003, undo).changed, "there is nothing left");
    assert_eq!(state.revision(), revision);
}

#[test]
fn history_is_bounded() {
    let mut session = Session::new();
    for _ in 0..300 {
        session.json(r#"{"intent":"preset","step":1}"#);
    }
    assert_eq!(session.state.record().undo, 64);
}

#[test]
fn the_record_is_the_documented_json() {
    let mut session = Session::new();
    session.json(r#"{"intent":"look","azimuth_deg":0,"elevation_deg":90}"#);
    let json = serde_json::to_string(&session.state.record()).unwrap();
    let wanted = r#"{"look_at_mm":[10.0,-20.0,300.0],"orientation_xyzw":[0.0,0.0,0.0,1.0],"zoom":1.0,"vertical_fov_deg":22.0,"preset":"bone","clip_mm":null,"cursor_mm":null,"grabbed":false,"placing":false,"undo":1,"revision":1}"#;
    assert_eq!(json, wanted);
    let back: relief_live::ViewRecord = serde_json::from_str(&json).unwrap();
    assert_eq!(back, session.state.record());
}

/// As `apply` has it inside a message of a protocol: beside other keys, and still without unknown
/// ones.
#[test]
fn intents_lie_flat_in_a_message() {
    #[derive(Debug, serde::Deserialize)]
    struct Message {
        seq: u64,
        #[serde(flatten)]
        intent: Intent,
    }
    let message: Message = serde_json::from_str(r#"{"seq":7,"intent":"zoom","factor":1.5}"#).unwrap();
    assert_eq!((message.seq, message.intent), (7, Intent::Zoom { factor: 1.5 }));
    for wrong in [r#"{"seq":7,"intent":"zoom","factor":1.5,"extra":1}"#, r#"{"seq":7,"intent":"undo","x":1}"#]
    {
        let refused = serde_json::from_str::<Message>(wrong).unwrap_err().to_string();
        assert!(refused.contains("unknown field"), "{refused}");
    }
}
