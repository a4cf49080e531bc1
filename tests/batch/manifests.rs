//! Manifests, tables and view sets: read as written, refused with line and reason.

use super::*;
use relief_batch::{Shard, ViewSet, read_manifest};

/// Invariant: A series that fails stops no other, and the key of a job depends only on the inputs
/// of its outputs.
#[test]
fn moved_series_keep_their_keys_and_another_scene_has_others() {
    let archive = Archive::of_phantoms(2);
    ok(&archive.plan(&["--views", "turntable:2"]));
    let keys = |archive: &Archive| -> Vec<String> {
        let mut keys: Vec<_> =
            archive.jobs().iter().map(|job| job["job"].as_str().unwrap().to_owned()).collect();
        keys.sort();
        keys
    };
    let before = keys(&archive);
    std::fs::rename(archive.path("series/DOE^JOHN 0"), archive.path("series/renamed")).unwrap();
    ok(&archive.plan(&["--views", "turntable:2"]));
    assert_eq!(keys(&archive), before);
    ok(&archive.plan(&["--views", "turntable:2", "--zoom", "2"]));
    assert!(keys(&archive).iter().all(|key| !before.contains(key)));
    let text = std::fs::read_to_string(archive.path("jobs.jsonl")).unwrap();
    assert_eq!(read_manifest(text.as_bytes()).unwrap().len(), 4);
}

#[test]
fn a_folder_with_series_and_manifest_can_be_moved_and_run_from_anywhere() {
    let archive = Archive::of_phantoms(1);
    ok(&archive.plan(&["--views", "turntable:2"]));
    assert_eq!(archive.jobs()[0]["series"]["path"], "series/DOE^JOHN 0");
    std::fs::create_dir(archive.path("moved")).unwrap();
    for name in ["series", "jobs.jsonl"] {
        std::fs::rename(archive.path(name), archive.path(&format!("moved/{name}"))).unwrap();
    }
    let (manifest, out) = (archive.text("moved/jobs.jsonl"), archive.text("out"));
    let run = || relief(&["batch", "run", "--manifest", &manifest, "--out", &out, "--json"]);
    assert_eq!(ok(&run())["done"], 2);
    // Without its series the run names the path that it looked for.
    std::fs::rename(archive.path("moved/series"), archive.path("gone")).unwrap();
    std::fs::remove_dir_all(archive.path("out")).unwrap();
    let failed = run();
    let message = String::from_utf8(failed.stderr).unwrap();
    assert!(!failed.status.success());
    assert!(message.contains("warning: series/DOE^JOHN 0 does not exist, neither in "), "{message}");
}

#[test]
fn invalid_manifests_are_refused_with_line_and_reason() {
    let archive = Archive::of_phantoms(1);
    ok(&archive.plan(&["--views", "sides"]));
    let text = std::fs::read_to_string(archive.path("jobs.jsonl")).unwrap();
    let first = text.lines().next().unwrap();
    let refused = |text: &str| read_manifest(text.as_bytes()).unwrap_err().to_string();
    assert!(refused("\n\n{\n").starts_with("line 3 is not a valid job"));
    assert!(refused(&first.replace("\"bone\"", "\"skin\"")).contains("plan again instead of editing jobs"));
    assert!(refused(&format!("{first}\n{first}")).contains("lines 1 and 2 would both write"));
    assert!(refused(&first.replace("\"anterior\"", "\"../anterior\"")).contains("view is \"../anterior\""));
    assert!(refused(&first.replace("\"view\"", "\"sight\"")).contains("sight"));
    assert!(read_manifest(&b""[..]).unwrap().is_empty());
    let bytes = first.as_bytes();
    for cut in 0..bytes.len() {
        assert!(cut == 0 || read_manifest(&bytes[..cut]).is_err(), "the first {cut} bytes");
    }
}

#[test]
fn tables_name_series_and_tell_what_is_wrong_with_them() {
    let archive = Archive::of_phantoms(2);
    let plan = |table: &str| {
        std::fs::write(archive.path("table.csv"), table).unwrap();
        let (table, out) = (archive.text("table.csv"), archive.text("jobs.jsonl"));
        relief(&["batch", "plan", "--table", &table, "--out", &out, "--views", "planes", "--json"])
    };
    ok(&plan("name,path\nalpha,series/DOE^JOHN 0\n,\"series/DOE^JOHN 1\"\n"));
    let names: Vec<String> =
        archive.jobs().iter().map(|job| job["series"]["name"].as_str().unwrap().to_owned()).collect();
    assert!(names[0] == "alpha" && names[3].starts_with("series-"), "{names:?}");
    for (table, says) in [
        ("file\nx\n", "line 1: unknown column \"file\""),
        ("name\nx\n", "line 1: there is no column path"),
        ("path,name\na,x\nb,x\n", "line 3: name \"x\" is that of line 2, too"),
        ("path,name\na,../x\n", "line 2: name is \"../x\""),
        ("path,name\na\n", "line 2"),
        ("path\nnowhere\n", "no CT series under"),
    ] {
        let refused = plan(table);
        assert_eq!(refused.status.code(), Some(1));
        let message = String::from_utf8(refused.stderr).unwrap();
        assert!(message.contains(says), "{table:?}: {message}");
    }
}

#[test]
fn view_sets_are_what_they_say_or_refused() {
    let set = ViewSet::parse("turntable:8,sides,planes").unwrap();
    assert_eq!(set.views.len(), 8 + 6 + 3);
    assert_eq!(set.views[3].orbit, Some([135.0, 0.0]));
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("views.json");
    let read = |text: &str| {
        std::fs::write(&file, text).unwrap();
        ViewSet::parse(file.to_str().unwrap()).map_err(|error| error.to_string())
    };
    let set = read(r#"[{"name":"a","azimuth_deg":20},{"name":"b","scene":{"mode":"mip"}}]"#).unwrap();
    assert_eq!((set.views[0].orbit, set.views[1].orbit), (Some([20.0, 0.0]), Some([0.0, 0.0])));
    for (text, says) in [
        ("[]", "allowed: a JSON array"),
        ("[{}]", "view 0: name is \"\""),
        (r#"[{"name":"a","scene":{"modus":"mip"}}]"#, "modus"),
        (r#"[{"name":"a"},{"name":"a"}]"#, "two views are called \"a\""),
        (r#"[{"name":"a","zoom":2}]"#, "unknown key \"zoom\""),
        (
            r#"[{"name":"a","azimuth_deg":1,"scene":{"mode":"slice","slice":{"plane":"axial"}}}]"#,
            "without a camera",
        ),
    ] {
        let refused = read(text).unwrap_err();
        assert!(refused.contains(says), "{text}: {refused}");
    }
    for text in ["turntable:0", "turntable:x", "turntable:721", "nowhere.json", "sides,sides"] {
        assert!(ViewSet::parse(text).is_err(), "{text}");
    }
    for text in ["1", "4/4", "-1/4", "a/b", "0/0"] {
        assert!(text.parse::<Shard>().is_err(), "{text}");
    }
}
