//! `relief receive`: series that DCMTK and Orthanc send arrive whole, and acknowledged objects stay.

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use super::orthanc::{Orthanc, Wanted};
use crate::cluster::stage::{phantom, relief, until};
use crate::common::child;
use crate::common::child::signal;

/// A receiver of a test's own.
pub(crate) struct Receiving {
    process: Child,
    lines: std::io::Lines<BufReader<std::process::ChildStdout>>,
    port: u16,
}

impl Receiving {
    pub(crate) fn start(inbox: &Path, more: &[&str]) -> Self {
        let mut command = relief(&["receive", "--port", "0", "--into"]);
        command.arg(inbox);
        if !more.contains(&"--quiet") {
            command.args(["--quiet", "1"]);
        }
        command.args(more).stdout(Stdio::piped());
        let mut process = command.stderr(Stdio::null()).spawn().unwrap();
        let mut lines = BufReader::new(process.stdout.take().unwrap()).lines();
        let first = lines.next().unwrap().unwrap();
        let port = first.split([':', ' ']).find_map(|part| part.parse().ok()).unwrap();
        Self { process, lines, port }
    }

    pub(crate) fn port(&self) -> u16 {
        self.port
    }

    fn line(&mut self) -> String {
        self.lines.next().unwrap().unwrap()
    }
}

impl Drop for Receiving {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// A program of DCMTK; `None` after saying aloud that `what` was not tested.
pub(crate) fn dcmtk(what: &str, name: &str) -> Option<Command> {
    let Some(programs) = std::env::var_os("RELIEF_ORTHANC").map(PathBuf::from) else {
        eprintln!("SKIPPED: {what} (RELIEF_ORTHANC is not set, see scripts/setup-services)");
        return None;
    };
    Some(Command::new(programs.join(name)))
}

pub(crate) fn send(storescu: &mut Command, caller: &str, port: u16, series: &Path) -> Output {
    storescu.args(["-v", "-aec", "RELIEF", "-aet", caller, "127.0.0.1", &port.to_string()]);
    storescu.args(["+sd", "+r", "+sp", "*.dcm"]).arg(series).output().unwrap()
}

pub(crate) fn printed(output: &Output) -> String {
    [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).into_owned()).concat()
}

fn files_below(folder: &Path) -> Vec<PathBuf> {
    let all = walkdir::WalkDir::new(folder).into_iter().map(Result::unwrap);
    all.filter(|entry| entry.file_type().is_file()).map(walkdir::DirEntry::into_path).collect()
}

/// Without the landmarks that lie beside them.
pub(crate) fn slices_below(folder: &Path) -> Vec<PathBuf> {
    let mut files = files_below(folder);
    files.retain(|path| path.extension().is_some_and(|extension| extension == "dcm"));
    files
}

fn folders_in(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.filter(|path| path.is_dir()).collect()
}

fn picture(series: &Path, out: &Path) -> Vec<u8> {
    let mut render =
        relief(&["render", "--preset", "bone", "--layout", "color", "--size", "64x48", "--series"]);
    let made = render.arg(series).arg("--out").arg(out).output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    std::fs::read(out).unwrap()
}

