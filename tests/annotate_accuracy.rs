//! `relief annotate accuracy` as users run it: the bar of 1 mm, and the files that it writes.

mod common;

use std::process::Command;

use serde_json::Value;

#[test]
fn landmarks_are_placed_within_a_millimetre_where_the_lever_is_long_and_snapped() {
    if common::software_adapter("the accuracy of placing").is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let arguments = ["annotate", "accuracy", "--seed", "1", "--repeats", "3", "--json", "--out", out];
    let done = Command::new(env!("CARGO_BIN_EXE_relief")).args(arguments).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let report: Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(report["landmarks"], 20);
    let ways = report["ways"].as_array().unwrap();
    let median = |way: &str, lever: f64, snap: &str| {
        let found =
            ways.iter().find(|one| one["way"] == way && one["lever_mm"] == lever && one["snap"] == snap);
        let found = found.unwrap();
        assert!(
            found["errors_mm"].as_array().unwrap().len() >= 54,
            "rays that meet nothing are few: {found}"
        );
        found["median_mm"].as_f64().unwrap()
    };
    for way in ["ray", "tip"] {
        let (raw, snapped) = (median(way, 1200.0, "none"), median(way, 1200.0, "surface"));
        println!("{way}: {raw:.2} mm, snapped {snapped:.2} mm");
        assert!(snapped < 1.0, "{way}: {snapped} mm");
        assert!(median(way, 150.0, "surface") > snapped, "a short lever is no steadier");
    }
    for file in ["accuracy.svg", "accuracy.png"] {
        assert!(folder.path().join(file).metadata().unwrap().len() > 5000, "{file}");
    }
}
