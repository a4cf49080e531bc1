//! Archives that misbehave: clear errors, bounded memory and disk, and nothing lost.

use std::io::Write;
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::stand_in::{StandIn, reply, write_head};
use relief_dicom::read_identity;

use crate::cluster::stage::{Process, ask, phantom, relief};
use crate::common::child;

const JSON: &str = "application/dicom+json";
const SERIES: &str = "/studies/1.2/series/3.4";
/// Most memory that a listing or a retrieval may take, MiB.
const MOST_MIB: u64 = 400;

/// The list of one series, or of instances `1.1`, `1.2` and so on.
fn listed(tag: &str, uids: impl Iterator<Item = String>) -> Vec<u8> {
    let one = |uid: String| {
        serde_json::json!({
            "0020000D": { "vr": "UI", "Value": ["1.2"] }, "00080060": { "vr": "CS", "Value": ["CT"] },
            tag: { "vr": "UI", "Value": [uid] },
        })
    };
    serde_json::to_vec(&uids.map(one).collect::<Vec<_>>()).unwrap()
}

fn part_of(file: &[u8]) -> Vec<u8> {
    [b"--x\r\nContent-Type: application/dicom\r\n\r\n", file, b"\r\n--x--\r\n"].concat()
}

const PART: &str = "multipart/related; type=\"application/dicom\"; boundary=x";

fn failed(command: &mut Command) -> String {
    let ended = child::run(command.env("NO_PROXY", "*"), MOST_MIB);
    assert!(!ended.status.success(), "{}", ended.stdout);
    ended.stderr
}

fn render(address: &str, out: &Path) -> Command {
    let mut command = relief(&[
        "render", "--series", address, "--preset", "bone", "--size", "64x48", "--layout", "color", "--out",
    ]);
    command.arg(out);
    command
}

fn files_of(series: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = walkdir::WalkDir::new(series)
        .into_iter()
        .map(Result::unwrap)
        .filter(|entry| entry.file_type().is_file())
        .map(walkdir::DirEntry::into_path)
        .collect();
    files.sort();
    files
}

/// Serves a series of files, but its first answers for the list and for each instance fail: one is
/// refused, the next breaks off.
fn unreliable(files: Vec<Vec<u8>>) -> StandIn {
    let tries: Vec<AtomicUsize> = (0..=files.len()).map(|_| AtomicUsize::new(0)).collect();
    let uids: Vec<String> = files.iter().map(|file| read_identity(file).unwrap().sop_instance).collect();
    StandIn::start(move |path, stream| {
        let wanted = path.rsplit_once("/instances/").map(|(_, uid)| uid);
        let number = wanted.map(|wanted| uids.iter().position(|uid| uid == wanted).unwrap());
        let (kind, body) = match number {
            Some(number) => (PART, part_of(&files[number])),
            None => (JSON, listed("00080018", uids.iter().cloned())),
        };
        let tried = tries[number.map_or(files.len(), |number| number)].fetch_add(1, Ordering::Relaxed);
        match tried {
            0 => reply(stream, "503 Service Unavailable", "text/plain", b"later"),
            1 => {
                write_head(stream, "200 OK", kind, body.len())?;
                stream.write_all(&body[..body.len() / 2])
            }
            // Compressed, as by a proxy.
            _ => reply(stream, "200 OK\r\nContent-Encoding: gzip", kind, &gzip(&body)),
        }
    })
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// Invariant: A retrieval survives answers of an archive that fail or break off.
#[test]
fn answers_that_fail_or_break_off_are_requested_again() {
    let folder = tempfile::tempdir().unwrap();
    let series = phantom(folder.path(), "sphere");
    let slices = files_of(&series).into_iter().filter(|file| file.extension().is_some_and(|it| it == "dcm"));
    let files: Vec<Vec<u8>> = slices.map(|file| std::fs::read(file).unwrap()).collect();
    let (count, place) = (files.len(), place_of(&files[0]));
    let archive = unreliable(files);
    let [local, remote] = ["local.png", "remote.png"].map(|name| folder.path().join(name));
    for (address, out) in [(series.to_str().unwrap(), &local), (&*archive.address(&place), &remote)] {
        let made = render(address, out).env("NO_PROXY", "*").output().unwrap();
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    }
    assert!(std::fs::read(local).unwrap() == std::fs::read(remote).unwrap());
    let instances = archive.requests().iter().filter(|path| path.contains("/instances/")).count();
    assert_eq!(instances, 3 * count);
}

/// The path of a file's series in an archive.
fn place_of(file: &[u8]) -> String {
    let identity = read_identity(file).unwrap();
    format!("/studies/{}/series/{}", identity.study, identity.series)
}

/// Invariant: If an archive sends instances of another series, the whole series is refused, and the message
/// states the difference.
#[test]
fn instances_of_another_patient_or_series_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let slices = |kind: &str| -> Vec<Vec<u8>> {
        let made = files_of(&phantom(folder.path(), kind));
        let slices = made.iter().filter(|file| file.extension().is_some_and(|it| it == "dcm"));
        slices.map(|file| std::fs::read(file).unwrap()).collect()
    };
    let (wanted, other) = (slices("sphere"), slices("slab"));
    let place = place_of(&wanted[0]);
    let uids: Vec<String> = wanted.iter().map(|file| read_identity(file).unwrap().sop_instance).collect();
    // The archive sends another series, and then one instance for all requests.
    for (sent, what) in
        [(other, "another study"), (vec![wanted[0].clone(); wanted.len()], "another instance")]
    {
        let known = uids.clone();
        let archive = StandIn::start(move |path, stream| {
            match path
                .rsplit_once("/instances/")
                .map(|(_, uid)| known.iter().position(|known| known == uid).unwrap())
            {
                Some(number) => reply(stream, "200 OK", PART, &part_of(&sent[number])),
                None => reply(stream, "200 OK", JSON, &listed("00080018", known.iter().cloned())),
            }
        });
        let out = folder.path().join("out.png");
        let made = render(&archive.address(&place), &out).env("NO_PROXY", "*").output().unwrap();
        let said = String::from_utf8_lossy(&made.stderr);
        assert!(!made.status.success() && !out.exists() && said.contains(what), "{said}");
        assert!(uids.iter().all(|uid| !said.contains(uid)), "{said}");
    }
}

