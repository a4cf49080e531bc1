//! Why a message is refused.

use serde_json::Value;

use crate::interaction::IntentError;

/// A message that is refused: where, and why.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {source}")]
pub struct MessageError {
    /// Path of the key.
    pub path: String,
    /// The fault at that path.
    pub source: Box<MessageFault>,
}

/// A fault of a message.
#[derive(Debug, thiserror::Error)]
pub enum MessageFault {
    /// The text is too long.
    #[error("{found} bytes, allowed: {most}")]
    TooLong {
        /// Its bytes.
        found: usize,
        /// The limit.
        most: usize,
    },
    /// Not JSON, or an unknown or missing key, or a value of the wrong kind.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    /// The message has no type.
    #[error("missing or no text")]
    NoType,
    /// The type is unknown.
    #[error("{found:?}, allowed: {}", allowed.join(", "))]
    UnknownType {
        /// The first characters of the type.
        found: String,
        /// The types of this direction.
        allowed: &'static [&'static str],
    },
    /// serde would read an array as an object's values in their order.
    #[error("an array, expected an object")]
    Array,
    /// A number or a time is missing or of another kind.
    #[error("{0}, expected a whole number from 0 on")]
    NotANumber(Value),
    /// The intent is invalid.
    #[error(transparent)]
    Intent(#[from] IntentError),
    /// An eye is behind the screen or far away.
    #[error(
        "{found_mm:?}, allowed: up to {farthest_mm} mm each, and z from {nearest_mm} mm in front of the screen"
    )]
    Eye {
        /// Its position in the space of the screen, mm.
        found_mm: [f64; 3],
        /// Largest coordinate, mm.
        farthest_mm: f64,
        /// Smallest z, mm.
        nearest_mm: f64,
    },
    /// The client's name is too long.
    #[error("longer than {0} characters")]
    LongClient(usize),
    /// The author's name is empty, too long, or has several lines.
    #[error("{found} characters, allowed: 1 to {most} in one line")]
    Author {
        /// Its characters.
        found: usize,
        /// The limit.
        most: usize,
    },
    /// More formats than are looked at.
    #[error("{found} formats, allowed: {most}")]
    Formats {
        /// The number found.
        found: usize,
        /// The limit.
        most: usize,
    },
    /// The name of a view has other characters, none, or too many.
    #[error("no name of a view; allowed: 1 to {0} letters, digits, -, _ and .")]
    ViewName(usize),
    /// The report of a Wiimote is invalid.
    #[error("no pairs of hexadecimal digits of at most {0} bytes")]
    Report(usize),
    /// The pose of a Wiimote has no state.
    #[error("missing beside a Wiimote's pose")]
    NoState,
    /// The state and the pose of a Wiimote contradict each other.
    #[error("position_mm and orientation_xyzw are there while tracking, and only then")]
    Untracked,
    /// The message has no pose, or several kinds of it.
    #[error("one of: state with a Wiimote's pose, orbit, camera")]
    PoseKinds,
    /// A button is unknown, or is there twice.
    #[error("{found:?}, allowed, once each: {}", known.join(", "))]
    Button {
        /// The first characters of its name.
        found: String,
        /// The names of buttons.
        known: Vec<&'static str>,
    },
    /// The camera is shifted.
    #[error("not 0, which frames of a live session cannot represent")]
    LensShift,
}

impl MessageError {
    /// The fault at a path.
    pub fn new(path: &str, source: impl Into<MessageFault>) -> Self {
        Self { path: path.to_owned(), source: Box::new(source.into()) }
    }
}
