//! Why there is no session.

use std::error::Error;
use std::fmt;
use std::time::Duration;

use relief_live::{FrameError, MessageError};
use tokio_tungstenite::tungstenite::http::StatusCode;
use tokio_tungstenite::tungstenite::http::uri::InvalidUri;

use super::address::ServerAddress;

/// Why a session could not start, or has ended.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// Nothing listens at the address, or the network does not reach it.
    #[error(
        "cannot reach {server}: {source}; is `relief serve` running there, and may this machine connect to it?"
    )]
    Unreachable {
        /// The server.
        server: ServerAddress,
        /// Why.
        source: ConnectError,
    },
    /// The server's certificate is not trusted, or the connection cannot be encrypted.
    #[error("the connection to {server} cannot be encrypted: {source}; name its authority by --ca FILE.pem")]
    Insecure {
        /// The server.
        server: ServerAddress,
        /// Why.
        source: EncryptionError,
    },
    /// Something answers that is no Relief server, or an older one.
    #[error("{server} does not answer as a Relief server with live sessions: {source}")]
    NotRelief {
        /// The server.
        server: ServerAddress,
        /// The unexpected answer.
        source: AnswerError,
    },
    /// The server asks for a token, or does not accept the given one.
    #[error(
        "{server} refused the session: it asks who you are: give a token of `relief token add` by --token or RELIEF_TOKEN"
    )]
    Unauthorized {
        /// The server.
        server: ServerAddress,
    },
    /// The server understood the request and refused it.
    #[error("{server} refused the session: {reason}")]
    Refused {
        /// The server.
        server: ServerAddress,
        /// Its words.
        reason: ServerText,
        /// Whether the same request may be accepted later.
        passing: bool,
        /// Whether the server has no volume of the requested id.
        no_volume: bool,
    },
    /// The volume of the session was removed from the server.
    #[error("the session at {server} has ended: the volume was removed{}", reason.after_colon())]
    Removed {
        /// The server.
        server: ServerAddress,
        /// Its words; may be empty.
        reason: ServerText,
    },
    /// Another connection continues the session; connecting again would take it back.
    #[error("the session at {server} has ended: another connection has resumed this session")]
    Resumed {
        /// The server.
        server: ServerAddress,
    },
    /// The connection ended.
    #[error("the connection to {server} was lost: {source}")]
    Lost {
        /// The server.
        server: ServerAddress,
        /// How.
        source: LossError,
    },
}

impl ClientError {
    /// Whether another attempt may succeed without a change of this client. A session that existed
    /// may come back whatever the reason: a restarted server loads its volumes first.
    #[must_use]
    pub const fn is_passing(&self, was_connected: bool) -> bool {
        match self {
            Self::Unreachable { .. } | Self::Lost { .. } => true,
            Self::Refused { passing, .. } => *passing || was_connected,
            Self::Unauthorized { .. } | Self::NotRelief { .. } | Self::Insecure { .. } => was_connected,
            Self::Resumed { .. } | Self::Removed { .. } => false,
        }
    }

    /// Whether the volume of the session does not exist on the server, or no longer.
    pub(super) const fn has_no_volume(&self) -> bool {
        matches!(self, Self::Removed { .. } | Self::Refused { no_volume: true, .. })
    }
}

