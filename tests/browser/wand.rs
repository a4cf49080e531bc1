//! Pointers of the kiosk: a phone, paired by its QR code, with Chromium's sensors; and a SpaceMouse behind
//! WebHID, which a script plays.

use std::sync::OnceLock;

use glam::{DQuat, DVec3};
use serde_json::{Value, json};

use super::{driven, numbers, skipped};

/// The results of the browser, once for all tests; `None` if there is no browser.
fn seen() -> Option<&'static Value> {
    static SEEN: OnceLock<Option<Value>> = OnceLock::new();
    SEEN.get_or_init(|| driven("wand.py", "64", false)).as_ref()
}

fn patient_from_view(state: &Value) -> DQuat {
    DQuat::from_slice(&numbers(&state["orientation_xyzw"])).normalize()
}

/// Invariant: A phone that scans the kiosk's code turns the view as it is turned, moves the cursor
/// where it points, and places landmarks there; a code opens one session.
#[test]
fn a_phone_turns_points_and_places() {
    let Some(seen) = seen() else { return skipped("a phone as a wand") };
    let open = &seen["open"];
    assert_eq!(open["problems"], json!([]));
    assert_eq!(open["violations"], json!([]));
    assert_eq!(open["address"], open["expected"], "as OpenCV reads the code");
    assert!(open["words"].as_str().unwrap().contains("cannot reach this address"), "{}", open["words"]);

    // The volume follows the hand: from above, clockwise by 25 degrees.
    let turn = patient_from_view(&open["turned"]).inverse() * patient_from_view(&open["before"]);
    let expected = DQuat::from_rotation_y(-25f64.to_radians());
    let apart = turn.angle_between(expected).to_degrees();
    assert!(apart < 0.1, "{turn} is {apart} degrees from {expected}");

    // Across the line of sight, because the surface is steep there: a pixel has 0.6 mm.
    for [by_phone, by_click] in [["pointed", "clicked"], ["steadied", "clicked_above"]] {
        let cursor = |state: &str| DVec3::from_slice(&numbers(&open[state]["cursor_mm"]));
        let apart = cursor(by_phone) - cursor(by_click);
        let apart = patient_from_view(&open["clicked"]).inverse() * apart;
        assert!(apart.truncate().length() < 0.6, "{by_phone}: {apart} mm from the cursor of a click");
    }
    let placed = open["placed"].as_array().unwrap();
    assert_eq!(placed.len(), 1, "{placed:?}: {}", open["said"]);
    assert_eq!(open["count"], 3, "one with Place held, one by a key");
    assert_eq!(open["inside"], "", "every landmark is within the depth");
    let outside = open["outside"].as_str().unwrap();
    let (named, others) =
        (outside.contains("“behind” is "), outside.contains("; another landmark is outside of it, too"));
    assert!(named && others && outside.contains(" mm behind the depth that the display shows"), "{outside}");

    let guarded = &seen["guarded"];
    assert_eq!((&guarded["has_ticket"], &guarded["is_read"]), (&json!(true), &json!(true)), "{guarded}");
    assert!(guarded["second"].as_str().unwrap().contains("Scan a new code"), "{guarded}");
}

/// Invariant: A phone that WebXR tracks moves and turns the volume as the hand does.
#[test]
fn a_phone_in_space_moves_and_turns() {
    let Some(seen) = seen() else { return skipped("a phone that is tracked in space") };
    let space = &seen["space"];
    assert_eq!((&space["problems"], &space["violations"]), (&json!([]), &json!([])));
    assert!(space["unknown"].as_str().unwrap().contains("does not know where it is"), "{space}");
    let look_at = |state: &str| DVec3::from_slice(&numbers(&space[state]["look_at_mm"]));
    // The volume goes with the hand, so that the view goes the other way.
    let by = patient_from_view(&space["before"]).inverse() * (look_at("moved") - look_at("before"));
    assert!((by - DVec3::new(-40.0, -20.0, 0.0)).length() < 0.5, "{by} mm");
    let turn = patient_from_view(&space["turned"]).inverse() * patient_from_view(&space["moved"]);
    let apart = turn.angle_between(DQuat::from_rotation_y(30f64.to_radians())).to_degrees();
    assert!(apart < 0.1, "{turn} is {apart} degrees away");
}

/// How long the reports of a SpaceMouse count, s: each for the time since the last one, and for 50 ms
/// at most, as the first one does.
fn counted_s(times_s: &Value) -> f64 {
    let times_s = numbers(times_s);
    0.05 + times_s.windows(2).map(|pair| (pair[1] - pair[0]).min(0.05)).sum::<f64>()
}

/// Invariant: A SpaceMouse behind WebHID turns the view about the axis of its cap, and moves the
/// cursor along it.
#[test]
fn a_spacemouse_turns_and_moves_the_cursor() {
    let Some(seen) = seen() else { return skipped("a SpaceMouse behind WebHID") };
    let cap = &seen["cap"];
    assert_eq!(cap["problems"], json!([]));
    let turn = patient_from_view(&cap["turned"]).inverse() * patient_from_view(&cap["before"]);
    // Pressed clockwise, from above: z of the device points down. 120 degrees a second.
    let expected = DVec3::new(0.0, -120f64.to_radians() * counted_s(&cap["times_s"]["turn"]), 0.0);
    let apart = (turn.to_scaled_axis() - expected).length();
    assert!(apart < 0.03 * expected.length(), "{} is not {expected}", turn.to_scaled_axis());
    let [clicked, moved] =
        ["clicked", "moved"].map(|state| DVec3::from_slice(&numbers(&cap[state]["cursor_mm"])));
    let by = patient_from_view(&cap["moved"]).inverse() * (moved - clicked);
    // To the right, by 60 mm a second.
    let expected = DVec3::new(60.0 * counted_s(&cap["times_s"]["shift"]), 0.0, 0.0);
    assert!((by - expected).length() < 0.03 * expected.length(), "{by} mm are not {expected} mm");
}
