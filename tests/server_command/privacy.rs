//! Planted names, ids and UIDs of a patient are searched in everything that a server and the command
//! line print, log, answer and leave behind.

use std::path::Path;

use dicom_core::{DataElement, VR};
use dicom_dictionary_std::tags;
use relief_dicom::Strictness;

use super::{Running, phantom, relief};

/// Texts that must not be seen: a name, an id, and every UID of the series.
struct Planted(Vec<String>);

impl Planted {
    /// Gives the slices of a phantom a patient, and reads their UIDs.
    fn into(series: &Path) -> Self {
        let mut planted = vec!["DOE^JAN".to_owned()];
        for slice in std::fs::read_dir(series).unwrap() {
            let path = slice.unwrap().path();
            if path.extension().is_none_or(|extension| extension != "dcm") {
                continue; // what is known of the phantom, beside its slices
            }
            let bytes = std::fs::read(&path).unwrap();
            // The description of a series is free text, and may have the name as well.
            let bytes = replaced(&bytes, b"PHANTOM", b"DOE^JAN");
            std::fs::write(&path, replaced(&bytes, b"Procedu", b"DOE^JAN")).unwrap();
        }
        let found = relief_dicom::discover(series, Strictness::Lenient, &|_| ()).unwrap();
        let entry = found.select(None).unwrap();
        planted.push(entry.uid().to_owned());
        planted.push(entry.frame_of_reference().unwrap().to_owned());
        let json = serde_json::to_string(&relief_dicom::SeriesReference::of(entry).unwrap()).unwrap();
        let words = json.split('"').filter(|word| word.len() > 20 && word.starts_with("2.25."));
        planted.extend(words.map(str::to_owned));
        planted.sort();
        planted.dedup();
        assert!(planted.len() > 10, "{planted:?}");
        Self(planted)
    }

    /// Those of them that bytes contain.
    fn in_bytes(&self, bytes: &[u8]) -> Vec<&str> {
        let is_in = |word: &&String| bytes.windows(word.len()).any(|window| window == word.as_bytes());
        self.0.iter().filter(is_in).map(String::as_str).collect()
    }

    fn assert_absent(&self, place: &str, bytes: &[u8]) {
        let seen = self.in_bytes(bytes);
        assert!(seen.is_empty(), "{place} has {} planted words, such as {}", seen.len(), seen[0]);
    }
}

fn replaced(bytes: &[u8], from: &[u8; 7], to: &[u8; 7]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let mut count = 0;
    for at in 0..bytes.len().saturating_sub(from.len()) {
        if bytes[at..at + from.len()] == *from {
            bytes[at..at + to.len()].copy_from_slice(to);
            count += 1;
        }
    }
    assert!(count > 0, "a phantom has the name of one");
    bytes
}

#[test]
fn descriptions_are_shown_if_the_operator_allows_it() {
    let folder = tempfile::tempdir().unwrap();
    let series = phantom(folder.path());
    let _planted = Planted::into(Path::new(&series));
    for slice in std::fs::read_dir(&series).unwrap().map(|slice| slice.unwrap().path()) {
        if let Ok(mut object) = dicom_object::open_file(&slice) {
            object.put(DataElement::new(tags::STUDY_DATE, VR::DA, "20090314"));
            object.write_to_file(&slice).unwrap();
        }
    }
    let name = |more: &[&str]| {
        let arguments = ["serve", "--series", &series, "--listen", "127.0.0.1:0"];
        let running = Running::spawn(&mut relief(&[&arguments[..], more].concat()));
        running.await_ready();
        let listed: serde_json::Value = serde_json::from_slice(&running.get("/v1/volumes").1).unwrap();
        listed["volumes"][0]["name"].as_str().unwrap().to_owned()
    };
    let hidden = name(&[]);
    assert!(hidden.starts_with("Object, ") && !hidden.contains("2009"), "{hidden}");
    let shown = name(&["--show-patient-data"]);
    assert!(shown.starts_with("DOE^JANral phantom: ") && shown.ends_with(", 2009-03-14"), "{shown}");
}

