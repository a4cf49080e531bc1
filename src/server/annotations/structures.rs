//! Structures over HTTP: regions that grow, are painted or filled, and meshes of them.
//!
//! The result is a content in the store, and an edit by the author of the request (see `order`).

use std::collections::HashSet;
use std::sync::Arc;

use axum::Json;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use data_encoding::BASE64;
use serde::Deserialize;
use serde_json::json;

use super::asked::{EditRequest, JsonBody};
use super::order::{LABEL, MOST_BYTES, NewStructure, unusable};
use crate::annotation_service::invalid;
use crate::problem::Problem;
use relief_annotation::{
    Change, Contour, Decimation, Geometry, Grow, GrowError, GrowLimits, Item, ItemId, MeshError, MeshFormat,
    MeshSummary, RefineStep, Smoothing, Stroke, Versioned, fill_contours as filled, grow_region as grown,
    paint_strokes as painted, refine_region, surface_nets, write_mesh as written,
};
use relief_base::{OutOfRange, Patient, Point};
use relief_session::Waiting;
use relief_volume::Mask;

/// Most curves between which one region is filled.
const MOST_CURVES: usize = 1000;

/// Media type of a mesh's content.
const MESH: &str = "model/ply";
/// Default limit of growing, ml: larger than any organ. A larger region has leaked.
const USUAL_ML: f64 = 5000.0;

