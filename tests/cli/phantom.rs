//! `relief phantom` from outside: its files, the files it preserves, and other programs that read
//! them.

use std::path::Path;
use std::process::Command;

use relief_volume::{Phantom, PhantomTruth};

fn relief(arguments: &[&str], out: &Path) -> std::process::Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
    command
        .args(["phantom", "--out"])
        .arg(out)
        .args(arguments)
        .output()
        .expect("the program was built for tests")
}

#[test]
fn the_command_writes_a_series_with_its_truth_and_keeps_what_is_there() {
    let parent = tempfile::tempdir().unwrap();
    let out = parent.path().join("axes");
    let made = relief(&["--kind", "axes", "--size", "24", "--json"], &out);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let report: serde_json::Value = serde_json::from_slice(&made.stdout).unwrap();
    let truth: PhantomTruth =
        serde_json::from_slice(&std::fs::read(out.join("truth.json")).unwrap()).unwrap();
    assert_eq!(truth, Phantom::axes(24).unwrap().truth);
    assert_eq!(report["stack_sha256"], truth.stack_sha256.as_str());
    assert_eq!((&report["slices"], std::fs::read_dir(&out).unwrap().count()), (&24.into(), 25));

    let again = relief(&["--kind", "ramp", "--size", "16"], &out);
    assert_eq!(again.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&again.stderr).contains("--force"));
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), 25, "the refused run changed nothing");

    assert!(relief(&["--kind", "ramp", "--size", "16", "--force"], &out).status.success());
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), 17);
    assert_eq!(std::fs::read_dir(parent.path()).unwrap().count(), 1, "no temporary folder is left");
    for wrong in [["--kind", "torso"], ["--size", "8"], ["--size", "2000"]] {
        assert_eq!(relief(&wrong, &parent.path().join("none")).status.code(), Some(2), "{wrong:?}");
    }
}

#[test]
fn a_head_comes_with_its_organs_and_landmarks_and_can_be_replaced() {
    let parent = tempfile::tempdir().unwrap();
    let out = parent.path().join("head");
    assert!(relief(&["--size", "32"], &out).status.success());
    let truth: PhantomTruth =
        serde_json::from_slice(&std::fs::read(out.join("truth.json")).unwrap()).unwrap();
    let database = parent.path().join("head.db");
    let annotate = |arguments: &[&std::ffi::OsStr]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
        // A user without a name in the system has to give one.
        command.env("RELIEF_AUTHOR", "tester").args(["annotate", "--db"]).arg(&database);
        let output = command.args(arguments).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()
    };
    let table = out.join("landmarks.csv");
    let [import, series, list, json] = ["import", "--series", "list", "--json"].map(std::ffi::OsStr::new);
    annotate(&[import, table.as_os_str(), series, out.as_os_str(), json]);
    let listed = annotate(&[list, json]);
    let mut found: Vec<(&str, [f64; 3])> = listed["items"]
        .as_array()
        .unwrap()
        .iter()
        .map(|item| {
            let at = &item["item"]["geometry"]["at_mm"];
            (item["item"]["name"].as_str().unwrap(), [0, 1, 2].map(|axis| at[axis].as_f64().unwrap()))
        })
        .collect();
    let mut expected: Vec<(&str, [f64; 3])> =
        truth.landmarks.iter().map(|landmark| (&*landmark.name, landmark.position_mm)).collect();
    assert_eq!(expected.len(), 20);
    found.sort_by_key(|(name, _)| *name);
    expected.sort_by_key(|(name, _)| *name);
    assert_eq!(found, expected);

    assert!(relief(&["--size", "24", "--force"], &out).status.success(), "its own files are replaced");
    std::fs::write(out.join("notes.csv"), "kept").unwrap();
    let refused = relief(&["--size", "24", "--force"], &out);
    assert!(String::from_utf8_lossy(&refused.stderr).contains("notes.csv"));
}
