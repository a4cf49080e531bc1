//! The parts of a server. Handlers extract the parts that they need from the router's state, never
//! the whole server.

use std::convert::Infallible;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::extract::{FromRef, FromRequestParts};
use axum::http::request::Parts;
use tokio::sync::Semaphore;

use super::annotation_service::Annotations;
use super::archived::{Archives, SeriesArchives};
use super::audit::AuditLog;
use super::identity::{Admission, SignIns, Tickets};
use super::live::{Live, LiveConfig};
use super::metrics::Metrics;
use super::shares::{self, Shares, Turns};
use relief_base::Budget;
use relief_exchange::{Format, Imported, ReadContext};
use relief_session::{
    Engine, LoadedVolume, MemoryFull, NameSource, RenderService, VolumeEntry, VolumeReader, Volumes,
};
use relief_store::Store;
use relief_volume::{Grid, LabelMap};

/// Uploads that are received at a time; each may fill a file of [`UploadLimits::file_bytes`].
const RECEIVING: usize = 4;

/// An error of a loader. Clients see its message, so it must not name paths or patients.
pub type LoadError = Box<dyn Error + Send + Sync>;

/// Reads the series of an uploaded file within a budget. Blocks; a cancelled budget ends it.
pub type VolumeLoader = Arc<dyn Fn(&Path, &Budget) -> Result<LoadedVolume, LoadError> + Send + Sync>;

/// Reads the label map of an uploaded file onto the grid of a volume. Blocks.
pub type LabelsLoader = Arc<dyn Fn(&Path, &Grid) -> Result<Arc<LabelMap>, LoadError> + Send + Sync>;

/// Reads an uploaded file of annotations: its path, its name, and its format if the client says it.
/// Blocks.
pub type AnnotationsLoader =
    Arc<dyn Fn(&Path, &str, Option<Format>, &ReadContext<'_>) -> Result<Imported, ImportError> + Send + Sync>;

/// Why a file of annotations was not read. Clients see its message, so it must not name paths or
/// patients.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// Its format is unknown.
    #[error("neither name nor first bytes of the file tell its format; name it with format=")]
    UnknownFormat,
    /// It is damaged, or needs too much.
    #[error("{0}")]
    Unreadable(LoadError),
}

/// The configuration of a server.
#[derive(Clone, Debug)]
pub struct Config {
    /// Build and adapter: what decides the bytes of a frame besides the request. Part of every
    /// `ETag`.
    pub identity: String,
    /// Name of the adapter, for `/readyz`.
    pub adapter: String,
    /// How callers are recognised.
    pub admission: Admission,
    /// Most requests of one caller that are answered at a time.
    pub requests_per_caller: usize,
    /// Accepted values of `Host`; `None` accepts all.
    pub allowed_hosts: Option<AllowedHosts>,
    /// Longest time from a request to its answer, except for uploads.
    pub request_timeout: Duration,
    /// Longest wait for the next part of a request's body.
    pub body_timeout: Duration,
    /// Limits of uploads; `None` refuses uploads.
    pub uploads: Option<UploadLimits>,
    /// Most bytes of voxels and label maps in host memory, of all volumes together. Render requests
    /// that wait or run hold theirs in addition.
    pub memory_bytes: u64,
    /// The source of the names of volumes.
    pub volume_names: NameSource,
    /// Most bytes of contents of annotations (regions, meshes) in the log, after which imports of
    /// more are refused.
    pub content_bytes: u64,
    /// Live sessions.
    pub live: LiveConfig,
    /// Joins the span of a request to its caller's trace; `None` starts a trace for each request.
    pub join_trace: Option<JoinTrace>,
}

/// Joins a span to the trace that the headers `traceparent` and `tracestate` name (W3C Trace
/// Context). Invalid headers leave the span as it is.
pub(crate) type JoinTrace = fn(&tracing::Span, TraceHeaders<'_>);

/// The headers of a request that name its caller's trace.
#[derive(Clone, Copy, Debug)]
pub struct TraceHeaders<'a> {
    /// The trace and the span that sent the request.
    pub parent: &'a str,
    /// Values of tracing systems, in their order.
    pub state: Option<&'a str>,
}

/// The names under which a server answers. They defend it against web pages whose host name
/// resolves to its address (DNS rebinding).
#[derive(Clone, Debug, Default)]
pub struct AllowedHosts {
    /// Names, without port.
    pub names: Vec<String>,
    /// Whether any address of digits is accepted, too: no page can give itself such a name.
    pub addresses: bool,
}

impl AllowedHosts {
    /// Whether the server answers under this name, which has no port.
    #[must_use]
    pub fn accept(&self, name: &str) -> bool {
        let bare = name.trim_start_matches('[').trim_end_matches(']');
        let is_address = self.addresses && bare.parse::<std::net::IpAddr>().is_ok();
        is_address || self.names.iter().any(|known| known.eq_ignore_ascii_case(name))
    }
}

