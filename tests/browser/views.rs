//! The page of the volume, and all pages on large and small screens: the results of
//! `browser/views.py` and their expectations.

use std::sync::OnceLock;

use serde_json::{Value, json};

use super::{driven, number, numbers, skipped, triple};

/// The results of the browser, once for all tests; `None` with a message if there is no browser.
fn seen(what: &str) -> Option<&'static Value> {
    static SEEN: OnceLock<Option<Value>> = OnceLock::new();
    let seen = SEEN.get_or_init(|| driven("views.py", "96", false));
    if seen.is_none() {
        skipped(what);
    }
    seen.as_ref()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn choices_are_kept_in_the_address() {
    let Some(seen) = seen("the address of the page") else { return };
    let address = &seen["address"];
    assert_eq!(address["problems"], json!([]));
    let kept = &address["kept"];
    for (key, value) in
        [("preview", "anaglyph"), ("factor", "100"), ("overlay", "cube"), ("preset", "skin"), ("az", "35.0")]
    {
        assert_eq!(kept[key], value, "{kept}");
    }
    assert_eq!(
        address["again"],
        json!({ "preview": "anaglyph", "factor": "100", "cube": true, "preset": "skin" })
    );
    assert_eq!(address["off"], Value::Null);
}

#[test]
fn the_difference_from_true_views_is_that_of_the_pictures_and_of_files() {
    let Some(seen) = seen("the difference from true views on the page") else { return };
    let difference = &seen["difference"];
    assert_eq!(difference["problems"], json!([]));
    let psnr = numbers(&difference["psnr"]);
    assert!(psnr.len() >= 8 && psnr.iter().all(|db| (20.0..60.0).contains(db)), "{psnr:?}");
    let mean = psnr.iter().sum::<f64>() / psnr.len() as f64;
    let worst = psnr.iter().copied().fold(f64::INFINITY, f64::min);
    let words = format!("{mean:.1} dB from true views, the worst one {worst:.1} dB.");
    assert_eq!(difference["words"], words);
    let [shown, expected] = ["map", "expected_map"].map(|name| number(&difference[name]));
    assert!(expected > 0.2 && (shown - expected).abs() < 0.3, "{shown}, expected {expected}");
    assert!(number(&difference["from_file"]) <= 1.0, "relief render --views true differs: {difference}");
}

#[test]
fn mouse_fingers_and_keys_move_the_picture_and_typing_is_no_command() {
    let Some(seen) = seen("hands on the page") else { return };
    let hands = &seen["hands"];
    assert_eq!(hands["problems"], json!([]));
    // 50 pixels to the right: so much of the height that is seen where the camera looks.
    let (asked, radius) = (&hands["moved"]["asked"], number(&hands["radius_mm"]));
    let [width, height] = [0, 1].map(|side| number(&hands["stage"][side]));
    let seen_mm = 2.0 * radius / 11f64.to_radians().cos() / (width / height).min(1.0);
    let moved = distance(&triple(&asked["look_at_mm"]), &numbers(&hands["center_mm"]));
    assert!((moved - 50.0 / height * seen_mm).abs() < 0.5, "{moved} mm of {seen_mm} mm");
    assert!(hands["moved"]["kept"]["shift"].is_string(), "{hands}");
    assert_eq!(hands["home"].get("shift"), None);
    let by_key = triple(&hands["by_key"]["shift"]);
    assert!((distance(&by_key, &[0.0; 3]) - 0.05 * seen_mm).abs() < 0.2, "{by_key:?}");
    assert_eq!((&hands["pinched"]["zoom"], &hands["pinched"]["preset"]), (&json!("2.00"), &json!("bone")));
    let typed = &hands["typed"];
    assert_eq!(
        (&typed["window"], &typed["preset"], &typed["plane"]),
        (&json!("55,80"), &json!("bone"), &json!("axial"))
    );
}

