//! `relief inspect` as programs use it: JSON, exit status, messages.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use crate::common;
use crate::dicom::made;

use std::path::Path;
use std::process::{Command, Output};

use common::{facts, numbers, shared_data, unpacked};
use dicom_core::VR;
use dicom_dictionary_std::tags;
use made::slice_with;
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

/// Invariant: A volume of another format is described like a series.
#[test]
fn a_volume_of_nifti_is_described_like_a_series() {
    let folder = tempfile::tempdir().unwrap();
    let volume = folder.path().join("ct.nii.gz");
    // 3 x 2 x 2 voxels of 0.5 x 1 x 2 mm; NIfTI's axes point to the patient's right and front.
    let mut header = [0u8; 352];
    header[..4].copy_from_slice(&348i32.to_le_bytes());
    let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
    for (index, side) in [3i16, 3, 2, 2, 1, 1, 1, 1].into_iter().enumerate() {
        put(40 + 2 * index, &side.to_le_bytes());
    }
    put(70, &4i16.to_le_bytes());
    put(72, &16i16.to_le_bytes());
    put(108, &352f32.to_le_bytes());
    put(254, &1i16.to_le_bytes());
    put(344, b"n+1\0");
    let rows = [[0.5f32, 0.0, 0.0, 10.0], [0.0, 1.0, 0.0, 20.0], [0.0, 0.0, 2.0, 30.0]];
    for (index, value) in rows.as_flattened().iter().enumerate() {
        put(280 + 4 * index, &value.to_le_bytes());
    }
    let voxels: Vec<u8> = (-5i16..7).flat_map(i16::to_le_bytes).collect();
    let write = |header: &[u8]| {
        let file = std::fs::File::create(&volume).unwrap();
        let mut packed = flate2::write::GzEncoder::new(file, flate2::Compression::fast());
        std::io::Write::write_all(&mut packed, &[header, &voxels].concat()).unwrap();
        packed.finish().unwrap();
    };
    write(&header);
    let report = json(&inspect(&volume, &["--json"]));
    let series = &report["series"][0];
    assert_eq!(numbers(&series["dims"]), [3.0, 2.0, 2.0], "{report}");
    assert_eq!(numbers(&series["spacing_mm"]), [0.5, 1.0, 2.0]);
    assert_eq!(numbers(&series["origin_mm"]), [-10.0, -20.0, 30.0]);
    assert_eq!(series["hu_range"], serde_json::json!([-5, 6]));
    let table = String::from_utf8(inspect(&volume, &[]).stdout).unwrap();
    assert!(table.contains("voxels          3 x 2 x 2"), "{table}");
    // An s-form of zeros names itself.
    header[280..328].fill(0);
    write(&header);
    let refused = inspect(&volume, &[]);
    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(!refused.status.success() && said.contains("srow_x, srow_y, srow_z"), "{said}");
}

#[test]
fn inspect_names_the_unit_of_other_values() {
    let folder = tempfile::tempdir().unwrap();
    for k in 0..4 {
        let texts = [(tags::RESCALE_TYPE, VR::LO, "MGML")];
        std::fs::write(folder.path().join(k.to_string()), slice_with(k as f64, k, &texts)).unwrap();
    }
    let report = json(&inspect(folder.path(), &["--json"]));
    assert_eq!(report["series"][0]["value_type"], "MGML", "{report}");
    let table = String::from_utf8(inspect(folder.path(), &[]).stdout).unwrap();
    assert!(table.contains("of RescaleType MGML, not HU"), "{table}");
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
