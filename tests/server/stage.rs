//! The fixtures of the server tests: a backend with a closed form and a gate, a server around it,
//! and short requests.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::http::{HeaderMap, Request, StatusCode};
use http_body_util::BodyExt;
use relief_base::DepthLimits;
use relief_dicom::{SeriesIdentity, Strictness, WarningCode};
use relief_exchange::Format;
use relief_render::{OverlayItem, Progress, RenderRequest, RenderedFrame, Timings};
use relief_server::{AnnotationsLoader, Config, ImportError, LabelsLoader, Server, VolumeLoader, app};
use relief_session::{BackendError, LoadedVolume, QueueConfig, RenderBackend, RenderService};
use relief_store::Store;
use relief_volume::{Grid, Projection, Volume};
use serde_json::Value;
use tower::ServiceExt;

/// Radius of the sphere that the backend shows around the focal point, mm.
pub(crate) const SPHERE_MM: f64 = 20.0;

/// The frame of reference of the volume with annotations: a UID that no answer may have.
pub(crate) const FRAME: &str = "1.2.826.0.1.99.7";

/// Sample distances that make the backend misbehave.
pub(crate) const PANICS: &str = "sample_distance_mm=13";
pub(crate) const REFUSES: &str = "sample_distance_mm=14";
pub(crate) const FAILS: &str = "sample_distance_mm=15";

/// Closed, it holds the render thread inside a render.
#[derive(Default)]
pub(crate) struct Gate {
    closed: Mutex<bool>,
    changed: Condvar,
    inside: AtomicUsize,
    pub(crate) renders: AtomicUsize,
    /// The last rendered request.
    pub(crate) last: Mutex<Option<RenderRequest>>,
}

impl Gate {
    pub(crate) fn close(&self) {
        *self.closed.lock().unwrap() = true;
    }

    pub(crate) fn open(&self) {
        *self.closed.lock().unwrap() = false;
        self.changed.notify_all();
    }

    /// Waits until the render thread is held.
    pub(crate) async fn held(&self) {
        while self.inside.load(Ordering::SeqCst) == 0 {
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
    }

    /// Labels of the landmarks that were drawn last, in their order.
    pub(crate) fn labels(&self) -> Vec<String> {
        let last = self.last.lock().unwrap();
        let label = |item: &OverlayItem| match item {
            OverlayItem::Landmark(landmark) => landmark.label.as_deref().map(str::to_owned),
            _ => None,
        };
        last.as_ref().map(|last| last.overlays.items.iter().filter_map(label).collect()).unwrap_or_default()
    }

    pub(crate) fn count(&self) -> usize {
        self.renders.load(Ordering::SeqCst)
    }

    /// Waits at the gate, and asks at times whether to go on.
    fn pass(&self, goes_on: &mut dyn FnMut(Progress) -> ControlFlow<()>) -> ControlFlow<()> {
        self.inside.fetch_add(1, Ordering::SeqCst);
        let mut asked = ControlFlow::Continue(());
        for bands in 1.. {
            let closed = self.closed.lock().unwrap();
            let (still, _) =
                self.changed.wait_timeout_while(closed, Duration::from_millis(2), |closed| *closed).unwrap();
            let is_open = !*still;
            drop(still);
            assert!(is_open || bands < 10_000, "a test left the gate closed");
            asked = goes_on(Progress { bands, ..Progress::default() });
            if is_open || asked.is_break() {
                break;
            }
        }
        self.inside.fetch_sub(1, Ordering::SeqCst);
        asked
    }
}

struct SphereBackend(Arc<Gate>);

impl RenderBackend for SphereBackend {
    fn render(
        &mut self,
        _: &Volume,
        request: &RenderRequest,
        goes_on: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<RenderedFrame, BackendError> {
        self.0.renders.fetch_add(1, Ordering::SeqCst);
        *self.0.last.lock().unwrap() = Some(request.clone());
        if self.0.pass(goes_on).is_break() {
            return Err(BackendError::Cancelled);
        }
        match request.sample_distance_mm {
            13.0 => panic!("secret panic"),
            14.0 => Err(BackendError::Refused("the volume is larger than this adapter takes".into())),
            15.0 => Err(BackendError::Failed("secret cause".into())),
            _ => Ok(sphere(request)),
        }
    }
}

/// Red where the sphere is, with its exact view depth; black and without depth elsewhere.
fn sphere(request: &RenderRequest) -> RenderedFrame {
    let depth_mm = sphere_depths(request);
    let distance = request.camera.distance_mm();
    RenderedFrame {
        size_px: request.size_px,
        color_rgba: depth_mm
            .iter()
            .map(|d| if d.is_finite() { [200, 40, 20, 255] } else { [0; 4] })
            .collect(),
        depth_mm,
        display_mm: None,
        back: None,
        camera: request.camera,
        limits: DepthLimits::new(distance - 50.0, distance + 50.0).unwrap(),
        nearest_ball_mm: None,
        is_partial: false,
        timings: Timings { upload_ms: 1.0, render_ms: 2.0, ..Timings::default() },
    }
}

/// View depth of the first point of the sphere around the volume's centre on each pixel's ray, row by row, mm; of the plane
/// through the focal point in parallel projections, which show slices.
pub(crate) fn sphere_depths(request: &RenderRequest) -> Vec<f32> {
    let camera = &request.camera;
    let ([width, height], distance) = (request.size_px, camera.distance_mm());
    let count = width as usize * height as usize;
    if let Projection::Orthographic { .. } = camera.projection() {
        return vec![distance as f32; count];
    }
    let [half_x, half_y] = camera.half_extent(request.size_px);
    let [shift_x, shift_y] = camera.lens_shift();
    let center = (camera.view_from_patient() * cube().grid().center()).xyz;
    let mut depths = Vec::with_capacity(count);
    for row in 0..height {
        let y = (1.0 - (f64::from(row) + 0.5) / f64::from(height) * 2.0) * half_y + shift_y;
        for column in 0..width {
            let x = ((f64::from(column) + 0.5) / f64::from(width) * 2.0 - 1.0) * half_x + shift_x;
            // The ray t (x, y, -1) meets |p - center| = radius; t is the view depth.
            let (a, along) = (x * x + y * y + 1.0, x * center.x + y * center.y - center.z);
            let discriminant = along * along - a * (center.length_squared() - SPHERE_MM * SPHERE_MM);
            let depth =
                if discriminant < 0.0 { f32::INFINITY } else { ((along - discriminant.sqrt()) / a) as f32 };
            depths.push(depth);
        }
    }
    depths
}

/// A server with one volume and its gate.
pub(crate) struct Stage {
    pub(crate) app: Router,
    pub(crate) server: Arc<Server>,
    pub(crate) service: Arc<RenderService>,
    pub(crate) gate: Arc<Gate>,
    pub(crate) id: String,
    /// Where the annotations are, if there are any.
    pub(crate) _folder: Option<tempfile::TempDir>,
}

/// An answer, read to its end.
pub(crate) struct Answer {
    pub(crate) status: StatusCode,
    pub(crate) headers: HeaderMap,
    pub(crate) body: Vec<u8>,
}

impl Stage {
    pub(crate) fn new() -> Self {
        Self::with(Config::default(), QueueConfig::default())
    }

