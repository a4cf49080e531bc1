//! `relief annotate import` and `export`: one edit or none, and files that come back as they went.

use std::path::{Path, PathBuf};
use std::process::Output;

use serde_json::Value;

use super::{TEXTS, asymmetric, common, everything, read, same, write};
use relief_annotation::Item;
use relief_exchange::Format;

/// A folder with a log in it, perhaps.
struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn file(&self, name: &str, bytes: impl AsRef<[u8]>) -> String {
        std::fs::write(self.path(name), bytes).unwrap();
        self.path(name).display().to_string()
    }

    fn run(&self, arguments: &[&str]) -> Output {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_relief"));
        command.env_remove("RELIEF_AUTHOR").env_remove("RELIEF_ANNOTATIONS").env("USER", "anna");
        command.args(["annotate", "--db"]).arg(self.path("ann.db")).args(arguments).output().unwrap()
    }

    /// The output of a command with `--json`.
    fn json(&self, arguments: &[&str]) -> Value {
        let output = self.run(&[arguments, &["--json"]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    }

    fn items(&self) -> Vec<Item> {
        if !self.path("ann.db").exists() {
            return Vec::new();
        }
        let listed = self.json(&["list"]);
        let item = |found: &Value| serde_json::from_value(found["item"].clone()).unwrap();
        listed["items"].as_array().unwrap().iter().map(item).collect()
    }
}

fn error(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(1));
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn several_files_are_one_edit_that_undo_takes_back() {
    let bench = Bench::new();
    let markups = bench.file("skull.mrk.json", write(Format::MrkJson, &everything()).unwrap().bytes);
    let table = bench.file("ears.csv", write(Format::Csv, &asymmetric()).unwrap().bytes);
    let dry = bench.json(&["import", &markups, &table, "--dry-run"]);
    assert_eq!((&dry["created"], &dry["dry_run"]), (&13.into(), &true.into()));
    assert!(!bench.path("ann.db").exists(), "a dry run makes no log");
    let report = bench.json(&[
        "import",
        &markups,
        &table,
        "--set",
        "first",
        "--author",
        "ben",
        "--reason",
        "session 1",
    ]);
    assert_eq!((&report["created"], &report["files"][1]["format"]), (&13.into(), &"csv".into()));
    let items = bench.items();
    assert_eq!(items.len(), 13);
    assert!(items.iter().all(|item| item.set == "first"));
    let ears = items.iter().find(|item| item.name == "left ear").unwrap();
    assert_eq!((ears.list.as_str(), ears.author.as_str()), ("ears", "ben"));
    let nasion = items.iter().find(|item| item.name == "nasion" && item.list == "skull").unwrap();
    assert_eq!(nasion.author, "anna", "a file of ours says who made it");
    let events = bench.json(&["log"]);
    let events = events["events"].as_array().unwrap();
    assert!(
        events
            .iter()
            .all(|event| event["edit"] == 1 && event["author"] == "ben" && event["reason"] == "session 1")
    );
    bench.json(&["undo", "--author", "ben"]);
    assert_eq!(bench.items(), []);
}

/// Invariant: An annotation file is imported completely or not at all, and LPS and RAS are
/// distinguished in every format.
#[test]
fn a_damaged_file_among_others_changes_nothing() {
    let bench = Bench::new();
    let good = bench.file("good.csv", write(Format::Csv, &asymmetric()).unwrap().bytes);
    let bad = bench.file("bad.fcsv", "# CoordinateSystem = LPS\n# columns = id,x,y,z,label\n1,2,x,4,a\n");
    let said = error(&bench.run(&["import", &good, &bad]));
    assert!(said.contains("bad.fcsv") && said.contains("line 3, column y is \"x\""), "{said}");
    assert!(!bench.path("ann.db").exists(), "nothing was made");
    bench.json(&["import", &good]);
    let before = bench.json(&["log"]);
    error(&bench.run(&["import", &good, &bad]));
    assert_eq!(bench.json(&["log"]), before);
    let unknown = bench.file("points.txt", "1 2 3");
    let said = error(&bench.run(&["import", &unknown]));
    assert!(said.contains("name it with --format"), "{said}");
    assert!(error(&bench.run(&["import", "nowhere.csv"])).contains("nowhere.csv"));
    let wrong = bench.run(&["import", &good, "--format", "xml"]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&wrong.stderr).contains("mrk.json, fcsv"));
}

