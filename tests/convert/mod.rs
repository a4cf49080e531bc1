//! `relief convert`: plain pictures and films as 2D-plus-depth frames.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(
    clippy::print_stderr,
    reason = "a test that cannot run says so aloud, and figures belong to the log"
)]

mod accuracy;
mod films;
mod networks;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::common::ffmpeg::ffmpeg;

fn relief(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
    command.args(arguments).env("RELIEF_ADAPTER", "cpu").output().unwrap()
}

fn ok(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The output of a command that fails.
fn refusal(arguments: &[&str]) -> String {
    let output = relief(arguments);
    assert!(!output.status.success(), "{arguments:?} succeeded");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A picture with a bright square on a ramp.
fn picture(size_px: [u32; 2], square_at: u32) -> image::RgbImage {
    image::RgbImage::from_fn(size_px[0], size_px[1], |x, y| {
        let inside =
            x.wrapping_sub(square_at) < size_px[0] / 4 && y.wrapping_sub(size_px[1] / 3) < size_px[1] / 3;
        if inside {
            image::Rgb([230, 200, 170])
        } else {
            image::Rgb([(x * 80 / size_px[0]) as u8, 20, (y % 50) as u8])
        }
    })
}

fn saved(folder: &Path, name: &str, picture: &image::RgbImage) -> PathBuf {
    let path = folder.join(name);
    picture.save(&path).unwrap();
    path
}

/// The report of `relief inspect`.
fn inspected(frame: &Path) -> serde_json::Value {
    serde_json::from_str(&ok(&relief(&["inspect", "--json", text(frame)]))).unwrap()
}

#[test]
fn a_picture_becomes_a_frame_that_decodes_to_it() {
    let folder = tempfile::tempdir().unwrap();
    let source = picture([960, 540], 300);
    let (path, out) = (saved(folder.path(), "plain.png", &source), folder.path().join("frame.png"));
    let said =
        ok(&relief(&["convert", text(&path), "--estimate-depth", "--factor", "96", "--out", text(&out)]));
    assert!(said.contains("1 frame, layout wowvx"), "{said}");
    let report = inspected(&out);
    assert_eq!(report["problems"].as_array().map(Vec::len), Some(0), "{report}");
    assert_eq!((&report["content"], &report["factor"]), (&"still".into(), &96.into()));
    let frame = image::open(&out).unwrap().into_rgb8();
    for (x, y, pixel) in source.enumerate_pixels().filter(|(_, y, _)| *y > 0) {
        assert_eq!(frame.get_pixel(x, 2 * y), pixel, "at {x}, {y}");
    }
}

#[test]
fn a_picture_of_other_proportions_is_fitted_and_its_margin_is_background() {
    let folder = tempfile::tempdir().unwrap();
    let path = saved(folder.path(), "square.png", &picture([300, 300], 80));
    let out = folder.path().join("frame.png");
    ok(&relief(&["convert", text(&path), "--estimate-depth", "--out", text(&out)]));
    let frame = image::open(&out).unwrap().into_rgb8();
    assert_eq!(frame.dimensions(), (1920, 1080));
    let disparity = |x: u32, y: u32| frame.get_pixel(960 + x, 2 * y).0[0];
    for y in (2..540).step_by(50) {
        assert_eq!(frame.get_pixel(100, 2 * y).0, [0; 3], "the margin is black");
        assert_eq!(disparity(100, y), disparity(900, y), "the margins have the depth of the background");
        assert!(disparity(100, y) <= disparity(480, y));
    }
    let any = folder.path().join("any.png");
    ok(&relief(&["convert", text(&path), "--estimate-depth", "--layout", "rgbd", "--out", text(&any)]));
    assert_eq!(image::open(&any).unwrap().into_rgb8().dimensions(), (600, 300), "rgbd takes any size");
}

/// A JPEG with an EXIF orientation (EXIF 2.32, 4.6.4).
fn with_orientation(jpeg: &[u8], orientation: u8) -> Vec<u8> {
    let mut exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
    exif.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
    let length = (exif.len() as u16 + 2).to_be_bytes();
    [&jpeg[..2], &[0xff, 0xe1], &length, &exif, &jpeg[2..]].concat()
}

#[test]
fn a_picture_is_turned_as_its_exif_says() {
    use image::imageops::{flip_horizontal, rotate90, rotate180, rotate270};
    let folder = tempfile::tempdir().unwrap();
    let path = saved(folder.path(), "plain.jpg", &picture([96, 64], 30));
    let plain = std::fs::read(&path).unwrap();
    let stored = image::open(&path).unwrap().into_rgb8();
    let turned = folder.path().join("turned.jpg");
    let out = folder.path().join("frame.png");
    for (orientation, shown) in [
        (2, flip_horizontal(&stored)),
        (3, rotate180(&stored)),
        (6, rotate90(&stored)),
        (8, rotate270(&stored)),
    ] {
        std::fs::write(&turned, with_orientation(&plain, orientation)).unwrap();
        let convert = ["convert", text(&turned), "--estimate-depth", "--layout", "rgbd", "--out", text(&out)];
        ok(&relief(&convert));
        let frame = image::open(&out).unwrap().into_rgb8();
        assert_eq!(frame.dimensions(), (2 * shown.width(), shown.height()), "{orientation}");
        let color = image::imageops::crop_imm(&frame, 0, 0, shown.width(), shown.height()).to_image();
        assert!(color == shown, "{orientation}");
    }
}

#[test]
fn what_cannot_be_converted_is_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let path = saved(folder.path(), "plain.png", &picture([64, 48], 10));
    let (plain, out) = (text(&path), folder.path().join("frame.png"));
    let out = text(&out);
    for (arguments, reason) in [
        (vec!["convert", plain, "--out", out], "--estimate-depth"),
        (vec!["convert", plain, "--estimate-depth", "--out", "x.mkv"], "one picture makes no film"),
        (vec!["convert", plain, "--estimate-depth", "--layout", "color", "--out", out], "has no depth"),
        (
            vec!["convert", plain, "--estimate-depth", "--layout", "declipse", "--out", out],
            "background layer",
        ),
        (vec!["convert", "no-such", "--estimate-depth", "--out", out], "no such file"),
        (vec!["convert", text(folder.path()), "--estimate-depth", "--out", out], "name a folder"),
    ] {
        let said = refusal(&arguments);
        assert!(said.contains(reason), "{arguments:?}: {said}");
    }
    std::fs::write(&path, &std::fs::read(&path).unwrap()[..60]).unwrap();
    assert!(refusal(&["convert", plain, "--estimate-depth", "--out", out]).contains("cannot read"));
    assert!(!Path::new(out).exists());
}
