//! Frames, depth and picks: from a scene in a query or a body to the picture, its depth or a point
//! in it.
//!
//! The order of things: volume, media type, scene, its budget of time, then the `ETag`, and only
//! then the render queue. Encoding runs on blocking threads. A client that leaves drops its
//! handler, and with it the order.

use std::sync::Arc;
use std::time::Instant;

use axum::Json;
use axum::body::{Body, Bytes};
use axum::extract::Path;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{MethodRouter, get};
use data_encoding::HEXLOWER;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use super::annotations::draw;
use super::camera::camera_json;
use super::guard::read_body;
use super::negotiate::{knows_tag, negotiate};
use super::problem::Problem;
use super::quality::within_budget;
use super::query::{Query, SceneQuery};
use super::state::{AppState, Pictures};
use relief_annotation::value_at;
use relief_base::{OutOfRange, Patient, Point};
use relief_render::{PictureWarning, RenderedFrame, Scene, depth_limits};
use relief_session::{
    EncodingError, FileFormat, LeftOutCounts, Origin, Product, Rendered, VolumeEntry, encode,
};

/// A browser revalidates after a minute, and gets 304 for unchanged pictures.
const CACHE_CONTROL: &str = "private, max-age=60";

/// Largest scene in a body: 1024 control points and 12 planes fit several times.
pub(super) const SCENE_BYTES: usize = 1 << 20;

static RELIEF_ANNOTATIONS: HeaderName = HeaderName::from_static("relief-annotations");
static RELIEF_CAMERA: HeaderName = HeaderName::from_static("relief-camera");
static RELIEF_WARNING: HeaderName = HeaderName::from_static("relief-warning");
static SERVER_TIMING: HeaderName = HeaderName::from_static("server-timing");

/// The routes of a product: a scene in the query of a GET or in the body of a POST.
pub(super) fn routes(product: Product) -> MethodRouter<AppState> {
    let by_query = move |pictures: Pictures, Path(id): Path<String>, uri: Uri, headers: HeaderMap| async move {
        by_query(&pictures, &id, &uri, &headers, product).await
    };
    let by_body = move |pictures: Pictures,
                        Path(id): Path<String>,
                        uri: Uri,
                        headers: HeaderMap,
                        body: Body| async move {
        by_body(&pictures, &id, &uri, &headers, body, product).await
    };
    get(by_query).post(by_body)
}

/// A slice, by its query.
pub(super) async fn get_slice(
    pictures: Pictures,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let entry = pictures.engine.volumes.find(&id)?;
    let media = negotiate(&headers, Product::Frame.formats())?;
    answer_query(&pictures, &entry, &Query::of_slice(&uri)?, &headers, Product::Frame, media).await
}

