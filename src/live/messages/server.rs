//! What the server sends beside frames.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::hello::{ColorFormats, Role};
use super::{MessageError, object, read, refused, written};
use crate::interaction::ViewRecord;
use crate::live::format::DepthFormat;
use crate::tracking::tracker::TrackingState;

/// What the server sends beside frames.
#[derive(Clone, Debug, PartialEq)]
pub enum ServerMessage {
    /// The answer to `hello`.
    Welcome(Box<Welcome>),
    /// The view changed: to everybody who looks at it.
    State(StateMessage),
    /// Something was refused or failed.
    Error(ErrorMessage),
    /// What the server's own tracking knows.
    Tracking(TrackingMessage),
    /// How many look at the view.
    Peers(Peers),
}

/// The answer to `hello`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Welcome {
    /// Token of this session, to resume it; nobody else's business.
    pub session: String,
    /// Name of the view.
    pub view: String,
    /// The volume, as `GET /v1/volumes/{id}` describes it.
    pub volume: Value,
    /// What the client may do.
    pub role: Role,
    /// Formats of colour.
    pub color: ColorFormats,
    /// Format of depth.
    pub depth: DepthFormat,
    /// The view as it is.
    pub state: ViewRecord,
    /// Whether this is a session that was interrupted.
    pub resumed: bool,
}

/// A view, after a change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StateMessage {
    /// The view.
    pub state: ViewRecord,
    /// Id of its volume.
    pub volume: String,
}

/// Something was refused or failed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ErrorMessage {
    /// A problem document (RFC 9457).
    pub problem: Value,
    /// Whether the connection ends with it.
    pub fatal: bool,
}

/// What the server's own tracking knows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrackingMessage {
    /// What is known.
    pub state: TrackingState,
    /// How many LEDs were matched.
    pub leds: usize,
    /// Root mean square of their errors, px.
    pub rms_px: Option<f64>,
}

/// How many look at a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Peers {
    /// Clients that may change it.
    pub presenters: usize,
    /// Clients and plain viewers that look.
    pub watchers: usize,
}

impl ServerMessage {
    /// The types of messages that the server sends.
    pub const TYPES: [&str; 5] = ["welcome", "state", "error", "tracking", "peers"];

    /// Reads a message.
    ///
    /// # Errors
    /// As [`super::ClientMessage::parse`].
    pub fn parse(text: &str) -> Result<Self, MessageError> {
        let (kind, message) = object(text)?;
        match kind.as_str() {
            "welcome" => read(message).map(|welcome| Self::Welcome(Box::new(welcome))),
            "state" => read(message).map(Self::State),
            "error" => read(message).map(Self::Error),
            "tracking" => read(message).map(Self::Tracking),
            "peers" => read(message).map(Self::Peers),
            _ => {
                let shown: String = kind.chars().take(40).collect();
                Err(refused("type", format!("{shown:?}, allowed: {}", Self::TYPES.join(", "))))
            }
        }
    }

    /// The message as text.
    #[must_use]
    pub fn to_text(&self) -> String {
        match self {
            Self::Welcome(welcome) => written("welcome", welcome),
            Self::State(state) => written("state", state),
            Self::Error(error) => written("error", error),
            Self::Tracking(tracking) => written("tracking", tracking),
            Self::Peers(peers) => written("peers", peers),
        }
    }
}
