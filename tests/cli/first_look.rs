//! The defaults of `relief render`: the anatomy fills the picture and the display's depth, the
//! table is left out, and an empty picture has a warning that says why.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::path::Path;
use std::process::{Command, Output};

use crate::common::unpacked;

fn relief(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
    command.args(arguments).env("RELIEF_ADAPTER", "cpu").output().unwrap()
}

/// Renders a series in colour, and returns what was said and the picture.
fn picture(series: &str, out: &Path, more: &[&str]) -> (String, image::RgbImage) {
    let given = [
        "render",
        "--series",
        series,
        "--layout",
        "color",
        "--size",
        "240x136",
        "--out",
        out.to_str().unwrap(),
    ];
    let output = relief(&[&given[..], more].concat());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{more:?}: {said}");
    (said, image::open(out).unwrap().into_rgb8())
}

/// The shares of width and height between the outermost lit pixels.
fn covered(picture: &image::RgbImage) -> [f64; 2] {
    let lit = picture.enumerate_pixels().filter(|(.., pixel)| pixel.0.iter().any(|channel| *channel > 24));
    let ends = lit.fold([[u32::MAX, 0]; 2], |[across, down], (x, y, _)| {
        [[across[0].min(x), across[1].max(x)], [down[0].min(y), down[1].max(y)]]
    });
    let (width, height) = picture.dimensions();
    [0, 1].map(|axis| f64::from(ends[axis][1] + 1 - ends[axis][0]) / f64::from([width, height][axis]))
}

/// Z of the pixels before the far limit, 65535 nearest.
fn surfaces(series: &str, preset: &str, range: &str, out: &Path) -> Vec<u16> {
    let look = ["--preset", preset, "--layout", "depth16", "--size", "240x136", "--depth-range", range];
    let given = ["render", "--series", series, "--out", out.to_str().unwrap()];
    assert!(relief(&[&given[..], &look].concat()).status.success());
    let image::DynamicImage::ImageLuma16(z) = image::open(out).unwrap() else { panic!("16 bits") };
    z.into_raw().into_iter().filter(|z| *z > 0).collect()
}

/// Invariant: Without options a series fills 80 to 95 % of the limiting side, and its surfaces at
/// least 90 % of the display's depth.
#[test]
fn real_series_fill_the_picture_and_the_depth() {
    const WHAT: &str = "the first look at real series";
    let folder = tempfile::tempdir().unwrap();
    let (out, depth) = (folder.path().join("out.png"), folder.path().join("depth.png"));
    for name in ["crlm-ct-1004", "totalseg-abdomen-j2k", "phantom-skull-5mm", "sts-001-thigh"] {
        let Some(data) = unpacked(WHAT, name, &[]) else { continue };
        let series = data.to_str().unwrap();
        for preset in ["bone", "skin"] {
            let (_, shown) = picture(series, &out, &["--preset", preset]);
            let side = covered(&shown).into_iter().fold(0.0, f64::max);
            assert!((0.8..0.96).contains(&side), "{name}, {preset}: {side}");
            // Beyond the far limit Z is 0, as of background: how many surfaces there are in all is seen
            // with the volume's limits.
            let [all, shown] = ["volume", "visible"].map(|range| surfaces(series, preset, range, &depth));
            let mut z = vec![0; all.len().saturating_sub(shown.len())];
            z.extend(shown);
            z.sort_unstable();
            let at = |share: f64| f64::from(z[(share * (z.len() - 1) as f64) as usize]) / 65535.0;
            assert!(at(0.99) - at(0.01) > 0.9, "{name}, {preset}: {} to {}", at(0.01), at(0.99));
        }
    }
}

