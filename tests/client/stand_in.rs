//! A server that speaks `relief.v1` under the control of a test. It renders nothing: its pictures
//! are known in advance.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use futures_util::StreamExt;
use relief_client::{Event, Handle, Options, Received, run};
use relief_display::{DisplaySettings, Layout};
use relief_live::{
    ClientMessage, ColorFormat, DepthFormat, EncodedColor, EncodedDepth, FrameHeader, Hello, LiveLayout,
    PoseKind, SUBPROTOCOL, assemble, encode_color, encode_d8,
};
use serde_json::json;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::handshake::server::{Request, Response};
use tokio_tungstenite::tungstenite::protocol::CloseFrame;
use tokio_tungstenite::{WebSocketStream, accept_hdr_async};

/// Beyond what any event here may take on a busy machine.
pub(crate) const PATIENCE: Duration = Duration::from_secs(120);

pub(crate) type Socket = WebSocketStream<TcpStream>;

/// A listener on a free port, or on one that was free before.
pub(crate) async fn listen(at: Option<SocketAddr>) -> (TcpListener, SocketAddr) {
    let at = at.unwrap_or_else(|| "127.0.0.1:0".parse().unwrap());
    let socket = tokio::net::TcpSocket::new_v4().unwrap();
    socket.set_reuseaddr(true).unwrap();
    socket.bind(at).unwrap();
    let listener = socket.listen(128).unwrap();
    let address = listener.local_addr().unwrap();
    (listener, address)
}

/// Takes a connection up to its hello.
pub(crate) async fn accept(listener: &TcpListener) -> (Socket, Hello) {
    let (stream, _) =
        tokio::time::timeout(PATIENCE, listener.accept()).await.expect("a client in time").unwrap();
    stream.set_nodelay(true).unwrap();
    let mut socket = accept_hdr_async(stream, echo_protocol).await.unwrap();
    match next(&mut socket).await {
        Some(ClientMessage::Hello(hello)) => (socket, *hello),
        other => panic!("no hello but {other:?}"),
    }
}

#[expect(clippy::result_large_err, clippy::unnecessary_wraps, reason = "the signature is given")]
fn echo_protocol(
    request: &Request,
    mut response: Response,
) -> Result<Response, tokio_tungstenite::tungstenite::handshake::server::ErrorResponse> {
    let asked = request.headers().get("sec-websocket-protocol").unwrap();
    assert_eq!(asked, SUBPROTOCOL);
    assert_eq!(request.uri().path(), "/v1/session");
    response.headers_mut().insert("sec-websocket-protocol", asked.clone());
    Ok(response)
}

/// The next message of the client; `None` when it is gone.
pub(crate) async fn next(socket: &mut Socket) -> Option<ClientMessage> {
    loop {
        match tokio::time::timeout(PATIENCE, socket.next()).await.expect("a message in time")? {
            Ok(Message::Text(text)) => return Some(ClientMessage::parse(&text).unwrap()),
            Ok(Message::Binary(_)) => panic!("clients send text alone"),
            Ok(Message::Close(_)) | Err(_) => return None,
            Ok(_) => {}
        }
    }
}

pub(crate) fn welcome(token: &str, resumed: bool) -> Message {
    let state = json!({
        "look_at_mm": [0.0, 0.0, 0.0], "orientation_xyzw": [0.0, 0.0, 0.0, 1.0], "zoom": 1.0, "vertical_fov_deg": 22.0,
        "preset": "bone", "clip_mm": null, "cursor_mm": null, "grabbed": false, "placing": false, "undo": 0, "revision": 0,
    });
    let welcome = json!({
        "type": "welcome", "session": token, "view": "desk", "volume": { "id": "0123456789abcdef", "name": "secret" },
        "role": "presenter", "color": { "moving": "jpeg", "still": "rgb-zstd" }, "depth": "d8-zstd", "state": state,
        "resumed": resumed,
    });
    Message::text(welcome.to_string())
}

/// Width and height of its pictures: just wide enough for a header.
pub(crate) const SIZE: [usize; 2] = [516, 8];

