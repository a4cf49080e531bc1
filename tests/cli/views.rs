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
    assert!(preview(&plain, &["--view-span", "99"]).contains("0 to 18 eye separations"));
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
