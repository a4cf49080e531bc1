//! `--against-true` of `relief preview` and `relief inspect`, as users run it.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::process::{Command, Output};

use relief_display::{Layout, psnr_db, read_png};
use serde_json::{Value, json};

fn relief(arguments: &[&str]) -> Output {
    let program = env!("CARGO_BIN_EXE_relief");
    Command::new(program).args(arguments).env("RELIEF_ADAPTER", "cpu").output().unwrap()
}

fn json_of(arguments: &[&str]) -> Value {
    let output = relief(&[arguments, &["--json"]].concat());
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn refused(commands: &[(&[&str], &str)]) {
    for (arguments, reason) in commands {
        let output = relief(arguments);
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success() && error.contains(reason), "{error}");
    }
}

/// The views of a frame are compared with rendered ones of the same eyes: one number, and a picture of
/// the differences. Another number of views, or a picture without views, is refused.
#[test]
fn views_of_a_frame_are_compared_with_true_ones() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let [series, frame, truth, made, map] =
        ["head", "frame.png", "true.png", "made.png", "map.png"].map(path);
    assert!(relief(&["phantom", "--kind", "head", "--size", "48", "--out", &series]).status.success());
    let scene = ["render", "--series", &series, "--preset", "bone", "--zoom", "1.5", "--size", "160x90"];
    let views = ["--layout", "views-3x1", "--view-span", "4"];
    json_of(&[&scene[..], &["--layout", "rgbd", "--out", &frame]].concat());
    json_of(&[&scene[..], &views, &["--views", "true", "--out", &truth]].concat());
    let compare = |truth: &str| {
        ["preview", &frame, "--against-true", truth, "--map", &map, "--out", &made].map(str::to_owned)
    };
    let compare_with = |truth: &str, layout: &[&str]| {
        let arguments = compare(truth);
        let arguments: Vec<&str> =
            arguments.iter().map(String::as_str).chain(layout.iter().copied()).collect();
        relief(&[&arguments[..], &["--json"]].concat())
    };
    let output = compare_with(&truth, &views);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let layout: Layout = "views-3x1".parse().unwrap();
    let [truly, synthesised] = [&truth, &made].map(|path| {
        layout.decode(&read_png(&std::fs::read(path).unwrap()).unwrap().0).unwrap().views.unwrap()
    });
    let expected: Vec<f64> =
        truly.pictures().iter().zip(synthesised.pictures()).map(|(a, b)| psnr_db(a, b)).collect();
    let found = &report["against_true"];
    assert_eq!(found["psnr_db"], json!([expected[0], null, expected[2]]), "the middle view is the picture");
    assert_eq!(found["psnr_mean_db"], json!((expected[0] + expected[2]) / 2.0));
    assert!(expected[0] > 25.0 && expected[2] > 25.0, "{expected:?}");
    let shown = image::open(&map).unwrap().into_rgb8();
    assert_eq!(shown.dimensions(), (160, 90));
    let bright = shown.pixels().filter(|pixel| pixel.0[0] > 20).count();
    assert!(bright > 20 && bright < 160 * 90 / 2, "{bright} pixels differ");
    for (pixel, (x, y)) in shown.pixels().zip((0..90).flat_map(|y| (0..160).map(move |x| (x, y)))) {
        let at = y * 160 + x;
        let differs = truly.pictures().iter().zip(synthesised.pictures()).any(|(a, b)| a[at] != b[at]);
        assert!(differs || pixel.0 == [0; 3], "{x}, {y}");
    }

    // relief inspect makes the views in the layout of the true ones.
    let other_map = format!("{map}.inspect.png");
    let against = ["inspect", &frame, "--against-true", &truth, "--view-span", "4", "--map", &other_map];
    let inspected = json_of(&against);
    assert_eq!((&inspected["against_true"], &inspected["layout"]), (found, &json!("rgbd")));
    assert_eq!(std::fs::read(&other_map).unwrap(), std::fs::read(&map).unwrap());
    let words = String::from_utf8(relief(&against).stdout).unwrap();
    assert!(words.contains("problems  none\nlikeness  "), "{words}");
    refused(&[
        (&["inspect", &series, "--against-true", &truth][..], "--against-true is for 2D-plus-depth frames"),
        (&["inspect", &frame, "--against-true", &frame], "it has no views (layout rgbd)"),
        (&["inspect", &frame, "--against-true", &truth, "--view-span", "61"], "allowed: 0 to 60"),
        (&["inspect", &frame, "--view-span", "4"], "--against-true"),
    ]);

    std::fs::remove_file(&made).unwrap();
    for (truth, layout, reason) in [
        (&truth, &["--layout", "views-5x1"][..], "3 views of 160x90, the frame's are 5"),
        (&frame, &views[..], "it has no views (layout rgbd)"),
    ] {
        let output = compare_with(truth, layout);
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success() && error.contains(reason), "{error}");
        assert!(!std::path::Path::new(&made).exists(), "no output is left");
    }
}
