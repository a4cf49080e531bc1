//! Pointers of `relief client --pointer`: a SpaceMouse behind a stand-in for spacenavd, and trackers
//! that pyigtl plays. The server is a stand-in that reads what the client sends.
#![cfg(unix)]

use std::io::Write;
use std::os::unix::net::UnixListener;
use std::process::{Child, Command, Stdio};

use futures_util::SinkExt;
use relief_live::{ClientMessage, Intent, PlacePhase, Pose, PoseKind, RemotePose};
use relief_tracking::TrackingState;

use crate::client::stand_in::{Socket, accept, listen, next, welcome};

/// A client that is connected to the stand-in; it ends with this value.
struct Client(Child);

impl Drop for Client {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

async fn connected(arguments: &[&str]) -> (Client, Socket) {
    let (listener, address) = listen(None).await;
    let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
    command.args(["client", "--server", &format!("http://{address}"), "--headless"]).args(arguments);
    let client = Client(command.stdout(Stdio::null()).spawn().unwrap());
    let (mut socket, _) = accept(&listener).await;
    socket.send(welcome("0123", false)).await.unwrap();
    (client, socket)
}

async fn next_intent(socket: &mut Socket) -> Intent {
    loop {
        match next(socket).await.expect("the client is there") {
            ClientMessage::Intent(message) => return message.intent,
            _ => continue,
        }
    }
}

/// An event of spacenavd.
fn event(numbers: [i32; 8]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_ne_bytes()).collect()
}

#[tokio::test]
async fn a_spacemouse_turns_the_view_moves_the_cursor_and_places() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("spnav.sock");
    let spacenavd = UnixListener::bind(&path).unwrap();
    let source = format!("spacemouse:{}", path.display());
    let (_client, mut socket) = connected(&["--pointer", &source]).await;
    let (mut device, _) = spacenavd.accept().unwrap();

    // In parts: a stream keeps no boundaries.
    let turned = event([0, 0, 0, 0, 0, 350, 0, 20]);
    device.write_all(&turned[..13]).unwrap();
    device.flush().unwrap();
    tokio::time::sleep(std::time::Duration::from_millis(50)).await;
    device.write_all(&turned[13..]).unwrap();
    let Intent::Turn { rotation_xyzw: [x, y, z, w] } = next_intent(&mut socket).await else {
        panic!("no turn")
    };
    // 120 degrees a second for 20 ms, to the left about the vertical.
    assert!((2.0 * y.atan2(w).to_degrees() - 2.4).abs() < 1e-9 && x == 0.0 && z == 0.0, "{x} {y} {z} {w}");

    device.write_all(&event([1, 0, 0, 0, 0, 0, 0, 0])).unwrap();
    device.write_all(&event([0, 0, 0, 350, 0, 0, 0, 20])).unwrap();
    let Intent::Cursor { by_view_mm: Some(by), .. } = next_intent(&mut socket).await else {
        panic!("no cursor")
    };
    assert_eq!(by.map(|mm| (mm * 1e9).round() / 1e9), [0.0, 0.0, -1.2], "pushed away from the viewer");
    device.write_all(&event([2, 0, 0, 0, 0, 0, 0, 0])).unwrap();
    device.write_all(&event([1, 1, 0, 0, 0, 0, 0, 0])).unwrap();
    assert_eq!(next_intent(&mut socket).await, Intent::Place { phase: PlacePhase::Commit });
    device.write_all(&event([0, 350, 0, 0, 0, 0, 0, 20])).unwrap();
    assert_eq!(next_intent(&mut socket).await, Intent::Pan { right: 0.8 * 0.02, up: 0.0 });
}

/// Invariant: A tracker behind OpenTrack moves the hand of a view, and is lost when it is silent.
#[tokio::test]
async fn datagrams_of_opentrack_are_the_poses_of_a_hand() {
    let port = std::net::UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let source = format!("opentrack:127.0.0.1:{port}");
    let (_client, mut socket) = connected(&["--pointer", &source]).await;
    let sender = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    // x, y, z in cm; yaw, pitch, roll in degrees.
    let datagram: Vec<u8> =
        [1.5, -2.0, 30.0, 90.0, 0.0, 0.0].iter().flat_map(|n: &f64| n.to_le_bytes()).collect();
    let (position, [x, y, z, w]) = loop {
        sender.send_to(b"nothing", ("127.0.0.1", port)).unwrap();
        sender.send_to(&datagram, ("127.0.0.1", port)).unwrap();
        if let Some(ClientMessage::Pose(message)) = next(&mut socket).await
            && let PoseKind::Remote(remote) = message.what
            && let Some(pose) = remote.pose
        {
            assert!(remote.buttons.is_empty());
            break pose;
        }
    };
    assert_eq!(position, [15.0, -20.0, 300.0]);
    let forward = glam::DQuat::from_xyzw(x, y, z, w) * glam::DVec3::Z;
    assert!((forward - glam::DVec3::NEG_X).length() < 1e-9, "{forward}");
    while !matches!(
        next(&mut socket).await,
        Some(ClientMessage::Pose(Pose {
            what: PoseKind::Remote(RemotePose { state: TrackingState::Lost, .. }),
            ..
        }))
    ) {}
}

