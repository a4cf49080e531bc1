//! Poses against OpenCV, PoseLib, IPOPT, and pyigtl: code that is not ours, on the same pixels and
//! bytes.
//!
//! Runs where `RELIEF_PEERS_PYTHON` names a Python that has them, and says aloud where it does not.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test may panic and talk, in its helpers too")]

use std::io::{BufRead, Read};
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;

/// The path of a Python with these modules. Without one, prints a message and returns `None`.
fn python(test: &str, modules: &str) -> Option<Command> {
    let name = std::env::var_os("RELIEF_PEERS_PYTHON").filter(|name| !name.is_empty());
    let has = |name: &std::ffi::OsString| {
        let imported =
            Command::new(name).args(["-c", &format!("import {modules}")]).stderr(Stdio::null()).status();
        imported.is_ok_and(|status| status.success())
    };
    let found = name.filter(has).map(Command::new);
    if found.is_none() {
        eprintln!("SKIPPED: {test} (RELIEF_PEERS_PYTHON names no Python with {modules})");
    }
    found
}

/// Invariant: Poses are the minima that OpenCV, PoseLib and IPOPT find from the same pixels.
#[test]
fn poses_are_the_minima_of_opencv_poselib_and_ipopt() {
    expect_minima(250);
}

#[test]
#[ignore = "takes half a minute: four times as many poses, in scripts/test --all"]
fn more_poses_are_the_minima_of_opencv_poselib_and_ipopt() {
    expect_minima(1000);
}

/// Compares the poses of this number of simulated views with those of the peers.
fn expect_minima(count: u64) {
    let Some(mut python) = python("poses_are_the_minima_of_opencv_poselib_and_ipopt", "cv2, poselib, casadi")
    else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let views = folder.path().join("views.json");
    let mut relief = Command::new(env!("CARGO_BIN_EXE_relief"));
    let made =
        relief.args(["track", "views", "--count", &count.to_string(), "--out"]).arg(&views).output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/peers/poses.py");
    let compared = python.arg(script).arg(&views).output().unwrap();
    assert!(compared.status.success(), "{}", String::from_utf8_lossy(&compared.stderr));
    let report: Value = serde_json::from_slice(&compared.stdout).unwrap();
    for name in ["opencv", "poselib", "ipopt"] {
        let peer = &report[name];
        assert_eq!(peer["better"], 0, "{name}: {report}");
        assert!(peer["max_degrees"].as_f64().unwrap() < 1e-4, "{name}: {report}");
        assert!(peer["max_mm"].as_f64().unwrap() < 1e-3, "{name}: {report}");
        // IPOPT has no global start: from a level pose it ends in other minima at times.
        assert!(
            peer["worse"].as_u64().unwrap() <= if name == "ipopt" { count / 5 } else { 0 },
            "{name}: {report}"
        );
    }
}

/// Receives until a transform has come, and prints its matrix.
const PYIGTL: &str = r"
import json, sys, time, pyigtl
client = pyigtl.OpenIGTLinkClient(host='127.0.0.1', port=int(sys.argv[1]))
message, end = None, time.monotonic() + 80
while not isinstance(message, pyigtl.TransformMessage):
    assert time.monotonic() < end, f'nothing came; connected: {client.is_connected()}'
    message = client.wait_for_message('WiimoteToBeacon', timeout=5)
print(json.dumps({'matrix': message.matrix.tolist(), 'timestamp': message.timestamp}))
client.stop()
";

/// `relief track` that plays a recording and publishes its poses.
struct Publisher {
    /// Output lines of all poses of the recording.
    poses: Vec<Value>,
    child: std::process::Child,
    stderr: std::io::BufReader<std::process::ChildStderr>,
    port: String,
    _folder: tempfile::TempDir,
}

impl Publisher {
    /// Publishes by this option; the port is chosen by the system.
    fn start(option: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let reports = folder.path().join("rec.jsonl");
        let relief = || {
            let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
            command.arg("track").env_remove("RELIEF_LOG");
            command
        };
        let simulated =
            relief().args(["simulate", "--seconds", "100", "--out"]).arg(&reports).output().unwrap();
        assert!(simulated.status.success());
        let poses = relief().arg("--reports").arg(&reports).output().unwrap().stdout;
        let poses = String::from_utf8(poses)
            .unwrap()
            .lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect();
        let mut child = relief();
        child.arg("--reports").arg(&reports).args(["--realtime", option, "127.0.0.1:0", "--json"]);
        let mut child = child.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        // It stays open: a program that cannot write to stderr ends.
        let mut stderr = std::io::BufReader::new(child.stderr.take().unwrap());
        stderr.read_line(&mut line).unwrap();
        let port = line.trim().rsplit(':').next().unwrap().to_owned();
        Self { poses, child, stderr, port, _folder: folder }
    }

    /// The JSON in the last line of a peer's output.
    fn received(&mut self, peer: &mut Command) -> Value {
        let received = peer.output().unwrap();
        let _ = self.child.kill();
        let mut said = String::new();
        self.stderr.read_to_string(&mut said).unwrap();
        assert!(received.status.success(), "{} {said}", String::from_utf8_lossy(&received.stderr));
        let text = String::from_utf8_lossy(&received.stdout).into_owned();
        serde_json::from_str(text.trim().lines().last().unwrap()).unwrap()
    }

    /// Distance of a pose of the recording from a position, mm.
    fn distance_mm(pose: &Value, position_mm: [f64; 3]) -> f64 {
        let along = |axis: usize| (pose["position_mm"][axis].as_f64().unwrap() - position_mm[axis]).abs();
        along(0).max(along(1)).max(along(2))
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn pyigtl_receives_the_published_poses() {
    let Some(mut python) = python("pyigtl_receives_the_published_poses", "pyigtl") else { return };
    let mut publisher = Publisher::start("--igtl");
    let port = publisher.port.clone();
    let received = publisher.received(python.args(["-c", PYIGTL, &port]));
    let seconds = received["timestamp"].as_f64().unwrap();
    let of_that_time = publisher
        .poses
        .iter()
        .find(|pose| (pose["t_ns"].as_f64().unwrap() * 1e-9 - seconds).abs() < 1e-6)
        .expect("the pose of that report");
    let matrix = |axis: usize| received["matrix"][axis][3].as_f64().unwrap();
    assert!(Publisher::distance_mm(of_that_time, [0, 1, 2].map(matrix)) < 1e-3, "{of_that_time} {received}");
}
