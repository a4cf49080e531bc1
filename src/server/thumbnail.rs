//! Thumbnails: a volume with a preset, small, for menus.
//!
//! They are frames like any other: rendered in the same queue, named by the same tags, remembered
//! as shortly.

use axum::extract::Path;
use axum::http::{HeaderMap, Method, StatusCode, Uri};
use axum::response::Response;

use super::frame::{Reply, answer};
use super::negotiate::negotiate;
use super::problem::Problem;
use super::query::Query;
use super::state::Pictures;
use relief_session::{FileFormat, Product, THUMBNAIL_SIZE_PX, thumbnail_scene};
use relief_volume::{PRESETS, preset};

/// A thumbnail has no use for depth.
const FORMATS: [FileFormat; 2] = [FileFormat::Png, FileFormat::Jpeg];

pub(super) async fn thumbnail(
    pictures: Pictures,
    Path((id, name)): Path<(String, String)>,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let entry = pictures.engine.volumes.find(&id)?;
    let preset = preset(&name).ok_or_else(unknown)?;
    let media = negotiate(&headers, &FORMATS)?;
    Query::of(&uri)?.expect_empty()?;
    let scene = thumbnail_scene(preset, &entry.subject(), THUMBNAIL_SIZE_PX)?;
    answer(&pictures, &entry, scene, &headers, Reply { method: Method::GET, product: Product::Frame, media })
        .await
}

fn unknown() -> Problem {
    let names: Vec<&str> = PRESETS.iter().map(|preset| preset.name).collect();
    let detail = format!("no preset has this name; there are {}", names.join(", "));
    Problem::new(StatusCode::NOT_FOUND, "unknown-preset", detail)
}
