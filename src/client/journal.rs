//! Recordings of sessions as JSON lines: sent and received messages, times, and hashes of frames.
//!
//! ```text
//! {"relief_session":1,"hello":{...}}
//! {"t_ns":81000000,"state":"connected"}
//! {"t_ns":90000000,"sent":{"type":"pose","seq":1,...}}
//! {"t_ns":95000000,"received":{"type":"state",...}}
//! {"t_ns":99000000,"frame":{"sequence":1,"shows_seq":1,"size_px":[960,540],"full_px":[960,540],"still":true,"lossless":true,
//!   "bytes":410233,"sha256":"...","pixels_sha256":"..."}}
//! ```
//!
//! `sha256` is the hash of colour and depth as they were sent. It excludes the header, because its
//! times differ between runs. Still lossless frames also have `pixels_sha256`, the hash of the
//! unpacked pixels: two equal sessions have equal ones. The journal has no session token, and no
//! name or description of a volume. Lines are bounded, so a file of any size is read in little
//! memory.

use std::io::{BufRead, Read};

use data_encoding::HEXLOWER;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use super::link::{Event, LinkState, Received};
use relief_live::{
    ClientMessage, HEADER_BYTES, Hello, MAX_TEXT_BYTES, MessageError, ReceivedDepth, ReceivedFrame,
    ServerMessage,
};

/// The version of such files.
pub const VERSION: u64 = 1;
/// A longer line does not belong to a recording.
pub const MAX_LINE_BYTES: usize = 2 * MAX_TEXT_BYTES;

/// A file that is no session.
#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    /// The file cannot be read.
    #[error("line {line}: {source}")]
    Read {
        /// Line, from 1.
        line: usize,
        /// The error of the system.
        source: std::io::Error,
    },
    /// The line is invalid.
    #[error("line {line}: {source}")]
    Line {
        /// Line, from 1.
        line: usize,
        /// Why it is invalid.
        source: LineError,
    },
}