/// Invariant: No name, id or UID of a patient is in an answer, a log line, a metric, the audit log or
/// a file that a server leaves behind.
#[test]
fn a_server_names_no_patient() {
    let folder = tempfile::tempdir().unwrap();
    let series = phantom(folder.path());
    let planted = Planted::into(Path::new(&series));
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (audit, temporary) = (path("audit.log"), path("temporary"));
    std::fs::create_dir(&temporary).unwrap();
    let arguments = ["serve", "--series", &series, "--listen", "127.0.0.1:0", "--audit-log", &audit];
    let log = path("log.db");
    let more = ["--annotations", &log];
    let mut command = relief(&[&arguments[..], &more].concat());
    let running = Running::spawn(command.env("RELIEF_LOG", "relief=trace").env("TMPDIR", &temporary));
    running.await_ready();
    let listed = running.get("/v1/volumes").1;
    planted.assert_absent("/v1/volumes", &listed);
    let listed: serde_json::Value = serde_json::from_slice(&listed).unwrap();
    let volume = format!("/v1/volumes/{}", listed["volumes"][0]["id"].as_str().unwrap());
    let point = r#"{"changes":[{"change":"create","item":{"name":"L1","geometry":{"kind":"point","at_mm":[0,0,0]}}}]}"#;
    let headers = format!(
        "Content-Type: application/json\r\nRelief-Author: anna\r\nContent-Length: {}\r\n",
        point.len()
    );
    let (head, made) = running.ask(&format!("POST {volume}/annotations"), &headers, point.as_bytes());
    assert!(head.contains(" 201 "), "{head}");
    planted.assert_absent("an edit", &made);
    for part in [
        "",
        "/frame?layout=color&size_px=64,64",
        "/frame?layout=nonsense",
        "/slice?plane=axial&size_px=64,64",
        "/depth?size_px=64,64",
        "/pick?u=1&v=1",
        "/annotations/log",
        "/annotations/export?format=csv",
        "/annotations/export?format=cornerstone&deidentify=true",
        "/annotations/export?format=sr&deidentify=true",
    ] {
        let (head, body) = running.get(&format!("{volume}{part}"));
        planted.assert_absent(part, &[head.as_bytes(), &body].concat());
    }
    for other in ["/metrics", "/readyz", "/openapi.json", "/studies/1.2.3/series/1.2.4/rendered3D"] {
        let (head, body) = running.get(other);
        planted.assert_absent(other, &[head.as_bytes(), &body].concat());
    }
    // A series by its UIDs, and an upload that cannot be read.
    let uid = &planted.0[1];
    running.get(&format!("/studies/{uid}/series/{uid}/rendered3D"));
    let found = relief_dicom::discover(Path::new(&series), Strictness::Lenient, &|_| ()).unwrap();
    assert_eq!(found.series.len(), 1);
    let slices = std::fs::read_dir(&series).unwrap().map(|slice| slice.unwrap().path());
    let slice = slices.filter(|path| path.extension().is_some_and(|ending| ending == "dcm")).min().unwrap();
    let bytes = std::fs::read(slice).unwrap();
    let zip = crate::common::hostile::zip_of([("DOE^JAN.dcm".to_owned(), bytes[..bytes.len() / 2].to_vec())]);
    planted.assert_absent("a refused upload", &running.upload(&zip).1);
    let (_, said) = running.stop("TERM");
    assert!(said.contains("/v1/volumes"), "requests are logged at this level: {said}");
    planted.assert_absent("the log", said.as_bytes());
    planted.assert_absent("the audit log", &std::fs::read(&audit).unwrap());
    for file in walkdir::WalkDir::new(&temporary).into_iter().map(Result::unwrap) {
        planted.assert_absent("a name of a temporary file", file.path().to_str().unwrap().as_bytes());
        if file.file_type().is_file() {
            planted.assert_absent("a temporary file", &std::fs::read(file.path()).unwrap());
        }
    }
}

/// Invariant: An export without identities has no name, id or UID of the patient, in any format.
#[test]
fn an_export_without_identities_names_no_patient() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (series, log) = (path("head"), path("log.db"));
    let made = relief(&["phantom", "--kind", "head", "--size", "48", "--out", &series]).output().unwrap();
    assert!(made.status.success());
    for (name, file) in [("landmarks.csv", "landmarks.csv"), ("labels.seg.nrrd", "labels.seg.nrrd")] {
        std::fs::rename(Path::new(&series).join(name), folder.path().join(file)).unwrap();
        let _ = std::fs::remove_file(Path::new(&series).join("truth.json"));
    }
    let planted = Planted::into(Path::new(&series));
    let annotate = |arguments: &[&str]| {
        let output = relief(&[&["annotate", "--db", &log][..], arguments].concat()).output().unwrap();
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        planted.assert_absent("what the command prints", &[output.stdout, output.stderr].concat());
    };
    for file in ["landmarks.csv", "labels.seg.nrrd"] {
        annotate(&["import", &path(file), "--series", &series, "--author", "Dr. Ann Lee"]);
    }
    for (format, names_series) in
        [("sr", true), ("seg", true), ("cornerstone", true), ("mrk.json", false), ("csv", false)]
    {
        let [named, without] = ["named", "without"].map(|kind| path(&format!("{kind}.{format}")));
        annotate(&["export", "--format", format, "--series", &series, "--out", &named]);
        annotate(&["export", "--format", format, "--series", &series, "--deidentify", "--out", &without]);
        let (named, without) = (std::fs::read(named).unwrap(), std::fs::read(without).unwrap());
        assert_eq!(!planted.in_bytes(&named).is_empty(), names_series, "{format}");
        planted.assert_absent(format, &without);
        let author = b"Ann Lee";
        assert!(!without.windows(author.len()).any(|window| window == author), "{format} has the author");
    }
}
