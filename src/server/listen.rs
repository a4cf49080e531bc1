//! Connections: accepting them within limits, noticing the slow and the gone, and draining them at
//! the end.
//!
//! A WebSocket leaves these limits with its upgrade; `live` has its own. A connection has at most
//! one request and one encoded frame at a time. Clients that send a request's head too slowly, or
//! do not read answers, are disconnected. A connection beyond the limit takes the place of the one
//! that has been idle the longest; where none is idle, it waits in the system's backlog.

use std::convert::Infallible;
use std::future::Future;
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use axum::Router;
use axum::body::Bytes;
use http_body_util::BodyExt;
use hyper::body::{Body, Incoming};
use hyper::server::conn::http1;
use hyper::service::{HttpService, Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, watch};
use tokio::time::{Instant, Sleep};

use super::idle::{Connections, Entry, Running};

/// How much of their time and number connections may take.
#[derive(Clone, Copy, Debug)]
pub struct ConnectionLimits {
    /// Connections held at a time.
    pub connections: usize,
    /// Longest time for a request's head to arrive; also how long an idle connection is kept.
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

/// Serves `app` until `stop` is done, then finishes running requests within the limit.
pub async fn serve(
    listener: TcpListener,
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
        let (stream, place) = tokio::select! {
            () = &mut stop => break,
            accepted = accept(&listener, &places, &known) => accepted,
        };
        while connections.try_join_next().is_some() {}
        let entry = Arc::new(known.add());
        let service = answering(TowerToHyperService::new(app.clone()), Arc::clone(&entry));
        let io = TokioIo::new(StallGuard::new(stream, limits.stall_timeout));
        let mut drain = draining.subscribe();
        let connection = http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(limits.head_timeout)
            .max_buf_size(64 << 10)
            .serve_connection(io, service)
            .with_upgrades();
        connections.spawn(async move {
            let mut connection = std::pin::pin!(connection);
            let ended = tokio::select! {
                ended = &mut connection => ended,
                () = entry.closed() => Ok(()), // idle, and another connection needs its place
                _ = drain.changed() => {
                    connection.as_mut().graceful_shutdown();
                    connection.await
                }
            };
            if let Err(error) = ended {
                tracing::debug!(%error, "a connection ended early");
            }
            drop(place);
        });
    }
    drop(listener); // new connections are refused from here on
    draining.send_replace(true);
    let all = async { while connections.join_next().await.is_some() {} };
    match tokio::time::timeout(limits.drain_timeout, all).await {
        Ok(()) => Shutdown::Whole,
        Err(_) => Shutdown::CutOff, // dropping the set ends what is left
    }
}

/// The application for one connection: its entry is busy until the last byte of an answer was taken.
fn answering(
    app: TowerToHyperService<Router>,
    entry: Arc<Entry>,
) -> impl HttpService<
    Incoming,
    ResBody = impl Body<Data = Bytes, Error = axum::Error> + Send + 'static,
    Error = Infallible,
    Future: Send,
> + use<> {
    service_fn(move |request| {
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
) -> (TcpStream, impl Sized + Send + use<>) {
    loop {
        match listener.accept().await {
            Ok((stream, _)) => {
                if places.available_permits() == 0 {
                    known.close_idlest();
                }
                let place = Arc::clone(places).acquire_owned().await.ok();
                // Frames go out whole: waiting to fill packets only delays them.
                let _ = stream.set_nodelay(true);
                return (stream, place);
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

/// A stream whose writes fail when the other side takes nothing for too long.
struct StallGuard {
    stream: TcpStream,
    patience: Duration,
    /// Runs while a write waits.
    alarm: Option<Pin<Box<Sleep>>>,
}

impl StallGuard {
    fn new(stream: TcpStream, patience: Duration) -> Self {
        Self { stream, patience, alarm: None }
    }

    /// Passes progress on and turns a wait that is too long into an error.
    fn watch<T>(&mut self, progress: Poll<io::Result<T>>, context: &mut Context<'_>) -> Poll<io::Result<T>> {
        if progress.is_ready() {
            self.alarm = None;
            return progress;
        }
        let until = Instant::now() + self.patience;
        let alarm = self.alarm.get_or_insert_with(|| Box::pin(tokio::time::sleep_until(until)));
        match alarm.as_mut().poll(context) {
            Poll::Ready(()) => Poll::Ready(Err(io::ErrorKind::TimedOut.into())),
            Poll::Pending => Poll::Pending,
        }
    }
}

impl AsyncRead for StallGuard {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(cx, buffer)
    }
}

impl AsyncWrite for StallGuard {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let progress = Pin::new(&mut self.stream).poll_write(cx, bytes);
        self.watch(progress, cx)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        parts: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let progress = Pin::new(&mut self.stream).poll_write_vectored(cx, parts);
        self.watch(progress, cx)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        let progress = Pin::new(&mut self.stream).poll_flush(cx);
        self.watch(progress, cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        let progress = Pin::new(&mut self.stream).poll_shutdown(cx);
        self.watch(progress, cx)
    }
}
