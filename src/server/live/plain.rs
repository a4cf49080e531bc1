//! Live views for viewers without a WebSocket: a stream of JPEGs, one frame at a time, and intents
//! by POST.

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
use tokio::sync::watch;

use super::audience::join;
use super::hub::{Place, no_such_view};
use super::placing::{LandmarkPlacer, apply_effect, pointer};
use crate::annotations::author_of;
use crate::guard::{expect_content_type, read_body};
use crate::identity::Caller;
use crate::negotiate::negotiate;
use crate::problem::Problem;
use crate::state::{LiveParts, Started};
use relief_display::encode_png;
use relief_live::{
    ColorFormat, DepthFormat, Intent, MAX_TEXT_BYTES, PlacePhase, Role, Settings, check_view_name,
};
use relief_session::{FileFormat, LiveError, Outcome, Presentation, View, ViewFrame, Viewer, search_preview};

pub(super) static RELIEF_FRAME: HeaderName = HeaderName::from_static("relief-frame");
const BOUNDARY: &str = "relief-frame-boundary";
const JPEG_QUALITY: u8 = 90;
/// Waits for a frame, ms.
const USUAL_WAIT_MS: u64 = 10_000;
const LONGEST_WAIT_MS: u64 = 30_000;

/// A viewer without acknowledgements; it leaves the view when dropped.
pub(super) struct PlainViewer {
    parts: LiveParts,
    view: Arc<View>,
    viewer: Arc<Viewer>,
    frames: watch::Receiver<Option<Arc<ViewFrame>>>,
    _place: Place,
}

impl PlainViewer {
    pub(super) async fn new(parts: LiveParts, caller: &Caller, name: &str) -> Result<Self, Problem> {
        let view = find_view(&parts, name)?;
        let place = parts.live.place(caller)?;
        let viewer = join(&parts, &view, Role::Watcher, true, caller).await;
        let mut frames = view.frames.subscribe();
        frames.mark_changed();
        Ok(Self { parts, view, viewer, frames, _place: place })
    }

    /// The next frame; `None` when the view has ended.
    async fn next(&mut self) -> Option<Arc<ViewFrame>> {
        let mut closing = self.parts.live.closing.subscribe();
        let mut ended = self.view.ended.subscribe();
        loop {
            tokio::select! {
                _ = closing.wait_for(|closing| *closing) => return None,
                _ = ended.wait_for(|ended| *ended) => return None,
                changed = self.frames.changed() => changed.ok()?,
            }
            let view_frame = self.frames.borrow_and_update().clone();
            if let Some(view_frame) = view_frame {
                self.viewer.flow().taken = view_frame.number;
                self.view.work.notify_one();
                return Some(view_frame);
            }
        }
    }

    /// The newest frame once it has full quality; `None` when the view has ended.
    pub(super) async fn still(&mut self) -> Option<Arc<ViewFrame>> {
        loop {
            let newest = self.next().await?;
            if newest.is_still && newest.revision == self.view.revision() {
                return Some(newest);
            }
        }
    }

    async fn jpeg(&self, view_frame: &Arc<ViewFrame>) -> Result<Bytes, Problem> {
        let parts =
            view_frame.parts(&self.parts.engine, ColorFormat::Jpeg, JPEG_QUALITY, DepthFormat::None).await?;
        let (color, _) = parts.get().ok_or_else(|| Problem::internal("encoding", "nothing was made"))?;
        self.parts.metrics.live.sent(view_frame.is_still, color.bytes.len());
        Ok(color.bytes.clone().into())
    }

    async fn png(&self, view_frame: &Arc<ViewFrame>) -> Result<Bytes, Problem> {
        let still = view_frame.is_still;
        let view_frame = Arc::clone(view_frame);
        let job = move || Ok::<_, LiveError>(encode_png(&view_frame.composed()?));
        let encoded = self.parts.engine.blocking("encoding", job).await??;
        let png = encoded.map_err(|error| Problem::internal("encoding", error))?;
        self.parts.metrics.live.sent(still, png.len());
        Ok(png.into())
    }
}

impl Drop for PlainViewer {
    fn drop(&mut self) {
        self.view.leave(&self.viewer);
    }
}

