//! Pages never show another series than that of their link, and survive restarts of the server.

use serde_json::{Value, json};

use super::{driven, skipped};

/// Invariant: A link to a series that is missing shows no other one; a page survives every restart of its server.
#[test]
fn a_missing_series_is_named_and_restarts_block_no_edit() {
    let Some(seen) = driven("safety.py", "64", false) else { return skipped("links and restarts") };
    for page in ["page", "annotate"] {
        let found = &seen[page];
        assert!(found["said"].as_str().unwrap().contains("The series of this link is not here"), "{found}");
        assert_eq!((&found["name"], &found["pictures"]), (&json!(""), &json!([])), "{page}: {found}");
        assert!(found["address"].as_str().unwrap().contains("volume=0123456789abcdef"), "{found}");
        let chosen = &found["chosen"];
        let [name, id] = [0, 1].map(|at: usize| chosen["expected"][at].as_str().unwrap());
        let shown = chosen["name"].as_str().unwrap();
        assert!(shown.contains(name) && shown.contains(&id[..8]), "{chosen}");
        let address = chosen["address"].as_str().unwrap();
        assert!(address.contains(&format!("volume={id}")) && !address.contains("az=77"), "{chosen}");
        assert_eq!(found["problems"], json!([]), "{page}");
    }
    let restarts = &seen["restarts"];
    let kept = restarts["kept"].as_array().unwrap();
    assert_eq!(kept.len() as u64, restarts["restarts"].as_u64().unwrap());
    assert!(kept.iter().all(|is_kept| is_kept == &Value::Bool(true)), "{restarts}");
    assert_eq!((&restarts["wrong"], &restarts["problems"]), (&json!([]), &json!([])), "{restarts}");
}
