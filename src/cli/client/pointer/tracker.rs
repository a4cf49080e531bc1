//! A tracker that sends OpenIGTLink: each transform is a pose of the hand, like that of a Wiimote.

use std::io::Read;
use std::net::{TcpStream, ToSocketAddrs};
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::Context;
use relief_client::Handle;
use relief_live::{PoseKind, RemotePose};
use relief_tracking::{
    IGTL_HEADER_BYTES, IgtlError, IgtlHeader, SensorPose, ToolPlacement, TrackerGeometry, TrackingState,
    igtl_pose,
};

/// After this time without a transform the tool counts as lost.
pub(super) const SILENT: Duration = Duration::from_millis(500);
/// Longest time for connecting, and the pause before the next attempt.
const CONNECT: Duration = Duration::from_secs(5);
const LOOK_AGAIN: Duration = Duration::from_secs(1);
/// Largest message of another type that is skipped, bytes: some trackers send pictures, too.
const MOST_SKIPPED: u64 = 256 << 20;
/// Largest file of a geometry, bytes.
const MOST_BYTES: u64 = 1 << 20;

/// The placement that a file describes, or the default one.
pub(super) fn placement(path: Option<&Path>) -> anyhow::Result<ToolPlacement> {
    let Some(path) = path else { return Ok(TrackerGeometry::default().placement()?) };
    let about = || format!("cannot read {}", path.display());
    let bytes = relief_base::read_at_most(path, MOST_BYTES).with_context(about)?;
    let bytes = bytes.with_context(|| format!("{} is larger than 1 MiB", path.display()))?;
    let geometry: TrackerGeometry = serde_json::from_slice(&bytes).with_context(about)?;
    geometry.placement().with_context(about)
}

pub(super) fn start(
    address: &str,
    device: Option<String>,
    placement: ToolPlacement,
    handle: &Handle,
) -> anyhow::Result<()> {
    let mut tracker =
        Some(connect(address).with_context(|| format!("cannot connect to the tracker at {address}"))?);
    let (address, handle) = (address.to_owned(), handle.clone());
    let read = move || {
        while !handle.is_stopped() {
            let Some(stream) = tracker.take() else {
                std::thread::sleep(LOOK_AGAIN);
                tracker = connect(&address).ok();
                continue;
            };
            if let Err(error) = relay(stream, device.as_deref(), &placement, &handle) {
                eprintln!("the tracker at {address}: {error}; connecting again");
            }
            send(&handle, None);
        }
    };
    std::thread::Builder::new().name("tracker".to_owned()).spawn(read)?;
    Ok(())
}

fn connect(address: &str) -> std::io::Result<TcpStream> {
    let mut last = std::io::Error::other("the name has no address");
    for one in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&one, CONNECT) {
            Ok(stream) => return stream.set_read_timeout(Some(SILENT)).map(|()| stream),
            Err(error) => last = error,
        }
    }
    Err(last)
}

/// Sends the pose of the pointer, `None` for a lost one, with the button that is held for it.
pub(super) fn send(handle: &Handle, pointer: Option<SensorPose>) {
    let state = if pointer.is_some() { TrackingState::Tracking } else { TrackingState::Lost };
    let pose = pointer.map(|pointer| (pointer.position.into(), pointer.orientation_xyzw()));
    let buttons = if handle.is_tool_held() { vec!["a".to_owned()] } else { Vec::new() };
    handle.pose(handle.now_ns(), PoseKind::Remote(RemotePose { state, pose, buttons }));
}

/// Reads messages until the connection or the session ends.
fn relay(
    mut stream: TcpStream,
    device: Option<&str>,
    placement: &ToolPlacement,
    handle: &Handle,
) -> std::io::Result<()> {
    let mut head = [0; IGTL_HEADER_BYTES];
    let (mut is_reported, mut seen) = (false, None::<Instant>);
    while fill(&mut stream, &mut head, handle)? {
        // Other tools and pictures may go on while this tool is out of sight.
        if seen.is_some_and(|seen| seen.elapsed() > SILENT) {
            send(handle, None);
            seen = None;
        }
        let header = match IgtlHeader::decode(&head) {
            Ok(header) => header,
            Err(IgtlError::Body(bytes)) if bytes <= MOST_SKIPPED => {
                skip(&mut stream, bytes, handle)?;
                continue;
            }
            Err(error) => return Err(std::io::Error::other(error)),
        };
        let mut body = vec![0; header.body_bytes];
        if !fill(&mut stream, &mut body, handle)? {
            return Ok(());
        }
        if device.is_some_and(|device| device != header.device) {
            continue;
        }
        match igtl_pose(&header, &body) {
            Ok(Some(pose)) => {
                send(handle, Some(placement.place(&pose)));
                seen = Some(Instant::now());
            }
            Ok(None) => {}
            Err(error) if !std::mem::replace(&mut is_reported, true) => {
                eprintln!("{error}; it is left out, as all like it");
            }
            Err(_) => {}
        }
    }
    Ok(())
}

/// Fills a buffer; `false` when the session is over. A pause of the tracker means a lost tool.
fn fill(stream: &mut TcpStream, buffer: &mut [u8], handle: &Handle) -> std::io::Result<bool> {
    let mut filled = 0;
    while filled < buffer.len() {
        if handle.is_stopped() {
            return Ok(false);
        }
        match stream.read(&mut buffer[filled..]) {
            Ok(0) => return Err(std::io::Error::other("it closed the connection")),
            Ok(bytes) => filled += bytes,
            Err(error)
                if matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut) =>
            {
                send(handle, None);
            }
            Err(error) => return Err(error),
        }
    }
    Ok(true)
}

fn skip(stream: &mut TcpStream, bytes: u64, handle: &Handle) -> std::io::Result<()> {
    let (mut left, mut dropped) = (bytes, [0; 16 << 10]);
    while left > 0 {
        let part = dropped.len().min(usize::try_from(left).unwrap_or(usize::MAX));
        if !fill(stream, &mut dropped[..part], handle)? {
            return Ok(());
        }
        left -= part as u64;
    }
    Ok(())
}