    pub(crate) fn with(config: Config, queue: QueueConfig) -> Self {
        let empty = Self::empty(config, queue);
        let volume = cube();
        let id = volume.content_hash().short();
        empty.server.add_volume(LoadedVolume {
            volume,
            warnings: vec![WarningCode::BadFile; 2],
            identity: None,
            reference: None,
            labels: None,
        });
        Self { id, ..empty }
    }

    pub(crate) fn empty(config: Config, queue: QueueConfig) -> Self {
        Self::loading(config, queue, loader())
    }

    /// A server without volumes that reads uploads in this way.
    pub(crate) fn loading(config: Config, queue: QueueConfig, loader: VolumeLoader) -> Self {
        Self::built(config, queue, loader, None)
    }

    /// A server with one volume and a log of annotations of its own.
    pub(crate) async fn annotated() -> Self {
        Self::annotated_with(Config::default()).await
    }

    pub(crate) async fn annotated_with(config: Config) -> Self {
        Self::annotated_on(config, cube()).await
    }

    async fn annotated_on(config: Config, volume: Volume) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("log.db");
        Self { _folder: Some(folder), ..Self::annotated_at(place.to_str().unwrap(), config, volume).await }
    }

    /// As [`Stage::annotated`], with a volume in which there is the sphere that the backend shows.
    pub(crate) async fn annotated_sphere() -> Self {
        Self::annotated_on(Config::default(), ball(44, 1.5)).await
    }

    /// As [`Stage::annotated_sphere`], in the finest voxels that the largest search radius allows.
    pub(crate) async fn annotated_fine_sphere() -> Self {
        Self::annotated_on(Config::default(), ball(164, 0.25)).await
    }

    /// A server with one volume and a log of annotations, which receives notifications of other
    /// writers.
    pub(crate) async fn following(place: &str) -> Self {
        let stage = Self::annotated_at(place, Config::default(), cube()).await;
        stage.server.follow_annotations().await;
        stage
    }

    async fn annotated_at(place: &str, config: Config, volume: Volume) -> Self {
        let store = Store::open(place).await.unwrap();
        let empty = Self::built(config, QueueConfig::default(), loader(), Some(store));
        let id = volume.content_hash().short();
        let identity = Some(SeriesIdentity::new("1.2.3", "1.2.4").within_frame_of_reference(FRAME));
        empty.server.add_volume(LoadedVolume {
            volume,
            warnings: Vec::new(),
            identity,
            reference: None,
            labels: None,
        });
        Self { id, ..empty }
    }

