//! The messages of a session: JSON objects with a `type`, one per text message.
//!
//! [`ClientMessage::parse`] reads a client's messages; an unknown key or a wrong type is an error
//! with its path. [`ServerMessage::parse`] does the same for a server's messages. Lengths are in
//! mm, angles in degrees, times in ns of the sender's own clock.

mod error;
mod eyes;
mod hello;
mod pose;
mod server;
mod settings;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::interaction::Intent;

pub use error::{MessageError, MessageFault};
pub use eyes::Eyes;
pub use hello::{Accept, ColorFormats, Formats, Hello, NoFormat, Role, check_view_name};
pub use pose::{IntentMessage, OrbitPose, Pose, PoseKind, RawReport, RemotePose};
pub use server::{
    AnnotationsMessage, ErrorMessage, NextLabel, OutsideDepth, Peers, ServerMessage, SnappedPlace,
    StateMessage, TrackingMessage, Welcome,
};
pub use settings::{Play, Quality, Settings, SnapTarget, SnapTo};

/// Most bytes of a message of either side that is text.
pub const MAX_TEXT_BYTES: usize = 64 << 10;

/// A message of a client.
#[derive(Clone, Debug, PartialEq)]
pub enum ClientMessage {
    /// The first message of a connection.
    Hello(Box<Hello>),
    /// The pose of the hand, or a viewpoint. The newest counts.
    Pose(Pose),
    /// A raw report of a Wiimote, for the server to track.
    Report(RawReport),
    /// An intent; none is dropped.
    Intent(IntentMessage),
    /// Settings of the view.
    Settings(Box<Settings>),
    /// The eyes of a viewer; passed on to every client of the view.
    Eyes(Eyes),
    /// A frame was shown, or is not going to be: the next may come.
    Ack(Ack),
}

/// A frame was shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ack {
    /// Its sequence; those before it count as shown too.
    pub frame: u32,
    /// When it was shown, ns of the client's clock.
    #[serde(default)]
    pub t_ns: u64,
}

/// A JSON object, its type taken out.
fn object(text: &str) -> Result<(String, Map<String, Value>), MessageError> {
    if text.len() > MAX_TEXT_BYTES {
        return Err(MessageError::new(
            ".",
            MessageFault::TooLong { found: text.len(), most: MAX_TEXT_BYTES },
        ));
    }
    let mut message: Map<String, Value> =
        serde_json::from_str(text).map_err(|error| MessageError::new(".", error))?;
    match message.remove("type") {
        Some(Value::String(kind)) => Ok((kind, message)),
        _ => Err(MessageError::new("type", MessageFault::NoType)),
    }
}

fn read<T: DeserializeOwned>(message: Map<String, Value>) -> Result<T, MessageError> {
    expect_objects(&message)?;
    serde_path_to_error::deserialize(Value::Object(message))
        .map_err(|error| MessageError::new(&error.path().to_string(), error.into_inner()))
}

/// Refuses arrays where the messages have objects: serde would read them as an object's values in
/// order.
fn expect_objects(message: &Map<String, Value>) -> Result<(), MessageError> {
    const OBJECTS: [&str; 12] = [
        "/accept",
        "/settings",
        "/settings/display",
        "/settings/display/profile",
        "/display",
        "/display/profile",
        "/orbit",
        "/camera",
        "/camera/projection",
        "/camera/projection/perspective",
        "/camera/projection/orthographic",
        "/state",
    ];
    for path in OBJECTS {
        let mut names = path.split('/').skip(1);
        let first = names.next().and_then(|name| message.get(name));
        let found = names.try_fold(first, |value, name| value.map(|value| value.get(name)));
        if let Some(Some(Value::Array(_))) = found {
            return Err(MessageError::new(&path[1..].replace('/', "."), MessageFault::Array));
        }
    }
    Ok(())
}

fn take_number(message: &mut Map<String, Value>, key: &'static str) -> Result<u64, MessageError> {
    let value = message.remove(key).unwrap_or(Value::Null);
    value.as_u64().ok_or_else(|| MessageError::new(key, MessageFault::NotANumber(value)))
}

/// A message with its type.
fn written(kind: &str, message: &impl Serialize) -> String {
    let mut object = Map::from_iter([("type".to_owned(), Value::from(kind))]);
    if let Ok(Value::Object(rest)) = serde_json::to_value(message) {
        object.extend(rest);
    }
    Value::Object(object).to_string()
}

impl ClientMessage {
    /// The types of messages that a client sends.
    pub const TYPES: [&str; 7] = ["hello", "pose", "report", "intent", "settings", "eyes", "ack"];

    /// Reads a message.
    ///
    /// # Errors
    /// When it is no JSON object of a known type, or a key is unknown, missing or of the wrong
    /// kind.
    pub fn parse(text: &str) -> Result<Self, MessageError> {
        let (kind, mut message) = object(text)?;
        match kind.as_str() {
            "hello" => {
                let hello: Hello = read(message)?;
                hello.validate()?;
                Ok(Self::Hello(Box::new(hello)))
            }
            "pose" => Pose::of(read(message)?).map(Self::Pose),
            "report" => read(message).map(Self::Report),
            "intent" => {
                let [seq, t_ns] = [take_number(&mut message, "seq")?, take_number(&mut message, "t_ns")?];
                let json = Value::Object(message).to_string();
                let intent =
                    Intent::from_json(json.as_bytes()).map_err(|error| MessageError::new("intent", error))?;
                Ok(Self::Intent(IntentMessage { seq, t_ns, intent }))
            }
            "settings" => read(message).map(|settings| Self::Settings(Box::new(settings))),
            "eyes" => {
                let eyes: Eyes = read(message)?;
                eyes.validate().map(|()| Self::Eyes(eyes))
            }
            "ack" => read(message).map(Self::Ack),
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
            Self::Hello(hello) => written("hello", hello),
            Self::Pose(pose) => written("pose", &pose.file()),
            Self::Report(report) => written("report", report),
            Self::Intent(IntentMessage { seq, t_ns, intent }) => {
                let mut object = Map::new();
                if let Ok(Value::Object(rest)) = serde_json::to_value(intent) {
                    object.extend(rest);
                }
                object.insert("seq".to_owned(), (*seq).into());
                object.insert("t_ns".to_owned(), (*t_ns).into());
                written("intent", &object)
            }
            Self::Settings(settings) => written("settings", settings),
            Self::Eyes(eyes) => written("eyes", eyes),
            Self::Ack(ack) => written("ack", ack),
        }
    }
}
