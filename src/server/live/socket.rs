//! From the upgrade to a session and to its end: who may connect, what `hello` opens, and how one
//! says farewell.
//!
//! `connection` handles messages and frames. Reader and writer run in one task, so that a
//! connection that receives nothing is still read.

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::extract::State;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade};
use axum::http::{HeaderMap, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use futures_util::{SinkExt, StreamExt};
use tokio::sync::mpsc;
use tracing::Instrument;

use super::audience::join;
use super::connection::Connected;
use super::hub::{Place, random_name};
use super::remote::Remote;
use super::session::Session;
use super::wire::{error, expect_annotations, malformed, text};
use crate::guard::is_cross_site;
use crate::identity::Caller;
use crate::live::close::End;
use crate::live::close::GOING_AWAY;
use crate::live::close::POLICY;
use crate::problem::Problem;
use crate::state::LiveParts;
use relief_live::{ClientMessage, Formats, Hello, MAX_TEXT_BYTES, PingLimit, Role, SUBPROTOCOL, Settings};
use relief_session::{Presentation, VolumeEntry, VolumeError, find_phase};

/// Short messages that wait for the writer; more are left out.
const OUTBOX: usize = 32;
/// The longest time that the last messages may take.
const FAREWELL: Duration = Duration::from_secs(1);
/// Most messages of a client that are read after the closing message.
const MOST_PENDING: usize = 1000;
/// Most bytes that wait in the socket's own buffer: one frame of the largest picture, unpacked. [`PingLimit`] limits the pongs.
const SOCKET_BUFFER: usize = 96 << 20;

/// The protocol for programs.
pub(crate) async fn protocol() -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "application/schema+json")], relief_live::protocol())
}