/// Why a line of a recording is invalid.
#[derive(Debug, thiserror::Error)]
pub enum LineError {
    /// The file has no line.
    #[error("the file is empty, expected {{\"relief_session\":1,...}}")]
    Empty,
    /// The first line is another one.
    #[error("no session of this version, expected {{\"relief_session\":1,...}}")]
    Version,
    /// The line is no JSON.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    /// The hello is invalid.
    #[error("hello.{0}")]
    Hello(#[source] MessageError),
    /// The hello is of another type.
    #[error("hello is another message")]
    OtherMessage,
    /// The line has more bytes than are read.
    #[error("longer than {MAX_LINE_BYTES} bytes")]
    TooLong,
    /// A sent message has no time.
    #[error("t_ns is missing or no whole number")]
    NoTime,
    /// A sent message is invalid.
    #[error("sent.{0}")]
    Sent(#[source] MessageError),
}

/// The first line of a file.
#[must_use]
pub fn journal_head(hello: &Hello) -> String {
    let hello = Hello { resume: None, ..hello.clone() };
    json!({ "relief_session": VERSION, "hello": object(&ClientMessage::Hello(Box::new(hello)).to_text()) })
        .to_string()
}

/// The line of an event; `None` for events that are not recorded.
#[must_use]
pub fn journal_line(t_ns: u64, event: &Event) -> Option<String> {
    let line = match event {
        Event::State(LinkState::Connecting | LinkState::Silent | LinkState::Heard) | Event::Unreadable(_) => {
            return None;
        }
        Event::State(LinkState::Connected { .. }) => json!({ "t_ns": t_ns, "state": "connected" }),
        Event::State(LinkState::Lost { .. }) => json!({ "t_ns": t_ns, "state": "lost" }),
        Event::Sent(ClientMessage::Ack(_) | ClientMessage::Hello(_)) => return None,
        Event::Sent(message) => json!({ "t_ns": t_ns, "sent": object(&message.to_text()) }),
        Event::Message(message) => json!({ "t_ns": t_ns, "received": without_secrets(message) }),
        Event::Frame(received) => json!({ "t_ns": received.at_ns, "frame": frame(received) }),
    };
    Some(line.to_string())
}

fn object(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or(Value::Null)
}

fn without_secrets(message: &ServerMessage) -> Value {
    let mut value = object(&message.to_text());
    if let Value::Object(fields) = &mut value {
        fields.remove("session");
        if let Some(Value::Object(volume)) = fields.get_mut("volume") {
            volume.retain(|key, _| key == "id");
        }
    }
    value
}

fn frame(received: &Received) -> Value {
    let header = &received.header;
    let mut frame = json!({
        "sequence": header.sequence,
        "shows_seq": header.shows_seq,
        "size_px": header.size_px,
        "full_px": header.full_px,
        "still": header.still,
        "lossless": header.lossless(),
        "bytes": received.bytes.len(),
        "sha256": HEXLOWER.encode(&Sha256::digest(received.bytes.get(HEADER_BYTES..).unwrap_or_default())),
    });
    if let Some(pixels) = pixels_sha256(received) {
        frame["pixels_sha256"] = pixels.into();
    }
    frame
}

/// SHA-256 of the colours and depths of a still lossless frame, as numbers: equal pictures have
/// equal ones however they are packed.
#[must_use]
pub fn pixels_sha256(received: &Received) -> Option<String> {
    if !(received.header.still && received.header.lossless()) {
        return None;
    }
    let picture = ReceivedFrame::decode(&received.bytes).ok()?;
    let hash = Sha256::new().chain_update(picture.color.as_flattened());
    let hash = match &picture.depth {
        ReceivedDepth::None => hash,
        ReceivedDepth::Disparity(disparity) => hash.chain_update(disparity),
        ReceivedDepth::Scaled16(scaled) => {
            scaled.iter().fold(hash, |hash, z| hash.chain_update(z.to_le_bytes()))
        }
    };
    Some(HEXLOWER.encode(&hash.finalize()))
}

/// The content of a line, as far as a replay needs it.
#[derive(Clone, Debug, PartialEq)]
pub enum JournalEntry {
    /// This was sent at that time, ns.
    Sent(u64, ClientMessage),
    /// A still lossless frame came, with this hash of its pixels.
    Still(String),
    /// Something else.
    Other,
}

/// Reads a session line by line.
#[derive(Debug)]
pub struct Journal<R> {
    source: R,
    line: usize,
    hello: Hello,
}

impl<R: BufRead> Journal<R> {
    /// Reads the first line.
    ///
    /// # Errors
    /// When the file is no session.
    pub fn open(source: R) -> Result<Self, JournalError> {
        let mut journal = Self { source, line: 0, hello: Hello::default() };
        let Some(first) = journal.next_line()? else {
            return Err(journal.wrong(LineError::Empty));
        };
        let value: Value = serde_json::from_str(&first).map_err(|error| journal.wrong(error.into()))?;
        if value.get("relief_session").and_then(Value::as_u64) != Some(VERSION) {
            return Err(journal.wrong(LineError::Version));
        }
        let hello = value.get("hello").map(Value::to_string).unwrap_or_default();
        match ClientMessage::parse(&hello).map_err(|error| journal.wrong(LineError::Hello(error)))? {
            ClientMessage::Hello(hello) => journal.hello = *hello,
            _ => return Err(journal.wrong(LineError::OtherMessage)),
        }
        Ok(journal)
    }

    /// How the session was begun.
    pub fn hello(&self) -> &Hello {
        &self.hello
    }

    fn wrong(&self, source: LineError) -> JournalError {
        JournalError::Line { line: self.line, source }
    }

    /// The next line that is not blank; `None` at the end.
    fn next_line(&mut self) -> Result<Option<String>, JournalError> {
        loop {
            self.line += 1;
            let mut text = String::new();
            let mut bounded = self.source.by_ref().take(MAX_LINE_BYTES as u64 + 1);
            let read = bounded.read_line(&mut text);
            let count = read.map_err(|source| JournalError::Read { line: self.line, source })?;
            if count > MAX_LINE_BYTES {
                return Err(self.wrong(LineError::TooLong));
            }
            if count == 0 {
                return Ok(None);
            }
            if !text.trim().is_empty() {
                return Ok(Some(text));
            }
        }
    }

    fn entry(&self, text: &str) -> Result<JournalEntry, JournalError> {
        let value: Value = serde_json::from_str(text).map_err(|error| self.wrong(error.into()))?;
        if let Some(sent) = value.get("sent") {
            let t_ns = value.get("t_ns").and_then(Value::as_u64);
            let t_ns = t_ns.ok_or_else(|| self.wrong(LineError::NoTime))?;
            let message = ClientMessage::parse(&sent.to_string());
            return Ok(JournalEntry::Sent(
                t_ns,
                message.map_err(|error| self.wrong(LineError::Sent(error)))?,
            ));
        }
        let hash = value.get("frame").and_then(|frame| frame.get("pixels_sha256")).and_then(Value::as_str);
        Ok(hash.map_or(JournalEntry::Other, |hash| JournalEntry::Still(hash.chars().take(64).collect())))
    }
}

impl<R: BufRead> Iterator for Journal<R> {
    type Item = Result<JournalEntry, JournalError>;

    fn next(&mut self) -> Option<Self::Item> {
        match self.next_line() {
            Ok(Some(text)) => Some(self.entry(&text)),
            Ok(None) => None,
            Err(error) => Some(Err(error)),
        }
    }
}
