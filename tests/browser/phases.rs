//! The phases of a series on pages: a slider, and playing them; cut faces; the name on pictures.

use serde_json::{Value, json};

use super::{driven, skipped};

/// Invariant: Pages play the phases of a series from where the view is, and name the phase that they
/// show.
#[test]
fn pages_play_phases_and_name_them() {
    let Some(seen) = driven("phases.py", "64", false) else { return skipped("phases on pages") };
    let names: Vec<&str> = seen["volumes"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
    for (number, name) in (1..).zip(&names) {
        assert!(name.ends_with(&format!(", phase {number} of 3")), "{names:?}");
    }
    let page = &seen["page"];
    assert_eq!(page["visible"], true);
    assert!(page["first"].as_str().unwrap().contains("phase 1 of 3"), "{page}");
    assert_eq!(page["slider"], json!(["2 of 3", true]));
    assert_eq!(page["playing"], json!([["1 of 3", "2 of 3", "3 of 3"], "Stop"]));
    assert_eq!(page["stopped"], json!(["Play", true]));
    assert_eq!(page["asked"], json!({ "cut": "slice", "overlay": "caption" }));
    assert_eq!(page["reloaded"], json!(["slice", true]));
    assert_eq!(page["mip"], json!([null, false]), "a projection has no cut faces");
    let kiosk = &seen["kiosk"];
    assert!(kiosk["title"].as_str().unwrap().contains("phase 2 of 3"), "{kiosk}");
    assert_eq!(kiosk["playing"].as_array().unwrap().len(), 3, "{kiosk}");
    assert_eq!(kiosk["stopped"], true);
    for found in [page, kiosk] {
        assert_eq!(found["problems"], json!([]));
    }
}
