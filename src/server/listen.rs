//! Connections: accepting them within limits, noticing the slow and the gone, and draining them at
//! the end.
//!
//! A WebSocket leaves these limits with its upgrade; `live` has its own. A connection has at most
//! one request and one encoded frame at a time. Clients that send a request's head too slowly, or
//! do not read answers, are disconnected. A connection beyond the limit takes the place of the one
//! that has been idle the longest; where none is idle, it waits in the system's backlog. An address
//! other than loopback has a share of the connections: one beyond it takes the place of the idlest
//! of the same address, or is closed.

use std::convert::Infallible;
use std::future::Future;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::body::Bytes;
use http_body_util::BodyExt;
use hyper::body::{Body, Incoming};
use hyper::server::conn::http1;
use hyper::service::{HttpService, Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

use super::identity::Peer;
use super::idle::{Connections, Entry, Running};
use super::stall::StallGuard;
use super::tls::{Tls, common_name};

/// Limits of the time and of the number of connections.
#[derive(Clone, Debug)]
pub struct ConnectionLimits {
    /// Connections held at a time.
    pub connections: usize,
    /// Connections of one address at a time; loopback and the addresses of a trusted proxy have no
    /// such limit.
    pub connections_per_address: usize,
    /// Addresses without that limit.
    pub unlimited: Vec<IpAddr>,
    /// Longest time for a request's head to arrive, and of an idle connection.
    pub head_timeout: Duration,
    /// Longest time without progress while a client receives an answer.
    pub stall_timeout: Duration,
    /// Longest time for running requests to finish after the signal to stop.
    pub drain_timeout: Duration,
}

impl Default for ConnectionLimits {
    fn default() -> Self {
        Self {
            connections: 256,
            connections_per_address: 64,
            unlimited: Vec::new(),
            head_timeout: Duration::from_secs(20),
            stall_timeout: Duration::from_secs(20),
            drain_timeout: Duration::from_secs(10),
        }
    }
}

/// How serving ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shutdown {
    /// Every running request was finished.
    Whole,
    /// Time ran out; the rest was cut off.
    CutOff,
}

/// Serves `app` until `stop` is done, then finishes running requests within the limit. With `tls`,
/// connections are encrypted.
pub async fn serve(
    listener: TcpListener,
    tls: Option<Arc<Tls>>,
    app: Router,
    limits: ConnectionLimits,
    stop: impl Future<Output = ()>,
) -> Shutdown {
    let places = Arc::new(Semaphore::new(limits.connections));
    let known = Arc::new(Connections::default());
    let draining = watch::Sender::new(false);
    let mut connections = tokio::task::JoinSet::new();
    let mut stop = std::pin::pin!(stop);
    loop {
        let (stream, peer, place) = tokio::select! {
            () = &mut stop => break,
            accepted = accept(&listener, &places, &known, &limits) => accepted,
        };
        while connections.try_join_next().is_some() {}
        let connection = Connection {
            app: app.clone(),
            entry: Arc::new(known.add(peer.address.ip())),
            peer,
            drain: draining.subscribe(),
            head_timeout: limits.head_timeout,
        };
        let stream = StallGuard::new(stream, limits.stall_timeout);
        let tls = tls.clone();
        connections.spawn(async move {
            match tls {
                None => connection.run(stream).await,
                Some(tls) => connection.run_encrypted(&tls, stream).await,
            }
            drop(place);
        });
    }
    drop(listener); // new connections are refused from here on
    draining.send_replace(true);
    let all = async { while connections.join_next().await.is_some() {} };
    match tokio::time::timeout(limits.drain_timeout, all).await {
        Ok(()) => Shutdown::Whole,
        Err(_) => Shutdown::CutOff, // dropping the set ends the other connections
    }
}

/// A connection that has been accepted.
struct Connection {
    app: Router,
    entry: Arc<Entry>,
    peer: Peer,
    drain: watch::Receiver<bool>,
    head_timeout: Duration,
}

impl Connection {
    /// Encrypts the stream and answers its requests. A connection counts as idle until it is
    /// encrypted.
    async fn run_encrypted(mut self, tls: &Tls, stream: StallGuard<TcpStream>) {
        let handshake = tokio::time::timeout(self.head_timeout, tls.acceptor().accept(stream));
        let stream = tokio::select! {
            handshake = handshake => match handshake {
                Ok(Ok(stream)) => stream,
                Ok(Err(error)) => return tracing::debug!(%error, "a TLS handshake failed"),
                Err(_) => return tracing::debug!("a TLS handshake took too long"),
            },
            () = self.entry.closed() => return,
        };
        let certificates = stream.get_ref().1.peer_certificates();
        self.peer.certificate = certificates.and_then(|chain| common_name(chain.first()?));
        self.peer.is_encrypted = true;
        self.run(stream).await;
    }

    /// Answers the requests of a stream.
    async fn run(mut self, stream: impl AsyncRead + AsyncWrite + Send + Unpin + 'static) {
        let service =
            answering(TowerToHyperService::new(self.app), Arc::clone(&self.entry), self.peer.clone());
        let connection = http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(self.head_timeout)
            .max_buf_size(64 << 10)
            .serve_connection(TokioIo::new(stream), service)
            .with_upgrades();
        let mut connection = std::pin::pin!(connection);
        let ended = tokio::select! {
            ended = &mut connection => ended,
            () = self.entry.closed() => Ok(()), // idle, and another connection needs its place
            _ = self.drain.changed() => {
                connection.as_mut().graceful_shutdown();
                connection.await
            }
        };
        if let Err(error) = ended {
            tracing::debug!(%error, "a connection ended early");
        }
    }
}

/// The application for one connection: its entry is busy until the last byte of an answer was taken.
fn answering(
    app: TowerToHyperService<Router>,
    entry: Arc<Entry>,
    peer: Peer,
) -> impl HttpService<
    Incoming,
    ResBody = impl Body<Data = Bytes, Error = axum::Error> + Send + 'static,
    Error = Infallible,
    Future: Send,
> + use<> {
    service_fn(move |mut request: hyper::Request<Incoming>| {
        request.extensions_mut().insert(peer.clone());
        let (running, answer) = (entry.request(), app.call(request));
        async move {
            let answer = answer.await?;
            Ok(answer.map(|body| {
                body.map_frame(move |frame| {
                    let _kept: &Running = &running;
                    frame
                })
            }))
        }
    })
}

/// The next connection, when there is a place for it.
async fn accept(
    listener: &TcpListener,
    places: &Arc<Semaphore>,
    known: &Connections,
    limits: &ConnectionLimits,
) -> (TcpStream, Peer, Option<OwnedSemaphorePermit>) {
    loop {
        match listener.accept().await {
            Ok((stream, address)) => {
                let ip = address.ip();
                let is_limited = !ip.is_loopback() && !limits.unlimited.contains(&ip);
                if is_limited
                    && known.count_of(ip) >= limits.connections_per_address
                    && !known.close_idlest(Some(ip))
                {
                    tracing::debug!("an address has its share of connections");
                    continue;
                }
                if places.available_permits() == 0 {
                    known.close_idlest(None);
                }
                let place = Arc::clone(places).acquire_owned().await.ok();
                // Frames go out whole: waiting to fill packets only delays them.
                let _ = stream.set_nodelay(true);
                return (stream, Peer { address, certificate: None, is_encrypted: false }, place);
            }
            Err(error) => {
                // Out of file descriptors, or the client has left already: neither is a reason to
                // stop.
                tracing::warn!(%error, "cannot accept a connection");
                tokio::time::sleep(Duration::from_millis(50)).await;
            }
        }
    }
}
