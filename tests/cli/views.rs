//! `relief render` and `relief preview` with layouts of views, as users run them.
//!
//! OpenCV checks the
//! signal-to-noise ratios where `RELIEF_PEERS_PYTHON` names a Python that has it.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, clippy::print_stdout, reason = "a test that cannot run says so aloud")]

use std::path::Path;
use std::process::{Command, Output};

use relief_base::DepthLimits;
use relief_display::{DisplaySettings, Layout, Picture, decode_wiggle, encode_png, read_png};
use serde_json::{Value, json};

fn relief(arguments: &[&str]) -> Output {
    let program = env!("CARGO_BIN_EXE_relief");
    Command::new(program).args(arguments).env("RELIEF_ADAPTER", "cpu").output().unwrap()
}

fn json_of(arguments: &[&str]) -> Value {
    let output = relief(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn refusal(arguments: &[&str]) -> String {
    let output = relief(arguments);
    assert!(!output.status.success(), "{arguments:?}");
    String::from_utf8(output.stderr).unwrap()
}

/// PSNR of each rendered view, in the upper row, to the synthesised one below it.
const OPENCV: &str = r"
import json, sys, numpy as np, cv2
picture = cv2.imread(sys.argv[1])
width = picture.shape[1] // int(sys.argv[2])
above, below = np.split(picture, 2)
cut = lambda row: [row[:, i * width:(i + 1) * width] for i in range(int(sys.argv[2]))]
print(json.dumps([cv2.PSNR(a, b) for a, b in zip(cut(above), cut(below))]))
";

#[test]
fn true_views_stand_above_synthesised_ones_with_the_ratios_that_opencv_finds() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (series, both, lone) = (path("head"), path("both.png"), path("true.png"));
    assert!(relief(&["phantom", "--kind", "head", "--size", "48", "--out", &series]).status.success());
    let render = |views: &str, layout: &str, out: &str| {
        let scene = ["render", "--series", &series, "--preset", "bone", "--zoom", "1.5", "--size", "160x90"];
        json_of(&[&scene[..], &["--layout", layout, "--views", views, "--out", out, "--json"]].concat())
    };
    let report = render("both", "views-3", &both)["views"].clone();
    assert_eq!(report["eyes"], json!([-1.0, 0.0, 1.0]));
    let reported: Vec<Option<f64>> =
        report["psnr_db"].as_array().unwrap().iter().map(Value::as_f64).collect();
    assert!(
        reported[1].is_none()
            && reported[0].is_some_and(|db| db > 25.0)
            && reported[2].is_some_and(|db| db > 25.0),
        "{reported:?}"
    );
    let mean = (reported[0].unwrap() + reported[2].unwrap()) / 2.0;
    assert!((report["psnr_mean_db"].as_f64().unwrap() - mean).abs() < 1e-9);

    // The upper row is the output of --views true, the lower one the output without it.
    let synthesised = path("synthesised.png");
    render("true", "views-3", &lone);
    render("synthesised", "views-3", &synthesised);
    let rows = |file: &str| {
        let picture = image::open(file).unwrap().into_rgb8();
        assert_eq!(picture.width(), 480);
        picture.into_raw()
    };
    assert_eq!(rows(&both), [rows(&lone), rows(&synthesised)].concat());

    let Some(python) = std::env::var_os("RELIEF_PEERS_PYTHON") else {
        return eprintln!("SKIPPED: OpenCV's PSNR (RELIEF_PEERS_PYTHON is not set)");
    };
    let output = Command::new(python).args(["-c", OPENCV, &both, "3"]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let peer: Vec<f64> = serde_json::from_slice(&output.stdout).unwrap();
    for view in [0, 2] {
        assert!((reported[view].unwrap() - peer[view]).abs() < 1e-6, "{reported:?} {peer:?}");
    }
    assert!(peer[1] > 300.0, "OpenCV has no infinity");

    let no_eye = refusal(&[
        "render",
        "--series",
        &series,
        "--fov-deg",
        "0",
        "--layout",
        "stereo",
        "--views",
        "true",
        "--size",
        "32x18",
        "--out",
        &lone,
    ]);
    assert!(no_eye.contains("true views need a perspective"), "{no_eye}");
    let no_views = refusal(&["render", "--series", &series, "--views", "true", "--out", &lone]);
    assert!(no_views.contains("--views is for layouts of views"), "{no_views}");
}

/// Views between rendered ones: the rendered ones are the true ones, the others nearly.
#[test]
fn interpolated_views_are_the_true_ones_at_the_keys_and_close_between_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let series = path("head");
    assert!(relief(&["phantom", "--kind", "head", "--size", "64", "--out", &series]).status.success());
    let render = |views: &[&str], out: &str| {
        let scene = ["render", "--series", &series, "--preset", "bone", "--zoom", "1.5", "--size", "160x90"];
        let layout = ["--layout", "views-9x1", "--view-span", "4", "--views"];
        let made = json_of(&[&scene[..], &layout, views, &["--out", out, "--json"]].concat());
        (made["views"].clone(), views_of(out))
    };
    let (_, exact) = render(&["true"], &path("true.png"));
    let (_, synthesised) = render(&["synthesised"], &path("made.png"));
    for (keys, numbers) in [("3", json!([0, 4, 8])), ("5", json!([0, 2, 4, 6, 8]))] {
        let (report, views) = render(&["interpolated", "--key-views", keys], &path("between.png"));
        assert_eq!(report["rendered"], numbers);
        let mut means = [0.0; 2];
        for (number, view) in views.iter().enumerate() {
            let [between, made] =
                [view, &synthesised[number]].map(|other| relief_display::psnr_db(&exact[number], other));
            if numbers.as_array().unwrap().contains(&json!(number)) {
                assert!(between.is_infinite(), "{keys}, {number}: {between} dB");
                continue;
            }
            assert!(between > 30.0, "{keys}, {number}: {between} dB");
            means = [means[0] + between, means[1] + made];
        }
        assert!(means[0] > means[1], "{keys}: {means:?} dB in all");
    }
    // A tenth of the others rendered brings them nearer.
    let (_, between) = render(&["interpolated", "--key-views", "3"], &path("three.png"));
    let (report, refined) = render(&["refined", "--key-views", "3"], &path("refined.png"));
    assert_eq!(report["rendered"], json!([0, 4, 8]));
    for number in [1, 2, 3, 5, 6, 7] {
        let [before, after] =
            [&between[number], &refined[number]].map(|other| relief_display::psnr_db(&exact[number], other));
        assert!(after > before + 0.2 && after < 99.0, "{number}: {before} and {after} dB");
    }
    let pair = |views: &str| {
        let scene = ["render", "--series", &series, "--preset", "bone", "--zoom", "1.5", "--size", "161x91"];
        json_of(
            &[&scene[..], &["--layout", "stereo", "--views", views, "--out", &path("two.png"), "--json"]]
                .concat(),
        );
        views_of(&path("two.png"))
    };
    let (exact, made, refined) = (pair("true"), pair("synthesised"), pair("refined"));
    for eye in [0, 1] {
        let [before, after] =
            [&made, &refined].map(|other| relief_display::psnr_db(&exact[eye], &other[eye]));
        assert!(after > before + 0.2 && after < 99.0, "{eye}: {before} and {after} dB");
    }
    let no_keys = refusal(&[
        "render",
        "--series",
        &series,
        "--layout",
        "stereo",
        "--key-views",
        "2",
        "--out",
        &path("a.png"),
    ]);
    assert!(no_keys.contains("--key-views is for --views interpolated"), "{no_keys}");
}

/// The picture of an eye is that of the camera that the report names; the camera is where the eye is, in the
/// scale of the screen, and points in the plane of the screen stay where they are.
#[test]
fn an_eye_sees_the_volume_through_the_screen_as_through_a_window() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (series, out, geometry) = (path("head"), path("eye.png"), path("display.json"));
    assert!(relief(&["phantom", "--kind", "head", "--size", "48", "--out", &series]).status.success());
    std::fs::write(&geometry, r#"{"width_mm": 600}"#).unwrap();
    let scene =
        ["render", "--series", &series, "--preset", "bone", "--layout", "rgbd", "--size", "160x90", "--json"];
    let of = |eye: &str| {
        let eye = ["--eye-mm", eye, "--display-geometry", &geometry, "--out", &out];
        json_of(&[&scene[..], &eye].concat())["eye"].clone()
    };
    let numbers = |value: &Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|n| n.as_f64().unwrap()).collect()
    };
    let (middle, beside) = (of("0,0,1200"), of("-150,100,900"));
    let seen = image::open(&out).unwrap().into_rgb8();
    let ([a, b], shift) =
        ([&middle, &beside].map(|eye| numbers(&eye["camera"]["eye_mm"])), &beside["camera"]["lens_shift"]);
    // Seen from the front: x is the patient's left and the picture's right, z is up, y is away.
    let moved: Vec<f64> = a.iter().zip(&b).map(|(a, b)| b - a).collect();
    let scale = middle["screen_mm"].as_f64().unwrap() / 1200.0;
    for (found, expected) in moved.iter().zip([-150.0 * scale, 300.0 * scale, 100.0 * scale]) {
        assert!((found - expected).abs() < 1e-6, "{moved:?}, {scale} mm of the patient per mm");
    }
    for (found, expected) in numbers(shift).into_iter().zip([150.0 / 900.0, -100.0 / 900.0]) {
        assert!((found - expected).abs() < 1e-9, "{shift}");
    }
    // The scene of that camera is the same picture: colour, and disparity between the same planes.
    let written = path("scene.json");
    let limits = json_of(
        &[&scene[..], &["--eye-mm", "-150,100,900", "--display-geometry", &geometry, "--out", &out]].concat(),
    );
    let display = json!({ "layout": "rgbd", "near_mm": limits["near_mm"], "far_mm": limits["far_mm"] });
    let scene_file =
        json!({ "camera": beside["camera"], "transfer": "bone", "size_px": [160, 90], "display": display });
    std::fs::write(&written, scene_file.to_string()).unwrap();
    json_of(&["render", "--series", &series, "--scene", &written, "--out", &out, "--json"]);
    assert_eq!(image::open(&out).unwrap().into_rgb8(), seen);
    for (more, reason) in [
        (["--eye-mm", "0,0,-5"], "the eye sees nothing through the screen"),
        (["--fov-deg", "0"], "has no eye"),
    ] {
        let arguments = if more[0] == "--fov-deg" {
            vec![more[0], more[1], "--eye-mm", "0,0,900"]
        } else {
            more.to_vec()
        };
        let refused = refusal(&[&scene[..], &arguments, &["--out", &out]].concat());
        assert!(refused.contains(reason), "{refused}");
    }
}

