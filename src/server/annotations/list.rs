//! `GET /v1/volumes/{id}/annotations`: the items that the author may see.

use std::collections::BTreeMap;

use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::asked::{EditRequest, query};
use crate::annotation_service::Visible;
use crate::negotiate::{knows_tag, text_tag};
use crate::problem::Problem;
use relief_annotation::{Completeness, Item, Measure, Set, ShownSets, State as Presence, measures};

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct ListQuery {
    set: Option<String>,
    author: Option<String>,
}

#[derive(Serialize)]
struct ListedItem<'a> {
    version: u64,
    item: &'a Item,
    measures: Vec<Measure>,
}

/// The progress of a set.
#[derive(Default, Serialize)]
struct Complete {
    defined: usize,
    missing: usize,
    skipped: usize,
    /// The template of the set, and the item that it expects next.
    #[serde(skip_serializing_if = "Option::is_none")]
    template: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
}

impl Complete {
    fn of(Completeness { template, defined, missing, skipped, next }: Completeness) -> Self {
        Self { defined, missing, skipped, template: Some(template), next }
    }
}

#[derive(Serialize)]
struct Listing<'a> {
    seq: u64,
    items: Vec<ListedItem<'a>>,
    sets: Vec<&'a Set>,
    complete: BTreeMap<&'a str, Complete>,
    templates: Vec<String>,
}

pub(super) async fn list(asked: EditRequest, uri: Uri, headers: HeaderMap) -> Result<Response, Problem> {
    let ListQuery { set, author } = query(&uri)?;
    let shown = set.as_deref().map_or(Ok(ShownSets::All), chosen)?;
    let asked = asked.or_by(author)?;
    let snapshot = asked.annotations.snapshot(&asked.entry.frame_of_reference()).await?;
    let visible = Visible::new(&snapshot.sets, asked.author.as_deref());
    let sets: Vec<&Set> = visible.sets().filter(|set| shown.has(&set.name)).collect();
    let templates = asked.annotations.store.templates().await?;
    let tag = text_tag(&json!([snapshot.seq, sets, templates]).to_string());
    let validators = [
        (header::ETAG, HeaderValue::from_str(&tag).unwrap_or(HeaderValue::from_static("\"\""))),
        (header::CACHE_CONTROL, HeaderValue::from_static("private, no-cache")),
        (header::VARY, HeaderValue::from_static("Relief-Author")),
    ];
    if knows_tag(&headers, &tag) {
        return Ok((StatusCode::NOT_MODIFIED, validators).into_response());
    }
    let mut complete: BTreeMap<&str, Complete> = BTreeMap::new();
    let mut items = Vec::with_capacity(snapshot.items.len());
    for known in snapshot.items.iter() {
        let item = &known.item;
        if !(shown.has(&item.set) && visible.sees(&item.set)) {
            continue;
        }
        let count = complete.entry(&item.set).or_default();
        *match item.state {
            Presence::Defined => &mut count.defined,
            Presence::Missing => &mut count.missing,
            Presence::Skipped => &mut count.skipped,
        } += 1;
        let measures = item.geometry.as_ref().map(measures).unwrap_or_default();
        items.push(ListedItem { version: known.version, item, measures });
    }
    for set in &sets {
        let Some(name) = &set.template else { continue };
        // An unknown template expects nothing.
        let Ok(template) = asked.annotations.template(name).await else { continue };
        let of_set = items.iter().map(|listed| listed.item).filter(|item| item.set == set.name);
        complete.insert(&set.name, Complete::of(template.completeness(of_set)));
    }
    let listing = Listing { seq: snapshot.seq, items, sets, complete, templates };
    let body =
        serde_json::to_string(&listing).map_err(|error| Problem::internal("listing annotations", error))?;
    Ok((validators, [(header::CONTENT_TYPE, "application/json")], body).into_response())
}

/// Sets by their names.
pub(super) fn chosen(names: &str) -> Result<ShownSets, Problem> {
    ShownSets::of_names(names.split(',').map(str::trim)).map_err(|reason| {
        Problem::new(StatusCode::BAD_REQUEST, "malformed-parameter", format!("set: {reason}"))
            .with("path", "set")
    })
}
