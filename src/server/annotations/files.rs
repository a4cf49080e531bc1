//! Annotations as files of other tools, both ways, and the contents of regions and meshes.
//!
//! Files are read and written on blocking threads; imports share the queue of uploads. No output
//! contains a name or id of a patient, except for DICOM objects, which name the series that they
//! belong to.

use std::collections::HashMap;
use std::sync::Arc;

use axum::Json;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::{Value, json};

use super::asked::events_json;
use super::asked::{EditRequest, query};
use crate::annotation_service::{Annotations, Visible};
use crate::archived::Archives;
use crate::guard::{expect_content_type, read_body};
use crate::problem::{Problem, parse};
use crate::results::Destination;
use crate::state::ImportError;
use crate::upload::{ReceivedUpload, take_in, uploads_off};
use relief_annotation::{ContentId, Item, Set, ShownSets, Versioned};
use relief_dicom::SeriesReference;
use relief_exchange::{
    ExchangeError, ExistingItems, ExportedFile, Format, Imported, Merged, ReadContext, WriteContext,
    deidentified,
};
use relief_session::on_blocking_thread;
use relief_store::Filter;

/// A content never changes.
const CACHE_CONTROL: &str = "private, max-age=31536000, immutable";
/// Largest file that comes: a label map of a large series.
const MOST_BYTES: u64 = 256 << 20;
/// Largest order to store annotations.
const MOST_ORDER_BYTES: usize = 4096;

static LEFT_OUT: HeaderName = HeaderName::from_static("relief-left-out");

pub(super) async fn content(
    asked: EditRequest,
    Path((_, sha256)): Path<(String, String)>,
) -> Result<Response, Problem> {
    let content = ContentId::try_from(sha256)
        .map_err(|reason| Problem::new(StatusCode::NOT_FOUND, "no-such-content", reason))?;
    let (media_type, bytes) = asked.annotations.store.content(&content).await?;
    let media_type =
        HeaderValue::from_str(&media_type).unwrap_or(HeaderValue::from_static("application/octet-stream"));
    let headers = [
        (header::CONTENT_TYPE, media_type),
        (header::CACHE_CONTROL, HeaderValue::from_static(CACHE_CONTROL)),
    ];
    Ok((headers, bytes).into_response())
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct ImportQuery {
    format: Option<String>,
    /// The file's name, by which its format may be known. It is kept nowhere but as the name of the
    /// list.
    name: Option<String>,
    set: Option<String>,
    list: Option<String>,
    reason: String,
    author: Option<String>,
    /// Treatment of items that exist already; without either option they stay unchanged.
    update: bool,
    duplicate: bool,
    /// Whether to answer what would be done, and change nothing.
    dry_run: bool,
}

pub(super) async fn import(
    asked: EditRequest,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    asked.config().uploads.ok_or_else(uploads_off)?;
    let ImportQuery { format, name, set, list, reason, author, update, duplicate, dry_run } = query(&uri)?;
    let present = match (update, duplicate) {
        (false, false) => ExistingItems::Keep,
        (true, false) => ExistingItems::Update,
        (false, true) => ExistingItems::Duplicate,
        (true, true) => {
            let detail = "update and duplicate exclude one another";
            let status = StatusCode::UNPROCESSABLE_ENTITY;
            return Err(Problem::new(status, "conflicting-parameters", detail).with("path", "duplicate"));
        }
    };
    let author = asked.author(author)?;
    let set = set.unwrap_or_else(|| Set::DEFAULT.to_owned());
    Set::check_name(&set).map_err(|error| crate::annotation_service::invalid(&error))?;
    let format = format.map(|format| parse_format(&format)).transpose()?;
    let Some(loader) = asked.uploads.annotations_loader.clone() else { return Err(uploads_off()) };
    let ReceivedUpload { turn, file, share: _share, .. } = take_in(
        asked.config(),
        &asked.uploads,
        &asked.caller,
        &headers,
        body,
        "application/octet-stream",
        MOST_BYTES,
    )
    .await?;
    let (entry, by) = (Arc::clone(&asked.entry), author.clone());
    let job = move || {
        let frame = entry.frame_of_reference();
        let context = ReadContext {
            author: &by,
            set: &set,
            list: list.as_deref().unwrap_or("import"),
            frame_of_reference: Some(&frame),
            grid: Some(&entry.grid),
            series: entry.reference.as_deref(),
        };
        loader(file.path(), name.as_deref().unwrap_or_default(), format, &context).map_err(unreadable)
    };
    let Imported { items, contents, mut warnings } =
        on_blocking_thread(turn, "reading annotations", job).await??;
    if items.is_empty() {
        let detail = "the file has no annotations";
        return Err(Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "nothing-there", detail)
            .with("warnings", warnings));
    }
    let merged = merged(&asked, &author, items, present).await?;
    warnings.extend(merged.note("update=true", "duplicate=true"));
    let counts = json!({ "unchanged": merged.unchanged, "skipped": merged.skipped });
    if merged.changes.is_empty() || dry_run {
        let answer = json!({ "events": [], "warnings": warnings, "there": counts });
        return Ok(Json(answer).into_response());
    }
    asked.expect_room(contents.iter().map(|(_, _, bytes)| bytes.len() as u64).sum()).await?;
    for (_, media_type, bytes) in &contents {
        asked.annotations.store.put_content(media_type, bytes).await?;
    }
    let events = asked.edit(&author, &reason, merged.changes).await?;
    let answer = json!({ "events": events_json(&events), "warnings": warnings, "there": counts });
    Ok((StatusCode::CREATED, Json(answer)).into_response())
}

