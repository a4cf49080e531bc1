//! Messages of a WebSocket that both the opening of a session and its connection send, and the
//! codes that close it.

use axum::extract::ws::{Message, WebSocket};
use axum::http::StatusCode;
use futures_util::stream::SplitSink;

use crate::annotation_service;
use crate::problem::Problem;
use crate::state::LiveParts;
use relief_live::{ErrorMessage, ServerMessage, Settings};

pub(super) const UNSUPPORTED: u16 = 1003;
pub(super) const TOO_LARGE: u16 = 1009;

pub(super) type Writer = SplitSink<WebSocket, Message>;

pub(super) fn malformed(error: &relief_live::MessageError) -> Problem {
    Problem::new(StatusCode::BAD_REQUEST, "malformed-message", error).with("path", error.path.as_str())
}

/// Refuses settings that draw annotations on a server without any.
pub(super) fn expect_annotations(parts: &LiveParts, settings: Option<&Settings>) -> Result<(), Problem> {
    let shown = settings.and_then(|settings| settings.annotations.as_ref());
    match shown.filter(|shown| !shown.is_nothing()) {
        Some(_) => annotation_service::of(parts.annotations.as_ref()).map(drop),
        None => Ok(()),
    }
}

/// A problem as a message; what caused it goes to the log.
pub(super) fn error(problem: &Problem, fatal: bool) -> String {
    if let Some(cause) = problem.cause() {
        tracing::error!(cause, "a live session failed");
    }
    ServerMessage::Error(ErrorMessage { problem: problem.document(), fatal }).to_text()
}

pub(super) fn text(message: &str) -> Message {
    Message::Text(message.into())
}
