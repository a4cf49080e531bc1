//! The Wiimote as the desktop's pointer: `relief track --uinput`, read by the kernel's evdev as a
//! desktop reads it.
#![allow(clippy::unwrap_used, reason = "a test may panic, in its helpers too")]

use std::fs::File;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::{Duration, Instant};

use glam::{DQuat, DVec3};
use serde_json::Value;

use super::kernel;

/// Of linux/input-event-codes.h.
const EV_SYN: u16 = 0;
const EV_KEY: u16 = 1;
const EV_ABS: u16 = 3;
const BTN_LEFT: u16 = 0x110;
const KEY_UP: u16 = 103;
/// `sizeof(struct input_event)` on 64-bit systems: seconds, microseconds, type, code, value.
const EVENT_BYTES: usize = 24;
const SIZE_MM: [f64; 2] = [930.0, 523.0];
/// The beacon is on top of the screen.
const BEACON_ABOVE_MM: f64 = 300.0;

/// The pointer's events so far: places, and keys with their states.
#[derive(Default)]
struct Seen {
    places: Vec<[i32; 2]>,
    keys: Vec<(u16, i32)>,
}

/// The kernel's node of the pointer, once it is there.
fn node() -> PathBuf {
    let end = Instant::now() + Duration::from_secs(60);
    while Instant::now() < end {
        for entry in std::fs::read_dir("/sys/class/input").unwrap().flatten() {
            let name = std::fs::read_to_string(entry.path().join("device/name")).unwrap_or_default();
            let node = PathBuf::from("/dev/input").join(entry.file_name());
            if name.trim() == "Relief Wiimote pointer"
                && entry.file_name().to_string_lossy().starts_with("event")
                && node.exists()
            {
                return node;
            }
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    panic!("the kernel has no pointer")
}

/// Reads events on a thread, until the device is gone.
fn read_events(mut device: File) -> Receiver<(u16, u16, i32)> {
    let (sender, events) = sync_channel(1 << 16);
    let read = move || {
        let mut event = [0; EVENT_BYTES];
        while device.read_exact(&mut event).is_ok() {
            let short = |at: usize| u16::from_ne_bytes([event[at], event[at + 1]]);
            let value = i32::from_ne_bytes([event[20], event[21], event[22], event[23]]);
            let _ = sender.send((short(16), short(18), value));
        }
    };
    std::thread::Builder::new().spawn(read).unwrap();
    events
}

fn sorted(events: &Receiver<(u16, u16, i32)>) -> Seen {
    let (mut seen, mut at, mut has_moved) = (Seen::default(), [0, 0], false);
    for (kind, code, value) in events {
        match kind {
            EV_ABS => (at[usize::from(code)], has_moved) = (value, true),
            EV_KEY => seen.keys.push((code, value)),
            EV_SYN if std::mem::take(&mut has_moved) => seen.places.push(at),
            _ => {}
        }
    }
    seen
}

/// A recording of a hand that points at the beacon; A is held in its second second, Up at the end.
fn recording(folder: &Path) -> String {
    let file = folder.join("rec.jsonl");
    let mut relief = Command::new(env!("CARGO_BIN_EXE_relief"));
    relief.args(["track", "simulate", "--seconds", "3", "--press", "a:1:2", "--press", "up:2.5:4", "--out"]);
    let made = relief.arg(&file).output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    std::fs::read_to_string(file).unwrap()
}

/// Where the ray of a pose meets the screen, in units of the device.
fn aimed(pose: &Value) -> [i32; 2] {
    let numbers = |key: &str| serde_json::from_value::<Vec<f64>>(pose[key].clone()).unwrap();
    let position = DVec3::from_slice(&numbers("position_mm")) + DVec3::Y * BEACON_ABOVE_MM;
    let forward = DQuat::from_slice(&numbers("orientation_xyzw")) * DVec3::Z;
    let point = position - forward * (position.z / forward.z);
    [point.x / SIZE_MM[0], -point.y / SIZE_MM[1]]
        .map(|share| ((share + 0.5).clamp(0.0, 1.0) * 65_535.0).round() as i32)
}

/// Invariant: The pointer of `relief track --uinput` is where the Wiimote's ray meets the screen.
#[test]
fn the_desktops_pointer_follows_the_ray_and_the_buttons() {
    if !kernel::entered(kernel::POINTER) {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let [geometry, poses] = ["geometry.json", "poses.jsonl"].map(|name| folder.path().join(name));
    let matrix =
        format!("{{\"display_from_tracker\": [[1,0,0,0],[0,1,0,{BEACON_ABOVE_MM}],[0,0,1,0],[0,0,0,1]]}}");
    std::fs::write(&geometry, matrix).unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let source = format!("tcp://{}", listener.local_addr().unwrap());
    let mut relief = Command::new(env!("CARGO_BIN_EXE_relief"));
    relief.args(["track", "--reports", &source, "--uinput", "930x523", "--tracker-geometry"]);
    relief.arg(&geometry).arg("--out").arg(&poses).stdout(Stdio::null());
    let mut relief = relief.spawn().unwrap();
    let (mut socket, _) = listener.accept().unwrap();
    let events = read_events(File::open(node()).unwrap());
    for line in recording(folder.path()).lines() {
        writeln!(socket, "{line}").unwrap();
        // The kernel keeps a few events for each reader.
        std::thread::sleep(Duration::from_millis(3));
    }
    drop(socket);
    assert!(relief.wait().unwrap().success());
    let seen = sorted(&events);

    let poses = std::fs::read_to_string(&poses).unwrap();
    let mut expected: Vec<[i32; 2]> = poses
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).unwrap())
        .filter(|pose| pose["state"] == "tracking")
        .map(|pose| aimed(&pose))
        .collect();
    expected.dedup();
    assert!(expected.len() > 200, "{} places", expected.len());
    assert_eq!(seen.places.len(), expected.len());
    for (place, expected) in seen.places.iter().zip(&expected) {
        assert!(place.iter().zip(expected).all(|(a, b)| (a - b).abs() <= 1), "{place:?} {expected:?}");
    }
    // Up is held at the end: the kernel releases it when the device goes.
    assert_eq!(seen.keys, [(BTN_LEFT, 1), (BTN_LEFT, 0), (KEY_UP, 1), (KEY_UP, 0)]);
}
