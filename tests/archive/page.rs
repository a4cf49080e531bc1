//! The search of a server over archives: over HTTP, and on the page in Chromium.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value, json};

use super::orthanc::{Orthanc, Wanted};
use crate::browser::{chromium, python, skipped};
use crate::cluster::stage::{Answer, Process, ask, get, lone, phantom, relief, until, volumes};

/// A server with this archive, and its address; its log is in the folder.
fn searching(orthanc: &Orthanc, folder: &Path, more: &[&str]) -> (Process, String) {
    let archive = format!("pacs={}", orthanc.address(""));
    let mut command = orthanc.relief(&["serve", "--listen", "127.0.0.1:0", "--archive", &archive]);
    let errors = std::fs::File::create(folder.join("serve.log")).unwrap();
    let (process, lines) = Process::start(command.args(more).env("RELIEF_LOG", "debug").stderr(errors));
    let address = lines[0].split_once("http://").unwrap().1.trim_end_matches('/').to_owned();
    (process, address)
}

fn post(address: &str, path: &str, body: &Value) -> Answer {
    ask(address, &format!("POST {path}"), "Content-Type: application/json\r\n", &body.to_string()).unwrap()
}

fn found(address: &str, query: &Value) -> Vec<Value> {
    let answer = post(address, "/v1/archives/pacs/search", query);
    assert_eq!(answer.status, 200, "{}", String::from_utf8_lossy(&answer.body));
    answer.json()["series"].as_array().unwrap().clone()
}

/// A log with the landmarks of a phantom.
fn landmarks(folder: &Path, series: &Path) -> PathBuf {
    let log = folder.join("ann.db");
    let mut import = relief(&["annotate", "--db"]);
    import.arg(&log).arg("import").arg(series.join("landmarks.csv")).arg("--series").arg(series);
    assert!(import.output().unwrap().status.success());
    log
}

/// The number of DICOM files in a folder.
fn slices(folder: &Path) -> usize {
    let files = std::fs::read_dir(folder).unwrap().map(|file| file.unwrap().path());
    files.filter(|path| path.extension().is_some_and(|ending| ending == "dcm")).count()
}

/// Loads a series, and returns the last state.
fn loaded(address: &str, key: &str) -> Value {
    let path = format!("/v1/archives/pacs/series/{key}");
    let begun = post(address, &path, &json!({}));
    assert_eq!(begun.status, 202);
    let mut last = begun.json();
    until("a series of an archive is loaded", || {
        last = get(address, &path, "").json();
        matches!(last["state"].as_str().unwrap(), "ready" | "failed")
    });
    last
}

/// Invariant: A series that is found in an archive and loaded on demand has the id of its files, and
/// neither answers nor logs have its UIDs; names of patients are shown where the operator wants it.
#[test]
fn a_series_is_found_by_a_search_and_loaded_on_demand() {
    let Some(orthanc) = Orthanc::start("searches of archives", Wanted::Login) else { return };
    let folder = tempfile::tempdir().unwrap();
    let files = ["head", "sphere"].map(|kind| phantom(folder.path(), kind));
    files.iter().for_each(|series| orthanc.store(series));
    let listed = orthanc.relief(&["inspect", &orthanc.address(""), "--json"]).output().unwrap();
    let listed: Value = serde_json::from_slice(&listed.stdout).unwrap();
    let head = listed.as_array().unwrap().iter().find(|one| one["instances"] == slices(&files[0]));
    let head = head.unwrap_or_else(|| panic!("{listed}"));

    let (_process, address) = searching(&orthanc, folder.path(), &[]);
    let archives = json!({ "archives": ["pacs"], "take_results": false });
    assert_eq!(get(&address, "/v1/archives", "").json(), archives);
    let everything = found(&address, &json!({ "patient_id": "*" }));
    assert_eq!(everything.len(), 2, "{everything:?}");
    let by_description = found(&address, &json!({ "description": "*phantom*head" }));
    assert_eq!(by_description.len(), 1, "{by_description:?}");
    assert_eq!(by_description[0]["instances"], slices(&files[0]));
    assert!(by_description[0].get("description").is_none() && by_description[0].get("patient_id").is_none());
    assert_eq!(found(&address, &json!({ "patient_id": "nobody" })), Vec::<Value>::new());

    let key = by_description[0]["key"].as_str().unwrap();
    let last = loaded(&address, key);
    let (_local, local) = lone(&files[..1]);
    assert_eq!(last, json!({ "state": "ready", "volume": volumes(&local)[0] }));
    assert_eq!(volumes(&address), volumes(&local));
    assert_eq!(loaded(&address, key), last, "a repeat changes nothing");
    let again = found(&address, &json!({ "description": "*phantom*head" }));
    assert_eq!(again[0]["load"], last);

    let log = std::fs::read_to_string(folder.path().join("serve.log")).unwrap();
    for text in ["study_uid", "series_uid"].map(|name| head[name].as_str().unwrap()) {
        assert!(text.len() > 8 && !log.contains(text), "{text} is in the log:\n{log}");
        assert!(!again[0].to_string().contains(text), "{text} is in {}", again[0]);
    }
    let (_process, shown) = searching(&orthanc, folder.path(), &["--show-patient-data"]);
    let series = found(&shown, &json!({ "description": "*phantom*head" }));
    let patient = series[0]["patient_id"].as_str().unwrap();
    assert!(patient.starts_with("PHANTOM-HEAD") && !log.contains(patient), "{patient}");
    assert_eq!(series[0]["description"], head["description"]);
}

