//! A session that outlives its connections.
//!
//! [`run`] connects, sends `hello`, passes frames and messages to a callback, sends the messages of
//! the [`Handle`], and reconnects after a loss with the token of its session. A restarted server
//! does not know the token; it creates a view of the same name with the last volume and preset, and
//! intents then restore its state.

use std::time::{Duration, Instant};

use bytes::Bytes;
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt, StreamExt};
use parking_lot::Mutex;
use serde_json::Value;
use tokio::time::{MissedTickBehavior, timeout};
use tokio_tungstenite::tungstenite::protocol::CloseFrame;
use tokio_tungstenite::tungstenite::protocol::frame::coding::CloseCode;
use tokio_tungstenite::tungstenite::{Error, Message};

use super::access::Access;
use super::address::ServerAddress;
use super::backoff::Backoff;
use super::error::{ClientError, LossError, ServerText};
use super::handle::Handle;
use super::restore;
use super::socket::{self, Socket};
use relief_live::{
    ClientMessage, FrameHeader, Hello, Parts, PingLimit, Role, ServerMessage, Settings, ViewRecord, Welcome,
};

/// Interval of the client's pings. A server answers each at once.
const PING: Duration = Duration::from_millis(1500);
/// After a silence this long the picture may be out of date: [`LinkState::Silent`].
const SILENT: Duration = Duration::from_secs(4);
/// A longer silence means that the connection is lost.
const SILENCE: Duration = Duration::from_secs(25);
/// A connection that lived for so long was a good one.
const GOOD: Duration = Duration::from_secs(2);
/// The longest time of a goodbye.
const GOODBYE: Duration = Duration::from_millis(500);
/// Number of invalid messages after which the connection is closed.
const MAX_UNREADABLE: u32 = 20;

/// The session.
#[derive(Clone, Debug)]
pub struct Options {
    /// The server.
    pub server: ServerAddress,
    /// Certificates: the own ones for the server, and those accepted from it.
    pub access: Access,
    /// The hello of the session.
    pub hello: Hello,
    /// Whether to wait for a server or a volume that is not there yet, and for one that was removed.
    pub wait: bool,
}

/// The events of a session, in their order.
#[derive(Clone, Debug)]
pub enum Event {
    /// The connection came or went.
    State(LinkState),
    /// This was sent.
    Sent(ClientMessage),
    /// The server said something.
    Message(Box<ServerMessage>),
    /// A frame came. It has to be acknowledged by [`Handle::ack`].
    Frame(Received),
    /// A text message that is not part of the protocol.
    Unreadable(String),
}

/// The connection of a session.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LinkState {
    /// On its way.
    Connecting,
    /// There.
    Connected {
        /// The number of the connection, from 1: each numbers its frames anew.
        connection: u64,
        /// Whether the server went on with a session that was interrupted.
        resumed: bool,
        /// Name of the view.
        view: String,
    },
    /// Nothing was received for 4 s, not even an answer to a ping; the connection may still work.
    Silent,
    /// The server was heard again after [`LinkState::Silent`].
    Heard,
    /// Not there.
    Lost {
        /// Why.
        reason: String,
        /// When it is tried again.
        retry: Duration,
    },
}

/// A frame as it came, its header read.
#[derive(Clone, Debug)]
pub struct Received {
    /// The connection that it came by.
    pub connection: u64,
    /// When it was whole, ns of the client's clock.
    pub at_ns: u64,
    /// The messages before the first frame.
    pub header: FrameHeader,
    /// All of it.
    pub bytes: Bytes,
}

/// The state of a session beyond its connection.
#[derive(Default)]
struct SessionState {
    token: Option<String>,
    view: Option<String>,
    volume: Option<String>,
    preset: Option<String>,
    state: Option<ViewRecord>,
}

