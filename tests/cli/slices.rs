//! `relief render` with slices, as users run it: the picture, the letters at its edges, and
//! refusals.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]

use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Value, json};

fn relief(arguments: &[&str]) -> Output {
    let program = env!("CARGO_BIN_EXE_relief");
    Command::new(program).args(arguments).env("RELIEF_ADAPTER", "cpu").output().unwrap()
}

fn axes_series(folder: &Path) -> String {
    let place = folder.join("axes").to_str().unwrap().to_owned();
    let made = relief(&["phantom", "--kind", "axes", "--size", "32", "--out", &place]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    place
}

/// The same by options and by a scene file, with the balls and the letters where they belong.
#[test]
fn a_slice_by_options_is_that_of_its_scene() {
    let folder = tempfile::tempdir().unwrap();
    let series = axes_series(folder.path());
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (by_options, by_scene, scene) = (path("options.png"), path("scene.png"), path("scene.json"));
    let render = |more: &[&str], out: &str| -> Value {
        let output = relief(&[&["render", "--series", &series, "--json", "--out", out][..], more].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let options = [
        "--plane",
        "coronal",
        "--offset-mm",
        "-40",
        "--slab-mm",
        "6",
        "--slab-blend",
        "mip",
        "--height-mm",
        "128",
        "--window-hu",
        "0,2",
        "--layout",
        "color",
        "--size",
        "64x64",
    ];
    let report = render(&options, &by_options);
    assert_eq!(report["edges"], json!({ "left": "R", "right": "L", "top": "H", "bottom": "F" }));
    let written = json!({
        "mode": "slice",
        "slice": { "plane": "coronal", "offset_mm": -40, "slab_mm": 6, "blend": "mip", "height_mm": 128 },
        "transfer": { "window": { "center_hu": 0, "width_hu": 2 } },
        "size_px": [64, 64],
        "display": { "layout": "color" },
    });
    std::fs::write(&scene, written.to_string()).unwrap();
    render(&["--scene", &scene], &by_scene);
    assert_eq!(std::fs::read(&by_options).unwrap(), std::fs::read(&by_scene).unwrap());
    // The ball in front, of 8 mm radius, is all that this slab holds: 2 mm a pixel, in the middle.
    let picture = image::open(&by_options).unwrap().into_luma8();
    let white = picture.pixels().filter(|pixel| pixel.0[0] == 255).count();
    assert!((30..70).contains(&white), "{white} white pixels for a disc of 4 pixels' radius");
    assert_eq!(picture.get_pixel(32, 32).0[0], 255);
}

#[test]
fn options_without_meaning_for_slices_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.png").to_str().unwrap().to_owned();
    let camera = folder.path().join("camera.json");
    let written = json!({ "camera": { "eye_mm": [0, -300, 0], "look_at_mm": [0, 0, 0],
                                      "projection": { "orthographic": { "height_mm": 99 } } } });
    std::fs::write(&camera, written.to_string()).unwrap();
    let camera = camera.to_str().unwrap();
    for (options, status, message) in [
        (&["--slab-mm", "5"][..], 1, "--plane or --normal"),
        (&["--plane", "axial", "--azimuth-deg", "20"], 1, "a slice has its own view"),
        (&["--plane", "axial", "--scene", camera], 1, "has a camera"),
        (&["--plane", "transverse"], 2, "axial, coronal and sagittal"),
        (&["--plane", "axial", "--normal", "0,0,1"], 2, "cannot be used with"),
        (&["--normal", "0,1"], 2, "three numbers"),
        (&["--up", "0,0,1"], 2, "--normal"),
        (&["--plane", "axial", "--slab-blend", "median"], 2, "mean, mip and minip"),
        (&["--window-hu", "40"], 2, "CENTER,WIDTH"),
    ] {
        let output = relief(&[&["render", "--series", "none", "--out", &out][..], options].concat());
        let reported = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(status), "{options:?}: {reported}");
        assert!(reported.contains(message), "{options:?}: {reported}");
    }
}
