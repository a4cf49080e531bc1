//! `relief golden` as developers run it, in its own folders: statuses, files, output, and which
//! command writes.
//!
//! Most of it needs a software adapter. With `RELIEF_REQUIRE_ADAPTER=1` a missing one fails;
//! otherwise a test says that it skipped.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test may panic and talk, in its helpers too")]

use crate::common;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use common::software_adapter;
use serde_json::Value;

/// A folder with cases, and room for the pictures of failures.
struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    /// Copies of these cases, with their goldens.
    fn with(cases: &[&str]) -> Self {
        let place = Self { folder: tempfile::tempdir().unwrap() };
        for case in cases {
            let (from, to) =
                (Path::new(env!("CARGO_MANIFEST_DIR")).join("golden").join(case), place.case(case));
            fs::create_dir_all(&to).unwrap();
            for entry in fs::read_dir(from).unwrap() {
                let path = entry.unwrap().path();
                fs::copy(&path, to.join(path.file_name().unwrap())).unwrap();
            }
        }
        place
    }

    fn case(&self, case: &str) -> PathBuf {
        self.folder.path().join("golden").join(case)
    }

    fn left_by(&self, case: &str) -> PathBuf {
        self.folder.path().join("target/golden").join(case)
    }

    /// Runs `relief golden` in the place.
    fn golden(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
        command.arg("golden").args(arguments).current_dir(self.folder.path());
        command.env_remove("RELIEF_ADAPTER").env_remove("RELIEF_LOG");
        command
    }

    /// Moves the red of one pixel of a golden by 128.
    fn spoil(&self, file: &str) {
        let path = self.case(file);
        let mut picture = image::open(&path).unwrap().into_rgba8();
        picture.get_pixel_mut(20, 10).0[0] ^= 128;
        picture.save(&path).unwrap();
    }
}

