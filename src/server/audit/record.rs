//! One record, and its line.

use serde::{Deserialize, Serialize};

use relief_annotation::Timestamp;
use relief_base::sha256_of;

/// The predecessor of the first record.
pub(super) const FIRST: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// A request, or an event of the log itself.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Record {
    /// The hash of the record before this one.
    pub(super) previous: String,
    pub(super) time: Timestamp,
    /// The line before this record is incomplete, because the server crashed.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(super) torn: bool,
    /// The record before this one is in another file, because the log was moved, emptied or removed.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(super) continues: bool,
    /// Number of refused requests since the record before that have no record.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) refused: Option<u64>,
    /// Number of requests since the record before whose records did not fit into the queue.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) lost: Option<u64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) who: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) from: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) method: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) route: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) volume: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) status: Option<u16>,
}

impl Record {
    /// A record of this time, with nothing else.
    pub(super) fn now() -> Self {
        Self {
            previous: String::new(),
            time: Timestamp::now(),
            torn: false,
            continues: false,
            refused: None,
            lost: None,
            who: None,
            from: None,
            method: None,
            route: None,
            volume: None,
            status: None,
        }
    }

    /// The line of this record. `head` is the hash of the record before and becomes the hash of this one.
    pub(super) fn line_after(self, head: &mut String) -> serde_json::Result<String> {
        let body = serde_json::to_string(&Self { previous: head.clone(), ..self })?;
        *head = sha256_of(body.as_bytes());
        Ok(format!("{head} {body}\n"))
    }
}

/// The hash and the record of a line without its line break; `None` if the hash is wrong.
pub(super) fn parse(line: &[u8]) -> Option<(String, Record)> {
    let text = std::str::from_utf8(line).ok()?;
    let (hash, body) = text.split_once(' ')?;
    let record = serde_json::from_str(body).ok()?;
    (sha256_of(body.as_bytes()) == hash).then(|| (hash.to_owned(), record))
}
