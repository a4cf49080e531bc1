//! Structures, curves, snapping, fingers and linked views of the page for annotations: the results
//! of `browser/hands.py` and their expectations.

use std::f64::consts::PI;
use std::sync::OnceLock;

use serde_json::{Value, json};

use super::annotate::distance;
use super::{driven, number, numbers, skipped, triple};

/// The results of the browser, once for all tests; `None` with a message if there is no browser.
fn seen(what: &str) -> Option<&'static Value> {
    static SEEN: OnceLock<Option<Value>> = OnceLock::new();
    let seen = SEEN.get_or_init(|| driven("hands.py", "128", false));
    if seen.is_none() {
        skipped(what);
    }
    seen.as_ref()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn minus(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

fn cross(a: &[f64], b: &[f64]) -> Vec<f64> {
    (0..3).map(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3]).collect()
}

fn length(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

/// Invariant: A click in one of the five linked views moves the cursor in all; two fingers keep the
/// point under them; a snap in 3D moves along the line of sight.
#[test]
fn a_click_in_any_view_moves_the_cursor_in_all() {
    let Some(seen) = seen("linked views") else { return };
    assert_eq!(seen["problems"], json!([]));
    for (view, found) in seen["links"].as_object().unwrap() {
        let cursor = numbers(&found["cursor"]);
        let off = distance(&found["cursor"], &found["picked"]);
        assert!(off < 0.1, "{view}: the cursor is {off} mm from the pick");
        for (slice, asked) in found["slices"].as_object().unwrap() {
            let normal = match slice.as_str() {
                "axial" => vec![0.0, 0.0, 1.0],
                "sagittal" => vec![1.0, 0.0, 0.0],
                "coronal" => vec![0.0, 1.0, 0.0],
                _ => triple(&asked["normal"]),
            };
            let off = dot(&normal, &minus(&cursor, &triple(&asked["center_mm"])));
            assert!(off.abs() < 0.01, "{view}: the {slice} slice passes {off} mm beside the cursor");
        }
        // The clicked place is where the lines meet, or at the mark.
        let at = numbers(&found["at"]);
        let (marked, [width, height]) = match found["meets"].get(view) {
            None => (numbers(&found["mark"]), [1.0, 1.0]),
            Some(meets) => (numbers(meets), [number(&meets[2]), number(&meets[3])]),
        };
        for (i, side) in [width, height].into_iter().enumerate() {
            assert!(
                (marked[i] / side - at[i]).abs() < 0.006,
                "{view}: {marked:?} of {width} x {height}, {at:?}"
            );
        }
    }
}

#[test]
fn balls_are_painted_and_erased_and_the_erasing_is_taken_back() {
    let Some(seen) = seen("painting on the page") else { return };
    let painting = &seen["painting"];
    let [one, two, erased, undone] = ["one", "two", "erased", "undone"].map(|name| number(&painting[name]));
    // 12 mm, apart from each other, of voxels of 1.875 mm.
    let ball = 4.0 / 3.0 * PI * 12f64.powi(3) / 1000.0;
    assert!((one / ball - 1.0).abs() < 0.03, "{one} ml, the ball has {ball} ml");
    assert!((two / (2.0 * ball) - 1.0).abs() < 0.03, "{two} ml of two balls");
    assert!((erased - one).abs() < 1e-9 && (undone - two).abs() < 1e-9, "{painting}");
}

#[test]
fn contours_on_three_levels_become_the_region_between_them() {
    let Some(seen) = seen("filling on the page") else { return };
    let filling = &seen["filling"];
    assert_eq!(filling["closed"], json!([true, true, true]));
    assert_eq!(filling["points"], json!([8, 8, 8]));
    let heights = numbers(&filling["heights"]);
    // Ten slices of 2.4 mm from level to level.
    for pair in heights.windows(2) {
        assert!((pair[1] - pair[0] - 10.0 * 2.4).abs() < 0.01, "{heights:?}");
    }
    // Whole slices of 2.4 mm, those whose middle lies between the levels or within half a slice of
    // them; each as large as the circle, of which a smooth curve through eight points leaves out
    // about a hundredth.
    let radius = number(&filling["radius_mm"]);
    let slice_ml = PI * radius * radius * 2.4 / 1000.0;
    let (height, ml) = (heights[2] - heights[0], number(&filling["region"]["volume_ml"]));
    let slices = (ml / slice_ml).round();
    assert!(
        ((height - 2.4) / 2.4..=(height + 4.8) / 2.4).contains(&slices),
        "{slices} slices between {heights:?}"
    );
    assert!(
        (ml / (slices * slice_ml) - 0.99).abs() < 0.015,
        "{ml} ml, {slices} slices have {} ml",
        slices * slice_ml
    );
}

#[test]
fn points_of_a_curve_are_added_on_its_line_and_removed() {
    let Some(seen) = seen("points of a curve on the page") else { return };
    let curve = &seen["curve"];
    let [made, removed, undone] = ["made", "removed", "undone"].map(|name| curve[name].as_array().unwrap());
    let added = curve["added"]["points"].as_array().unwrap();
    assert_eq!((made.len(), added.len()), (3, 4));
    assert_eq!((&added[0], &added[2], &added[3]), (&made[0], &made[1], &made[2]), "between the first two");
    let off = distance(&added[1], &curve["added"]["pressed"]);
    assert!(off < 1.0, "{off} mm from the press, less than a pixel and a half");
    assert_eq!(
        (removed, undone),
        (made, added),
        "two were removed in all, one after the other, and both came back"
    );
    assert_eq!(curve["least"], 2);
}

/// Invariant: A click in one of the five linked views moves the cursor in all; two fingers keep the
/// point under them; a snap in 3D moves along the line of sight.
#[test]
fn a_snap_in_3d_looks_along_the_line_of_sight() {
    let Some(seen) = seen("snapping along the line of sight") else { return };
    let sight = &seen["sight"];
    let shift = numbers(&sight["placement"]["snapped_mm"]);
    let eye = numbers(&sight["placement"]["camera"]["eye_mm"]);
    let ray = minus(&numbers(&sight["at_mm"]), &eye);
    assert!(length(&shift) > 0.01, "{sight}");
    let across = length(&cross(&shift, &ray)) / length(&ray);
    assert!(across < 0.01, "moved {} mm, {across} of it across the line of sight", length(&shift));
    assert!((length(&numbers(&sight["ray"])) - 1.0).abs() < 1e-6, "{sight}");
    assert_eq!(sight["in_slice"], Value::Null, "in a slice the nearest edge counts");
}

/// Invariant: A click in one of the five linked views moves the cursor in all; two fingers keep the
/// point under them; a snap in 3D moves along the line of sight.
#[test]
fn two_fingers_move_and_zoom_what_lies_under_them() {
    let Some(seen) = seen("two fingers") else { return };
    let fingers = &seen["fingers"];
    assert_eq!((&fingers["problems"], &fingers["items"]), (&json!([]), &seen_items(seen)));
    // The slice: half of the visible height is left, and the part between the fingers stays there.
    let axial = &fingers["axial"];
    let [before, after] = ["before", "after"].map(|name| number(&axial[name]["height_mm"]));
    assert!((before / after - 2.0).abs() < 1e-3, "{before} mm, {after} mm");
    let aspect = number(&axial["aspect"]);
    let under = |name: &str, at: &str| {
        let (asked, at) = (&axial[name], numbers(&axial[at]));
        let (center, height) = (triple(&asked["center_mm"]), number(&asked["height_mm"]));
        // The patient's left is at the right, the back below.
        [center[0] + (at[0] - 0.5) * aspect * height, center[1] + (at[1] - 0.5) * height]
    };
    let [from, to] = [under("before", "from"), under("after", "to")];
    assert!((from[0] - to[0]).hypot(from[1] - to[1]) < 0.5, "{from:?} was under the fingers, {to:?} is");
    // 3D: the same in the plane through the point that is looked at.
    let volume = &fingers["volume"];
    let (radius, center) = (number(&volume["radius_mm"]), numbers(&volume["center_mm"]));
    let after = &volume["after"];
    let [eye, look] = ["eye_mm", "look_at_mm"].map(|name| triple(&after[name]));
    let back = minus(&eye, &look);
    let half = 11f64.to_radians();
    assert!((length(&back) - radius / half.sin()).abs() < 0.01, "the eye stays as far away");
    let zoom = number(&volume["before"]["zoom"]);
    let height = 2.0 * length(&back) * (number(&after["vertical_fov_deg"]).to_radians() / 2.0).tan();
    let whole = 2.0 * radius / half.cos() / zoom;
    assert!((whole / height - 2.0).abs() < 1e-3, "{whole} mm, {height} mm");
    let up = triple(&after["up"]);
    let right = cross(&up, &back.iter().map(|mm| mm / length(&back)).collect::<Vec<_>>());
    let aspect = number(&volume["aspect"]);
    let under = |center: &[f64], height: f64, at: &str| -> Vec<f64> {
        let at = numbers(&volume[at]);
        let (x, y) = ((at[0] - 0.5) * aspect * height, (0.5 - at[1]) * height);
        (0..3).map(|i| center[i] + x * right[i] + y * up[i]).collect()
    };
    let [from, to] = [under(&center, whole, "from"), under(&look, height, "to")];
    let off = length(&minus(&from, &to));
    assert!(off < 0.5, "{off} mm from what was under the fingers");
}

/// How many items the other steps left: fingers add none.
fn seen_items(seen: &Value) -> Value {
    json!(seen["jobs"]["items"][1].as_u64().unwrap() + 1)
}

#[test]
fn hanging_tasks_are_displayed_and_cancelled() {
    let Some(seen) = seen("long work on the page") else { return };
    let jobs = &seen["jobs"];
    let said = jobs["said"].as_str().unwrap();
    // The time so far; a busy machine may show more than the first second.
    let seconds = said.lines().find_map(|line| line.strip_suffix(" s")?.parse::<u32>().ok());
    assert!(said.contains("mesh of “Region 1”") && seconds >= Some(1) && said.contains("Cancel"), "{said}");
    assert_eq!(jobs["bar"], -1.0, "nobody knows the share that is done");
    assert_eq!(jobs["items"][0], jobs["items"][1]);
    assert_eq!(jobs["mesh"], "mesh", "the next one goes through");
}

#[test]
fn slices_play_and_a_plane_cuts_the_3d_view() {
    let Some(seen) = seen("cine and clip planes of the page for annotations") else { return };
    let cine = &seen["cine"];
    assert_eq!((&cine["playing"], &cine["stopped"]), (&json!("true"), &json!("false")), "{cine}");
    assert_ne!(cine["first"], cine["last"], "{cine}");
    let plane: Vec<f64> =
        cine["plane"].as_str().unwrap().split(',').map(|part| part.parse().unwrap()).collect();
    assert_eq!(plane.len(), 6, "{cine}");
    assert!((length(&plane[3..]) - 1.0).abs() < 1e-3, "{cine}");
    assert_eq!(cine["whole"], Value::Null);
}

/// Invariant: A pane at rest displays the complete picture, however late the ones before it come.
#[test]
fn pictures_that_come_late_do_not_stay() {
    let Some(seen) = seen("late pictures of the page for annotations") else { return };
    // The script fails where a moving picture stays.
    assert!(seen["late"]["held"].as_u64().unwrap() > 0, "{}", seen["late"]);
}