fn said(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

#[test]
fn a_missing_golden_fails_and_nothing_but_bless_writes_it() {
    if software_adapter("a_missing_golden_fails").is_none() {
        return;
    }
    let place = Place::with(&["composite/ramp-planes"]);
    let golden = place.case("composite/ramp-planes/color.png");
    let approved = fs::read(&golden).unwrap();
    fs::remove_file(&golden).unwrap();
    let checked = place.golden(&["check"]);
    assert_eq!(checked.status.code(), Some(1), "{}", said(&checked));
    assert!(said(&checked).contains("color.png is missing"), "{}", said(&checked));
    assert!(said(&checked).contains("relief golden bless composite/ramp-planes"), "{}", said(&checked));
    assert!(!golden.exists(), "check writes no golden");
    assert!(place.left_by("composite/ramp-planes/actual.png").exists());
    let blessed = place.golden(&["bless", "composite/ramp-planes"]);
    assert!(blessed.status.success() && said(&blessed).contains("is new"), "{}", said(&blessed));
    assert_eq!(fs::read(&golden).unwrap(), approved, "the same picture makes the same file");
    let checked = place.golden(&["check"]);
    assert!(checked.status.success(), "{}", said(&checked));
    assert!(!place.left_by("composite/ramp-planes").exists(), "what passes leaves nothing");
}

#[test]
fn a_spoilt_golden_leaves_pictures_numbers_and_a_page() {
    if software_adapter("a_spoilt_golden_leaves_pictures_numbers_and_a_page").is_none() {
        return;
    }
    let place = Place::with(&["composite/ramp-planes", "display/rgbd"]);
    place.spoil("composite/ramp-planes/color.png");
    let output = place.golden(&["check"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("1 of 2 golden images are as expected"), "{}", said(&output));
    let left = |name: &str| place.left_by("composite/ramp-planes").join(name);
    let open = |name: &str| image::open(left(name)).unwrap().into_rgb8();
    let (expected, actual, difference) = (open("expected.png"), open("actual.png"), open("difference.png"));
    let differs = |x, y| expected.get_pixel(x, y) != actual.get_pixel(x, y);
    for (x, y, pixel) in difference.enumerate_pixels() {
        assert_eq!(pixel.0 != [0; 3], differs(x, y), "column {x}, row {y}");
        assert_eq!(differs(x, y), (x, y) == (20, 10), "column {x}, row {y}");
    }
    assert!(difference.get_pixel(20, 10).0[0] > 200, "the difference is magnified");
    let numbers: Value = serde_json::from_slice(&fs::read(left("numbers.json")).unwrap()).unwrap();
    let color = &numbers["aspects"][0]["comparison"]["difference"]["color"];
    assert_eq!((&color["differing"], &color["max_steps"]), (&1.into(), &128.into()), "{numbers}");
    assert_eq!(color["worst_at"], serde_json::json!([20, 10]));
    assert_eq!(numbers["bless"], "relief golden bless composite/ramp-planes");
    assert_eq!(numbers["adapter"]["kind"], "software");
    let depth = &numbers["aspects"][1]["comparison"]["difference"]["depth"];
    assert_eq!(depth["differing"], 0, "the depth is as it was");
    let page = fs::read_to_string(place.folder.path().join("target/golden/index.html")).unwrap();
    for part in [
        "composite/ramp-planes/expected.png",
        "composite/ramp-planes/actual.png",
        "composite/ramp-planes/depth-difference.png",
        "1 of 2",
    ] {
        assert!(page.contains(part), "{part} is not on the page");
    }
    assert!(!page.contains("display/rgbd"), "what passed is not shown");
}

#[test]
fn the_page_shows_only_pictures_that_are_there() {
    if software_adapter("the_page_shows_only_pictures_that_are_there").is_none() {
        return;
    }
    let place = Place::with(&["composite/ramp-planes", "display/rgbd", "clip/box"]);
    place.spoil("composite/ramp-planes/color.png");
    fs::remove_file(place.case("display/rgbd/frame.png")).unwrap();
    fs::copy(place.case("composite/ramp-planes/depth.exr"), place.case("clip/box/depth.exr")).unwrap();
    assert_eq!(place.golden(&["check"]).status.code(), Some(1));
    let root = place.folder.path().join("target/golden");
    let page = fs::read_to_string(root.join("index.html")).unwrap();
    let sources: Vec<&str> =
        page.split("src=\"").skip(1).map(|rest| rest.split('"').next().unwrap()).collect();
    assert_eq!(sources.len(), 6 + 1 + 6, "{sources:?}");
    for source in sources {
        image::open(root.join(source)).unwrap_or_else(|error| panic!("{source}: {error}"));
    }
}

#[test]
fn json_says_the_same() {
    if software_adapter("json_says_the_same").is_none() {
        return;
    }
    let place = Place::with(&["composite/ramp-planes", "display/rgbd"]);
    place.spoil("composite/ramp-planes/color.png");
    let output = place.golden(&["check", "--json"]);
    assert_eq!(output.status.code(), Some(1));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let verdicts: Vec<_> =
        report["cases"].as_array().unwrap().iter().map(|c| (&c["case"], &c["verdict"])).collect();
    assert_eq!(
        verdicts,
        [(&"composite/ramp-planes".into(), &"failed".into()), (&"display/rgbd".into(), &"identical".into())]
    );
    let output = place.golden(&["check", "--json", "display"]);
    assert!(output.status.success(), "only the suite that was asked for: {}", said(&output));
}

#[test]
fn a_case_that_cannot_be_read_fails_and_the_others_are_compared() {
    if software_adapter("a_case_that_cannot_be_read_fails").is_none() {
        return;
    }
    let place = Place::with(&["composite/ramp-planes", "mip/axes"]);
    let file = place.case("mip/axes/case.toml");
    let text = fs::read_to_string(&file).unwrap();
    fs::write(&file, format!("known_failure = true\n{text}")).unwrap();
    let output = place.golden(&["check"]);
    assert_eq!(output.status.code(), Some(1));
    let said = said(&output);
    assert!(
        said.contains("known_failure") && said.contains("1 of 2 golden images are as expected"),
        "{said}"
    );
}

#[test]
fn bless_replaces_what_differs_and_says_by_how_much() {
    if software_adapter("bless_replaces_what_differs").is_none() {
        return;
    }
    let place = Place::with(&["composite/ramp-planes"]);
    let approved = fs::read(place.case("composite/ramp-planes/color.png")).unwrap();
    place.spoil("composite/ramp-planes/color.png");
    let output = place.golden(&["bless", "--all"]);
    let said = said(&output);
    assert!(said.contains("changes: 1 of 12288 pixels, the most by 128/255"), "{said}");
    assert!(said.contains("depth.exr stays"), "{said}");
    assert_eq!(fs::read(place.case("composite/ramp-planes/color.png")).unwrap(), approved);
}

#[test]
fn a_picture_that_shows_nothing_is_not_blessed() {
    if software_adapter("a_picture_that_shows_nothing_is_not_blessed").is_none() {
        return;
    }
    let place = Place::with(&["clip/box"]);
    let scene = place.case("clip/box/scene.json");
    let text = fs::read_to_string(&scene)
        .unwrap()
        .replace("\"look_at_mm\": [0, 0, 0]", "\"look_at_mm\": [-300, -900, 0]");
    fs::write(&scene, text).unwrap();
    let before = fs::read(place.case("clip/box/color.png")).unwrap();
    let output = place.golden(&["bless", "--all"]);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(said(&output).contains("shows nothing"), "{}", said(&output));
    assert_eq!(fs::read(place.case("clip/box/color.png")).unwrap(), before);
}

#[test]
fn nothing_to_compare_fails() {
    let place = Place { folder: tempfile::tempdir().unwrap() };
    for (arguments, part) in
        [(&["check"][..], "golden"), (&["check", "--dir", "."], "contains no golden case")]
    {
        let output = place.golden(arguments);
        assert_eq!(output.status.code(), Some(1), "{}", said(&output));
        assert!(said(&output).contains(part), "{}", said(&output));
    }
    let place = Place::with(&["composite/ramp-planes"]);
    let output = place.golden(&["check", "composite/ramp-planese"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("composite/ramp-planese"), "{}", said(&output));
}

#[test]
fn bless_wants_to_know_what() {
    let place = Place::with(&["composite/ramp-planes"]);
    for arguments in [&["bless"][..], &["bless", "--all", "mip"], &[]] {
        assert_eq!(place.golden(arguments).status.code(), Some(2), "{arguments:?}");
    }
}

#[test]
#[cfg(target_os = "linux")]
fn a_missing_adapter_fails() {
    let place = Place::with(&["composite/ramp-planes"]);
    let mut command = place.command(&["check"]);
    command
        .env("VK_DRIVER_FILES", "/nonexistent/icd.json")
        .env("VK_ADD_DRIVER_FILES", "")
        .env("VK_ICD_FILENAMES", "");
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(said(&output).contains("no graphics adapter"), "{}", said(&output));
}

/// A project that has no cases yet: from the first command to a failure, without a driver.
#[test]
fn another_project_begins_with_a_phantom_or_with_its_own_series() {
    let place = Place { folder: tempfile::tempdir().unwrap() };
    let text = |output: &Output| {
        format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
    };
    let run = |arguments: &[&str]| {
        let output = place.golden(arguments);
        (output.status.success(), text(&output))
    };
    let phantom = Command::new(env!("CARGO_BIN_EXE_relief"))
        .args(["phantom", "--kind", "sphere", "--size", "32", "--out", "data/ball"])
        .current_dir(place.folder.path())
        .output()
        .unwrap();
    assert!(phantom.status.success(), "{}", text(&phantom));
    for (dir, series) in [("golden", None), ("pictures/ct", Some("data/ball"))] {
        let init = ["init", "--dir", dir];
        let (begun, told) = run(&[&init[..], &series.map_or(vec![], |path| vec!["--series", path])].concat());
        assert!(begun && told.contains("bless --all"), "{told}");
        let place_and_adapter = ["--dir", dir, "--adapter", "cpu"];
        let (passed, told) = run(&[&["check"], &place_and_adapter[..]].concat());
        assert!(!passed && told.contains("FAILED"), "there is no golden yet: {told}");
        let (blessed, told) = run(&[&["bless", "--all"], &place_and_adapter[..]].concat());
        assert!(blessed && told.contains("color.png is new"), "{told}");
        let (passed, told) = run(&[&["check"], &place_and_adapter[..]].concat());
        assert!(passed && told.contains("1 of 1 golden images are as expected"), "{told}");
        // Another scene is another picture.
        let scene = place.folder.path().join(dir).join("first/front/scene.json");
        fs::write(&scene, fs::read_to_string(&scene).unwrap().replace("bone", "skin")).unwrap();
        let (passed, told) = run(&[&["check"], &place_and_adapter[..]].concat());
        assert!(!passed && told.contains("relief golden bless"), "{told}");
        let (again, told) = run(&init);
        assert!(!again && told.contains("has cases already"), "{told}");
    }
    let (begun, told) = run(&["init", "--dir", "other", "--series", "data/none"]);
    assert!(!begun && told.contains("there is no series at data/none"), "{told}");
    // A series that is gone is a finding of the case, with its path.
    fs::remove_dir_all(place.folder.path().join("data")).unwrap();
    let (passed, told) = run(&["check", "--dir", "pictures/ct", "--adapter", "cpu"]);
    assert!(!passed && told.contains("the series at") && told.contains("data/ball"), "{told}");
    let case = place.folder.path().join("pictures/ct/first/front/case.toml");
    for (volume, reason) in [
        ("phantom = \"head\"", "volume.size is missing"),
        ("phantom = \"head\"\nsize = 400", "at most 128"),
        ("series = \"x\"\nsize = 4", "these beside phantom"),
        ("seed = 4", "neither or both of phantom and series"),
    ] {
        let text =
            format!("purpose = \"x\"\ntolerance = \"exact\"\ncompare = [\"color\"]\n[volume]\n{volume}\n");
        fs::write(&case, text).unwrap();
        let (passed, told) = run(&["check", "--dir", "pictures/ct", "--adapter", "cpu"]);
        assert!(!passed && told.contains(reason), "{reason}: {told}");
    }
}