pub(super) async fn get_pick(
    pictures: Pictures,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Json<Value>, Problem> {
    let entry = pictures.engine.volumes.find(&id)?;
    let mut query = Query::of(&uri)?;
    let at = [query.take_number("u")?, query.take_number("v")?];
    let picked = async {
        let mut scene = resolve(SceneQuery::from_query(&query, &entry.grid)?, &entry, SizeRule::Any)?;
        draw(&pictures, &entry, &mut scene, &headers).await?;
        pick(&pictures, &entry, scene, at).await
    };
    picked.await.map_err(|problem| query.blame(problem))
}

pub(super) async fn post_pick(
    pictures: Pictures,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> Result<Json<Value>, Problem> {
    let entry = pictures.engine.volumes.find(&id)?;
    let mut query = Query::of(&uri)?;
    let at = [query.take_number("u")?, query.take_number("v")?];
    query.expect_empty()?;
    let order = read_order(&pictures, &headers, body).await?;
    let mut scene = resolve(order, &entry, SizeRule::Any)?;
    draw(&pictures, &entry, &mut scene, &headers).await?;
    pick(&pictures, &entry, scene, at).await
}

async fn by_query(
    pictures: &Pictures,
    id: &str,
    uri: &Uri,
    headers: &HeaderMap,
    product: Product,
) -> Result<Response, Problem> {
    let entry = pictures.engine.volumes.find(id)?;
    let media = negotiate(headers, product.formats())?;
    answer_query(pictures, &entry, &Query::of(uri)?, headers, product, media).await
}

async fn answer_query(
    pictures: &Pictures,
    entry: &Arc<VolumeEntry>,
    query: &Query,
    headers: &HeaderMap,
    product: Product,
    media: FileFormat,
) -> Result<Response, Problem> {
    let answered = async {
        let order = SceneQuery::from_query(query, &entry.grid)?;
        let scene = resolve(order, entry, SizeRule::of(product, media))?;
        let reply = Reply { method: Method::GET, product, media };
        with_annotations(pictures, entry, scene, headers, async |scene| {
            answer(pictures, entry, scene, headers, reply).await
        })
        .await
    };
    answered.await.map_err(|problem| query.blame(problem))
}

async fn by_body(
    pictures: &Pictures,
    id: &str,
    uri: &Uri,
    headers: &HeaderMap,
    body: Body,
    product: Product,
) -> Result<Response, Problem> {
    let entry = pictures.engine.volumes.find(id)?;
    let media = negotiate(headers, product.formats())?;
    Query::of(uri)?.expect_empty()?;
    let scene = resolve(read_order(pictures, headers, body).await?, &entry, SizeRule::of(product, media))?;
    let reply = Reply { method: Method::POST, product, media };
    with_annotations(pictures, &entry, scene, headers, async |scene| {
        answer(pictures, &entry, scene, headers, reply).await
    })
    .await
}

/// Draws the annotations that the scene wants, and answers.
pub(super) async fn with_annotations(
    pictures: &Pictures,
    entry: &Arc<VolumeEntry>,
    mut scene: Scene,
    headers: &HeaderMap,
    answer: impl AsyncFnOnce(Scene) -> Result<Response, Problem>,
) -> Result<Response, Problem> {
    // Before the tag: annotations are part of the scene, so the tag changes with them.
    let drawn = draw(pictures, entry, &mut scene, headers).await?;
    let mut answered = answer(scene).await?;
    if let Some(LeftOutCounts { drawn, left_out, unlabelled }) = drawn {
        let headers = answered.headers_mut();
        let silent = if unlabelled > 0 { format!(", unlabelled={unlabelled}") } else { String::new() };
        headers.insert(&RELIEF_ANNOTATIONS, ascii(&format!("drawn={drawn}, left_out={left_out}{silent}")));
        headers.insert(header::VARY, HeaderValue::from_static("Accept, Relief-Author"));
    }
    Ok(answered)
}

pub(super) async fn read_order(
    pictures: &Pictures,
    headers: &HeaderMap,
    body: Body,
) -> Result<SceneQuery, Problem> {
    super::guard::expect_content_type(headers, "application/json")?;
    let body = read_body(body, SCENE_BYTES, pictures.config.body_timeout).await?;
    SceneQuery::from_body(&body)
}

/// The sizes that a scene may have. A scene without a size gets the layout's in both cases.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SizeRule {
    /// The answer is a frame in a layout, which may fix the size.
    OfLayout,
    /// The answer is only the picture or only its depth.
    Any,
}

impl SizeRule {
    fn of(product: Product, media: FileFormat) -> Self {
        if (product, media) == (Product::Frame, FileFormat::Png) { Self::OfLayout } else { Self::Any }
    }
}

/// The complete scene. A size that contradicts the layout is refused where the answer has that
/// layout, and a depth limit that contradicts the volume's always: nothing is rendered for what
/// cannot be answered.
pub(super) fn resolve(order: SceneQuery, entry: &VolumeEntry, rule: SizeRule) -> Result<Scene, Problem> {
    let scene = order.file.resolve_for(&entry.subject(), &order.orbit)?;
    if rule == SizeRule::OfLayout {
        scene.expect_size_of_layout()?;
    }
    scene.display.limits(depth_limits(&scene.request.camera, &entry.grid))?;
    Ok(scene)
}

/// The answer to a request for a picture.
pub(super) struct Reply {
    pub(super) method: Method,
    pub(super) product: Product,
    pub(super) media: FileFormat,
}

/// As [`Reply`], for callers that make tag and picture themselves.
pub(super) struct Tagged<'a> {
    pub(super) method: Method,
    pub(super) media: FileFormat,
    pub(super) tag: &'a str,
}

/// Answers with 304 if the tag matches, else renders and encodes.
pub(super) async fn answer(
    pictures: &Pictures,
    entry: &Arc<VolumeEntry>,
    mut scene: Scene,
    headers: &HeaderMap,
    reply: Reply,
) -> Result<Response, Problem> {
    let Reply { method, product, media } = reply;
    let quality = within_budget(&pictures.engine, entry, &mut scene);
    let tag = entity_tag(pictures, entry, &scene, &format!("{} {}", product.name(), media.media_type()));
    let display = scene.display.clone();
    let job = move |frame: &RenderedFrame| encode(frame, &display, product, media);
    let answered =
        answer_as(pictures, entry, &scene, headers, Tagged { method, media, tag: &tag }, job).await?;
    Ok(quality.mark(answered))
}

/// As [`answer`], with the caller's tag and encoder.
pub(super) async fn answer_as(
    pictures: &Pictures,
    entry: &Arc<VolumeEntry>,
    scene: &Scene,
    headers: &HeaderMap,
    Tagged { method, media, tag }: Tagged<'_>,
    encoder: impl FnOnce(&RenderedFrame) -> Result<Vec<u8>, EncodingError> + Send + 'static,
) -> Result<Response, Problem> {
    if let Some(answer) = not_modified(pictures, headers, tag, &method) {
        return Ok(answer);
    }
    let rendered = render(pictures, entry, scene).await?;
    respond(pictures, entry, scene, &rendered, (media, tag), encoder).await
}

