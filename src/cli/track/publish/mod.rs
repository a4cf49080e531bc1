//! A server of poses for other programs, by OpenIGTLink.
//!
//! One thread serves the listener and all clients. Only the newest state waits for it. A client that
//! does not accept data within 50 ms is disconnected, so that it does not delay the others.

mod igtl;

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use anyhow::Context;
use relief_tracking::SensorPose;

use igtl::IgtlSession;

const MAX_CLIENTS: usize = 16;
/// Longest time that a client may delay the others.
const STALL: Duration = Duration::from_millis(50);

#[derive(Debug, clap::Args)]
pub(crate) struct PublishArguments {
    /// Serve poses over OpenIGTLink (TRANSFORM, POSITION; TDATA to those who ask)
    #[arg(long, value_name = "ADDRESS:PORT")]
    igtl: Option<SocketAddr>,
}

/// The tracked Wiimote at one time.
#[derive(Clone, Copy)]
pub(crate) struct Published {
    /// Time since 1970, ns.
    pub(crate) unix_ns: u64,
    /// `beacon_from_sensor`, while tracking.
    pub(crate) pose: Option<SensorPose>,
}

/// The server, where one was chosen.
pub(crate) struct Publisher(Option<SyncSender<Published>>);

impl Publisher {
    /// Starts the chosen server, and prints its address.
    pub(crate) fn start(arguments: &PublishArguments) -> anyhow::Result<Self> {
        let Some(address) = arguments.igtl else { return Ok(Self(None)) };
        let listener = TcpListener::bind(address).with_context(|| format!("cannot listen on {address}"))?;
        listener.set_nonblocking(true)?;
        eprintln!("OpenIGTLink on {}", listener.local_addr()?);
        let (states, received) = sync_channel(1);
        std::thread::Builder::new()
            .name("openigtlink".to_owned())
            .spawn(move || serve(&listener, &received))?;
        Ok(Self(Some(states)))
    }

    /// Hands over a state; a server that is busy leaves it out, as a newer one follows.
    pub(crate) fn publish(&self, published: Published) {
        if let Some(publisher) = &self.0 {
            let _ = publisher.try_send(published);
        }
    }
}

fn serve(listener: &TcpListener, states: &Receiver<Published>) {
    let mut clients: Vec<Client> = Vec::new();
    loop {
        while let Ok((stream, _)) = listener.accept() {
            if clients.len() < MAX_CLIENTS {
                clients.extend(Client::new(stream));
            }
        }
        match states.recv_timeout(Duration::from_millis(20)) {
            Ok(published) => clients.retain_mut(|client| client.serve(Some(&published)).is_ok()),
            Err(RecvTimeoutError::Timeout) => clients.retain_mut(|client| client.serve(None).is_ok()),
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

struct Client {
    stream: TcpStream,
    session: IgtlSession,
}

impl Client {
    fn new(stream: TcpStream) -> Option<Self> {
        // Accepted sockets do not wait on some systems, as their listener.
        stream.set_nonblocking(false).ok()?;
        stream.set_write_timeout(Some(STALL)).ok()?;
        stream.set_nodelay(true).ok()?;
        Some(Self { stream, session: IgtlSession::default() })
    }

    fn serve(&mut self, published: Option<&Published>) -> std::io::Result<()> {
        self.answer(published.map_or(0, |published| published.unix_ns))?;
        let bytes = published.map_or_else(Vec::new, |published| {
            self.session.publish(published.unix_ns, published.pose.as_ref())
        });
        self.stream.write_all(&bytes)
    }

    /// Reads received data without waiting, and answers it.
    fn answer(&mut self, unix_ns: u64) -> std::io::Result<()> {
        let mut buffer = [0; 512];
        self.stream.set_nonblocking(true)?;
        let read = self.stream.read(&mut buffer);
        self.stream.set_nonblocking(false)?;
        match read {
            Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
            Ok(count) => {
                let answer = self.session.answer(&buffer[..count], unix_ns)?;
                self.stream.write_all(&answer)
            }
            Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(()),
            Err(error) => Err(error),
        }
    }
}