/// Body parts of the public collections that the series come from.
#[test]
fn real_series_get_the_preset_and_the_window_of_their_body_part() {
    const WHAT: &str = "presets chosen for real series";
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.png");
    for (name, preset, window) in [
        ("lidc-idri-0314", "skin-and-bone for a chest without", "-550,1500"),
        ("crlm-ct-1004", "kidneys for an abdomen with", "40,400"),
        ("totalseg-abdomen-j2k", "skin-and-bone for an abdomen without", "40,400"),
        ("sts-001-thigh", "skin-and-bone for a limb without", "40,400"),
        ("head-ge-varspacing-tilt", "bone for a head without", "40,80"),
        ("phantom-skull-5mm", "bone for bones without soft tissue", "500,2500"),
        ("catphan504-cbct", "skin for no body part", "40,400"),
    ] {
        let Some(data) = unpacked(WHAT, name, &[]) else { continue };
        let series = data.to_str().unwrap();
        let said = |more: &[&str]| {
            let out = out.to_str().unwrap();
            let given = ["render", "--series", series, "--size", "64x36", "--layout", "color", "--out", out];
            let output = relief(&[&given[..], more].concat());
            assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
            String::from_utf8(output.stdout).unwrap()
        };
        let volume = said(&[]);
        assert!(volume.starts_with(&format!("preset {preset}")), "{name}: {volume}");
        let slice = said(&["--mode", "slice", "--plane", "axial"]);
        assert!(slice.starts_with(&format!("window {window} HU for ")), "{name}: {slice}");
        if name == "sts-001-thigh" {
            assert!(!said(&["--preset", "bone"]).contains("preset"), "{name}: a given preset has no reason");
        }
    }
}

#[test]
fn a_picture_without_content_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let (series, out, scene) =
        (folder.path().join("head"), folder.path().join("out.png"), folder.path().join("s.json"));
    let series = series.to_str().unwrap();
    assert!(relief(&["phantom", "--kind", "sphere", "--size", "32", "--out", series]).status.success());
    for (json, says) in [
        (
            r#"{"transfer":{"points":[{"hu":2900,"rgba":[1,1,1,0]},{"hu":3000,"rgba":[1,1,1,1]}]}}"#,
            "shows no value of the volume",
        ),
        (
            r#"{"transfer":"bone","clip":{"box_mm":[[900,900,900],[901,901,901]]}}"#,
            "remove everything that is visible",
        ),
        (
            r#"{"transfer":"bone","camera":{"eye_mm":[0,-900,0],"look_at_mm":[0,-950,0],"up":[0,0,1],"projection":{"perspective":{"vertical_fov_deg":20}}}}"#,
            "misses the volume",
        ),
        (r#"{"transfer":"bone","display":{"near_mm":1,"far_mm":2}}"#, "the picture has no depth"),
        (r#"{"transfer":"bone"}"#, ""),
    ] {
        std::fs::write(&scene, json).unwrap();
        let (said, _) = picture(series, &out, &["--scene", scene.to_str().unwrap()]);
        assert!(if says.is_empty() { said.is_empty() } else { said.contains(says) }, "{json}: {said}");
    }
}

/// Invariant: A layout takes the size of the scene where it takes any, and says so where it needs
/// another.
#[test]
fn the_size_of_a_scene_is_kept_or_a_warning_is_given() {
    let folder = tempfile::tempdir().unwrap();
    let [series, out, scene] =
        ["head", "out.png", "s.json"].map(|name| folder.path().join(name).to_str().unwrap().to_owned());
    assert!(relief(&["phantom", "--kind", "sphere", "--size", "16", "--out", &series]).status.success());
    std::fs::write(&scene, r#"{"size_px":[480,270],"transfer":"bone"}"#).unwrap();
    for (layout, size, says) in
        [("color", (480, 270), ""), ("wowvx", (1920, 1080), "layout wowvx needs 960x540")]
    {
        let output =
            relief(&["render", "--series", &series, "--scene", &scene, "--layout", layout, "--out", &out]);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(
            output.status.success() && said.contains(says) && said.is_empty() == says.is_empty(),
            "{said}"
        );
        assert_eq!(image::image_dimensions(&out).unwrap(), size, "{layout}");
    }
}