/// `GET /v1/session/{view}/mjpeg`.
pub(crate) async fn mjpeg(
    State(parts): State<LiveParts>,
    Path(name): Path<String>,
    caller: Caller,
) -> Result<Response, Problem> {
    let viewer = PlainViewer::new(parts, &caller, &name).await?;
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
        let view_frame = viewer.next().await?;
        let jpeg = viewer.jpeg(&view_frame).await.ok()?;
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
    State(parts): State<LiveParts>,
    Path(name): Path<String>,
    uri: Uri,
    caller: Caller,
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
    let mut viewer = PlainViewer::new(parts, &caller, &name).await?;
    let mut newest = None;
    let waiting = async {
        while let Some(view_frame) = viewer.next().await {
            let is_new = view_frame.number > after && view_frame.revision == viewer.view.revision();
            // A frame for a display is worth the wait for the best one.
            let is_good = media == FileFormat::Jpeg || view_frame.is_still;
            newest = Some(view_frame).filter(|_| is_new).or_else(|| newest.take());
            if is_new && is_good {
                return;
            }
        }
    };
    let _ = tokio::time::timeout(Duration::from_millis(wait_ms), waiting).await;
    let no_store = (header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    let vary = (header::VARY, HeaderValue::from_static("Accept"));
    let Some(view_frame) = newest else {
        return Ok((StatusCode::NO_CONTENT, [no_store, vary]).into_response());
    };
    let bytes = match media {
        FileFormat::Jpeg => viewer.jpeg(&view_frame).await?,
        _ => viewer.png(&view_frame).await?,
    };
    let number = (RELIEF_FRAME.clone(), HeaderValue::from(view_frame.number));
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
    State(parts): State<LiveParts>,
    State(Started(started)): State<Started>,
    Path(name): Path<String>,
    uri: Uri,
    caller: Caller,
    headers: HeaderMap,
    body: Body,
) -> Result<Json<Value>, Problem> {
    check_name(&name)?;
    let IntentQuery { volume } = query(&uri)?;
    expect_content_type(&headers, "application/json")?;
    let body = read_body(body, MAX_TEXT_BYTES, parts.config.body_timeout).await?;
    let intent = Intent::from_json(&body).map_err(|error| {
        let is_object = serde_json::from_slice::<serde_json::Map<String, Value>>(&body).is_ok();
        let status = if is_object { StatusCode::UNPROCESSABLE_ENTITY } else { StatusCode::BAD_REQUEST };
        Problem::new(status, "malformed-intent", error).with("path", "intent")
    })?;
    // Nothing is held from one request to the next: what would be taken hold of is shown.
    let intent = match intent {
        Intent::Place { phase: PlacePhase::Take } => Intent::Place { phase: PlacePhase::Preview },
        other => other,
    };
    let now = Instant::now();
    let entry = volume.map(|id| parts.engine.volumes.find(&id)).transpose()?;
    let view = if let Some(view) = parts.live.views.find(&name) {
        if entry.is_some() {
            view.configure(&Settings::default(), entry.as_ref(), None, now)?;
        }
        view
    } else {
        let entry = entry.map_or_else(|| parts.engine.volumes.first(), Ok)?;
        parts.find_or_open(&name, Presentation::new(entry, &Settings::default(), None)?, &caller)?
    };
    // Times tell which changes are taken back together.
    let t_ns = u64::try_from(started.elapsed().as_nanos()).unwrap_or(u64::MAX);
    let Outcome { effects, context, refused, .. } = view.apply_intents(None, &[intent], t_ns, now);
    if let Some(error) = refused {
        return Err(error.into());
    }
    search_preview(&parts.engine, &view);
    let mut answer = json!({ "state": view.record(), "volume": view.entry().id });
    if !effects.is_empty() {
        let author = author_of(&headers)?;
        let task = parking_lot::Mutex::default();
        let hand =
            LandmarkPlacer { author: author.as_deref(), caller: &caller, task: &task, device: pointer() };
        for effect in effects {
            answer["next"] = json!(apply_effect(&parts, &view, &hand, effect, &context).await?.next);
        }
    }
    Ok(Json(answer))
}

/// The view of this name, which is kept for a while from now on.
pub(super) fn find_view(parts: &LiveParts, name: &str) -> Result<Arc<View>, Problem> {
    check_name(name)?;
    parts.live.views.find(name).ok_or_else(no_such_view)
}

fn check_name(name: &str) -> Result<(), Problem> {
    check_view_name(name).map_err(|error| {
        Problem::new(StatusCode::BAD_REQUEST, "malformed-name", error.source).with("path", "view")
    })
}

pub(super) fn query<T: serde::de::DeserializeOwned>(uri: &Uri) -> Result<T, Problem> {
    axum::extract::Query::<T>::try_from_uri(uri)
        .map(|query| query.0)
        .map_err(|error| Problem::new(StatusCode::BAD_REQUEST, "malformed-parameter", error.body_text()))
}