/// The response with a rendered picture: its bytes from the encoder, its camera, its warning.
pub(super) async fn respond(
    pictures: &Pictures,
    entry: &Arc<VolumeEntry>,
    scene: &Scene,
    rendered: &Rendered,
    (media, tag): (FileFormat, &str),
    encoder: impl FnOnce(&RenderedFrame) -> Result<Vec<u8>, EncodingError> + Send + 'static,
) -> Result<Response, Problem> {
    let (display, request, entry) = (scene.display.clone(), scene.request.clone(), Arc::clone(entry));
    let encoder = move |frame: &RenderedFrame| {
        let camera = camera_json(&frame.camera, frame.size_px, frame.limits_for(&display)?).to_string();
        let warning = PictureWarning::of(frame, &display, &request, &entry.subject(), entry.range_hu);
        let bytes = encoder(frame).map_err(|error| match error {
            EncodingError::Settings(error) => Problem::from(error),
            other => Problem::internal("encoding", other),
        })?;
        Ok(Encoded { bytes: bytes.into(), camera, warning })
    };
    let (Encoded { bytes, camera, warning }, encode_ms) = encode_apart(pictures, rendered, encoder).await?;
    let mut response = (validators(tag), bytes).into_response();
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(media.media_type()));
    headers.insert(&SERVER_TIMING, ascii(&timing(rendered, encode_ms)));
    headers.insert(&RELIEF_CAMERA, ascii(&camera));
    if let Some(warning) = warning {
        headers.insert(&RELIEF_WARNING, ascii(&format!("{}; {warning}", warning.code())));
    }
    Ok(response)
}

pub(super) async fn render(
    pictures: &Pictures,
    entry: &VolumeEntry,
    scene: &Scene,
) -> Result<Rendered, Problem> {
    // Before the voxels: a request that waits must not keep them in memory.
    let _turn = pictures.turns.take(pictures.caller.as_ref()).await;
    let volume = pictures.engine.voxels(entry).await?;
    let ticket = pictures.engine.service.render_for(pictures.caller.clone(), &volume, scene.request.clone());
    drop(volume); // the order has its own
    let outcome = match ticket {
        Ok(ticket) => ticket.await,
        Err(refused) => Err(refused),
    };
    pictures.metrics.rendered(&outcome);
    if !pictures.engine.volumes.has(entry) {
        // Removed since it was found: the frame must not outlive it.
        pictures.engine.service.forget(entry.hash);
    }
    Ok(outcome?)
}

/// A picture as bytes, and the content of its headers.
struct Encoded {
    bytes: Bytes,
    /// Its camera and depth limits, JSON.
    camera: String,
    warning: Option<PictureWarning>,
}

/// Encodes on a blocking thread, as many at a time as there are cores, those whose clients have
/// left included; and the milliseconds that it took. Work on all pixels would delay other requests on
/// the threads of the runtime.
async fn encode_apart(
    pictures: &Pictures,
    rendered: &Rendered,
    encoder: impl FnOnce(&RenderedFrame) -> Result<Encoded, Problem> + Send + 'static,
) -> Result<(Encoded, f64), Problem> {
    let frame = Arc::clone(&rendered.frame);
    let since = Instant::now();
    let encoded = pictures.engine.encoding(frame.size_px, move || encoder(&frame)).await??;
    Ok((encoded, since.elapsed().as_secs_f64() * 1e3))
}

async fn pick(
    pictures: &Pictures,
    entry: &VolumeEntry,
    mut scene: Scene,
    at: [f64; 2],
) -> Result<Json<Value>, Problem> {
    let pixel = pixel_at(at, scene.request.size_px)?;
    within_budget(&pictures.engine, entry, &mut scene);
    let frame = render(pictures, entry, &scene).await?.frame;
    let limits = frame.limits_for(&scene.display)?;
    let depth = frame.depth_at(pixel);
    let mut found = camera_json(&frame.camera, frame.size_px, limits);
    found["u"] = json!(at[0]);
    found["v"] = json!(at[1]);
    found["pixel"] = json!(pixel);
    found["hit"] = json!(depth.is_hit());
    found["hu"] = Value::Null;
    found["unit"] = entry.anatomy.quantity().unit().into();
    found["depth_mm"] = depth.is_hit().then_some(depth.0).into();
    let point = frame.pick(pixel);
    found["patient_mm"] = point.map(|point| point.xyz.to_array()).map_or(Value::Null, Value::from);
    if let Some(point) = point {
        let volume = pictures.engine.voxels(entry).await?;
        found["hu"] = json!(value_at(&volume, point));
    }
    let segment = point.zip(entry.labels.as_ref()).and_then(|(point, labels)| labels.at(point));
    found["segment"] = segment.map(|segment| json!({ "label": segment.label, "name": segment.name })).into();
    Ok(Json(found))
}