/// Colours and D of picture `number`.
pub(crate) fn picture(number: u32) -> (Vec<[u8; 4]>, Vec<u8>) {
    let count = SIZE[0] * SIZE[1];
    let at = |i: usize| (i as u32).wrapping_mul(2_654_435_761).wrapping_add(number.wrapping_mul(40_503));
    let color = (0..count).map(|i| [(at(i) >> 8) as u8, (at(i) >> 16) as u8, (at(i) >> 24) as u8, 255]);
    (color.collect(), (0..count).map(|i| (i as u32 + number) as u8).collect())
}

/// A frame header for [`picture`]s.
pub(crate) fn header(sequence: u32) -> FrameHeader {
    let size_px = SIZE.map(|side| side as u16);
    FrameHeader {
        still: true,
        back_layer: false,
        color: ColorFormat::RgbZstd,
        depth: DepthFormat::D8Zstd,
        sequence,
        shows_seq: 0,
        shows_t_ns: 0,
        total_us: 9000,
        render_us: 5000,
        wait_us: 1000,
        encode_us: 2000,
        size_px,
        full_px: size_px,
        limits_mm: [100.0, 300.0],
        display: DisplaySettings::default().header().fields(),
        layout: LiveLayout::Of(Layout::Wowvx),
        color_bytes: 0,
        depth_bytes: 0,
        eye_mm: [0.0, -900.0, 40.0],
        look_at_mm: [0.0, 0.0, 40.0],
        up: [0.0, 0.0, 1.0],
        projection: [22.0, 0.0],
    }
}

/// The bytes of a frame with [`picture`] `sequence`.
pub(crate) fn frame(header: &FrameHeader) -> Vec<u8> {
    let (color, disparity) = picture(header.sequence);
    let color =
        EncodedColor { format: header.color, bytes: encode_color(SIZE, &color, header.color, 80).unwrap() };
    let depth =
        EncodedDepth { format: header.depth, bytes: encode_d8(SIZE, &disparity, header.depth).unwrap() };
    assemble(header, &color, &depth)
}

pub(crate) async fn close(socket: &mut Socket, code: u16, reason: &'static str) {
    let frame = CloseFrame { code: code.into(), reason: reason.into() };
    let _ = socket.close(Some(frame)).await;
}

pub(crate) fn options(address: SocketAddr) -> Options {
    let (access, hello) = (relief_client::Access::default(), Hello::default());
    Options { server: format!("http://{address}").parse().unwrap(), access, hello, wait: false }
}

pub(crate) fn orbit(azimuth_deg: f64) -> PoseKind {
    PoseKind::Orbit(relief_live::OrbitPose { azimuth_deg, elevation_deg: 0.0, zoom: None })
}

/// A client under test: its events, and its outcome.
pub(crate) struct Running {
    pub(crate) handle: Handle,
    pub(crate) events: mpsc::Receiver<Event>,
    ended: tokio::task::JoinHandle<Result<(), relief_client::ClientError>>,
}

impl Running {
    pub(crate) fn start(options: Options) -> Self {
        let handle = Handle::new();
        let (sender, events) = mpsc::channel(10_000);
        let own = handle.clone();
        let sender = Arc::new(Mutex::new(sender));
        let ended = tokio::spawn(async move {
            let on = move |event| sender.lock().unwrap().try_send(event).expect("a test takes its events");
            run(&options, &own, &on).await
        });
        Self { handle, events, ended }
    }

    /// The next event that `pick` takes.
    pub(crate) async fn until<T>(&mut self, mut pick: impl FnMut(&Event) -> Option<T>) -> T {
        let look = async {
            loop {
                let event = self.events.recv().await.expect("the session goes on");
                if let Some(found) = pick(&event) {
                    return found;
                }
            }
        };
        tokio::time::timeout(PATIENCE, look).await.expect("an event in time")
    }

    pub(crate) async fn frame(&mut self) -> Received {
        let received = self.until(|event| match event {
            Event::Frame(received) => Some(received.clone()),
            _ => None,
        });
        received.await
    }

    pub(crate) async fn ended(self) -> Result<(), relief_client::ClientError> {
        tokio::time::timeout(PATIENCE, self.ended).await.expect("an end in time").unwrap()
    }
}
