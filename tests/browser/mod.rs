//! The pages for display boxes and for annotations in a browser: pixels on the screen, hands, a
//! Wiimote behind WebHID, a server that dies.
//!
//! Scripts in `browser/` drive Chromium with Playwright and print their results; the tests here
//! compare these with the expectations. The tests need Chromium, and a Python with Playwright in
//! `RELIEF_PEERS_PYTHON`; they print a message if either is missing.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test may panic and talk, in its helpers too")]

mod annotate;
use crate::common;
mod hands;
mod identity;
mod phases;
mod quantities;
mod readers;
mod safety;
mod views;
mod wand;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use serde_json::Value;

const RELIEF: &str = env!("CARGO_BIN_EXE_relief");

/// Chromium by `RELIEF_CHROMIUM`, or by the names that it goes by.
pub(crate) fn chromium() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os("RELIEF_CHROMIUM") {
        return Some(named.into());
    }
    let folders: Vec<PathBuf> = std::env::split_paths(&std::env::var_os("PATH")?).collect();
    let names = ["chromium", "chromium-browser", "google-chrome"];
    names
        .iter()
        .flat_map(|name| folders.iter().map(move |folder| folder.join(name)))
        .find(|path| path.is_file())
}

pub(crate) fn python() -> Option<std::ffi::OsString> {
    let name = std::env::var_os("RELIEF_PEERS_PYTHON").filter(|name| !name.is_empty())?;
    let imported =
        Command::new(&name).args(["-c", "import playwright.sync_api"]).stderr(Stdio::null()).status();
    imported.is_ok_and(|status| status.success()).then_some(name)
}

fn relief(arguments: &[&str]) {
    let output = Command::new(RELIEF).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// The results of a script of `browser/` with a served head of this size; `None` if there is no
/// browser.
fn driven(script: &str, size: &str, reports: bool) -> Option<Value> {
    let (python, chromium) = (python()?, chromium()?);
    let folder = tempfile::tempdir().unwrap();
    let [series, last] = ["head", "reports.jsonl"].map(|name| folder.path().join(name));
    let text = |path: &Path| path.to_str().unwrap().to_owned();
    relief(&["phantom", "--kind", "head", "--size", size, "--out", &text(&series)]);
    if reports {
        relief(&["track", "simulate", "--seconds", "3", "--out", &text(&last)]);
    }
    let last = if reports { last.as_path() } else { folder.path() };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/browser").join(script);
    // Compiled modules would lie beside the sources.
    let mut command = Command::new(python);
    command.env("PYTHONDONTWRITEBYTECODE", "1").arg(script).arg(RELIEF).args([&chromium, &series]).arg(last);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(serde_json::from_slice(&output.stdout).unwrap())
}

/// Says aloud that a test did not run.
pub(crate) fn skipped(what: &str) {
    eprintln!("SKIPPED: {what} (no Chromium, or RELIEF_PEERS_PYTHON names no Python with playwright)");
}

/// The results of the browser, once for all tests; `None` with a message if there is no browser.
fn seen(what: &str) -> Option<&'static Value> {
    static SEEN: OnceLock<Option<Value>> = OnceLock::new();
    let seen = SEEN.get_or_init(|| driven("kiosk.py", "96", true));
    if seen.is_none() {
        skipped(what);
    }
    seen.as_ref()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| value.as_str().unwrap().parse().unwrap())
}

/// Numbers with commas between them.
fn triple(value: &Value) -> Vec<f64> {
    value.as_str().unwrap().split(',').map(|mm| mm.parse().unwrap()).collect()
}

fn numbers(value: &Value) -> Vec<f64> {
    common::numbers(value)
}

/// Invariant: The kiosk shows exactly the served frame, and warns about a browser that converts
/// colours.
#[test]
fn the_screen_shows_the_served_frame_and_detects_another_profile() {
    let Some(seen) = seen("frames on a screen") else { return };
    let exact = &seen["exact"];
    assert_eq!(exact["srgb"]["different"], 0, "{exact}");
    assert_eq!(exact["srgb"]["test"], "good", "{exact}");
    assert_eq!(exact["srgb"]["monitor"]["test"], "good", "{exact}");
    // A browser that converts for another screen alters the frame, and the pages say so.
    assert!(exact["p3"]["different"].as_i64().unwrap() > 10_000, "{exact}");
    assert_eq!(exact["p3"]["test"], "bad", "{exact}");
    assert_eq!(exact["p3"]["monitor"]["test"], "bad", "{exact}");
    assert!(exact["p3"]["menu"].as_str().unwrap().contains("--force-color-profile=srgb"), "{exact}");
    for profile in ["srgb", "p3"] {
        for problems in [&exact[profile]["problems"], &exact[profile]["monitor"]["problems"]] {
            assert_eq!(problems, &serde_json::json!([]), "{profile}");
        }
    }
}

