//! Live views for viewers without a WebSocket: a stream of JPEGs, one frame at a time, and wishes by POST.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::Json;
use axum::body::{Body, Bytes};
use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use futures_util::stream::unfold;
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::sync::{OwnedSemaphorePermit, watch};

use super::placing::{Hand, happen, pointer};
use super::preview;
use super::shot::Shot;
use super::slot::Slot;
use super::view::View;
use super::wished::Wished;
use super::{Live, Look, no_such_view};
use crate::annotations::author_of;
use crate::blocking::on_blocking_thread;
use crate::guard::{expect_content_type, read_body};
use crate::negotiate::negotiate;
use crate::problem::Problem;
use crate::state::Server;
use relief_display::encode_png;
use relief_live::{
    ColorFormat, DepthFormat, Intent, MAX_TEXT_BYTES, PlacePhase, Role, Settings, check_view_name,
};
use relief_session::FileFormat;

static RELIEF_FRAME: HeaderName = HeaderName::from_static("relief-frame");
const BOUNDARY: &str = "relief-frame-boundary";
const JPEG_QUALITY: u8 = 90;
/// Waits for a frame, ms.
const USUAL_WAIT_MS: u64 = 10_000;
const LONGEST_WAIT_MS: u64 = 30_000;

/// Somebody who looks without acknowledging, until dropped.
struct Viewer {
    server: Arc<Server>,
    view: Arc<View>,
    slot: Arc<Slot>,
    shots: watch::Receiver<Option<Arc<Shot>>>,
    _place: OwnedSemaphorePermit,
}

impl Viewer {
    fn new(server: Arc<Server>, name: &str) -> Result<Self, Problem> {
        check_name(name)?;
        let place = server.live.place()?;
        let view = server.live.find(name).ok_or_else(no_such_view)?;
        let slot = Slot::new(server.live.next_id(), Role::Watcher, true, Instant::now());
        let mut shots = view.shots.subscribe();
        shots.mark_changed();
        view.join(&slot);
        Ok(Self { server, view, slot, shots, _place: place })
    }

    /// The next picture; `None` when there will be none.
    async fn next(&mut self) -> Option<Arc<Shot>> {
        let mut closing = self.server.live.closing.subscribe();
        let mut ended = self.view.ended.subscribe();
        loop {
            tokio::select! {
                _ = closing.wait_for(|closing| *closing) => return None,
                _ = ended.wait_for(|ended| *ended) => return None,
                changed = self.shots.changed() => changed.ok()?,
            }
            let shot = self.shots.borrow_and_update().clone();
            if let Some(shot) = shot {
                self.slot.flow().taken = shot.number;
                self.view.work.notify_one();
                return Some(shot);
            }
        }
    }

    async fn jpeg(&self, shot: &Arc<Shot>) -> Result<Bytes, Problem> {
        let parts = shot.parts(&self.server, (ColorFormat::Jpeg, JPEG_QUALITY), DepthFormat::None).await?;
        let (color, _) = parts.get().ok_or_else(|| Problem::internal("encoding", "nothing was made"))?;
        self.server.metrics.live.sent(shot.is_still, color.bytes.len());
        Ok(color.bytes.clone().into())
    }

    async fn png(&self, shot: &Arc<Shot>) -> Result<Bytes, Problem> {
        let place = Arc::clone(&self.server.encoders).acquire_owned().await;
        let place = place.map_err(|closed| Problem::internal("encoding", closed))?;
        let still = shot.is_still;
        let shot = Arc::clone(shot);
        let encoded = on_blocking_thread(place, "encoding", move || {
            encode_png(&shot.composed()?).map_err(|error| Problem::internal("encoding", error))
        });
        let png = encoded.await??;
        self.server.metrics.live.sent(still, png.len());
        Ok(png.into())
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        self.view.leave(&self.slot);
    }
}

/// `GET /v1/session/{view}/mjpeg`.
pub(crate) async fn mjpeg(
    State(server): State<Arc<Server>>,
    Path(name): Path<String>,
) -> Result<Response, Problem> {
    let viewer = Viewer::new(server, &name)?;
    // A browser shows a picture when the next boundary comes: it comes right behind.
    let part = |jpeg: &Bytes| {
        let head = format!("Content-Type: image/jpeg\r\nContent-Length: {}\r\n\r\n", jpeg.len());
        let tail = format!("\r\n--{BOUNDARY}\r\n");
        Bytes::from([head.as_bytes(), jpeg, tail.as_bytes()].concat())
    };
    let start = Some(Bytes::from(format!("--{BOUNDARY}\r\n")));
    let parts = unfold((viewer, start), move |(mut viewer, start)| async move {
        if let Some(start) = start {
            return Some((Ok::<_, Infallible>(start), (viewer, None)));
        }
        let shot = viewer.next().await?;
        let jpeg = viewer.jpeg(&shot).await.ok()?;
        Some((Ok(part(&jpeg)), (viewer, None)))
    });
    let kind = format!("multipart/x-mixed-replace; boundary={BOUNDARY}");
    let headers = [(header::CONTENT_TYPE, kind), (header::CACHE_CONTROL, "no-store".to_owned())];
    Ok((headers, Body::from_stream(parts)).into_response())
}

