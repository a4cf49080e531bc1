//! The volumes that are served, and their descriptions. They hold geometry and values, nothing about the patient.
//!
//! A volume's id is the beginning of its content hash: the same series has the same id everywhere.

use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use axum::Json;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use serde_json::{Value, json};

use super::problem::Problem;
use super::state::{Server, UploadLimits};
use crate::dicom::SeriesIdentity;
use crate::volume::Volume;

/// A volume and how many warnings its reading gave.
#[derive(Clone, Debug)]
pub struct LoadedVolume {
    /// The voxels and their place.
    pub volume: Volume,
    /// Warnings that the reader gave: the description shows their number.
    pub warnings: usize,
    /// The study and series that it answers for; `None` answers for none.
    pub identity: Option<SeriesIdentity>,
}

/// Who brought a volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Owner {
    Operator,
    Upload,
}

#[derive(Debug)]
pub(super) struct Entry {
    pub(super) id: String,
    pub(super) volume: Volume,
    warnings: usize,
    owner: Owner,
    identity: Option<SeriesIdentity>,
}

/// Whether an upload brought something new.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Added {
    New,
    Known,
}

/// All volumes, in the order of their arrival.
#[derive(Debug, Default)]
pub(super) struct Volumes(RwLock<Inner>);

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
        needed: usize,
        /// Bytes left of those allowed.
        free: usize,
        /// Bytes allowed.
        allowed: usize,
    },
}

impl Entry {
    fn new(loaded: LoadedVolume, owner: Owner) -> Arc<Self> {
        let id = loaded.volume.content_hash().short();
        let LoadedVolume { volume, warnings, identity } = loaded;
        Arc::new(Self { id, volume, warnings, owner, identity })
    }

    fn voxel_bytes(&self) -> usize {
        size_of_val(self.volume.voxels_hu())
    }

    /// What clients learn of a volume.
    pub(super) fn describe(&self) -> Value {
        let grid = self.volume.grid();
        let (low, high) = self.volume.range_hu();
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
            "warnings": self.warnings,
            "removable": self.owner == Owner::Upload,
            "links": { "self": format!("/v1/volumes/{}", self.id), "frame": format!("/v1/volumes/{}/frame", self.id) },
        })
    }
}

impl Volumes {
    pub(super) fn expect(&self, count: usize) {
        self.write().expected += count;
    }

    pub(super) fn add_own(&self, loaded: LoadedVolume) {
        let entry = Entry::new(loaded, Owner::Operator); // hashes the voxels: not under the lock
        let mut inner = self.write();
        inner.expected = inner.expected.saturating_sub(1);
        inner.entries.retain(|known| known.id != entry.id);
        inner.entries.push(entry);
    }

    /// Adds an upload, or finds it here already.
    pub(super) fn add_upload(
        &self,
        loaded: LoadedVolume,
        limits: UploadLimits,
    ) -> Result<(Arc<Entry>, Added), AddError> {
        let entry = Entry::new(loaded, Owner::Upload);
        let mut inner = self.write();
        if let Some(known) = inner.entries.iter().find(|known| known.id == entry.id) {
            return Ok((Arc::clone(known), Added::Known));
        }
        let uploads = inner.entries.iter().filter(|known| known.owner == Owner::Upload);
        let (count, bytes) = uploads.fold((0, 0), |(n, bytes), known| (n + 1, bytes + known.voxel_bytes()));
        if count >= limits.volumes {
            return Err(AddError::Count(count));
        }
        let (needed, allowed) = (entry.voxel_bytes(), limits.voxel_bytes);
        let free = allowed.saturating_sub(bytes);
        if needed > free {
            return Err(AddError::Bytes { needed, free, allowed });
        }
        inner.entries.push(Arc::clone(&entry));
        Ok((entry, Added::New))
    }

    /// The volume with this id.
    pub(super) fn find(&self, id: &str) -> Result<Arc<Entry>, Problem> {
        let inner = self.read();
        inner.entries.iter().find(|entry| entry.id == id).cloned().ok_or_else(no_such_volume)
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
        self.0.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self) -> RwLockWriteGuard<'_, Inner> {
        self.0.write().unwrap_or_else(PoisonError::into_inner)
    }
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
    server.service.forget(removed.volume.content_hash());
    Ok(StatusCode::NO_CONTENT)
}