/// A series that the operator serves with a label map keeps the map when a client loads the same
/// series from an archive.
#[test]
fn a_series_that_is_served_already_keeps_its_label_map() {
    let Some(orthanc) = Orthanc::start("a series that is served already", Wanted::Login) else { return };
    let folder = tempfile::tempdir().unwrap();
    let files = phantom(folder.path(), "head");
    orthanc.store(&files);
    let labels = files.join("labels.seg.nrrd");
    let more = ["--series", files.to_str().unwrap(), "--labels", labels.to_str().unwrap()];
    let (_process, address) = searching(&orthanc, folder.path(), &more);
    until("the series is served", || volumes(&address).len() == 1);
    let segments = || get(&address, "/v1/volumes", "").json()["volumes"][0]["segments"].clone();
    let before = segments();
    assert!(before.as_array().is_some_and(|segments| !segments.is_empty()), "{before}");
    let series = found(&address, &json!({ "patient_id": "*" }));
    let last = loaded(&address, series[0]["key"].as_str().unwrap());
    assert_eq!(last["volume"], json!(volumes(&address)[0]));
    assert_eq!(segments(), before);
}

/// Searches that are wrong, archives that are gone, and callers without the scope get a reason.
#[test]
fn wrong_searches_and_callers_without_the_scope_are_refused() {
    let Some(orthanc) = Orthanc::start("refused searches of archives", Wanted::Login) else { return };
    let folder = tempfile::tempdir().unwrap();
    let tokens = folder.path().join("tokens");
    let made = orthanc
        .relief(&["token", "add"])
        .arg(&tokens)
        .args(["--name", "vera", "--scope", "annotate"])
        .output();
    let token = String::from_utf8(made.unwrap().stdout).unwrap();
    let token = token.split_whitespace().last().unwrap().to_owned();
    let (_guarded, guarded) = searching(&orthanc, folder.path(), &["--token-file", tokens.to_str().unwrap()]);
    let headers = format!("Content-Type: application/json\r\nAuthorization: Bearer {token}\r\n");
    let refused =
        ask(&guarded, "POST /v1/archives/pacs/search", &headers, "{\"patient_id\": \"*\"}").unwrap();
    assert_eq!(refused.status, 403);

    let (_process, address) = searching(&orthanc, folder.path(), &[]);
    let code = |path: &str, body: Value| {
        let answer = post(&address, path, &body);
        (answer.status, answer.json()["code"].as_str().unwrap().to_owned())
    };
    let search = "/v1/archives/pacs/search";
    assert_eq!(code(search, json!({})), (422, "out-of-range".to_owned()));
    assert_eq!(code(search, json!({ "patient_id": " " })), (422, "out-of-range".to_owned()));
    assert_eq!(code(search, json!({ "patient": "x" })), (400, "malformed-json".to_owned()));
    assert_eq!(
        code("/v1/archives/other/search", json!({ "patient_id": "*" })),
        (404, "no-archive".to_owned())
    );
    assert_eq!(code("/v1/archives/pacs/series/0123", json!({})), (404, "no-series".to_owned()));
    let (_closed, closed) = searching(&orthanc, folder.path(), &["--uploads", "off"]);
    let answer = post(&closed, search, &json!({ "patient_id": "*" }));
    assert_eq!((answer.status, &answer.json()["code"]), (403, &json!("uploads-off")));
    drop(orthanc);
    assert_eq!(code(search, json!({ "patient_id": "*" })), (502, "archive-failed".to_owned()));
}

