//! Series of this machine: how they are chosen, found and loaded. Those of buckets and archives:
//! see `series`.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context, bail};

use crate::memory::available_bytes;
use crate::output::milliseconds;
use crate::progress::Reporter;
use relief_dicom::{Discovery, LoadLimits, Loaded, SeriesEntry, Strictness, Warning};

/// How to choose and load a series.
#[derive(Clone, Debug, Default, clap::Args)]
pub(super) struct SeriesOptions {
    /// The series, where PATH holds several (`relief inspect PATH` lists them)
    #[arg(long, value_name = "UID")]
    pub(super) series_uid: Option<String>,
    /// The phase of a series that shows one region several times, from 1 (`relief inspect PATH` lists them)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) phase: Option<u32>,
    /// Fail on any defective file instead of leaving it out with a warning
    #[arg(long)]
    pub(super) strict: bool,
    /// Load every N³ voxels as their mean, for adapters whose limits the volume exceeds
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=16))]
    pub(super) downsample: u8,
}

/// Loads the chosen series under `path`, with progress and warnings on stderr. `before` receives the
/// dimensions that the volume will have, when all headers are read and no voxel yet, and may refuse
/// them.
pub(super) fn load_after<T>(
    path: &Path,
    options: &SeriesOptions,
    before: impl FnOnce([usize; 3]) -> anyhow::Result<T>,
) -> anyhow::Result<(Loaded, T)> {
    if relief_dicom::is_volume_file(path) {
        // The header is checked against the limits of the adapter before voxels are read.
        let grid = relief_dicom::read_grid(path).with_context(|| format!("cannot use {}", path.display()))?;
        let prepared = before(grid.dims().map(|side| side.div_ceil(options.downsample.into())))?;
        return Ok((load_file(path, options)?, prepared));
    }
    let strictness = strictness(options.strict);
    let found = discover(path, strictness)?;
    let entry = options.select(&found)?;
    warn(&found.warnings());
    let prepared = before(entry.dims().map(|side| side.div_ceil(options.downsample.into())))?;
    let mut loaded = load_entry(entry, strictness)?;
    warn(&loaded.warnings);
    loaded.warnings.extend(found.warnings());
    Ok((loaded.downsampled(options.downsample.into()), prepared))
}

/// Loads a volume of another format than DICOM.
fn load_file(path: &Path, options: &SeriesOptions) -> anyhow::Result<Loaded> {
    if options.series_uid.is_some() || options.phase.is_some() {
        bail!("{} is one volume and no series; leave --series-uid and --phase out", path.display());
    }
    let loaded = read_file(path)?;
    warn(&loaded.warnings);
    Ok(loaded.downsampled(options.downsample.into()))
}

/// Reads a volume of another format than DICOM.
pub(super) fn read_file(path: &Path) -> anyhow::Result<Loaded> {
    let read = relief_dicom::read_volume(path).with_context(|| format!("cannot use {}", path.display()))?;
    Ok(Loaded::of_volume(read))
}

impl SeriesOptions {
    /// The series that the options choose.
    fn select<'a>(&self, found: &'a Discovery) -> anyhow::Result<&'a SeriesEntry> {
        let uid = self.series_uid.as_deref();
        match self.phase {
            Some(phase) => Ok(found.select_phase(uid, phase as usize)?),
            None => select(found, uid),
        }
    }
}

/// The chosen series, or the only one; where there are several, the error names the option that
/// chooses.
pub(super) fn select<'a>(found: &'a Discovery, uid: Option<&str>) -> anyhow::Result<&'a SeriesEntry> {
    found.select(uid).map_err(|error| match error {
        relief_dicom::Error::SeveralSeries { .. } => {
            let phases = found.series.iter().any(|entry| entry.phase().is_some());
            let also = if phases { ", or a phase with --phase N" } else { "" };
            anyhow::Error::new(error).context(format!("choose a series with --series-uid UID{also}"))
        }
        other => other.into(),
    })
}

/// The strictness that `--strict` selects.
pub(super) fn strictness(strict: bool) -> Strictness {
    if strict { Strictness::Strict } else { Strictness::Lenient }
}

/// [`relief_dicom::discover`] with progress on stderr.
pub(super) fn discover(path: &Path, strictness: Strictness) -> anyhow::Result<Discovery> {
    let (start, reporter) = (Instant::now(), Reporter::default());
    let found = relief_dicom::discover(path, strictness, &|progress| reporter.report(progress))?;
    tracing::debug!("found {} series in {:.1} ms", found.series.len(), milliseconds(start));
    Ok(found)
}

/// [`relief_dicom::load_within`] with progress on stderr.
pub(super) fn load_entry(entry: &SeriesEntry, strictness: Strictness) -> anyhow::Result<Loaded> {
    let (start, reporter) = (Instant::now(), Reporter::default());
    let loaded =
        relief_dicom::load_within(limits(), entry, strictness, &|progress| reporter.report(progress));
    let loaded = loaded.context("cannot load the series")?; // without its UID, which may not leave this machine
    tracing::debug!("loaded {:?} voxels in {:.1} ms", loaded.volume.grid().dims(), milliseconds(start));
    Ok(loaded)
}

/// The library's own limits, and no more than this machine has to give: a system that promises
/// memory which it does not have ends the process when that is touched.
pub(super) fn limits() -> LoadLimits {
    let usual = LoadLimits::default().voxel_bytes;
    LoadLimits { voxel_bytes: available_bytes().map_or(usual, |available| usual.min(available)) }
}

/// Shows warnings on stderr.
pub(super) fn warn(warnings: &[Warning]) {
    for warning in warnings {
        eprintln!("warning: {}", warning.message);
    }
}
