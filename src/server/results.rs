//! Results in an archive: pictures as Secondary Captures, annotations as DICOM objects.
//!
//! Objects belong to the study of their volume, and name its patient. Equal results make equal
//! objects, which an archive has once.

use std::sync::Arc;

use axum::Json;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, Uri};
use serde::Deserialize;
use serde_json::{Value, json};

use super::archived::{Archives, StoredResult};
use super::archives::{failed, no_archives};
use super::frame::{SCENE_BYTES, picture_of};
use super::guard::{expect_content_type, read_body};
use super::problem::{Problem, parse};
use super::query::{Query, SceneQuery};
use super::state::Pictures;
use relief_dicom::{CaptureOptions, CapturedPicture, SeriesReference, write_capture};
use relief_session::{VolumeEntry, on_blocking_thread};

/// A picture that is to be stored.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PictureToStore {
    /// Name of the archive.
    archive: String,
    /// As for `/frame`, in place of a query; its layout does not matter.
    scene: Option<serde_json::Map<String, Value>>,
}

/// `POST /v1/volumes/{id}/frame/store`: renders a picture and stores it.
pub(super) async fn store_picture(
    pictures: Pictures,
    State(archives): State<Option<Arc<Archives>>>,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> Result<(StatusCode, Json<Value>), Problem> {
    expect_content_type(&headers, "application/json")?;
    let body = read_body(body, SCENE_BYTES, pictures.config.body_timeout).await?;
    let PictureToStore { archive, scene } = parse(&body)?;
    let destination = Destination::find(archives, &archive)?;
    let entry = pictures.engine.volumes.find(&id)?;
    let series = series_of(&entry)?;
    let query = Query::of(&uri)?;
    let scene = match scene {
        None => SceneQuery::from_query(&query, &entry.grid)?,
        Some(scene) => {
            query.expect_empty()?;
            SceneQuery::from_body(Value::from(scene).to_string().as_bytes())?
        }
    };
    let frame =
        picture_of(&pictures, &entry, scene, &headers).await.map_err(|problem| query.blame(problem))?;
    let job = move || {
        let picture = CapturedPicture::of_rgba(frame.size_px, &frame.color_rgba);
        write_capture(&[picture], &series, &CaptureOptions::of_view())
    };
    let object = pictures.engine.blocking("writing a picture as a DICOM object", job).await?;
    let object =
        object.map_err(|error| Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "not-storable", error))?;
    destination.store(object).await
}

/// The series that results belong to.
fn series_of(entry: &VolumeEntry) -> Result<Arc<SeriesReference>, Problem> {
    entry.reference.clone().ok_or_else(|| {
        let detail = "the volume is not of a DICOM series with UIDs, so its results belong to no study";
        Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "no-study", detail)
    })
}

/// An archive for results.
pub(super) struct Destination {
    archives: Arc<Archives>,
    archive: usize,
}

impl Destination {
    /// The archive of this name, if clients may store results there.
    pub(super) fn find(archives: Option<Arc<Archives>>, name: &str) -> Result<Self, Problem> {
        let archives = archives.ok_or_else(no_archives)?;
        if !archives.source.take_results() {
            let detail = "results are not stored from here; start the server with --archive-results";
            return Err(Problem::new(StatusCode::FORBIDDEN, "results-off", detail));
        }
        let archive = archives.index(name)?;
        Ok(Self { archives, archive })
    }

    /// Stores an object: 201 where it is new, 200 where the archive had it.
    pub(super) async fn store(self, object: Vec<u8>) -> Result<(StatusCode, Json<Value>), Problem> {
        let Self { archives, archive } = self;
        let turn = Arc::clone(&archives.stores).acquire_owned().await;
        let turn = turn.map_err(|error| Problem::internal("waiting to store a result", error))?;
        let job = move || archives.source.store(archive, object);
        let stored = on_blocking_thread(turn, "storing a result in an archive", job).await?;
        match stored.map_err(|error| failed("storing the result", &error))? {
            StoredResult::Stored => Ok((StatusCode::CREATED, Json(json!({ "outcome": "stored" })))),
            StoredResult::AlreadyThere => Ok((StatusCode::OK, Json(json!({ "outcome": "already-there" })))),
            StoredResult::Refused { reason } => {
                let reason =
                    reason.map_or_else(String::new, |reason| format!(", failure reason {reason:#06x}"));
                let detail = format!("the archive did not store the object{reason}");
                Err(Problem::new(StatusCode::BAD_GATEWAY, "archive-refused", detail))
            }
        }
    }
}