/// Invariant: A series that arrives by the DICOM network gives the picture of its files; callers
/// that are not known, and objects beyond the quota, are refused.
#[test]
fn series_of_known_callers_arrive_whole() {
    let what = "the DICOM network";
    let Some(mut echoscu) = dcmtk(what, "echoscu") else { return };
    let folder = tempfile::tempdir().unwrap();
    let (series, inbox) = (phantom(folder.path(), "slab"), folder.path().join("inbox"));
    let mut receiving = Receiving::start(
        &inbox,
        &["--caller", "SCANNER", "--caller", "ORTHANC@127.0.0.1", "--quota", "160KiB"],
    );
    let port = receiving.port.to_string();
    let echoed = echoscu.args(["-aec", "RELIEF", "-aet", "SCANNER", "127.0.0.1", &port]).output().unwrap();
    assert!(echoed.status.success(), "{}", String::from_utf8_lossy(&echoed.stderr));
    let stranger = send(&mut dcmtk(what, "storescu").unwrap(), "STRANGER", receiving.port, &series);
    let said = printed(&stranger);
    assert!(!stranger.status.success() && said.contains("Calling AE Title Not Recognized"), "{said}");
    assert!(files_below(&inbox).is_empty());

    let sent = send(&mut dcmtk(what, "storescu").unwrap(), "SCANNER", receiving.port, &series);
    assert!(sent.status.success(), "{}", printed(&sent));
    let line = receiving.line();
    let (received, count) = line.rsplit_once(": ").unwrap();
    assert_eq!(count, "32 objects");
    let [expected, found] =
        [&series, Path::new(received)].map(|path| picture(path, &folder.path().join("out.png")));
    assert!(expected == found);
    // Once more: acknowledged, and nothing new. Then another series, for which there is no room.
    let again = send(&mut dcmtk(what, "storescu").unwrap(), "SCANNER", receiving.port, &series);
    assert!(again.status.success() && files_below(&inbox).len() == 32);
    let more = send(
        &mut dcmtk(what, "storescu").unwrap(),
        "SCANNER",
        receiving.port,
        &phantom(folder.path(), "head"),
    );
    let said = printed(&more);
    assert!(said.contains("OutOfResources"), "{said}");
    let bytes: u64 = slices_below(&inbox).iter().map(|file| file.metadata().unwrap().len()).sum();
    assert!(bytes <= 120 << 10, "{bytes}");
    signal("TERM", receiving.process.id());
    assert!(receiving.process.wait().unwrap().success());
}

/// Invariant: Orthanc sends series to the receiver.
#[test]
fn orthanc_sends_its_series() {
    let Some(orthanc) = Orthanc::start("series that Orthanc sends", Wanted::Login) else { return };
    let folder = tempfile::tempdir().unwrap();
    let (series, inbox) = (phantom(folder.path(), "sphere"), folder.path().join("inbox"));
    orthanc.store(&series);
    let mut receiving = Receiving::start(&inbox, &["--caller", "ORTHANC@127.0.0.1"]);
    orthanc.send_all("RELIEF", receiving.port);
    let line = receiving.line();
    let received = line.rsplit_once(": ").unwrap().0;
    let [expected, found] =
        [&series, Path::new(received)].map(|path| picture(path, &folder.path().join("out.png")));
    assert!(expected == found);
}

/// Invariant: An archive that asks whether its objects are kept gets a report at its own address, and
/// the series is complete.
#[test]
fn orthanc_learns_that_its_objects_are_kept() {
    let what = "storage commitment";
    let Some(orthanc) = Orthanc::start(what, Wanted::Login) else { return };
    let folder = tempfile::tempdir().unwrap();
    let (series, inbox) = (phantom(folder.path(), "sphere"), folder.path().join("inbox"));
    orthanc.store(&series);
    let provider = orthanc.network_address().replace("dicom://", "");
    let mut receiving = Receiving::start(&inbox, &["--caller", &provider, "--quiet", "3600"]);
    orthanc.send_all("RELIEF", receiving.port);
    let report = orthanc.commit_all();
    assert_eq!((&report["Status"], report["Success"].as_array().unwrap().len()), (&"Success".into(), 32));
    assert!(receiving.line().ends_with(": 32 objects"), "complete, long before it is quiet");

    let gone = files_below(&inbox).pop().unwrap();
    std::fs::remove_file(gone).unwrap();
    let report = orthanc.commit_all();
    assert_eq!(report["Status"], "Failure", "{report}");
    assert_eq!(
        (report["Success"].as_array().unwrap().len(), report["Failures"].as_array().unwrap().len()),
        (31, 1)
    );
}

/// Asks for the commitment of a known and of an unknown object, and prints the response and the report.
const PYNETDICOM: &str = r#"
import json, sys, threading
import pydicom
from pynetdicom import AE, evt
port, path = int(sys.argv[1]), sys.argv[2]
COMMITMENT, INSTANCE = "1.2.840.10008.1.20.1", "1.2.840.10008.1.20.1.1"
known = pydicom.dcmread(path, stop_before_pixels=True)
def item(instance):
    made = pydicom.Dataset()
    made.ReferencedSOPClassUID, made.ReferencedSOPInstanceUID = known.SOPClassUID, instance
    return made
