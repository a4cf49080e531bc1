//! `relief batch`, as researchers run it: many series, interrupted runs, bad series among good
//! ones.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]

#[cfg(feature = "full")]
mod access;
mod annotated;
#[cfg(feature = "full")]
mod buckets;
mod dataset;
mod films;
mod interrupted;
mod labels;
mod manifests;
mod query;
#[cfg(feature = "full")]
mod queue;
#[cfg(feature = "full")]
pub(crate) mod services;
mod slurm;
mod time;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

use crate::common;

/// A folder with series, a manifest and outputs.
struct Archive {
    folder: tempfile::TempDir,
}

impl Archive {
    /// An archive of this many small phantoms, all different.
    fn of_phantoms(count: usize) -> Self {
        let archive = Self { folder: tempfile::tempdir().unwrap() };
        for n in 0..count {
            let kind = ["sphere", "slab", "head"][n % 3];
            let size = (24 + 2 * n).to_string();
            let out = archive.path(&format!("series/DOE^JOHN {n}"));
            ok(&relief(&["phantom", "--kind", kind, "--size", &size, "--out", out.to_str().unwrap()]));
        }
        archive
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn text(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_owned()
    }

    /// Plans with colour pictures of 64 x 48 by default.
    fn plan(&self, more: &[&str]) -> Output {
        let (root, out) = (self.text("series"), self.text("jobs.jsonl"));
        let fixed = ["batch", "plan", "--root", &root, "--out", &out, "--preset", "bone", "--size", "64x48"];
        relief(&[&fixed[..], &["--products", "color", "--json"], more].concat())
    }

    fn run_into(&self, out: &str, more: &[&str]) -> Output {
        let (manifest, out) = (self.text("jobs.jsonl"), self.text(out));
        relief(&[&["batch", "run", "--manifest", &manifest, "--out", &out, "--json"], more].concat())
    }

    fn run(&self, more: &[&str]) -> Output {
        self.run_into("out", more)
    }

    fn jobs(&self) -> Vec<Value> {
        let manifest = std::fs::read_to_string(self.path("jobs.jsonl")).unwrap();
        manifest.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }
}

fn relief(arguments: &[&str]) -> Output {
    let program = env!("CARGO_BIN_EXE_relief");
    Command::new(program).args(arguments).env("RELIEF_ADAPTER", "cpu").output().unwrap()
}

fn ok(output: &Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap_or(Value::Null)
}

/// All files below a folder with their bytes.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = walkdir::WalkDir::new(folder).into_iter().map(Result::unwrap);
    let files = entries.filter(|entry| entry.file_type().is_file());
    files
        .map(|entry| {
            let name = entry.path().strip_prefix(folder).unwrap().to_str().unwrap().to_owned();
            (name, std::fs::read(entry.path()).unwrap())
        })
        .collect()
}

/// Only pictures: records and reports contain times.
fn pictures(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = files(folder);
    files.retain(|name, _| name.ends_with(".color.png"));
    files
}

/// Invariant: An interrupted batch leaves complete pictures, and the next run renders only the
/// rest; a further run renders nothing.
#[test]
fn a_batch_renders_what_render_writes_and_a_second_run_renders_nothing() {
    let archive = Archive::of_phantoms(3);
    let planned = ok(&archive.plan(&["--views", "turntable:4,planes"]));
    assert_eq!((&planned["series"], &planned["jobs"]), (&3.into(), &21.into()));
    let ran = ok(&archive.run(&[]));
    assert_eq!((&ran["done"], &ran["skipped"], &ran["series_loaded"]), (&21.into(), &0.into(), &3.into()));
    let made = files(&archive.path("out"));
    assert_eq!(pictures(&archive.path("out")).len(), 21);
    assert!(made.keys().all(|name| !name.contains("DOE")), "a folder's name may be a patient's: {made:?}");

    // The same picture as a single command writes.
    let job = archive.jobs().into_iter().find(|job| job["view"] == "turntable-001").unwrap();
    let single = archive.text("single.png");
    let series = archive.text(job["series"]["path"].as_str().unwrap());
    let fixed = ["render", "--series", &series, "--preset", "bone", "--size", "64x48", "--layout", "color"];
    ok(&relief(&[&fixed[..], &["--azimuth-deg", "90", "--out", &single]].concat()));
    let name = format!("{}/turntable-001.color.png", job["series"]["name"].as_str().unwrap());
    assert!(made[&name] == std::fs::read(&single).unwrap(), "{name} is another picture than relief render's");
    // A slice has the window of the body part, not the preset of the volume's views.
    let fixed = ["render", "--series", &series, "--plane", "axial", "--size", "64x48", "--layout", "color"];
    ok(&relief(&[&fixed[..], &["--out", &single]].concat()));
    let name = format!("{}/axial.color.png", job["series"]["name"].as_str().unwrap());
    assert!(made[&name] == std::fs::read(&single).unwrap(), "{name} is another picture than relief render's");

    let again = ok(&archive.run(&[]));
    assert_eq!(
        (&again["done"], &again["skipped"], &again["series_loaded"]),
        (&0.into(), &21.into(), &0.into())
    );
    assert!(files(&archive.path("out")) == made, "a second run altered something");
}

