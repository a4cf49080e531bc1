//! Structures over HTTP: regions that grow, are painted or filled, and meshes of them.
//!
//! The work is done on blocking threads, one structure at a time, as it takes all cores. A client that leaves, or the deadline, ends
//! growing within a moment; the rest is short. What is made is a content in the store, and an edit by whoever asked.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use axum::Json;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::{Value, json};

use super::edit::{events_json, parse, read_json};
use super::refusal::{invalid, no_such_item};
use super::{Asked, Visible};
use crate::annotation::{
    Change, Geometry, Item, ItemError, ItemId, MeshSummary, Method, Placement, RegionSummary, Set, Versioned,
};
use crate::formats::seg_nrrd;
use crate::mesh::files::{MeshFormat, write as written};
use crate::mesh::{Decimation, Smoothing, TriangleMesh, surface_nets};
use crate::segmentation::{
    Contour, Grow, GrowError, Limits, Stroke, fill as filled, grow as grown, paint as painted,
};
use crate::server::blocking::on_blocking_thread;
use crate::server::problem::Problem;
use crate::server::resident::with_voxels;
use crate::server::state::Server;
use crate::session::region_of_content;
use crate::space::{Patient, Point};
use crate::volume::{Mask, Segment};

const MOST_BYTES: usize = 256 << 10;
/// Media types of contents.
const REGION: &str = "application/x-seg-nrrd";
const MESH: &str = "model/ply";
/// The label of a region in its content.
const LABEL: u16 = 1;
/// Regions that grow beyond this leak, where nobody says what is too large, ml: more than any organ.
const USUAL_ML: f64 = 5000.0;

