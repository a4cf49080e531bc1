//! Templates: lists of expected items, stored for all volumes and applied to a set of one.

use axum::Json;
use axum::extract::Path;
use axum::http::{HeaderMap, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::{Value, json};

use super::asked::created;
use super::asked::{EditRequest, JsonBody, query};
use super::author;
use crate::annotation_service::{Annotations, Named, invalid, permission};
use crate::negotiate::{may_replace, text_tag};
use crate::problem::Problem;
use relief_annotation::{Change, Item, Set, Template, TemplateError};
use relief_base::OutOfRange;
use relief_store::{NamedState, Permission, StoreError};

/// Largest template.
const MOST_BYTES: usize = 1 << 20;

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct ApplyQuery {
    set: Option<String>,
    author: Option<String>,
}

impl Annotations {
    /// The template of this name: the log's, or one that comes with the program.
    pub(crate) async fn template(&self, name: &str) -> Result<Template, Problem> {
        let text = self.template_text(name).await?;
        Template::read(text.as_bytes()).map_err(|error| refused(&error))
    }

    async fn template_text(&self, name: &str) -> Result<String, Problem> {
        match (self.store.template(name).await, Template::ready_json(name)) {
            (Err(StoreError::NoTemplate { .. }), Some(ready)) => Ok(ready.to_owned()),
            (text, _) => Ok(text?),
        }
    }
}

/// The templates of the log, and those that come with the program.
pub(super) async fn names(asked: EditRequest) -> Result<Json<Value>, Problem> {
    let names = asked.annotations.store.templates().await?;
    let ready: Vec<_> =
        Template::ready_names().filter(|ready| !names.iter().any(|name| name == ready)).collect();
    Ok(Json(json!({ "templates": names, "ready": ready })))
}

pub(super) async fn show(
    asked: EditRequest,
    Path((_, name)): Path<(String, String)>,
) -> Result<Response, Problem> {
    let text = asked.annotations.template_text(&name).await?;
    let template = asked.annotations.template(&name).await?;
    Ok(([(header::ETAG, text_tag(&text))], Json(json!(template))).into_response())
}

pub(super) async fn put(
    asked: EditRequest,
    Path((_, name)): Path<(String, String)>,
    headers: HeaderMap,
    JsonBody(mut body): JsonBody<MOST_BYTES>,
) -> Result<Response, Problem> {
    let of_body = body.as_object_mut().and_then(|body| body.remove("author"));
    let author = asked.author(author::of_body(of_body.as_ref())?)?;
    let said = body.as_object_mut().and_then(|body| body.insert("name".to_owned(), name.as_str().into()));
    if said.as_ref().is_some_and(|said| *said != name.as_str()) {
        return Err(invalid(&OutOfRange::new("name", "another name", "what the path says")));
    }
    let template = Template::read(body.to_string().as_bytes()).map_err(|error| refused(&error))?;
    let (text, identity) = (template.json(), asked.caller.identity.as_ref());
    asked.expect_room(text.len() as u64).await?;
    let may = |known: &NamedState| match permission(Named::Template, identity, known) {
        Permission::Granted if !may_replace(&headers, known.text.as_deref()) => Permission::Replaced,
        permission => permission,
    };
    asked.annotations.store.put_template_if(&name, &text, &author, may).await?;
    Ok(([(header::ETAG, text_tag(&text))], Json(json!(template))).into_response())
}

/// Makes the items that a set does not have.
pub(super) async fn apply(
    asked: EditRequest,
    Path((_, name)): Path<(String, String)>,
    uri: Uri,
) -> Result<Response, Problem> {
    let ApplyQuery { set, author } = query(&uri)?;
    let author = asked.author(author)?;
    let set = set.unwrap_or_else(|| Set::DEFAULT.to_owned());
    Set::check_name(&set).map_err(|error| invalid(&error))?;
    let template = asked.annotations.template(&name).await?;
    let snapshot = asked.annotations.snapshot(&asked.entry.frame_of_reference()).await?;
    let present: Vec<&Item> =
        snapshot.items.iter().map(|known| &known.item).filter(|item| item.set == set).collect();
    let missing = template
        .missing(&set, &author, None, present)
        .map_err(|error| Problem::internal("drawing random ids", error))?;
    if missing.is_empty() {
        return Ok(Json(json!({ "events": [] })).into_response()); // all of it is there
    }
    let changes = missing.into_iter().map(|item| Change::Create { item: Box::new(item) }).collect();
    let reason = format!("template {name}");
    let events = asked.edit(&author, &reason, changes).await?;
    let location = [(header::LOCATION, format!("/v1/volumes/{}/annotations?set={set}", asked.entry.id))];
    Ok((location, created(&events)).into_response())
}

fn refused(error: &TemplateError) -> Problem {
    match error {
        TemplateError::Wrong(error) => invalid(error),
        TemplateError::Json { path, .. } => {
            Problem::new(StatusCode::BAD_REQUEST, "malformed-json", error).with("path", path.as_str())
        }
        TemplateError::Long { .. } => Problem::new(StatusCode::PAYLOAD_TOO_LARGE, "too-large", error),
    }
}
