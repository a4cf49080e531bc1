//! A series of a job: found again where it was planned, checked to be the same, loaded.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use data_encoding::HEXLOWER;
use serde::{Deserialize, Serialize};

use super::copies::Copies;
use super::error::{FailureKind, SeriesError};
use super::gate::{MemoryBudget, ReservedMemory};
use super::isolation::{self, FoundSeries, IsolatedReader, IsolationError};
use parking_lot::Mutex;
use relief_base::{Budget, sha256_of_file};
use relief_dicom::{LoadLimits, SeriesEntry, SeriesReference, Strictness};
use relief_render::framing_of_tissue;
use relief_session::load_labels;
use relief_volume::{Anatomy, Framing, Grid, LabelMap, Occupancy, Table, Volume};

/// The location and identity of a series.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SeriesSource {
    /// A folder, file, DICOMDIR or zip; or a volume as `.nii`, `.nii.gz` or `.nrrd`. Of this
    /// machine, or in a bucket: `s3://BUCKET/KEY`.
    pub path: PathBuf,
    /// Its UID, where the path holds several series.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uid: Option<String>,
    /// The name of its outputs: from a table, or the beginning of the hash.
    pub name: String,
    /// SHA-256 of its files.
    pub sha256: String,
    /// The label map that its scenes know segments by.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub labels: Option<LabelsSource>,
    /// The phase whose framing and table it has, of a series that shows one region several times.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first_phase: Option<PhaseSource>,
}

/// A phase at the same path.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhaseSource {
    /// Its UID.
    pub uid: String,
    /// SHA-256 of its files.
    pub sha256: String,
}

/// Framing, preset and table of the first phase of a region: all phases have them.
#[derive(Debug)]
pub(super) struct SharedLook {
    source: PhaseSource,
    grid: Grid,
    pub(super) occupancy: Arc<Occupancy>,
    pub(super) tissue: Framing,
    pub(super) anatomy: Anatomy,
    table: Option<Arc<Table>>,
}

/// The look of the phases that were loaded last: the next ones are of the same region.
#[derive(Debug, Default)]
pub(super) struct LastLook(Mutex<Option<Arc<SharedLook>>>);

/// The location and identity of a label map.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelsSource {
    /// A NIfTI, NRRD or DICOM segmentation. Of this machine, or in a bucket.
    pub path: PathBuf,
    /// SHA-256 of the file.
    pub sha256: String,
}

/// A volume with the bytes that it holds of a gate.
#[derive(Debug)]
pub(super) struct BudgetedVolume<'a> {
    pub(super) volume: Volume,
    /// On its grid.
    pub(super) labels: Option<Arc<LabelMap>>,
    /// Framing, preset and table of a phase.
    pub(super) look: Option<Arc<SharedLook>>,
    /// The series that DICOM objects of its pictures belong to.
    pub(super) reference: Option<Arc<SeriesReference>>,
    /// Warnings from reading the series.
    pub(super) warnings: Vec<String>,
    held: ReservedMemory<'a>,
}

impl BudgetedVolume<'_> {
    /// Counts the voxels of the volume without its table, once they have been made.
    pub(super) fn count_copy(&mut self) {
        if self.volume.has_copy_without_table() {
            self.held.grow(size_of_val(self.volume.voxels_hu()) as u64);
        }
    }
}