/// Invariant: The views that the kiosk makes of a live frame are those that the server makes of it, byte by
/// byte, in every arrangement.
#[test]
fn the_kiosk_makes_the_views_that_the_server_makes() {
    let Some(seen) = seen("views in a browser") else { return };
    let outputs = &seen["outputs"];
    assert!(outputs["eyes_differ"].as_i64().unwrap() > 5000, "{outputs}");
    let names = [
        "stereo",
        "stereo&swap",
        "stereo-half",
        "top-bottom",
        "top-bottom-half",
        "lines",
        "columns",
        "checkerboard",
        "quilt",
        "layers",
    ];
    for name in names {
        let output = &outputs[name];
        assert_eq!(
            (&output["different"], &output["problems"]),
            (&0.into(), &serde_json::json!([])),
            "{name}: {outputs}"
        );
        // Layouts of the server with the same name have the same pixels.
        assert_eq!(output["served"].as_i64().unwrap_or(0), 0, "{name}: {outputs}");
    }
    // Which lens a subpixel at the edge of one belongs to is rounded in 32 bits.
    let lenses = outputs["lenses"]["different"].as_i64().unwrap();
    assert!((0..500).contains(&lenses), "{lenses} pixels of a panel with lenses differ");
    let facts = outputs["facts"].as_str().unwrap();
    assert!(
        facts.contains("side by side, 1920 × 540") && facts.contains("2, made in a worker in"),
        "{facts}"
    );
    let delay =
        outputs["facts"].as_str().unwrap().split("a movement is shown ").nth(1).expect("the delay is stated");
    let ms: f64 = delay.split(" ms").next().unwrap().parse().unwrap();
    assert!(ms > 0.0, "{delay}");
    let monitor = &outputs["monitor"];
    assert!(monitor["address"].as_str().unwrap().contains("output=stereo"), "{monitor}");
    for what in ["flat", "deep", "swapped", "lenses"] {
        assert_eq!(monitor[what], true, "{what}: {monitor}");
    }
    assert_eq!(monitor["problems"], serde_json::json!([]));
    let refused = outputs["refused"].as_str().unwrap();
    assert!(refused.contains("output is hologram; allowed: frame, flat, stereo"), "{refused}");
}

/// Invariant: The kiosk shows rendered views of a picture at rest: those of `relief render --views true`, byte by
/// byte.
#[test]
fn views_at_rest_are_those_that_the_command_line_renders() {
    let Some(seen) = seen("views at rest") else { return };
    let rest = &seen["rest"];
    assert_eq!(rest["problems"], serde_json::json!([]), "{rest}");
    assert!(rest["lit"].as_i64().unwrap() > 5000, "{rest}");
    for output in ["stereo", "inches", "lines", "middle"] {
        assert_eq!(rest[output], 0, "{output}: {rest}");
    }
    assert_eq!((&rest["synthesised"], &rest["moved"]), (&Value::Null, &true.into()), "{rest}");
    let [warped, refined] = ["warped", "refined"].map(|way| number(&rest["db"][way]));
    assert!(refined > warped + 1.0 && refined < 90.0, "{warped} and {refined} dB");
    assert!(rest["facts"].as_str().unwrap().contains("true views of the server"), "{rest}");
    for (query, refused) in rest["refused"].as_object().unwrap() {
        let expected = if query.contains("best") { "malformed-parameter" } else { "out-of-range" };
        assert_eq!(refused["code"], expected, "{query}: {refused}");
    }
    assert_eq!(rest["other"]["status"], 204, "{rest}");
    let never = rest["never"].as_str().unwrap();
    assert!(never.contains("rest is never; allowed: true, synthesised"), "{never}");
}

/// Invariant: Views follow a tracked viewer: they are those of the same places of the eyes, byte by byte.
#[test]
fn views_follow_the_eyes_of_a_head_tracker() {
    let Some(seen) = seen("eyes of a viewer") else { return };
    let eyes = &seen["eyes"];
    assert_eq!(eyes["connected"], true, "{eyes}");
    for place in ["right", "far", "pair"] {
        assert_eq!(
            (&eyes[place]["different"], &eyes[place]["problems"]),
            (&0.into(), &serde_json::json!([])),
            "{eyes}"
        );
    }
    let moved = |place: &str| eyes[place]["moved"].as_i64().unwrap();
    assert!(moved("right") > 1000 && moved("far") > 500, "{eyes}");
    let words = eyes["words"].as_str().unwrap();
    assert!(words.contains("mm away") && words.contains("ms after they came"), "{words}");
    assert!(eyes["said"].as_str().unwrap().contains("out of range"), "a wrong datagram is reported: {eyes}");
}