/// The picture of a scene with its annotations, within its budget of time.
pub(super) async fn picture_of(
    pictures: &Pictures,
    entry: &VolumeEntry,
    order: SceneQuery,
    headers: &HeaderMap,
) -> Result<Arc<RenderedFrame>, Problem> {
    let mut scene = resolve(order, entry, SizeRule::Any)?;
    draw(pictures, entry, &mut scene, headers).await?;
    within_budget(&pictures.engine, entry, &mut scene);
    Ok(render(pictures, entry, &scene).await?.frame)
}

/// The patient position that a pixel of a scene's picture shows, if any, and where its eye is.
pub(super) async fn pick_scene(
    pictures: &Pictures,
    entry: &VolumeEntry,
    scene: &[u8],
    at: [f64; 2],
) -> Result<(Option<Point<Patient>>, Point<Patient>), Problem> {
    let mut scene = resolve(SceneQuery::from_body(scene)?, entry, SizeRule::Any)?;
    let pixel = pixel_at(at, scene.request.size_px)?;
    within_budget(&pictures.engine, entry, &mut scene);
    let frame = render(pictures, entry, &scene).await?.frame;
    Ok((frame.pick(pixel), frame.camera.eye()))
}

/// The pixel (column, row) that holds a point of the picture.
fn pixel_at(at: [f64; 2], size_px: [u32; 2]) -> Result<[u32; 2], Problem> {
    for ((name, value), side) in ["u", "v"].into_iter().zip(at).zip(size_px) {
        if !(0.0..f64::from(side)).contains(&value) {
            let allowed = format!("0 to below {side}, pixels of the picture");
            return Err(Problem::out_of_range(&OutOfRange::new(name, value, allowed)));
        }
    }
    Ok(at.map(|value| value as u32))
}

/// A name for the bytes that this order gives: everything that decides them goes into the hash.
///
/// The scene enters by forms that are the same in every process
/// ([`relief_render::RenderRequest::stable_bytes`], JSON), so that servers of one build before
/// adapters of one kind agree, and one may answer for another. `form` is how the picture is
/// written.
pub(super) fn entity_tag(pictures: &Pictures, entry: &VolumeEntry, scene: &Scene, form: &str) -> String {
    let Scene { request, display, budget_ms, annotations, frame: _, chosen: _ } = scene;
    let around = json!([pictures.config.identity, form, display, budget_ms, annotations]).to_string();
    let hash = Sha256::new()
        .chain_update(entry.hash.0)
        .chain_update(around)
        .chain_update(request.stable_bytes())
        .finalize();
    let digits = HEXLOWER.encode(&hash[..16]);
    // Weak: another adapter of the same name may round a pixel another way.
    format!("W/\"{digits}\"")
}

/// 304 for a GET, and 412 for a POST, whose `If-None-Match` matches the answer (RFC 9110, 13.1.2).
pub(super) fn not_modified(
    pictures: &Pictures,
    headers: &HeaderMap,
    tag: &str,
    method: &Method,
) -> Option<Response> {
    let status =
        if *method == Method::GET { StatusCode::NOT_MODIFIED } else { StatusCode::PRECONDITION_FAILED };
    knows_tag(headers, tag).then(|| {
        pictures.metrics.not_modified();
        (status, validators(tag)).into_response()
    })
}

fn validators(tag: &str) -> HeaderMap {
    HeaderMap::from_iter([
        (header::ETAG, ascii(tag)),
        (header::CACHE_CONTROL, HeaderValue::from_static(CACHE_CONTROL)),
        (header::VARY, HeaderValue::from_static("Accept")),
    ])
}

fn timing(rendered: &Rendered, encode_ms: f64) -> String {
    let queue_ms = rendered.queue_ms;
    let timings = rendered.frame.timings;
    match rendered.origin {
        Origin::Reused => {
            format!("queue;dur={queue_ms:.2}, render;dur=0;desc=reused, encode;dur={encode_ms:.2}")
        }
        Origin::Rendered => format!(
            "queue;dur={queue_ms:.2}, upload;dur={:.2}, render;dur={:.2}, overlay;dur={:.2}, encode;dur={encode_ms:.2}",
            timings.upload_ms, timings.render_ms, timings.overlay_ms
        ),
    }
}

/// A header of our own making: digits, names and JSON of numbers.
fn ascii(text: &str) -> HeaderValue {
    HeaderValue::from_str(text).unwrap_or_else(|_| HeaderValue::from_static(""))
}