/// A panel's file and the name of a quilt, in render and in preview.
#[test]
fn panels_have_files_and_quilts_have_names() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (series, panel) = (path("head"), path("panel.json"));
    assert!(relief(&["phantom", "--kind", "head", "--size", "48", "--out", &series]).status.success());
    std::fs::write(&panel, r#"{"pitch_px": 4.5, "slant": 0.25, "center": 0.125, "subpixels": "bgr"}"#)
        .unwrap();
    let scene = ["render", "--series", &series, "--preset", "bone", "--size", "160x90", "--json"];
    let render = |more: &[&str]| json_of(&[&scene[..], more].concat());
    let refused = |more: &[&str]| refusal(&[&scene[..], more].concat());

    // The views of a quilt under the lenses: the formula of the panel, third by third.
    let (quilt, interlaced) = (path("head_qs3x3a1.778.png"), path("panel.png"));
    render(&["--view-span", "2", "--out", &quilt]);
    let views = views_of(&quilt);
    assert_eq!(views.len(), 9);
    render(&["--layout", "lenses-9", "--panel", &panel, "--out", &interlaced]);
    let found = image::open(&interlaced).unwrap().into_rgb8();
    for (x, y, pixel) in found.enumerate_pixels() {
        for channel in 0..3 {
            let third = (2 - channel) as f64 + 0.5; // blue, green, red
            let lenses = (f64::from(x) + third / 3.0 + f64::from(y) * 0.25) / 4.5 - 0.125;
            let view = ((lenses - lenses.floor()) * 9.0) as usize;
            assert_eq!(pixel[channel], views[view][(y * 160 + x) as usize][channel], "{x}, {y}, {channel}");
        }
    }
    let described = String::from_utf8(relief(&["inspect", &panel]).stdout).unwrap();
    assert!(
        described.contains("output=lenses&lens=4.500000,0.250000,0.125000&subpixels=bgr\n"),
        "{described}"
    );
    let previewed = path("previewed.png");
    json_of(&["preview", &quilt, "--layout", "lenses-9", "--panel", &panel, "--out", &previewed, "--json"]);
    assert_eq!(image::open(&previewed).unwrap().into_rgb8(), found);
    let other = path("other_qs3x3a1.78.png");
    assert_eq!(json_of(&["preview", &quilt, "--out", &other, "--json"])["layout"], "views-9");

    let both = refused(&["--layout", "stereo", "--out", &quilt]);
    assert!(
        both.contains("the file's name says that it is a quilt of 3x3 views, --layout is stereo"),
        "{both}"
    );
    let square = refused(&["--out", &path("head_qs3x3a1.png")]);
    assert!(square.contains("aspect of 1, those of 160x90 end a name with _qs3x3a1.7778"), "{square}");
    let flat = refused(&["--layout", "stereo", "--panel", &panel, "--out", &path("a.png")]);
    assert!(flat.contains("--panel is for layouts lenses-N; this one is stereo"), "{flat}");
    std::fs::write(&panel, r#"{"pitch_px": 0}"#).unwrap();
    let thin = refused(&["--layout", "lenses-9", "--panel", &panel, "--out", &path("a.png")]);
    assert!(
        thin.contains("panel.json is no panel") && thin.contains("pitch_px is 0, allowed: 1 to 1000"),
        "{thin}"
    );
    let named = relief(&["preview", &quilt, "--layout", "views-9", "--out", &path("plain.png")]);
    assert!(String::from_utf8(named.stdout).unwrap().contains("plain_qs3x3a1.7778"));
}

/// Invariant: The cameras of the outermost views have the angle of the view cone between them.
#[test]
fn cones_are_angles_from_the_middle_of_the_screen() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (series, panel) = (path("head"), path("visual.json"));
    assert!(relief(&["phantom", "--kind", "head", "--size", "48", "--out", &series]).status.success());
    let calibration = |cone: &str| {
        let file = format!(
            r#"{{"configVersion": "1.0", "serial": "LKG-2K-00000", "pitch": {{"value": 47.57}}, "slope": {{"value": -5.44}},
            "center": {{"value": 0.041}}, {cone} "DPI": {{"value": 338}}, "screenW": {{"value": 160}}, "screenH": {{"value": 90}}}}"#
        );
        std::fs::write(&panel, file).unwrap();
    };
    let scene =
        ["render", "--series", &series, "--preset", "bone", "--size", "160x90", "--views", "true", "--json"];
    let angle_deg = |more: &[&str]| {
        let report = json_of(&[&scene[..], more].concat())["views"].clone();
        let eyes = report["eyes"].as_array().unwrap();
        let span = eyes.last().unwrap().as_f64().unwrap() - eyes[0].as_f64().unwrap();
        let [baseline_mm, converging_mm] =
            ["baseline_mm", "converging_mm"].map(|key| report[key].as_f64().unwrap());
        2.0 * (span * baseline_mm / 2.0 / converging_mm).atan().to_degrees()
    };
    let (quilt, interlaced, plain) = (path("head_qs3x3a1.778.png"), path("panel.png"), path("plain.png"));
    let lenses = ["--layout", "lenses-9", "--panel", &panel, "--out", &interlaced];
    for (more, cone_deg) in [
        (&["--layout", "views-9", "--view-cone", "20", "--out", &plain][..], 20.0),
        (&["--layout", "views-9", "--view-cone", "53.5", "--depth-range", "volume", "--out", &plain], 53.5),
        (&["--out", &quilt], 35.0),
        (&["--view-cone", "40", "--out", &quilt], 40.0),
    ] {
        let found = angle_deg(more);
        assert!((found - cone_deg).abs() < 1e-6, "{found} for {cone_deg}");
    }
    for (cone, cone_deg) in [(r#""viewCone": {"value": 40},"#, 40.0), ("", 35.0)] {
        calibration(cone);
        let found = angle_deg(&lenses);
        assert!((found - cone_deg).abs() < 1e-6, "{found} for the panel's {cone_deg}");
    }
    // Views of a cone are interpolated by default.
    let fewer = ["render", "--series", &series, "--preset", "bone", "--size", "160x90", "--json", "--out"];
    let made =
        |more: &[&str]| json_of(&[&fewer[..], more].concat())["views"]["rendered"].as_array().map(Vec::len);
    assert_eq!(made(&[&quilt]), Some(2));
    assert_eq!(made(&[&quilt, "--views", "synthesised"]), None);
    assert_eq!(made(&[&plain, "--layout", "views-9"]), None);
    // --view-span overrides the cone of the panel and of the name.
    for output in [&lenses[..], &["--out", &quilt]] {
        assert!(angle_deg(&[output, &["--view-span", "1"]].concat()) < 5.0);
    }
    let both = refusal(&[&scene[..], &["--view-cone", "35", "--view-span", "2", "--out", &quilt]].concat());
    assert!(both.contains("cannot be used with"), "{both}");
    let wide = refusal(&[&scene[..], &["--view-cone", "91", "--out", &quilt]].concat());
    assert!(wide.contains("display.view_cone_deg is 91, allowed: 0 to 90 degrees"), "{wide}");
    let single =
        refusal(&[&fewer[..8], &["--layout", "rgbd", "--out", &plain, "--view-cone", "35"]].concat());
    assert!(single.contains("are for .png files with a layout of views"), "{single}");
    // In a parallel projection default cones are left out, and a given cone is refused.
    calibration("");
    let parallel = [&fewer[..5], &["--fov-deg", "0", "--size", "160x90", "--json", "--out"]].concat();
    json_of(&[&parallel[..], &[&quilt]].concat());
    json_of(&[&parallel[..], &[&interlaced, "--layout", "lenses-9", "--panel", &panel]].concat());
    let flat = refusal(&[&parallel[..], &[&quilt, "--view-cone", "35"]].concat());
    assert!(flat.contains("parallel projection"), "{flat}");
}