/// Invariant: Views follow a tracked viewer: they are those of the same places of the eyes, byte by byte.
#[test]
fn a_screen_in_space_shows_each_eye_its_view_and_follows_the_head() {
    let Some(seen) = seen("a screen in space") else { return };
    let space = &seen["space"];
    assert_eq!((&space["offered"], &space["problems"]), (&true.into(), &serde_json::json!([])), "{space}");
    for place in ["rest", "aside"] {
        assert!(space[place]["lit"].as_i64().unwrap() > 5000, "{space}");
        assert_eq!(space[place]["different"], 0, "{place}: {space}");
    }
}

/// Truth: the published formula, with 65 mm of eye separation on a screen of 42 inches and M = -1960.37.
#[test]
fn the_menu_states_parallax_and_warns_where_it_is_uncomfortable() {
    let Some(seen) = seen("comfort of the kiosk") else { return };
    let comfort = &seen["comfort"];
    let width_mm = 42.0 * 25.4 * 16.0 / 16f64.hypot(9.0);
    for name in ["usual", "strong", "strict"] {
        let found = &comfort[name];
        assert_eq!(found["problems"], serde_json::json!([]), "{found}");
        let share = |end: usize| {
            let disparity = number(&found["ends"][end]) - 128.0;
            100.0 * 65.0 / width_mm * number(&found["factor"]) / 64.0 * disparity / 1960.37
        };
        let (behind, front) = ((-share(0)).max(0.0), share(1).max(0.0));
        let expected = format!("{front:.1} % of the width in front of the screen, {behind:.1} % behind");
        assert!(found["words"].as_str().unwrap().contains(&expected), "{expected}: {found}");
    }
    assert_eq!((&comfort["usual"]["comfort"], &comfort["usual"]["warnings"]), (&"good".into(), &"".into()));
    assert_eq!(comfort["strict"]["comfort"], "bad");
    let warnings = comfort["strict"]["warnings"].as_str().unwrap();
    assert!(warnings.contains("Parallax in front") && warnings.contains("above 0.1 %"), "{warnings}");
    assert!(comfort["refused"].as_str().unwrap().contains("comfort is 0,3; allowed: per cent"), "{comfort}");
}

/// Invariant: Hands move the view of the kiosk, its cursor lies where a pick lies, and the kiosk
/// reconnects to a restarted server.
#[test]
fn hands_move_the_view_and_a_server_that_comes_back_is_found() {
    let Some(seen) = seen("hands on a kiosk") else { return };
    let hands = &seen["hands"];
    assert_eq!(hands["problems"], serde_json::json!([]));
    assert_ne!(hands["turned"]["orientation_xyzw"], hands["home"]["orientation_xyzw"]);
    // 70 pixels to the right and 14 down, 0.35 degrees each.
    let [turned, home] = ["turned", "home"].map(|name| numbers(&hands[name]["orientation_xyzw"]));
    let cosine: f64 = turned.iter().zip(&home).map(|(a, b)| a * b).sum();
    let angle = 2.0 * cosine.abs().min(1.0).acos().to_degrees();
    assert!((15.0..27.0).contains(&angle), "{angle} degrees");
    assert_eq!(hands["reset"]["orientation_xyzw"], hands["home"]["orientation_xyzw"]);
    let picked = numbers(&hands["pick"]["patient_mm"]);
    let distance =
        picked.iter().zip(numbers(&hands["cursor_mm"])).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    assert!(distance < 1.0, "the cursor is {distance} mm from what is picked there");
    // The server was killed: its successor does not know the session and receives its state.
    for key in ["look_at_mm", "orientation_xyzw", "cursor_mm"] {
        let [before, after] = ["before", "after"].map(|name| numbers(&hands[name][key]));
        assert!(before.iter().zip(&after).all(|(a, b)| (a - b).abs() < 1e-6), "{key}: {hands}");
    }
    assert_eq!(hands["after"]["preset"], "bone");
    assert!(hands["said"].as_str().unwrap().contains("No connection"), "{hands}");
}

