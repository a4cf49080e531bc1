//! A tracker that sends the UDP output of OpenTrack: its tool is a pointer.
//!
//! The tool has x to the right, y up and z away from the screen, as a head. Its position is relative
//! to its place of rest.

use std::net::{SocketAddr, UdpSocket};

use anyhow::Context;
use relief_tracking::{HeadPose, OPENTRACK_BYTES};

use super::tool::{SILENT, Tool};

pub(super) fn start(address: SocketAddr, mut tool: Tool) -> anyhow::Result<()> {
    let socket =
        UdpSocket::bind(address).with_context(|| format!("cannot listen for a tracker at {address}"))?;
    socket.set_read_timeout(Some(SILENT))?;
    let read = move || relay(&socket, &mut tool);
    std::thread::Builder::new().name("tracker".to_owned()).spawn(read)?;
    Ok(())
}

fn relay(socket: &UdpSocket, tool: &mut Tool) {
    let mut datagram = [0; 2 * OPENTRACK_BYTES];
    while !tool.is_stopped() {
        let received = socket.recv_from(&mut datagram).ok();
        match received.map(|(bytes, _)| HeadPose::from_opentrack(&datagram[..bytes])) {
            Some(Ok(pose)) => tool.moved(&pose.pointer()),
            Some(Err(error)) => tool.report(&error),
            None => {}
        }
        tool.check_silence();
    }
}
