//! The voxels of one volume, in memory or to be read again.

use std::error::Error;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use parking_lot::{Mutex, MutexGuard};

use relief_volume::Volume;

/// Reads a series again. Blocks. Its error is logged.
pub type VolumeReader = Arc<dyn Fn() -> Result<Volume, Box<dyn Error + Send + Sync>> + Send + Sync>;

/// The voxels of one volume.
pub(super) struct Voxels {
    volume: Mutex<Option<Volume>>,
    /// `None` keeps the voxels in memory.
    pub(super) reader: Option<VolumeReader>,
    /// Time of the last use, on the clock of [`Residents`](super::residents::Residents).
    pub(super) last_use: AtomicU64,
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

    pub(super) fn get(&self) -> Option<Volume> {
        self.lock().clone()
    }

    pub(super) fn can_be_evicted(&self) -> bool {
        self.reader.is_some()
    }

    /// The value is whole between statements, so a panic elsewhere leaves it usable.
    pub(super) fn lock(&self) -> MutexGuard<'_, Option<Volume>> {
        self.volume.lock()
    }
}