/// The query of a frame.
#[derive(Debug, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct FrameQuery {
    after: u64,
    wait_ms: u64,
}

impl Default for FrameQuery {
    fn default() -> Self {
        Self { after: 0, wait_ms: USUAL_WAIT_MS }
    }
}

/// `GET /v1/session/{view}/frame`.
pub(crate) async fn next_frame(
    State(server): State<Arc<Server>>,
    Path(name): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let FrameQuery { after, wait_ms } = query(&uri)?;
    if wait_ms > LONGEST_WAIT_MS {
        let detail = format!("wait_ms is {wait_ms}, allowed: 0 to {LONGEST_WAIT_MS}");
        return Err(
            Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "out-of-range", detail).with("path", "wait_ms")
        );
    }
    let media = negotiate(&headers, &[FileFormat::Png, FileFormat::Jpeg])?;
    let mut viewer = Viewer::new(server, &name)?;
    let mut newest = None;
    let waiting = async {
        while let Some(shot) = viewer.next().await {
            let is_new = shot.number > after && shot.revision == viewer.view.revision();
            // A frame for a display is worth the wait for the best one.
            let is_good = media == FileFormat::Jpeg || shot.is_still;
            newest = Some(shot).filter(|_| is_new).or_else(|| newest.take());
            if is_new && is_good {
                return;
            }
        }
    };
    let _ = tokio::time::timeout(Duration::from_millis(wait_ms), waiting).await;
    let no_store = (header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    let vary = (header::VARY, HeaderValue::from_static("Accept"));
    let Some(shot) = newest else { return Ok((StatusCode::NO_CONTENT, [no_store, vary]).into_response()) };
    let bytes = match media {
        FileFormat::Jpeg => viewer.jpeg(&shot).await?,
        _ => viewer.png(&shot).await?,
    };
    let number = (RELIEF_FRAME.clone(), HeaderValue::from(shot.number));
    let kind = (header::CONTENT_TYPE, HeaderValue::from_static(media.media_type()));
    Ok(([no_store, vary, number, kind], bytes).into_response())
}

/// The query of an intent.
#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct IntentQuery {
    volume: Option<String>,
}

/// `POST /v1/session/{view}/intent`.
pub(crate) async fn intent(
    State(server): State<Arc<Server>>,
    Path(name): Path<String>,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> Result<Json<Value>, Problem> {
    check_name(&name)?;
    let IntentQuery { volume } = query(&uri)?;
    expect_content_type(&headers, "application/json")?;
    let body = read_body(body, MAX_TEXT_BYTES, server.config.body_timeout).await?;
    let intent = Intent::from_json(&body).map_err(|error| {
        Problem::new(StatusCode::BAD_REQUEST, "malformed-intent", error).with("path", "intent")
    })?;
    // Nothing is held from one request to the next: what would be taken hold of is shown.
    let intent = match intent {
        Intent::Place { phase: PlacePhase::Take } => Intent::Place { phase: PlacePhase::Preview },
        other => other,
    };
    let now = Instant::now();
    let entry = volume.map(|id| server.volumes.find(&id)).transpose()?;
    let view = if let Some(view) = server.live.find(&name) {
        if entry.is_some() {
            view.settle(&Settings::default(), entry, None, now)?;
        }
        view
    } else {
        let entry = entry.map_or_else(|| server.volumes.first(), Ok)?;
        Live::find_or_open(&server, &name, Look::new(entry, &Settings::default(), None)?)?
    };
    // Times tell which changes are taken back together.
    let t_ns = u64::try_from(server.started.elapsed().as_nanos()).unwrap_or(u64::MAX);
    let Wished { happened, ground, refused, .. } = view.wish(None, &[intent], t_ns, now);
    if let Some(problem) = refused {
        return Err(problem); // the only one there was
    }
    preview::search(&server, &view);
    let mut answer = json!({ "state": view.record(), "volume": view.entry().id });
    if !happened.is_empty() {
        let author = author_of(&headers)?;
        let task = std::sync::Mutex::default();
        let hand = Hand { author: author.as_deref(), task: &task, device: pointer() };
        for happened in happened {
            answer["next"] = json!(happen(&server, &view, &hand, (happened, &ground)).await?.next);
        }
    }
    Ok(Json(answer))
}

fn check_name(name: &str) -> Result<(), Problem> {
    check_view_name(name).map_err(|error| {
        Problem::new(StatusCode::BAD_REQUEST, "malformed-name", error.reason).with("path", "view")
    })
}

fn query<T: serde::de::DeserializeOwned>(uri: &Uri) -> Result<T, Problem> {
    axum::extract::Query::<T>::try_from_uri(uri)
        .map(|query| query.0)
        .map_err(|error| Problem::new(StatusCode::BAD_REQUEST, "malformed-parameter", error.body_text()))
}
