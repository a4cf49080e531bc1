//! Servers to which `--fault` brings about failures: of the graphics device, the disk and the clock.

use serde_json::{Value, json};

use super::{Running, phantom, relief};
use crate::common::software_adapter;

/// Invariant: A lost device is opened again without a restart, and no picture is wrong or missing.
#[test]
fn pictures_outlive_their_device() {
    let Some(log) = pictures_are_right_with("device-lost=3") else { return };
    assert!(log.matches("was opened again").count() >= 3, "{log}");
}

/// Invariant: A picture that finds the graphics memory full is made again after other volumes left it.
#[test]
fn pictures_outlive_a_full_graphics_memory() {
    let Some(_) = pictures_are_right_with("device-memory=2") else { return };
}

/// Compares pictures with those of a server without the fault; returns the log of the one with it, or
/// `None` without an adapter.
fn pictures_are_right_with(fault: &str) -> Option<String> {
    software_adapter(fault)?;
    let folder = tempfile::tempdir().unwrap();
    let series = phantom(folder.path());
    let arguments = ["serve", "--series", &series, "--listen", "127.0.0.1:0"];
    let on_a_driver =
        |arguments: &[&str]| Running::spawn(relief(arguments).env("RELIEF_ADAPTER", "software"));
    let steady = on_a_driver(&arguments);
    let faulty = on_a_driver(&[&arguments[..], &["--fault", fault]].concat());
    for running in [&steady, &faulty] {
        running.await_ready();
    }
    let listed: Value = serde_json::from_slice(&steady.get("/v1/volumes").1).unwrap();
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
    let (status, log) = faulty.stop("TERM");
    assert_eq!(status, Some(0), "{log}");
    Some(log)
}

/// A server of a log, and the id of its volume.
fn annotating(series: &str, log: &str, faults: &[&str]) -> (Running, String) {
    let mut arguments = vec!["serve", "--series", series, "--annotations", log, "--listen", "127.0.0.1:0"];
    arguments.extend(faults.iter().flat_map(|fault| ["--fault", fault]));
    let running = Running::spawn(&mut relief(&arguments));
    running.await_ready();
    let listed: Value = serde_json::from_slice(&running.get("/v1/volumes").1).unwrap();
    let id = listed["volumes"][0]["id"].as_str().unwrap().to_owned();
    (running, id)
}

/// Adds a landmark with a long description; the status and the body.
fn add(running: &Running, id: &str, name: &str) -> (u16, Value) {
    let item = json!({ "name": name, "description": "x".repeat(4000),
        "geometry": { "kind": "point", "at_mm": [0, 0, 0] } });
    let body = json!({ "author": "anna", "changes": [{ "change": "create", "item": item }] }).to_string();
    let headers = format!("Content-Type: application/json\r\nContent-Length: {}\r\n", body.len());
    let (head, answer) =
        running.ask(&format!("POST /v1/volumes/{id}/annotations"), &headers, body.as_bytes());
    (head.split(' ').nth(1).unwrap().parse().unwrap(), serde_json::from_slice(&answer).unwrap())
}

/// Names of the items, in the order of their making.
fn names(running: &Running, id: &str) -> Vec<String> {
    let (_, body) = running.get(&format!("/v1/volumes/{id}/annotations/log?limit=1000"));
    let log: Value = serde_json::from_slice(&body).unwrap();
    let events = log["events"].as_array().unwrap();
    let of_event = |event: &Value| event["item"]["name"].as_str().map(str::to_owned);
    events.iter().filter_map(of_event).collect()
}

/// Invariant: A full disk refuses edits with 507, loses none that was acknowledged, and stops nothing
/// else.
#[test]
fn a_full_disk_refuses_edits_and_loses_none() {
    let folder = tempfile::tempdir().unwrap();
    let series = phantom(folder.path());
    let log = folder.path().join("log.db").to_str().unwrap().to_owned();
    let (running, id) = annotating(&series, &log, &["disk-full=300000"]);
    let mut kept = Vec::new();
    let refused = loop {
        let name = kept.len().to_string();
        match add(&running, &id, &name) {
            (201, _) => kept.push(name),
            (507, problem) => break problem,
            (status, problem) => panic!("{status}: {problem}"),
        }
        assert!(kept.len() < 1000, "the disk is never full");
    };
    assert_eq!(refused["code"], "log-full", "{refused}");
    assert!(kept.len() > 3, "{kept:?}");
    assert_eq!(names(&running, &id), kept);
    assert!(
        running
            .get(&format!("/v1/volumes/{id}/frame?size_px=32,32&layout=color"))
            .0
            .starts_with("HTTP/1.1 200")
    );
    running.await_ready();
    assert_eq!(running.stop("TERM").0, Some(0));
    // With room again, edits go on.
    let (running, id) = annotating(&series, &log, &[]);
    assert_eq!(names(&running, &id), kept);
    kept.push("more".to_owned());
    assert_eq!(add(&running, &id, "more").0, 201);
    assert_eq!(names(&running, &id), kept);
}

/// Invariant: Edits keep their order when the disk is slow and the clock goes backwards.
#[test]
fn edits_keep_their_order_on_a_slow_disk_under_a_clock_that_goes_back() {
    let folder = tempfile::tempdir().unwrap();
    let series = phantom(folder.path());
    let log = folder.path().join("log.db").to_str().unwrap().to_owned();
    let (running, id) = annotating(&series, &log, &["disk-slow=300", "clock-back=3600"]);
    let made: Vec<String> = (0..4).map(|number| number.to_string()).collect();
    let times: Vec<String> = made
        .iter()
        .map(|name| {
            let (status, events) = add(&running, &id, name);
            assert_eq!(status, 201, "{events}");
            events["events"][0]["time"].as_str().unwrap().to_owned()
        })
        .collect();
    assert!(times.is_sorted_by(|a, b| a > b), "the clock does not go back: {times:?}");
    assert_eq!(names(&running, &id), made);
    // The newest edit is taken back, not the one of the latest time.
    let body = br#"{"author":"anna"}"#;
    let headers = format!("Content-Type: application/json\r\nContent-Length: {}\r\n", body.len());
    let (head, _) = running.ask(&format!("POST /v1/volumes/{id}/annotations/undo"), &headers, body);
    assert!(head.starts_with("HTTP/1.1 200"), "{head}");
    let (_, body) = running.get(&format!("/v1/volumes/{id}/annotations"));
    let listed: Value = serde_json::from_slice(&body).unwrap();
    let left: Vec<&str> = listed["items"]
        .as_array()
        .unwrap()
        .iter()
        .map(|item| item["item"]["name"].as_str().unwrap())
        .collect();
    assert_eq!(left.len(), 3, "{listed}");
    assert!(!left.contains(&"3"), "{left:?}");
}