/// `GET /v1/session`.
pub(crate) async fn connect(
    State(parts): State<LiveParts>,
    headers: HeaderMap,
    uri: Uri,
    caller: Caller,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Result<Response, Problem> {
    if is_cross_site(&headers, &uri) {
        let detail = "sessions of pages of another site are refused";
        return Err(Problem::new(StatusCode::FORBIDDEN, "cross-site", detail));
    }
    let upgrade = upgrade.map_err(|rejection| {
        let detail = format!("{}; see docs/LIVE.md for ways without a WebSocket", rejection.body_text());
        Problem::new(StatusCode::UPGRADE_REQUIRED, "no-websocket", detail)
    })?;
    let upgrade = upgrade.protocols([SUBPROTOCOL]);
    if upgrade.selected_protocol().is_none() {
        let detail = format!("Sec-WebSocket-Protocol does not name {SUBPROTOCOL}");
        return Err(Problem::new(StatusCode::BAD_REQUEST, "unknown-subprotocol", detail));
    }
    let place = parts.live.place(&caller)?;
    let upgrade = upgrade
        .max_message_size(2 * MAX_TEXT_BYTES)
        .max_frame_size(2 * MAX_TEXT_BYTES)
        .read_buffer_size(16 << 10)
        .write_buffer_size(0)
        .max_write_buffer_size(SOCKET_BUFFER);
    let span = tracing::info_span!("connection", number = parts.live.next_id());
    Ok(upgrade.on_upgrade(move |socket| run(parts, socket, caller, place).instrument(span)))
}

/// A whole connection.
async fn run(parts: LiveParts, mut socket: WebSocket, caller: Caller, _place: Place) {
    let metrics = Arc::clone(&parts.metrics);
    let _counted = metrics.live.connected();
    let mut closing = parts.live.closing.subscribe();
    let waited = tokio::select! {
        hello = tokio::time::timeout(parts.live.config.hello_timeout, first_message(&mut socket)) => Some(hello),
        () = async { drop(closing.wait_for(|closing| *closing).await) } => None,
    };
    let Some(hello) = waited else {
        return farewell(&mut socket, Some((GOING_AWAY, "the server stops"))).await;
    };
    let opened = match hello {
        Err(_) => return farewell(&mut socket, Some((POLICY, "no hello in time"))).await,
        Ok(None) => return,
        Ok(Some(Err(problem))) => Err(problem),
        Ok(Some(Ok(hello))) => open(&parts, &hello, &caller),
    };
    let (session, number, formats, resumed) = match opened {
        Ok(opened) => opened,
        Err(problem) => {
            let _ = tokio::time::timeout(FAREWELL, socket.send(text(&error(&problem, true)))).await;
            return farewell(&mut socket, Some((POLICY, "hello refused"))).await;
        }
    };
    let viewer = join(&parts, &session.view, session.role, false, &session.caller).await;
    let connected = Connected { parts: parts.clone(), session, viewer, formats, number };
    let (mut writer, mut reader) = socket.split();
    let (outbox, messages) = mpsc::channel(OUTBOX);
    let _ = outbox.try_send(connected.welcome(resumed));
    connected.say_next(&outbox).await;
    let end = tokio::select! {
        end = connected.read(&mut reader, &outbox) => end,
        end = connected.write(&mut writer, messages) => end,
        end = connected.interrupted() => end,
    };
    connected.leave();
    farewell(&mut writer, end).await;
    // Pending input is read: otherwise closing would reset the connection before the last message
    // arrives.
    let rest = async {
        for _ in 0..MOST_PENDING {
            let Some(Ok(_)) = reader.next().await else { break };
        }
    };
    let _ = tokio::time::timeout(FAREWELL, rest).await;
}

/// The first message that says something; `None` when the connection ended before.
async fn first_message(socket: &mut WebSocket) -> Option<Result<Hello, Problem>> {
    let mut pings = PingLimit::new(Instant::now());
    loop {
        match socket.recv().await?.ok()? {
            Message::Text(text) => {
                return Some(match ClientMessage::parse(&text) {
                    Ok(ClientMessage::Hello(hello)) => Ok(*hello),
                    Ok(_) => {
                        Err(Problem::new(StatusCode::BAD_REQUEST, "no-hello", "the first message is hello"))
                    }
                    Err(error) => Err(malformed(&error)),
                });
            }
            Message::Binary(_) => {
                let detail = "binary messages are the server's alone";
                return Some(Err(Problem::new(StatusCode::BAD_REQUEST, "no-hello", detail)));
            }
            Message::Close(_) => return None,
            Message::Ping(_) if !pings.accepts(Instant::now()) => return None,
            Message::Ping(_) | Message::Pong(_) => {}
        }
    }
}

/// The session of a hello, the number of its connection, the formats agreed on, and whether it was
/// resumed.
fn open(
    parts: &LiveParts,
    hello: &Hello,
    caller: &Caller,
) -> Result<(Arc<Session>, u64, Formats, bool), Problem> {
    let now = Instant::now();
    let formats = hello.accept.negotiate().map_err(|error| {
        let path = format!("accept.{}", error.what);
        Problem::new(StatusCode::NOT_ACCEPTABLE, "no-common-format", &error).with("path", path)
    })?;
    if let Some(token) = &hello.resume
        && let Some((session, connection)) = parts.live.sessions.lock().resume(token, caller, now)
    {
        session.view.touch();
        return Ok((session, connection, formats, true));
    }
    // An unknown token, for example after a restart of the server, begins a new session.
    let entry = match &hello.volume {
        Some(id) => Some(find_volume(parts, id)?),
        None => None,
    };
    let author = caller.author(hello.author.clone())?;
    let author = author.as_deref();
    expect_annotations(parts, hello.settings.as_ref())?;
    let mut settings = hello.settings.clone().unwrap_or_default();
    settings.size_px = settings.size_px.or(hello.size_px);
    let known = hello.view.as_ref().and_then(|name| parts.live.views.find(name));
    let entry = match settings.phase {
        Some(number) => {
            let volumes = &parts.engine.volumes;
            let of = entry.or_else(|| known.as_ref().map(|view| view.entry()));
            Some(find_phase(volumes, &of.map_or_else(|| volumes.first(), Ok)?, number)?)
        }
        None => entry,
    };
    let view = if let Some(view) = known {
        if hello.role == Role::Presenter && (settings != Settings::default() || entry.is_some()) {
            view.configure(&settings, entry.as_ref(), author, now)?;
        }
        view
    } else {
        let entry = entry.map_or_else(|| parts.engine.volumes.first(), Ok)?;
        let presentation = Presentation::new(entry, &settings, author)?;
        let name = hello.view.clone().map_or_else(random_name, Ok)?;
        parts.find_or_open(&name, presentation, caller)?
    };
    let mut remote = Remote::new()?;
    if let Some(grab_mode) = settings.grab_mode {
        remote.set_grab_mode(grab_mode)?;
    }
    let session =
        Session::new(random_name()?, view, hello.role, author.map(str::to_owned), caller.clone(), remote);
    parts.live.sessions.lock().add(&session, now);
    Ok((session, 1, formats, false))
}

/// The volume with this id. While series are being loaded, an unknown id may be one of them: the client
/// tries again.
fn find_volume(parts: &LiveParts, id: &str) -> Result<Arc<VolumeEntry>, Problem> {
    let found = parts.engine.volumes.find(id);
    let (_, loading) = parts.engine.volumes.count();
    match found {
        Err(VolumeError::UnknownId) if loading > 0 => {
            let detail = format!("no volume has this id yet; {loading} series are being loaded");
            Err(Problem::unavailable("loading", detail).with("loading", loading))
        }
        found => Ok(found?),
    }
}

/// Says why, and closes.
async fn farewell(socket: &mut (impl futures_util::Sink<Message> + Unpin), end: End) {
    let Some((code, reason)) = end else { return };
    let close = Message::Close(Some(CloseFrame { code, reason: reason.into() }));
    let _ = tokio::time::timeout(FAREWELL, socket.send(close)).await;
}
