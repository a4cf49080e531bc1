//! `/v1/volumes`: the list of volumes, their descriptions and their removal. Answers hold geometry
//! and values, nothing about the patient.

use std::collections::BTreeMap;
use std::sync::Arc;

use axum::Json;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use serde_json::{Value, json};

use super::live::Live;
use super::problem::Problem;
use relief_dicom::WarningCode;
use relief_render::TISSUE_VIEW;
use relief_session::{Engine, VolumeEntry};
use relief_volume::{LabelMap, Segment};

/// The description of a volume.
pub(super) fn describe(entry: &VolumeEntry) -> Value {
    let grid = &entry.grid;
    let (low, high) = entry.range_hu;
    let bounds = grid.bounds();
    let path = format!("/v1/volumes/{}", entry.id);
    json!({
        "id": entry.id,
        "name": entry.name(),
        "dims": grid.dims(),
        "spacing_mm": grid.spacing_mm(),
        "origin_mm": grid.origin().xyz.to_array(),
        "direction": grid.direction(),
        "center_mm": grid.center().xyz.to_array(),
        "radius_mm": grid.bounding_radius_mm(),
        "framing": {
            "center_mm": entry.framing.center().xyz.to_array(),
            "radius_mm": entry.framing.radius_mm(&TISSUE_VIEW, 1.0),
            "narrowest_aspect": entry.framing.narrowest_aspect(),
        },
        "anatomy": {
            "part": entry.anatomy.part.name(),
            "contrast": entry.anatomy.has_contrast,
            "metal": entry.anatomy.has_metal,
            "preset": entry.anatomy.preset().map(|preset| preset.name),
            "window_hu": entry.anatomy.window_hu(),
        },
        "bounds_mm": [bounds.min.xyz.to_array(), bounds.max.xyz.to_array()],
        "hu_range": [low, high],
        "unit": entry.anatomy.quantity().unit(),
        "phase": entry.phase().map(|phase| json!({
            "number": phase.number,
            "count": phase.count,
            "series": entry.region.short(),
        })),
        "segments": entry.labels.as_deref().map(segments),
        "warnings": entry.warnings.len(),
        "reading_warnings": reading_warnings(&entry.warnings),
        "removable": entry.is_upload(),
        "links": { "self": path, "frame": format!("{path}/frame") },
    })
}

/// The warnings of the reader by their codes: names of files stay with the operator.
fn reading_warnings(warnings: &[WarningCode]) -> Vec<Value> {
    let mut counts = BTreeMap::<WarningCode, usize>::new();
    for warning in warnings {
        *counts.entry(*warning).or_default() += 1;
    }
    let described =
        |(code, count): (WarningCode, usize)| json!({ "code": code, "count": count, "text": code.summary() });
    counts.into_iter().map(described).collect()
}

/// The segments of a label map, by rising label, with the colours in which they are drawn.
fn segments(map: &LabelMap) -> Vec<Value> {
    let segment = |(segment, voxels): (&Segment, u64)| {
        json!({
            "label": segment.label,
            "name": segment.name,
            "rgb": segment.color(),
            "voxels": voxels,
            "volume_ml": voxels as f64 * map.voxel_mm3() / 1000.0,
        })
    };
    map.counted().map(segment).collect()
}

pub(super) async fn list(State(engine): State<Arc<Engine>>) -> Json<Value> {
    let (entries, loading) = engine.volumes.list();
    let volumes: Vec<Value> = entries.iter().map(|entry| describe(entry)).collect();
    Json(json!({ "volumes": volumes, "loading": loading }))
}

pub(super) async fn show(
    State(engine): State<Arc<Engine>>,
    Path(id): Path<String>,
) -> Result<Json<Value>, Problem> {
    Ok(Json(describe(&*engine.volumes.find(&id)?)))
}

pub(super) async fn remove(
    State(engine): State<Arc<Engine>>,
    State(live): State<Arc<Live>>,
    Path(id): Path<String>,
) -> Result<StatusCode, Problem> {
    let removed = engine.volumes.remove(&id)?;
    engine.service.forget(removed.hash);
    live.views.wake();
    Ok(StatusCode::NO_CONTENT)
}
