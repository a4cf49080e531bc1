//! `relief render --labels`, as users run it: organs of the procedural head, kept and cut by name;
//! a volume without DICOM; refusals.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]

use std::path::Path;
use std::process::{Command, Output};

fn relief(arguments: &[&str]) -> Output {
    let program = env!("CARGO_BIN_EXE_relief");
    Command::new(program).args(arguments).env("RELIEF_ADAPTER", "cpu").output().unwrap()
}

fn head(folder: &Path) -> [String; 2] {
    let place = folder.join("head").to_str().unwrap().to_owned();
    let made = relief(&["phantom", "--size", "48", "--out", &place]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let labels = format!("{place}/labels.seg.nrrd");
    assert!(Path::new(&labels).is_file());
    [place, labels]
}

#[test]
fn organs_of_the_head_are_kept_and_cut_by_name_and_number() {
    let folder = tempfile::tempdir().unwrap();
    let [series, labels] = head(folder.path());
    let picture = |more: &[&str]| {
        let out = folder.path().join("out.png");
        let given = [
            "render",
            "--series",
            &series,
            "--preset",
            "soft-tissue",
            "--layout",
            "color",
            "--size",
            "96x96",
            "--frame",
            "volume",
        ];
        let output = relief(&[&given[..], &["--out", out.to_str().unwrap()], more].concat());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success() && said.is_empty(), "{more:?}: {said}");
        image::open(out).unwrap().into_rgb8().into_raw()
    };
    let lit =
        |picture: &[u8]| picture.chunks(3).filter(|rgb| rgb.iter().any(|channel| *channel > 20)).count();
    let plain = picture(&[]);
    let tinted = picture(&["--labels", &labels]);
    assert_ne!(plain, tinted, "organs are tinted where nothing else is said");
    assert_eq!(picture(&["--labels", &labels, "--label-tint", "0"]), plain);
    let brain = picture(&["--labels", &labels, "--keep-labels", "brain"]);
    assert!(lit(&brain) > 100 && 3 * lit(&brain) < 2 * lit(&plain), "{} of {}", lit(&brain), lit(&plain));
    assert_eq!(picture(&["--labels", &labels, "--keep-labels", "5"]), brain);
    let without = picture(&["--labels", &labels, "--cut-labels", "0,1,2,3,4,6,7,8,9,10"]);
    assert_eq!(without, brain);
    // The map as a volume: its values are labels, not HU, but it is a volume all the same.
    let out = folder.path().join("volume.png");
    let window = ["--window-hu", "5,10", "--layout", "color", "--size", "96x96", "--plane", "axial"];
    let shown = [&["render", "--series", &labels, "--out", out.to_str().unwrap()], &window[..]].concat();
    assert!(relief(&shown).status.success());
}

#[test]
fn invalid_label_maps_and_those_of_other_grids_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [series, labels] = head(folder.path());
    let refused = |labels: &str, more: &[&str]| {
        let out = folder.path().join("never.png");
        let given = ["render", "--series", &series, "--labels", labels, "--out", out.to_str().unwrap()];
        let output = relief(&[&given[..], more].concat());
        assert_eq!(output.status.code(), Some(1));
        assert!(!out.exists());
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let truth = format!("{series}/truth.json");
    assert!(refused(&truth, &[]).contains("neither NIfTI nor NRRD nor a usable DICOM segmentation"));
    assert!(refused(&series, &[]).contains("is a folder"));
    assert!(refused("nowhere.nii.gz", &[]).contains("nowhere.nii.gz"));
    assert!(refused(&labels, &["--cut-labels", "liver"]).contains("clip.labels.cut[0] is \"liver\""));
    let mut bytes = std::fs::read(&labels).unwrap();
    let header = bytes.windows(2).position(|pair| pair == b"\n\n").unwrap();
    let moved = String::from_utf8(bytes[..header].to_vec()).unwrap();
    let from = moved.find("space origin: (").unwrap();
    let to = from + moved[from..].find('\n').unwrap();
    bytes.splice(from..to, *b"space origin: (9000,0,0)");
    let elsewhere = folder.path().join("elsewhere.seg.nrrd");
    std::fs::write(&elsewhere, bytes).unwrap();
    let said = refused(elsewhere.to_str().unwrap(), &[]);
    assert!(said.contains("do not overlap") && said.contains("the same scan?"), "{said}");
    let several = relief(&["serve", "--series", &series, "--labels", &labels, "--labels", &labels]);
    assert!(String::from_utf8_lossy(&several.stderr).contains("2 --labels for 1 --series"));
}