/// A frame as any program may have written it: a ball before a wall.
fn frame_file(folder: &Path, settings: &DisplaySettings) -> String {
    let [width, height] = [960, 540];
    let inside = |i: u32| {
        let (x, y) = (f64::from(i % width) - 480.0, f64::from(i / width) - 270.0);
        x.hypot(y) < 150.0
    };
    let pixels = 0..width * height;
    let color: Vec<[u8; 4]> = pixels
        .clone()
        .map(|i| if inside(i) { [220, 80, 40, 255] } else { [(i % 97) as u8, 90, 160, 255] })
        .collect();
    let depth: Vec<f32> = pixels.map(|i| if inside(i) { 120.0 } else { 280.0 }).collect();
    let (wall, wall_mm) = (vec![[1, 255, 2, 255]; color.len()], vec![280.0; color.len()]);
    let picture = Picture::new([width, height], &color, &depth).unwrap().with_back(&wall, &wall_mm).unwrap();
    let limits = DepthLimits::new(100.0, 300.0).unwrap();
    let frame = settings.encoder().unwrap().encode(&picture, limits).unwrap();
    let path = folder.join(format!("{}.png", settings.layout));
    std::fs::write(&path, encode_png(&frame).unwrap()).unwrap();
    path.to_str().unwrap().to_owned()
}

