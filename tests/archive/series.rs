//! A series of Orthanc gives what its files give.

use std::path::Path;
use std::process::Output;

use serde_json::Value;

use super::orthanc::{Orthanc, Wanted};
use crate::cluster::stage::{Process, get, lone, phantom, relief, volumes};

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn succeeded(output: &Output) -> String {
    assert!(output.status.success(), "{}", text(&output.stderr));
    text(&output.stdout)
}

/// The address and the UIDs of the only series that an archive lists.
fn only_series(orthanc: &Orthanc) -> (String, [String; 2]) {
    let listed = orthanc.relief(&["inspect", &orthanc.address(""), "--json"]).output().unwrap();
    let listed: Value = serde_json::from_str(&succeeded(&listed)).unwrap();
    assert_eq!(listed.as_array().unwrap().len(), 1, "{listed}");
    let one = |name: &str| listed[0][name].as_str().unwrap().to_owned();
    (one("address"), [one("study_uid"), one("series_uid")])
}

fn render(command: &mut std::process::Command, out: &Path) -> Output {
    command
        .args(["--preset", "bone", "--size", "96x64", "--layout", "color", "--out"])
        .arg(out)
        .output()
        .unwrap()
}

/// Invariant: A series of a DICOM archive gives the picture of its files, over TLS with
/// certificates as without; no message has its UIDs.
#[test]
fn a_series_of_an_archive_gives_the_picture_of_its_files() {
    for wanted in [Wanted::Login, Wanted::Certificate] {
        let Some(orthanc) = Orthanc::start("series of an archive", wanted) else { return };
        let folder = tempfile::tempdir().unwrap();
        let files = phantom(folder.path(), "head");
        orthanc.store(&files);
        let (address, uids) = only_series(&orthanc);
        let [local, remote] = ["local.png", "remote.png"].map(|name| folder.path().join(name));
        succeeded(&render(relief(&["render", "--series"]).arg(&files), &local));
        let made = render(&mut orthanc.relief(&["render", "--series", &address]), &remote);
        succeeded(&made);
        assert!(std::fs::read(&local).unwrap() == std::fs::read(&remote).unwrap());
        assert!(uids.iter().all(|uid| !text(&made.stderr).contains(uid)), "{}", text(&made.stderr));

        let mut stranger = orthanc.relief(&["render", "--series", &address]);
        stranger.env_remove("RELIEF_ARCHIVE_LOGIN_FILE");
        let refused = render(&mut stranger, &folder.path().join("none.png"));
        let said = text(&refused.stderr);
        assert!(!refused.status.success() && said.contains("refuses access (status 401)"), "{said}");
        assert!(uids.iter().all(|uid| !said.contains(uid)), "{said}");
    }
}

/// Invariant: A copy of a series of an archive that is in the cache is not retrieved again; one
/// whose retrieval was interrupted is completed.
#[test]
fn an_interrupted_retrieval_is_completed_and_a_whole_copy_is_used() {
    let Some(orthanc) = Orthanc::start("copies of an archive", Wanted::Login) else { return };
    let folder = tempfile::tempdir().unwrap();
    orthanc.store(&phantom(folder.path(), "slab"));
    let (address, _) = only_series(&orthanc);
    let (cache, out) = (folder.path().join("cache"), folder.path().join("out.png"));
    let cached = |bytes: &str| {
        let mut command =
            orthanc.relief(&["render", "--series", &address, "--cache-bytes", bytes, "--cache"]);
        render(command.arg(&cache), &out)
    };
    let files = || {
        let all = walkdir::WalkDir::new(&cache).into_iter().map(Result::unwrap);
        let mut files: Vec<_> = all
            .filter(|entry| entry.path().extension().is_some_and(|ending| ending == "dcm"))
            .map(|entry| (entry.file_name().to_owned(), entry.metadata().unwrap().modified().unwrap()))
            .collect();
        files.sort();
        files
    };
    let stopped = cached("20000");
    let said = text(&stopped.stderr);
    assert!(!stopped.status.success() && said.contains("--cache-bytes"), "{said}");
    let before = files();
    assert!(!before.is_empty() && before.len() < 32, "{}", before.len());
    succeeded(&cached("1MiB"));
    let whole = files();
    assert_eq!(whole.len(), 32);
    assert!(before.iter().all(|file| whole.contains(file)), "an instance was retrieved again");
    let picture = std::fs::read(&out).unwrap();
    succeeded(&cached("1MiB"));
    assert_eq!(files(), whole);
    assert!(std::fs::read(&out).unwrap() == picture);
}

/// Invariant: Servers and batches find the series of a DICOM archive by a query.
#[test]
fn servers_and_batches_take_series_by_a_query() {
    let Some(orthanc) = Orthanc::start("queries of an archive", Wanted::Login) else { return };
    let folder = tempfile::tempdir().unwrap();
    let files = ["sphere", "head"].map(|kind| phantom(folder.path(), kind));
    files.iter().for_each(|series| orthanc.store(series));
    let query = orthanc.address("?Modality=CT");
    let (_local, local) = lone(&files);
    let mut served =
        orthanc.relief(&["serve", "--listen", "127.0.0.1:0", "--listen-when-loaded", "--series", &query]);
    let errors = folder.path().join("served.log");
    let (_remote, lines) = Process::start(served.stderr(std::fs::File::create(&errors).unwrap()));
    let remote = lines[0].split_once("http://").unwrap().1.trim_end_matches('/').to_owned();
    let sorted = |address: &str| {
        let mut ids = volumes(address);
        ids.sort();
        ids
    };
    assert_eq!(sorted(&local), sorted(&remote));
    let id = &sorted(&remote)[0];
    let path = format!("/v1/volumes/{id}/frame?preset=bone&layout=color&size_px=64,48");
    assert!(get(&local, &path, "").body == get(&remote, &path, "").body);
    assert!(!std::fs::read_to_string(&errors).unwrap().contains("/studies/"));

    let (jobs, out) = (folder.path().join("jobs.jsonl"), folder.path().join("out"));
    let mut plan = orthanc.relief(&[
        "batch",
        "plan",
        "--views",
        "turntable:2",
        "--size",
        "64x48",
        "--products",
        "color",
    ]);
    succeeded(&plan.args(["--root", &query, "--out"]).arg(&jobs).output().unwrap());
    let planned = std::fs::read_to_string(&jobs).unwrap();
    assert_eq!(planned.lines().count(), 4, "{planned}");
    let mut run = orthanc.relief(&["batch", "run", "--manifest"]);
    succeeded(&run.arg(&jobs).arg("--out").arg(&out).output().unwrap());
    let pictures = walkdir::WalkDir::new(&out).into_iter().map(Result::unwrap);
    let is_picture = |entry: &walkdir::DirEntry| entry.file_name().to_string_lossy().ends_with("color.png");
    assert_eq!(pictures.filter(is_picture).count(), 4);
    let nothing = orthanc.relief(&["inspect", &orthanc.address("?PatientID=nobody")]).output().unwrap();
    let said = text(&nothing.stderr);
    assert!(!nothing.status.success() && said.contains("no series") && !said.contains("nobody"), "{said}");
}
