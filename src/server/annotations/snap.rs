//! `POST .../annotations/snap`: the place near another one that was meant, by the volume's values.

use std::sync::Arc;

use axum::Json;
use axum::http::StatusCode;
use serde::Deserialize;
use serde_json::{Map, Value, json};

use super::edit::parse;
use super::{Asked, Sent};
use crate::blocking::on_blocking_thread;
use crate::frame::pick_scene;
use crate::problem::Problem;
use crate::resident::with_voxels;
use crate::state::Server;
use crate::volumes::Entry;
use relief_annotation::{Snap, SnapError, SnapFeature, Snapped, snap_point as snapped};
use relief_base::{Patient, Point, Vector};
use relief_render::RequestError;

/// Largest body: a scene with all it may have.
const MOST_BYTES: usize = 1 << 20;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SnapBody {
    at_mm: Option<[f64; 3]>,
    /// The line of sight through `at_mm`, of any length but zero; both directions of it count.
    ray: Option<[f64; 3]>,
    /// A pixel of the picture of this scene.
    pixel: Option<[f64; 2]>,
    #[serde(default)]
    scene: Map<String, Value>,
    to: String,
    hu: Option<f64>,
    radius_mm: Option<f64>,
}

pub(super) async fn snap(asked: Asked, Sent(body): Sent<MOST_BYTES>) -> Result<Json<Value>, Problem> {
    let Asked { server, entry, .. } = asked;
    let body: SnapBody = parse(body.to_string().as_bytes())?;
    let wanted =
        Snap { to: target(&body.to, body.hu)?, radius_mm: body.radius_mm.unwrap_or(Snap::DEFAULT_RADIUS_MM) };
    let (at, ray) = match (body.at_mm, body.pixel) {
        (Some(at_mm), None) => {
            let ray = body.ray.map(|ray| Vector::<Patient>::from_xyz(ray.into()));
            (Point::<Patient>::from_xyz(at_mm.into()), ray)
        }
        (None, Some(_)) if body.ray.is_some() => {
            let error = refuse("ray", "there", "nothing beside a pixel, whose own line of sight counts");
            return Err(Problem::out_of_range(&error));
        }
        (None, Some(pixel)) => {
            let scene = Value::Object(body.scene).to_string();
            let (at, eye) = pick_scene(&server, &entry, scene.as_bytes(), pixel).await?;
            let nothing = || {
                let detail = "the pixel shows nothing of the volume";
                Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "nothing-there", detail).with("path", "pixel")
            };
            let at = at.ok_or_else(nothing)?;
            (at, Some(at - eye))
        }
        _ => {
            let error = refuse("at_mm", "none or both of at_mm and pixel", "one of them");
            return Err(Problem::out_of_range(&error));
        }
    };
    let found = snap_in(&server, &entry, (at, ray), wanted).await?;
    found.map(|found| Json(answer(at, &found))).map_err(|error| refused(&error))
}

fn answer(from: Point<Patient>, found: &Snapped) -> Value {
    json!({
        "at_mm": found.at.xyz.to_array(),
        "from_mm": from.xyz.to_array(),
        "shift_mm": found.shift.xyz.to_array(),
        "distance_mm": Vector::length(found.shift),
        "hu": found.hu,
        "gradient_hu_per_mm": found.gradient_hu_per_mm,
    })
}

/// A target by its name.
///
/// # Errors
/// When there is none of that name, or a level is missing or has no meaning.
pub(crate) fn target(to: &str, hu: Option<f64>) -> Result<SnapFeature, Problem> {
    let target = match (to, hu) {
        ("surface", Some(hu)) => SnapFeature::Surface { hu },
        ("boundary", None) => SnapFeature::Boundary,
        ("gradient", None) => SnapFeature::Gradient,
        ("minimum", None) => SnapFeature::Minimum,
        ("maximum", None) => SnapFeature::Maximum,
        ("surface", None) => {
            let allowed = "the level of the surface, HU, or to boundary";
            return Err(Problem::out_of_range(&refuse("hu", "missing", allowed)));
        }
        (name, Some(_)) if SnapFeature::NAMES.contains(&name) => {
            return Err(Problem::out_of_range(&refuse(
                "hu",
                "there",
                "nothing beside another target than surface",
            )));
        }
        _ => {
            return Err(Problem::out_of_range(&refuse(
                "to",
                &format!("{to:?}"),
                &SnapFeature::NAMES.join(", "),
            )));
        }
    };
    Ok(target)
}

/// Snaps on a blocking thread, in turn with the encoders.
pub(crate) async fn snap_in(
    server: &Arc<Server>,
    entry: &Arc<Entry>,
    (at, ray): (Point<Patient>, Option<Vector<Patient>>),
    wanted: Snap,
) -> Result<Result<Snapped, SnapError>, Problem> {
    let volume = with_voxels(server, entry).await?;
    let place = Arc::clone(&server.encoders).acquire_owned().await;
    let place = place.map_err(|closed| Problem::internal("snapping", closed))?;
    on_blocking_thread(place, "snapping", move || snapped(&volume, at, ray, &wanted)).await
}

fn refuse(path: &str, found: &str, allowed: &str) -> RequestError {
    RequestError {
        path: path.to_owned(),
        found: found.chars().take(60).collect(),
        allowed: allowed.to_owned(),
    }
}

fn refused(error: &SnapError) -> Problem {
    match error {
        SnapError::OutOfRange { key, found, allowed } => Problem::out_of_range(&refuse(key, found, allowed)),
        SnapError::NotFound { radius_mm, .. } => {
            Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "nothing-to-snap-to", error)
                .with("radius_mm", *radius_mm)
        }
    }
}
