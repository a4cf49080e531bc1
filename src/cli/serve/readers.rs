//! How `relief serve` reads what clients upload: in a child process without rights, or in its own.

use std::path::Path;
use std::sync::Arc;

use anyhow::Context;

use crate::isolation::Isolation;
use crate::serve::series::served;
use relief_dicom::{LoadLimits, Strictness};
use relief_exchange::{Format, Imported, ReadContext};
use relief_render::VolumeLimits;
use relief_server::{AnnotationsLoader, ImportError, LabelsLoader, UploadLimits, VolumeLoader};
use relief_session::{load_labels, most_label_voxels};

/// The readers of a server.
pub(crate) struct Readers {
    pub(crate) series: VolumeLoader,
    pub(crate) labels: LabelsLoader,
    pub(crate) annotations: AnnotationsLoader,
}

/// The name of an uploaded file in messages: its own may be that of a patient.
const SUBJECT: &str = "the uploaded file";

/// Most bytes of an uploaded series' voxels.
fn voxel_bytes() -> u64 {
    UploadLimits::default().voxel_bytes as u64
}

impl Readers {
    /// Readers that keep to the limits of the adapter; whether they are used decides what is tried.
    ///
    /// # Errors
    /// When this system lacks the isolation that is used.
    pub(crate) fn new(isolation: Isolation, is_used: bool, limits: VolumeLimits) -> anyhow::Result<Self> {
        match isolation {
            Isolation::On => Self::isolated(is_used, limits),
            Isolation::Off => Ok(Self::in_process(limits)),
        }
    }

    #[cfg(target_os = "linux")]
    fn isolated(is_used: bool, volumes: VolumeLimits) -> anyhow::Result<Self> {
        use relief_isolation::{FoundSeries, IsolatedReader, IsolationError, SeriesChoice};
        const CANNOT: &str = "uploads cannot be read in a child process; --uploads off refuses them, --isolation off reads them in the server's own";
        let reader = IsolatedReader::of_this_program().context(CANNOT)?;
        if is_used {
            let rights = reader.remaining_rights().context(CANNOT)?;
            if !rights.are_none() {
                eprintln!(
                    "warning: the child processes that read uploads have rights left (relief doctor): one {rights}"
                );
            }
        }
        let [for_labels, for_annotations] = [reader.clone(), reader.clone()];
        Ok(Self {
            series: Arc::new(move |path, budget| {
                let wanted = |found: &FoundSeries| volumes.plan(found.dims).map(drop).map_err(Into::into);
                Ok(reader.series(path, SeriesChoice::only(SUBJECT), voxel_bytes(), budget, wanted)?.0)
            }),
            labels: Arc::new(move |path, grid| {
                let loaded = for_labels.labels(path, grid)?;
                warn(&loaded.warnings);
                Ok(loaded.map)
            }),
            annotations: Arc::new(move |path, name, format, context| {
                let read = for_annotations.annotations(path, name, format, context);
                read.map_err(|error| match error {
                    IsolationError::UnknownFormat => ImportError::UnknownFormat,
                    error => ImportError::Unreadable(error.into()),
                })
            }),
        })
    }

    #[cfg(not(target_os = "linux"))]
    fn isolated(_: bool, _: VolumeLimits) -> anyhow::Result<Self> {
        anyhow::bail!(crate::isolation::NEEDS_LINUX)
    }

    fn in_process(volumes: VolumeLimits) -> Self {
        let about = |error: relief_dicom::Error| error.without_names(SUBJECT);
        Self {
            series: Arc::new(move |path, budget| {
                let found = relief_dicom::discover_within(budget, path, Strictness::Lenient, &|_| ());
                let found = found.map_err(about)?;
                let entry = found.select(None).map_err(about)?;
                volumes.plan(entry.dims())?;
                let limits = LoadLimits { voxel_bytes: voxel_bytes() };
                let loaded = relief_dicom::load_within(limits, entry, Strictness::Lenient, &|_| ());
                Ok(loaded.map(served).map_err(about)?)
            }),
            labels: Arc::new(|path, grid| {
                let loaded =
                    load_labels(path, most_label_voxels(grid), grid).map_err(|error| error.about(SUBJECT))?;
                warn(&loaded.warnings);
                Ok(loaded.map)
            }),
            annotations: Arc::new(annotations),
        }
    }
}

fn warn(warnings: &[String]) {
    warnings.iter().for_each(|warning| tracing::warn!("an uploaded label map: {warning}"));
}

/// Reads a file of annotations in this process.
fn annotations(
    path: &Path,
    name: &str,
    format: Option<Format>,
    context: &ReadContext<'_>,
) -> Result<Imported, ImportError> {
    let unreadable = |error: std::io::Error| ImportError::Unreadable(error.into());
    let bytes = std::fs::read(path).map_err(unreadable)?;
    let format = format.or_else(|| Format::of(Path::new(name), &bytes));
    let read = relief_exchange::read(format.ok_or(ImportError::UnknownFormat)?, &bytes, context);
    read.map_err(|error| ImportError::Unreadable(error.into()))
}
