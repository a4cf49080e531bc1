//! The volumes that are served, and their descriptions. They hold geometry and values, nothing about the patient.
//!
//! A volume's id is the beginning of its content hash: the same series has the same id everywhere.

use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use axum::Json;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use serde_json::{Value, json};

use super::problem::Problem;
use super::resident::{HostMemory, NoRoom, Residents, VolumeReader, Voxels};
use super::state::{Server, UploadLimits};
use relief_annotation::FrameOfReference;
use relief_dicom::{SeriesIdentity, SeriesReference};
use relief_volume::{ContentHash, Grid, LabelMap, Segment, Volume};

/// A volume and how many warnings its reading gave.
#[derive(Clone, Debug)]
pub struct LoadedVolume {
    /// The voxels and their place.
    pub volume: Volume,
    /// Warnings that the reader gave: the description shows their number.
    pub warnings: usize,
    /// The study and series that it answers for; `None` answers for none.
    pub identity: Option<SeriesIdentity>,
    /// What reports and segmentations that are exported say of it. It names the patient: for files alone.
    pub reference: Option<Arc<SeriesReference>>,
    /// Its label map, on its grid.
    pub labels: Option<Arc<LabelMap>>,
}

/// Who brought a volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Owner {
    Operator,
    Upload,
}

#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub(super) id: String,
    pub(super) grid: Grid,
    pub(super) hash: ContentHash,
    /// Shared with what it was before it got another label map.
    pub(super) voxels: Arc<Voxels>,
    range_hu: (i16, i16),
    warnings: usize,
    owner: Owner,
    identity: Option<SeriesIdentity>,
    pub(super) reference: Option<Arc<SeriesReference>>,
    pub(super) labels: Option<Arc<LabelMap>>,
}

/// Whether an upload brought something new.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Added {
    New,
    Known,
}

/// All volumes, in the order of their arrival.
#[derive(Debug)]
pub(super) struct Volumes {
    inner: RwLock<Inner>,
    residents: Residents,
}

#[derive(Debug, Default)]
struct Inner {
    entries: Vec<Arc<Entry>>,
    expected: usize,
}

/// Why an upload was not added.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum AddError {
    /// There are as many uploaded volumes as allowed.
    #[error("{0} uploaded volumes are here, the most that are allowed; remove one with DELETE")]
    Count(usize),
    /// The voxels of all uploads would need more memory than allowed.
    #[error(
        "the volume has {needed} bytes of voxels, and {free} of {allowed} are free; remove one with DELETE"
    )]
    Bytes {
        /// Bytes of the new volume.
        needed: u64,
        /// Bytes left of those allowed.
        free: u64,
        /// Bytes allowed.
        allowed: u64,
    },
    /// The voxels of all volumes would need more memory than allowed.
    #[error(transparent)]
    NoRoom(#[from] NoRoom),
}

impl Entry {
    fn new(loaded: LoadedVolume, owner: Owner, reader: Option<VolumeReader>) -> Arc<Self> {
        let LoadedVolume { volume, warnings, identity, reference, labels } = loaded;
        let (grid, hash, range_hu) = (volume.grid().clone(), volume.content_hash(), volume.range_hu());
        let voxels = Arc::new(Voxels::new(volume, reader));
        let id = hash.short();
        Arc::new(Self { id, grid, hash, voxels, range_hu, warnings, owner, identity, reference, labels })
    }

    /// What positions of annotations are told from. A UID leads to a patient: for the store, not for answers.
    pub(super) fn frame_of_reference(&self) -> FrameOfReference {
        let of_series = self.identity.as_ref().and_then(SeriesIdentity::frame_of_reference);
        FrameOfReference::of(of_series, &self.id)
    }

    pub(super) fn voxel_bytes(&self) -> u64 {
        (self.grid.voxel_count() * size_of::<i16>()) as u64
    }