fn views_of(file: &str) -> Vec<Vec<[u8; 3]>> {
    let (frame, report) = read_png(&std::fs::read(file).unwrap()).unwrap();
    report.layout.decode(&frame).unwrap().views.unwrap().pictures().to_vec()
}

#[test]
fn a_frame_file_is_previewed_with_its_headers_factor_and_its_background() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.png").to_str().unwrap().to_owned();
    let preview = |frame: &str, more: &[&str]| {
        json_of(&[&["preview", frame, "--out", &out, "--json"][..], more].concat())
    };
    let of = |layout: Layout, factor: u8| DisplaySettings { layout, factor, ..DisplaySettings::default() };
    let green = |view: &[[u8; 3]]| view.iter().filter(|color| color[1] > 200).count();

    let strong = frame_file(folder.path(), &of(Layout::Wowvx, 160));
    assert_eq!(preview(&strong, &["--layout", "stereo"])["factor"], 160);
    let stereo = views_of(&out);
    assert_eq!((stereo.len(), green(&stereo[0])), (2, 0));
    // The header's bits do not show: above the ball all views are the wall, whose blue is 160
    // everywhere.
    assert!(stereo.iter().all(|view| view[200..700].iter().all(|color| color[2] == 160)));
    assert_eq!(preview(&strong, &["--layout", "stereo", "--factor", "0"])["factor"], 0);
    let flat = views_of(&out);
    assert_eq!(flat[0], flat[1]);

    for layout in [Layout::Declipse, Layout::DeclipseLines] {
        let frame = frame_file(folder.path(), &of(layout, 64));
        preview(&frame, &["--layout", "stereo"]);
        // Two eyes, each half a separation from the middle: the ball's edge is uncovered by some 2
        // px, 300 lines high.
        let behind = views_of(&out).iter().map(|view| green(view)).collect::<Vec<_>>();
        assert!(behind.iter().all(|green| (250..1200).contains(green)), "{layout}: {behind:?}");
    }

    let rgbd = frame_file(folder.path(), &of(Layout::Rgbd, 64));
    preview(&rgbd, &["--layout", "views-5x1"]);
    let strip = views_of(&out);
    assert_eq!(preview(&rgbd, &[])["layout"], "wiggle");
    assert_eq!(decode_wiggle(&std::fs::read(&out).unwrap()).unwrap().pictures().len(), 9);
    // Views of a file become another layout of them.
    preview(&rgbd, &["--layout", "views-5x1"]);
    let quilt = folder.path().join("quilt.png").to_str().unwrap().to_owned();
    std::fs::rename(&out, &quilt).unwrap();
    preview(&quilt, &["--layout", "wiggle"]);
    assert_eq!(decode_wiggle(&std::fs::read(&out).unwrap()).unwrap().pictures(), strip);
    preview(&quilt, &["--layout", "stereo"]);
    assert_eq!(views_of(&out), [strip[0].clone(), strip[4].clone()]);
}