    fn built(config: Config, queue: QueueConfig, loader: VolumeLoader, store: Option<Store>) -> Self {
        let gate = Arc::new(Gate::default());
        let service = Arc::new(RenderService::start(SphereBackend(Arc::clone(&gate)), queue).unwrap());
        let server = Server::new(Arc::clone(&service), loader, config)
            .reading_labels(labels_loader())
            .reading_annotations(annotations_loader());
        let server = Arc::new(match store {
            Some(store) => server.annotating(store),
            None => server,
        });
        Self { app: app(Arc::clone(&server)), server, service, gate, id: String::new(), _folder: None }
    }

    /// The path of a part of the volume.
    pub(crate) fn path(&self, part: &str) -> String {
        format!("/v1/volumes/{}/{part}", self.id)
    }

    pub(crate) async fn get(&self, path: &str) -> Answer {
        self.ask(Request::get(path).body(Body::empty()).unwrap()).await
    }

    pub(crate) async fn get_with(&self, path: &str, headers: &[(&str, &str)]) -> Answer {
        let request =
            headers.iter().fold(Request::get(path), |request, (name, value)| request.header(*name, *value));
        self.ask(request.body(Body::empty()).unwrap()).await
    }

    pub(crate) async fn post(&self, path: &str, media: &str, body: impl Into<Body>) -> Answer {
        self.ask(Request::post(path).header("content-type", media).body(body.into()).unwrap()).await
    }

    pub(crate) async fn ask(&self, request: Request<Body>) -> Answer {
        let response = self.app.clone().oneshot(request).await.unwrap();
        let (parts, body) = response.into_parts();
        let body = body.collect().await.unwrap().to_bytes().to_vec();
        Answer { status: parts.status, headers: parts.headers, body }
    }
}

impl Answer {
    pub(crate) fn header(&self, name: &str) -> &str {
        self.headers.get(name).unwrap_or_else(|| panic!("no header {name}")).to_str().unwrap()
    }

    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|error| panic!("{error}: {}", self.text()))
    }

    pub(crate) fn text(&self) -> &str {
        std::str::from_utf8(&self.body).unwrap()
    }

    /// The problem document, after checking its form.
    #[track_caller]
    pub(crate) fn problem(&self, status: u16) -> Value {
        assert_eq!(self.status.as_u16(), status, "{}", self.text());
        assert_eq!(self.header("content-type"), "application/problem+json");
        assert!(!self.header("x-request-id").is_empty());
        let problem = self.json();
        assert_eq!(problem["status"], status);
        assert!(problem["type"].as_str().unwrap().starts_with("urn:relief:problem:"), "{problem}");
        assert!(
            !problem["title"].as_str().unwrap().is_empty() && !problem["detail"].as_str().unwrap().is_empty()
        );
        problem
    }
}

/// 4x4x4 voxels of 10 mm around the patient origin.
pub(crate) fn cube() -> Volume {
    let grid = Grid::axis_aligned([4; 3], [10.0; 3], [-15.0; 3]).unwrap();
    Volume::new(grid, (0..64).collect()).unwrap()
}

/// A ball of 300 HU and the backend's radius in air, in `count`³ voxels of `mm` around the patient
/// origin; its edge is about 2 mm wide, and steepest at the radius.
fn ball(count: u32, mm: f64) -> Volume {
    let first = -f64::from(count - 1) / 2.0 * mm;
    let grid = Grid::axis_aligned([count as usize; 3], [mm; 3], [first; 3]).unwrap();
    let hu = (0..count.pow(3)).map(|at| {
        let place = [at % count, at / count % count, at / count.pow(2)].map(|i| f64::from(i) * mm + first);
        let depth = SPHERE_MM - place.iter().map(|x| x * x).sum::<f64>().sqrt();
        (-350.0 + 650.0 * depth.tanh()).round() as i16
    });
    Volume::new(grid, hu.collect()).unwrap()
}

fn labels_loader() -> LabelsLoader {
    Arc::new(|path, grid| {
        let found = relief_dicom::read_labels(path).map_err(|error| error.to_string())?;
        Ok(Arc::new(found.map.resampled(grid)))
    })
}

fn annotations_loader() -> AnnotationsLoader {
    Arc::new(|path, name, format, context| {
        let bytes = std::fs::read(path).unwrap();
        let format = format.or_else(|| Format::of(Path::new(name), &bytes));
        let format = format.ok_or(ImportError::UnknownFormat)?;
        relief_exchange::read(format, &bytes, context).map_err(|error| ImportError::Unreadable(error.into()))
    })
}

fn loader() -> VolumeLoader {
    Arc::new(|path, budget| {
        let found = relief_dicom::discover_within(budget, path, Strictness::Lenient, &|_| ())
            .map_err(|error| error.to_string())?;
        let entry = found.select(None).map_err(|error| error.to_string())?;
        let loaded =
            relief_dicom::load(entry, Strictness::Lenient, &|_| ()).map_err(|error| error.to_string())?;
        Ok(LoadedVolume {
            warnings: loaded.warnings.iter().map(|warning| warning.code).collect(),
            volume: loaded.volume,
            identity: Some(loaded.identity),
            reference: loaded.reference,
            labels: None,
        })
    })
}