/// Limits of uploads.
#[derive(Clone, Copy, Debug)]
pub struct UploadLimits {
    /// Largest file, bytes.
    pub file_bytes: u64,
    /// Lowest mean rate of an upload, bytes per second, after an initial [`Config::body_timeout`].
    /// Few uploads are received at a time, so slow ones would block the others.
    pub slowest_bytes_per_s: u64,
    /// Most uploaded volumes at a time.
    pub volumes: usize,
    /// Most bytes of their voxels together.
    pub voxel_bytes: usize,
}

impl UploadLimits {
    /// Memory that headers of an upload may take: a small share of its voxels.
    #[must_use]
    pub fn header_bytes(&self) -> u64 {
        (self.voxel_bytes as u64 / 8).max(64 << 20)
    }

    /// Bytes that an upload may unpack to: headers are read before voxels, and some files hold
    /// more than voxels.
    #[must_use]
    pub fn unpacked_bytes(&self) -> u64 {
        (self.voxel_bytes as u64).saturating_mul(4).max(1 << 30)
    }
}

impl Default for Config {
    fn default() -> Self {
        Self {
            identity: env!("CARGO_PKG_VERSION").to_owned(),
            adapter: String::new(),
            admission: Admission::default(),
            requests_per_caller: 16,
            allowed_hosts: None,
            request_timeout: Duration::from_secs(60),
            body_timeout: Duration::from_secs(15),
            uploads: Some(UploadLimits::default()),
            memory_bytes: 16 << 30,
            volume_names: NameSource::default(),
            content_bytes: 64 << 30,
            live: LiveConfig::default(),
            join_trace: None,
        }
    }
}

impl Default for UploadLimits {
    fn default() -> Self {
        Self { file_bytes: 2 << 30, slowest_bytes_per_s: 512 << 10, volumes: 8, voxel_bytes: 4 << 30 }
    }
}

/// A server: volumes, the render queue, live sessions and annotations.
pub struct Server {
    pub(super) config: Arc<Config>,
    pub(super) engine: Arc<Engine>,
    pub(super) metrics: Arc<Metrics>,
    pub(super) live: Arc<Live>,
    pub(super) uploads: Uploads,
    pub(super) annotations: Option<Arc<Annotations>>,
    pub(super) archives: Option<Arc<Archives>>,
    pub(super) tickets: Arc<Tickets>,
    pub(super) requests: Arc<Shares>,
    turns: Arc<Turns>,
    pub(super) audit: Option<Arc<AuditLog>>,
    pub(super) sign_ins: Arc<SignIns>,
    started: Started,
}

/// When the server was started.
#[derive(Clone, Copy)]
pub(super) struct Started(pub(super) Instant);

/// The parts that receive uploads.
#[derive(Clone)]
pub(super) struct Uploads {
    pub(super) loader: VolumeLoader,
    pub(super) labels_loader: Option<LabelsLoader>,
    pub(super) annotations_loader: Option<AnnotationsLoader>,
    /// Uploads that are received at a time.
    pub(super) receiving: Arc<Semaphore>,
    /// One upload of each caller.
    pub(super) shares: Arc<Shares>,
    /// One upload is read at a time.
    pub(super) turn: Arc<Semaphore>,
}

/// The parts that answer with pictures, and the caller.
#[derive(Clone)]
pub(super) struct Pictures {
    pub(super) config: Arc<Config>,
    pub(super) engine: Arc<Engine>,
    pub(super) metrics: Arc<Metrics>,
    pub(super) annotations: Option<Arc<Annotations>>,
    pub(super) turns: Arc<Turns>,
    /// The key of the caller (see `shares`).
    pub(super) caller: Option<Arc<str>>,
}

impl Pictures {
    /// The parts, for the request with this head.
    pub(super) fn new(AppState(server): &AppState, head: &Parts) -> Self {
        Self {
            config: Arc::clone(&server.config),
            engine: Arc::clone(&server.engine),
            metrics: Arc::clone(&server.metrics),
            annotations: server.annotations.clone(),
            turns: Arc::clone(&server.turns),
            caller: head.extensions.get().and_then(shares::key),
        }
    }
}

impl FromRequestParts<AppState> for Pictures {
    type Rejection = Infallible;

    async fn from_request_parts(head: &mut Parts, state: &AppState) -> Result<Self, Infallible> {
        Ok(Self::new(state, head))
    }
}

/// The parts of a live session.
#[derive(Clone)]
pub(super) struct LiveParts {
    pub(super) config: Arc<Config>,
    pub(super) engine: Arc<Engine>,
    pub(super) metrics: Arc<Metrics>,
    pub(super) live: Arc<Live>,
    pub(super) annotations: Option<Arc<Annotations>>,
}

/// The router's state.
#[derive(Clone)]
pub(super) struct AppState(pub(super) Arc<Server>);

/// `FromRef` for parts that are a clone of a field.
macro_rules! parts {
    ($($part:ty = $field:ident),* $(,)?) => {$(
        impl FromRef<AppState> for $part {
            fn from_ref(AppState(server): &AppState) -> Self {
                server.$field.clone()
            }
        }
    )*};
}

