//! Sets: whose they are, and whether they are blinded.

use axum::Json;
use axum::extract::Path;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::json;

use super::asked::{EditRequest, JsonBody};
use super::edit::parse_value;
use crate::annotation_service::invalid;
use crate::identity::Scope;
use crate::negotiate::{may_replace, text_tag};
use crate::problem::Problem;
use relief_annotation::Set;
use relief_base::OutOfRange;

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
    let unrecorded = text(&unrecorded(set.name.clone()));
    let may = |known: Option<&str>| {
        may_replace(&headers, known) || (known.is_none() && may_replace(&headers, Some(&unrecorded)))
    };
    asked.may_change_set(&set.name).await?;
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

impl EditRequest {
    /// Checks that the caller may change a set: a blinded one is its reader's, and an
    /// administrator's. An open server does not know its callers and allows every change.
    async fn may_change_set(&self, name: &str) -> Result<(), Problem> {
        let Some(identity) = &self.caller.identity else { return Ok(()) };
        let sets = self.annotations.sets().await?;
        let known = sets.iter().find(|set| set.name == name && set.blinded);
        let reader = known.and_then(|set| set.reader.as_deref());
        if identity.scope == Scope::Admin || reader.is_none_or(|reader| reader == identity.name) {
            return Ok(());
        }
        let detail = "the set is blinded: its reader and administrators may change it";
        Err(Problem::new(StatusCode::FORBIDDEN, "blinded-set", detail))
    }
}
