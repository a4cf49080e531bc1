//! A TCP connection to a tracker, which is made again when it breaks.

use std::io::{ErrorKind, Read};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

use anyhow::Context;

use super::network::Network;
use super::tool::{SILENT, Tool};

/// Longest time for connecting, and the pause before the next attempt.
const CONNECT: Duration = Duration::from_secs(5);
const LOOK_AGAIN: Duration = Duration::from_secs(1);

/// Relays the messages of one connection until it or the session ends.
pub(super) type Relay = fn(&mut Connection, source: &Network) -> std::io::Result<()>;

pub(super) struct Connection {
    pub(super) stream: TcpStream,
    pub(super) tool: Tool,
}

/// Connects, and relays on a thread that ends with the session.
pub(super) fn start(source: &Network, tool: Tool, relay: Relay) -> anyhow::Result<()> {
    let address = source.address.clone();
    let stream = connect(&address).with_context(|| format!("cannot connect to the tracker at {address}"))?;
    let source = source.clone();
    let mut connection = Connection { stream, tool };
    let read = move || {
        while !connection.tool.is_stopped() {
            if let Err(error) = relay(&mut connection, &source) {
                eprintln!("the tracker at {address}: {error}; connecting again");
            }
            connection.tool.lost();
            while !connection.tool.is_stopped() {
                std::thread::sleep(LOOK_AGAIN);
                if let Ok(stream) = connect(&address) {
                    connection.stream = stream;
                    break;
                }
            }
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

impl Connection {
    /// Waits for bytes; `None` when the session is over. A pause of the tracker means a lost tool.
    pub(super) fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<Option<usize>> {
        loop {
            if self.tool.is_stopped() {
                return Ok(None);
            }
            match self.stream.read(buffer) {
                Ok(0) => return Err(std::io::Error::other("it closed the connection")),
                Ok(bytes) => return Ok(Some(bytes)),
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    self.tool.lost();
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
    }

    /// Fills a buffer; `false` when the session is over.
    pub(super) fn fill(&mut self, buffer: &mut [u8]) -> std::io::Result<bool> {
        let mut filled = 0;
        while filled < buffer.len() {
            let Some(bytes) = self.read(&mut buffer[filled..])? else { return Ok(false) };
            filled += bytes;
        }
        Ok(true)
    }
}
