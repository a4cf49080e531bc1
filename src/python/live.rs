//! A live session of one volume inside of the process of Python, for the widget in Jupyter.
//!
//! What it is: the server of `relief serve` with one volume, and the client's end of one WebSocket
//! of `relief.v1`. They are connected in memory: there is no port that others could reach. What it
//! is not: the messages, which `relief/_viewer.py` writes and reads (see `docs/LIVE.md`).

use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use futures_util::{SinkExt, StreamExt};
use hyper_util::rt::TokioIo;
use hyper_util::service::TowerToHyperService;
use parking_lot::Mutex;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyString};
use tokio::io::DuplexStream;
use tokio::runtime::Runtime;
use tokio::sync::mpsc;
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::http::HeaderValue;
use tokio_tungstenite::tungstenite::{self, Message};

use crate::error::raised;
use crate::volume::Volume;
use relief_live::SUBPROTOCOL;
use relief_render::{AdapterChoice, Renderer};
use relief_server::{Config, Server};
use relief_session::{GpuBackend, LoadedVolume, QueueConfig, RenderService};

/// Bytes between both ends of the connection.
const PIPE_BYTES: usize = 1 << 20;
/// Messages that wait for the server, and for Python. A session whose messages Python does not take
/// ends.
const WAITING: usize = 256;
/// The longest time of the end of a session.
const FAREWELL: Duration = Duration::from_secs(2);

/// The session of a viewer. It ends with the value.
#[pyclass(frozen, module = "relief._native")]
pub(crate) struct LiveSession {
    /// Messages that wait for Python: the server sends two frames at most before it waits for an
    /// `ack`.
    received: Mutex<Receiver<Message>>,
    outgoing: mpsc::Sender<Message>,
    /// `None` after the end.
    runtime: Mutex<Option<Runtime>>,
    service: Arc<RenderService>,
}

#[pymethods]
impl LiveSession {
    /// A session of this volume, rendered by this adapter. The first message is `hello`.
    #[new]
    fn new(py: Python<'_>, volume: &Volume, adapter: String) -> PyResult<Self> {
        let loaded = LoadedVolume {
            volume: volume.clone_volume(),
            warnings: Vec::new(),
            identity: None,
            reference: None,
            labels: None,
        };
        py.detach(move || Self::open(loaded, adapter))
    }

    /// Sends a message of the client.
    fn send(&self, py: Python<'_>, text: String) -> PyResult<()> {
        py.detach(|| self.outgoing.blocking_send(Message::Text(text.into()))).map_err(|_| raised(&Ended))
    }

    /// The next message: text, or the bytes of a frame. `None` when none arrived within this time,
    /// s; an error after the end of the session.
    fn receive<'py>(&self, py: Python<'py>, timeout_s: f64) -> PyResult<Option<Bound<'py, PyAny>>> {
        let timeout = Duration::try_from_secs_f64(timeout_s).map_err(|error| raised(&error))?;
        let message = py.detach(|| self.next(timeout))?;
        Ok(match message {
            None => None,
            Some(Message::Text(text)) => Some(PyString::new(py, &text).into_any()),
            Some(message) => Some(PyBytes::new(py, &message.into_data()).into_any()),
        })
    }

    /// Ends the session and stops rendering.
    fn close(&self, py: Python<'_>) {
        py.detach(|| self.end());
    }
}

impl LiveSession {
    fn open(loaded: LoadedVolume, adapter: String) -> PyResult<Self> {
        let choice = AdapterChoice::parse(&adapter);
        let backend = GpuBackend::open(Box::new(move || Renderer::open(&choice)));
        let backend = backend.map_err(|error| raised(&error))?;
        let service =
            RenderService::start(backend, QueueConfig::default()).map_err(|error| raised(&error))?;
        let service = Arc::new(service);
        let config = Config { uploads: None, memory_bytes: u64::MAX, ..Config::default() };
        let no_uploads = Arc::new(|_: &std::path::Path, _: &relief_base::Budget| Err("no uploads".into()));
        let server = Arc::new(Server::new(Arc::clone(&service), no_uploads, config));
        server.add_volume(loaded);
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
        let (outgoing, messages) = mpsc::channel(WAITING);
        let (inbox, received) = sync_channel(WAITING);
        let socket = runtime.block_on(connect(server)).map_err(|error| raised(&error))?;
        runtime.spawn(relay(socket, messages, inbox));
        Ok(Self { received: Mutex::new(received), outgoing, runtime: Mutex::new(Some(runtime)), service })
    }

    fn next(&self, timeout: Duration) -> PyResult<Option<Message>> {
        let received = self.received.lock();
        match received.recv_timeout(timeout) {
            Ok(message) => Ok(Some(message)),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(raised(&Ended)),
        }
    }

    fn end(&self) {
        let runtime = self.runtime.lock().take();
        if let Some(runtime) = runtime {
            runtime.shutdown_timeout(FAREWELL);
            self.service.shut_down();
        }
    }
}

impl Drop for LiveSession {
    fn drop(&mut self) {
        self.end();
    }
}

/// A message after the end of a session.
#[derive(Debug)]
struct Ended;

impl std::fmt::Display for Ended {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("the live session has ended")
    }
}

impl std::error::Error for Ended {}

/// The client's end of a WebSocket to this server, which is served in the background.
async fn connect(server: Arc<Server>) -> Result<WebSocketStream<DuplexStream>, tungstenite::Error> {
    let (ours, theirs) = tokio::io::duplex(PIPE_BYTES);
    let service = TowerToHyperService::new(relief_server::app(server));
    let serving = hyper::server::conn::http1::Builder::new()
        .serve_connection(TokioIo::new(theirs), service)
        .with_upgrades();
    tokio::spawn(serving);
    let mut request = "ws://localhost/v1/session".into_client_request()?;
    request.headers_mut().insert("sec-websocket-protocol", HeaderValue::from_static(SUBPROTOCOL));
    let (socket, _) = tokio_tungstenite::client_async(request, ours).await?;
    Ok(socket)
}

/// Passes messages in both directions until one side ends. Reading also answers pings.
async fn relay(
    mut socket: WebSocketStream<DuplexStream>,
    mut outgoing: mpsc::Receiver<Message>,
    inbox: SyncSender<Message>,
) {
    loop {
        tokio::select! {
            message = outgoing.recv() => match message {
                Some(message) => if socket.send(message).await.is_err() { return },
                None => return,
            },
            message = socket.next() => match message {
                Some(Ok(message @ (Message::Text(_) | Message::Binary(_)))) => {
                    if inbox.try_send(message).is_err() { return }
                }
                Some(Ok(_)) => {}
                Some(Err(_)) | None => return,
            },
        }
    }
}
