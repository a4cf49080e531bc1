//! A server whose graphics device is lost again and again.

use super::{Running, phantom, relief};
use crate::common::software_adapter;

/// Invariant: A lost device is opened again without a restart, and no picture is wrong or missing.
#[test]
fn pictures_outlive_their_device() {
    if software_adapter("a lost device").is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let series = phantom(folder.path());
    let arguments = ["serve", "--series", &series, "--listen", "127.0.0.1:0"];
    let steady = Running::spawn(&mut relief(&arguments));
    let faulty = Running::spawn(&mut relief(&[&arguments[..], &["--lose-device-every", "3"]].concat()));
    for running in [&steady, &faulty] {
        running.await_ready();
    }
    let listed: serde_json::Value = serde_json::from_slice(&steady.get("/v1/volumes").1).unwrap();
    let id = listed["volumes"][0]["id"].as_str().unwrap();
    for number in 0..10 {
        let path =
            format!("/v1/volumes/{id}/frame?preset=bone&layout=color&size_px=96,54&azimuth_deg={number}");
        let (head, expected) = steady.get(&path);
        assert!(head.starts_with("HTTP/1.1 200"), "{head}");
        let (head, found) = faulty.get(&path);
        assert!(head.starts_with("HTTP/1.1 200"), "{number}: {head}{}", String::from_utf8_lossy(&found));
        assert!(found == expected, "picture {number} is another one");
    }
    faulty.await_ready();
    let (status, log) = faulty.stop("-TERM");
    assert_eq!(status, Some(0), "{log}");
    assert!(log.matches("was opened again").count() >= 3, "{log}");
}
