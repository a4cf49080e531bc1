//! How `relief serve` reads the series of its options: those of this machine in its own process,
//! those of buckets in a child process without rights.

use std::path::Path;
use std::sync::Arc;

use crate::isolation::Isolation;
use crate::source::{self, SeriesOptions};
use relief_dicom::Strictness;
use relief_session::LoadedVolume;

/// A reader of series.
pub(crate) trait SeriesReader: Send + Sync {
    /// The series in a folder or a file, at least one, each by the options that choose it.
    fn list(&self, path: &Path, options: &SeriesOptions) -> anyhow::Result<Vec<SeriesOptions>>;

    /// Reads a series, with its warnings on stderr. `wanted` sees its dimensions before voxels are
    /// read.
    fn read(
        &self,
        path: &Path,
        options: &SeriesOptions,
        wanted: &dyn Fn([usize; 3]) -> anyhow::Result<()>,
    ) -> anyhow::Result<LoadedVolume>;
}

/// A reader of series from buckets.
///
/// # Errors
/// When this system cannot isolate.
pub(crate) fn of_buckets(isolation: Isolation) -> anyhow::Result<Arc<dyn SeriesReader>> {
    match isolation {
        Isolation::Off => Ok(Arc::new(InProcess)),
        #[cfg(target_os = "linux")]
        Isolation::On => Ok(Arc::new(isolated::InChild::new()?)),
        #[cfg(not(target_os = "linux"))]
        Isolation::On => anyhow::bail!(crate::isolation::NEEDS_LINUX),
    }
}

/// Reads in this process.
#[derive(Debug)]
pub(crate) struct InProcess;

impl SeriesReader for InProcess {
    fn list(&self, path: &Path, options: &SeriesOptions) -> anyhow::Result<Vec<SeriesOptions>> {
        if relief_dicom::is_volume_file(path) || (options.series_uid.is_some() && options.phase.is_none()) {
            return Ok(vec![options.clone()]);
        }
        let found = relief_dicom::discover(path, Strictness::Lenient, &|_| ())?;
        if found.series.is_empty() {
            found.select(None)?; // says why
        }
        if let Some(phase) = options.phase {
            let chosen = found.select_phase(options.series_uid.as_deref(), phase as usize)?;
            return Ok(vec![with_uid(options, chosen.uid())]);
        }
        Ok(found.series.iter().map(|entry| with_uid(options, entry.uid())).collect())
    }

    fn read(
        &self,
        path: &Path,
        options: &SeriesOptions,
        wanted: &dyn Fn([usize; 3]) -> anyhow::Result<()>,
    ) -> anyhow::Result<LoadedVolume> {
        source::load_after(path, options, wanted).map(|(loaded, ())| served(loaded))
    }
}

/// The phases of a series of this machine, each by the options that choose it; `None` where the
/// options leave more than the phases of one region.
pub(super) fn phases(path: &Path, options: &SeriesOptions) -> anyhow::Result<Option<Vec<SeriesOptions>>> {
    let found = relief_dicom::discover(path, Strictness::Lenient, &|_| ())?;
    let phases = found.phases(options.series_uid.as_deref());
    let chosen = |phases: Vec<&relief_dicom::SeriesEntry>| {
        phases.into_iter().map(|phase| with_uid(options, phase.uid())).collect()
    };
    Ok(phases.map(chosen))
}

fn with_uid(options: &SeriesOptions, uid: &str) -> SeriesOptions {
    SeriesOptions { series_uid: Some(uid.to_owned()), phase: None, ..options.clone() }
}

/// A loaded series as the server takes it.
pub(crate) fn served(loaded: relief_dicom::Loaded) -> LoadedVolume {
    let relief_dicom::Loaded { volume, warnings, identity, reference, .. } = loaded;
    let warnings = warnings.iter().map(|warning| warning.code).collect();
    LoadedVolume { warnings, volume, identity: Some(identity), reference, labels: None }
}

#[cfg(target_os = "linux")]
mod isolated {
    use super::*;
    use anyhow::Context;
    use relief_base::Budget;
    use relief_isolation::{FoundSeries, IsolatedReader, Listing, SeriesChoice};

    /// The name of a series' files in messages: their own may be those of patients.
    const SUBJECT: &str = "the series' files";
    const NO_PHASE: &str = "--phase chooses in series of this machine; of a bucket or an archive, choose the series with \
                            --series-uid UID#N";

    /// Reads in a child process.
    #[derive(Debug)]
    pub(crate) struct InChild(IsolatedReader);

    impl InChild {
        pub(super) fn new() -> anyhow::Result<Self> {
            let reader = IsolatedReader::of_this_program();
            let reader = reader.context("series from buckets cannot be read in a child process; --isolation off reads them in the server's own")?;
            Ok(Self(reader))
        }
    }

    impl SeriesReader for InChild {
        fn list(&self, path: &Path, options: &SeriesOptions) -> anyhow::Result<Vec<SeriesOptions>> {
            if options.phase.is_some() {
                anyhow::bail!(NO_PHASE);
            }
            if options.series_uid.is_some() {
                return Ok(vec![options.clone()]);
            }
            match self.0.list(path, false, &Budget::default())? {
                Listing::VolumeFile(_) => Ok(vec![options.clone()]),
                Listing::Series(series) => {
                    Ok(series.iter().map(|listed| with_uid(options, &listed.uid)).collect())
                }
            }
        }

        fn read(
            &self,
            path: &Path,
            options: &SeriesOptions,
            wanted: &dyn Fn([usize; 3]) -> anyhow::Result<()>,
        ) -> anyhow::Result<LoadedVolume> {
            if options.phase.is_some() {
                anyhow::bail!(NO_PHASE);
            }
            let choice = SeriesChoice {
                subject: SUBJECT.to_owned(),
                uid: options.series_uid.clone(),
                is_strict: options.strict,
                downsample: options.downsample,
                takes_volume_files: true,
                hashes_content: false,
            };
            let voxel_bytes = source::limits().voxel_bytes;
            let wanted = |found: &FoundSeries| wanted(found.dims).map_err(Into::into);
            let (loaded, warnings) = self.0.series(path, choice, voxel_bytes, &Budget::default(), wanted)?;
            for warning in warnings {
                eprintln!("warning: {warning}");
            }
            Ok(loaded)
        }
    }
}
