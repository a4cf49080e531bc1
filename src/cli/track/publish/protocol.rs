//! The interface of a protocol for publishing.

use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::Duration;

use anyhow::Context;
use relief_tracking::{Buttons, SensorPose};

/// Longest time that a client may delay the others.
pub(super) const STALL: Duration = Duration::from_millis(50);

/// The tracked Wiimote at one time.
#[derive(Clone, Copy)]
pub(crate) struct Published {
    /// Time since 1970, ns.
    pub(crate) unix_ns: u64,
    /// `beacon_from_sensor`, while tracking.
    pub(crate) pose: Option<SensorPose>,
    /// The buttons held.
    pub(crate) buttons: Buttons,
}

/// One client's side of a protocol: bytes to send.
pub(super) trait Session {
    /// The first bytes of a connection.
    fn greeting(&mut self) -> Vec<u8>;
    /// Answers to bytes of a client.
    fn answer(&mut self, received: &[u8], unix_ns: u64) -> std::io::Result<Vec<u8>>;
    /// A new state.
    fn publish(&mut self, published: &Published) -> Vec<u8>;
}

/// Accepts connections without waiting.
pub(super) trait Listener: Send + 'static {
    type Session: Session;
    fn accept(&mut self) -> Option<TcpStream>;
    fn session(&self) -> Self::Session;
}

/// Opens a port whose `accept` does not wait.
pub(super) fn listen(address: SocketAddr) -> anyhow::Result<TcpListener> {
    let listener = TcpListener::bind(address).with_context(|| format!("cannot listen on {address}"))?;
    listener.set_nonblocking(true)?;
    Ok(listener)
}
