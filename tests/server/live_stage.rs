//! The stage of tests of live sessions: a server on a real socket, and a client that speaks
//! `relief.v1` by hand.

use std::net::SocketAddr;
use std::time::Duration;

use futures_util::{SinkExt, StreamExt};
use relief_live::{Parts, ReceivedFrame, SUBPROTOCOL};
use relief_server::{Config, ConnectionLimits, LiveConfig, Shutdown, serve};
use relief_session::QueueConfig;
use serde_json::{Value, json};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::sync::oneshot;
use tokio::task::JoinHandle;
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::http::Response;
use tokio_tungstenite::tungstenite::{Error, Message};

use crate::server::stage::Stage;

/// Beyond what any event here may take on a busy machine.
pub(crate) const PATIENCE: Duration = Duration::from_secs(120);

/// A server that listens.
pub(crate) struct Running {
    pub(crate) stage: Stage,
    pub(crate) address: SocketAddr,
    stop: Option<oneshot::Sender<()>>,
    ended: Option<JoinHandle<Shutdown>>,
}

impl Running {
    pub(crate) async fn new() -> Self {
        Self::with(LiveConfig::default()).await
    }

    pub(crate) async fn with(live: LiveConfig) -> Self {
        Self::of(Config { live, ..Config::default() }).await
    }

    pub(crate) async fn of(config: Config) -> Self {
        Self::on(Stage::with(config, QueueConfig::default())).await
    }

    /// A server with annotations.
    pub(crate) async fn annotated() -> Self {
        Self::on(Stage::annotated().await).await
    }

    pub(crate) async fn annotated_with(config: Config) -> Self {
        Self::on(Stage::annotated_with(config).await).await
    }

    /// A server with annotations of a volume in which there is the sphere that is shown.
    pub(crate) async fn annotated_sphere() -> Self {
        Self::on(Stage::annotated_sphere().await).await
    }

    pub(crate) async fn annotated_fine_sphere() -> Self {
        Self::on(Stage::annotated_fine_sphere().await).await
    }

    /// One of several servers of a log.
    pub(crate) async fn following(place: &str) -> Self {
        Self::on(Stage::following(place).await).await
    }

    async fn on(stage: Stage) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let (stop, stopped) = oneshot::channel::<()>();
        let (app, server) = (stage.app.clone(), stage.server.clone());
        let ended = tokio::spawn(async move {
            serve(listener, None, app, ConnectionLimits::default(), async move {
                let _ = stopped.await;
                server.close_sessions(PATIENCE).await;
            })
            .await
        });
        Self { stage, address, stop: Some(stop), ended: Some(ended) }
    }

    pub(crate) fn stop(&mut self) {
        self.stop.take().unwrap().send(()).unwrap();
    }

    pub(crate) async fn ended(&mut self) -> Shutdown {
        tokio::time::timeout(PATIENCE, self.ended.take().unwrap()).await.unwrap().unwrap()
    }

    /// Upgrades with these headers beside the usual ones.
    pub(crate) async fn connect(&self, headers: &[(&str, &str)]) -> Result<Client, Box<Error>> {
        let stream = TcpStream::connect(self.address).await.unwrap();
        self.upgrade(stream, headers).await
    }

    /// A client that takes little before it is read from.
    pub(crate) async fn connect_narrow(&self) -> Client {
        let socket = TcpSocket::new_v4().unwrap();
        socket.set_recv_buffer_size(4096).unwrap();
        let stream = socket.connect(self.address).await.unwrap();
        self.upgrade(stream, &[("sec-websocket-protocol", SUBPROTOCOL)]).await.unwrap()
    }

    async fn upgrade(&self, stream: TcpStream, headers: &[(&str, &str)]) -> Result<Client, Box<Error>> {
        let mut request = format!("ws://{}/v1/session", self.address).into_client_request().unwrap();
        for (name, value) in headers {
            let name: tokio_tungstenite::tungstenite::http::HeaderName = name.parse().unwrap();
            request.headers_mut().insert(name, value.parse().unwrap());
        }
        let (socket, _): (_, Response<_>) = tokio_tungstenite::client_async(request, stream).await?;
        Ok(Client { socket })
    }

    /// A session: the client and its welcome message.
    pub(crate) async fn hello(&self, hello: Value) -> (Client, Value) {
        self.hello_as(&[], hello).await
    }

    /// A session of the caller whom these headers name.
    pub(crate) async fn hello_as(&self, headers: &[(&str, &str)], mut hello: Value) -> (Client, Value) {
        hello["type"] = "hello".into();
        let headers = [&[("sec-websocket-protocol", SUBPROTOCOL)], headers].concat();
        let mut client = self.connect(&headers).await.unwrap();
        client.send(&hello).await;
        let welcome = client.event("welcome").await;
        (client, welcome)
    }

    /// The number of a line of the metrics.
    pub(crate) async fn metric(&self, name: &str) -> f64 {
        let text = self.stage.get("/metrics").await;
        let line = text.text().lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
        line.unwrap_or_else(|| panic!("no {name}")).parse().unwrap()
    }
}