asked = pydicom.Dataset()
asked.TransactionUID = "1.2.3.4"
asked.ReferencedSOPSequence = [item(known.SOPInstanceUID), item("1.2.3.99")]
def dialogue():
    reported, seen = threading.Event(), {}
    def on_report(event):
        told = event.event_information
        seen.update(event=event.event_type, transaction=str(told.TransactionUID),
            kept=[one.ReferencedSOPInstanceUID == known.SOPInstanceUID for one in told.ReferencedSOPSequence],
            failed=[[str(one.ReferencedSOPInstanceUID), one.FailureReason] for one in told.FailedSOPSequence])
        reported.set()
        return 0x0000, None
    ae = AE(ae_title="SCANNER")
    ae.dimse_timeout = 10
    ae.add_requested_context(COMMITMENT)
    ae.add_requested_context("1.2.840.10008.1.1")
    handlers = [(evt.EVT_N_EVENT_REPORT, on_report)]
    association = ae.associate("127.0.0.1", port, ae_title="RELIEF", evt_handlers=handlers)
    seen["status"] = association.send_n_action(asked, 1, COMMITMENT, INSTANCE)[0].get("Status")
    seen["is_reported"] = reported.wait(20)
    bad = pydicom.Dataset()
    bad.TransactionUID = ""
    seen["bad"] = association.send_n_action(bad, 1, COMMITMENT, INSTANCE)[0].get("Status")
    seen["echo"] = association.send_c_echo().get("Status")
    association.release()
    return seen
# On a busy machine, the reactor of pynetdicom 3.0.4 can take a response from the call that waits for it:
# it counts as paused until it has passed its checkpoint. The call then ends without a status.
for attempt in range(5):
    try:
        seen = dialogue()
    except RuntimeError:  # the association was aborted, see above
        continue
    if None not in (seen["status"], seen["bad"], seen["echo"]):
        break
print(json.dumps(seen))
"#;

