//! `relief client --eyes`: the eyes of the viewer, from a head tracker, sent to the view.

use std::net::{SocketAddr, UdpSocket};
use std::path::PathBuf;
use std::time::Duration;

use anyhow::Context;

use crate::eye::geometry;
use relief_client::Handle;
use relief_live::Eyes;
use relief_tracking::{DisplayGeometry, HeadPose, OPENTRACK_BYTES};

/// The port to which OpenTrack sends where nothing else is set.
const OPENTRACK_PORT: u16 = 4242;
/// The time between two checks for the end of the program.
const LOOK: Duration = Duration::from_millis(200);

#[derive(Debug, clap::Args)]
pub(crate) struct EyesArguments {
    /// Head tracker: opentrack, which is its output "UDP over network" to 127.0.0.1:4242, or
    /// opentrack:ADDRESS:PORT for another address of this machine
    #[arg(long, value_name = "SOURCE", value_parser = source, conflicts_with_all = ["measure", "replay"])]
    eyes: Option<SocketAddr>,
    /// Size and place of the display, JSON with width_mm, height_mm, rest_mm, tracker_pitch_deg and
    /// eye_separation_mm; a 42-inch display seen from 1.86 m where left out
    #[arg(long, value_name = "FILE.json", requires = "eyes")]
    display_geometry: Option<PathBuf>,
}

impl EyesArguments {
    /// Whether there is to be a head tracker.
    pub(crate) fn is_there(&self) -> bool {
        self.eyes.is_some()
    }

    /// From where a viewer at rest sees the display, mm, where a file says so.
    pub(crate) fn distance_mm(&self) -> anyhow::Result<Option<f64>> {
        let Some(path) = &self.display_geometry else { return Ok(None) };
        Ok(Some(geometry(Some(path))?.rest_mm[2]))
    }
}

/// Takes eyes beside the session: a window, whose views follow them.
pub(super) type OnEyes = Box<dyn Fn(Eyes) + Send>;

/// The address of a source of OpenTrack.
pub(super) fn source(text: &str) -> Result<SocketAddr, String> {
    let allowed =
        || "sources are opentrack and opentrack:ADDRESS:PORT, such as opentrack:0.0.0.0:4242".to_owned();
    match text.strip_prefix("opentrack").ok_or_else(allowed)? {
        "" => Ok(SocketAddr::from(([127, 0, 0, 1], OPENTRACK_PORT))),
        rest => rest.strip_prefix(':').and_then(|address| address.parse().ok()).ok_or_else(allowed),
    }
}

/// Starts listening, on a thread that ends with the session.
pub(super) fn start(arguments: &EyesArguments, handle: &Handle, on_eyes: OnEyes) -> anyhow::Result<()> {
    let Some(address) = arguments.eyes else { return Ok(()) };
    let geometry = geometry(arguments.display_geometry.as_deref())?;
    let socket =
        UdpSocket::bind(address).with_context(|| format!("cannot listen for a head tracker at {address}"))?;
    socket.set_read_timeout(Some(LOOK))?;
    let handle = handle.clone();
    std::thread::Builder::new()
        .name("eyes".to_owned())
        .spawn(move || relay(&socket, &geometry, &handle, &on_eyes))?;
    Ok(())
}

fn relay(socket: &UdpSocket, geometry: &DisplayGeometry, handle: &Handle, on_eyes: &OnEyes) {
    let mut datagram = [0; 2 * OPENTRACK_BYTES];
    let mut is_reported = false;
    while !handle.is_stopped() {
        let Ok((bytes, _)) = socket.recv_from(&mut datagram) else { continue };
        let head = match HeadPose::from_opentrack(&datagram[..bytes]) {
            Ok(head) => head,
            Err(error) => {
                if !std::mem::replace(&mut is_reported, true) {
                    eprintln!("{error}; it is ignored, and later invalid ones are ignored without a message");
                }
                continue;
            }
        };
        let [left, right] = geometry.eyes(&head).map(Into::into);
        let eyes = Eyes { t_ns: handle.now_ns(), left_mm: left, right_mm: right };
        if eyes.validate().is_ok() {
            on_eyes(eyes);
            handle.eyes(eyes);
        }
    }
}
