//! Voxels and label maps in host memory: beyond a limit of bytes the least recently used voxels are
//! evicted and read again on demand. Label maps stay.
//!
//! Series of the operator have a reader and can be evicted; uploads have none and stay. Render
//! requests that wait or run hold their voxels in addition to the limit. What it is not: graphics
//! memory (see `relief_render`).

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use tokio::sync::Semaphore;

use super::entry::VolumeEntry;
use super::error::MemoryFull;
use super::voxels::Voxels;

/// The limit and its counters.
#[derive(Debug)]
pub(crate) struct Residents {
    limit_bytes: u64,
    clock: AtomicU64,
    evictions: AtomicU64,
    pub(super) reads: AtomicU64,
    /// One series is read at a time; otherwise each would make room only for itself.
    pub(super) reading: Arc<Semaphore>,
}

/// Voxels in host memory, and evictions and reads since the start.
#[derive(Clone, Copy, Debug)]
pub struct HostMemory {
    /// Bytes of voxels and label maps in memory.
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
        let kept = |entry: &Arc<VolumeEntry>| {
            entry.label_bytes() + if entry.voxels.can_be_evicted() { 0 } else { entry.memory_bytes() }
        };
        let available = self.limit_bytes.saturating_sub(entries.iter().map(kept).sum());
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
    let of_entry = |entry: &Arc<VolumeEntry>| {
        entry.label_bytes() + if entry.voxels.lock().is_some() { entry.memory_bytes() } else { 0 }
    };
    entries.iter().map(of_entry).sum()
}
