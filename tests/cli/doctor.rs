//! `relief doctor` as users run it: with a driver, without one, and with one that cannot be found.
//!
//! Independent references: the driver's description file, the renderer's other subcommands, and the
//! exit status.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test may panic and talk, in its helpers too")]

use std::process::{Command, Output};

use serde_json::Value;

fn doctor(arguments: &[&str], environment: &[(&str, &str)]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
    command.arg("doctor").args(arguments).env_remove("RELIEF_ADAPTER").env_remove("RELIEF_LOG");
    command.envs(environment.iter().copied()).output().expect("the program runs")
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).expect("one JSON object")
}

/// The finding about something.
fn finding<'a>(report: &'a Value, what: &str) -> &'a Value {
    let findings = report["findings"].as_array().expect("a list");
    findings
        .iter()
        .find(|finding| finding["what"] == what)
        .unwrap_or_else(|| panic!("nothing on {what}: {report}"))
}

/// The report with a working driver; `None` with a message if there is no driver.
fn healthy(test: &str) -> Option<Value> {
    let report = json(&doctor(&["--json"], &[]));
    if report["adapters"].as_array().is_some_and(|adapters| !adapters.is_empty()) {
        return Some(report);
    }
    assert!(std::env::var_os("RELIEF_REQUIRE_ADAPTER").is_none(), "RELIEF_REQUIRE_ADAPTER is set: {report}");
    eprintln!("SKIPPED: {test} (no graphics adapter)");
    None
}

#[test]
fn a_healthy_machine_renders_and_says_on_what() {
    let Some(report) = healthy("a_healthy_machine_renders_and_says_on_what") else { return };
    assert_eq!(report["can_render"], true, "{report}");
    assert_eq!(report["self_test"]["passed"], true, "{report}");
    assert_eq!(finding(&report, "self-test")["mark"], "ok");
    let chosen = report["chosen"]["name"].as_str().expect("an adapter was chosen");
    let is_processor = report["chosen"]["kind"] == "processor";
    let has = |name: &str| report["adapters"].as_array().unwrap().iter().any(|one| one["name"] == name);
    assert!(is_processor || has(chosen), "{chosen}");
    // Vulkan guarantees 3D textures of 256 and storage buffers of 128 MiB.
    let adapter = json(&doctor(&["--json"], &[("RELIEF_ADAPTER", "software")]));
    assert!(adapter["limits"]["texture_3d_side"].as_u64().unwrap() >= 256);
    assert!(adapter["limits"]["storage_bytes"].as_u64().unwrap() >= 1 << 27);
    assert_eq!(adapter["self_test"]["passed"], true, "{adapter}");
    let readable = doctor(&[], &[]);
    assert!(readable.status.success());
    assert!(text(&readable).ends_with(&format!("Relief renders on {chosen}.\n")), "{}", text(&readable));
    assert!(!text(&readable).contains("MISSING"), "{}", text(&readable));
}

#[test]
fn every_finding_is_aligned_and_every_trouble_has_advice() {
    let output = doctor(&["--json"], &[("VK_DRIVER_FILES", "/nonexistent/icd.json")]);
    for finding in json(&output)["findings"].as_array().unwrap() {
        let fine = finding["mark"] == "ok" && finding["what"] != "features"; // lists what can be added
        assert_eq!(finding["advice"].is_null(), fine, "{finding}");
    }
    for line in text(&doctor(&[], &[])).lines().filter(|line| line.starts_with("ok ")) {
        assert_eq!(
            line.find(|letter: char| letter.is_ascii_alphabetic() && letter != 'o' && letter != 'k'),
            Some(9)
        );
    }
}

