//! A tracker that sends the UDP output of OpenTrack: its tool is a pointer.
//!
//! The tool has x to the right, y up and z away from the screen, as a head. Its position is relative
//! to its place of rest.

use std::net::{SocketAddr, UdpSocket};
use std::time::Instant;

use anyhow::Context;
use relief_client::Handle;
use relief_tracking::{HeadPose, OPENTRACK_BYTES, ToolPlacement};

use super::tracker::{SILENT, send};

pub(super) fn start(address: SocketAddr, placement: ToolPlacement, handle: &Handle) -> anyhow::Result<()> {
    let socket =
        UdpSocket::bind(address).with_context(|| format!("cannot listen for a tracker at {address}"))?;
    socket.set_read_timeout(Some(SILENT))?;
    let handle = handle.clone();
    let read = move || relay(&socket, &placement, &handle);
    std::thread::Builder::new().name("tracker".to_owned()).spawn(read)?;
    Ok(())
}

fn relay(socket: &UdpSocket, placement: &ToolPlacement, handle: &Handle) {
    let mut datagram = [0; 2 * OPENTRACK_BYTES];
    let (mut is_reported, mut seen) = (false, Some(Instant::now()));
    while !handle.is_stopped() {
        let received = socket.recv_from(&mut datagram).ok();
        match received.map(|(bytes, _)| HeadPose::from_opentrack(&datagram[..bytes])) {
            Some(Ok(tool)) => {
                send(handle, Some(placement.place(&tool.pointer())));
                seen = Some(Instant::now());
            }
            Some(Err(error)) if !std::mem::replace(&mut is_reported, true) => {
                eprintln!("{error}; it is left out, as all like it");
            }
            _ => {}
        }
        if seen.is_some_and(|seen| seen.elapsed() >= SILENT) {
            send(handle, None);
            seen = None;
        }
    }
}
