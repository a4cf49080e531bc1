//! Edits over HTTP: changes that happen together or not at all, taking back, making again.

use axum::Json;
use axum::body::Body;
use axum::http::HeaderMap;
use axum::response::Response;
use axum::routing::{self, MethodRouter};
use serde::Deserialize;
use serde_json::{Value, json};

use super::asked::{EditRequest, JsonBody, created, events_json};
use super::author;
use crate::annotation_service::{HistoryStep, invalid};
use crate::guard::{expect_content_type, read_body};
use crate::problem::{Problem, malformed, parse};
use crate::state::AppState;
use relief_annotation::{Edit, ItemId, Timestamp};

/// Largest edit: 10,000 items with all they may have but long curves.
pub(super) const MOST_BYTES: usize = 16 << 20;

pub(super) async fn post(
    asked: EditRequest,
    JsonBody(mut wanted): JsonBody<MOST_BYTES>,
) -> Result<Response, Problem> {
    let of_body = author::of_body(wanted.get("author"))?;
    let author = asked.author(of_body)?;
    wanted["author"] = author.as_str().into();
    for change in wanted.get_mut("changes").and_then(Value::as_array_mut).into_iter().flatten() {
        if let Some(item) = change.get_mut("item").filter(|item| item.is_object()) {
            fill(item, &author)?;
        }
    }
    let edit: Edit = serde_path_to_error::deserialize(wanted).map_err(|error| malformed(&error, ""))?;
    edit.validate().map_err(|error| invalid(&error))?;
    let Edit { reason, changes, .. } = edit;
    asked.edit(&author, &reason, changes).await.map(|events| created(&events))
}

/// A step of an author through the own edits.
pub(super) fn steps(step: HistoryStep) -> MethodRouter<AppState> {
    routing::post(move |asked: EditRequest, headers: HeaderMap, body: Body| take(asked, headers, body, step))
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct StepBody {
    author: Option<String>,
    reason: String,
}

async fn take(
    asked: EditRequest,
    headers: HeaderMap,
    body: Body,
    step: HistoryStep,
) -> Result<Json<Value>, Problem> {
    let body = read_body(body, 64 << 10, asked.config().body_timeout).await?;
    let StepBody { author, reason } = if body.is_empty() {
        StepBody::default()
    } else {
        expect_content_type(&headers, "application/json")?;
        parse(&body)?
    };
    let author = asked.author(author)?;
    let events = asked.annotations.step(&asked.entry, &author, &reason, step).await?;
    asked.notify_views();
    Ok(Json(json!({ "events": events_json(&events) })))
}

/// The keys that a new item may omit: author, time and id. The server overrides some of them when
/// it stores the edit.
pub(super) fn fill(item: &mut Value, author: &str) -> Result<(), Problem> {
    let Some(item) = item.as_object_mut() else { return Ok(()) };
    item.insert("author".to_owned(), author.into());
    item.insert("created".to_owned(), json!(Timestamp::now()));
    item.remove("frame_of_reference");
    if !item.contains_key("id") {
        let id = ItemId::random().map_err(|error| Problem::internal("drawing a random id", error))?;
        item.insert("id".to_owned(), json!(id));
    }
    Ok(())
}

/// As [`parse`], for a body that is in memory as a value.
pub(super) fn parse_value<T: serde::de::DeserializeOwned>(body: Value) -> Result<T, Problem> {
    serde_path_to_error::deserialize(body).map_err(|error| malformed(&error, ""))
}
