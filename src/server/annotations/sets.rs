//! Sets: whose they are, and whether they are blinded.

use axum::Json;
use axum::extract::Path;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::json;

use super::asked::{EditRequest, JsonBody};
use super::edit::parse_value;
use crate::annotation_service::{Named, invalid, permission};
use crate::negotiate::{may_replace, text_tag};
use crate::problem::Problem;
use relief_annotation::Set;
use relief_base::OutOfRange;
use relief_store::{NamedState, Permission};

/// Largest description of a set.
const MOST_BYTES: usize = 64 << 10;

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct SetBody {
    name: Option<String>,
    reader: Option<String>,
    blinded: bool,
    template: Option<String>,
    author: Option<String>,
}

pub(super) async fn show(
    asked: EditRequest,
    Path((_, name)): Path<(String, String)>,
) -> Result<Response, Problem> {
    Set::check_name(&name).map_err(|error| invalid(&error))?;
    let sets = asked.annotations.sets().await?;
    let known = sets.iter().find(|set| set.name == name).cloned();
    // A set without a record exists as soon as an item names it.
    Ok(tagged(&known.unwrap_or(unrecorded(name))))
}

pub(super) async fn put(
    asked: EditRequest,
    Path((_, name)): Path<(String, String)>,
    headers: HeaderMap,
    JsonBody(body): JsonBody<MOST_BYTES>,
) -> Result<Response, Problem> {
    Set::check_name(&name).map_err(|error| invalid(&error))?;
    let SetBody { name: said, reader, blinded, template, author } = parse_value(body)?;
    if let Some(said) = said.filter(|said| *said != name) {
        let error = OutOfRange::new("name", format!("{said:?}"), "what the path says");
        return Err(invalid(&error));
    }
    let author = asked.author(author)?;
    let set = Set { name, reader, blinded, template };
    let described = text(&set);
    asked.expect_room(described.len() as u64).await?;
    let unrecorded = text(&unrecorded(set.name.clone()));
    let identity = asked.caller.identity.as_ref();
    let may = |known: &NamedState| {
        let is_as_seen = may_replace(&headers, known.text.as_deref())
            || (known.text.is_none() && may_replace(&headers, Some(&unrecorded)));
        match permission(Named::Set(&set), identity, known) {
            Permission::Granted if !is_as_seen => Permission::Replaced,
            permission => permission,
        }
    };
    asked.annotations.store.put_set_if(&set, &author, may).await?;
    asked.annotations.sets_changed().await;
    asked.notify_views();
    Ok(tagged(&set))
}

/// A set that items name and that has no description.
fn unrecorded(name: String) -> Set {
    Set { name, reader: None, blinded: false, template: None }
}

/// A set as the store keeps it.
fn text(set: &Set) -> String {
    serde_json::to_string(set).unwrap_or_default()
}

/// A set with the tag by which it can be replaced.
fn tagged(set: &Set) -> Response {
    ([(header::ETAG, text_tag(&text(set)))], Json(json!(set))).into_response()
}
