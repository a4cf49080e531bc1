//! Uploads: a zip of a series becomes a volume.
//!
//! The file is streamed to disk under a limit, one upload at a time, and removed when it has been read.

use std::sync::Arc;

use axum::Json;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use tempfile::TempPath;
use tokio::io::AsyncWriteExt;

use super::guard::{expect_content_type, next_part, too_large};
use super::problem::Problem;
use super::state::{Server, UploadLimits};
use super::volumes::{AddError, Added, LoadedVolume};

pub(super) async fn upload(
    State(server): State<Arc<Server>>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let Some(limits) = server.config.uploads else {
        let detail = "uploads are off; start the server with --allow-upload";
        return Err(Problem::new(StatusCode::FORBIDDEN, "uploads-off", detail));
    };
    expect_content_type(&headers, "application/zip")?;
    check_length(&headers, limits.file_bytes)?;
    let _turn = server
        .upload
        .try_acquire()
        .map_err(|_| Problem::unavailable("busy", "another upload is being read; try again soon"))?;
    let path = receive(body, &server, limits.file_bytes).await?;
    let loaded = load(&server, path).await?;
    let (entry, added) = add(&server, loaded, limits).await?;
    let status = match added {
        Added::New => StatusCode::CREATED,
        Added::Known => StatusCode::OK,
    };
    let location = [(header::LOCATION, format!("/v1/volumes/{}", entry.id))];
    Ok((status, location, Json(entry.describe())).into_response())
}

/// Refuses what says that it is too large before any of it is read.
fn check_length(headers: &HeaderMap, limit: u64) -> Result<(), Problem> {
    let length =
        headers.get(header::CONTENT_LENGTH).and_then(|value| value.to_str().ok()?.parse::<u64>().ok());
    if length.is_some_and(|length| length > limit) { Err(too_large(limit)) } else { Ok(()) }
}

async fn receive(mut body: Body, server: &Server, limit: u64) -> Result<TempPath, Problem> {
    let failed = |error: std::io::Error| Problem::internal("storing the upload", error);
    let file = tempfile::Builder::new().prefix("relief-upload-").suffix(".zip").tempfile().map_err(failed)?;
    let (file, path) = file.into_parts();
    let mut file = tokio::fs::File::from_std(file);
    let mut received = 0u64;
    while let Some(part) = next_part(&mut body, server.config.body_timeout).await? {
        received += part.len() as u64;
        if received > limit {
            return Err(too_large(limit));
        }
        file.write_all(&part).await.map_err(failed)?;
    }
    file.flush().await.map_err(failed)?;
    Ok(path)
}

async fn load(server: &Server, path: TempPath) -> Result<LoadedVolume, Problem> {
    let loader = Arc::clone(&server.loader);
    // The path goes along: the file is removed when it has been read, whatever became of the client.
    let job = tokio::task::spawn_blocking(move || loader(&path));
    let loaded = job.await.map_err(|panic| Problem::internal("reading the upload", panic))?;
    loaded.map_err(|reason| Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "unreadable-series", reason))
}

async fn add(
    server: &Arc<Server>,
    loaded: LoadedVolume,
    limits: UploadLimits,
) -> Result<(Arc<super::volumes::Entry>, Added), Problem> {
    let server = Arc::clone(server);
    // Hashing the voxels takes a while.
    let job = tokio::task::spawn_blocking(move || server.volumes.add_upload(loaded, limits));
    let added = job.await.map_err(|panic| Problem::internal("adding the upload", panic))?;
    added.map_err(|full: AddError| Problem::new(StatusCode::INSUFFICIENT_STORAGE, "uploads-full", full))
}