fn unreadable(error: ImportError) -> Problem {
    let kind = match &error {
        ImportError::UnknownFormat => "unknown-format",
        ImportError::Unreadable(_) => "unreadable-annotations",
    };
    Problem::new(StatusCode::UNPROCESSABLE_ENTITY, kind, error)
}

/// Merges imported items with those of the volume that the author sees.
async fn merged(
    asked: &EditRequest,
    author: &str,
    items: Vec<Item>,
    present: ExistingItems,
) -> Result<Merged, Problem> {
    // Items that the author cannot see count as missing.
    let snapshot = asked.annotations.snapshot(&asked.entry.frame_of_reference()).await?;
    let visible = Visible::new(&snapshot.sets, Some(author));
    let known = snapshot.items.iter().filter(|known| visible.sees(&known.item.set));
    let known = known.map(|known| Versioned::clone(known)).collect();
    let failed = |error: &dyn std::fmt::Display| Problem::internal("merging annotations", error);
    tokio::task::spawn_blocking(move || Merged::of(items, known, present))
        .await
        .map_err(|error| failed(&error))?
        .map_err(|error| failed(&error))
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct ExportQuery {
    format: Option<String>,
    set: Option<String>,
    author: Option<String>,
    report: bool,
    deidentify: bool,
}

pub(super) async fn export(asked: EditRequest, uri: Uri) -> Result<Response, Problem> {
    let ExportQuery { format, set, author: by, report, deidentify } = query(&uri)?;
    let asked = asked.or_by(by)?;
    let shown = set.as_deref().map_or(Ok(ShownSets::All), super::list::chosen)?;
    let format = parse_format(format.as_deref().unwrap_or_default())?;
    let written = written(&asked, &shown, format, deidentify).await?;
    if report {
        return Ok(Json(json!({ "items": written.items, "left_out": written.left_out })).into_response());
    }
    let name = format!("attachment; filename=\"annotations.{}\"", format.extension());
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static(format.media_type())),
        (
            header::CONTENT_DISPOSITION,
            HeaderValue::from_str(&name).unwrap_or(HeaderValue::from_static("attachment")),
        ),
        (header::CACHE_CONTROL, HeaderValue::from_static("no-store")),
        (LEFT_OUT.clone(), HeaderValue::from(written.left_out.len())),
    ];
    Ok((headers, written.bytes).into_response())
}

