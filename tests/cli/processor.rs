//! Pictures without any graphics driver: the processor's ray caster renders most of them, and names
//! the part of a request that it leaves to a graphics adapter.
//!
//! Independent reference: a software adapter's picture of the same request.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]

use std::process::{Command, Output};

use crate::common::software_adapter;

/// A machine without a driver: the loader finds only a file that is missing.
const NO_DRIVER: [(&str, &str); 3] =
    [("VK_DRIVER_FILES", "/nonexistent/icd.json"), ("VK_ADD_DRIVER_FILES", ""), ("VK_ICD_FILENAMES", "")];

fn relief(arguments: &[&str], environment: &[(&str, &str)]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
    command.args(arguments).env_remove("RELIEF_ADAPTER").env_remove("RELIEF_LOG");
    command.envs(environment.iter().copied()).output().unwrap()
}

fn head(folder: &std::path::Path) -> String {
    let series = folder.join("head").to_str().unwrap().to_owned();
    let made = relief(&["phantom", "--kind", "head", "--size", "48", "--out", &series], &[]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    series
}

#[test]
fn a_machine_without_a_driver_renders_and_measures() {
    let folder = tempfile::tempdir().unwrap();
    let series = head(folder.path());
    let out = folder.path().join("bone.png").to_str().unwrap().to_owned();
    let common =
        ["render", "--series", &series, "--preset", "bone", "--size", "160x120", "--layout", "color"];
    let output = relief(&[&common[..], &["--out", &out, "--json"]].concat(), &NO_DRIVER);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let made: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(made["adapter"].as_str().unwrap().starts_with("processor, "), "{made}");
    assert!(made["left_by_processor"].is_null(), "{made}");

    let bench =
        ["bench", "--series", &series, "--preset", "bone", "--size", "64x48", "--frames", "2", "--json"];
    let output = relief(&bench, &NO_DRIVER);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let measured: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(measured["median_ms"].as_f64().unwrap() > 0.0, "{measured}");
    assert!(measured.get("share").is_none(), "there is no driver to have a share of: {measured}");

    if software_adapter("the same picture on a software adapter").is_none() {
        return;
    }
    let by_driver = folder.path().join("driver.png").to_str().unwrap().to_owned();
    let output = relief(&[&common[..], &["--out", &by_driver, "--adapter", "software"]].concat(), &[]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let [own, other] = [&out, &by_driver].map(|path| image::open(path).unwrap().into_rgba8());
    let apart = own.as_raw().iter().zip(other.as_raw()).filter(|(a, b)| a.abs_diff(**b) > 1).count();
    assert!(apart * 500 < own.as_raw().len(), "{apart} of {} bytes differ", own.as_raw().len());
    assert!(own.pixels().any(|pixel| pixel.0 != own.get_pixel(0, 0).0), "nothing is visible");
}

#[test]
fn the_processor_names_modes_that_it_does_not_render() {
    let folder = tempfile::tempdir().unwrap();
    let series = head(folder.path());
    let out = folder.path().join("paths.png").to_str().unwrap().to_owned();
    let scene = folder.path().join("paths.json").to_str().unwrap().to_owned();
    std::fs::write(&scene, r#"{ "mode": "path-traced", "path_trace": { "passes": 2 } }"#).unwrap();
    let render = [
        "render", "--series", &series, "--scene", &scene, "--size", "96x64", "--layout", "color", "--out",
        &out,
    ];
    let refused = relief(&render, &NO_DRIVER);
    let message = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && !std::path::Path::new(&out).exists(), "{message}");
    for part in ["its mode cannot be rendered on the processor alone", "relief doctor"] {
        assert!(message.contains(part), "{message}");
    }
    if software_adapter("a mode that the processor leaves out").is_none() {
        return;
    }
    let output = relief(&[&render[..], &["--adapter", "cpu"]].concat(), &[]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(said.contains("its mode: not rendered by the processor's own ray caster"), "{said}");
}
