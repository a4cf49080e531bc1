//! Reports, segmentations and pictures in Orthanc: read back by others, and stored once.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use dicom_dictionary_std::tags;
use serde_json::{Value, json};

use super::orthanc::{Orthanc, Wanted};
use super::receive::Receiving;
use super::stand_in::{StandIn, reply};
use crate::cluster::stage::{phantom, relief};

fn succeeded(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Landmarks and structures of a phantom as a report and a segmentation, and two pictures of it.
fn results(folder: &Path, series: &Path) -> Vec<PathBuf> {
    let log = folder.join("ann.db");
    let annotate = |arguments: &[&str], paths: &[&Path]| {
        let mut command = relief(&["annotate", "--db"]);
        succeeded(
            &command.arg(&log).args(arguments).args(paths).arg("--series").arg(series).output().unwrap(),
        )
    };
    annotate(&["import"], &[&series.join("landmarks.csv")]);
    annotate(&["import"], &[&series.join("labels.seg.nrrd")]);
    let [report, regions] = ["report.dcm", "regions.dcm"].map(|name| folder.join(name));
    annotate(&["export", "--format", "sr", "--out"], &[&report]);
    annotate(&["export", "--format", "seg", "--out"], &[&regions]);
    let pictures = ["0", "40"].map(|azimuth| {
        let out = folder.join(format!("{azimuth}.png"));
        let mut render = relief(&["render", "--preset", "bone", "--layout", "color", "--size", "64x48"]);
        render.args(["--azimuth-deg", azimuth, "--series"]).arg(series).arg("--out").arg(&out);
        succeeded(&render.output().unwrap());
        out
    });
    [report, regions].into_iter().chain(pictures).collect()
}

/// The errors of dciodvfy about an object; `None` after saying aloud that it is not there.
fn dciodvfy(file: &Path) -> Option<Vec<String>> {
    let Some(tools) = std::env::var_os("RELIEF_DICOM_TOOLS") else {
        eprintln!("SKIPPED: objects of pictures (RELIEF_DICOM_TOOLS is not set, see scripts/setup-peers)");
        return None;
    };
    let output = Command::new(PathBuf::from(tools).join("dciodvfy")).arg("-new").arg(file).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("SCImage"), "{said}");
    Some(said.lines().filter(|line| line.starts_with("Error")).map(str::to_owned).collect())
}

