//! True views: each view of a layout is rendered with the camera of its eye. `frame` makes all views of one
//! picture and its depth instead.
//!
//! The cameras are beside the scene's camera and converge on the plane of the screen. That plane follows
//! from the depth limits of the scene's own picture, so a layout of N views needs N + 1 pictures. They are
//! rendered one after the other, and each takes its turn in the render queue.

use std::sync::Arc;

use axum::body::Body;
use axum::extract::Path;
use axum::http::{HeaderMap, Method, Uri};
use axum::response::Response;
use axum::routing::{MethodRouter, get};

use super::frame::{
    SizeRule, entity_tag, not_modified, read_order, render, resolve, respond, with_annotations,
};
use super::negotiate::negotiate;
use super::problem::Problem;
use super::quality::within_budget;
use super::query::{Query, SceneQuery};
use super::state::{AppState, Pictures};
use relief_base::OutOfRange;
use relief_display::{DisplaySettings, Views, encode_views};
use relief_render::{RenderedFrame, Scene, eye_cameras, true_views, with_span_of_cone};
use relief_session::{EncodingError, FileFormat, VolumeEntry};

/// The routes: a scene in the query of a GET or in the body of a POST.
pub(super) fn routes() -> MethodRouter<AppState> {
    get(by_query).post(by_body)
}

async fn by_query(
    pictures: Pictures,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let entry = pictures.engine.volumes.find(&id)?;
    negotiate(&headers, &[FileFormat::Png])?;
    let query = Query::of(&uri)?;
    let answered = async {
        let order = SceneQuery::from_query(&query, &entry.grid)?;
        answer(&pictures, &entry, order, &headers, &Method::GET).await
    };
    answered.await.map_err(|problem| query.blame(problem))
}

async fn by_body(
    pictures: Pictures,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let entry = pictures.engine.volumes.find(&id)?;
    negotiate(&headers, &[FileFormat::Png])?;
    Query::of(&uri)?.expect_empty()?;
    let order = read_order(&pictures, &headers, body).await?;
    answer(&pictures, &entry, order, &headers, &Method::POST).await
}

async fn answer(
    pictures: &Pictures,
    entry: &Arc<VolumeEntry>,
    order: SceneQuery,
    headers: &HeaderMap,
    method: &Method,
) -> Result<Response, Problem> {
    let scene = resolve(order, entry, SizeRule::OfLayout)?;
    let layout = scene.display.layout;
    if layout.view_count() == 0 {
        let allowed = "a layout of views, such as stereo, views-9, lenses-9, anaglyph or wiggle";
        return Err(Problem::out_of_range(&OutOfRange::new("display.layout", layout.to_string(), allowed)));
    }
    with_annotations(pictures, entry, scene, headers, async |mut scene| {
        let quality = within_budget(&pictures.engine, entry, &mut scene);
        let media = FileFormat::Png;
        let tag = entity_tag(pictures, entry, &scene, "true views");
        if let Some(answer) = not_modified(pictures, headers, &tag, method) {
            return Ok(answer);
        }
        let middle = render(pictures, entry, &scene).await?;
        let frames = seen_by_eyes(pictures, entry, &scene, &middle.frame).await?;
        let display = scene.display.clone();
        let encoder = move |_: &RenderedFrame| packed(&frames, &display);
        Ok(quality.mark(respond(pictures, entry, &scene, &middle, (media, &tag), encoder).await?))
    })
    .await
}

/// The pictures of the layout's eyes, from left to right.
async fn seen_by_eyes(
    pictures: &Pictures,
    entry: &VolumeEntry,
    scene: &Scene,
    middle: &RenderedFrame,
) -> Result<Vec<Arc<RenderedFrame>>, Problem> {
    let limits = middle.limits_for(&scene.display)?;
    let display = with_span_of_cone(&scene.display, &middle.camera, middle.size_px, limits)?;
    let setup = true_views(&display, &middle.camera, middle.size_px, limits)
        .map_err(|error| Problem::from(&error))?;
    let eyes = display.encoder()?.eyes();
    let mut frames = Vec::with_capacity(eyes.len());
    let cameras = eye_cameras(&setup, &middle.camera, &eyes).map_err(|error| Problem::from(&error))?;
    for camera in cameras {
        let seen = Scene { request: scene.request.seen_by(camera), ..scene.clone() };
        frames.push(render(pictures, entry, &seen).await?.frame);
    }
    Ok(frames)
}

/// The views in the layout of the display.
fn packed(frames: &[Arc<RenderedFrame>], display: &DisplaySettings) -> Result<Vec<u8>, EncodingError> {
    let size_px = frames.first().map_or([0; 2], |frame| frame.size_px);
    let rgb = |frame: &Arc<RenderedFrame>| frame.color_rgba.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect();
    let views = Views::new(size_px, frames.iter().map(rgb).collect())?;
    Ok(encode_views(display.layout, &views, display.encoder()?.panel())?)
}