#[test]
fn the_volume_is_cropped_measured_and_played() {
    let Some(seen) = seen("crop, distances, cine and search of the page") else { return };
    let tools = &seen["tools"];
    assert_eq!(tools["problems"], json!([]), "{tools}");
    let (low, high) = (numbers(&tools["bounds"][0]), numbers(&tools["bounds"][1]));
    let (dragged, pressed) = (triple(&tools["dragged"]), triple(&tools["pressed"]));
    // The side follows the pointer, and the other five stay.
    assert!(dragged[5] < high[2] - 5.0 && (number(&tools["moved"]) - 60.0).abs() < 1.5, "{tools}");
    assert!(dragged[..3].iter().zip(&low).all(|(mm, end)| (mm - end).abs() < 0.06), "{tools}");
    assert!((pressed[3] - (dragged[3] - 2.0)).abs() < 0.11, "an arrow key is 2 mm: {tools}");
    assert_eq!((&tools["table"], &tools["whole"]), (&json!("keep"), &Value::Null));
    let places: Vec<Vec<f64>> = tools["places"].as_array().unwrap().iter().map(lps).collect();
    let words = tools["places"][1].as_str().unwrap();
    let mm = words.split("Distance").nth(1).unwrap().trim().split(' ').next().unwrap();
    assert!((mm.parse::<f64>().unwrap() - distance(&places[0], &places[1])).abs() < 0.06, "{words}");
    // The cut through the centre of the tissue faces the front, so that the pick lies on it or behind.
    let [plane, moved] = ["plane", "plane_moved"].map(|key| {
        numbers(&json!(
            tools[key]
                .as_str()
                .unwrap()
                .split(',')
                .map(|part| part.parse::<f64>().unwrap())
                .collect::<Vec<_>>()
        ))
    });
    assert_eq!(plane, [0.0, -1.0, 0.0, 0.0], "{tools}");
    assert_eq!(moved, [0.0, -1.0, 0.0, 0.5], "an arrow key is 0.5 mm: {tools}");
    assert!(lps(&tools["behind"])[1] > places[0][1] + 20.0, "{tools}");
    assert_eq!(tools["no_plane"], Value::Null);
    assert!(number(&tools["removable"]) < 0.0, "the button lies inside the panel: {tools}");
    assert!(tools["preset"].as_str().unwrap().contains("vessels") && tools["none"] == true, "{tools}");
    assert_eq!((&tools["playing"], &tools["stopped"]), (&json!("true"), &json!("false")));
}

#[test]
fn volumes_are_chosen_by_their_pictures() {
    let Some(seen) = seen("menus of volumes") else { return };
    let menus = &seen["menus"];
    assert_eq!(menus["problems"], json!([]), "{menus}");
    assert_eq!(menus["names"].as_array().unwrap().len(), 2, "{menus}");
    assert!(menus["names"].to_string().contains(" × "), "{menus}");
    assert_ne!(menus["first"], menus["second"], "{menus}");
    assert_eq!((&menus["closed"], &menus["axe"]["violations"]), (&json!(true), &json!([])), "{menus}");
}

/// The position in the words of a pick.
fn lps(words: &Value) -> Vec<f64> {
    let line = words.as_str().unwrap().split("LPS").nth(1).unwrap().lines().next().unwrap();
    line.split(',').map(|mm| mm.trim().parse().unwrap()).collect()
}

/// Invariant: Every control of the pages has a name and stays inside the window, on desktop and
/// phone screens, and axe-core finds no violation.
#[test]
fn every_control_has_a_name_and_nothing_reaches_out_of_the_window() {
    let Some(seen) = seen("all pages on two screens") else { return };
    let looks = seen["looks"].as_object().unwrap();
    assert_eq!(looks.len(), 8);
    for (page, found) in looks {
        assert_eq!(found["problems"], json!([]), "{page}");
        assert!(found["controls"].as_u64().unwrap() >= 4, "{page}: {found}");
        assert_eq!(found["without"], json!([]), "{page}: controls without a name");
        assert_eq!(found["outside"], json!([]), "{page}: controls beyond the window");
        assert_eq!(found["axe"]["violations"], json!([]), "{page}");
        assert!(found["axe"]["passes"].as_u64().unwrap() >= 10, "{page}: axe-core checked nothing");
        let [has, room] = [0, 1].map(|i| number(&found["wide"][i]));
        assert!(has <= room, "{page}: {has} pixels wide, the window {room}");
        if let Some(help) = found.get("help") {
            let help = numbers(help);
            assert!(help[0] >= 0.0 && help[1] <= room && help[2] >= 0.0, "{page}: help at {help:?}");
        }
    }
}

#[test]
fn a_server_without_a_series_says_what_to_do() {
    let Some(seen) = seen("the page without a series") else { return };
    let empty = &seen["empty"];
    let said = empty["said"].as_str().unwrap();
    for words in ["No volume is loaded", "relief serve --series", "relief phantom", "Choose a zip"] {
        assert!(said.contains(words), "{said}");
    }
    assert!(empty["refused"].as_str().unwrap().starts_with("notes.zip: "), "{empty}");
    assert_eq!(empty["still"], true);
}
