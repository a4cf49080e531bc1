//! The engine that serves pictures: the render queue, the volumes, and permits for encoding.
//!
//! HTTP handlers and live views share one [`Engine`]. What it is not: sockets, routes, annotations.

use std::sync::Arc;

use tokio::sync::Semaphore;

use crate::blocking::on_blocking_thread;
use crate::volumes::{ReadError, VolumeEntry, Volumes, voxels};
use crate::{JobError, RenderService, Rendered, ServiceError};
use relief_annotation::{Snap, SnapError, Snapped, snap_point};
use relief_base::{Patient, Point, Vector};
use relief_volume::Volume;

/// Pixels of a small picture: encoding it takes a few milliseconds at most.
const SMALL_PX: u64 = 1 << 17;

/// Called with the outcome of every request that was rendered, for metrics.
pub(crate) type RenderObserver = Box<dyn Fn(&Result<Rendered, ServiceError>) + Send + Sync>;

/// The parts that turn requests into encoded pictures.
pub struct Engine {
    /// The render queue.
    pub service: Arc<RenderService>,
    /// The volumes.
    pub volumes: Volumes,
    /// Permits for blocking work: as many jobs as processors.
    encoders: Arc<Semaphore>,
    /// Permits for short work, which must not wait for long work.
    short_work: Arc<Semaphore>,
    observer: RenderObserver,
}

impl std::fmt::Debug for Engine {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Engine").field("volumes", &self.volumes).finish_non_exhaustive()
    }
}

impl Engine {
    /// An engine of these volumes.
    #[must_use]
    pub fn new(service: Arc<RenderService>, volumes: Volumes, observer: RenderObserver) -> Self {
        let cores = std::thread::available_parallelism().map_or(2, std::num::NonZero::get);
        let encoders = Arc::new(Semaphore::new(cores));
        let short_work = Arc::new(Semaphore::new(cores));
        Self { service, volumes, encoders, short_work, observer }
    }

    /// A volume with its voxels, which are read again after an eviction.
    ///
    /// # Errors
    /// [`ReadError`].
    pub async fn voxels(&self, entry: &VolumeEntry) -> Result<Volume, ReadError> {
        voxels(&self.volumes, entry).await
    }

    /// Reports the outcome of a render request.
    pub fn observe(&self, outcome: &Result<Rendered, ServiceError>) {
        (self.observer)(outcome);
    }

    /// A permit for blocking work; waits until one is free.
    ///
    /// # Errors
    /// [`JobError::Closed`].
    pub async fn permit(&self, what: &'static str) -> Result<tokio::sync::OwnedSemaphorePermit, JobError> {
        Arc::clone(&self.encoders).acquire_owned().await.map_err(|_| JobError::Closed { what })
    }

    /// Runs `job` on a blocking thread when a permit is free.
    ///
    /// # Errors
    /// [`JobError`].
    pub async fn blocking<T: Send + 'static>(
        &self,
        what: &'static str,
        job: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, JobError> {
        on_blocking_thread(self.permit(what).await?, what, job).await
    }

    /// Encodes a picture of this size on a blocking thread when a permit is free. Small pictures do
    /// not wait until large ones are encoded.
    ///
    /// # Errors
    /// [`JobError`].
    pub async fn encoding<T: Send + 'static>(
        &self,
        [width, height]: [u32; 2],
        job: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, JobError> {
        const WHAT: &str = "encoding";
        let is_small = u64::from(width) * u64::from(height) <= SMALL_PX;
        let permits = if is_small { &self.short_work } else { &self.encoders };
        let permit = Arc::clone(permits).acquire_owned().await;
        on_blocking_thread(permit.map_err(|_| JobError::Closed { what: WHAT })?, WHAT, job).await
    }

    /// Moves a point to the nearest feature of the volume; `ray` is the line of sight through it.
    ///
    /// # Errors
    /// [`ReadError`]; the inner error when there is no feature near.
    pub async fn snap(
        &self,
        entry: &VolumeEntry,
        at: Point<Patient>,
        ray: Option<Vector<Patient>>,
        snap: Snap,
    ) -> Result<Result<Snapped, SnapError>, ReadError> {
        let volume = self.voxels(entry).await?;
        Ok(self.blocking("snapping", move || snap_point(&volume, at, ray, &snap)).await?)
    }
}