    /// What clients learn of a volume.
    pub(super) fn describe(&self) -> Value {
        let grid = &self.grid;
        let (low, high) = self.range_hu;
        let bounds = grid.bounds();
        json!({
            "id": self.id,
            "dims": grid.dims(),
            "spacing_mm": grid.spacing_mm(),
            "origin_mm": grid.origin().xyz.to_array(),
            "direction": grid.direction(),
            "center_mm": grid.center().xyz.to_array(),
            "radius_mm": grid.bounding_radius_mm(),
            "bounds_mm": [bounds.min.xyz.to_array(), bounds.max.xyz.to_array()],
            "hu_range": [low, high],
            "segments": self.labels.as_deref().map(segments),
            "warnings": self.warnings,
            "removable": self.owner == Owner::Upload,
            "links": { "self": format!("/v1/volumes/{}", self.id), "frame": format!("/v1/volumes/{}/frame", self.id) },
        })
    }
}

impl Volumes {
    /// None yet; their voxels together may take so many bytes.
    pub(super) fn within(limit_bytes: u64) -> Self {
        Self { inner: RwLock::default(), residents: Residents::new(limit_bytes) }
    }

    pub(super) fn residents(&self) -> &Residents {
        &self.residents
    }

    /// Lets voxels go that can be read again until so many bytes have room, the least recently shown first.
    pub(super) fn make_room(&self, bytes: u64) -> Result<(), NoRoom> {
        self.residents.make_room(&self.read().entries, bytes)
    }

    pub(super) fn memory(&self) -> HostMemory {
        self.residents.memory(&self.read().entries)
    }

    pub(super) fn expect(&self, count: usize) {
        self.write().expected += count;
    }

    pub(super) fn expect_fewer(&self, count: usize) {
        let mut inner = self.write();
        inner.expected = inner.expected.saturating_sub(count);
    }

    pub(super) fn add_own(&self, loaded: LoadedVolume, reader: Option<VolumeReader>) -> Result<(), NoRoom> {
        let entry = Entry::new(loaded, Owner::Operator, reader); // hashes the voxels: not under the lock
        let mut inner = self.write();
        inner.entries.retain(|known| known.id != entry.id);
        self.residents.make_room(&inner.entries, entry.voxel_bytes())?;
        inner.expected = inner.expected.saturating_sub(1);
        self.residents.touch(&entry.voxels);
        inner.entries.push(entry);
        Ok(())
    }

    /// Adds an upload, or finds it here already.
    pub(super) fn add_upload(
        &self,
        loaded: LoadedVolume,
        limits: UploadLimits,
    ) -> Result<(Arc<Entry>, Added), AddError> {
        let entry = Entry::new(loaded, Owner::Upload, None);
        let mut inner = self.write();
        if let Some(known) = inner.entries.iter().find(|known| known.id == entry.id) {
            return Ok((Arc::clone(known), Added::Known));
        }
        let uploads = inner.entries.iter().filter(|known| known.owner == Owner::Upload);
        let (count, bytes) =
            uploads.fold((0, 0u64), |(n, bytes), known| (n + 1, bytes + known.voxel_bytes()));
        if count >= limits.volumes {
            return Err(AddError::Count(count));
        }
        let (needed, allowed) = (entry.voxel_bytes(), limits.voxel_bytes as u64);
        let free = allowed.saturating_sub(bytes);
        if needed > free {
            return Err(AddError::Bytes { needed, free, allowed });
        }
        self.residents.make_room(&inner.entries, needed)?;
        inner.entries.push(Arc::clone(&entry));
        Ok((entry, Added::New))
    }

    /// Gives a volume another label map.
    pub(super) fn set_labels(&self, id: &str, labels: Arc<LabelMap>) -> Result<Arc<Entry>, Problem> {
        let mut inner = self.write();
        let known = inner.entries.iter_mut().find(|entry| entry.id == id).ok_or_else(no_such_volume)?;
        *known = Arc::new(Entry { labels: Some(labels), ..Entry::clone(known) });
        Ok(Arc::clone(known))
    }

