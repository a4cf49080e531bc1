//! `GET /v1/volumes/{id}/annotations/log`: every change of the volume's items that the author may
//! see, oldest first.

use axum::Json;
use axum::http::{StatusCode, Uri};
use serde::Deserialize;
use serde_json::{Value, json};

use super::asked::{EditRequest, query};
use crate::annotation_service::{Visible, outward_event};
use crate::problem::Problem;
use relief_store::LogFilter;

/// Events of an answer: usually, and at most.
const USUAL: usize = 200;
const MOST: usize = 1000;
/// Events that are looked at for an answer: those of other volumes are passed over.
const LOOKED_AT: u64 = 5000;

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct LogQuery {
    after: u64,
    limit: Option<usize>,
    author: Option<String>,
}

pub(super) async fn log(asked: EditRequest, uri: Uri) -> Result<Json<Value>, Problem> {
    let LogQuery { after, limit, author } = query(&uri)?;
    let limit = limit.unwrap_or(USUAL);
    if !(1..=MOST).contains(&limit) {
        let detail = format!("limit is {limit}, allowed: 1 to {MOST}");
        return Err(
            Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "out-of-range", detail).with("path", "limit")
        );
    }
    let asked = asked.or_by(author)?;
    let (store, frame) = (&asked.annotations.store, asked.entry.frame_of_reference());
    let sets = asked.annotations.sets().await?;
    let visible = Visible::new(&sets, asked.author.as_deref());
    let events = store.log(&LogFilter { after, limit: Some(LOOKED_AT), ..LogFilter::default() }).await?;
    let homes = asked.annotations.homes(&events).await?;
    let mut next = after;
    let mut shown: Vec<Value> = Vec::new();
    for (event, home) in events.iter().zip(&homes) {
        if shown.len() == limit {
            break;
        }
        next = event.seq;
        if home.frame.as_ref() == Some(&frame) && visible.sees(&home.set) {
            shown.push(outward_event(event, &home.set));
        }
    }
    Ok(Json(json!({ "events": shown, "next": next, "seq": store.seq().await? })))
}