#[test]
fn a_spacenavd_that_is_not_there_is_an_error() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relief"));
    command.args([
        "client",
        "--server",
        "http://127.0.0.1:1",
        "--headless",
        "--pointer",
        "spacemouse:/nowhere/spnav.sock",
    ]);
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && said.contains("is it installed and running?"), "{said}");
}

/// Sends transforms of a stylus for a second, and those of another tool until it is stopped; prints a
/// line when it listens.
const PYIGTL: &str = r"
import sys, time, numpy, pyigtl
server = pyigtl.OpenIGTLinkServer(port=int(sys.argv[1]), local_server=True)
matrix = numpy.eye(4)
matrix[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
matrix[:3, 3] = [10, -20, 900]
print('ready', flush=True)
sent = 0
while True:
    server.send_message(pyigtl.TransformMessage(numpy.eye(4), device_name='OtherToTracker'))
    server.send_message(pyigtl.StringMessage('on', device_name='StylusToTracker'))
    if sent < 50:
        server.send_message(pyigtl.TransformMessage(matrix, device_name='StylusToTracker'))
        sent += server.is_connected()
    time.sleep(0.02)
";

/// A tracker that this script plays, and its port; `None` where a peer is missing.
fn played(script: &str) -> Option<(Client, u16)> {
    let Some(python) = std::env::var_os("RELIEF_PEERS_PYTHON") else {
        eprintln!("SKIPPED: a tracker played by a peer (RELIEF_PEERS_PYTHON is not set)");
        return None;
    };
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let mut tracker = Command::new(python);
    tracker.args(["-c", script, &port.to_string()]).stdout(Stdio::piped());
    let mut tracker = Client(tracker.spawn().unwrap());
    let mut line = String::new();
    let stdout = tracker.0.stdout.take().unwrap();
    std::io::BufRead::read_line(&mut std::io::BufReader::new(stdout), &mut line).unwrap();
    assert_eq!(line.trim(), "ready");
    Some((tracker, port))
}

/// The next state of the hand that fulfils a condition.
async fn hand(socket: &mut Socket, is_meant: impl Fn(&RemotePose) -> bool) -> RemotePose {
    let found = async {
        loop {
            if let Some(ClientMessage::Pose(message)) = next(socket).await
                && let PoseKind::Remote(remote) = message.what
                && is_meant(&remote)
            {
                return remote;
            }
        }
    };
    tokio::time::timeout(std::time::Duration::from_secs(60), found)
        .await
        .expect("no such state within a minute")
}

/// Checks the pose that both trackers report: turned to the left by a quarter, and 0.9 m in front of
/// the tracker, which is one metre below the display.
async fn tracked(pointer: &str) -> (Client, Socket) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("geometry.json");
    std::fs::write(&file, r#"{"display_from_tracker": [[1,0,0,0],[0,1,0,-1000],[0,0,1,0],[0,0,0,1]]}"#)
        .unwrap();
    let arguments = ["--pointer", pointer, "--tracker-geometry", file.to_str().unwrap()];
    let (client, mut socket) = connected(&arguments).await;
    let (position, turn) = hand(&mut socket, |hand| hand.pose.is_some()).await.pose.unwrap();
    let half = std::f64::consts::FRAC_1_SQRT_2;
    assert!(glam::DVec3::from(position).abs_diff_eq(glam::DVec3::new(10.0, -1020.0, 900.0), 1e-9));
    assert!(glam::DVec4::from(turn).abs_diff_eq(glam::DVec4::new(0.0, 0.0, half, half), 1e-6), "{turn:?}");
    (client, socket)
}

/// Invariant: A tracker that speaks OpenIGTLink, as pyigtl does, moves the hand of a view; a tool that
/// is out of sight is lost, although others are tracked.
#[tokio::test]
async fn transforms_of_pyigtl_are_the_poses_of_a_hand() {
    let Some((_tracker, port)) = played(PYIGTL) else { return };
    let (_client, mut socket) = tracked(&format!("igtl:127.0.0.1:{port}/StylusToTracker")).await;
    hand(&mut socket, |hand| hand.state == TrackingState::Lost).await;
}
