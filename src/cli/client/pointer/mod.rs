//! `relief client --pointer`: input devices beside the Wiimote, through the same poses and intents.

mod connection;
mod igtl;
mod network;
mod opentrack;
#[cfg(unix)]
mod spacemouse;
mod tool;

use std::net::SocketAddr;
use std::path::PathBuf;

use crate::client::eyes;
use network::Network;
use relief_client::Handle;
use tool::Tool;

/// The socket of spacenavd.
const SPACENAVD: &str = "/var/run/spnav.sock";

#[derive(Debug, clap::Args)]
pub(crate) struct PointerArguments {
    /// Another pointer: spacemouse (by spacenavd), spacemouse:SOCKET, igtl:HOST:PORT[/DEVICE], a
    /// tracker that sends OpenIGTLink transforms, opentrack or opentrack:ADDRESS:PORT, one that sends
    /// OpenTrack's output "UDP over network" to 127.0.0.1:4242 or another address of this machine. The
    /// space bar is the button A of a tracker's tool
    #[arg(long, value_name = "SOURCE", value_parser = parse, conflicts_with_all = ["measure", "replay"])]
    pointer: Option<Pointer>,
    /// Axes of the tracker and of its tool: JSON with display_from_tracker and tool_from_pointer, rows
    /// of 4x4 matrices in mm; identities where left out
    #[arg(long, value_name = "FILE.json", requires = "pointer")]
    tracker_geometry: Option<PathBuf>,
}

/// A source of movements.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Pointer {
    /// A SpaceMouse behind this socket of spacenavd.
    SpaceMouse(PathBuf),
    /// A server of OpenIGTLink.
    Igtl(Network),
    /// The address that OpenTrack sends to.
    OpenTrack(SocketAddr),
}

impl PointerArguments {
    /// Whether a pointer is named.
    pub(crate) fn is_there(&self) -> bool {
        self.pointer.is_some()
    }
}

fn parse(text: &str) -> Result<Pointer, String> {
    if let Some(rest) = text.strip_prefix("spacemouse") {
        match rest.strip_prefix(':') {
            Some(socket) if !socket.is_empty() => return Ok(Pointer::SpaceMouse(socket.into())),
            None if rest.is_empty() => return Ok(Pointer::SpaceMouse(SPACENAVD.into())),
            _ => {}
        }
    }
    if let Some(source) = text.strip_prefix("igtl:").and_then(network::igtl_source) {
        return Ok(Pointer::Igtl(source));
    }
    if text.starts_with("opentrack") {
        return eyes::source(text).map(Pointer::OpenTrack);
    }
    Err("pointers are spacemouse[:SOCKET], igtl:HOST:PORT[/DEVICE] and opentrack[:ADDRESS:PORT]".to_owned())
}

/// Starts reading, on a thread that ends with the session.
pub(crate) fn start(arguments: &PointerArguments, handle: &Handle) -> anyhow::Result<()> {
    let Some(pointer) = &arguments.pointer else { return Ok(()) };
    let geometry = arguments.tracker_geometry.as_deref();
    match pointer {
        Pointer::SpaceMouse(socket) => {
            if geometry.is_some() {
                anyhow::bail!("--tracker-geometry needs a tracker (--pointer igtl or opentrack)");
            }
            #[cfg(unix)]
            return spacemouse::start(socket, handle);
            #[cfg(not(unix))]
            anyhow::bail!("spacenavd at {} needs Unix", socket.display());
        }
        Pointer::Igtl(source) => connection::start(source, Tool::new(geometry, handle)?, igtl::relay),
        Pointer::OpenTrack(address) => opentrack::start(*address, Tool::new(geometry, handle)?),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_are_sockets_and_addresses() {
        assert_eq!(parse("spacemouse"), Ok(Pointer::SpaceMouse(SPACENAVD.into())));
        assert_eq!(parse("spacemouse:/tmp/s"), Ok(Pointer::SpaceMouse("/tmp/s".into())));
        let igtl = |address: &str, device: Option<&str>| {
            Pointer::Igtl(Network { address: address.to_owned(), device: device.map(str::to_owned) })
        };
        assert_eq!(parse("igtl:plus:18944"), Ok(igtl("plus:18944", None)));
        assert_eq!(parse("igtl:[::1]:18944/Stylus"), Ok(igtl("[::1]:18944", Some("Stylus"))));
        assert_eq!(parse("opentrack"), Ok(Pointer::OpenTrack(SocketAddr::from(([127, 0, 0, 1], 4242)))));
        let other = SocketAddr::from(([0, 0, 0, 0], 5000));
        assert_eq!(parse("opentrack:0.0.0.0:5000"), Ok(Pointer::OpenTrack(other)));
        for wrong in [
            "",
            "spacemouse:",
            "spacemouse2",
            "igtl:",
            "igtl:plus",
            "igtl::1",
            "igtl:plus:x",
            "igtl:plus:1/",
            "mouse",
            "opentrack:",
            "opentrack:4242",
        ] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
