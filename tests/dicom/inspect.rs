//! `relief inspect` as programs use it: JSON, exit status, messages.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use crate::common;
use crate::dicom::made;

use std::path::Path;
use std::process::{Command, Output};

use common::{facts, numbers, shared_data, unpacked};
use serde_json::Value;

fn inspect(path: &Path, options: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_relief")).arg("inspect").arg(path).args(options).output().unwrap()
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {output:?}"))
}

#[test]
fn json_has_the_geometry_and_the_hash_of_the_facts() {
    let name = "catphan504-cbct";
    let Some(folder) = unpacked("relief inspect --json", name, &[]) else { return };
    let facts =
        facts(&shared_data(name, &[&format!("{name}.facts.json")]).unwrap(), &format!("{name}.facts.json"));
    let output = inspect(&folder, &["--json"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let report = json(&output);
    let series = &report["series"][0];
    assert_eq!(series["uid"], facts["series_instance_uid"][0]);
    assert_eq!(series["modality"], "CT");
    assert_eq!(numbers(&series["dims"]), [512.0, 512.0, 64.0]);
    assert_eq!(series["hu_range"], serde_json::json!([facts["hu"]["min"], facts["hu"]["max"]]));
    assert_eq!(series["stack_sha256"], facts["hu"]["sha256_int16le_zyx"]);
    assert_eq!(series["transfer_syntax"], "1.2.840.10008.1.2");
    assert_eq!(series["warnings"], serde_json::json!([]));
    let simpleitk = &facts["simpleitk"]; // direction is written alike: columns are the axes, row by row
    for (key, expected) in [
        ("origin_mm", &simpleitk["origin"]),
        ("spacing_mm", &simpleitk["spacing"]),
        ("direction", &simpleitk["direction"]),
    ] {
        let near = |(a, b): (&f64, &f64)| (a - b).abs() < 1e-3;
        assert!(numbers(&series[key]).iter().zip(&numbers(expected)).all(near), "{key}: {series}");
    }
    let skipped = report["skipped"].as_array().unwrap(); // the structure set beside the slices
    assert_eq!(skipped.len(), 1);
    assert!(skipped[0]["reason"].as_str().unwrap().contains("RTSTRUCT"), "{skipped:?}");
}

#[test]
fn warnings_have_codes_and_messages() {
    let Some(folder) = unpacked("warnings of relief inspect", "head-ge-varspacing-tilt", &[]) else { return };
    let report = json(&inspect(&folder, &["--json"]));
    let warnings = report["series"][0]["warnings"].as_array().unwrap();
    let codes: Vec<&str> = warnings.iter().map(|warning| warning["code"].as_str().unwrap()).collect();
    assert_eq!(codes, ["mixed-slices", "mixed-slices", "gantry-tilt", "uneven-spacing"]);
    let table = String::from_utf8(inspect(&folder, &[]).stdout).unwrap();
    for warning in warnings {
        assert!(table.contains(warning["message"].as_str().unwrap()), "{table}");
    }
}

#[test]
fn no_series_is_a_failure_that_says_why() {
    let Some(data) = shared_data("relief inspect without series", &["quirks/MR_truncated.dcm"]) else {
        return;
    };
    let output = inspect(&data.join("quirks/MR_truncated.dcm"), &["--json"]);
    assert_eq!(output.status.code(), Some(1));
    let report = json(&output);
    assert_eq!(report["series"], serde_json::json!([]));
    assert!(report["skipped"][0]["reason"].as_str().unwrap().starts_with("not CT: MR"), "{report}");
    assert_eq!(inspect(Path::new("no/such/path"), &[]).status.code(), Some(1));
}

#[test]
fn several_series_are_listed_with_the_option_that_chooses() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("native.dcm"), made::slice_at(9.0, 1)).unwrap();
    std::fs::write(folder.path().join("other.dcm"), made::compressed(1, [64, 128], vec![0; 64])).unwrap();
    let out = folder.path().join("picture.png");
    let render = Command::new(env!("CARGO_BIN_EXE_relief"))
        .args(["render", "--series"])
        .arg(folder.path())
        .arg("--out")
        .arg(&out)
        .output()
        .unwrap();
    let reported = String::from_utf8(render.stderr).unwrap();
    assert_eq!((render.status.code(), out.exists()), (Some(1), false), "{reported}");
    assert!(
        reported.starts_with("relief: choose a series with --series-uid UID\n  because: 2 series found"),
        "{reported}"
    );
    assert!(reported.contains("128 x 128 x 1") && reported.contains("128 x 64 x 1"), "{reported}");
}