/// Invariant: Reports, segmentations and pictures that are stored in a DICOM archive are read back
/// by others as they were, and a repeated storage stores nothing.
#[test]
fn results_are_stored_once_and_read_back_by_others() {
    let Some(orthanc) = Orthanc::start("results in an archive", Wanted::Login) else { return };
    let folder = tempfile::tempdir().unwrap();
    let series = phantom(folder.path(), "head");
    orthanc.store(&series);
    let files = results(folder.path(), &series);
    let to = orthanc.address("");
    let send = |files: &[PathBuf], more: &[&str]| -> Vec<String> {
        let mut command = orthanc.relief(&["send", "--to", &to, "--json", "--series"]);
        let sent = command.arg(&series).args(files).args(more).output().unwrap();
        let sent: Vec<Value> = serde_json::from_str(&succeeded(&sent)).unwrap();
        sent.iter().map(|one| one["outcome"].as_str().unwrap().to_owned()).collect()
    };
    let object = folder.path().join("turntable.dcm");
    assert_eq!(send(&files, &[]), ["stored"; 4]);
    assert_eq!(send(&files[2..], &["--multi-frame", "--out", object.to_str().unwrap()]), ["stored"]);
    assert_eq!(send(&files, &[]), ["already there"; 4]);
    if let Some(errors) = dciodvfy(&object) {
        assert_eq!(errors, [""; 0]);
    }
    let Some(python) = std::env::var_os("RELIEF_PEERS_PYTHON") else {
        eprintln!("SKIPPED: reading results back (RELIEF_PEERS_PYTHON is not set, see scripts/setup-peers)");
        return;
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/archive/read_back.py");
    let mut read = Command::new(python);
    read.args(["-W", "ignore"]).arg(script).arg(to.trim_start_matches("dicomweb+")).arg("reader:a secret");
    let read: Vec<Value> =
        serde_json::from_str(&succeeded(&read.args(&files[2..]).output().unwrap())).unwrap();
    let of = |kind: &str| read.iter().filter(|one| one["kind"] == kind).cloned().collect::<Vec<_>>();
    let patient = &of("SR")[0]["patient"];
    assert!(patient.as_str().is_some_and(|id| !id.is_empty()));
    assert_eq!(of("SEG").len(), 1);
    assert!(of("SEG")[0]["segments"].as_u64() > Some(1) && of("SEG")[0]["patient"] == *patient);
    let mut frames: Vec<Value> = of("OT");
    frames.sort_by_key(|one| one["frames"].as_u64());
    let captured = |frames: u32| json!({ "kind": "OT", "frames": frames, "same": true, "patient": patient });
    assert_eq!(frames, [captured(1), captured(1), captured(2)]);
}

/// Invariant: Results reach an archive by the DICOM network, too; a provider that does not take them
/// is an error that says why.
#[test]
fn results_are_stored_by_the_dicom_network() {
    let Some(orthanc) = Orthanc::start("results by the DICOM network", Wanted::Login) else { return };
    let folder = tempfile::tempdir().unwrap();
    let series = phantom(folder.path(), "head");
    orthanc.store(&series);
    let files = results(folder.path(), &series);
    let send = |to: &str, files: &[PathBuf], more: &[&str]| {
        relief(&["send", "--to", to]).args(files).args(more).output().unwrap()
    };
    for _ in 0..2 {
        let sent = succeeded(&send(&orthanc.network_address(), &files[..2], &[]));
        assert_eq!(sent.matches(": stored").count(), 2, "{sent}");
    }
    let listed = orthanc.relief(&["inspect", &orthanc.address(""), "--json"]).output().unwrap();
    let listed: Value = serde_json::from_str(&succeeded(&listed)).unwrap();
    let count = |modality: &str| {
        let series = listed.as_array().unwrap().iter().filter(|one| one["modality"] == modality);
        series.map(|one| one["instances"].as_u64().unwrap()).sum::<u64>()
    };
    assert_eq!((count("SR"), count("SEG")), (1, 1));

    let receiving = Receiving::start(&folder.path().join("inbox"), &["--caller", "KNOWN"]);
    let provider = format!("dicom://RELIEF@127.0.0.1:{}", receiving.port());
    let slice = a_slice(&series);
    let slice = std::slice::from_ref(&slice);
    assert!(succeeded(&send(&provider, slice, &["--aet", "KNOWN"])).contains(": stored"));
    let fails = |files: &[PathBuf], calling: &str, expected: &str| {
        let refused = send(&provider, files, &["--aet", calling]);
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(!refused.status.success() && said.contains(expected), "{said}");
    };
    fails(slice, "STRANGER", "does it know the caller");
    fails(&files[..1], "KNOWN", "does not take objects of this kind");
    drop(receiving);
    fails(slice, "KNOWN", "does not answer");
}

/// A slice of a phantom.
fn a_slice(series: &Path) -> PathBuf {
    let files = walkdir::WalkDir::new(series).into_iter().map(Result::unwrap);
    let mut files = files.map(walkdir::DirEntry::into_path);
    files.find(|path| path.extension().is_some_and(|ending| ending == "dcm")).unwrap()
}

/// Invariant: An object that an archive does not store is an error, with the archive's reason.
#[test]
fn an_archive_that_stores_nothing_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let slice = a_slice(&phantom(folder.path(), "slab"));
    let failed =
        json!([{ "00081198": { "vr": "SQ", "Value": [{ "00081197": { "vr": "US", "Value": [272] } }] } }]);
    for (status, body, expected) in [
        ("409 Conflict", failed.to_string(), "refused (failure reason 0x0110)"),
        ("202 Accepted", failed[0].to_string(), "refused (failure reason 0x0110)"),
        ("200 OK", "<html>".to_owned(), "sends something else where the outcome of a storage"),
        ("200 OK", "{}".to_owned(), "sends something else where the outcome of a storage"),
        ("413 Payload Too Large", String::new(), "answers with status 413"),
        ("404 Not Found", String::new(), "no such service for storage (STOW-RS)"),
    ] {
        // The list has another instance than the one that was searched for.
        let other = json!([{ "00080018": { "vr": "UI", "Value": ["1.2"] } }]).to_string();
        let archive = StandIn::start(move |path, stream| match path.ends_with("/studies") {
            true => reply(stream, status, "application/dicom+json", body.as_bytes()),
            false => reply(stream, "200 OK", "application/dicom+json", other.as_bytes()),
        });
        let mut command = relief(&["send", "--to", &archive.address("")]);
        let sent = command.arg(&slice).env("NO_PROXY", "*").output().unwrap();
        let said =
            [&sent.stdout, &sent.stderr].map(|text| String::from_utf8_lossy(text).into_owned()).concat();
        assert!(!sent.status.success() && said.contains(expected), "{status}: {said}");
    }
}