/// Invariant: Unneeded attributes in an archive's answers take no memory, and a search ends within a
/// minute.
#[test]
fn junk_in_answers_takes_no_memory() {
    let junk = vec![b'0'; 20 << 20].iter().flat_map(|digit| [*digit, b',']).collect::<Vec<u8>>();
    let pages = AtomicUsize::new(0);
    let archive = StandIn::start(move |_, stream| {
        let page = pages.fetch_add(1, Ordering::Relaxed);
        let head = format!(
            r#"[{{"0020000D":{{"Value":["1.2"]}},"0020000E":{{"Value":["1.3.{page}"]}},"00080060":{{"Value":["CT"]}},"x":["#
        );
        reply(stream, "200 OK", JSON, &[head.as_bytes(), &junk, b"0]}]"].concat())
    });
    let since = std::time::Instant::now();
    // Each answer has 40 MiB; as JSON values it would take 640 MiB.
    let said = failed(&mut relief(&["inspect", &archive.address("?PatientID=*")]));
    assert!(said.contains("in answer to one search") || said.contains("to answer"), "{said}");
    // Exceeding a limit is final: the search is not repeated.
    assert!(since.elapsed() < std::time::Duration::from_secs(100), "{:?}", since.elapsed());
}

/// Invariant: An archive that never ends its answers does not delay searches of another archive.
#[test]
fn a_slow_archive_delays_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let slow = StandIn::start(|_, stream| {
        write_head(stream, "200 OK", JSON, 1 << 20)?;
        loop {
            stream.write_all(b" ")?;
            std::thread::sleep(std::time::Duration::from_millis(200));
        }
    });
    let good = StandIn::start(|_, stream| reply(stream, "200 OK", JSON, b"[]"));
    let cache = folder.path().join("cache");
    let mut serve = relief(&["serve", "--listen", "127.0.0.1:0", "--adapter", "cpu", "--cache"]);
    serve.arg(&cache).env("NO_PROXY", "*");
    for (name, archive) in [("slow", &slow), ("good", &good)] {
        serve.args(["--archive", &format!("{name}={}", archive.address(""))]);
    }
    let (_process, lines) = Process::start(&mut serve);
    let address = lines[0].split_once("http://").unwrap().1.trim_end_matches('/').to_owned();
    let body = r#"{"patient_id":"*"}"#;
    let search = |archive: &str| {
        let line = format!("POST /v1/archives/{archive}/search");
        ask(&address, &line, "", body).unwrap().status
    };
    // Four searches of an archive may run at a time; the fifth is refused.
    let _waiting = [(); 4].map(|()| {
        let mut stream = TcpStream::connect(&address).unwrap();
        let head = format!(
            "POST /v1/archives/slow/search HTTP/1.1\r\nHost: {address}\r\nContent-Type: application/json"
        );
        write!(stream, "{head}\r\nContent-Length: {}\r\n\r\n{body}", body.len()).unwrap();
        stream
    });
    let since = std::time::Instant::now();
    while slow.requests().len() < 4 {
        assert!(since.elapsed() < std::time::Duration::from_secs(60), "the searches are not made");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    assert_eq!((search("slow"), search("good")), (503, 200));
}

fn endless(stream: &mut TcpStream, kind: &str, begin: &[u8]) -> std::io::Result<()> {
    write_head(stream, "200 OK", kind, usize::MAX / 2)?;
    stream.write_all(begin)?;
    loop {
        stream.write_all(&[b' '; 1 << 16])?;
    }
}

