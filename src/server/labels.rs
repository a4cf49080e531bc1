//! Label maps that clients bring: a file becomes the segments of a volume that is served.
//!
//! Label maps share the limits and the queue of uploads. A map takes at most as many bytes as its
//! volume, so the limit of volumes bounds it.

use std::path::Path as FilePath;
use std::sync::Arc;

use axum::Json;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode};
use serde_json::Value;

use super::identity::Caller;
use super::problem::Problem;
use super::state::{Config, LabelsLoader, Uploads};
use super::upload::{ReceivedUpload, take_in};
use super::volumes::describe;
use relief_session::{Engine, on_blocking_thread};

pub(super) async fn upload(
    State(engine): State<Arc<Engine>>,
    State(config): State<Arc<Config>>,
    State(uploads): State<Uploads>,
    Path(id): Path<String>,
    caller: Caller,
    headers: HeaderMap,
    body: Body,
) -> Result<Json<Value>, Problem> {
    let entry = engine.volumes.find(&id)?;
    let Some(loader) = uploads.labels_loader.clone() else {
        let detail = "this server reads no label maps";
        return Err(Problem::new(StatusCode::FORBIDDEN, "uploads-off", detail));
    };
    let ReceivedUpload { turn, file, share: _share, .. } =
        take_in(&config, &uploads, &caller, &headers, body, "application/octet-stream", u64::MAX).await?;
    let job = move || read(&engine, &loader, file.path(), &entry.id);
    Ok(Json(on_blocking_thread(turn, "reading the label map", job).await??))
}

/// Reads the map and gives it to the volume. Blocks.
fn read(engine: &Engine, loader: &LabelsLoader, path: &FilePath, id: &str) -> Result<Value, Problem> {
    let entry = engine.volumes.find(id)?;
    let labels = loader(path, &entry.grid)
        .map_err(|reason| Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "unreadable-labels", reason))?;
    // Frames know their labels by content: those of an earlier map are not taken for these.
    Ok(describe(&*engine.volumes.set_labels(id, labels)?))
}
