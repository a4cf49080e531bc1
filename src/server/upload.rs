//! Uploads: a zip of a series becomes a volume.
//!
//! The file is streamed to disk under limits of size and time, and removed when it has been read. A
//! few are received at a time; one is read at a time. When the client leaves, reading ends at its next step.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use axum::Json;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use tokio::io::AsyncWriteExt;
use tokio::sync::OwnedSemaphorePermit;

use super::guard::{BodyTime, expect_content_type, too_large};
use super::identity::Caller;
use super::problem::Problem;
use super::shares::Share;
use super::state::{Config, UploadLimits, Uploads, VolumeLoader};
use super::volumes::describe;
use relief_base::Budget;
use relief_session::{Added, Engine, UploadedVolumes, VolumeEntry, on_blocking_thread};

pub(super) async fn upload(
    State(engine): State<Arc<Engine>>,
    State(config): State<Arc<Config>>,
    State(uploads): State<Uploads>,
    caller: Caller,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let ReceivedUpload { limits, turn, file, share: _share } =
        take_in(&config, &uploads, &caller, &headers, body, "application/zip", u64::MAX).await?;
    let budget = Budget::new(limits.header_bytes(), limits.unpacked_bytes());
    let _cancelled = CancelOnDrop(budget.clone());
    let job = move || read(&engine, &uploads.loader, file.path(), limits, &budget);
    let (entry, added) = on_blocking_thread(turn, "reading the upload", job).await??;
    let status = match added {
        Added::New => StatusCode::CREATED,
        Added::Known => StatusCode::OK,
    };
    let location = [(header::LOCATION, format!("/v1/volumes/{}", entry.id))];
    Ok((status, location, Json(describe(&entry))).into_response())
}

/// Cancels a reading when the request that waits for it is dropped.
struct CancelOnDrop(Budget);

impl Drop for CancelOnDrop {
    fn drop(&mut self) {
        self.0.cancel();
    }
}

/// A file of the system's temporary folder without a name: it is gone with the process, however
/// that ends.
pub(super) struct SpooledFile {
    file: std::fs::File,
    path: PathBuf,
    /// Where the system opens no nameless file a second time.
    _named: Option<tempfile::TempPath>,
}

impl SpooledFile {
    fn create() -> std::io::Result<Self> {
        #[cfg(target_os = "linux")]
        {
            use std::os::fd::AsRawFd;
            let file = tempfile::tempfile()?;
            let path = PathBuf::from(format!("/proc/self/fd/{}", file.as_raw_fd()));
            if path.is_file() {
                return Ok(Self { file, path, _named: None });
            }
        }
        let named = tempfile::Builder::new().prefix("relief-upload-").tempfile()?;
        let (file, path) = named.into_parts();
        Ok(Self { file, path: path.to_path_buf(), _named: Some(path) })
    }

    /// A path that opens the file from its beginning, as long as this value lives.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }
}

/// An upload that has arrived.
pub(super) struct ReceivedUpload {
    pub(super) limits: UploadLimits,
    /// The place for uploads, to be kept until the file has been read.
    pub(super) turn: OwnedSemaphorePermit,
    pub(super) file: SpooledFile,
    /// The caller's only place, to be kept as long.
    pub(super) share: Option<Share>,
}

/// Steps that all uploads share: permission, media type, transfer to a temporary file, and the turn
/// to be read. One caller has one upload at a time. A file has at most `most_bytes`, and no more than
/// the limits of uploads allow.
pub(super) async fn take_in(
    config: &Config,
    uploads: &Uploads,
    caller: &Caller,
    headers: &HeaderMap,
    body: Body,
    media_type: &'static str,
    most_bytes: u64,
) -> Result<ReceivedUpload, Problem> {
    let Some(limits) = config.uploads else {
        return Err(uploads_off());
    };
    expect_content_type(headers, media_type)?;
    let limits = UploadLimits { file_bytes: limits.file_bytes.min(most_bytes), ..limits };
    check_length(headers, limits.file_bytes)?;
    let share = uploads.shares.take(caller).map_err(|most| {
        let detail = "your last upload is not read yet; send the next one after its answer";
        Problem::new(StatusCode::TOO_MANY_REQUESTS, "too-many-uploads", detail).with("allowed", most)
    })?;
    let receiving = Arc::clone(&uploads.receiving)
        .try_acquire_owned()
        .map_err(|_| Problem::unavailable("busy", "other uploads are being received; try again soon"))?;
    let file = receive(body, config.body_timeout, limits).await?;
    let stopped = |_| Problem::unavailable("stopping", "the server stops");
    let turn = Arc::clone(&uploads.turn).acquire_owned().await.map_err(stopped)?;
    drop(receiving); // until then, as files that wait take room on the disk
    Ok(ReceivedUpload { limits, turn, file, share })
}

/// The answer of a server that takes no files.
pub(super) fn uploads_off() -> Problem {
    let detail = "uploads are off; start the server with --uploads on";
    Problem::new(StatusCode::FORBIDDEN, "uploads-off", detail)
}

/// Refuses a body by its declared length before reading it.
fn check_length(headers: &HeaderMap, limit: u64) -> Result<(), Problem> {
    let length =
        headers.get(header::CONTENT_LENGTH).and_then(|value| value.to_str().ok()?.parse::<u64>().ok());
    if length.is_some_and(|length| length > limit) { Err(too_large(limit)) } else { Ok(()) }
}

/// The body as a file. The slower it comes, the sooner it must be whole: waits count against the
/// slowest rate.
async fn receive(mut body: Body, patience: Duration, limits: UploadLimits) -> Result<SpooledFile, Problem> {
    let failed = |error: std::io::Error| match error.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            let detail = "the folder for uploads is full; try again later";
            Problem::new(StatusCode::INSUFFICIENT_STORAGE, "upload-folder-full", detail)
        }
        _ => Problem::internal("storing the upload", error),
    };
    let spooled = SpooledFile::create().map_err(failed)?;
    let mut file = tokio::fs::File::from_std(spooled.file.try_clone().map_err(failed)?);
    let (time, mut received) = (BodyTime::new(patience, limits.slowest_bytes_per_s), 0u64);
    while let Some(part) = time.next(&mut body, received).await? {
        received += part.len() as u64;
        if received > limits.file_bytes {
            return Err(too_large(limits.file_bytes));
        }
        file.write_all(&part).await.map_err(failed)?;
    }
    file.flush().await.map_err(failed)?;
    Ok(spooled)
}

/// Reads the series and adds its volume. Blocks.
fn read(
    engine: &Engine,
    loader: &VolumeLoader,
    path: &Path,
    limits: UploadLimits,
    budget: &Budget,
) -> Result<(Arc<VolumeEntry>, Added), Problem> {
    let loaded = loader(path, budget)
        .map_err(|reason| Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "unreadable-series", reason))?;
    let limits = UploadedVolumes { volumes: limits.volumes, voxel_bytes: limits.voxel_bytes };
    Ok(engine.volumes.add_upload(loaded, limits)?)
}
