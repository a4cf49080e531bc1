//! A WebSocket to a server, from nothing to its `welcome`.

use std::time::{Duration, Instant};

use futures_util::{SinkExt, StreamExt};
use serde_json::Value;
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::client::ClientRequestBuilder;
use tokio_tungstenite::tungstenite::http::StatusCode;
use tokio_tungstenite::tungstenite::http::Uri;
use tokio_tungstenite::tungstenite::http::uri::InvalidUri;
use tokio_tungstenite::tungstenite::protocol::{CloseFrame, WebSocketConfig};
use tokio_tungstenite::tungstenite::{Error, Message};
use tokio_tungstenite::{WebSocketStream, client_async_with_config};

use super::access::{Access, Stream};
use super::address::ServerAddress;
use super::error::{AnswerError, ClientError, ConnectError, EncryptionError, LossError, ServerText};
use relief_live::{
    ClientMessage, HEADER_BYTES, Hello, MAX_PIXELS, MAX_TEXT_BYTES, PingLimit, SUBPROTOCOL, ServerMessage,
    Welcome, check_view_name,
};

/// Most bytes of a message that is received: colours and 16-bit depth of the largest picture,
/// unpacked.
pub const MAX_FRAME_BYTES: usize = HEADER_BYTES + 5 * MAX_PIXELS;

/// Most bytes that wait to be sent: texts and pongs.
const SOCKET_BUFFER: usize = 4 << 20;
/// Longest time until a reachable server accepts.
const CONNECT: Duration = Duration::from_secs(3);
/// The longest time until `welcome`: the first volume may still be on its way to the graphics
/// card.
const WELCOME: Duration = Duration::from_secs(30);

pub(super) type Socket = WebSocketStream<Stream>;

/// Connects and says hello; gives the socket after `welcome`. `first` is the hello that the session
/// began with: by its names a proxy finds the server of several that has the session.
pub(super) async fn open(
    server: &ServerAddress,
    access: &Access,
    first: &Hello,
    hello: &Hello,
) -> Result<(Socket, Box<Welcome>), ClientError> {
    let stream = secured(server, access).await?;
    let mut socket = upgrade(server, access, first, stream).await?;
    let lost = |source| ClientError::Lost { server: server.clone(), source };
    let text = ClientMessage::Hello(Box::new(hello.clone())).to_text();
    socket.send(Message::text(text)).await.map_err(|error| lost(LossError::Protocol(error.into())))?;
    let answered = timeout(WELCOME, welcome(server, &mut socket)).await;
    let welcome = answered.map_err(|_| lost(LossError::NoWelcome(WELCOME)))??;
    Ok((socket, welcome))
}

/// A connection to the server, encrypted if the server is.
pub(super) async fn secured(server: &ServerAddress, access: &Access) -> Result<Stream, ClientError> {
    let stream = reach(server).await?;
    let secured = timeout(CONNECT, access.secured(server, stream)).await;
    let insecure = |source| ClientError::Insecure { server: server.clone(), source };
    let secured = secured.map_err(|_| insecure(EncryptionError::NoAnswer))?;
    secured.map_err(|error| insecure(error.into()))
}

async fn reach(server: &ServerAddress) -> Result<TcpStream, ClientError> {
    let unreachable = |source| ClientError::Unreachable { server: server.clone(), source };
    let stream = timeout(CONNECT, TcpStream::connect(server.target())).await;
    let stream = stream.map_err(|_| unreachable(ConnectError::NoAnswer(CONNECT)))?;
    let stream = stream.map_err(|error| unreachable(error.into()))?;
    // A pose is small and due at once.
    stream.set_nodelay(true).map_err(|error| unreachable(error.into()))?;
    Ok(stream)
}

async fn upgrade(
    server: &ServerAddress,
    access: &Access,
    first: &Hello,
    stream: Stream,
) -> Result<Socket, ClientError> {
    let not_relief = |source| ClientError::NotRelief { server: server.clone(), source };
    let uri: Uri = server.session_url(first).parse().map_err(|error: InvalidUri| not_relief(error.into()))?;
    let mut request = ClientRequestBuilder::new(uri).with_sub_protocol(SUBPROTOCOL);
    if let Some(authorization) = access.authorization() {
        request = request.with_header("Authorization", authorization);
    }
    let config = WebSocketConfig::default()
        .max_message_size(Some(MAX_FRAME_BYTES))
        .max_frame_size(Some(MAX_FRAME_BYTES))
        .max_write_buffer_size(SOCKET_BUFFER);
    let handshake = timeout(CONNECT, client_async_with_config(request, stream, Some(config))).await;
    let handshake = handshake.map_err(|_| not_relief(AnswerError::NoHandshake))?;
    match handshake {
        Ok((socket, _)) => Ok(socket),
        Err(Error::Http(response)) => {
            let body = response.body().as_deref().map(String::from_utf8_lossy).unwrap_or_default();
            Err(answered(server, response.status(), &body))
        }
        Err(Error::Io(error)) => Err(ClientError::Lost { server: server.clone(), source: error.into() }),
        Err(error) => Err(not_relief(AnswerError::Protocol(error.into()))),
    }
}

