//! What all handlers share: the render service, the volumes, the counters and the configuration.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::Semaphore;

use super::annotations::Annotations;
use super::live::{Live, LiveConfig};
use super::metrics::Metrics;
use super::resident::{NoRoom, VolumeReader};
use super::volumes::{LoadedVolume, Volumes};
use relief_session::RenderService;
use relief_store::Store;
use relief_volume::{Grid, LabelMap};

/// Reads a series from a file that was uploaded. Blocks. Its error is told to the client, so it names no path here.
pub type VolumeLoader = Arc<dyn Fn(&Path) -> Result<LoadedVolume, String> + Send + Sync>;

/// Reads a label map from a file that was uploaded, onto the grid of a volume. As [`VolumeLoader`] otherwise.
pub type LabelsLoader = Arc<dyn Fn(&Path, &Grid) -> Result<Arc<LabelMap>, String> + Send + Sync>;

/// How a server behaves.
#[derive(Clone, Debug)]
pub struct Config {
    /// What besides the request decides a frame's bytes: build and adapter. Part of every `ETag`.
    pub identity: String,
    /// The adapter's name, for `/readyz`.
    pub adapter: String,
    /// Values of `Host` (without port) that are served; `None` serves all. A list defends a loopback address
    /// against web pages whose name was made to point at it.
    pub allowed_hosts: Option<Vec<String>>,
    /// Longest time from a request to its answer, uploads apart.
    pub request_timeout: Duration,
    /// Longest wait for the next part of a request's body.
    pub body_timeout: Duration,
    /// Limits of uploads; `None` refuses them.
    pub uploads: Option<UploadLimits>,
    /// Most bytes of voxels in memory, of all volumes together; orders that wait keep theirs beside. Of the series that can
    /// be read again the least recently shown goes first.
    pub memory_bytes: u64,
    /// Live sessions.
    pub live: LiveConfig,
}

/// How much may be uploaded.
#[derive(Clone, Copy, Debug)]
pub struct UploadLimits {
    /// Largest file, bytes.
    pub file_bytes: u64,
    /// Slowest mean rate at which a file may come, bytes per second, after a first [`Config::body_timeout`]: an
    /// upload holds the only place for uploads.
    pub slowest_bytes_per_s: u64,
    /// Most volumes that uploads may add.
    pub volumes: usize,
    /// Most bytes of voxels that uploads may add.
    pub voxel_bytes: usize,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            identity: env!("CARGO_PKG_VERSION").to_owned(),
            adapter: String::new(),
            allowed_hosts: None,
            request_timeout: Duration::from_secs(60),
            body_timeout: Duration::from_secs(15),
            uploads: Some(UploadLimits::default()),
            memory_bytes: 16 << 30,
            live: LiveConfig::default(),
        }
    }
}

impl Default for UploadLimits {
    fn default() -> Self {
        Self { file_bytes: 2 << 30, slowest_bytes_per_s: 512 << 10, volumes: 8, voxel_bytes: 4 << 30 }
    }
}

/// A server's parts, shared by all handlers.
pub struct Server {
    pub(super) config: Config,
    pub(super) service: Arc<RenderService>,
    pub(super) volumes: Volumes,
    pub(super) metrics: Metrics,
    pub(super) live: Live,
    pub(super) loader: VolumeLoader,
    pub(super) labels_loader: Option<LabelsLoader>,
    pub(super) annotations: Option<Arc<Annotations>>,
    /// Places of encoders at work, so that they leave the async threads and the machine's memory alone.
    pub(super) encoders: Arc<Semaphore>,
    /// The place of an upload at work: one at a time.
    pub(super) upload: Arc<Semaphore>,
    /// The place of a series that is read again: one at a time, or each would make room for itself alone.
    pub(super) reading: Arc<Semaphore>,
    pub(super) started: Instant,
}

impl Server {
    /// A server without volumes.
    #[must_use]
    pub fn new(service: Arc<RenderService>, loader: VolumeLoader, config: Config) -> Self {
        let cores = std::thread::available_parallelism().map_or(2, std::num::NonZero::get);
        Self {
            service,
            volumes: Volumes::within(config.memory_bytes),
            reading: Arc::new(Semaphore::new(1)),
            metrics: Metrics::default(),
            live: Live::new(config.live.clone()),
            loader,
            labels_loader: None,
            annotations: None,
            encoders: Arc::new(Semaphore::new(cores)),
            upload: Arc::new(Semaphore::new(1)),
            started: Instant::now(),
            config,
        }
    }

    /// The same server, which takes label maps and reads them so.
    #[must_use]
    pub fn reading_labels(self, loader: LabelsLoader) -> Self {
        Self { labels_loader: Some(loader), ..self }
    }

    /// The same server, which keeps annotations there.
    #[must_use]
    pub fn annotating(self, store: Store) -> Self {
        Self { annotations: Some(Arc::new(Annotations::new(store))), ..self }
    }

    /// Says that this many volumes will be added: the server is not ready before.
    pub fn expect_volumes(&self, count: usize) {
        self.volumes.expect(count);
    }

    /// Says that this many of those that were expected do not come.
    pub fn expect_fewer_volumes(&self, count: usize) {
        self.volumes.expect_fewer(count);
    }

    /// Adds a volume of the operator's own; it cannot be removed over HTTP, and its voxels stay.
    ///
    /// # Panics
    /// When there is no room for it, which only [`Server::add_series`] expects.
    pub fn add_volume(&self, loaded: LoadedVolume) {
        self.volumes.add_own(loaded, None).expect("room for a volume that stays");
    }

    /// Adds a series of the operator's own, whose voxels may go when others need the room: `reader` reads them again.
    ///
    /// # Errors
    /// When there is no room for it even without all that can go.
    pub fn add_series(&self, loaded: LoadedVolume, reader: VolumeReader) -> Result<(), NoRoom> {
        self.volumes.add_own(loaded, Some(reader))
    }

    /// Lets voxels go until so many bytes have room: before a series is read.
    ///
    /// # Errors
    /// When there is no room even without all that can go.
    pub fn make_room(&self, bytes: u64) -> Result<(), NoRoom> {
        self.volumes.make_room(bytes)
    }
}

impl std::fmt::Debug for Server {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Server").field("config", &self.config).finish_non_exhaustive()
    }
}