impl SeriesSource {
    /// Loads the series within the limit of the gate, when memory is free; from a bucket through a
    /// copy. Errors are shown to others, so they name no file: folders may be named after patients.
    pub(super) fn load<'a>(
        &self,
        gate: &'a MemoryBudget,
        copies: &Copies,
        last: &LastLook,
    ) -> Result<BudgetedVolume<'a>, SeriesError> {
        let local = copies.local(&self.path).map_err(|error| SeriesError::new(kind_of(&error), &error))?;
        let path = local.path();
        // Before its own voxels take the memory.
        let look = self.first_phase.as_ref().map(|first| last.of(first, path, gate)).transpose()?;
        let mut loaded = match local.isolated() {
            Some(reader) => self.load_isolated(reader, path, gate)?,
            None if relief_dicom::is_volume_file(path) => self.load_file(path, gate)?,
            None => self.load_series(path, gate)?,
        };
        if let Some(look) = look.filter(|look| look.grid == *loaded.volume.grid()) {
            loaded.volume = loaded.volume.with_table(look.table.clone());
            loaded.look = Some(look);
        }
        if let Some(labels) = &self.labels {
            labels.load(copies, gate, &mut loaded)?;
        }
        let bytes = size_of_val(loaded.volume.voxels_hu()) as u64;
        loaded.held.shrink(bytes + loaded.labels.as_ref().map_or(0, |map| labels_bytes(map)));
        Ok(loaded)
    }

    fn load_series<'a>(
        &self,
        path: &Path,
        gate: &'a MemoryBudget,
    ) -> Result<BudgetedVolume<'a>, SeriesError> {
        let found =
            relief_dicom::discover(path, Strictness::Lenient, &|_| ()).map_err(|error| of_dicom(&error))?;
        let entry = found.select(self.uid.as_deref()).map_err(|error| of_dicom(&error))?;
        self.expect(&HEXLOWER.encode(&entry.content_sha256().map_err(|error| of_dicom(&error))?))?;
        // A label map has at most as many bytes as the voxels.
        let bytes = needed_bytes(entry).saturating_mul(1 + u64::from(self.labels.is_some()));
        if bytes > gate.limit() {
            return Err(too_large(bytes, gate.limit()));
        }
        let held = gate.hold(bytes);
        let limits = LoadLimits { voxel_bytes: gate.limit() };
        let loaded = relief_dicom::load_within(limits, entry, Strictness::Lenient, &|_| ())
            .map_err(|error| of_dicom(&error))?;
        let warnings = found.warnings().into_iter().chain(loaded.warnings);
        let warnings = warnings.map(|warning| warning.message).collect();
        let (volume, reference) = (loaded.volume, loaded.reference);
        Ok(BudgetedVolume { volume, labels: None, look: None, reference, warnings, held })
    }

    fn load_file<'a>(&self, path: &Path, gate: &'a MemoryBudget) -> Result<BudgetedVolume<'a>, SeriesError> {
        let sha256 = sha256_of_file(path).map_err(SeriesError::retryable)?;
        self.expect(&sha256)?;
        // How large it is, is known when it is read.
        let held = gate.hold(gate.limit());
        let limits = relief_dicom::FormatLimits { voxels: gate.limit() / size_of::<i16>() as u64 };
        let read = relief_dicom::read_volume_within(limits, path)
            .map_err(|error| SeriesError::permanent(error.about("its file")))?;
        let warnings = read.warnings.into_iter().map(|warning| warning.message).collect();
        let volume = read.volume;
        Ok(BudgetedVolume { volume, labels: None, look: None, reference: None, warnings, held })
    }

    /// Loads the series in a child process.
    fn load_isolated<'a>(
        &self,
        reader: &IsolatedReader,
        path: &Path,
        gate: &'a MemoryBudget,
    ) -> Result<BudgetedVolume<'a>, SeriesError> {
        let is_file = relief_dicom::is_volume_file(path);
        if is_file {
            self.expect(&sha256_of_file(path).map_err(SeriesError::retryable)?)?;
        }
        let mut held = None;
        let wanted = |found: &FoundSeries| {
            if !is_file {
                self.expect(found.sha256.as_deref().unwrap_or_default())?;
            }
            let voxels = found.dims.iter().fold(1_u64, |count, side| count.saturating_mul(*side as u64));
            let bytes = voxels.saturating_mul(size_of::<i16>() as u64);
            let bytes = bytes.saturating_mul(1 + u64::from(self.labels.is_some()));
            if bytes > gate.limit() {
                return Err(too_large(bytes, gate.limit()).into());
            }
            held = Some(gate.hold(bytes));
            Ok(())
        };
        let choice = isolation::choice(self.uid.as_deref());
        let read = reader.series(path, choice, gate.limit(), &Budget::default(), wanted);
        let (loaded, warnings) = read.map_err(of_child)?;
        let held = held.unwrap_or_else(|| gate.hold(0));
        let (volume, reference) = (loaded.volume, loaded.reference);
        Ok(BudgetedVolume { volume, labels: None, look: None, reference, warnings, held })
    }

    fn expect(&self, found: &str) -> Result<(), SeriesError> {
        if self.sha256 == found {
            return Ok(());
        }
        Err(SeriesError::permanent("the series' files have changed since planning; plan again"))
    }
}