    /// The volume with this id.
    pub(super) fn find(&self, id: &str) -> Result<Arc<Entry>, Problem> {
        let inner = self.read();
        inner.entries.iter().find(|entry| entry.id == id).cloned().ok_or_else(no_such_volume)
    }

    /// The first volume that came.
    pub(super) fn first(&self) -> Result<Arc<Entry>, Problem> {
        self.read()
            .entries
            .first()
            .cloned()
            .ok_or_else(|| Problem::unavailable("no-volume", "no volume is loaded"))
    }

    /// The volume of this study and series: the first, where a series is several stacks.
    pub(super) fn find_series(&self, study_uid: &str, series_uid: &str) -> Result<Arc<Entry>, Problem> {
        let inner = self.read();
        let is_it = |entry: &&Arc<Entry>| {
            entry.identity.as_ref().is_some_and(|identity| identity.is(study_uid, series_uid))
        };
        inner.entries.iter().find(is_it).cloned().ok_or_else(|| {
            let detail = "no volume of this study and series is served";
            Problem::new(StatusCode::NOT_FOUND, "no-such-series", detail)
        })
    }

    /// How many are here, and how many are on their way.
    pub(super) fn count(&self) -> (usize, usize) {
        let inner = self.read();
        (inner.entries.len(), inner.expected)
    }

    /// Whether this volume is still here.
    pub(super) fn has(&self, entry: &Entry) -> bool {
        self.read().entries.iter().any(|known| known.id == entry.id)
    }

    fn remove(&self, id: &str) -> Result<Arc<Entry>, Problem> {
        let mut inner = self.write();
        let at = inner.entries.iter().position(|entry| entry.id == id).ok_or_else(no_such_volume)?;
        if inner.entries[at].owner == Owner::Operator {
            let detail =
                "this volume was given to the server at its start; only uploaded ones can be removed";
            return Err(Problem::new(StatusCode::FORBIDDEN, "not-removable", detail));
        }
        Ok(inner.entries.remove(at))
    }

    /// Entries are whole between statements, so a panic elsewhere leaves them usable.
    fn read(&self) -> RwLockReadGuard<'_, Inner> {
        self.inner.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self) -> RwLockWriteGuard<'_, Inner> {
        self.inner.write().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What clients learn of a label map: labels rising, colours as they are shown.
fn segments(map: &LabelMap) -> Vec<Value> {
    let segment = |(segment, voxels): (&Segment, u64)| {
        json!({
            "label": segment.label,
            "name": segment.name,
            "rgb": segment.color(),
            "voxels": voxels,
            "volume_ml": voxels as f64 * map.voxel_mm3() / 1000.0,
        })
    };
    map.counted().map(segment).collect()
}

fn no_such_volume() -> Problem {
    let detail = "no volume has this id; GET /v1/volumes lists them";
    Problem::new(StatusCode::NOT_FOUND, "no-such-volume", detail)
}

pub(super) async fn list(State(server): State<Arc<Server>>) -> Json<Value> {
    let inner = server.volumes.read();
    let volumes: Vec<Value> = inner.entries.iter().map(|entry| entry.describe()).collect();
    Json(json!({ "volumes": volumes, "loading": inner.expected }))
}

pub(super) async fn show(
    State(server): State<Arc<Server>>,
    Path(id): Path<String>,
) -> Result<Json<Value>, Problem> {
    Ok(Json(server.volumes.find(&id)?.describe()))
}

pub(super) async fn remove(
    State(server): State<Arc<Server>>,
    Path(id): Path<String>,
) -> Result<StatusCode, Problem> {
    let removed = server.volumes.remove(&id)?;
    server.service.forget(removed.hash);
    server.live.volume_removed();
    Ok(StatusCode::NO_CONTENT)
}