/// Invariant: A caller without an address of its own gets the report in its association, with the
/// missing objects.
#[test]
fn a_report_names_what_is_missing() {
    let what = "storage commitment by pynetdicom";
    let Some(mut storescu) = dcmtk(what, "storescu") else { return };
    let Some(python) = std::env::var_os("RELIEF_PEERS_PYTHON") else {
        eprintln!("SKIPPED: {what} (RELIEF_PEERS_PYTHON is not set)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let (series, inbox) = (phantom(folder.path(), "slab"), folder.path().join("inbox"));
    let receiving = Receiving::start(&inbox, &["--caller", "SCANNER"]);
    let sent = send(&mut storescu, "SCANNER", receiving.port, &series);
    assert!(sent.status.success(), "{}", printed(&sent));
    let mut scanner = Command::new(python);
    scanner.args(["-c", PYNETDICOM, &receiving.port.to_string()]).arg(&slices_below(&series)[0]);
    let output = scanner.output().unwrap();
    let seen: serde_json::Value =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", printed(&output)));
    let expected = serde_json::json!({
        "status": 0, "is_reported": true, "event": 2, "transaction": "1.2.3.4", "kept": [true],
        "failed": [["1.2.3.99", 0x0112]], "bad": 0x0115, "echo": 0,
    });
    assert_eq!(seen, expected);
}

/// Invariant: What a receiver acknowledged is there after it was killed at any moment, and nothing
/// is half written.
#[test]
fn what_was_acknowledged_survives_a_kill() {
    let what = "a killed receiver";
    if dcmtk(what, "storescu").is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (series, inbox) = (phantom(folder.path(), "head"), folder.path().join("inbox"));
    let all = files_below(&series)
        .into_iter()
        .filter(|path| path.extension().is_some_and(|it| it == "dcm"))
        .count();
    let mut acknowledged = 0;
    // Moments that are spread over the objects, and over the steps of one.
    for kill in 0..20 {
        let (objects, delay) = (1 + kill * 7 % 20, Duration::from_micros((kill * 137 % 900) as u64));
        let receiving = Receiving::start(&inbox, &["--any-caller"]);
        let mut storescu = dcmtk(what, "storescu").unwrap();
        storescu.arg("-v").args(["-aec", "RELIEF", "127.0.0.1", &receiving.port.to_string()]);
        storescu
            .args(["+sd", "+r", "+sp", "*.dcm"])
            .arg(&series)
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        let mut sending = storescu.spawn().unwrap();
        let mut answers = 0;
        for line in BufReader::new(sending.stderr.take().unwrap()).lines().map_while(Result::ok) {
            answers += usize::from(line.contains("Received Store Response (Success)"));
            if answers == objects {
                std::thread::sleep(delay);
                signal("KILL", receiving.process.id());
            }
        }
        let _ = sending.wait();
        acknowledged = acknowledged.max(answers);
        let files: Vec<PathBuf> = files_below(&inbox);
        let whole: Vec<&PathBuf> =
            files.iter().filter(|path| path.extension().is_some_and(|it| it == "dcm")).collect();
        assert!(whole.len() >= acknowledged, "{} of {acknowledged}", whole.len());
        for file in whole {
            let bytes = std::fs::read(file).unwrap();
            relief_dicom::read_identity(&bytes).unwrap();
        }
    }
    assert!(acknowledged > 0 && acknowledged < all, "{acknowledged} of {all}");
    let mut receiving = Receiving::start(&inbox, &["--any-caller"]);
    let sent = send(&mut dcmtk(what, "storescu").unwrap(), "ANY", receiving.port, &series);
    assert!(sent.status.success());
    receiving.line();
    let received =
        files_below(&inbox).into_iter().filter(|path| path.extension().is_some_and(|it| it == "dcm"));
    assert_eq!(received.count(), all);
}

/// Invariant: Four callers at once lose nothing, series stay in order, and the memory of a receiver does not grow with the
/// number of objects.
#[test]
fn four_callers_at_once_lose_nothing() {
    let what = "four callers";
    if dcmtk(what, "storescu").is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let series = ["head", "slab", "sphere", "ramp"].map(|kind| phantom(folder.path(), kind));
    let inbox = folder.path().join("inbox");
    let receiving = Receiving::start(&inbox, &["--any-caller"]);
    let sent = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for series in &series {
            let (sent, port) = (&sent, receiving.port);
            scope.spawn(move || {
                let output = send(&mut dcmtk(what, "storescu").unwrap(), "ANY", port, series);
                assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
                let slices = files_below(series)
                    .into_iter()
                    .filter(|path| path.extension().is_some_and(|it| it == "dcm"));
                sent.fetch_add(slices.count(), Ordering::Relaxed);
            });
        }
    });
    assert_eq!(files_below(&inbox).len(), sent.into_inner());
    // Pictures of the received series are those of the sent ones, so the slices are in their order.
    let out = folder.path().join("view.png");
    let studies = folders_in(&inbox).into_iter();
    let received = studies.flat_map(|study| folders_in(&study)).map(|series| picture(&series, &out));
    let pictures = series.iter().map(|series| picture(series, &out)).collect::<BTreeSet<_>>();
    assert!(pictures.len() == 4 && pictures == received.collect());
    assert!(child::peak_of(&receiving.process) < 100, "{} MiB", child::peak_of(&receiving.process));
}