/// Invariant: An archive cannot make a client take more memory or disk than allowed.
#[test]
fn endless_answers_end_in_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let archive = StandIn::start(|path, stream| match path.ends_with("/instances") {
        true => {
            reply(stream, "200 OK", JSON, &listed("00080018", (0..3).map(|number| format!("1.{number}"))))
        }
        false if path.contains("/instances/") => endless(stream, PART, b"--x\r\n\r\n"),
        false if path.ends_with("/studies/1.2/series") => reply(stream, "200 OK", JSON, b"[]"),
        false => endless(stream, JSON, b"["),
    });
    let said = failed(&mut relief(&["inspect", &archive.address("")]));
    assert!(said.contains("sends more than 67108864 bytes"), "{said}");
    let bomb = gzip(&[&b"["[..], &[b' '; 256 << 20]].concat());
    let packed =
        StandIn::start(move |_, stream| reply(stream, "200 OK\r\nContent-Encoding: gzip", JSON, &bomb));
    let said = failed(&mut relief(&["inspect", &packed.address("")]));
    assert!(said.contains("sends more than 67108864 bytes"), "{said}");
    let (cache, out) = (folder.path().join("cache"), folder.path().join("out.png"));
    let mut command = render(&archive.address(SERIES), &out);
    let said = failed(command.args(["--cache-bytes", "8MiB", "--cache"]).arg(&cache));
    assert!(said.contains("--cache-bytes") && !said.contains("1.2"), "{said}");
    let left: u64 = files_of(&cache).iter().map(|file| file.metadata().unwrap().len()).sum();
    assert!(left <= 8 << 20 && !out.exists(), "{left} bytes");
}

/// Invariant: An archive that lists a part of a series gives an error, not a part of the series.
#[test]
fn a_part_of_a_series_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.png");
    // The same 10 instances for any offset.
    let ten = || listed("00080018", (0..10).map(|number| format!("1.{number}")));
    let counted = |count: u64| {
        let one = serde_json::json!([{
            "0020000D": { "vr": "UI", "Value": ["1.2"] }, "0020000E": { "vr": "UI", "Value": ["3.4"] },
            "00201209": { "vr": "IS", "Value": [count] },
        }]);
        serde_json::to_vec(&one).unwrap()
    };
    let more = "Warning: 299 dicom: There are 6 additional results that can be requested";
    let other = "Warning: 299 dicom: The fuzzymatching parameter is not supported";
    for (status, count, said) in [
        ("200 OK", 16, Some("lists only 10 of 16 instances")),
        ("206 Partial Content", 10, Some("lists only 10 of its matches")),
        (&*format!("200 OK\r\n{more}"), 10, Some("lists only 10 of its matches")),
        // This list is complete. The client goes on to retrieve the files, which this archive does not
        // have.
        (&*format!("200 OK\r\n{other}"), 10, None),
    ] {
        let status = status.to_owned();
        let archive = StandIn::start(move |path, stream| match path {
            path if path.ends_with("/instances") => reply(stream, &status, JSON, &ten()),
            path if path.ends_with("/series") => reply(stream, "200 OK", JSON, &counted(count)),
            _ => reply(stream, "404 Not Found", "text/plain", b""),
        });
        let text = failed(&mut render(&archive.address(SERIES), &out));
        assert!(text.contains(said.unwrap_or("no such instance")) && !out.exists(), "{text}");
    }
}

/// Invariant: A client follows no redirect of an archive, which could lead its login elsewhere.
#[test]
fn redirects_are_not_followed() {
    let elsewhere = StandIn::start(|_, stream| reply(stream, "200 OK", JSON, b"[]"));
    let target = elsewhere.address("").replace("dicomweb+", "");
    let archive = StandIn::start(move |_, stream| {
        write!(
            stream,
            "HTTP/1.1 302 Found\r\nLocation: {target}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
        )
    });
    let said = failed(&mut relief(&["inspect", &archive.address("")]));
    assert!(said.contains("status 302"), "{said}");
    assert_eq!(elsewhere.requests(), [""; 0]);
}

/// Invariant: Answers that are not what DICOMweb prescribes end in an error that says so.
#[test]
fn answers_of_other_servers_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.png");
    let deep = vec![b'['; 1 << 20];
    for body in [b"<html>".to_vec(), b"{}".to_vec(), b"[1]".to_vec(), deep] {
        let archive = StandIn::start(move |_, stream| reply(stream, "200 OK", JSON, &body));
        let said = failed(&mut relief(&["inspect", &archive.address("")]));
        assert!(said.contains("DICOM's JSON"), "{said}");
    }
    let none = StandIn::start(|_, stream| reply(stream, "404 Not Found", "text/plain", b"1.2"));
    let said = failed(&mut render(&none.address(SERIES), &out));
    assert!(said.contains("no such series") && !said.contains("1.2"), "{said}");
    for (kind, body) in [
        ("text/html", b"<html>".to_vec()),
        (PART, part_of(b"no file of DICOM")),
        (PART, b"--x\r\n\r\nwithout an end".to_vec()),
    ] {
        let archive = StandIn::start(move |path, stream| match path.ends_with("/instances") {
            true => reply(stream, "200 OK", JSON, &listed("00080018", ["1.1".to_owned()].into_iter())),
            false => reply(stream, "200 OK", kind, &body),
        });
        let said = failed(&mut render(&archive.address(SERIES), &out));
        assert!(said.contains("is expected") && !out.exists(), "{said}");
    }
}
