//! The page for annotations: the results of `browser/annotate.py` and their expectations.

use std::sync::OnceLock;

use serde_json::{Value, json};

use super::{driven, number, numbers, skipped};

/// The results of the browser, once for all tests; `None` with a message if there is no browser.
fn seen(what: &str) -> Option<&'static Value> {
    static SEEN: OnceLock<Option<Value>> = OnceLock::new();
    let seen = SEEN.get_or_init(|| driven("annotate.py", "128", false));
    if seen.is_none() {
        skipped(what);
    }
    seen.as_ref()
}

pub(super) fn distance(a: &Value, b: &Value) -> f64 {
    numbers(a).iter().zip(numbers(b)).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// Invariant: The annotation page places what a pick returns, within 0.1 mm; looking around changes
/// nothing; nothing unseen is overwritten.
#[test]
fn points_are_placed_where_the_pick_says_in_3d_and_in_slices() {
    let Some(seen) = seen("placing on the page") else { return };
    let placing = &seen["placing"];
    for (view, method) in [("volume", "pick"), ("axial", "slice")] {
        let item = &placing[view]["placed"];
        let off = distance(&item["geometry"]["at_mm"], &placing[view]["picked"]);
        assert!(off < 0.1, "{view}: {off} mm from the pick");
        assert_eq!(item["placement"]["method"], method);
        assert_eq!(item["placement"]["device"]["kind"], "mouse");
        assert_eq!(item["author"], "Ada Berg");
        assert_eq!(item["placement"]["camera"]["eye_mm"].as_array().unwrap().len(), 3);
    }
    // The mark that is drawn in 3D lies on the pixel that was clicked.
    let [marked, clicked] = ["marked", "clicked"].map(|name| numbers(&placing["volume"][name]));
    let pixels = (marked[0] - clicked[0]).hypot(marked[1] - clicked[1]);
    assert!(pixels < 1.5, "drawn {pixels} pixels from the click");
    // A point moves the cursor, in all views; the value there is the pick's.
    let cursor: Vec<f64> =
        placing["cursor"].as_str().unwrap().split(',').map(|mm| mm.parse().unwrap()).collect();
    assert!(distance(&json!(cursor), &placing["axial"]["placed"]["geometry"]["at_mm"]) < 0.01);
    let [shown, asked] = ["shown", "asked"].map(|name| placing["value"][name].as_f64().unwrap());
    assert!((shown - asked).abs() < 5.0, "{shown} HU, {asked} HU");
    assert_eq!(seen["problems"], json!([]));
}

#[test]
fn a_line_has_its_length_and_escape_leaves_nothing() {
    let Some(seen) = seen("a line on the page") else { return };
    let line = &seen["placing"]["line"];
    let ends = &line["placed"]["item"]["geometry"]["ends_mm"];
    for end in 0..2 {
        let off = distance(&ends[end], &line["picked"][end]);
        assert!(off < 0.1, "end {end}: {off} mm from the pick");
    }
    let length = distance(&ends[0], &ends[1]);
    let measure = &line["placed"]["measures"][0];
    assert_eq!((&measure["name"], &measure["unit"]), (&json!("length"), &json!("mm")));
    assert!((measure["value"].as_f64().unwrap() - length).abs() < 1e-6, "{measure}");
    let row = format!("Line 1, {length:.1} mm");
    assert!(seen["placing"]["rows"].as_array().unwrap().contains(&json!(row)), "{row}: {seen}");
    assert_eq!(seen["placing"]["after_escape"], 3);
}

#[test]
fn changes_are_taken_back_and_made_again() {
    let Some(seen) = seen("undo on the page") else { return };
    assert_eq!(seen["undoing"]["counts"], json!([3, 2, 1, 2, 3]));
    let log: Vec<&str> =
        seen["undoing"]["log"].as_array().unwrap().iter().map(|row| row.as_str().unwrap()).collect();
    assert!(log[0].contains("made again Line 1") && log[3].contains("took back Line 1"), "{log:?}");
}

/// Invariant: The annotation page places what a pick returns, within 0.1 mm; looking around changes
/// nothing; nothing unseen is overwritten.
#[test]
fn a_grabbed_point_follows_in_edit_mode_alone_and_a_locked_one_stays() {
    let Some(seen) = seen("grabbing on the page") else { return };
    let editing = &seen["editing"];
    assert!(distance(&editing["not_in_look"], &editing["before"]) < 1e-9, "looking moved a point");
    let per_pixel = editing["per_pixel"].as_f64().unwrap();
    let [before, after] = ["before", "after"].map(|name| numbers(&editing[name]));
    let moved: Vec<f64> = before.iter().zip(&after).map(|(a, b)| b - a).collect();
    // 40 pixels to the patient's left, 20 upwards, which is forwards; at most a pixel off.
    for (mm, pixels) in moved.iter().zip([40.0, -20.0, 0.0]) {
        assert!((mm - pixels * per_pixel).abs() < 1.01 * per_pixel, "{moved:?} mm, {per_pixel} mm a pixel");
    }
    assert_eq!(editing["locked"]["locked"], true);
    assert!(distance(&editing["locked"]["geometry"]["at_mm"], &editing["before"]) < 1e-9);
    assert!(editing["said"].as_str().unwrap().contains("is locked"), "{editing}");
}

#[test]
fn the_keyboard_places_at_the_cursor_and_a_snap_tells_its_shift() {
    let Some(seen) = seen("the keyboard on the page") else { return };
    let keyboard = &seen["keyboard"];
    // Two voxels to the right of an axial picture, one up and one slice towards the head; voxels
    // are 1.875 mm wide, and slices 2.4 mm apart.
    let [before, cursor] = ["before", "cursor"].map(|name| numbers(&keyboard[name]));
    for ((from, to), steps) in before.iter().zip(&cursor).zip([2.0 * 1.875, -1.875, 2.4]) {
        assert!((to - from - steps).abs() < 0.01, "{keyboard}");
    }
    assert!(distance(&keyboard["placed"]["geometry"]["at_mm"], &keyboard["cursor"]) < 1e-3, "{keyboard}");
    assert_eq!(keyboard["placed"]["placement"]["device"]["kind"], "keyboard");
    assert_eq!(keyboard["focus"], "axial");
    assert_eq!(keyboard["left"], 3);
    let shift = numbers(&keyboard["snapped"]["placement"]["snapped_mm"]);
    let mm = shift.iter().map(|part| part * part).sum::<f64>().sqrt();
    assert!(mm > 0.01 && mm <= 5.0, "{mm} mm");
    assert!(keyboard["said"].as_str().unwrap().contains(&format!("snapped by {mm:.2} mm")), "{keyboard}");
}

#[test]
fn a_template_is_gone_through_with_one_skipped_and_come_back_to() {
    let Some(seen) = seen("a template on the page") else { return };
    let template = &seen["template"];
    let at = |name: &str| {
        let at = &template[name];
        ["placed", "skipped", "total", "expected"].map(|key| at[key].as_str().unwrap().to_owned())
    };
    assert_eq!(at("begin"), ["0", "0", "3", "Nasion"]);
    assert_eq!(at("skipped"), ["1", "1", "3", "Vertex"]);
    assert_eq!(at("decided"), ["2", "1", "3", ""]);
    assert_eq!(at("complete"), ["3", "0", "3", ""]);
    assert_eq!(template["states"], json!(["defined", "defined", "defined"]));
}

/// Invariant: The annotation page places what a pick returns, within 0.1 mm; looking around changes
/// nothing; nothing unseen is overwritten.
#[test]
fn two_people_never_overwrite_each_other_unseen() {
    let Some(seen) = seen("a conflict on the page") else { return };
    let conflict = &seen["conflict"];
    let shown = conflict["shown"].as_str().unwrap();
    assert!(shown.contains("Bizygomatic") && shown.contains("Orbit width"), "{shown}");
    assert_eq!(conflict["before_decision"], json!(["Bizygomatic"]));
    assert_eq!(
        conflict["other"].as_array().unwrap().len(),
        1,
        "the other page follows by itself: {conflict}"
    );
    assert_eq!(conflict["live"], "live", "pushed by the server, not polled");
    assert_eq!(conflict["problems"], json!([]));
}

#[test]
fn markups_go_out_and_come_back_and_bad_ones_change_nothing() {
    let Some(seen) = seen("files on the page") else { return };
    let files = &seen["files"];
    assert!(files["name"].as_str().unwrap().ends_with(".mrk.json"), "{files}");
    assert_eq!(files["dialogs"], json!([false, 1]), "a second click opens no second dialog");
    assert!(!files["file"]["markups"].as_array().unwrap().is_empty());
    let points = files["points"].as_array().unwrap();
    assert_eq!(points.len(), 2, "{files}");
    for pair in points {
        let off = distance(&pair[0]["at_mm"], &pair[1]["at_mm"]);
        assert!(off < 1e-3, "{off} mm after a round trip");
    }
    let updated = &files["updated"];
    let places: Vec<_> = updated["places"].as_array().unwrap().iter().map(numbers).collect();
    assert_eq!(places[1], places[0], "skipped: {updated}");
    assert!((places[2][2] - places[0][2] - 3.0).abs() < 1e-3, "updated: {updated}");
    assert_eq!(updated["items"][0], updated["items"][1]);
    let bad = &files["bad"];
    assert_eq!(bad["items"][0], bad["items"][1]);
    assert!(bad["said"].as_str().unwrap().contains("bad.mrk.json"), "{bad}");
}

#[test]
fn growing_reports_its_volume_in_advance_and_detects_leaks() {
    let Some(seen) = seen("growing on the page") else { return };
    let growing = &seen["growing"];
    let region = &growing["region"]["item"]["geometry"];
    assert_eq!(region["kind"], "region");
    let ml = region["volume_ml"].as_f64().unwrap();
    assert!(ml > 10.0, "{region}");
    let preview = growing["preview"].as_str().unwrap();
    let said: f64 = preview.split(' ').next().unwrap().parse().unwrap();
    assert!((said - ml).abs() < 0.1, "{preview}, made: {ml} ml");
    for pane in ["volume", "sagittal"] {
        let [all, narrower] = [&growing["extent"][pane], &growing["narrower"][1][pane]].map(number);
        assert!(0.0 < narrower && narrower < all, "the extent is drawn before it is made, {pane}: {growing}");
    }
    assert_eq!(growing["mesh"]["item"]["geometry"]["kind"], "mesh");
    for (pane, pixels) in growing["drawn"].as_object().unwrap() {
        assert!(pixels.as_u64().unwrap() > 100, "{pane}: {pixels} pixels of region and mesh");
    }
    assert!(growing["leak"].as_str().unwrap().contains("leak"), "{growing}");
}

#[test]
fn without_annotations_the_page_shows_the_volume_and_says_how_to_have_them() {
    let Some(seen) = seen("the page without annotations") else { return };
    let without = &seen["without"];
    assert!(without["said"].as_str().unwrap().contains("--annotations"), "{without}");
    assert!(without["cursor"].as_str().unwrap().split(',').count() == 3, "{without}");
}