#[test]
fn a_kiosk_waits_for_its_volume_with_a_message() {
    let Some(seen) = seen("a kiosk that comes early") else { return };
    let early = &seen["early"];
    assert_eq!(early["connection"], "waiting", "{early}");
    assert!(early["said"].as_str().unwrap().contains("does not have this volume yet"), "{early}");
    // Tries are farther and farther apart: after 100 ms, 200, 400, 800, 1600, and then every 2 s.
    let tries = early["tries"].as_u64().unwrap();
    assert!((4..=8).contains(&tries), "{tries} in 4 s");
    assert_eq!((&early["later"], &early["different"]), (&"live".into(), &0.into()), "{early}");
    assert_eq!(early["problems"], serde_json::json!([]));
}

/// Invariant: Hands move the view of the kiosk, its cursor lies where a pick lies, and the kiosk
/// reconnects to a restarted server.
#[test]
fn a_wiimote_behind_webhid_is_brought_up_and_tracked() {
    let Some(seen) = seen("a Wiimote behind WebHID") else { return };
    let wiimote = &seen["wiimote"];
    assert_eq!(wiimote["problems"], serde_json::json!([]));
    // The order of Linux' driver: clock, logic, five registers, mode 0x33 in continuous reports.
    let ids: Vec<u64> =
        wiimote["said"].as_array().unwrap().iter().map(|said| said[0].as_u64().unwrap()).collect();
    assert_eq!(ids[..8], [0x13, 0x1a, 0x16, 0x16, 0x16, 0x16, 0x16, 0x12], "{wiimote}");
    assert_eq!(wiimote["said"][7], serde_json::json!([0x12, 0x06, 0x33]));
    // The tip moves the cursor.
    assert_ne!(wiimote["after"]["cursor_mm"], wiimote["before"]["cursor_mm"], "{wiimote}");
}

/// One bad frame is reported and acknowledged like a good one; many end the connection. A copied
/// tab has no token.
#[test]
fn a_bad_frame_ends_no_session_and_a_copied_tab_takes_none() {
    let has_node = Command::new("node").arg("--version").stdout(Stdio::null()).status();
    if !has_node.is_ok_and(|status| status.success()) {
        eprintln!("SKIPPED: the kiosk's session by itself (no node)");
        return;
    }
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().unwrap();
    // Node treats the files of a folder as modules if its package.json says so.
    std::fs::write(folder.path().join("package.json"), r#"{"type": "module"}"#).unwrap();
    for module in ["session.js", "frame.js", "restore.js"] {
        std::fs::copy(here.join("src/server/page/kiosk").join(module), folder.path().join(module)).unwrap();
    }
    let identity = here.join("src/server/page/identity.js");
    std::fs::copy(identity, folder.path().join("identity.js")).unwrap();
    std::fs::write(folder.path().join("layouts.js"), relief_live::layouts_script()).unwrap();
    let script = here.join("tests/browser/session.mjs");
    let output = Command::new("node").arg(script).arg(folder.path()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let seen: Value = serde_json::from_slice(&output.stdout).unwrap();
    let texts = &seen["bad_texts"];
    let reported: Vec<_> = texts["changed"].as_array().unwrap().iter().collect();
    assert_eq!((reported.len(), &texts["closed"]), (6, &Value::Null), "{seen}");
    assert!(reported[1..5].iter().all(|change| change[1].as_str().unwrap().contains("no message")), "{seen}");
    assert_eq!(*reported[5], serde_json::json!(["live", ""]), "{seen}");
    let early = serde_json::json!(
        {"unavailable": "waiting", "missing": "waiting", "preset": "ended", "unprocessable": "ended"}
    );
    assert_eq!(seen["too_early"], early);
    let bad = &seen["bad_frames"];
    assert_eq!(
        (&bad["acknowledged"], &bad["closed"]),
        (&serde_json::json!([1, 2, 3]), &Value::Null),
        "{seen}"
    );
    assert_eq!(
        bad["shown"],
        serde_json::json!([[1, 10, 20, 30, 255, 11, 21, 31, 255], [3, 10, 20, 30, 255, 11, 21, 31, 255]])
    );
    let reported: Vec<_> =
        bad["changed"].as_array().unwrap().iter().map(|change| change[0].clone()).collect();
    assert_eq!(reported, ["connecting", "live", "live", "live"], "{seen}");
    assert_eq!((&bad["closed_at_last"], &bad["acknowledged_at_last"]), (&4000.into(), &22.into()), "{seen}");
    assert_eq!(seen["no_frame"], serde_json::json!({"closed": 4000, "acknowledged": 0}));
    let tokens = &seen["tokens"];
    assert_eq!((&tokens["copied"], &tokens["left"]), (&Value::Null, &"token-1".into()), "{seen}");
    assert_eq!((&tokens["resumed"], &tokens["ended"]), (&"token-1".into(), &"ended".into()), "{seen}");
    assert_eq!(tokens["after"], Value::Null, "an ended session leaves no token: {seen}");
}
