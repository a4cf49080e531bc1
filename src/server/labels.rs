//! Label maps that clients bring: a file becomes the segments of a volume that is served.
//!
//! Under the limits of uploads, in turn with them. A map takes at most as many bytes as the volume that it belongs to, so the
//! limit on volumes holds it, too.

use std::path::Path as FilePath;
use std::sync::Arc;

use axum::Json;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode};
use serde_json::Value;

use super::blocking::on_blocking_thread;
use super::problem::Problem;
use super::state::Server;
use super::upload::{Received, take_in};

pub(super) async fn upload(
    State(server): State<Arc<Server>>,
    Path(id): Path<String>,
    headers: HeaderMap,
    body: Body,
) -> Result<Json<Value>, Problem> {
    let entry = server.volumes.find(&id)?;
    if server.labels_loader.is_none() {
        let detail = "this server reads no label maps";
        return Err(Problem::new(StatusCode::FORBIDDEN, "uploads-off", detail));
    }
    let Received { turn, path, .. } = take_in(&server, &headers, body, "application/octet-stream").await?;
    let reader = Arc::clone(&server);
    let job = move || read(&reader, &path, &entry.id);
    Ok(Json(on_blocking_thread(turn, "reading the label map", job).await??))
}

/// Reads the map and gives it to the volume. Blocks.
fn read(server: &Server, path: &FilePath, id: &str) -> Result<Value, Problem> {
    let entry = server.volumes.find(id)?;
    let loader =
        server.labels_loader.as_ref().ok_or_else(|| Problem::internal("reading labels", "no reader"))?;
    let labels = loader(path, &entry.grid)
        .map_err(|reason| Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "unreadable-labels", reason))?;
    // Frames know their labels by content: those of an earlier map are not taken for these.
    Ok(server.volumes.set_labels(id, labels)?.describe())
}