impl LastLook {
    /// The look of the phases whose first one this is.
    fn of(
        &self,
        first: &PhaseSource,
        path: &Path,
        gate: &MemoryBudget,
    ) -> Result<Arc<SharedLook>, SeriesError> {
        let mut last = self.0.lock();
        if let Some(known) = last.as_ref().filter(|known| known.source == *first) {
            return Ok(Arc::clone(known));
        }
        let look = Arc::new(first.load(path, gate)?);
        *last = Some(Arc::clone(&look));
        Ok(look)
    }
}

impl PhaseSource {
    fn load(&self, path: &Path, gate: &MemoryBudget) -> Result<SharedLook, SeriesError> {
        let source = SeriesSource {
            path: path.to_owned(),
            uid: Some(self.uid.clone()),
            name: String::new(),
            sha256: self.sha256.clone(),
            labels: None,
            first_phase: None,
        };
        let mut loaded = source.load_series(path, gate)?;
        let shown = loaded.volume.without_table();
        let (occupancy, grid) = (Arc::clone(shown.occupancy()), shown.grid().clone());
        let tissue = framing_of_tissue(&occupancy, &grid);
        let (anatomy, table) = (shown.anatomy(), loaded.volume.table().cloned());
        loaded.count_copy();
        Ok(SharedLook { source: self.clone(), grid, occupancy, tissue, anatomy, table })
    }
}

impl LabelsSource {
    /// Loads the label map onto the grid of the volume, within the reserved bytes.
    fn load(
        &self,
        copies: &Copies,
        gate: &MemoryBudget,
        loaded: &mut BudgetedVolume<'_>,
    ) -> Result<(), SeriesError> {
        let of_file =
            |error: std::io::Error| SeriesError::new(kind_of(&error), format_args!("its label map: {error}"));
        let local = copies.local(&self.path).map_err(of_file)?;
        let path = local.path();
        if sha256_of_file(path).map_err(of_file)? != self.sha256 {
            return Err(SeriesError::permanent(
                "the series' label map has changed since planning; plan again",
            ));
        }
        let grid = loaded.volume.grid();
        let labels = match local.isolated() {
            Some(reader) => reader.labels(path, grid).map_err(|error| {
                let SeriesError { kind, reason } = of_child(error);
                SeriesError::new(kind, format_args!("its label map: {reason}"))
            })?,
            None => load_labels(path, gate.limit() / size_of::<u16>() as u64, grid).map_err(|error| {
                SeriesError::permanent(format_args!("its label map: {}", error.about("its file")))
            })?,
        };
        loaded.warnings.extend(labels.warnings);
        loaded.labels = Some(labels.map);
        Ok(())
    }
}

/// Why a child process did not read a series.
fn of_child(error: IsolationError) -> SeriesError {
    match error {
        IsolationError::Unwanted(reason) => match reason.downcast::<SeriesError>() {
            Ok(error) => *error,
            Err(reason) => SeriesError::permanent(reason),
        },
        // The machine is at fault, not the series.
        error @ (IsolationError::Start(_) | IsolationError::NoMemory | IsolationError::Cancelled(_)) => {
            SeriesError::new(FailureKind::Retryable, error)
        }
        error => SeriesError::permanent(error),
    }
}

fn labels_bytes(map: &LabelMap) -> u64 {
    (map.grid().voxel_count() * size_of::<u16>()) as u64
}

/// Missing or invalid input fails again at the next try.
fn kind_of(error: &std::io::Error) -> FailureKind {
    match error.kind() {
        std::io::ErrorKind::NotFound | std::io::ErrorKind::InvalidInput => FailureKind::Permanent,
        _ => FailureKind::Retryable,
    }
}

/// Voxels as read, and once more while they are resampled, as uneven stacks are.
fn needed_bytes(entry: &SeriesEntry) -> u64 {
    entry.voxel_bytes()
}

fn too_large(needed: u64, allowed: u64) -> SeriesError {
    let (needed, allowed) = (needed.div_ceil(1 << 20), allowed >> 20);
    SeriesError::permanent(format_args!(
        "the volume needs {needed} MiB, and {allowed} MiB are for voxels; allow more with --memory"
    ))
}

fn of_dicom(error: &relief_dicom::Error) -> SeriesError {
    let kind = match error {
        relief_dicom::Error::Unreadable { source, .. } if source.kind() != std::io::ErrorKind::NotFound => {
            FailureKind::Retryable
        }
        relief_dicom::Error::Memory { .. } => FailureKind::Retryable,
        _ => FailureKind::Permanent,
    };
    SeriesError::new(kind, error.without_names("its files"))
}
