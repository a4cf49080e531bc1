//! A series whose values are not HU, on the pages.

use serde_json::{Value, json};

use super::{driven, skipped};

/// Invariant: Volumes of other quantities than HU get no HU preset and no HU window by default.
#[test]
fn pages_name_the_unit_and_choose_no_preset() {
    let Some(seen) = driven("quantities.py", "48", false) else { return skipped("other values on pages") };
    let page = &seen["page"];
    assert_eq!((&page["first"][0], &page["first"][1]), (&json!(0), &Value::Null), "{page}");
    assert!(page["first"][2].as_str().unwrap().contains("MGML"), "{page}");
    assert_eq!((&page["chosen"][0], &page["chosen"]), (&json!(1), &page["reloaded"]), "{page}");
    assert_ne!(page["chosen"][1], Value::Null, "a preset can be chosen");
    assert_eq!(seen["annotate"]["preset"], "");
    for found in [page, &seen["annotate"]] {
        assert!(found["facts"].as_str().unwrap().ends_with(" MGML"), "{found}");
        let units = found["units"].as_array().unwrap();
        assert!(!units.is_empty() && units.iter().all(|unit| unit == "MGML"), "{found}");
        assert_eq!(found["problems"], json!([]));
    }
}
