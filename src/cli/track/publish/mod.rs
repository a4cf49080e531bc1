//! Servers of poses and buttons for other programs.
//!
//! Each protocol has one thread for its listener and all clients. Only the newest state waits for it.
//! A client that does not accept data within 50 ms is disconnected, so that it does not delay the
//! others.

mod igtl;
mod protocol;
mod vrpn;

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

pub(crate) use protocol::Published;
use protocol::{Listener, STALL, Session, listen};

const MAX_CLIENTS: usize = 16;

#[derive(Debug, clap::Args)]
pub(crate) struct PublishArguments {
    /// Serve poses over OpenIGTLink (TRANSFORM, POSITION; TDATA to those who ask)
    #[arg(long, value_name = "ADDRESS:PORT")]
    igtl: Option<SocketAddr>,
    /// Serve poses and buttons over VRPN, as the tracker and button device Wiimote; VRPN's own port
    /// is 3883
    #[arg(long, value_name = "ADDRESS:PORT")]
    vrpn: Option<SocketAddr>,
}

/// The servers that run.
pub(crate) struct Publishers(Vec<SyncSender<Published>>);

impl Publishers {
    /// Starts the chosen servers, and prints their addresses.
    pub(crate) fn start(arguments: &PublishArguments) -> anyhow::Result<Self> {
        let mut publishers = Vec::new();
        if let Some(address) = arguments.igtl {
            let listener = listen(address)?;
            eprintln!("OpenIGTLink on {}", listener.local_addr()?);
            publishers.push(start("openigtlink", igtl::Server(listener))?);
        }
        if let Some(address) = arguments.vrpn {
            let server = vrpn::Server::listen(address)?;
            eprintln!("VRPN on {}", server.local_addr()?);
            publishers.push(start("vrpn", server)?);
        }
        Ok(Self(publishers))
    }

    /// Hands over a state; a server that is busy leaves it out, as a newer one follows.
    pub(crate) fn publish(&self, published: Published) {
        for publisher in &self.0 {
            let _ = publisher.try_send(published);
        }
    }
}

fn start(name: &str, listener: impl Listener) -> anyhow::Result<SyncSender<Published>> {
    let (states, received) = sync_channel(1);
    std::thread::Builder::new().name(name.to_owned()).spawn(move || serve(listener, &received))?;
    Ok(states)
}

fn serve<L: Listener>(mut listener: L, states: &Receiver<Published>) {
    let mut clients: Vec<Client<L::Session>> = Vec::new();
    loop {
        while let Some(stream) = listener.accept() {
            if clients.len() < MAX_CLIENTS {
                clients.extend(Client::greet(stream, listener.session()));
            }
        }
        match states.recv_timeout(Duration::from_millis(20)) {
            Ok(published) => clients.retain_mut(|client| client.serve(Some(&published)).is_ok()),
            Err(RecvTimeoutError::Timeout) => clients.retain_mut(|client| client.serve(None).is_ok()),
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

struct Client<S> {
    stream: TcpStream,
    session: S,
}

impl<S: Session> Client<S> {
    fn greet(mut stream: TcpStream, mut session: S) -> Option<Self> {
        // Accepted sockets do not wait on some systems, as their listener.
        stream.set_nonblocking(false).ok()?;
        stream.set_write_timeout(Some(STALL)).ok()?;
        stream.set_nodelay(true).ok()?;
        stream.write_all(&session.greeting()).ok()?;
        Some(Self { stream, session })
    }

    fn serve(&mut self, published: Option<&Published>) -> std::io::Result<()> {
        self.answer(published.map_or(0, |published| published.unix_ns))?;
        let bytes = published.map_or_else(Vec::new, |published| self.session.publish(published));
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
