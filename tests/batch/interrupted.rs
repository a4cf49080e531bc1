//! Runs that are broken off, shared out, or have bad series among good ones: nothing is lost, and
//! nothing half written.

use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use super::*;

fn start(archive: &Archive, shard: &str) -> Child {
    let (manifest, out) = (archive.text("jobs.jsonl"), archive.text("out"));
    let program = env!("CARGO_BIN_EXE_relief");
    Command::new(program)
        .args(["batch", "run", "--manifest", &manifest, "--out", &out, "--shard", shard])
        .env("RELIEF_ADAPTER", "cpu")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// Invariant: An interrupted batch leaves complete pictures, and the next run renders only the
/// rest; a further run renders nothing.
///
/// Four workers, three of which are killed during their work; the next run does the rest.
#[test]
fn killed_workers_leave_whole_pictures_and_the_rest_for_the_next_run() {
    let archive = Archive::of_phantoms(5);
    ok(&archive.plan(&["--views", "turntable:16"]));
    ok(&archive.run_into("reference", &[]));
    let mut workers = ["0/4", "1/4", "2/4", "3/4"].map(|shard| start(&archive, shard));
    let started = Instant::now();
    // Kill three as soon as there is work to lose.
    while pictures_or_none(&archive) < 10 && started.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(5));
    }
    for worker in &mut workers[..3] {
        let _ = worker.kill();
    }
    for worker in &mut workers {
        worker.wait().unwrap();
    }
    let half = pictures(&archive.path("out"));
    let reference = pictures(&archive.path("reference"));
    assert_eq!(reference.len(), 80);
    assert!(half.iter().all(|(name, bytes)| reference[name] == *bytes), "a picture was left half written");
    let rest = ok(&archive.run(&[]));
    assert_eq!(rest["done"].as_u64().unwrap() + rest["skipped"].as_u64().unwrap(), 80);
    assert!(pictures(&archive.path("out")) == reference, "80 jobs, none lost, none twice");
    let left = files(&archive.path("out"));
    let temporary: Vec<_> = left.keys().filter(|name| name.contains(".relief-")).collect();
    // Three were killed, each with a writer for every core, and four at most.
    let writers = std::thread::available_parallelism().unwrap().get().min(4);
    assert!(temporary.len() <= 3 * writers, "at most what killed workers were writing: {temporary:?}");
}

fn pictures_or_none(archive: &Archive) -> usize {
    if archive.path("out").is_dir() {
        walkdir::WalkDir::new(archive.path("out")).into_iter().count()
    } else {
        0
    }
}

#[test]
fn shares_are_disjoint_and_whole() {
    let archive = Archive::of_phantoms(6);
    ok(&archive.plan(&["--views", "planes"]));
    let shares: Vec<u64> =
        (0..3).map(|n| ok(&archive.run(&["--shard", &format!("{n}/3")]))["done"].as_u64().unwrap()).collect();
    assert_eq!(shares.iter().sum::<u64>(), 18, "{shares:?}");
    let rest = ok(&archive.run(&[]));
    assert_eq!((&rest["done"], &rest["skipped"]), (&0.into(), &18.into()));
    let one = archive.jobs()[4]["job"].as_str().unwrap().to_owned();
    let ran = ok(&archive.run_into("one", &["--job", &one]));
    assert_eq!((&ran["jobs"], &ran["done"]), (&1.into(), &1.into()));
}

/// Invariant: A series that fails stops no other, and the key of a job depends only on the inputs
/// of its outputs.
#[test]
fn a_bad_series_stops_no_other_and_altered_ones_are_planned_anew() {
    let archive = Archive::of_phantoms(3);
    std::fs::create_dir(archive.path("series/empty")).unwrap();
    std::fs::write(archive.path("series/broken.nii"), b"no volume").unwrap();
    let planned = ok(&archive.plan(&["--views", "planes"]));
    assert_eq!(planned["series"], 3);
    assert_eq!(planned["skipped"].as_array().unwrap().len(), 1, "{planned}");

    // One series loses its slices and another gets a changed one between planning and running.
    let paths: Vec<_> =
        archive.jobs().iter().map(|job| archive.path(job["series"]["path"].as_str().unwrap())).collect();
    let (gone, changed) = (&paths[0], &paths[3]);
    std::fs::remove_dir_all(gone).unwrap();
    let slice = std::fs::read_dir(changed).unwrap().map(|entry| entry.unwrap().path());
    let slice = slice.filter(|path| path.extension().is_some_and(|ending| ending == "dcm")).min().unwrap();
    let mut bytes = std::fs::read(&slice).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&slice, bytes).unwrap();
    let ran = archive.run(&[]);
    assert_eq!(ran.status.code(), Some(1), "failed for good");
    let summary: Value = serde_json::from_slice(&ran.stdout).unwrap();
    assert_eq!((&summary["done"], summary["failed"].as_array().unwrap().len()), (&3.into(), 6));
    assert!(
        summary["failed"].as_array().unwrap().iter().all(|failure| failure["kind"] == "permanent"),
        "{summary}"
    );
    let reasons = summary["failed"].to_string();
    assert!(reasons.contains("files have changed since planning; plan again"), "{reasons}");
    let page = std::fs::read_to_string(archive.path("out/report.html")).unwrap();
    assert!(page.contains("3 of 9 views") && page.contains("Failures"));
}

/// Invariant: An interrupted batch leaves complete pictures, and the next run renders only the
/// rest; a further run renders nothing.
#[test]
fn outputs_that_were_altered_or_removed_are_made_again() {
    let archive = Archive::of_phantoms(1);
    ok(&archive.plan(&["--views", "planes"]));
    ok(&archive.run(&[]));
    let before = pictures(&archive.path("out"));
    let [first, second, _] = before.keys().collect::<Vec<_>>().try_into().unwrap();
    std::fs::remove_file(archive.path("out").join(first)).unwrap();
    let mut bytes = before[second].clone();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(archive.path("out").join(second), bytes).unwrap();
    let ran = ok(&archive.run(&[]));
    assert_eq!((&ran["done"], &ran["skipped"]), (&2.into(), &1.into()));
    assert!(pictures(&archive.path("out")) == before);
}

#[cfg(target_os = "linux")]
#[test]
fn a_volume_beyond_the_memory_is_refused_with_both_numbers() {
    let archive = Archive { folder: tempfile::tempdir().unwrap() };
    let out = archive.text("series/large");
    ok(&relief(&["phantom", "--kind", "sphere", "--size", "360", "--out", &out]));
    ok(&archive.plan(&["--views", "planes"]));
    let ran = archive.run(&["--memory", "800MiB"]);
    assert_eq!(ran.status.code(), Some(1));
    let summary: Value = serde_json::from_slice(&ran.stdout).unwrap();
    let reason = summary["failed"][0]["reason"].as_str().unwrap();
    assert!(reason.contains("needs 89 MiB, and 72 MiB are for voxels; allow more with --memory"), "{reason}");
}
