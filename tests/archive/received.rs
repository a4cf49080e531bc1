//! Servers that receive series by the DICOM network (`relief serve --receive`).

use std::process::Stdio;

use dicom_core::{DataElement, VR};
use dicom_dictionary_std::tags;

use super::receive::{dcmtk, printed, send, slices_below};
use crate::cluster::stage::{Process, free_ports, listed, lone, phantom, relief, until, volumes};

/// Invariant: A server shows series that arrive by the DICOM network, and those that arrived before
/// it was restarted.
#[test]
fn a_server_shows_series_that_arrive() {
    let what = "a server that receives";
    let Some(mut storescu) = dcmtk(what, "storescu") else { return };
    let folder = tempfile::tempdir().unwrap();
    let (inbox, series) = (folder.path().join("inbox"), phantom(folder.path(), "slab"));
    let port = free_ports();
    let start = || {
        let mut serve =
            relief(&["serve", "--listen", "127.0.0.1:0", "--listen-when-loaded", "--receive-quiet", "1"]);
        serve.args(["--receive-caller", "SCANNER", "--receive-listen", &format!("127.0.0.1:{port}")]);
        let (process, lines) = Process::start(serve.arg("--receive").arg(&inbox).stderr(Stdio::null()));
        (process, lines[0].split_once("http://").unwrap().1.trim_end_matches('/').to_owned())
    };
    let (_lone, expected) = lone(std::slice::from_ref(&series));
    let (process, address) = start();
    assert_eq!(volumes(&address), [""; 0]);
    let sent = send(storescu.arg("--abort"), "SCANNER", port, &series);
    assert!(sent.status.success(), "{}", printed(&sent));
    until("the series is served", || volumes(&address) == volumes(&expected));
    // The transfer was aborted: the page says so, until the series is sent again.
    let is_warned = |address: &str| listed(address).to_string().contains("\"interrupted\"");
    until("the series has a warning", || is_warned(&address));
    assert_eq!(process.stop(), Some(0));
    let (_process, address) = start();
    assert_eq!(volumes(&address), volumes(&expected));
    assert!(is_warned(&address), "{}", listed(&address));
    let Some(mut storescu) = dcmtk(what, "storescu") else { return };
    assert!(send(&mut storescu, "SCANNER", port, &series).status.success());
    until("the warning is gone", || !is_warned(&address));
}

/// Invariant: When objects of a received series arrive later, a server shows the larger volume in
/// place of the smaller one.
#[test]
fn a_series_that_grows_is_replaced() {
    let what = "a series that grows";
    let Some(mut storescu) = dcmtk(what, "storescu") else { return };
    let folder = tempfile::tempdir().unwrap();
    let (inbox, series) = (folder.path().join("inbox"), phantom(folder.path(), "head"));
    let parts = ["first", "second"].map(|name| folder.path().join(name));
    parts.iter().for_each(|part| std::fs::create_dir(part).unwrap());
    let mut files: Vec<_> = std::fs::read_dir(&series).unwrap().map(|file| file.unwrap().path()).collect();
    files.retain(|file| file.extension().is_some_and(|ending| ending == "dcm"));
    files.sort();
    for (number, file) in files.iter().enumerate() {
        let part = &parts[usize::from(number >= files.len() / 2)];
        std::fs::copy(file, part.join(file.file_name().unwrap())).unwrap();
    }
    let port = free_ports();
    let mut serve =
        relief(&["serve", "--listen", "127.0.0.1:0", "--receive-quiet", "1", "--receive-caller", "SCANNER"]);
    serve.args(["--receive-listen", &format!("127.0.0.1:{port}"), "--receive"]).arg(&inbox);
    let (_process, lines) = Process::start(serve.stderr(Stdio::null()));
    let address = lines[0].split_once("http://").unwrap().1.trim_end_matches('/').to_owned();
    let (_lone, expected) = lone(std::slice::from_ref(&series));
    assert!(send(&mut storescu, "SCANNER", port, &parts[0]).status.success());
    until("the first half is served", || volumes(&address).len() == 1);
    assert_ne!(volumes(&address), volumes(&expected));
    let Some(mut storescu) = dcmtk(what, "storescu") else { return };
    assert!(send(&mut storescu, "SCANNER", port, &parts[1]).status.success());
    until("the whole series is served alone", || volumes(&address) == volumes(&expected));
}

/// Series of buckets and archives are read in the same way.
#[test]
fn the_phases_of_a_received_series_are_served_together() {
    let folder = tempfile::tempdir().unwrap();
    let (series, inbox) = (phantom(folder.path(), "slab"), folder.path().join("inbox"));
    let received = inbox.join("study").join("series");
    std::fs::create_dir_all(&received).unwrap();
    for slice in slices_below(&series) {
        let mut object = dicom_object::open_file(&slice).unwrap();
        let uid = object.element(tags::SOP_INSTANCE_UID).unwrap().to_str().unwrap().into_owned();
        for phase in ["1", "2"] {
            object.put(DataElement::new(tags::TEMPORAL_POSITION_IDENTIFIER, VR::IS, phase));
            object.put(DataElement::new(tags::SOP_INSTANCE_UID, VR::UI, format!("{uid}.{phase}")));
            let name = format!("{phase}-{}", slice.file_name().unwrap().to_str().unwrap());
            object.write_to_file(received.join(name)).unwrap();
        }
    }
    let mut serve = relief(&["serve", "--listen", "127.0.0.1:0", "--receive-caller", "SCANNER"]);
    serve.args(["--receive-listen", &format!("127.0.0.1:{}", free_ports()), "--receive"]).arg(&inbox);
    let (_process, lines) = Process::start(serve.stderr(Stdio::null()));
    let address = lines[0].split_once("http://").unwrap().1.trim_end_matches('/').to_owned();
    until("both phases are served", || volumes(&address).len() == 2);
    let listed = listed(&address);
    let phases: Vec<_> =
        listed["volumes"].as_array().unwrap().iter().map(|volume| &volume["phase"]).collect();
    assert_eq!(phases[0]["series"], phases[1]["series"], "{listed}");
    assert_eq!([0, 1].map(|at: usize| phases[at]["number"].as_u64().unwrap()), [1, 2]);
}
