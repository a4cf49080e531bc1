//! Hostile requests to a server process: it answers, keeps its memory, and serves others meanwhile.

use std::io::{Read, Write};
use std::net::TcpStream;

use super::{Running, phantom, relief};
use crate::common::child::peak_of;
use crate::common::hostile::{
    DEFLATED_FRAME, RLE, Slice, deflated_zeros, nifti_labels, overlapping_zip, rle_frame, zip_of,
};

/// A server of a small phantom, and the volume's id.
fn serving(folder: &std::path::Path, more: &[&str]) -> (Running, String) {
    let log = folder.join("log.db");
    let series = phantom(folder);
    let arguments =
        ["serve", "--series", &series, "--listen", "127.0.0.1:0", "--annotations", log.to_str().unwrap()];
    let running = Running::spawn(&mut relief(&[&arguments, more].concat()));
    running.await_ready();
    let listed: serde_json::Value = serde_json::from_slice(&running.get("/v1/volumes").1).unwrap();
    let id = listed["volumes"][0]["id"].as_str().unwrap().to_owned();
    (running, id)
}

fn status_of(answer: &(String, Vec<u8>)) -> u16 {
    answer.0.split(' ').nth(1).and_then(|status| status.parse().ok()).expect("a status line")
}

/// Invariant: No upload takes more memory than its limits, and a refused one leaves the server as it
/// was.
#[test]
fn hostile_uploads_are_refused_in_little_memory() {
    let folder = tempfile::tempdir().unwrap();
    let (running, id) = serving(folder.path(), &[]);
    let before = peak_of(&running.process);
    let slice = Slice::default();
    let zipped = |file: Vec<u8>| zip_of([("DOE^JANE.dcm".to_owned(), file)]);
    let packbits = rle_frame(2, [64, 64 + 4096], &[0x81, 0].repeat(4 << 20));
    for (name, zip, expected) in [
        ("deflated", zipped(slice.encapsulated(DEFLATED_FRAME, &deflated_zeros(1 << 30))), 422),
        ("segments", zipped(slice.encapsulated(RLE, &rle_frame(0xffff_fffe, [64, 64], &[0; 64]))), 422),
        ("packbits", zipped(slice.encapsulated(RLE, &packbits)), 201),
        ("overlap", overlapping_zip(&slice.native(&[0; 8192]), 1000), 422),
    ] {
        let answer = running.upload(&zip);
        let text = String::from_utf8_lossy(&answer.1).into_owned();
        assert_eq!(status_of(&answer), expected, "{name}: {text}");
        assert!(!text.contains("DOE") && text.len() < 4000, "{name}: {text}");
    }
    // A label map of far more voxels than the volume: its header is enough.
    let labels = nifti_labels([2048, 1024, 1024], 1 << 20);
    let headers = format!("Content-Type: application/octet-stream\r\nContent-Length: {}\r\n", labels.len());
    let answer = running.ask(&format!("POST /v1/volumes/{id}/labels"), &headers, &labels);
    assert_eq!(status_of(&answer), 422, "{}", String::from_utf8_lossy(&answer.1));
    let path = format!("POST /v1/volumes/{id}/annotations/import?name=a.nii.gz&author=eve");
    let answer = running.ask(&path, &headers, &labels);
    assert_eq!(status_of(&answer), 422, "{}", String::from_utf8_lossy(&answer.1));
    let after = peak_of(&running.process);
    assert!(after < before + 400, "from {before} to {after} MiB");
    assert_eq!(status_of(&running.get(&format!("/v1/volumes/{id}"))), 200);
}

/// Invariant: A server that takes no uploads takes no files of annotations either.
#[test]
fn imports_are_refused_where_uploads_are_off() {
    let folder = tempfile::tempdir().unwrap();
    let (running, id) = serving(folder.path(), &["--uploads", "off"]);
    let table = b"label,l,p,s\nNasion,1,2,3\n";
    let headers = format!("Content-Type: application/octet-stream\r\nContent-Length: {}\r\n", table.len());
    let path = format!("POST /v1/volumes/{id}/annotations/import?name=a.csv&author=eve");
    let answer = running.ask(&path, &headers, table);
    assert_eq!(status_of(&answer), 403);
    assert!(String::from_utf8_lossy(&answer.1).contains("uploads-off"));
}

/// Invariant: Beyond the loopback, too, a server answers only to names that no page can have.
#[test]
fn a_server_of_a_network_answers_to_addresses_and_known_names() {
    let folder = tempfile::tempdir().unwrap();
    let series = phantom(folder.path());
    let arguments =
        ["serve", "--series", &series, "--listen", "0.0.0.0:0", "--allow-host", "ct.example", "--insecure"];
    let running = Running::spawn(&mut relief(&arguments));
    let asked = |host: &str| {
        let mut stream = TcpStream::connect(&running.address).unwrap();
        write!(stream, "GET /healthz HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer.split(' ').nth(1).unwrap().parse::<u16>().unwrap()
    };
    for host in ["127.0.0.1", "192.0.2.7:8080", "[2001:db8::1]:8080", "ct.example", "localhost:1"] {
        assert_eq!(asked(host), 200, "{host}");
    }
    for host in ["evil.example", "ct.example.evil.example", "192.0.2.7.evil.example", "127.1"] {
        assert_eq!(asked(host), 421, "{host}");
    }
}

/// Invariant: Idle connections do not exclude other clients.
#[test]
fn idle_connections_make_room_for_others() {
    let folder = tempfile::tempdir().unwrap();
    let (running, id) = serving(folder.path(), &[]);
    let idle: Vec<TcpStream> = (0..400).map(|_| TcpStream::connect(&running.address).unwrap()).collect();
    let mut slow = TcpStream::connect(&running.address).unwrap();
    slow.write_all(b"GET /v1/volumes HTTP/1.1\r\n").unwrap();
    for _ in 0..20 {
        assert_eq!(status_of(&running.get(&format!("/v1/volumes/{id}"))), 200);
    }
    // Some made room; the others are still there, so nobody waited until idle connections ended.
    let is_open = |stream: &&TcpStream| {
        stream.set_nonblocking(true).unwrap();
        stream.peek(&mut [0]).is_err_and(|error| error.kind() == std::io::ErrorKind::WouldBlock)
    };
    let open = idle.iter().filter(is_open).count();
    assert!((100..300).contains(&open), "{open} of {} idle connections are open", idle.len());
}