#[test]
#[cfg(target_os = "linux")]
fn a_driver_file_that_is_gone_is_named_with_the_remedy() {
    let gone = "/nonexistent/lvp_icd.json";
    // Another variable could add a driver that works.
    let environment = [("VK_DRIVER_FILES", gone), ("VK_ADD_DRIVER_FILES", ""), ("VK_ICD_FILENAMES", "")];
    let output = doctor(&[], &environment);
    assert_eq!(output.status.code(), Some(0), "the processor renders: {}", text(&output));
    let report = text(&output);
    for part in [
        gone,
        "does not exist",
        "scripts/setup-driver",
        "mesa-vulkan-drivers",
        "libvulkan1",
        "Relief renders on processor",
    ] {
        assert!(report.contains(part), "{part:?} is not in\n{report}");
    }
    let report = json(&doctor(&["--json"], &environment));
    assert_eq!(report["can_render"], true);
    assert_eq!(report["chosen"]["kind"], "processor");
    assert_eq!(report["adapters"], Value::Array(Vec::new()));
    assert_eq!(finding(&report, "VK_DRIVER_FILES")["mark"], "missing");
    assert_eq!(finding(&report, "adapter")["mark"], "warn");
}

#[test]
fn an_adapter_that_is_not_there_fails_and_what_there_is_is_listed() {
    let Some(healthy) = healthy("an_adapter_that_is_not_there_fails") else { return };
    let output = doctor(&["--json"], &[("RELIEF_ADAPTER", "voodoo 2")]);
    assert_eq!(output.status.code(), Some(1));
    let report = json(&output);
    let chosen = finding(&report, "chosen");
    assert_eq!(chosen["mark"], "missing");
    assert!(chosen["found"].as_str().unwrap().contains("voodoo 2"));
    assert!(chosen["advice"][0].as_str().unwrap().contains("RELIEF_ADAPTER"));
    assert_eq!(report["adapters"], healthy["adapters"]);
}

#[test]
fn the_features_are_those_of_this_build() {
    let report = json(&doctor(&["--json"], &[]));
    let features = finding(&report, "features");
    let built = features["found"].as_str().unwrap();
    let lacking = features["advice"].to_string();
    for (name, is_built) in [
        ("archives", cfg!(feature = "archives")),
        ("jpeg-ls", cfg!(feature = "jpeg-ls")),
        ("window", cfg!(feature = "window")),
    ] {
        assert_eq!(built.contains(name), is_built, "{features}");
        assert_eq!(lacking.contains(&format!("--features {name} ")), !is_built, "{features}");
    }
}

/// Invariant: No library prints to stderr where there is no window system: layers that look for one are off.
///
/// The stand-in for Mesa's layer has no library. The loader reports that it cannot be opened, unless its
/// switch is set.
#[cfg(target_os = "linux")]
#[test]
fn no_layer_looks_for_a_window_system() {
    let folder = tempfile::tempdir().unwrap();
    let layers = folder.path().join("vulkan/implicit_layer.d");
    std::fs::create_dir_all(&layers).unwrap();
    let layer = serde_json::json!({
        "file_format_version": "1.0.0",
        "layer": {
            "name": "VK_LAYER_RELIEF_absent", "type": "GLOBAL", "library_path": "/nonexistent/relief_absent.so",
            "api_version": "1.3.211", "implementation_version": "1", "description": "absent",
            "disable_environment": { "NODEVICE_SELECT": "1" }
        }
    });
    std::fs::write(layers.join("absent.json"), layer.to_string()).unwrap();
    let run = |runtime: Option<&str>| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
        command.arg("doctor").env_remove("NODEVICE_SELECT").env_remove("XDG_RUNTIME_DIR");
        command.env("XDG_DATA_HOME", folder.path()).env("VK_LOADER_DEBUG", "error");
        let output = command.envs(runtime.map(|folder| ("XDG_RUNTIME_DIR", folder))).output().unwrap();
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    if !run(folder.path().to_str()).contains("relief_absent") {
        let what = "no_layer_looks_for_a_window_system";
        eprintln!("UNAVAILABLE: {what} (the Vulkan loader is absent, or reports no missing layer)");
        return;
    }
    let said = run(None);
    assert!(!said.contains("relief_absent"), "{said}");
}
