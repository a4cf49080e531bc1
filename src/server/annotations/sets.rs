//! Sets: whose they are, and whether they are blinded.

use std::sync::Arc;

use axum::Json;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::HeaderMap;
use serde::Deserialize;
use serde_json::{Value, json};

use super::Asked;
use super::edit::{parse, read_json};
use super::refusal::invalid;
use crate::annotation::Set;
use crate::server::problem::Problem;
use crate::server::state::Server;

type Shared = State<Arc<Server>>;

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
    State(server): Shared,
    Path((id, name)): Path<(String, String)>,
    headers: HeaderMap,
) -> Result<Json<Value>, Problem> {
    let asked = Asked::new(&server, &id, &headers)?;
    Set::check_name(&name).map_err(|error| invalid(&error))?;
    let sets = asked.annotations.sets().await?;
    let known = sets.iter().find(|set| set.name == name).cloned();
    // A set without a row is there as soon as an item names it.
    Ok(Json(json!(known.unwrap_or(Set { name, reader: None, blinded: false, template: None }))))
}

pub(super) async fn put(
    State(server): Shared,
    Path((id, name)): Path<(String, String)>,
    headers: HeaderMap,
    body: Body,
) -> Result<Json<Value>, Problem> {
    let asked = Asked::new(&server, &id, &headers)?;
    Set::check_name(&name).map_err(|error| invalid(&error))?;
    let body = read_json(&server, &headers, body, 64 << 10).await?;
    let SetBody { name: said, reader, blinded, template, author } = parse(body.to_string().as_bytes())?;
    if let Some(said) = said.filter(|said| *said != name) {
        let error = crate::annotation::ItemError::new("name", &format!("{said:?}"), "what the path says");
        return Err(invalid(&error));
    }
    let author = asked.author(author)?;
    let set = Set { name, reader, blinded, template };
    asked.annotations.store.put_set(&set, &author).await?;
    asked.annotations.forget_sets();
    server.live.annotations_changed();
    Ok(Json(json!(set)))
}