type Mm = [f64; 3];

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct GrowBody {
    seed_mm: Mm,
    hu: [i16; 2],
    max_ml: Option<f64>,
    max_radius_mm: Option<f64>,
    neck_mm: Option<f64>,
    /// Measure the region, and make nothing.
    #[serde(default)]
    preview: bool,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PaintBody {
    center_mm: Mm,
    radius_mm: f64,
    mode: Stroke,
    /// The region to paint; `None` creates one.
    region: Option<ItemId>,
    version: Option<u64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RefineBody {
    region: ItemId,
    step: RefineStep,
    version: Option<u64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct FillBody {
    curves: Vec<ItemId>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct MeshBody {
    region: ItemId,
    /// Rounds of smoothing; 0 leaves the steps of voxels.
    smoothing: Option<u32>,
    /// Approximate number of triangles after decimation.
    triangles: Option<usize>,
}

pub(super) async fn grow(asked: EditRequest, body: JsonBody<MOST_BYTES>) -> Result<Response, Problem> {
    let (order, body) = NewStructure::read::<GrowBody>(asked, body, "Region")?;
    let GrowBody { seed_mm, hu, max_ml, max_radius_mm, neck_mm, preview } = body;
    let limits = GrowLimits { max_ml: max_ml.or(Some(USUAL_ML)), max_radius_mm, neck_mm };
    let wanted = Grow { seeds: vec![point(seed_mm)], hu, limits };
    let volume = order.asked.pictures.engine.voxels(&order.asked.entry).await?;
    let job = move |waiting: &Waiting| {
        grown(&volume, &wanted, &|_| waiting.is_there()).map_err(|error| not_grown(&error))
    };
    let found = order.work("growing a region", job).await?;
    if preview {
        let (voxels, volume_ml, ended) = (found.voxels, found.volume_ml, found.ended);
        let content = BASE64.encode(&order.file_of(found.mask, None).await?);
        let answer = json!({
            "voxels": voxels, "volume_ml": volume_ml, "ended": ended, "content": content, "label": LABEL,
        });
        return Ok(Json(answer).into_response());
    }
    let geometry = order.keep(found.mask, None).await?;
    order.create(geometry).await
}

pub(super) async fn paint(asked: EditRequest, body: JsonBody<MOST_BYTES>) -> Result<Response, Problem> {
    let (order, body) = NewStructure::read::<PaintBody>(asked, body, "Region")?;
    let PaintBody { center_mm, radius_mm, mode, region, version } = body;
    let known = match region {
        Some(region) => Some(order.find(region).await?),
        None => None,
    };
    let mask = match &known {
        Some(known) => match &known.item.geometry {
            Some(Geometry::Region(region)) => order.voxels(region).await?,
            _ => return Err(no_region(known.item.id)),
        },
        None => Mask::empty(order.asked.entry.grid.clone()),
    };
    let job = move |_: &Waiting| {
        let mut mask = mask;
        painted(&mut mask, point(center_mm), radius_mm, mode)
            .map_err(|error| Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "out-of-range", error))?;
        Ok(mask)
    };
    let mask = order.work("painting", job).await?;
    let geometry = order.keep(mask, known.as_ref().and_then(|known| known.item.rgb)).await?;
    let Some(known) = known else { return order.create(geometry).await };
    let item = Item { geometry: Some(geometry), ..known.item.clone() };
    let version = version.unwrap_or(known.version);
    order.change(Change::Update { item: Box::new(item), version }).await
}

/// Smooths a region, fills its holes or keeps its largest part. Where that changes nothing, there is no
/// edit.
pub(super) async fn refine(asked: EditRequest, body: JsonBody<MOST_BYTES>) -> Result<Response, Problem> {
    let (order, body) = NewStructure::read::<RefineBody>(asked, body, "Region")?;
    let RefineBody { region, step, version } = body;
    let known = order.find(region).await?;
    let Some(Geometry::Region(summary)) = &known.item.geometry else {
        return Err(no_region(known.item.id));
    };
    let mask = order.voxels(summary).await?;
    let job = move |_: &Waiting| {
        let refined = refine_region(&mask, step);
        Ok((refined != mask).then_some(refined))
    };
    let Some(refined) = order.work("refining a region", job).await? else {
        return Ok(Json(json!({ "events": [] })).into_response());
    };
    let geometry = order.keep(refined, known.item.rgb).await?;
    let item = Item { geometry: Some(geometry), ..known.item.clone() };
    let version = version.unwrap_or(known.version);
    order.change(Change::Update { item: Box::new(item), version }).await
}

pub(super) async fn fill(asked: EditRequest, body: JsonBody<MOST_BYTES>) -> Result<Response, Problem> {
    let (order, FillBody { curves }) = NewStructure::read(asked, body, "Region")?;
    let refuse =
        |found: &dyn std::fmt::Display, allowed: &str| invalid(&OutOfRange::new("curves", found, allowed));
    if curves.len() > MOST_CURVES {
        return Err(refuse(&curves.len(), &format!("up to {MOST_CURVES} curves")));
    }
    let mut met = HashSet::new();
    if let Some(twice) = curves.iter().find(|id| !met.insert(**id)) {
        return Err(refuse(twice, "each curve once"));
    }
    let known = order.find_all(&curves).await?;
    let grid = order.asked.entry.grid.clone();
    let job = move |_: &Waiting| {
        let contour = |known: &Arc<Versioned>| {
            let contour = known.item.geometry.as_ref().and_then(Contour::of);
            contour.ok_or_else(|| refuse(&known.item.id, "closed curves"))
        };
        let contours = known.iter().map(contour).collect::<Result<Vec<_>, _>>()?;
        filled(&grid, &contours).map_err(|error| unusable("curves", &error))
    };
    let mask = order.work("filling curves", job).await?;
    let geometry = order.keep(mask, None).await?;
    order.create(geometry).await
}

pub(super) async fn mesh(asked: EditRequest, body: JsonBody<MOST_BYTES>) -> Result<Response, Problem> {
    let (order, body) = NewStructure::read::<MeshBody>(asked, body, "Mesh")?;
    let MeshBody { region, smoothing, triangles } = body;
    let known = order.find(region).await?;
    let Some(Geometry::Region(region)) = &known.item.geometry else { return Err(no_region(known.item.id)) };
    let mask = order.voxels(region).await?;
    let name = order.name.clone();
    let smoothing = smoothing.map_or_else(Smoothing::default, |rounds| Smoothing { rounds });
    let job = move |waiting: &Waiting| {
        let refuse = |error: MeshError| unusable("region", &error);
        let mut mesh = surface_nets(&mask).map_err(refuse)?;
        waiting.expect()?;
        mesh = mesh.smoothed(smoothing).map_err(refuse)?;
        if let Some(triangles) = triangles {
            waiting.expect()?;
            mesh = mesh.decimated(Decimation::to(triangles)).map_err(refuse)?;
        }
        waiting.expect()?;
        let bytes = written(MeshFormat::Ply, &mesh, &name).map_err(refuse)?;
        Ok((bytes, mesh.vertices.len(), mesh.triangles.len(), mesh.measures()))
    };
    let (bytes, vertices, triangles, measures) = order.work("making a mesh", job).await?;
    let content = order.asked.keep_content(MESH, &bytes).await?;
    let count =
        |count: usize| u32::try_from(count).map_err(|error| Problem::internal("counting a mesh", error));
    let (area_mm2, volume_ml) = (measures.area_mm2, measures.volume_ml);
    let (vertices, triangles) = (count(vertices)?, count(triangles)?);
    order.create(Geometry::Mesh(MeshSummary { content, vertices, triangles, area_mm2, volume_ml })).await
}

fn point(mm: Mm) -> Point<Patient> {
    Point::from_xyz(mm.into())
}

fn no_region(id: ItemId) -> Problem {
    invalid(&OutOfRange::new("region", id, "an item that is a region"))
}

fn not_grown(error: &GrowError) -> Problem {
    let refuse = |kind| Problem::new(StatusCode::UNPROCESSABLE_ENTITY, kind, error);
    match error {
        GrowError::Leaked { reached_ml, allowed_ml } => {
            refuse("leaked").with("reached_ml", *reached_ml).with("allowed_ml", *allowed_ml)
        }
        GrowError::OutOfRange(error) => error.into(),
        GrowError::Outside { .. } | GrowError::Value { .. } => refuse("out-of-range").with("path", "seed_mm"),
        _ => refuse("not-grown"),
    }
}
