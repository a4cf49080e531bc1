//! Voxels in the machine's memory: within a limit of bytes, those of the series least recently shown go first.
//!
//! What it is: the voxels of each volume that is served, there or not, and how to have them again. A series of the
//! operator's own is read again when it is shown after its voxels went; an upload cannot be, and stays. What it is not:
//! graphics memory (see `render`). Orders that wait or render keep the voxels that they need, beside the limit.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::http::StatusCode;

use super::blocking::on_blocking_thread;
use super::problem::Problem;
use super::state::Server;
use super::volumes::Entry;
use relief_volume::Volume;

/// Reads a series again. Blocks. Its error is for the log.
pub type VolumeReader = Arc<dyn Fn() -> Result<Volume, String> + Send + Sync>;

/// The voxels of one volume.
pub(super) struct Voxels {
    there: Mutex<Option<Volume>>,
    /// Without one they never go.
    reader: Option<VolumeReader>,
    /// When they were last asked for, on the clock of [`Residents`].
    last_use: AtomicU64,
}

impl std::fmt::Debug for Voxels {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Voxels").field("there", &self.get().is_some()).finish_non_exhaustive()
    }
}

impl Voxels {
    pub(super) fn new(volume: Volume, reader: Option<VolumeReader>) -> Self {
        Self { there: Mutex::new(Some(volume)), reader, last_use: AtomicU64::new(0) }
    }

    pub(super) fn get(&self) -> Option<Volume> {
        self.lock().clone()
    }

    pub(super) fn can_go(&self) -> bool {
        self.reader.is_some()
    }

    /// What is locked here is whole between statements, so a panic elsewhere leaves it usable.
    fn lock(&self) -> MutexGuard<'_, Option<Volume>> {
        self.there.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The limit, and what happened under it.
#[derive(Debug)]
pub(super) struct Residents {
    limit_bytes: u64,
    clock: AtomicU64,
    evictions: AtomicU64,
    reads: AtomicU64,
}

/// What is in memory, and what went and came back since the start.
#[derive(Clone, Copy, Debug)]
pub(super) struct HostMemory {
    pub(super) used_bytes: u64,
    pub(super) limit_bytes: u64,
    pub(super) evictions: u64,
    pub(super) reads: u64,
}

/// There is no room for a volume, even without all that can go.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the volume has {needed} bytes of voxels, and {available} are available beside those that cannot go; \
     allow more with --memory"
)]
pub struct NoRoom {
    /// Bytes of the volume.
    pub needed: u64,
    /// Bytes that are left of those allowed when everything that can go has gone.
    pub available: u64,
}

impl Residents {
    pub(super) fn new(limit_bytes: u64) -> Self {
        let zero = || AtomicU64::new(0);
        Self { limit_bytes, clock: zero(), evictions: zero(), reads: zero() }
    }

    pub(super) fn memory(&self, entries: &[Arc<Entry>]) -> HostMemory {
        HostMemory {
            used_bytes: used(entries),
            limit_bytes: self.limit_bytes,
            evictions: self.evictions.load(Ordering::Relaxed),
            reads: self.reads.load(Ordering::Relaxed),
        }
    }

    /// Says that a volume was just asked for.
    pub(super) fn touch(&self, voxels: &Voxels) {
        voxels.last_use.store(self.clock.fetch_add(1, Ordering::Relaxed) + 1, Ordering::Relaxed);
    }

    /// Lets the least recently used go until so many bytes have room.
    pub(super) fn make_room(&self, entries: &[Arc<Entry>], needed: u64) -> Result<(), NoRoom> {
        let staying =
            entries.iter().filter(|entry| !entry.voxels.can_go()).map(|entry| entry.voxel_bytes()).sum();
        let available = self.limit_bytes.saturating_sub(staying);
        if needed > available {
            return Err(NoRoom { needed, available });
        }
        let mut going: Vec<&Arc<Entry>> = entries.iter().filter(|entry| entry.voxels.can_go()).collect();
        going.sort_by_key(|entry| entry.voxels.last_use.load(Ordering::Relaxed));
        for entry in going {
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

fn used(entries: &[Arc<Entry>]) -> u64 {
    entries.iter().filter(|entry| entry.voxels.lock().is_some()).map(|entry| entry.voxel_bytes()).sum()
}

/// A volume with its voxels, read again where they went.
pub(super) async fn with_voxels(server: &Server, entry: &Entry) -> Result<Volume, Problem> {
    let residents = server.volumes.residents();
    residents.touch(&entry.voxels);
    if let Some(volume) = entry.voxels.get() {
        return Ok(volume);
    }
    let place = Arc::clone(&server.reading).acquire_owned().await;
    let place = place.map_err(|closed| Problem::internal("reading the series again", closed))?;
    // Another request may have read it while this one waited for its turn.
    if let Some(volume) = entry.voxels.get() {
        return Ok(volume);
    }
    let Some(reader) = entry.voxels.reader.clone() else {
        return Err(Problem::internal("reading the series again", "it was never to go"));
    };
    server.volumes.make_room(entry.voxel_bytes()).map_err(|full| {
        Problem::new(StatusCode::INSUFFICIENT_STORAGE, "memory-full", full)
            .with("needed_bytes", full.needed)
            .with("available_bytes", full.available)
    })?;
    let read = on_blocking_thread(place, "reading the series again", move || {
        let volume = reader()?;
        let _ = volume.content_hash(); // takes as long as reading: not on an async thread
        Ok::<_, String>(volume)
    });
    let volume = read.await?.map_err(|cause| Problem::internal("reading the series again", cause))?;
    if volume.content_hash() != entry.hash {
        let detail = "the files of this series have changed since the server was started";
        return Err(Problem::new(StatusCode::CONFLICT, "series-changed", detail));
    }
    residents.reads.fetch_add(1, Ordering::Relaxed);
    *entry.voxels.lock() = Some(volume.clone());
    Ok(volume)
}