type Shared = State<Arc<Server>>;
type Mm = [f64; 3];

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct GrowBody {
    seed_mm: Mm,
    hu: [i16; 2],
    max_ml: Option<f64>,
    max_radius_mm: Option<f64>,
    neck_mm: Option<f64>,
    /// How much it would be, and nothing is made.
    #[serde(default)]
    preview: bool,
    name: Option<String>,
    set: Option<String>,
    author: Option<String>,
    #[serde(default)]
    reason: String,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PaintBody {
    center_mm: Mm,
    radius_mm: f64,
    mode: Stroke,
    /// The region that is painted; a new one where there is none.
    region: Option<ItemId>,
    version: Option<u64>,
    name: Option<String>,
    set: Option<String>,
    author: Option<String>,
    #[serde(default)]
    reason: String,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct FillBody {
    curves: Vec<ItemId>,
    name: Option<String>,
    set: Option<String>,
    author: Option<String>,
    #[serde(default)]
    reason: String,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct MeshBody {
    region: ItemId,
    /// Rounds of smoothing; 0 leaves the steps of voxels.
    smoothing: Option<u32>,
    /// Decimated to about so many.
    triangles: Option<usize>,
    name: Option<String>,
    set: Option<String>,
    author: Option<String>,
    #[serde(default)]
    reason: String,
}

/// Who makes what into which set.
struct Order {
    asked: Asked,
    author: String,
    reason: String,
    name: String,
    set: String,
}

impl Order {
    fn new(
        asked: Asked,
        (author, reason): (Option<String>, String),
        (name, set): (Option<String>, Option<String>),
        usual_name: &str,
    ) -> Result<Self, Problem> {
        let author = asked.author(author)?;
        let name = name.unwrap_or_else(|| usual_name.to_owned());
        let set = set.unwrap_or_else(|| Set::DEFAULT.to_owned());
        // Before the work.
        let item = Item { set: set.clone(), ..item(&name, &author)? };
        item.validate().map_err(|error| invalid(&error))?;
        Ok(Self { asked, author, reason, name, set })
    }

    /// Makes an item of a geometry.
    async fn create(self, server: &Server, geometry: Geometry) -> Result<Response, Problem> {
        let placement = Placement { method: Method::Computed, device: None, camera: None, snapped_mm: None };
        let item = Item {
            set: self.set.clone(),
            state: crate::annotation::State::Defined,
            geometry: Some(geometry),
            placement: Some(placement),
            ..item(&self.name, &self.author)?
        };
        self.change(server, Change::Create { item: Box::new(item) }).await
    }

    async fn change(self, server: &Server, change: Change) -> Result<Response, Problem> {
        let Self { asked, author, reason, .. } = self;
        let events = asked.annotations.apply(&asked.entry, &author, &reason, vec![change]).await?;
        server.live.annotations_changed();
        Ok((StatusCode::CREATED, Json(json!({ "events": events_json(&events) }))).into_response())
    }

    /// An item that the author sees.
    async fn find(&self, id: ItemId) -> Result<Arc<Versioned>, Problem> {
        let snapshot = self.asked.annotations.snapshot(&self.asked.entry.frame_of_reference()).await?;
        let visible = Visible::new(&snapshot.sets, Some(&self.author));
        let known = snapshot.get(id).filter(|known| visible.sees(&known.item.set));
        known.cloned().ok_or_else(|| no_such_item(&id))
    }

    /// Does the work that takes all cores.
    async fn work<T: Send + 'static>(
        &self,
        what: &str,
        job: impl FnOnce() -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        let place = Arc::clone(&self.asked.annotations.structures).acquire_owned().await;
        let place = place.map_err(|closed| Problem::internal(what, closed))?;
        on_blocking_thread(place, what, job).await?
    }

    /// Keeps the voxels of a region.
    async fn keep(&self, mask: Mask, rgb: Option<Mm>) -> Result<Geometry, Problem> {
        let (voxels, volume_ml) = (mask.voxels(), mask.volume_ml());
        if voxels == 0 {
            let detail = "the region would have no voxel";
            return Err(Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "nothing-there", detail));
        }
        let segment = Segment::new(LABEL, Some(&self.name), rgb);
        let job = move || {
            seg_nrrd(&mask.to_labels(segment)).map_err(|error| Problem::internal("writing a region", error))
        };
        let bytes = self.work("writing a region", job).await?;
        let content = self.asked.annotations.store.put_content(REGION, &bytes).await?;
        Ok(Geometry::Region(RegionSummary { content, label: LABEL, voxels, volume_ml }))
    }

    /// The voxels of a region.
    async fn voxels(&self, region: &RegionSummary) -> Result<Mask, Problem> {
        let (_, bytes) = self.asked.annotations.store.content(&region.content).await?;
        let label = region.label;
        let job = move || region_of_content(&bytes, label).map_err(|reason| unusable("region", &reason));
        self.work("reading a region", job).await
    }
}

pub(super) async fn grow(
    State(server): Shared,
    Path(id): Path<String>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let asked = Asked::new(&server, &id, &headers)?;
    let body: GrowBody = read(&server, &headers, body).await?;
    let GrowBody { preview, name, set, author, reason, .. } = body;
    let limits = Limits {
        max_ml: body.max_ml.or(Some(USUAL_ML)),
        max_radius_mm: body.max_radius_mm,
        neck_mm: body.neck_mm,
    };
    let wanted = Grow { seeds: vec![point(body.seed_mm)], hu: body.hu, limits };
    let order = Order::new(asked, (author, reason), (name, set), "Region")?;
    let volume = with_voxels(&server, &order.asked.entry).await?;
    let stop = Stop::default();
    let stopped = Arc::clone(&stop.0);
    let job = move || {
        let goes_on = |_| !stopped.load(Ordering::Relaxed);
        grown(&volume, &wanted, &goes_on).map_err(|error| not_grown(&error))
    };
    let found = order.work("growing a region", job).await?;
    drop(stop);
    if preview {
        let (voxels, volume_ml) = (found.voxels, found.volume_ml);
        return Ok(
            Json(json!({ "voxels": voxels, "volume_ml": volume_ml, "ended": found.ended })).into_response()
        );
    }
    let geometry = order.keep(found.mask, None).await?;
    order.create(&server, geometry).await
}

pub(super) async fn paint(
    State(server): Shared,
    Path(id): Path<String>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let asked = Asked::new(&server, &id, &headers)?;
    let body: PaintBody = read(&server, &headers, body).await?;
    let PaintBody { center_mm, radius_mm, mode, region, version, name, set, author, reason } = body;
    let order = Order::new(asked, (author, reason), (name, set), "Region")?;
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
    let job = move || {
        let mut mask = mask;
        painted(&mut mask, point(center_mm), radius_mm, mode)
            .map_err(|error| Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "out-of-range", error))?;
        Ok(mask)
    };
    let mask = order.work("painting", job).await?;
    let geometry = order.keep(mask, known.as_ref().and_then(|known| known.item.rgb)).await?;
    let Some(known) = known else { return order.create(&server, geometry).await };
    let item = Item { geometry: Some(geometry), ..known.item.clone() };
    let version = version.unwrap_or(known.version);
    order.change(&server, Change::Update { item: Box::new(item), version }).await
}

