//! The volumes that a server holds: geometry, label maps and voxels; nothing that names a patient
//! leaves it.
//!
//! What it is: a registry of [`VolumeEntry`]s, limits for uploads, and voxels that leave memory and
//! are read again (see `residents`). What it is not: HTTP, files, graphics memory (see
//! `relief_render`).
//!
//! A volume's id is the first half of its content hash, so one series has one id on every server.

mod entry;
mod error;
mod read_again;
mod residents;
mod voxels;

use std::sync::Arc;

use parking_lot::RwLock;

pub use entry::{LoadedVolume, NameSource, VolumeEntry};
pub use error::{MemoryFull, ReadError, UploadRefused, VolumeError};
pub(crate) use read_again::voxels;
pub use residents::HostMemory;
pub use voxels::VolumeReader;

use entry::Owner;
use relief_volume::LabelMap;
use residents::Residents;

/// Limits of the volumes that clients upload.
#[derive(Clone, Copy, Debug)]
pub struct UploadedVolumes {
    /// Most uploaded volumes at a time.
    pub volumes: usize,
    /// Most bytes of their voxels together.
    pub voxel_bytes: usize,
}

/// Whether an upload added a volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Added {
    /// The volume was not there before.
    New,
    /// An equal volume was there already.
    Known,
}

/// All volumes, in the order of their arrival.
#[derive(Debug)]
pub struct Volumes {
    inner: RwLock<Inner>,
    residents: Residents,
    names: NameSource,
}

#[derive(Debug, Default)]
struct Inner {
    entries: Vec<Arc<VolumeEntry>>,
    /// Volumes that the operator named and that are still being read.
    loading: usize,
}

impl Volumes {
    /// An empty registry whose voxels together take at most `limit_bytes` of memory.
    #[must_use]
    pub fn within(limit_bytes: u64) -> Self {
        Self {
            inner: RwLock::default(),
            residents: Residents::new(limit_bytes),
            names: NameSource::default(),
        }
    }

    /// The same registry with other names of the volumes that are added to it.
    #[must_use]
    pub fn named_by(self, names: NameSource) -> Self {
        Self { names, ..self }
    }

    pub(crate) fn residents(&self) -> &Residents {
        &self.residents
    }

    /// Evicts voxels that can be read again, least recently used first, until `bytes` are free.
    ///
    /// # Errors
    /// When evicting all of them does not free enough.
    pub fn make_room(&self, bytes: u64) -> Result<(), MemoryFull> {
        self.residents.make_room(&self.inner.read().entries, bytes)
    }

    /// Bytes of voxels in memory, evictions and reads.
    #[must_use]
    pub fn memory(&self) -> HostMemory {
        self.residents.memory(&self.inner.read().entries)
    }

    /// Announces volumes that are still being read.
    pub fn expect(&self, count: usize) {
        self.inner.write().loading += count;
    }

    /// Withdraws the announcement of volumes that could not be read.
    pub fn expect_fewer(&self, count: usize) {
        let mut inner = self.inner.write();
        inner.loading = inner.loading.saturating_sub(count);
    }

    /// Adds a volume of the operator and returns its entry; `reader` reads its voxels again after an
    /// eviction. Without one they stay in memory.
    ///
    /// # Errors
    /// When there is no room for its voxels.
    pub fn add_own(
        &self,
        loaded: LoadedVolume,
        reader: Option<VolumeReader>,
    ) -> Result<Arc<VolumeEntry>, MemoryFull> {
        let entry = self.entry(loaded, Owner::Operator, reader); // hashes the voxels: not under the lock
        let mut inner = self.inner.write();
        inner.entries.retain(|known| known.id != entry.id);
        self.push(&mut inner, &entry)?;
        inner.loading = inner.loading.saturating_sub(1);
        Ok(entry)
    }

    /// Adds a volume that a client requested and that was not announced, or finds an equal one, which
    /// keeps its label map. `reader` reads its voxels again.
    ///
    /// # Errors
    /// When there is no room for its voxels.
    pub fn add_requested(
        &self,
        loaded: LoadedVolume,
        reader: VolumeReader,
    ) -> Result<Arc<VolumeEntry>, MemoryFull> {
        let entry = self.entry(loaded, Owner::Operator, Some(reader));
        let mut inner = self.inner.write();
        if let Some(known) = inner.entries.iter().find(|known| known.id == entry.id) {
            return Ok(Arc::clone(known));
        }
        self.push(&mut inner, &entry)?;
        Ok(entry)
    }

    fn entry(&self, loaded: LoadedVolume, owner: Owner, reader: Option<VolumeReader>) -> Arc<VolumeEntry> {
        let siblings = loaded.identity.as_ref().map_or_else(Vec::new, |identity| {
            let inner = self.inner.read();
            inner.entries.iter().filter(|known| known.is_phase_of(identity)).cloned().collect()
        });
        VolumeEntry::new(loaded, owner, reader, self.names, &siblings)
    }

    /// The phases of a volume's series that are here and have its grid, in their order; the volume
    /// alone where it is no phase.
    #[must_use]
    pub fn phases_of(&self, entry: &Arc<VolumeEntry>) -> Vec<Arc<VolumeEntry>> {
        if entry.phase().is_none() {
            return vec![Arc::clone(entry)];
        }
        let inner = self.inner.read();
        let is_phase = |known: &&Arc<VolumeEntry>| known.id == entry.id || known.is_phase_with(entry);
        let mut phases: Vec<_> = inner.entries.iter().filter(is_phase).cloned().collect();
        phases.sort_by_key(|phase| phase.phase().map(|phase| phase.number));
        phases
    }