parts! {
    Arc<Config> = config,
    Arc<Engine> = engine,
    Arc<Metrics> = metrics,
    Arc<Live> = live,
    Arc<Tickets> = tickets,
    Uploads = uploads,
    Option<Arc<Annotations>> = annotations,
    Option<Arc<Archives>> = archives,
    Started = started,
}

impl FromRef<AppState> for LiveParts {
    fn from_ref(AppState(server): &AppState) -> Self {
        Self {
            engine: Arc::clone(&server.engine),
            metrics: Arc::clone(&server.metrics),
            config: Arc::clone(&server.config),
            live: Arc::clone(&server.live),
            annotations: server.annotations.clone(),
        }
    }
}

impl Server {
    /// A server without volumes.
    #[must_use]
    pub fn new(service: Arc<RenderService>, loader: VolumeLoader, config: Config) -> Self {
        let metrics = Arc::new(Metrics::default());
        let counter = Arc::clone(&metrics);
        let observer = Box::new(move |outcome: &_| counter.rendered(outcome));
        let volumes = Volumes::within(config.memory_bytes).named_by(config.volume_names);
        Self {
            engine: Arc::new(Engine::new(service, volumes, observer)),
            metrics,
            live: Arc::new(Live::new(config.live.clone())),
            uploads: Uploads {
                loader,
                labels_loader: None,
                annotations_loader: None,
                receiving: Arc::new(Semaphore::new(RECEIVING)),
                shares: Arc::new(Shares::new(1)),
                turn: Arc::new(Semaphore::new(1)),
            },
            annotations: None,
            archives: None,
            tickets: Arc::default(),
            requests: Arc::new(Shares::new(config.requests_per_caller)),
            turns: Arc::default(),
            audit: None,
            sign_ins: Arc::default(),
            started: Started(Instant::now()),
            config: Arc::new(config),
        }
    }

    /// Sets the loader of label maps; without one the server refuses them.
    #[must_use]
    pub fn reading_labels(mut self, loader: LabelsLoader) -> Self {
        self.uploads.labels_loader = Some(loader);
        self
    }

    /// Sets the loader of files of annotations; without one the server refuses them.
    #[must_use]
    pub fn reading_annotations(mut self, loader: AnnotationsLoader) -> Self {
        self.uploads.annotations_loader = Some(loader);
        self
    }

    /// Sets the store of annotations; without one the server has none.
    #[must_use]
    pub fn annotating(self, store: Store) -> Self {
        Self { annotations: Some(Arc::new(Annotations::new(store))), ..self }
    }

    /// Lets clients search these archives and load series from them. Without this call, clients can
    /// search no archive.
    ///
    /// # Errors
    /// When the system has no random numbers.
    pub fn searching(self, archives: Box<dyn SeriesArchives>) -> std::io::Result<Self> {
        Ok(Self { archives: Some(Arc::new(Archives::new(archives)?)), ..self })
    }

    /// Sets the log of requests; without one they are not recorded.
    #[must_use]
    pub fn audited(self, log: AuditLog) -> Self {
        Self { audit: Some(Arc::new(log)), ..self }
    }

    /// Announces volumes that are still being read. The server is not ready before they have been
    /// added.
    pub fn expect_volumes(&self, count: usize) {
        self.engine.volumes.expect(count);
    }

    /// Withdraws the announcement of volumes that could not be read.
    pub fn expect_fewer_volumes(&self, count: usize) {
        self.engine.volumes.expect_fewer(count);
    }

    /// Adds a volume of the operator. Clients cannot remove it, and its voxels stay in memory.
    ///
    /// # Panics
    /// When there is no room for it. Use [`Server::add_series`] where that can happen.
    pub fn add_volume(&self, loaded: LoadedVolume) {
        self.engine.volumes.add_own(loaded, None).expect("room for a volume that stays");
    }

    /// Adds a series of the operator, whose voxels may be evicted: `reader` reads them again. Returns its
    /// entry.
    ///
    /// # Errors
    /// When there is no room for it, even after evicting everything that can be read again.
    pub fn add_series(
        &self,
        loaded: LoadedVolume,
        reader: VolumeReader,
    ) -> Result<Arc<VolumeEntry>, MemoryFull> {
        self.engine.volumes.add_own(loaded, Some(reader))
    }

    /// Removes a volume of the operator; sessions that show it end.
    pub fn withdraw_series(&self, id: &str) {
        if let Some(removed) = self.engine.volumes.withdraw(id) {
            self.engine.service.forget(removed.hash);
            self.live.views.wake();
        }
    }

    /// Evicts voxels until `bytes` are free, before a series is read.
    ///
    /// # Errors
    /// When evicting everything that can be read again does not free enough.
    pub fn make_room(&self, bytes: u64) -> Result<(), MemoryFull> {
        self.engine.volumes.make_room(bytes)
    }
}

impl std::fmt::Debug for Server {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Server").field("config", &self.config).finish_non_exhaustive()
    }
}
