//! `--series` and its companions: series of this machine, of buckets and of archives, for commands
//! that load one.
//!
//! Files that come over the network are read in a child process where the system can isolate one.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context;

use crate::bucket::CopiesArguments;
use crate::isolation::Isolation;
use crate::labels;
use crate::serve::series::of_buckets;
use crate::source::{self, SeriesOptions};
use relief_batch::Location;
use relief_dicom::{Loaded, ReadVolume};
use relief_volume::{Grid, LabelMap};

/// A CT series to load.
#[derive(Debug, clap::Args)]
pub(super) struct SeriesArguments {
    /// CT series: a folder, a file, a DICOMDIR or a zip; a volume in HU as .nii, .nii.gz or .nrrd;
    /// or of a bucket, s3://BUCKET/PREFIX, or a DICOM archive,
    /// dicomweb+https://HOST/ROOT/studies/UID/series/UID
    #[arg(long, value_name = "PATH")]
    pub(super) series: PathBuf,
    /// Segments of the series: a label map as .nii, .nii.gz, .nrrd or .seg.nrrd, or a DICOM
    /// segmentation
    #[arg(long, value_name = "FILE")]
    pub(super) labels: Option<PathBuf>,
    #[command(flatten)]
    pub(super) options: SeriesOptions,
    #[command(flatten)]
    pub(super) copies: CopiesArguments,
}

impl SeriesArguments {
    /// [`load_after`] of this series.
    pub(super) fn load_after<T>(
        &self,
        before: impl FnOnce([usize; 3]) -> anyhow::Result<T>,
    ) -> anyhow::Result<(Loaded, T)> {
        load_after(&self.series, &self.copies, &self.options, before)
    }

    /// Loads the label map onto the grid of the series, if one is given.
    pub(super) fn load_labels(&self, grid: &Grid) -> anyhow::Result<Option<Arc<LabelMap>>> {
        self.labels.as_deref().map(|path| labels::load(path, grid)).transpose()
    }
}

/// [`source::load_after`] of a path, or of a copy of the series that an address names.
pub(super) fn load_after<T>(
    path: &Path,
    copies: &CopiesArguments,
    options: &SeriesOptions,
    before: impl FnOnce([usize; 3]) -> anyhow::Result<T>,
) -> anyhow::Result<(Loaded, T)> {
    if !Location::is_remote(path) {
        return source::load_after(path, options, before);
    }
    let about = || format!("cannot load {}", Location::public_name(path));
    // A temporary folder of copies lives as long as these.
    let copies = copies.copies_with_progress()?;
    let local = copies.local(path).with_context(about)?;
    let reader = of_buckets(Isolation::DEFAULT)?;
    let (before, prepared) = (RefCell::new(Some(before)), RefCell::new(None));
    let wanted = |dims| {
        if let Some(before) = before.take() {
            prepared.replace(Some(before(dims)?));
        }
        Ok(())
    };
    let read = reader.read(local.path(), options, &wanted).with_context(about)?;
    let prepared = prepared.take().context("the dimensions of the series are unknown")?;
    let mut loaded = Loaded::of_volume(ReadVolume { volume: read.volume, warnings: Vec::new() });
    loaded.identity = read.identity.unwrap_or_default();
    loaded.reference = read.reference;
    Ok((loaded, prepared))
}
