//! Label maps of series: found beside them, part of a job's key, drawn as `relief render` draws
//! them.

use super::*;

/// A head with the map of its organs in its folder, and a ball without one.
fn heads() -> Archive {
    let archive = Archive { folder: tempfile::tempdir().unwrap() };
    for (kind, name) in [("head", "series/head"), ("sphere", "series/ball")] {
        ok(&relief(&["phantom", "--kind", kind, "--size", "48", "--out", &archive.text(name)]));
    }
    std::fs::write(archive.path("brain.json"), r#"{"clip": {"labels": {"keep": ["brain"]}}}"#).unwrap();
    archive
}

fn keys(archive: &Archive) -> Vec<Value> {
    archive.jobs().into_iter().map(|job| job["job"].clone()).collect()
}

/// Invariant: Label maps are part of the key of a job and are drawn as by `relief render`.
#[test]
fn organs_are_kept_as_render_keeps_them() {
    let archive = heads();
    let scene = archive.text("brain.json");
    let views = ["--views", "turntable:2", "--scene", &scene];
    let planned = ok(&archive.plan(&[&views[..], &["--labels", "{}/labels.seg.nrrd"]].concat()));
    assert_eq!((&planned["series"], &planned["jobs"]), (&1.into(), &2.into()), "{planned}");
    let reason = planned["skipped"][0]["reason"].as_str().unwrap();
    assert!(reason.contains("its label map") && reason.contains("ball/labels.seg.nrrd"), "{reason}");
    ok(&archive.run(&[]));
    let (series, single) = (archive.text("series/head"), archive.text("single.png"));
    let labels = archive.text("series/head/labels.seg.nrrd");
    let fixed = ["render", "--series", &series, "--preset", "bone", "--size", "64x48", "--layout", "color"];
    let of_head = ["--labels", &labels, "--keep-labels", "brain", "--azimuth-deg", "180", "--out", &single];
    ok(&relief(&[&fixed[..], &of_head].concat()));
    let name = format!("{}/turntable-001.color.png", archive.jobs()[0]["series"]["name"].as_str().unwrap());
    let made = pictures(&archive.path("out"));
    assert!(made[&name] == std::fs::read(&single).unwrap(), "another picture than relief render's");
    ok(&relief(&[&fixed[..], &["--azimuth-deg", "180", "--out", &single]].concat()));
    assert!(made[&name] != std::fs::read(&single).unwrap(), "the brain alone is another picture");

    // A map that was altered after planning is refused.
    let mut bytes = std::fs::read(&labels).unwrap();
    bytes.push(0);
    std::fs::write(&labels, bytes).unwrap();
    let refused = archive.run_into("altered", &[]);
    let said = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(1), "{said}");
    assert_eq!(said.matches("label map has changed since planning").count(), 2, "{said}");
}

/// Invariant: Label maps are part of the key of a job and are drawn as by `relief render`.
#[test]
fn jobs_are_known_by_their_label_maps_wherever_these_lie() {
    let archive = heads();
    let plan = |more: &[&str]| {
        let planned = ok(&archive.plan(&[&["--views", "sides"], more].concat()));
        assert_eq!(planned["series"], 1, "{planned}");
        keys(&archive)
    };
    std::fs::remove_dir_all(archive.path("series/ball")).unwrap();
    let without = plan(&[]);
    let inside = plan(&["--labels", "{}/labels.seg.nrrd"]);
    assert!(without.iter().all(|key| !inside.contains(key)));
    // Beside the series it is no series of its own.
    std::fs::rename(archive.path("series/head/labels.seg.nrrd"), archive.path("series/head.organs.nrrd"))
        .unwrap();
    assert_eq!(plan(&["--labels", "{}.organs.nrrd"]), inside);
    std::fs::write(archive.path("series.csv"), "path,labels\nseries/head,series/head.organs.nrrd\n").unwrap();
    let (table, out) = (archive.text("series.csv"), archive.text("jobs.jsonl"));
    let of_table = ["batch", "plan", "--table", &table, "--out", &out, "--preset", "bone", "--size", "64x48"];
    ok(&relief(&[&of_table[..], &["--products", "color", "--views", "sides"]].concat()));
    assert_eq!(keys(&archive), inside);
    let wrong = archive.plan(&["--views", "sides", "--labels", "organs.nrrd"]);
    assert!(
        wrong.status.code() == Some(2)
            && String::from_utf8_lossy(&wrong.stderr).contains("a pattern has {} once")
    );
}
