//! Sets: whose they are, and whether they are blinded.

use axum::Json;
use axum::extract::Path;
use serde::Deserialize;
use serde_json::{Value, json};

use super::asked::{EditRequest, JsonBody};
use super::edit::parse_value;
use crate::annotation_service::invalid;
use crate::problem::Problem;
use relief_annotation::Set;

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
) -> Result<Json<Value>, Problem> {
    Set::check_name(&name).map_err(|error| invalid(&error))?;
    let sets = asked.annotations.sets().await?;
    let known = sets.iter().find(|set| set.name == name).cloned();
    // A set without a record exists as soon as an item names it.
    Ok(Json(json!(known.unwrap_or(Set { name, reader: None, blinded: false, template: None }))))
}

pub(super) async fn put(
    asked: EditRequest,
    Path((_, name)): Path<(String, String)>,
    JsonBody(body): JsonBody<MOST_BYTES>,
) -> Result<Json<Value>, Problem> {
    Set::check_name(&name).map_err(|error| invalid(&error))?;
    let SetBody { name: said, reader, blinded, template, author } = parse_value(body)?;
    if let Some(said) = said.filter(|said| *said != name) {
        let error = relief_annotation::ItemError::new("name", &format!("{said:?}"), "what the path says");
        return Err(invalid(&error));
    }
    let author = asked.author(author)?;
    let set = Set { name, reader, blinded, template };
    asked.annotations.store.put_set(&set, &author).await?;
    asked.annotations.sets_changed().await;
    asked.notify_views();
    Ok(Json(json!(set)))
}