/// Invariant: Captures that a batch stores in an archive are objects of the series' study, and a
/// repeated run stores nothing.
#[test]
fn captures_of_a_batch_are_stored_once() {
    let Some(orthanc) = Orthanc::start("captures of a batch", Wanted::Login) else { return };
    let folder = tempfile::tempdir().unwrap();
    let series = phantom(folder.path(), "head");
    orthanc.store(&series);
    let log = folder.path().join("ann.db");
    let landmarks = series.join("landmarks.csv");
    let mut import = relief(&["annotate", "--db"]);
    succeeded(&import.arg(&log).arg("import").arg(landmarks).arg("--series").arg(&series).output().unwrap());
    let planned = |products: &str| {
        let jobs = folder.path().join(format!("{products}.jsonl"));
        let mut plan =
            relief(&["batch", "plan", "--views", "turntable:3,sides", "--preset", "bone", "--size", "64x48"]);
        plan.args(["--products", products, "--root"]).arg(&series).arg("--annotations").arg(&log);
        succeeded(&plan.arg("--out").arg(&jobs).output().unwrap());
        jobs
    };
    let run = |jobs: &Path| {
        let mut run = orthanc.relief(&["batch", "run", "--json", "--send", &orthanc.address("")]);
        run.arg("--manifest").arg(jobs).arg("--out").arg(folder.path().join("views")).output().unwrap()
    };
    let jobs = planned("capture,annotated-capture");
    let sent = |jobs: &Path| -> Value {
        serde_json::from_str::<Value>(&succeeded(&run(jobs))).unwrap()["sent"].clone()
    };
    let counts = |stored: u32, there: u32| json!({ "stored": stored, "already_there": there, "refused": 0 });
    // Six sides and a turntable, without and with annotations.
    assert_eq!(sent(&jobs), counts(14, 0));
    assert_eq!(sent(&jobs), counts(0, 14), "a repeat");
    let without = run(&planned("color"));
    let said = String::from_utf8_lossy(&without.stderr).into_owned();
    assert!(!without.status.success() && said.contains("--products capture"), "{said}");

    let listed = orthanc.relief(&["inspect", &orthanc.address(""), "--json"]).output().unwrap();
    let listed: Vec<Value> = serde_json::from_str(&succeeded(&listed)).unwrap();
    let captures = listed.iter().filter(|one| one["modality"] == "OT");
    assert_eq!(captures.map(|one| one["instances"].as_u64().unwrap()).sum::<u64>(), 14, "{listed:?}");
    assert!(listed.iter().all(|one| one["study_uid"] == listed[0]["study_uid"]), "{listed:?}");
    let views = walkdir::WalkDir::new(folder.path().join("views")).into_iter().map(|entry| entry.unwrap());
    let objects: Vec<PathBuf> = views
        .map(walkdir::DirEntry::into_path)
        .filter(|path| path.extension().is_some_and(|ending| ending == "dcm"))
        .collect();
    assert_eq!(objects.len(), 2 * (6 + 3 + 1), "{objects:?}");
    turntable_has_the_frames_of_its_views(&objects);
    for object in objects {
        if let Some(errors) = dciodvfy(&object) {
            assert_eq!(errors, [""; 0], "{}", object.display());
        }
    }
}

/// As the DICOM library reads them.
fn turntable_has_the_frames_of_its_views(objects: &[PathBuf]) {
    let pixels = |path: &Path| {
        let object = dicom_object::open_file(path).unwrap();
        let frames = object.get(tags::NUMBER_OF_FRAMES).map(|frames| frames.to_int::<u32>().unwrap());
        (frames, object.element(tags::PIXEL_DATA).unwrap().to_bytes().unwrap().into_owned())
    };
    let named = |start: &str, end: &str| {
        let named = |path: &&PathBuf| {
            let name = path.file_name().unwrap().to_str().unwrap();
            name.starts_with(start) && name.ends_with(end)
        };
        let mut found: Vec<_> = objects.iter().filter(named).collect();
        found.sort();
        found
    };
    for ending in [".capture.dcm", ".annotated-capture.dcm"] {
        let turns = named("turntable-", ending);
        let joined = pixels(named("turntable.", ending)[0]);
        let expected: Vec<u8> = turns.iter().flat_map(|path| pixels(path).1).collect();
        assert_eq!((turns.len(), joined.0), (3, Some(3)));
        assert!(joined.1 == expected, "{ending}");
    }
}