/// A client of a session.
pub(crate) struct Client {
    socket: WebSocketStream<TcpStream>,
}

/// A received message.
#[derive(Debug)]
pub(crate) enum Came {
    Text(Value),
    Frame(Vec<u8>),
    Closed(Option<u16>),
}

impl Client {
    pub(crate) async fn send(&mut self, message: &Value) {
        self.socket.send(Message::Text(message.to_string().into())).await.unwrap();
    }

    pub(crate) async fn send_raw(&mut self, message: Message) {
        let _ = self.socket.send(message).await; // the other side may have closed
    }

    pub(crate) async fn next(&mut self) -> Came {
        loop {
            let next = tokio::time::timeout(PATIENCE, self.socket.next()).await.expect("something in time");
            match next {
                Some(Ok(Message::Text(text))) => return Came::Text(serde_json::from_str(&text).unwrap()),
                Some(Ok(Message::Binary(frame))) => return Came::Frame(frame.to_vec()),
                Some(Ok(Message::Close(close))) => {
                    return Came::Closed(close.map(|close| close.code.into()));
                }
                Some(Ok(_)) => {}
                Some(Err(_)) | None => return Came::Closed(None),
            }
        }
    }

    /// The next message of this type; frames on the way are acknowledged.
    pub(crate) async fn event(&mut self, kind: &str) -> Value {
        loop {
            match self.next().await {
                Came::Text(message) if message["type"] == kind => return message,
                Came::Text(_) => {}
                Came::Frame(frame) => self.ack(&frame).await,
                Came::Closed(code) => panic!("closed with {code:?} before {kind}"),
            }
        }
    }

    /// The next frame, not acknowledged.
    pub(crate) async fn frame(&mut self) -> Vec<u8> {
        loop {
            match self.next().await {
                Came::Frame(frame) => return frame,
                Came::Text(message) => assert_ne!(message["type"], "error", "{message}"),
                Came::Closed(code) => panic!("closed with {code:?} before a frame"),
            }
        }
    }

    /// Whether nothing but text comes for so long.
    pub(crate) async fn gets_no_frame_for(&mut self, wait: Duration) -> bool {
        let frame = async {
            loop {
                if let Some(Ok(Message::Binary(_))) = self.socket.next().await {
                    return;
                }
            }
        };
        tokio::time::timeout(wait, frame).await.is_err()
    }

    pub(crate) async fn ack(&mut self, frame: &[u8]) {
        let sequence = Parts::of(frame).unwrap().header.sequence;
        self.send(&json!({ "type": "ack", "frame": sequence, "t_ns": 1 })).await;
    }

    /// Acknowledges frames until one of a still view comes that shows a message of this number or
    /// later.
    pub(crate) async fn still(&mut self, shows_seq: u64) -> ReceivedFrame {
        loop {
            let frame = self.frame().await;
            self.ack(&frame).await;
            let frame = ReceivedFrame::decode(&frame).unwrap();
            if frame.header.still && frame.header.shows_seq >= shows_seq {
                return frame;
            }
        }
    }

    /// The code that the connection is closed with.
    pub(crate) async fn closed(&mut self) -> Option<u16> {
        loop {
            match self.next().await {
                Came::Closed(code) => return code,
                Came::Frame(frame) => {
                    let sequence = Parts::of(&frame).unwrap().header.sequence;
                    let ack = json!({ "type": "ack", "frame": sequence }).to_string();
                    self.send_raw(Message::Text(ack.into())).await;
                }
                Came::Text(_) => {}
            }
        }
    }
}

/// An intent with its number.
pub(crate) fn intent(seq: u64, mut intent: Value) -> Value {
    intent["type"] = "intent".into();
    intent["seq"] = seq.into();
    intent["t_ns"] = (seq * 1_000_000).into();
    intent
}

/// A pose around the volume.
pub(crate) fn orbit(seq: u64, azimuth_deg: f64) -> Value {
    json!({ "type": "pose", "seq": seq, "t_ns": seq * 1000,
        "orbit": { "azimuth_deg": azimuth_deg, "elevation_deg": 0, "zoom": 1 } })
}