/// Invariant: Reading a series whose transfer was interrupted gives a warning until the series is
/// sent again.
#[test]
fn an_interrupted_transfer_is_reported_until_it_was_repeated() {
    let what = "interrupted transfers";
    let Some(mut storescu) = dcmtk(what, "storescu") else { return };
    let folder = tempfile::tempdir().unwrap();
    let (inbox, series) = (folder.path().join("inbox"), phantom(folder.path(), "slab"));
    let mut receiving = Receiving::start(&inbox, &["--any-caller"]);
    let sent = send(storescu.arg("--abort"), "SCANNER", receiving.port, &series);
    assert!(sent.status.success(), "{}", printed(&sent));
    let line = until_line(&mut receiving, |line| line.ends_with("; the transfer was interrupted"));
    let received = PathBuf::from(line.split_once(": ").unwrap().0);
    let inspect = |options: &[&str]| relief(&["inspect"]).arg(&received).args(options).output().unwrap();
    assert!(printed(&inspect(&[])).contains("the transfer of this series has not ended or was interrupted"));
    assert!(!inspect(&["--strict"]).status.success());
    let render = |out: &str| {
        let mut render = relief(&["render", "--size", "64x48", "--layout", "color", "--series"]);
        printed(&render.arg(&received).arg("--out").arg(folder.path().join(out)).output().unwrap())
    };
    assert!(render("part.png").contains("the transfer of this series has not ended or was interrupted"));
    let Some(mut storescu) = dcmtk(what, "storescu") else { return };
    assert!(send(&mut storescu, "SCANNER", receiving.port, &series).status.success());
    until_line(&mut receiving, |line| line.ends_with(" objects"));
    assert!(inspect(&["--strict"]).status.success() && !render("whole.png").contains("was interrupted"));
    // Objects that were refused are missing, too.
    let mut receiving = Receiving::start(&folder.path().join("other"), &["--any-caller", "--quota", "40KiB"]);
    let Some(mut storescu) = dcmtk(what, "storescu") else { return };
    let refused = send(storescu.arg("-nh"), "SCANNER", receiving.port, &series);
    assert!(printed(&refused).contains("OutOfResources"), "{}", printed(&refused));
    until_line(&mut receiving, |line| line.ends_with("; the transfer was interrupted"));
}

/// The next line of which this is true.
fn until_line(receiving: &mut Receiving, is_it: impl Fn(&str) -> bool) -> String {
    loop {
        let line = receiving.line();
        if is_it(&line) {
            return line;
        }
    }
}

/// Invariant: No bytes end a receiver, and callers that are silent keep no others out.
#[test]
fn damaged_associations_end_alone() {
    let what = "damaged associations";
    let Some(mut echoscu) = dcmtk(what, "echoscu") else { return };
    let folder = tempfile::tempdir().unwrap();
    let receiving = Receiving::start(&folder.path().join("inbox"), &["--any-caller"]);
    let valid = association_request();
    let silent: Vec<TcpStream> =
        (0..8).map(|_| TcpStream::connect(("127.0.0.1", receiving.port)).unwrap()).collect();
    for at in 0..valid.len() {
        let mut damaged = valid.clone();
        damaged[at] ^= 0xff;
        let mut stream = TcpStream::connect(("127.0.0.1", receiving.port)).unwrap();
        stream.set_read_timeout(Some(Duration::from_millis(5))).unwrap();
        let _ = stream.write_all(&damaged);
        let _ = stream.read(&mut [0; 64]);
    }
    drop(silent);
    let port = receiving.port.to_string();
    until("the receiver answers", || {
        echoscu.args(["-aec", "RELIEF", "127.0.0.1", &port]).output().unwrap().status.success()
    });
}

/// A-ASSOCIATE-RQ (PS3.8 9.3.2) with one context: verification, implicit VR.
fn association_request() -> Vec<u8> {
    let item = |kind: u8, content: &[u8]| {
        [&[kind, 0], &u16::try_from(content.len()).unwrap().to_be_bytes()[..], content].concat()
    };
    let context =
        [&[1, 0, 0, 0][..], &item(0x30, b"1.2.840.10008.1.1"), &item(0x40, b"1.2.840.10008.1.2")].concat();
    let user = [item(0x51, &16384_u32.to_be_bytes()), item(0x52, b"1.2.3")].concat();
    let titles = [*b"RELIEF          ", *b"ANY             "].concat();
    let body = [
        &[0, 1, 0, 0][..],
        &titles,
        &[0; 32],
        &item(0x10, b"1.2.840.10008.3.1.1.1"),
        &item(0x20, &context),
        &item(0x50, &user),
    ]
    .concat();
    [&[1, 0], &u32::try_from(body.len()).unwrap().to_be_bytes()[..], &body].concat()
}
