//! Voxels in host memory: beyond a limit of bytes the least recently used are evicted and read
//! again on demand.
//!
//! Series of the operator have a reader and can be evicted; uploads have none and stay. Render
//! requests that wait or run hold their voxels in addition to the limit. What it is not: graphics
//! memory (see `relief_render`).

use std::error::Error;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::Semaphore;

use super::error::{MemoryFull, ReadError};
use super::{VolumeEntry, Volumes};
use crate::JobError;
use crate::blocking::on_blocking_thread;
use relief_volume::Volume;

/// Reads a series again. Blocks. Its error is for the log.
pub type VolumeReader = Arc<dyn Fn() -> Result<Volume, Box<dyn Error + Send + Sync>> + Send + Sync>;

/// The voxels of one volume.
pub(super) struct Voxels {
    volume: Mutex<Option<Volume>>,
    /// `None` keeps the voxels in memory.
    reader: Option<VolumeReader>,
    /// Time of the last use, on the clock of [`Residents`].
    last_use: AtomicU64,
}

impl std::fmt::Debug for Voxels {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Voxels").field("in_memory", &self.get().is_some()).finish_non_exhaustive()
    }
}

impl Voxels {
    pub(super) fn new(volume: Volume, reader: Option<VolumeReader>) -> Self {
        Self { volume: Mutex::new(Some(volume)), reader, last_use: AtomicU64::new(0) }
    }

    fn get(&self) -> Option<Volume> {
        self.lock().clone()
    }

    fn can_be_evicted(&self) -> bool {
        self.reader.is_some()
    }

    /// The value is whole between statements, so a panic elsewhere leaves it usable.
    fn lock(&self) -> MutexGuard<'_, Option<Volume>> {
        self.volume.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The limit and its counters.
#[derive(Debug)]
pub(crate) struct Residents {
    limit_bytes: u64,
    clock: AtomicU64,
    evictions: AtomicU64,
    reads: AtomicU64,
    /// One series is read at a time; otherwise each would make room only for itself.
    reading: Arc<Semaphore>,
}

/// Voxels in host memory, and evictions and reads since the start.
#[derive(Clone, Copy, Debug)]
pub struct HostMemory {
    /// Bytes of voxels in memory.
    pub used_bytes: u64,
    /// The limit.
    pub limit_bytes: u64,
    /// Volumes whose voxels were evicted.
    pub evictions: u64,
    /// Volumes whose voxels were read again.
    pub reads: u64,
}

impl Residents {
    pub(super) fn new(limit_bytes: u64) -> Self {
        let zero = || AtomicU64::new(0);
        let reading = Arc::new(Semaphore::new(1));
        Self { limit_bytes, clock: zero(), evictions: zero(), reads: zero(), reading }
    }

    pub(super) fn memory(&self, entries: &[Arc<VolumeEntry>]) -> HostMemory {
        HostMemory {
            used_bytes: used(entries),
            limit_bytes: self.limit_bytes,
            evictions: self.evictions.load(Ordering::Relaxed),
            reads: self.reads.load(Ordering::Relaxed),
        }
    }

    /// Marks a volume as just used.
    pub(super) fn touch(&self, voxels: &Voxels) {
        voxels.last_use.store(self.clock.fetch_add(1, Ordering::Relaxed) + 1, Ordering::Relaxed);
    }

    /// Evicts the least recently used voxels until `needed` bytes are free.
    pub(super) fn make_room(&self, entries: &[Arc<VolumeEntry>], needed: u64) -> Result<(), MemoryFull> {
        let kept = entries.iter().filter(|entry| !entry.voxels.can_be_evicted());
        let available = self.limit_bytes.saturating_sub(kept.map(|entry| entry.voxel_bytes()).sum());
        if needed > available {
            return Err(MemoryFull { needed, available });
        }
        let mut evictable: Vec<_> = entries.iter().filter(|entry| entry.voxels.can_be_evicted()).collect();
        evictable.sort_by_key(|entry| entry.voxels.last_use.load(Ordering::Relaxed));
        for entry in evictable {
            if used(entries).saturating_add(needed) <= self.limit_bytes {
                break;
            }
            if entry.voxels.lock().take().is_some() {
                self.evictions.fetch_add(1, Ordering::Relaxed);
            }
        }
        Ok(())
    }
}

fn used(entries: &[Arc<VolumeEntry>]) -> u64 {
    entries.iter().filter(|entry| entry.voxels.lock().is_some()).map(|entry| entry.voxel_bytes()).sum()
}

/// A volume with its voxels, which are read again after an eviction.
pub(crate) async fn voxels(volumes: &Volumes, entry: &VolumeEntry) -> Result<Volume, ReadError> {
    const WHAT: &str = "reading the series again";
    let residents = volumes.residents();
    residents.touch(&entry.voxels);
    if let Some(volume) = entry.voxels.get() {
        return Ok(volume);
    }
    let permit = Arc::clone(&residents.reading).acquire_owned().await;
    let permit = permit.map_err(|_| JobError::Closed { what: WHAT })?;
    // Another request may have read it while this one waited for its turn.
    if let Some(volume) = entry.voxels.get() {
        return Ok(volume);
    }
    let reader = entry.voxels.reader.clone().ok_or(ReadError::NoReader)?;
    volumes.make_room(entry.voxel_bytes())?;
    let read = on_blocking_thread(permit, WHAT, move || {
        let volume = reader()?;
        let _ = volume.content_hash(); // takes as long as reading: not on an async thread
        Ok(volume)
    });
    let volume = read.await?.map_err(ReadError::Reader)?;
    if volume.content_hash() != entry.hash {
        return Err(ReadError::Changed);
    }
    residents.reads.fetch_add(1, Ordering::Relaxed);
    *entry.voxels.lock() = Some(volume.clone());
    Ok(volume)
}
