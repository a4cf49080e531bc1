//! `relief render --budget-ms`, as users run it.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]

use std::process::{Command, Output};

use serde_json::{Value, json};

fn relief(arguments: &[&str]) -> Output {
    let program = env!("CARGO_BIN_EXE_relief");
    Command::new(program).args(arguments).env("RELIEF_ADAPTER", "cpu").output().unwrap()
}

#[test]
fn a_tiny_budget_casts_fewer_rays_at_the_requested_size_and_a_large_one_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let series = path("head");
    assert!(relief(&["phantom", "--kind", "head", "--size", "64", "--out", &series]).status.success());
    let render = |out: &str, more: &[&str]| -> Value {
        let fixed =
            ["render", "--series", &series, "--preset", "skin", "--layout", "color", "--size", "1920x1080"];
        let output = relief(&[&fixed[..], &["--json", "--out", out], more].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let [whole, roomy, tiny] = ["whole.png", "roomy.png", "tiny.png"].map(&path);
    assert!(render(&whole, &[]).get("rays_px").is_none());
    let report = render(&roomy, &["--budget-ms", "60000"]);
    assert_eq!((&report["rays_px"], &report["budget_ms"]), (&json!([1920, 1080]), &json!(60000.0)));
    assert_eq!(std::fs::read(&roomy).unwrap(), std::fs::read(&whole).unwrap());
    let report = render(&tiny, &["--budget-ms", "1"]);
    // No machine casts two million rays through two hundred samples in a millisecond of software.
    let rays = report["rays_px"].as_array().unwrap();
    assert!(rays[0].as_u64().unwrap() < 1920 && rays[1].as_u64().unwrap() < 1080, "{report}");
    assert_eq!(report["size_px"], json!([1920, 1080]));
    let size = image::image_dimensions(&tiny).unwrap();
    assert_eq!(size, (1920, 1080));
    let refused = relief(&["render", "--series", &series, "--out", &tiny, "--budget-ms", "0"]);
    let message = String::from_utf8(refused.stderr).unwrap();
    assert!(message.contains("budget_ms is 0, allowed: 1 to 60000 ms"), "{message}");
}