/// Why no connection to a server was made.
#[derive(Debug, thiserror::Error)]
pub enum ConnectError {
    /// The network does not answer.
    #[error("no answer within {} s", .0.as_secs())]
    NoAnswer(Duration),
    /// The error of the system.
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

/// Why a connection could not be encrypted.
#[derive(Debug, thiserror::Error)]
pub enum EncryptionError {
    /// The other side does not speak TLS.
    #[error("no answer to the TLS handshake")]
    NoAnswer,
    /// The error of TLS.
    #[error(transparent)]
    Tls(#[from] std::io::Error),
}

/// An answer that no Relief server gives.
#[derive(Debug, thiserror::Error)]
pub enum AnswerError {
    /// The address is no URI.
    #[error("its address is invalid: {0}")]
    Address(#[from] InvalidUri),
    /// No answer in time.
    #[error("no answer to the WebSocket handshake")]
    NoHandshake,
    /// An answer without a WebSocket.
    #[error("HTTP {0} at /v1/session")]
    Status(StatusCode),
    /// Bytes that are not HTTP or no WebSocket. It is no source: it may quote the server.
    #[error("{}", ServerText::new(&.0.to_string()))]
    Protocol(BoxedError),
    /// A text message that is too long.
    #[error("a text message of {0} bytes")]
    LongText(usize),
    /// A text message that the protocol does not have. It is no source: it may quote the server.
    #[error("{}", ServerText::new(&.0.to_string()))]
    Message(MessageError),
    /// A frame before the session has begun.
    #[error("a frame before welcome")]
    EarlyFrame,
}

/// How a connection was lost.
#[derive(Debug, thiserror::Error)]
pub enum LossError {
    /// The error of the system.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// An error of HTTP or of the WebSocket. It is no source: it may quote the server.
    #[error("{}", ServerText::new(&.0.to_string()))]
    Protocol(BoxedError),
    /// The server accepted the connection and did not begin the session.
    #[error("no welcome within {} s", .0.as_secs())]
    NoWelcome(Duration),
    /// The server sent no picture.
    #[error("no frame within {} s", .0.as_secs())]
    NoFrame(Duration),
    /// The server did not answer a request.
    #[error("no answer within {} s", .0.as_secs())]
    NoAnswer(Duration),
    /// The server does not answer a ping.
    #[error("silent for {} s", .0.as_secs())]
    Silent(Duration),
    /// Closed without `welcome`.
    #[error("closed before welcome")]
    ClosedEarly,
    /// Closed without a reason.
    #[error("closed without a reason")]
    Closed,
    /// Closed after an error that the server reported.
    #[error("{0}")]
    Reported(ServerText),
    /// The server stops.
    #[error("the server stops{}", .0.after_colon())]
    Stopping(ServerText),
    /// Closed with another code of the WebSocket.
    #[error("closed with code {code}{}", reason.after_colon())]
    Code {
        /// The code.
        code: u16,
        /// The server's words; may be empty.
        reason: ServerText,
    },
    /// The server sends pings without end.
    #[error("the server sends too many pings")]
    Pings,
    /// More messages than are tolerated could not be read.
    #[error("{0} unreadable messages")]
    Unreadable(u32),
    /// A frame without a valid header cannot be acknowledged.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// The task of a measured client failed.
    #[error(transparent)]
    Task(#[from] tokio::task::JoinError),
}

/// The error of a library.
pub type BoxedError = Box<dyn Error + Send + Sync>;

/// A server's words: at most 400 characters, without control characters, which a terminal would
/// execute.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ServerText(String);

impl ServerText {
    pub(super) fn new(text: &str) -> Self {
        Self(text.chars().filter(|c| !c.is_control()).take(400).collect())
    }

    /// The words with ": " before them; empty if the server sent no words.
    fn after_colon(&self) -> String {
        if self.0.is_empty() { String::new() } else { format!(": {}", self.0) }
    }
}

impl fmt::Display for ServerText {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A terminal would execute control characters.
    #[test]
    fn no_cause_has_control_characters_of_a_server() {
        let server = "http://127.0.0.1:1".parse::<ServerAddress>().unwrap();
        let quoted = || "unknown field `\u{1b}[2J`".to_owned();
        let message = relief_live::ServerMessage::parse("{\"type\":\"state\",\"\\u001b[2J\":1}").unwrap_err();
        assert!(message.to_string().contains('\u{1b}'), "the message quotes the key: {message:?}");
        for error in [
            ClientError::NotRelief { server: server.clone(), source: AnswerError::Message(message) },
            ClientError::NotRelief { server: server.clone(), source: AnswerError::Protocol(quoted().into()) },
            ClientError::Lost { server, source: LossError::Protocol(quoted().into()) },
        ] {
            let causes =
                std::iter::successors(Some(&error as &(dyn Error + 'static)), |cause| Error::source(*cause));
            for cause in causes {
                assert!(!cause.to_string().contains(char::is_control), "{cause:?}");
            }
        }
    }
}
