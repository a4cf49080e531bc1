//! Labels of segmentations in every character set, and label maps of Supplement 243.

use std::path::Path;
use std::process::Command;

use relief_dicom::{LoadLimits, load_segmentation};
use serde_json::Value;

/// Truth: pydicom, which reads back what it wrote; sets that it does not have are encoded by Python's codecs.
/// Invariant: Text of DICOM objects is what its character sets say.
#[test]
fn labels_in_every_character_set_are_those_that_pydicom_reads() {
    let Some(python) = std::env::var_os("RELIEF_PEERS_PYTHON") else {
        eprintln!("SKIPPED: labels in every character set (RELIEF_PEERS_PYTHON is not set)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/label_files/characters.py");
    let mut command = Command::new(python);
    command.args(["-W", "ignore"]).arg(script).arg(folder.path());
    let output = command.env("PYTHONDONTWRITEBYTECODE", "1").output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let written: Vec<Value> = serde_json::from_slice(&output.stdout).unwrap();
    assert!(written.len() > 30, "{} files", written.len());
    for file in &written {
        let found = load_segmentation(LoadLimits::default(), Path::new(file["path"].as_str().unwrap()));
        let map = found.unwrap_or_else(|error| panic!("{}: {error}", file["name"])).map;
        let names: Vec<&str> = map.segments().iter().filter_map(|segment| segment.name.as_deref()).collect();
        let expected: Vec<&str> =
            file["labels"].as_array().unwrap().iter().map(|name| name.as_str().unwrap()).collect();
        assert_eq!(names, expected, "{}", file["name"]);
        // Two slices of 2 x 6 voxels for each.
        assert_eq!(map.labelled_voxels(), 2 * 2 * 6 * 2, "{}", file["name"]);
    }
}
