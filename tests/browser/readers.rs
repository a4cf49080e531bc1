//! Several readers of the page for annotations: the results of `browser/readers.py` and their
//! expectations.

use std::sync::OnceLock;

use serde_json::{Value, json};

use super::annotate::distance;
use super::{driven, skipped};

/// The results of the browser, once for all tests; `None` with a message if there is no browser.
fn seen(what: &str) -> Option<&'static Value> {
    static SEEN: OnceLock<Option<Value>> = OnceLock::new();
    let seen = SEEN.get_or_init(|| driven("readers.py", "96", false));
    if seen.is_none() {
        skipped(what);
    }
    seen.as_ref()
}

/// Invariant: On the page, a blinded reader receives nothing of other readers, two windows follow
/// each other, and an invalid file changes nothing.
#[test]
fn two_windows_see_each_others_edits_at_once() {
    let Some(seen) = seen("two windows") else { return };
    let tabs = &seen["tabs"];
    assert_eq!(tabs["problems"], json!([]));
    // Pushed by the server: a page polls after two seconds without a session, and after twenty with
    // one.
    assert!(tabs["seconds"].as_f64().unwrap() < 1.5, "{tabs}");
    assert_eq!(tabs["placed"], json!({ "rows": ["Point 1"], "marks": 1 }));
    assert_eq!(tabs["renamed"]["rows"], json!(["Sella"]));
    assert!(tabs["not_undone"].as_str().unwrap().contains("another user has changed"), "{tabs}");
    assert_eq!(tabs["gone"], json!({ "rows": [], "marks": 0 }));
}

/// Invariant: On the page, a blinded reader receives nothing of other readers, two windows follow
/// each other, and an invalid file changes nothing.
#[test]
fn a_blinded_reader_sees_no_other_ones_items() {
    let Some(seen) = seen("blinded readers") else { return };
    let blinded = &seen["blinded"];
    for (name, other, author) in [("cara", "dan", "Dan Moe"), ("dan", "cara", "Cara Lind")] {
        let found = &blinded[name];
        assert_eq!(found["problems"], json!([]), "{name}");
        assert_eq!(found["rows"].as_array().unwrap().len(), 1, "{name}: {found}");
        assert_eq!(found["asked"], json!([name]), "nothing of another set comes over the line");
        let sets = found["sets"].to_string();
        assert!(sets.contains(&format!("{name} (blinded)")) && !sets.contains(other), "{name}: {sets}");
        let log = found["log"].as_str().unwrap();
        assert!(log.contains("events") && !log.contains(author), "{name}: {log}");
    }
    assert_eq!(blinded["anybody"], json!(["Tragus"]), "and others see neither");
}

/// Invariant: On the page, a blinded reader receives nothing of other readers, two windows follow
/// each other, and an invalid file changes nothing.
#[test]
fn a_dropped_file_is_taken_whole_and_a_bad_one_changes_nothing() {
    let Some(seen) = seen("dropped files") else { return };
    let dropping = &seen["dropping"];
    assert_eq!(dropping["problems"], json!([]));
    assert_eq!(dropping["over"], true, "the page says where to drop");
    // RAS in the file, LPS here.
    let off = distance(&dropping["taken"]["geometry"]["at_mm"], &json!([-12.5, 3.25, 20.75]));
    assert!(off < 1e-6, "{dropping}");
    assert_eq!(
        (&dropping["taken"]["list"], &dropping["taken"]["author"]),
        (&json!("ears"), &json!("Fay Wynn"))
    );
    let cursor: Vec<f64> =
        dropping["cursor"].as_str().unwrap().split(',').map(|mm| mm.parse().unwrap()).collect();
    assert!(
        distance(&json!(cursor), &dropping["taken"]["geometry"]["at_mm"]) < 0.01,
        "the cursor goes there"
    );
    assert!(dropping["said"].as_str().unwrap().contains("ears.mrk.json: 1 item"), "{dropping}");
    let bad = dropping["bad"].as_object().unwrap();
    assert_eq!(bad.len(), 4);
    for (name, said) in bad {
        let said = said.as_str().unwrap();
        assert!(said.starts_with(&format!("{name}: ")) && said.len() > name.len() + 15, "{said}");
        assert!(said.contains("Nothing was changed"), "{said}");
    }
    assert_eq!((&dropping["changed"], &dropping["rows"]), (&json!(0), &json!(["Tragus"])));
}