#[test]
fn every_format_comes_back_through_the_log() {
    let bench = Bench::new();
    let markups = bench.file("skull.mrk.json", write(Format::MrkJson, &everything()).unwrap().bytes);
    bench.json(&["import", &markups]);
    let items = bench.items();
    for format in TEXTS {
        let out = bench.path(&format!("out.{}", format.extension()));
        let report = bench.json(&[
            "export",
            "--format",
            format.name(),
            "--out",
            out.to_str().unwrap(),
            "--list",
            "skull",
        ]);
        let back = read(format, std::fs::read(&out).unwrap()).unwrap();
        assert_eq!(report["items"], back.items.len(), "{format}: {report}");
        for found in back.items.iter().filter(|_| format != Format::Mps) {
            let is_it = |item: &&Item| item.list == "skull" && item.name == found.name;
            let item = items.iter().find(is_it).unwrap_or_else(|| panic!("{format}: {}", found.name));
            assert!(same(item.geometry.as_ref(), found.geometry.as_ref()), "{format}: {item:?}");
        }
        let reported = report["left_out"].as_array().unwrap();
        assert!(!reported.is_empty() || format == Format::Cornerstone, "{format} holds less than everything");
    }
    let said = error(&bench.run(&["export", "--format", "csv", "--out", "x.csv", "--set", "nobody"]));
    assert!(said.contains("nothing is left to write"), "{said}");
    assert!(!Path::new("x.csv").exists());
}

#[test]
fn items_edited_elsewhere_update_their_originals() {
    let bench = Bench::new();
    let markups = bench.file("skull.mrk.json", write(Format::MrkJson, &everything()).unwrap().bytes);
    bench.json(&["import", &markups]);
    let out = bench.path("out.mrk.json");
    bench.json(&["export", "--format", "mrk.json", "--out", out.to_str().unwrap()]);
    let again = bench.json(&["import", out.to_str().unwrap(), "--update"]);
    assert_eq!(
        (&again["created"], &again["updated"], &again["unchanged"]),
        (&0.into(), &0.into(), &10.into())
    );
    // As 3D Slicer saves it: without Relief's own properties, and with a moved point.
    let mut file: Value = serde_json::from_slice(&std::fs::read(&out).unwrap()).unwrap();
    let lists = file["markups"].as_array_mut().unwrap();
    lists.retain(|markup| markup["type"] == "Fiducial" && markup["name"] == "skull");
    lists[0].as_object_mut().unwrap().remove("relief");
    for point in lists[0]["controlPoints"].as_array_mut().unwrap() {
        point.as_object_mut().unwrap().remove("relief");
        if point["label"] == "nasion" {
            point["position"] = serde_json::json!([2.5, 82.0, 40.0]);
            point["locked"] = false.into();
        }
    }
    let saved = bench.file("saved.mrk.json", file.to_string());
    // A locked item is unlocked first.
    let said = error(&bench.run(&["import", &saved, "--update"]));
    assert!(said.contains("is locked"), "{said}");
    let before = bench.items();
    for point in file["markups"][0]["controlPoints"].as_array_mut().unwrap() {
        if point["label"] == "nasion" {
            point["position"] = serde_json::json!([1.5, 82.25, 40.125]);
        } else if point["label"] == "hidden" {
            point["position"] = serde_json::json!([2.5, 82.0, 40.0]);
        }
    }
    let saved = bench.file("saved.mrk.json", file.to_string());
    let report = bench.json(&["import", &saved, "--update", "--author", "ben"]);
    assert_eq!(
        (&report["created"], &report["updated"], &report["unchanged"]),
        (&0.into(), &2.into(), &2.into())
    );
    for (before, now) in before.iter().zip(bench.items()) {
        let mut expected = before.clone();
        match before.name.as_str() {
            "nasion" => expected.locked = false,
            "hidden" => expected.geometry.as_mut().unwrap().points_mut()[0] = super::at(2.5, 82.0, 40.0),
            _ => {}
        }
        assert_eq!(now, expected, "everything else of it is as it was");
    }
}