/// Runs a session until [`Handle::stop`]. `on` receives events on the thread of the connection and
/// must return quickly.
///
/// # Errors
/// When the first connection fails, unless that is waited for; or when a connection ends for a
/// reason that another one would not change.
pub async fn run(
    options: &Options,
    handle: &Handle,
    on: &(dyn Fn(Event) + Send + Sync),
) -> Result<(), ClientError> {
    let known = Mutex::new(SessionState::default());
    let mut backoff = Backoff::new();
    let mut was_connected = false;
    loop {
        on(Event::State(LinkState::Connecting));
        let session = Session { options, handle, on, known: &known };
        let begun = Instant::now();
        let attempt = session.attempt(&mut was_connected).await;
        handle.outbox().close();
        let Err(error) = attempt else { return Ok(()) };
        let is_removed = matches!(error, ClientError::Removed { .. }) && options.wait;
        if !is_removed && !(error.is_passing(was_connected) && (was_connected || options.wait)) {
            return Err(error);
        }
        if error.has_no_volume() && options.hello.volume.is_none() {
            // The next attempt takes the server's first volume, from its beginning.
            *known.lock() = SessionState::default();
        }
        if begun.elapsed() > GOOD {
            backoff.reset();
        }
        let retry = backoff.next();
        on(Event::State(LinkState::Lost { reason: error.to_string(), retry }));
        tokio::select! {
            () = tokio::time::sleep(retry) => {}
            () = handle.stopped() => return Ok(()),
        }
    }
}

struct Session<'a> {
    options: &'a Options,
    handle: &'a Handle,
    on: &'a (dyn Fn(Event) + Send + Sync),
    known: &'a Mutex<SessionState>,
}