/// Invariant: Pictures and annotations that callers of a server store in an archive become objects of
/// the volume's study, and are stored once.
#[test]
fn results_are_stored_once_in_the_study_of_the_volume() {
    let Some(orthanc) = Orthanc::start("results of a server", Wanted::Login) else { return };
    let folder = tempfile::tempdir().unwrap();
    let files = phantom(folder.path(), "head");
    orthanc.store(&files);
    let log = landmarks(folder.path(), &files);
    let series = ["--series", files.to_str().unwrap(), "--annotations", log.to_str().unwrap()];
    let (_process, address) =
        searching(&orthanc, folder.path(), &[&series[..], &["--archive-results"]].concat());
    until("the series is served", || volumes(&address).len() == 1);
    let volume = format!("/v1/volumes/{}", volumes(&address)[0]);

    let store = |part: &str, body: Value| {
        let answer = post(&address, &format!("{volume}/{part}"), &body);
        let json = answer.json();
        (answer.status, json["outcome"].as_str().or(json["code"].as_str()).unwrap().to_owned())
    };
    let [new, known] = [(201, "stored".to_owned()), (200, "already-there".to_owned())];
    let picture = "frame/store?preset=bone&size_px=64,48&annotations=true";
    assert_eq!(store(picture, json!({ "archive": "pacs" })), new);
    assert_eq!(store(picture, json!({ "archive": "pacs" })), known);
    let scene = json!({ "transfer": "skin", "size_px": [64, 48] });
    assert_eq!(store("frame/store", json!({ "archive": "pacs", "scene": scene })), new);
    let report = json!({ "archive": "pacs", "format": "sr" });
    assert_eq!(store("annotations/store", report.clone()), new);
    assert_eq!(store("annotations/store", report), known);

    let refused = |part: &str, body: Value| store(part, body).1;
    assert_eq!(refused("frame/store", json!({ "archive": "other" })), "no-archive");
    assert_eq!(refused("frame/store?presets=1", json!({ "archive": "pacs" })), "unknown-parameter");
    assert_eq!(refused(picture, json!({ "archive": "pacs", "scene": {} })), "unknown-parameter");
    let mesh = json!({ "archive": "pacs", "format": "csv" });
    assert_eq!(refused("annotations/store", mesh), "out-of-range");

    let listed = orthanc.relief(&["inspect", &orthanc.address(""), "--json"]).output().unwrap();
    let listed: Vec<Value> = serde_json::from_slice(&listed.stdout).unwrap();
    let mut kinds: Vec<(&str, u64)> = listed
        .iter()
        .map(|one| (one["modality"].as_str().unwrap(), one["instances"].as_u64().unwrap()))
        .collect();
    kinds.sort_unstable();
    assert_eq!(kinds, [("CT", slices(&files) as u64), ("OT", 2), ("SR", 1)], "{listed:?}");
    assert!(listed.iter().all(|one| one["study_uid"] == listed[0]["study_uid"]), "{listed:?}");
}

