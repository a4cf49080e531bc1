//! A view brought back to where it was, by intents: for a server that was restarted.

use glam::{DQuat, DVec3};

use relief_live::{GrabMode, Intent, Pivot, ViewRecord};

/// The messages that bring a new view to `wanted`; `look_at_mm` is its focal point now. The preset
/// is set by hello.
///
/// A look from the front is a known orientation P = Rx(90 degrees). A hand then turns by Q and
/// moves by d: view_from_patient becomes Q P⁻¹, and the focal point goes to d in view.
pub(super) fn intents(look_at_mm: [f64; 3], wanted: &ViewRecord) -> Vec<Intent> {
    let front = DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2);
    let patient_from_view = DQuat::from_array(wanted.orientation_xyzw).normalize();
    let view_from_patient = patient_from_view.inverse();
    let shift = view_from_patient * (DVec3::from_array(look_at_mm) - DVec3::from_array(wanted.look_at_mm));
    let turn = (view_from_patient * front).normalize();
    let mut intents = vec![
        Intent::Look {
            azimuth_deg: 0.0,
            elevation_deg: 0.0,
            zoom: Some(wanted.zoom),
            vertical_fov_deg: Some(wanted.vertical_fov_deg),
        },
        Intent::Grab {
            position_mm: [0.0; 3],
            orientation_xyzw: [0.0, 0.0, 0.0, 1.0],
            mode: GrabMode::Both,
            pivot: Pivot::Focal,
        },
        Intent::Move { position_mm: shift.to_array(), orientation_xyzw: turn.to_array() },
        Intent::Release {},
    ];
    intents.extend(wanted.clip_mm.map(|mm| Intent::Clip { by_mm: None, to_mm: Some(mm) }));
    intents.extend(wanted.cursor_mm.map(|point| Intent::Cursor {
        at_px: None,
        at_view_mm: None,
        by_view_mm: None,
        point_mm: Some(point),
    }));
    // Received values may not be finite: then the view is not changed.
    if intents.iter().any(|intent| intent.validate().is_err()) { Vec::new() } else { intents }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relief_base::Point;
    use relief_live::{Home, Stage, ViewState};

    #[test]
    fn a_view_that_was_turned_shifted_cut_and_pointed_at_comes_back() {
        let home = Home { orbit: Home::ORBIT, preset: None };
        let stage = Stage::new(Point::new(10.0, -20.0, 300.0), 200.0, [960, 540], Vec::new(), home).unwrap();
        let mut before = ViewState::home(&stage);
        for json in [
            r#"{"intent":"orbit","azimuth_deg":70,"elevation_deg":-30}"#,
            r#"{"intent":"turn","rotation_xyzw":[0.1825741858350554,0.3651483716701107,0.5477225575051661,0.7302967433402214]}"#,
            r#"{"intent":"pan","right":0.1,"up":-0.2}"#,
            r#"{"intent":"zoom","factor":1.7}"#,
            r#"{"intent":"clip","by_mm":42}"#,
            r#"{"intent":"cursor","at_view_mm":[5,6,7]}"#,
        ] {
            let intent = Intent::from_json(json.as_bytes()).unwrap();
            before.apply(&stage, 0, &intent, None).unwrap();
        }
        let wanted = before.record();
        let mut again = ViewState::home(&stage);
        for intent in intents(again.record().look_at_mm, &wanted) {
            again.apply(&stage, 0, &intent, None).unwrap();
        }
        let found = again.record();
        let close = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
        assert!(close(&found.look_at_mm, &wanted.look_at_mm), "{found:?} {wanted:?}");
        assert!(close(&found.orientation_xyzw, &wanted.orientation_xyzw), "{found:?} {wanted:?}");
        assert!(close(&[found.zoom, found.vertical_fov_deg], &[wanted.zoom, wanted.vertical_fov_deg]));
        assert!(
            close(&found.cursor_mm.unwrap(), &wanted.cursor_mm.unwrap()) && found.clip_mm == wanted.clip_mm
        );
        assert!(!found.grabbed);
    }

    #[test]
    fn invalid_numbers_restore_nothing() {
        let home = Home { orbit: Home::ORBIT, preset: None };
        let stage = Stage::new(Point::new(0.0, 0.0, 0.0), 200.0, [960, 540], Vec::new(), home).unwrap();
        let record = ViewState::home(&stage).record();
        for broken in [
            ViewRecord { zoom: f64::NAN, ..record.clone() },
            ViewRecord { orientation_xyzw: [0.0; 4], ..record.clone() },
            ViewRecord { look_at_mm: [1e300; 3], ..record },
        ] {
            assert!(intents([0.0; 3], &broken).is_empty());
        }
    }
}
