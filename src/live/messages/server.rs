//! Text messages of the server.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::error::{MessageError, MessageFault};
use super::hello::{ColorFormats, Role};
use super::{Eyes, object, read, written};
use crate::format::DepthFormat;
use crate::interaction::ViewRecord;
use relief_tracking::TrackingState;

/// A text message of the server.
#[derive(Clone, Debug, PartialEq)]
pub enum ServerMessage {
    /// The answer to `hello`.
    Welcome(Box<Welcome>),
    /// The view changed; sent to every client of the view.
    State(StateMessage),
    /// Something was refused or failed.
    Error(ErrorMessage),
    /// The state of the server's own tracking.
    Tracking(TrackingMessage),
    /// The number of viewers of the view.
    Peers(Peers),
    /// The eyes of a viewer, as a client of the view sent them.
    Eyes(Eyes),
    /// Annotations of the volume, or the label of the next `place`, changed.
    Annotations(AnnotationsMessage),
}

/// A change to the annotations of the volume that is shown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AnnotationsMessage {
    /// The last event of the log. It counts those of other volumes too: numbers that are left out
    /// are not lost.
    pub seq: u64,
    /// Events, as `GET /v1/volumes/{id}/annotations/log` has them.
    pub events: Vec<Value>,
    /// Whether there were more than a message holds, and none is here: the list is to be fetched
    /// again.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub more: bool,
    /// The label that the next `place` of this session uses.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub next: Option<NextLabel>,
}

/// The label of a `place`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NextLabel {
    /// The set that it is in.
    pub set: String,
    /// Its name.
    pub name: String,
    /// The missing item that gets the place; null for a new point.
    pub id: Option<String>,
}

impl AnnotationsMessage {
    /// The same within the longest message: without its events where they are too many.
    #[must_use]
    pub fn bounded(self) -> Self {
        let length: usize = self.events.iter().map(|event| event.to_string().len() + 1).sum();
        if length + 256 <= super::MAX_TEXT_BYTES {
            return self;
        }
        Self { events: Vec::new(), more: true, ..self }
    }
}

/// The answer to `hello`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Welcome {
    /// Token of this session, to resume it. A secret of this client.
    pub session: String,
    /// Name of the view.
    pub view: String,
    /// The volume, as `GET /v1/volumes/{id}` describes it.
    pub volume: Value,
    /// The role.
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
    /// Phases per second while the phases of the volume's series play.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub phases_per_s: Option<f64>,
    /// The position where snapping would place the landmark.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub snapped: Option<SnappedPlace>,
    /// Named points of the picture outside of the depth that the display shows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outside: Option<OutsideDepth>,
}

/// Named points, such as landmarks, outside of the depth that a display shows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutsideDepth {
    /// Their number.
    pub count: usize,
    /// The name of the one that is farthest outside.
    pub label: String,
    /// Its distance behind the depth, whole mm; negative in front of it.
    pub behind_mm: f64,
}

/// The place at which something would be set down, patient mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SnappedPlace {
    /// The place.
    pub at_mm: [f64; 3],
    /// From where it was pointed at to the place.
    pub shift_mm: [f64; 3],
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

/// The state of the server's own tracking.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrackingMessage {
    /// The tracking state.
    pub state: TrackingState,
    /// The number of matched LEDs.
    pub leds: usize,
    /// Root mean square of their errors, px.
    pub rms_px: Option<f64>,
}

/// The viewers of a view, by role.
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
    pub const TYPES: [&str; 7] = ["welcome", "state", "error", "tracking", "peers", "eyes", "annotations"];

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
            "eyes" => read(message).map(Self::Eyes),
            "annotations" => read(message).map(Self::Annotations),
            _ => {
                let found = kind.chars().take(40).collect();
                Err(MessageError::new("type", MessageFault::UnknownType { found, allowed: &Self::TYPES }))
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
            Self::Eyes(eyes) => written("eyes", eyes),
            Self::Annotations(annotations) => written("annotations", annotations),
        }
    }
}