    fn push(&self, inner: &mut Inner, entry: &Arc<VolumeEntry>) -> Result<(), MemoryFull> {
        self.residents.make_room(&inner.entries, entry.memory_bytes() + entry.label_bytes())?;
        self.residents.touch(&entry.voxels);
        inner.entries.push(Arc::clone(entry));
        Ok(())
    }

    /// Adds an uploaded volume, or finds an equal one.
    ///
    /// # Errors
    /// When the upload exceeds `limits` or the memory.
    pub fn add_upload(
        &self,
        loaded: LoadedVolume,
        limits: UploadedVolumes,
    ) -> Result<(Arc<VolumeEntry>, Added), UploadRefused> {
        let entry = self.entry(loaded, Owner::Upload, None);
        let mut inner = self.inner.write();
        if let Some(known) = inner.entries.iter().find(|known| known.id == entry.id) {
            return Ok((Arc::clone(known), Added::Known));
        }
        let uploads = inner.entries.iter().filter(|known| known.is_upload());
        let (count, bytes) =
            uploads.fold((0, 0u64), |(n, bytes), known| (n + 1, bytes + known.voxel_bytes()));
        if count >= limits.volumes {
            return Err(UploadRefused::Count(count));
        }
        let (needed, allowed) = (entry.voxel_bytes(), limits.voxel_bytes as u64);
        let free = allowed.saturating_sub(bytes);
        if needed > free {
            return Err(UploadRefused::Bytes { needed, free, allowed });
        }
        self.residents.make_room(&inner.entries, needed)?;
        inner.entries.push(Arc::clone(&entry));
        Ok((entry, Added::New))
    }

    /// Replaces the label map of a volume.
    ///
    /// # Errors
    /// When no volume has this id, its label map is the operator's, or there is no room for the map.
    pub fn set_labels(&self, id: &str, labels: Arc<LabelMap>) -> Result<Arc<VolumeEntry>, VolumeError> {
        let mut inner = self.inner.write();
        let place = inner.entries.iter().position(|entry| entry.id == id).ok_or(VolumeError::UnknownId)?;
        let known = &inner.entries[place];
        if known.has_own_labels {
            return Err(VolumeError::OwnLabels);
        }
        let needed = labels.bytes().saturating_sub(known.label_bytes());
        self.residents.make_room(&inner.entries, needed)?;
        let known = &mut inner.entries[place];
        *known = Arc::new(VolumeEntry { labels: Some(labels), ..VolumeEntry::clone(known) });
        Ok(Arc::clone(known))
    }

    /// The volume with this id.
    ///
    /// # Errors
    /// When no volume has this id.
    pub fn find(&self, id: &str) -> Result<Arc<VolumeEntry>, VolumeError> {
        let inner = self.inner.read();
        inner.entries.iter().find(|entry| entry.id == id).cloned().ok_or(VolumeError::UnknownId)
    }

    /// The volume that was added first.
    ///
    /// # Errors
    /// When there is no volume.
    pub fn first(&self) -> Result<Arc<VolumeEntry>, VolumeError> {
        self.inner.read().entries.first().cloned().ok_or(VolumeError::NoVolume)
    }

    /// The volume of this study and series; the first stack of a series that has several.
    ///
    /// # Errors
    /// When no volume has this identity.
    pub fn find_series(&self, study_uid: &str, series_uid: &str) -> Result<Arc<VolumeEntry>, VolumeError> {
        let inner = self.inner.read();
        let found = inner.entries.iter().find(|entry| entry.is_of_series(study_uid, series_uid));
        found.cloned().ok_or(VolumeError::UnknownSeries)
    }

    /// All volumes and the number of those still being read.
    #[must_use]
    pub fn list(&self) -> (Vec<Arc<VolumeEntry>>, usize) {
        let inner = self.inner.read();
        (inner.entries.clone(), inner.loading)
    }

    /// Numbers of volumes in the registry, and of those that are still being read.
    #[must_use]
    pub fn count(&self) -> (usize, usize) {
        let inner = self.inner.read();
        (inner.entries.len(), inner.loading)
    }

    /// Whether the volume of this entry is still there.
    #[must_use]
    pub fn has(&self, entry: &VolumeEntry) -> bool {
        self.inner.read().entries.iter().any(|known| known.id == entry.id)
    }

    /// Removes an uploaded volume.
    ///
    /// # Errors
    /// When no volume has this id, or the operator added it.
    pub fn remove(&self, id: &str) -> Result<Arc<VolumeEntry>, VolumeError> {
        let mut inner = self.inner.write();
        let at = inner.entries.iter().position(|entry| entry.id == id).ok_or(VolumeError::UnknownId)?;
        if !inner.entries[at].is_upload() {
            return Err(VolumeError::NotRemovable);
        }
        Ok(inner.entries.remove(at))
    }

    /// Removes a volume of the operator; `None` if no such volume has this id.
    pub fn withdraw(&self, id: &str) -> Option<Arc<VolumeEntry>> {
        let mut inner = self.inner.write();
        let at = inner.entries.iter().position(|entry| entry.id == id && !entry.is_upload())?;
        Some(inner.entries.remove(at))
    }
}