#[test]
fn a_picture_without_content_is_a_warning_of_run_record_and_report() {
    let archive = Archive::of_phantoms(1);
    let views = archive.text("views.json");
    let far = r#"{"clip": {"box_mm": [[900, 900, 900], [901, 901, 901]]}}"#;
    std::fs::write(&views, format!(r#"[{{"name": "whole"}}, {{"name": "far", "scene": {far}}}]"#)).unwrap();
    ok(&archive.plan(&["--views", &views]));
    let run = archive.run(&[]);
    let said = String::from_utf8_lossy(&run.stderr);
    let warning = "nothing is visible: clip planes, box, sphere or hidden segments remove everything";
    assert_eq!(said.matches("warning: ").count(), 1, "{said}");
    assert!(said.contains("/far: ") && said.contains(warning), "{said}");
    let made = files(&archive.path("out"));
    let with_warning = made.iter().filter(|(_, bytes)| String::from_utf8_lossy(bytes).contains(warning));
    let names: Vec<_> = with_warning.map(|(name, _)| name.rsplit('/').next().unwrap()).collect();
    assert_eq!(names, ["report.html", "far.json"]);
}

#[test]
fn the_report_stands_alone_and_has_sheets_and_turntables() {
    let archive = Archive::of_phantoms(1);
    ok(&archive.plan(&["--views", "turntable:4"]));
    ok(&archive.run(&[]));
    let made = files(&archive.path("out"));
    let page = String::from_utf8(made["report.html"].clone()).unwrap();
    assert!(page.contains("4 of 4 views of 1 series") && !page.contains("DOE"), "{page}");
    assert_eq!(page.matches("data:image/jpeg;base64,").count(), 4);
    assert!(
        !page.contains("http://") && !page.contains("https://"),
        "a page that stands alone loads nothing"
    );
    let folder = archive.path("out").join(archive.jobs()[0]["series"]["name"].as_str().unwrap());
    let sheet = image::open(folder.join("contact-sheet.png")).unwrap();
    assert_eq!(sheet.width(), 4 * (240 + 8) + 8);
    let mut turntable = png::Decoder::new(std::io::BufReader::new(
        std::fs::File::open(folder.join("turntable.png")).unwrap(),
    ))
    .read_info()
    .unwrap();
    assert_eq!(turntable.info().animation_control.unwrap().num_frames, 4);
    for turn in 0..4 {
        let mut samples = vec![0; 3 * 64 * 48];
        turntable.next_frame(&mut samples).unwrap();
        let single = image::open(folder.join(format!("turntable-{turn:03}.color.png"))).unwrap().into_rgb8();
        assert!(samples == single.into_raw(), "picture {turn} of the turntable");
    }
}

/// Each product alone: a batch computes depths only for products that have them.
#[test]
fn frames_and_depth_have_the_depth_of_render() {
    let archive = Archive::of_phantoms(1);
    let (frame, depth) = (archive.text("frame.png"), archive.text("depth.exr"));
    let series = archive.text("series/DOE^JOHN 0");
    let scene = archive.text("scene.json");
    std::fs::write(&scene, r#"{ "depth": { "rule": "threshold", "fraction": 0.9 } }"#).unwrap();
    let look = ["--preset", "skin", "--scene", &scene];
    let render = ["render", "--series", &series, "--out", &frame, "--depth-out", &depth];
    ok(&relief(&[&render[..], &look].concat()));
    let (root, manifest) = (archive.text("series"), archive.text("jobs.jsonl"));
    let plan = ["batch", "plan", "--root", &root, "--out", &manifest, "--views", "turntable:1"];
    for (product, of_render) in [("frame", &frame), ("depth", &depth)] {
        ok(&relief(&[&plan[..], &look, &["--products", product]].concat()));
        ok(&archive.run_into(product, &[]));
        let folder = archive.path(product).join(archive.jobs()[0]["series"]["name"].as_str().unwrap());
        let ending = if product == "frame" { "frame.png" } else { "depth.exr" };
        let made = std::fs::read(folder.join(format!("turntable-000.{ending}"))).unwrap();
        assert!(made == std::fs::read(of_render).unwrap(), "{product}");
    }
}

#[test]
fn frames_and_depth_are_written_where_they_are_wanted() {
    let archive = Archive::of_phantoms(1);
    let (root, out) = (archive.text("series"), archive.text("jobs.jsonl"));
    let plan = ["batch", "plan", "--root", &root, "--out", &out, "--views", "sides", "--preset", "skin"];
    ok(&relief(&[&plan[..], &["--products", "frame,depth"]].concat()));
    ok(&archive.run(&[]));
    let folder = archive.path("out").join(archive.jobs()[0]["series"]["name"].as_str().unwrap());
    let frame = folder.join("anterior.frame.png");
    let inspected = ok(&relief(&["inspect", frame.to_str().unwrap(), "--json"]));
    assert_eq!((&inspected["layout"], &inspected["problems"]), (&"wowvx".into(), &serde_json::json!([])));
    let depth =
        relief_display::decode_exr(&std::fs::read(folder.join("anterior.depth.exr")).unwrap()).unwrap();
    assert_eq!(depth.size_px, [960, 540]);
    assert!(depth.depth_mm.iter().any(|mm| mm.is_finite()), "something is seen");
}
