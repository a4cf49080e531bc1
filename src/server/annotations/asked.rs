//! Extractors of requests about annotations (volume, author, JSON body), and the edit that ends
//! them.

use std::sync::Arc;

use axum::Json;
use axum::extract::{FromRef, FromRequest, FromRequestParts, RawPathParams, Request};
use axum::http::request::Parts;
use axum::http::{HeaderMap, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};

use super::author::{self, author_of};
use crate::annotation_service::{Annotations, Home, of, outward_event};
use crate::guard::{expect_content_type, read_body, too_large};
use crate::identity::Caller;
use crate::live::Live;
use crate::problem::{Problem, parse};
use crate::state::{AppState, Config, Pictures, Uploads};
use relief_annotation::{Change, ContentId, Event};
use relief_session::VolumeEntry;

/// The volume of the path's `id`, the author of the header `Relief-Author`, and the parts of the
/// server that handlers need.
pub(super) struct EditRequest {
    pub(super) pictures: Pictures,
    pub(super) uploads: Uploads,
    live: Arc<Live>,
    pub(super) annotations: Arc<Annotations>,
    pub(super) entry: Arc<VolumeEntry>,
    pub(super) author: Option<String>,
    pub(super) caller: Caller,
}

impl FromRequestParts<AppState> for EditRequest {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &AppState) -> Result<Self, Problem> {
        let pictures = Pictures::new(state, parts);
        let annotations = Arc::clone(of(pictures.annotations.as_ref())?);
        let path = RawPathParams::from_request_parts(parts, state).await;
        let path = path.map_err(|error| {
            Problem::new(StatusCode::BAD_REQUEST, "malformed-parameter", error.body_text())
        })?;
        let id = path.iter().find(|(name, _)| *name == "id").map_or("", |(_, id)| id);
        let caller = parts.extensions.get::<Caller>().cloned().unwrap_or_default();
        let (entry, author) = (pictures.engine.volumes.find(id)?, author_of(&parts.headers)?);
        let (uploads, live) = (Uploads::from_ref(state), Arc::from_ref(state));
        Ok(Self { pictures, uploads, live, annotations, entry, author, caller })
    }
}

impl EditRequest {
    /// The same; the author may stand in the query, for those who can set no header.
    pub(super) fn or_by(self, author: Option<String>) -> Result<Self, Problem> {
        author.as_deref().map_or(Ok(()), author::check)?;
        let author = self.caller.author(author)?;
        Ok(Self { author: self.author.or(author), ..self })
    }

    /// The author of a change: the header's, or else the body's.
    pub(super) fn author(&self, of_body: Option<String>) -> Result<String, Problem> {
        of_body.as_deref().map_or(Ok(()), author::check)?;
        let of_body = self.caller.author(of_body)?;
        let author = self.author.clone().or(of_body).ok_or_else(author::missing)?;
        author::check(&author)?;
        Ok(author)
    }

    /// Wakes the live views that draw annotations.
    pub(super) fn notify_views(&self) {
        self.live.views.wake();
    }

    /// The server's configuration.
    pub(super) fn config(&self) -> &Config {
        &self.pictures.config
    }

    /// Checks that contents of this size may be added to the log.
    pub(super) async fn expect_room(&self, bytes: u64) -> Result<(), Problem> {
        let limit = self.config().content_bytes;
        if bytes == 0 || self.annotations.store.content_bytes().await?.saturating_add(bytes) <= limit {
            return Ok(());
        }
        let detail = format!(
            "regions, meshes, sets and templates in the log have reached their limit of {limit} bytes"
        );
        Err(Problem::new(StatusCode::INSUFFICIENT_STORAGE, "contents-full", detail).with("allowed", limit))
    }

    /// Keeps a region or a mesh, if the log has room for it.
    pub(super) async fn keep_content(&self, media_type: &str, bytes: &[u8]) -> Result<ContentId, Problem> {
        self.expect_room(bytes.len() as u64).await?;
        Ok(self.annotations.store.put_content(media_type, bytes).await?)
    }

    /// Makes an edit, and wakes the live views.
    pub(super) async fn edit(
        &self,
        author: &str,
        reason: &str,
        changes: Vec<Change>,
    ) -> Result<Vec<(Event, Home)>, Problem> {
        let events = self.annotations.apply(&self.entry, author, reason, changes).await?;
        self.notify_views();
        Ok(events)
    }
}

/// A request body: one JSON object of at most `MOST_BYTES` bytes.
pub(super) struct JsonBody<const MOST_BYTES: usize>(pub(super) Value);

impl<const MOST_BYTES: usize> FromRequest<AppState> for JsonBody<MOST_BYTES> {
    type Rejection = Problem;

    async fn from_request(request: Request, AppState(server): &AppState) -> Result<Self, Problem> {
        let (parts, body) = request.into_parts();
        read_json(&server.config, &parts.headers, body, MOST_BYTES).await.map(Self)
    }
}

/// A body of JSON.
pub(super) async fn read_json(
    config: &Config,
    headers: &HeaderMap,
    body: axum::body::Body,
    limit: usize,
) -> Result<Value, Problem> {
    expect_content_type(headers, "application/json")?;
    let length =
        headers.get(header::CONTENT_LENGTH).and_then(|value| value.to_str().ok()?.parse::<usize>().ok());
    if length.is_some_and(|length| length > limit) {
        return Err(too_large(limit as u64));
    }
    let body = read_body(body, limit, config.body_timeout).await?;
    let mut value: Value = parse(&body)?;
    write_whole_numbers(&mut value);
    if value.is_object() {
        return Ok(value);
    }
    Err(Problem::new(StatusCode::BAD_REQUEST, "malformed-json", "the body is no JSON object")
        .with("path", "."))
}

/// Writes numbers such as 3.0 as integers, which they are in JSON Schema.
fn write_whole_numbers(value: &mut Value) {
    match value {
        Value::Number(number) if number.is_f64() => {
            // Integers of this size have exactly one f64.
            let whole =
                number.as_f64().filter(|number| number.fract() == 0.0 && number.abs() < 2f64.powi(53));
            *value = whole.map_or_else(|| value.clone(), |number| (number as i64).into());
        }
        Value::Array(items) => items.iter_mut().for_each(write_whole_numbers),
        Value::Object(members) => members.values_mut().for_each(write_whole_numbers),
        _ => {}
    }
}

/// Events as clients get them.
pub(super) fn events_json(events: &[(Event, Home)]) -> Value {
    events.iter().map(|(event, home)| outward_event(event, &home.set)).collect()
}

/// The answer to an edit that made something.
pub(super) fn created(events: &[(Event, Home)]) -> Response {
    (StatusCode::CREATED, Json(json!({ "events": events_json(events) }))).into_response()
}

/// A query of named parts, none unknown.
pub(super) fn query<T: serde::de::DeserializeOwned>(uri: &Uri) -> Result<T, Problem> {
    axum::extract::Query::<T>::try_from_uri(uri)
        .map(|query| query.0)
        .map_err(|error| Problem::new(StatusCode::BAD_REQUEST, "malformed-parameter", error.body_text()))
}
