//! `POST .../annotations/snap`: the place near another one that was meant, by the volume's values.

use axum::Json;
use axum::http::StatusCode;
use serde::Deserialize;
use serde_json::{Map, Value, json};

use super::asked::{EditRequest, JsonBody};
use super::edit::parse_value;
use crate::frame::pick_scene;
use crate::problem::Problem;
use relief_annotation::{Snap, SnapFeature, Snapped};
use relief_base::{OutOfRange, Patient, Point, Vector};

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

pub(super) async fn snap(
    asked: EditRequest,
    JsonBody(body): JsonBody<MOST_BYTES>,
) -> Result<Json<Value>, Problem> {
    let EditRequest { pictures, entry, .. } = asked;
    let body: SnapBody = parse_value(body)?;
    let wanted = Snap {
        to: SnapFeature::from_name(&body.to, body.hu)?,
        radius_mm: body.radius_mm.unwrap_or(Snap::DEFAULT_RADIUS_MM),
    };
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
            let (at, eye) = pick_scene(&pictures, &entry, scene.as_bytes(), pixel).await?;
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
    let found = pictures.engine.snap(&entry, at, ray, wanted).await??;
    let mut answer = answer(at, &found);
    answer["unit"] = entry.anatomy.quantity().unit().into();
    Ok(Json(answer))
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

fn refuse(path: &str, found: &str, allowed: &str) -> OutOfRange {
    OutOfRange::new(path, found.chars().take(60).collect::<String>(), allowed)
}