#[test]
fn layouts_without_a_preview_are_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (out, plain) = (path("out.png"), path("plain.png"));
    image::RgbImage::from_pixel(40, 30, image::Rgb([1, 2, 3])).save(&plain).unwrap();
    let preview =
        |frame: &str, more: &[&str]| refusal(&[&["preview", frame, "--out", &out][..], more].concat());
    assert!(preview(&plain, &[]).contains("no disparity beside it"));
    assert!(preview(&plain, &["--layout", "color"]).contains("no layout of views"));
    assert!(preview(&plain, &["--view-span", "99"]).contains("0 to 60 eye separations"));
    assert!(preview(&path("none.png"), &[]).contains("cannot read"));
    // A frame whose header is gone is shown as plain 2D by displays.
    let frame = frame_file(folder.path(), &DisplaySettings::default());
    let mut picture = image::open(&frame).unwrap().into_rgb8();
    for x in 0..512 {
        picture.get_pixel_mut(x, 0).0[2] &= 0x7F;
    }
    picture.save(&frame).unwrap();
    assert!(preview(&frame, &[]).contains("a display shows this as plain 2D"));
    assert!(!Path::new(&out).exists());
    // An anaglyph is recognized, and its views cannot be separated.
    let glasses = path("glasses.png");
    let rgbd =
        frame_file(folder.path(), &DisplaySettings { layout: Layout::Rgbd, ..DisplaySettings::default() });
    json_of(&["preview", &rgbd, "--layout", "anaglyph", "--out", &glasses, "--json"]);
    assert!(preview(&glasses, &[]).contains("cannot be separated"));
    let reported = relief(&["inspect", &glasses]);
    let reported = String::from_utf8(reported.stdout).unwrap();
    assert!(reported.contains("mixed in every pixel: its views cannot be separated"), "{reported}");
}