impl Session<'_> {
    /// One connection, from its beginning to its end.
    async fn attempt(&self, was_connected: &mut bool) -> Result<(), ClientError> {
        let hello = self.hello();
        let (socket, welcome) = tokio::select! {
            opened = socket::open(&self.options.server, &self.options.access, &self.options.hello, &hello) => opened?,
            () = self.handle.stopped() => return Ok(()),
        };
        *was_connected = true;
        let connection = self.handle.put(super::outbox::Outbox::open);
        self.begin(connection, welcome);
        self.pump(socket, connection).await
    }

    fn known<T>(&self, take: impl FnOnce(&mut SessionState) -> T) -> T {
        take(&mut self.known.lock())
    }

    /// The `hello` message: the token, and the settings for a server that does not know it.
    fn hello(&self) -> Hello {
        let hello = self.options.hello.clone();
        self.known(|known| {
            let mut settings = hello.settings.clone();
            if let Some(preset) = &known.preset {
                settings.get_or_insert_with(Settings::default).preset = Some(preset.clone());
            }
            let view = known.view.clone().or(hello.view);
            let volume = known.volume.clone().or(hello.volume);
            Hello { view, volume, settings, resume: known.token.clone(), ..hello }
        })
    }

    /// The messages after `welcome`.
    fn begin(&self, connection: u64, welcome: Box<Welcome>) {
        // A view that another client has changed is left as it is.
        let is_new = !welcome.resumed && welcome.state.undo == 0;
        let before = self.known(|known| {
            let volume = welcome.volume.get("id").and_then(Value::as_str).map(str::to_owned);
            known.token = Some(welcome.session.clone());
            known.view = Some(welcome.view.clone());
            known.volume = volume.or(known.volume.take());
            known.preset = welcome.state.preset.clone().or(known.preset.take());
            known.state.replace(welcome.state.clone()).filter(|_| is_new && welcome.role == Role::Presenter)
        });
        let look_at_mm = welcome.state.look_at_mm;
        let (resumed, view) = (welcome.resumed, welcome.view.clone());
        (self.on)(Event::State(LinkState::Connected { connection, resumed, view }));
        (self.on)(Event::Message(Box::new(ServerMessage::Welcome(welcome))));
        let t_ns = self.handle.now_ns();
        self.handle.put(|outbox| {
            for intent in before.iter().flat_map(|before| restore::intents(look_at_mm, before)) {
                outbox.intent(t_ns, intent);
            }
            outbox.repeat_remote(t_ns);
        });
    }

    /// Sends and receives concurrently; closes the connection when stopped.
    async fn pump(&self, socket: Socket, connection: u64) -> Result<(), ClientError> {
        let (mut sink, stream) = socket.split();
        let ended = tokio::select! {
            error = self.send_all(&mut sink) => Err(self.lost(LossError::Protocol(error.into()))),
            error = self.receive_all(stream, connection) => Err(error),
            () = self.handle.stopped() => Ok(()),
        };
        if ended.is_ok() {
            let goodbye = CloseFrame { code: CloseCode::Normal, reason: "done".into() };
            // Without a close frame the server would keep the session for a minute.
            let _ = timeout(GOODBYE, sink.send(Message::Close(Some(goodbye)))).await;
        }
        ended
    }

    /// Receives messages until the connection ends.
    async fn receive_all(&self, mut stream: SplitStream<Socket>, connection: u64) -> ClientError {
        let (mut unreadable, mut said) = (0, None);
        let mut pings = PingLimit::new(Instant::now());
        loop {
            let message = match self.next_message(&mut stream).await {
                Ok(message) => message,
                Err(error) => return error,
            };
            match message {
                Message::Binary(bytes) => {
                    if let Err(error) = self.frame(connection, bytes) {
                        return error;
                    }
                }
                Message::Text(text) => match ServerMessage::parse(&text) {
                    Ok(message) => self.message(message, &mut said),
                    Err(error) => {
                        unreadable += 1;
                        if unreadable > MAX_UNREADABLE {
                            return self.lost(LossError::Unreadable(unreadable));
                        }
                        (self.on)(Event::Unreadable(ServerText::new(&error.to_string()).to_string()));
                    }
                },
                Message::Close(frame) => return self.closed(frame.as_ref(), said.as_ref()),
                Message::Ping(_) if !pings.accepts(Instant::now()) => return self.lost(LossError::Pings),
                _ => {}
            }
        }
    }

    /// The next message of the server; reports a silence that begins or ends.
    async fn next_message(&self, stream: &mut SplitStream<Socket>) -> Result<Message, ClientError> {
        let heard = match timeout(SILENT, stream.next()).await {
            Ok(heard) => heard,
            Err(_) => {
                (self.on)(Event::State(LinkState::Silent));
                let heard = timeout(SILENCE - SILENT, stream.next()).await;
                let heard = heard.map_err(|_| self.lost(LossError::Silent(SILENCE)))?;
                if matches!(heard, Some(Ok(_))) {
                    (self.on)(Event::State(LinkState::Heard));
                }
                heard
            }
        };
        match heard {
            None => Err(self.lost(LossError::Closed)),
            Some(Err(error)) => Err(self.lost(LossError::Protocol(error.into()))),
            Some(Ok(message)) => Ok(message),
        }
    }

    /// Sends all messages, and pings, until that fails.
    async fn send_all(&self, sink: &mut SplitSink<Socket, Message>) -> Error {
        let mut ping = tokio::time::interval(PING);
        ping.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            let sent = tokio::select! {
                message = self.handle.next() => {
                    let text = message.to_text();
                    (self.on)(Event::Sent(message));
                    sink.send(Message::text(text)).await
                }
                _ = ping.tick() => sink.send(Message::Ping(Bytes::new())).await,
            };
            if let Err(error) = sent {
                return error;
            }
        }
    }

    fn frame(&self, connection: u64, bytes: Bytes) -> Result<(), ClientError> {
        let at_ns = self.handle.now_ns();
        // Without its number a frame cannot be acknowledged: the connection cannot be used.
        let header = Parts::of(&bytes).map_err(|error| self.lost(error.into()))?.header;
        (self.on)(Event::Frame(Received { connection, at_ns, header, bytes }));
        Ok(())
    }

    fn message(&self, message: ServerMessage, said: &mut Option<Value>) {
        match &message {
            ServerMessage::State(state) => self.known(|known| {
                known.volume = Some(state.volume.clone());
                known.preset.clone_from(&state.state.preset);
                known.state = Some(state.state.clone());
            }),
            ServerMessage::Error(error) => *said = Some(error.problem.clone()),
            _ => {}
        }
        (self.on)(Event::Message(Box::new(message)));
    }

    fn closed(&self, frame: Option<&CloseFrame>, said: Option<&Value>) -> ClientError {
        match socket::closed(&self.options.server, frame, said) {
            // Too many errors, after a welcome: a new connection resets the count.
            ClientError::Refused { reason, .. } => self.lost(LossError::Reported(reason)),
            other => other,
        }
    }

    fn lost(&self, source: LossError) -> ClientError {
        ClientError::Lost { server: self.options.server.clone(), source }
    }
}