pub(super) async fn fill(
    State(server): Shared,
    Path(id): Path<String>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let asked = Asked::new(&server, &id, &headers)?;
    let FillBody { curves, name, set, author, reason } = read(&server, &headers, body).await?;
    let order = Order::new(asked, (author, reason), (name, set), "Region")?;
    let mut contours = Vec::new();
    for id in curves {
        let known = order.find(id).await?;
        let contour = known.item.geometry.as_ref().and_then(Contour::of);
        let refuse = || {
            let error = ItemError::new("curves", &id.to_string(), "closed curves");
            invalid(&error)
        };
        contours.push(contour.ok_or_else(refuse)?);
    }
    let grid = order.asked.entry.grid.clone();
    let job = move || filled(&grid, &contours).map_err(|error| unusable("curves", &error));
    let mask = order.work("filling curves", job).await?;
    let geometry = order.keep(mask, None).await?;
    order.create(&server, geometry).await
}

pub(super) async fn mesh(
    State(server): Shared,
    Path(id): Path<String>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let asked = Asked::new(&server, &id, &headers)?;
    let MeshBody { region, smoothing, triangles, name, set, author, reason } =
        read(&server, &headers, body).await?;
    let order = Order::new(asked, (author, reason), (name, set), "Mesh")?;
    let known = order.find(region).await?;
    let Some(Geometry::Region(region)) = &known.item.geometry else { return Err(no_region(known.item.id)) };
    let mask = order.voxels(region).await?;
    let name = order.name.clone();
    let smoothing = smoothing.map_or_else(Smoothing::default, |rounds| Smoothing { rounds });
    let job = move || {
        let made = surface_nets(&mask).and_then(|mesh| mesh.smoothed(smoothing));
        let made = match triangles {
            Some(triangles) => made.and_then(|mesh| mesh.decimated(Decimation::to(triangles))),
            None => made,
        };
        let mesh: TriangleMesh = made.map_err(|error| unusable("region", &error))?;
        let bytes = written(MeshFormat::Ply, &mesh, &name).map_err(|error| unusable("region", &error))?;
        Ok((bytes, mesh.vertices.len(), mesh.triangles.len(), mesh.measures()))
    };
    let (bytes, vertices, triangles, measures) = order.work("making a mesh", job).await?;
    let content = order.asked.annotations.store.put_content(MESH, &bytes).await?;
    let count =
        |count: usize| u32::try_from(count).map_err(|error| Problem::internal("counting a mesh", error));
    let (area_mm2, volume_ml) = (measures.area_mm2, measures.volume_ml);
    let (vertices, triangles) = (count(vertices)?, count(triangles)?);
    order
        .create(&server, Geometry::Mesh(MeshSummary { content, vertices, triangles, area_mm2, volume_ml }))
        .await
}

/// Ends the work when whoever waits for it is gone.
#[derive(Default)]
struct Stop(Arc<AtomicBool>);

impl Drop for Stop {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

async fn read<T: serde::de::DeserializeOwned>(
    server: &Server,
    headers: &HeaderMap,
    body: Body,
) -> Result<T, Problem> {
    let body: Value = read_json(server, headers, body, MOST_BYTES).await?;
    parse(body.to_string().as_bytes())
}

fn item(name: &str, author: &str) -> Result<Item, Problem> {
    Item::new(name, author, None).map_err(|error| Problem::internal("drawing a random id", error))
}

fn point(mm: Mm) -> Point<Patient> {
    Point::from_xyz(mm.into())
}

fn no_region(id: ItemId) -> Problem {
    invalid(&ItemError::new("region", &id.to_string(), "an item that is a region"))
}

fn unusable(path: &str, reason: &impl std::fmt::Display) -> Problem {
    Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "unusable", reason).with("path", path)
}

fn not_grown(error: &GrowError) -> Problem {
    let refuse = |kind| Problem::new(StatusCode::UNPROCESSABLE_ENTITY, kind, error);
    match error {
        GrowError::Leaked { reached_ml, allowed_ml } => {
            refuse("leaked").with("reached_ml", *reached_ml).with("allowed_ml", *allowed_ml)
        }
        GrowError::Argument { key, .. } => refuse("out-of-range").with("path", *key),
        GrowError::Outside { .. } | GrowError::Value { .. } => refuse("out-of-range").with("path", "seed_mm"),
        _ => refuse("not-grown"),
    }
}
