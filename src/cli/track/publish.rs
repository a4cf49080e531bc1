//! An OpenIGTLink server of poses: every client gets TRANSFORM and POSITION, and TDATA when it asks
//! for it.
//!
//! One thread serves the listener and all clients. Only the newest pose waits for it. A client that
//! does not accept data within 50 ms is disconnected, so that it does not delay the others.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use anyhow::Context;

use relief_tracking::{IGTL_HEADER_BYTES, IgtlHeader, SensorPose};

const DEVICE: &str = "WiimoteToBeacon";
const TOOL: &str = "Wiimote";
const MAX_CLIENTS: usize = 16;
const STALL: Duration = Duration::from_millis(50);

/// A pose and its time since 1970, ns.
type Published = (u64, Option<SensorPose>);

pub(crate) struct Publisher {
    poses: SyncSender<Published>,
}

impl Publisher {
    /// Listens, and says where.
    pub(crate) fn start(address: SocketAddr) -> anyhow::Result<Self> {
        let listener = TcpListener::bind(address).with_context(|| format!("cannot listen on {address}"))?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        eprintln!("OpenIGTLink on {address}");
        let (poses, received) = sync_channel(1);
        let serve = move || serve(&listener, &received);
        std::thread::Builder::new().name("openigtlink".to_owned()).spawn(serve)?;
        Ok(Self { poses })
    }

    /// Hands over a pose; one that the thread has no time for is left out, as a newer one follows.
    pub(crate) fn publish(&self, unix_ns: u64, pose: Option<SensorPose>) {
        let _ = self.poses.try_send((unix_ns, pose));
    }
}

struct Client {
    stream: TcpStream,
    incoming: Vec<u8>,
    wants_tracking_data: bool,
}

fn serve(listener: &TcpListener, poses: &Receiver<Published>) {
    let mut clients: Vec<Client> = Vec::new();
    loop {
        while let Ok((stream, _)) = listener.accept() {
            if clients.len() < MAX_CLIENTS {
                clients.extend(Client::new(stream));
            }
        }
        match poses.recv_timeout(Duration::from_millis(20)) {
            Ok(published) => clients.retain_mut(|client| client.serve(Some(&published)).is_ok()),
            Err(RecvTimeoutError::Timeout) => clients.retain_mut(|client| client.serve(None).is_ok()),
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

impl Client {
    fn new(stream: TcpStream) -> Option<Self> {
        // Accepted sockets do not wait on some systems, as their listener.
        stream.set_nonblocking(false).ok()?;
        stream.set_write_timeout(Some(STALL)).ok()?;
        stream.set_nodelay(true).ok()?;
        Some(Self { stream, incoming: Vec::new(), wants_tracking_data: false })
    }

    fn serve(&mut self, published: Option<&Published>) -> std::io::Result<()> {
        self.read_requests(published.map_or(0, |(unix_ns, _)| *unix_ns))?;
        let Some((unix_ns, pose)) = published else { return Ok(()) };
        let mut bytes = Vec::new();
        if let Some(pose) = pose {
            bytes.extend(relief_tracking::igtl_transform(DEVICE, *unix_ns, pose));
            bytes.extend(relief_tracking::igtl_position(DEVICE, *unix_ns, pose));
        }
        if self.wants_tracking_data {
            bytes.extend(relief_tracking::igtl_tracking_data(DEVICE, *unix_ns, TOOL, pose.as_ref()));
        }
        self.stream.write_all(&bytes)
    }

    /// Reads received data without waiting, and executes STT_TDATA and STP_TDATA.
    fn read_requests(&mut self, unix_ns: u64) -> std::io::Result<()> {
        let mut buffer = [0; 512];
        self.stream.set_nonblocking(true)?;
        let read = self.stream.read(&mut buffer);
        self.stream.set_nonblocking(false)?;
        match read {
            Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
            Ok(count) => self.incoming.extend(&buffer[..count]),
            Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(()),
            Err(error) => return Err(error),
        }
        while let Some(head) = self.incoming.first_chunk::<IGTL_HEADER_BYTES>() {
            let header = IgtlHeader::decode(head)
                .map_err(|error| std::io::Error::new(ErrorKind::InvalidData, error))?;
            let whole = IGTL_HEADER_BYTES + header.body_bytes;
            if self.incoming.len() < whole {
                break;
            }
            self.incoming.drain(..whole);
            if matches!(header.kind.as_str(), "STT_TDATA" | "STP_TDATA") {
                self.wants_tracking_data = header.kind == "STT_TDATA";
                self.stream.write_all(&relief_tracking::igtl_acknowledgement(DEVICE, unix_ns))?;
            }
        }
        Ok(())
    }
}