/// Invariant: Importing a file twice creates no copies unless requested, and reports the items that
/// were there.
///
/// Existing items stay unchanged and are counted; copies are made on request.
#[test]
fn nothing_comes_in_twice_by_itself() {
    let bench = Bench::new();
    let markups = bench.file("skull.mrk.json", write(Format::MrkJson, &everything()).unwrap().bytes);
    bench.json(&["import", &markups]);
    let before = bench.items();
    let counts =
        |report: &Value| ["created", "updated", "unchanged", "skipped"].map(|key| report[key].clone());
    // Formats with ids, and those without: the same list, names and places.
    for format in [Format::MrkJson, Format::Csv, Format::Fcsv] {
        let out = bench.path(&format!("skull.{format}")).display().to_string();
        bench.json(&["export", "--format", &format.to_string(), "--out", &out, "--list", "skull"]);
        let again = bench.json(&["import", &out]);
        let held = again["files"][0]["items"].as_u64().unwrap();
        assert!(held > 0);
        // Tables and lists cannot hold every character of a text: items that differ only in those
        // count as existing.
        let differ = again["skipped"].as_u64().unwrap();
        assert!(differ <= u64::from(format != Format::MrkJson), "{format}: {again}");
        assert_eq!(counts(&again), [0, 0, held - differ, differ].map(Value::from), "{format}");
        let said = again["files"][0]["warnings"].to_string();
        let reported = match differ {
            0 => format!("{held} items are there already, as the file has them; --duplicate makes new ones"),
            _ => format!(
                "{held} items are there already and stay as they are, {differ} of them other than in the file"
            ),
        };
        assert!(said.contains(&reported), "{said}");
        assert_eq!(bench.items(), before, "{format}");
    }
    // One was moved in the log: it stays, and is counted.
    let out = bench.path("skull.mrk.json").display().to_string();
    bench.json(&["export", "--format", "mrk.json", "--out", &out, "--list", "skull"]);
    let mut file: Value = serde_json::from_slice(&std::fs::read(&out).unwrap()).unwrap();
    file["markups"][0]["controlPoints"][0]["position"] = serde_json::json!([9.0, 8.0, 7.0]);
    let moved = bench.file("moved.mrk.json", file.to_string());
    let again = bench.json(&["import", &moved]);
    assert_eq!((&again["created"], &again["skipped"]), (&0.into(), &1.into()), "{again}");
    let said = again["files"][0]["warnings"].to_string();
    assert!(said.contains("1 of them other than in the file; --update changes those"), "{said}");
    assert_eq!(bench.items(), before);
    let copied = bench.json(&["import", &moved, "--duplicate"]);
    let held = copied["files"][0]["items"].as_u64().unwrap();
    assert_eq!(counts(&copied), [held, 0, 0, 0].map(Value::from));
    let said = copied["files"][0]["warnings"].to_string();
    assert!(said.contains(&format!("{held} items were there already, and come in once more")), "{said}");
    assert_eq!(bench.items().len() as u64, before.len() as u64 + held);
    assert_eq!(bench.run(&["import", &moved, "--duplicate", "--update"]).status.code(), Some(2));
}

#[test]
fn a_series_says_where_items_belong_and_warns_of_a_mirror() {
    let Some(folder) =
        common::unpacked("landmarks of a skull imported with its volume", "interop", &["mouse_ct_atlas"])
    else {
        return;
    };
    let skull = folder.join("mouse_ct_atlas/low_res_skull_only.nii.gz").display().to_string();
    let markups = folder.join("mouse_ct_atlas/45_LM-skull.mrk.json");
    let bench = Bench::new();
    let report = bench.json(&["import", markups.to_str().unwrap(), "--series", &skull]);
    assert_eq!((&report["created"], &report["files"][0]["warnings"]), (&45.into(), &serde_json::json!([])));
    let items = bench.items();
    let frame = &items[0].frame_of_reference.as_ref().unwrap().0;
    assert!(frame.starts_with("volume:") && items.iter().all(|item| item.list == "45_LM-skull"), "{frame}");
    let text = std::fs::read_to_string(&markups).unwrap().replace(r#": "LPS""#, r#": "RAS""#);
    let wrong = bench.file("wrong.mrk.json", text);
    let output = bench.run(&["import", &wrong, "--series", &skull, "--dry-run"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("45 of 45 points lie outside of the volume; with x and y mirrored"), "{said}");
    let out = bench.path("out.fcsv").display().to_string();
    assert_eq!(bench.json(&["export", "--format", "fcsv", "--out", &out, "--series", &skull])["items"], 45);
    let other = folder.join("mouse_ct_atlas/low_res_template_UCHAR.nii.gz").display().to_string();
    let said = error(&bench.run(&["export", "--format", "fcsv", "--out", &out, "--series", &other]));
    assert!(said.contains("no items are there"), "{said}");
}
