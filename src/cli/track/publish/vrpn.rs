//! VRPN: every client gets the poses of sensor 0 and the changes of buttons.
//!
//! Clients connect by TCP (`Wiimote@tcp://HOST:PORT`), or ask by a datagram to be connected to
//! (`Wiimote@HOST:PORT`): it holds their host and port as text. Relief connects to the address that
//! the datagram came from, whatever host it names.

use std::io::ErrorKind;
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};

use anyhow::Context;
use relief_tracking::{Buttons, VrpnError, VrpnEvent, VrpnReader, VrpnWriter};

use super::protocol::{Listener, Published, STALL, Session};

const DEVICE: &str = "Wiimote";

pub(super) struct Server {
    listener: TcpListener,
    requests: UdpSocket,
}

impl Server {
    /// Listens on a TCP and a UDP port of the same number.
    pub(super) fn listen(address: SocketAddr) -> anyhow::Result<Self> {
        let listener = super::protocol::listen(address)?;
        let address = listener.local_addr()?;
        let requests =
            UdpSocket::bind(address).with_context(|| format!("cannot listen on UDP port {address}"))?;
        requests.set_nonblocking(true)?;
        Ok(Self { listener, requests })
    }

    pub(super) fn local_addr(&self) -> std::io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    fn requested(&self) -> Option<TcpStream> {
        let mut datagram = [0; 512];
        while let Ok((bytes, from)) = self.requests.recv_from(&mut datagram) {
            let stream = requested_port(&datagram[..bytes])
                .and_then(|port| TcpStream::connect_timeout(&(from.ip(), port).into(), STALL).ok());
            if stream.is_some() {
                return stream;
            }
        }
        None
    }
}

/// The port of a request, such as `host 12345` with a final zero.
fn requested_port(datagram: &[u8]) -> Option<u16> {
    let text = datagram.split(|byte| *byte == 0).next()?;
    let (_, port) = std::str::from_utf8(text).ok()?.trim().rsplit_once(' ')?;
    port.parse().ok().filter(|port| *port != 0)
}

impl Listener for Server {
    type Session = VrpnSession;

    fn accept(&mut self) -> Option<TcpStream> {
        self.listener.accept().ok().map(|(stream, _)| stream).or_else(|| self.requested())
    }

    fn session(&self) -> VrpnSession {
        VrpnSession::default()
    }
}

#[derive(Default)]
pub(super) struct VrpnSession {
    reader: VrpnReader,
    writer: VrpnWriter,
    sent: Buttons,
}

impl Session for VrpnSession {
    fn greeting(&mut self) -> Vec<u8> {
        self.writer.greeting(DEVICE)
    }

    fn answer(&mut self, received: &[u8], unix_ns: u64) -> std::io::Result<Vec<u8>> {
        self.reader.push(received);
        let mut answer = Vec::new();
        loop {
            match self.reader.next_event() {
                Ok(Some(VrpnEvent::Ping { device })) if device == DEVICE => {
                    answer.extend(self.writer.pong(unix_ns));
                }
                Ok(None) => return Ok(answer),
                Ok(Some(_)) | Err(VrpnError::Content(_)) => {}
                Err(error) => return Err(std::io::Error::new(ErrorKind::InvalidData, error)),
            }
        }
    }

    fn publish(&mut self, published: &Published) -> Vec<u8> {
        let Published { unix_ns, pose, buttons } = published;
        let before = std::mem::replace(&mut self.sent, *buttons);
        let mut bytes = self.writer.buttons(*unix_ns, before, *buttons);
        bytes.extend(pose.iter().flat_map(|pose| self.writer.pose(*unix_ns, pose)));
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::requested_port;

    #[test]
    fn a_request_is_a_host_and_a_port() {
        assert_eq!(requested_port(b"192.168.0.7 41234\0"), Some(41_234));
        assert_eq!(requested_port(b"box.example 1"), Some(1));
        for wrong in [&b""[..], b"host", b"host 0", b"host 70000", b"host x\0", b"\xff 5"] {
            assert_eq!(requested_port(wrong), None, "{wrong:?}");
        }
    }
}