/// Annotations that are to be stored.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AnnotationsToStore {
    /// Name of the archive.
    archive: String,
    /// `sr` or `seg`.
    format: String,
    /// As in an export.
    set: Option<String>,
}

/// `POST /v1/volumes/{id}/annotations/store`: writes annotations as a DICOM object and stores it.
pub(super) async fn store(
    State(archives): State<Option<Arc<Archives>>>,
    asked: EditRequest,
    headers: HeaderMap,
    body: Body,
) -> Result<(StatusCode, Json<Value>), Problem> {
    expect_content_type(&headers, "application/json")?;
    let body = read_body(body, MOST_ORDER_BYTES, asked.config().body_timeout).await?;
    let AnnotationsToStore { archive, format, set } = parse(&body)?;
    let destination = Destination::find(archives, &archive)?;
    let format = parse_format(&format)?;
    if format.media_type() != "application/dicom" {
        let detail = "an archive takes the formats sr and seg";
        return Err(
            Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "out-of-range", detail).with("path", "format")
        );
    }
    let shown = set.as_deref().map_or(Ok(ShownSets::All), super::list::chosen)?;
    let written = written(&asked, &shown, format, false).await?;
    let (status, Json(mut answer)) = destination.store(written.bytes).await?;
    answer["items"] = json!(written.items);
    answer["left_out"] = json!(written.left_out);
    Ok((status, Json(answer)))
}

/// The annotations that the author sees, as a file.
async fn written(
    asked: &EditRequest,
    shown: &ShownSets,
    format: Format,
    deidentify: bool,
) -> Result<ExportedFile, Problem> {
    let items = visible_items(asked, shown).await?;
    let contents = contents_of(&asked.annotations, &items).await?;
    let engine = Arc::clone(&asked.pictures.engine);
    let entry = Arc::clone(&asked.entry);
    let job = move || {
        let of = |id: &ContentId| contents.get(id).cloned();
        let without = entry.reference.as_deref().filter(|_| deidentify).map(SeriesReference::deidentified);
        let series = without.as_ref().or(entry.reference.as_deref());
        let items = if deidentify { deidentified(items) } else { items };
        let phase = entry.phase().map(|phase| phase.number);
        let (grid, warnings) = (Some(&entry.grid), &*entry.warnings);
        let context = WriteContext { contents: &of, grid, series, phase, warnings };
        relief_exchange::write(format, &items, &context)
    };
    let written = engine.blocking("writing annotations", job).await?;
    written.map_err(|error| refused(&error, "not-in-this-format"))
}

/// The items that the author may see, with their frame of reference, which files may name.
async fn visible_items(asked: &EditRequest, shown: &ShownSets) -> Result<Vec<Item>, Problem> {
    let sets = asked.annotations.sets().await?;
    let visible = Visible::new(&sets, asked.author.as_deref());
    let filter = Filter { frame_of_reference: Some(asked.entry.frame_of_reference()), ..Filter::default() };
    let listing = asked.annotations.store.list(&filter).await?;
    let items = listing.items.into_iter().map(|known| known.item);
    Ok(items.filter(|item| shown.has(&item.set) && visible.sees(&item.set)).collect())
}

async fn contents_of(
    annotations: &Annotations,
    items: &[Item],
) -> Result<HashMap<ContentId, Vec<u8>>, Problem> {
    let mut contents = HashMap::new();
    for id in items.iter().filter_map(|item| item.geometry.as_ref()?.content()) {
        if !contents.contains_key(id) {
            contents.insert(id.clone(), annotations.store.content(id).await?.1);
        }
    }
    Ok(contents)
}

fn parse_format(name: &str) -> Result<Format, Problem> {
    name.parse().map_err(|error: relief_exchange::UnknownFormat| {
        Problem::new(StatusCode::BAD_REQUEST, "malformed-parameter", error).with("path", "format")
    })
}

fn refused(error: &ExchangeError, kind: &'static str) -> Problem {
    Problem::new(StatusCode::UNPROCESSABLE_ENTITY, kind, error)
}
