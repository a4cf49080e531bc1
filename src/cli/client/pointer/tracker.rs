//! A tracker that speaks OpenIGTLink: its transforms are the poses of a hand, like those of a Wiimote.

use std::io::Read;
use std::net::{TcpStream, ToSocketAddrs};
use std::path::Path;
use std::time::Duration;

use anyhow::Context;
use relief_client::Handle;
use relief_live::{PoseKind, RemotePose};
use relief_tracking::{IGTL_HEADER_BYTES, IgtlError, IgtlHeader, TrackerGeometry, TrackingState, igtl_pose};

/// A tracker that sends nothing for so long has lost the tool.
const SILENT: Duration = Duration::from_millis(500);
/// How long a connection may take to be made, and the pause before it is made again.
const CONNECT: Duration = Duration::from_secs(5);
const LOOK_AGAIN: Duration = Duration::from_secs(1);
/// Largest message of another kind that is skipped, bytes: trackers send pictures on the same connection.
const MOST_SKIPPED: u64 = 256 << 20;
/// Largest file of a geometry, bytes.
const MOST_BYTES: u64 = 1 << 20;

/// The geometry of a file, or the usual one.
pub(super) fn geometry(path: Option<&Path>) -> anyhow::Result<TrackerGeometry> {
    let Some(path) = path else { return Ok(TrackerGeometry::default()) };
    let about = || format!("cannot read {}", path.display());
    let bytes = relief_base::read_at_most(path, MOST_BYTES).with_context(about)?;
    let bytes = bytes.with_context(|| format!("{} is larger than 1 MiB", path.display()))?;
    let geometry: TrackerGeometry = serde_json::from_slice(&bytes).with_context(about)?;
    geometry.validate().with_context(about)?;
    Ok(geometry)
}

pub(super) fn start(
    address: &str,
    device: Option<String>,
    geometry: TrackerGeometry,
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
            if let Err(error) = relay(stream, device.as_deref(), &geometry, &handle) {
                eprintln!("the tracker at {address}: {error}; connecting again");
            }
            lose(&handle);
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

fn lose(handle: &Handle) {
    let lost = RemotePose { state: TrackingState::Lost, pose: None, buttons: Vec::new() };
    handle.pose(handle.now_ns(), PoseKind::Remote(lost));
}

/// Reads messages until the connection or the session ends.
fn relay(
    mut stream: TcpStream,
    device: Option<&str>,
    geometry: &TrackerGeometry,
    handle: &Handle,
) -> std::io::Result<()> {
    let mut head = [0; IGTL_HEADER_BYTES];
    let mut is_told = false;
    while fill(&mut stream, &mut head, handle)? {
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
                let pointer = geometry.place(&pose).map_err(std::io::Error::other)?;
                let kind = PoseKind::Remote(RemotePose {
                    state: TrackingState::Tracking,
                    pose: Some((pointer.position.into(), pointer.orientation_xyzw())),
                    buttons: Vec::new(),
                });
                handle.pose(handle.now_ns(), kind);
            }
            Ok(None) => {}
            Err(error) if !std::mem::replace(&mut is_told, true) => {
                eprintln!("{error}; it is left out, as all like it");
            }
            Err(_) => {}
        }
    }
    Ok(())
}

/// Fills a buffer; `false` when the session is over. A tracker that says nothing has lost the tool.
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
                lose(handle);
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