/// The error of an answer without a WebSocket.
fn answered(server: &ServerAddress, status: StatusCode, body: &str) -> ClientError {
    let server = server.clone();
    // Relief's refusals are problem documents (RFC 9457).
    let detail = serde_json::from_str::<Value>(body).ok().map(|problem| detail(&problem));
    let words = || detail.unwrap_or_else(|| ServerText::new(&status.to_string()));
    match status {
        StatusCode::SERVICE_UNAVAILABLE | StatusCode::TOO_MANY_REQUESTS => {
            ClientError::Refused { server, reason: words(), passing: true, no_volume: false }
        }
        StatusCode::UNAUTHORIZED => ClientError::Unauthorized { server },
        StatusCode::FORBIDDEN | StatusCode::MISDIRECTED_REQUEST => {
            ClientError::Refused { server, reason: words(), passing: false, no_volume: false }
        }
        _ => ClientError::NotRelief { server, source: AnswerError::Status(status) },
    }
}

async fn welcome(server: &ServerAddress, socket: &mut Socket) -> Result<Box<Welcome>, ClientError> {
    let lost = |source| ClientError::Lost { server: server.clone(), source };
    let not_relief = |source| ClientError::NotRelief { server: server.clone(), source };
    let (mut said, mut pings) = (None, PingLimit::new(Instant::now()));
    loop {
        let message = match socket.next().await {
            Some(Ok(message)) => message,
            Some(Err(error)) => return Err(lost(LossError::Protocol(error.into()))),
            None => return Err(lost(LossError::ClosedEarly)),
        };
        match message {
            Message::Text(text) if text.len() > MAX_TEXT_BYTES => {
                return Err(not_relief(AnswerError::LongText(text.len())));
            }
            Message::Text(text) => match ServerMessage::parse(&text) {
                Ok(ServerMessage::Welcome(welcome)) => {
                    // The name is printed and becomes part of addresses.
                    let checked = check_view_name(&welcome.view).map(|()| welcome);
                    return checked.map_err(|error| not_relief(AnswerError::Message(error)));
                }
                Ok(ServerMessage::Error(error)) => said = Some(error.problem),
                Ok(_) => {}
                Err(error) => return Err(not_relief(AnswerError::Message(error))),
            },
            Message::Binary(_) => return Err(not_relief(AnswerError::EarlyFrame)),
            Message::Close(frame) => return Err(closed(server, frame.as_ref(), said.as_ref())),
            Message::Ping(_) if !pings.accepts(Instant::now()) => return Err(lost(LossError::Pings)),
            _ => {}
        }
    }
}

/// The detail of a problem document.
pub(super) fn detail(problem: &Value) -> ServerText {
    let word = |key: &str| problem.get(key).and_then(Value::as_str);
    ServerText::new(word("detail").or_else(|| word("title")).unwrap_or("without a reason"))
}

/// The error of a closed connection; `said` is the last problem that the server reported.
pub(super) fn closed(
    server: &ServerAddress,
    frame: Option<&CloseFrame>,
    said: Option<&Value>,
) -> ClientError {
    let server = server.clone();
    let Some(frame) = frame else {
        let source = said.map_or(LossError::Closed, |said| LossError::Reported(detail(said)));
        return ClientError::Lost { server, source };
    };
    let reason = said.map_or_else(|| ServerText::new(&frame.reason), detail);
    match u16::from(frame.code) {
        1001 => ClientError::Lost { server, source: LossError::Stopping(reason) },
        1008 => {
            // A temporary refusal: a volume is being loaded, or all sessions are taken.
            let status = said.and_then(|problem| problem.get("status")).and_then(Value::as_u64);
            let passing = matches!(status, Some(404 | 429 | 503));
            let kind = said.and_then(|problem| problem.get("type")).and_then(Value::as_str);
            let no_volume = status == Some(404) && kind.is_some_and(|kind| kind.ends_with("no-such-volume"));
            ClientError::Refused { server, reason, passing, no_volume }
        }
        4001 => ClientError::Resumed { server },
        4002 => ClientError::Removed { server, reason },
        code => ClientError::Lost { server, source: LossError::Code { code, reason } },
    }
}
