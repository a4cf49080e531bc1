//! `relief render` with placed lights, as users run it: options are equivalent to scenes, and
//! errors say what to do.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]

use std::process::{Command, Output};

use serde_json::json;

fn relief(arguments: &[&str]) -> Output {
    let program = env!("CARGO_BIN_EXE_relief");
    Command::new(program).args(arguments).env("RELIEF_ADAPTER", "cpu").output().unwrap()
}

#[test]
fn light_by_options_is_that_of_its_scene() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let series = path("head");
    let made = relief(&["phantom", "--kind", "head", "--size", "48", "--out", &series]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let render = |more: &[&str], out: &str| {
        let shared = ["render", "--series", &series, "--layout", "color", "--size", "96x64", "--out", out];
        relief(&[&shared[..], more].concat())
    };
    let (plain, by_options, by_scene, scene) =
        (path("plain.png"), path("options.png"), path("scene.png"), path("scene.json"));
    let written = json!({
        "transfer": "bone", "lights": "side",
        "shading": { "shadows": 0.7, "occlusion": { "strength": 0.6, "radius_mm": 30 } },
    });
    std::fs::write(&scene, written.to_string()).unwrap();
    let options = "--preset bone --lights side --shadows 0.7 --occlusion 0.6 --occlusion-radius-mm 30";
    let options: Vec<&str> = options.split(' ').collect();
    for (more, out) in
        [(&["--preset", "bone"][..], &plain), (&options, &by_options), (&["--scene", &scene], &by_scene)]
    {
        let output = render(more, out);
        assert!(output.status.success(), "{more:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
    let bytes = |path: &str| std::fs::read(path).unwrap();
    assert!(bytes(&by_options) == bytes(&by_scene), "options and scene differ");
    assert!(bytes(&by_options) != bytes(&plain), "the light changes nothing");
    let refused = render(&["--preset", "bone", "--shadows", "0.5"], &path("none.png"));
    let message = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && message.contains("shading.shadows is 0.5"), "{message}");
    assert!(message.contains("without lights") && !folder.path().join("none.png").exists(), "{message}");
}

#[test]
fn lights_that_are_unknown_are_refused_with_those_that_are_known() {
    for (arguments, parts) in [
        (["--lights", "disco"], &["headlight", "studio", "side", "above", "upper left"][..]),
        (["--occlusion-radius-mm", "5"], &["--occlusion"]),
    ] {
        let refused = relief(&[&["render", "--series", "x", "--out", "x.png"][..], &arguments].concat());
        let message = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(2), "{message}");
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    }
}
