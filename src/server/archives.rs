//! `/v1/archives`: a search over DICOM archives, and series that are loaded from them on demand.
//!
//! Series are addressed by keys that this server makes, because UIDs in paths would be in the logs of
//! proxies. A search is a POST for the same reason. Names of patients and descriptions are in answers
//! only where the operator shows them.

use std::sync::Arc;

use axum::Json;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode};
use serde_json::{Value, json};

use super::archived::{ArchivedSeries, Archives, Load, SeriesQuery, no_series, run};
use super::guard::{expect_content_type, read_body};
use super::problem::{Problem, parse};
use super::state::{Config, LoadError};
use relief_session::{Engine, NameSource, on_blocking_thread};

/// Series of one answer; more are cut off, and the answer says so.
const MOST_LISTED: usize = 200;
/// Largest body of a search, bytes.
const MOST_BYTES: usize = 4096;

/// `GET /v1/archives`: their names, and whether clients may store results in them.
pub(super) async fn list(State(archives): State<Option<Arc<Archives>>>) -> Json<Value> {
    let names: Vec<&String> = archives.iter().flat_map(|archives| archives.source.names()).collect();
    let take_results = archives.as_ref().is_some_and(|archives| archives.source.take_results());
    Json(json!({ "archives": names, "take_results": take_results }))
}

/// `POST /v1/archives/{archive}/search`: the series that match.
pub(super) async fn search(
    State(archives): State<Option<Arc<Archives>>>,
    State(config): State<Arc<Config>>,
    Path(name): Path<String>,
    headers: HeaderMap,
    body: Body,
) -> Result<Json<Value>, Problem> {
    let archives = searchable(archives, &config)?;
    let archive = archives.index(&name)?;
    expect_content_type(&headers, "application/json")?;
    let query: SeriesQuery = parse(&read_body(body, MOST_BYTES, config.body_timeout).await?)?;
    if query.attributes().next().is_none() {
        let detail = "the search has no value; give at least one of patient_id, patient_name, accession_number, study_date, description";
        return Err(Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "out-of-range", detail));
    }
    let turn = Arc::clone(&archives.searches[archive]).try_acquire_owned();
    let turn = turn.map_err(|_| {
        Problem::unavailable("busy", "other searches of this archive are running; try again soon")
    })?;
    let source = Arc::clone(&archives);
    let found =
        on_blocking_thread(turn, "searching an archive", move || source.source.search(archive, &query));
    let found = found.await?.map_err(|error| failed("the search", &error))?;
    let has_more = found.len() > MOST_LISTED;
    let shows_patients = config.volume_names == NameSource::Description;
    let described = found.into_iter().take(MOST_LISTED).map(|series| {
        let mut description = describe(&series, shows_patients);
        let (key, load) = archives.keep(archive, series);
        description["key"] = json!(key);
        description["load"] = load.as_ref().map_or(Value::Null, Load::describe);
        description
    });
    Ok(Json(json!({ "series": described.collect::<Vec<_>>(), "has_more": has_more })))
}

/// `POST /v1/archives/{archive}/series/{key}`: begins to load a series that was found.
pub(super) async fn load(
    State(archives): State<Option<Arc<Archives>>>,
    State(engine): State<Arc<Engine>>,
    State(config): State<Arc<Config>>,
    Path((name, key)): Path<(String, String)>,
) -> Result<(StatusCode, Json<Value>), Problem> {
    let archives = searchable(archives, &config)?;
    let archive = archives.index(&name)?;
    if let Some(series) = archives.begin(archive, &key, &engine)? {
        tokio::spawn(run(Arc::clone(&archives), engine, archive, key.clone(), series));
    }
    let state = archives.state(&key).ok_or_else(no_series)?;
    Ok((StatusCode::ACCEPTED, Json(state.describe())))
}

/// `GET /v1/archives/{archive}/series/{key}`: the state of loading it.
pub(super) async fn state(
    State(archives): State<Option<Arc<Archives>>>,
    Path((name, key)): Path<(String, String)>,
) -> Result<Json<Value>, Problem> {
    let archives = archives.ok_or_else(no_archives)?;
    archives.index(&name)?;
    Ok(Json(archives.state(&key).ok_or_else(no_series)?.describe()))
}

fn describe(series: &ArchivedSeries, shows_patients: bool) -> Value {
    let mut description = json!({
        "study_date": series.study_date,
        "body_part": series.body_part,
        "instances": series.instances,
    });
    if shows_patients {
        description["description"] = json!(series.description);
        description["patient_id"] = json!(series.patient_id);
        description["patient_name"] = json!(series.patient_name);
    }
    description
}

pub(super) fn failed(what: &str, error: &LoadError) -> Problem {
    Problem::new(StatusCode::BAD_GATEWAY, "archive-failed", format!("{what} failed: {error}"))
}

/// The archives, if clients may add volumes.
fn searchable(archives: Option<Arc<Archives>>, config: &Config) -> Result<Arc<Archives>, Problem> {
    let archives = archives.ok_or_else(no_archives)?;
    if config.uploads.is_none() {
        let detail = "clients may not add volumes; start the server with --uploads on";
        return Err(Problem::new(StatusCode::FORBIDDEN, "uploads-off", detail));
    }
    Ok(archives)
}

pub(super) fn no_archives() -> Problem {
    let detail = "no archive is searched here; start the server with --archive NAME=ADDRESS";
    Problem::new(StatusCode::NOT_FOUND, "no-archive", detail)
}
