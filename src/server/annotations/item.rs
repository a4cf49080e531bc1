//! One item: shown, changed, deleted. A change names the version that its author saw: two editors
//! never overwrite silently.

use std::sync::Arc;

use axum::Json;
use axum::body::Body;
use axum::extract::Path;
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::{Value, json};

use super::asked::{EditRequest, query};
use super::asked::{events_json, read_json};
use super::author;
use super::edit::{MOST_BYTES, fill};
use crate::annotation_service::Visible;
use crate::annotation_service::outward_versioned;
use crate::annotation_service::{invalid, no_such_item};
use crate::negotiate::knows_tag;
use crate::problem::Problem;
use relief_annotation::{Change, Item, ItemId, Versioned};

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct ItemQuery {
    author: Option<String>,
    reason: String,
}

pub(super) async fn show(
    asked: EditRequest,
    Path((_, item)): Path<(String, String)>,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let asked = asked.or_by(query::<ItemQuery>(&uri)?.author)?;
    let known = find(&asked, asked.author.as_deref(), &item).await?;
    let tag = format!("\"{}\"", known.version);
    if knows_tag(&headers, &tag) {
        return Ok((StatusCode::NOT_MODIFIED, [(header::ETAG, tag)]).into_response());
    }
    Ok(([(header::ETAG, tag)], Json(outward_versioned(&known))).into_response())
}

pub(super) async fn put(
    asked: EditRequest,
    Path((_, item)): Path<(String, String)>,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let ItemQuery { author, reason } = query(&uri)?;
    let condition = Condition::of(&headers)?;
    let mut item_id = Value::from(item.as_str());
    let mut wanted = read_json(asked.config(), &headers, body, MOST_BYTES).await?;
    let of_body = author::of_body(wanted.get("author"))?;
    // The body's author is the item's; it stands for the editor where nothing else names one.
    let of_body = of_body.filter(|_| asked.author.is_none());
    let author = asked.author(author.or(of_body))?;
    if let Some(found) = wanted.get("id").filter(|found| **found != item_id) {
        let detail = format!("id is {found}, and the path says {item_id}");
        return Err(Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "out-of-range", detail).with("path", "id"));
    }
    let known = find(&asked, Some(&author), &item).await;
    let version = condition.version(known.as_ref().ok())?;
    if known.is_err() && matches!(condition, Condition::Any) {
        return Err(no_such_item(&item));
    }
    wanted["id"] = item_id.take();
    fill(&mut wanted, &author)?;
    let wanted: Item =
        serde_path_to_error::deserialize(wanted).map_err(|error| crate::problem::malformed(&error, ""))?;
    wanted.validate().map_err(|error| invalid(&error))?;
    let change = Change::Update { item: Box::new(wanted), version };
    let events = asked.edit(&author, &reason, vec![change]).await?;
    let made = events
        .last()
        .and_then(|(event, _)| Some(Versioned { version: event.version, item: event.item.clone()? }));
    let made = made.ok_or_else(|| Problem::internal("changing an item", "the store made no event"))?;
    let mut answer = outward_versioned(&made);
    answer["events"] = events_json(&events);
    Ok(([(header::ETAG, format!("\"{}\"", made.version))], Json(answer)).into_response())
}

pub(super) async fn delete(
    asked: EditRequest,
    Path((_, item)): Path<(String, String)>,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let ItemQuery { author, reason } = query(&uri)?;
    let condition = Condition::of(&headers)?;
    let author = asked.author(author)?;
    let known = find(&asked, Some(&author), &item).await;
    if known.is_err() && matches!(condition, Condition::Any) {
        return Err(no_such_item(&item));
    }
    let version = condition.version(known.as_ref().ok())?;
    let change = Change::Delete { id: parse(&item)?, version };
    let events = asked.edit(&author, &reason, vec![change]).await?;
    Ok(Json(json!({ "events": events_json(&events) })).into_response())
}

fn parse(id: &str) -> Result<ItemId, Problem> {
    id.parse().map_err(|_| {
        let shown: String = id.chars().take(40).collect();
        no_such_item(&shown)
    })
}

/// The item as this author sees it.
async fn find(asked: &EditRequest, author: Option<&str>, id: &str) -> Result<Arc<Versioned>, Problem> {
    let id = parse(id)?;
    let snapshot = asked.annotations.snapshot(&asked.entry.frame_of_reference()).await?;
    let visible = Visible::new(&snapshot.sets, author);
    let known = snapshot.get(id).filter(|known| visible.sees(&known.item.set));
    known.cloned().ok_or_else(|| no_such_item(&id))
}

/// The condition of `If-Match` (RFC 9110, 13.1.1).
enum Condition {
    /// `If-Match: *` matches any version.
    Any,
    /// This version.
    Version(u64),
}

impl Condition {
    fn of(headers: &HeaderMap) -> Result<Self, Problem> {
        let Some(value) = headers.get(header::IF_MATCH) else {
            let detail = "say in If-Match which version you saw, such as \"3\": the ETag of the item";
            return Err(Problem::new(StatusCode::PRECONDITION_REQUIRED, "no-version", detail));
        };
        let text = HeaderValue::to_str(value).unwrap_or_default().trim();
        if text == "*" {
            return Ok(Self::Any);
        }
        let digits = text.strip_prefix('"').and_then(|rest| rest.strip_suffix('"'));
        let digits = digits.filter(|digits| digits.bytes().all(|digit| digit.is_ascii_digit()));
        digits.and_then(|digits| digits.parse().ok()).map(Self::Version).ok_or_else(|| {
            let detail = "If-Match is no version of an item, such as \"3\"";
            Problem::new(StatusCode::BAD_REQUEST, "malformed-version", detail).with("path", "If-Match")
        })
    }

    fn version(&self, known: Option<&Arc<Versioned>>) -> Result<u64, Problem> {
        match self {
            Self::Version(version) => Ok(*version),
            Self::Any => Ok(known.map_or(0, |known| known.version)),
        }
    }
}