/// Results are stored only where the operator allows it, and by callers who may annotate.
#[test]
fn results_are_refused_without_the_option_and_the_scope() {
    let Some(orthanc) = Orthanc::start("refused results of a server", Wanted::Login) else { return };
    let folder = tempfile::tempdir().unwrap();
    let files = phantom(folder.path(), "sphere");
    let series = ["--series", files.to_str().unwrap()];
    let (_process, address) = searching(&orthanc, folder.path(), &series);
    until("the series is served", || volumes(&address).len() == 1);
    let path = format!("/v1/volumes/{}/frame/store?size_px=64,48", volumes(&address)[0]);
    let answer = post(&address, &path, &json!({ "archive": "pacs" }));
    assert_eq!((answer.status, &answer.json()["code"]), (403, &json!("results-off")));

    let tokens = folder.path().join("tokens");
    let token = |name: &str, scope: &str| {
        let mut add = relief(&["token", "add"]);
        let made = add.arg(&tokens).args(["--name", name, "--scope", scope]).output().unwrap();
        String::from_utf8(made.stdout).unwrap().split_whitespace().last().unwrap().to_owned()
    };
    let [viewer, reader] = [token("viewer", "view"), token("reader", "annotate")];
    let alone = folder.path().join("alone.nrrd");
    let header = "NRRD0004\ntype: short\ndimension: 3\nsizes: 4 4 4\nencoding: raw\nendian: little\n\
                  space: left-posterior-superior\nspace directions: (1,0,0) (0,1,0) (0,0,1)\n\
                  space origin: (0,0,0)\n\n";
    std::fs::write(&alone, [header.as_bytes(), &[1; 2 * 64]].concat()).unwrap();
    let of_no_study = ["--series", alone.to_str().unwrap(), "--archive-results"];
    let (_process, address) = searching(&orthanc, folder.path(), &of_no_study);
    until("the volume is served", || volumes(&address).len() == 1);
    let unrelated = format!("/v1/volumes/{}/frame/store?size_px=64,48", volumes(&address)[0]);
    let answer = post(&address, &unrelated, &json!({ "archive": "pacs" }));
    assert_eq!((answer.status, &answer.json()["code"]), (422, &json!("no-study")));

    let guarded = ["--archive-results", "--token-file", tokens.to_str().unwrap()];
    let (_process, address) = searching(&orthanc, folder.path(), &[&series[..], &guarded].concat());
    let stored = |token: &str| {
        let headers = format!("Authorization: Bearer {token}\r\nContent-Type: application/json\r\n");
        let body = json!({ "archive": "pacs" }).to_string();
        ask(&address, &format!("POST {path}"), &headers, &body).unwrap().status
    };
    until("the series is served", || stored(&reader) != 404);
    assert_eq!(stored(&viewer), 403);
    assert_eq!(stored(&reader), 200);
    drop(orthanc);
    let gone = path.replace("64,48", "64,64");
    let headers = format!("Authorization: Bearer {reader}\r\nContent-Type: application/json\r\n");
    let answer = ask(&address, &format!("POST {gone}"), &headers, r#"{"archive": "pacs"}"#).unwrap();
    assert_eq!((answer.status, &answer.json()["code"]), (502, &json!("archive-failed")));
}

/// The page finds a series in an archive, shows how much of it has arrived, and then the volume.
#[test]
fn the_page_finds_and_loads_a_series() {
    let what = "searches of archives on the page";
    let (Some(python), Some(chromium)) = (python(), chromium()) else { return skipped(what) };
    let Some(orthanc) = Orthanc::start(what, Wanted::Login) else { return };
    let folder = tempfile::tempdir().unwrap();
    let files = phantom(folder.path(), "head");
    orthanc.store(&files);
    let log = landmarks(folder.path(), &files);
    let more = ["--show-patient-data", "--archive-results", "--annotations", log.to_str().unwrap()];
    let (_process, address) = searching(&orthanc, folder.path(), &more);
    let script = crate::cluster::stage::root().join("tests/browser/archives.py");
    let mut command = Command::new(python);
    command.env("PYTHONDONTWRITEBYTECODE", "1").arg(script).arg(&chromium).arg(format!("http://{address}"));
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let seen: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(seen["problems"], json!([]));
    assert_eq!(seen["none"], "No CT series match.");
    assert_eq!(seen["empty"], "Fill in at least one field.");
    assert_eq!(seen["found"], "1 CT series");
    assert!(seen["row"].as_str().unwrap().contains(&format!("{} slices", slices(&files))), "{seen}");
    assert_eq!(seen["shown"], json!(volumes(&address)));
    let said = [
        "Stored in pacs.",
        "pacs has this picture already.",
        "Stored in pacs. 2 kinds of values cannot be represented in this format and are left out.",
        "pacs has these annotations already. 2 kinds of values cannot be represented in this format and are left out.",
    ];
    assert_eq!(seen["stored"], json!(said));
    assert_eq!(seen["violations"], json!([]), "{seen}");
}
