//! A phone as a wand: paired by the QR code of the kiosk, with Chromium's sensors.

use glam::{DQuat, DVec3};
use serde_json::json;

use super::{driven, numbers, skipped};

/// Invariant: A phone that scans the kiosk's code turns the view as it is turned, moves the cursor
/// where it points, and places landmarks there; a code opens one session.
#[test]
fn a_phone_turns_points_and_places() {
    let Some(seen) = driven("wand.py", "64", false) else { return skipped("a phone as a wand") };
    let open = &seen["open"];
    assert_eq!(open["problems"], json!([]));
    assert_eq!(open["violations"], json!([]));
    assert_eq!(open["address"], open["expected"], "as OpenCV reads the code");
    assert!(open["words"].as_str().unwrap().contains("cannot reach this address"), "{}", open["words"]);

    // The volume follows the hand: from above, clockwise by 25 degrees.
    let patient_from_view =
        |state: &str| DQuat::from_slice(&numbers(&open[state]["orientation_xyzw"])).normalize();
    let turn = patient_from_view("turned").inverse() * patient_from_view("before");
    let expected = DQuat::from_rotation_y(-25f64.to_radians());
    let apart = turn.angle_between(expected).to_degrees();
    assert!(apart < 0.1, "{turn} is {apart} degrees from {expected}");

    // Across the line of sight, because the surface is steep there: a pixel has 0.6 mm.
    let [pointed, clicked] =
        ["pointed", "clicked"].map(|state| DVec3::from_slice(&numbers(&open[state]["cursor_mm"])));
    let apart = patient_from_view("clicked").inverse() * (pointed - clicked);
    assert!(apart.truncate().length() < 0.6, "the phone's cursor is {apart} mm from that of a click");
    let placed = open["placed"].as_array().unwrap();
    assert_eq!(placed.len(), 1, "{placed:?}: {}", open["said"]);

    let guarded = &seen["guarded"];
    assert_eq!((&guarded["has_ticket"], &guarded["is_read"]), (&json!(true), &json!(true)), "{guarded}");
    assert!(guarded["second"].as_str().unwrap().contains("Scan a new code"), "{guarded}");
}
