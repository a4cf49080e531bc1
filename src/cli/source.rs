//! `--series` and its companions: what render, bench and serve share to load a volume. Series of
//! buckets and archives: see `remote`.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::bucket::CopiesArguments;
use crate::labels;
use crate::memory::available_bytes;
use crate::output::milliseconds;
use crate::remote;
use relief_dicom::{Discovery, LoadLimits, Loaded, Progress, SeriesEntry, Stage, Strictness, Warning};

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

/// How to choose and load a series.
#[derive(Clone, Debug, Default, clap::Args)]
pub(super) struct SeriesOptions {
    /// Which series, where PATH holds several (`relief inspect PATH` lists them)
    #[arg(long, value_name = "UID")]
    pub(super) series_uid: Option<String>,
    /// Fail on any defective file instead of leaving it out with a warning
    #[arg(long)]
    pub(super) strict: bool,
    /// Load every N³ voxels as their mean, for adapters whose limits the volume exceeds
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=16))]
    pub(super) downsample: u8,
}

impl SeriesArguments {
    /// [`load_after`] of this series.
    pub(super) fn load_after<T>(
        &self,
        before: impl FnOnce([usize; 3]) -> anyhow::Result<T>,
    ) -> anyhow::Result<(Loaded, T)> {
        remote::load_after(&self.series, &self.copies, &self.options, before)
    }

    /// Loads the label map onto the grid of the series, if one is given.
    pub(super) fn load_labels(&self, grid: &Grid) -> anyhow::Result<Option<Arc<LabelMap>>> {
        self.labels.as_deref().map(|path| labels::load(path, grid)).transpose()
    }
}

/// Loads the chosen series under `path`, with progress and warnings on stderr.
pub(super) fn load(path: &Path, options: &SeriesOptions) -> anyhow::Result<Loaded> {
    load_after(path, options, |_| Ok(())).map(|(loaded, ())| loaded)
}

/// As [`load`]; `before` is given the dimensions that the volume will have, when all headers are
/// read and no slice yet, and may refuse them. Of a volume in a single file it is given them when
/// that is read.
pub(super) fn load_after<T>(
    path: &Path,
    options: &SeriesOptions,
    before: impl FnOnce([usize; 3]) -> anyhow::Result<T>,
) -> anyhow::Result<(Loaded, T)> {
    if relief_dicom::is_volume_file(path) {
        // The adapter's limits are held against the header, before voxels are read.
        let grid = relief_dicom::read_grid(path).with_context(|| format!("cannot use {}", path.display()))?;
        let prepared = before(grid.dims().map(|side| side.div_ceil(options.downsample.into())))?;
        return Ok((load_file(path, options)?, prepared));
    }
    let strictness = strictness(options.strict);
    let found = discover(path, strictness)?;
    let entry = select(&found, options.series_uid.as_deref())?;
    warn(&found.warnings());
    let prepared = before(entry.dims().map(|side| side.div_ceil(options.downsample.into())))?;
    let loaded = load_entry(entry, strictness)?;
    warn(&loaded.warnings);
    Ok((loaded.downsampled(options.downsample.into()), prepared))
}

/// Loads a volume of another format than DICOM.
fn load_file(path: &Path, options: &SeriesOptions) -> anyhow::Result<Loaded> {
    if options.series_uid.is_some() {
        bail!("{} is one volume and no series; leave --series-uid out", path.display());
    }
    let found = relief_dicom::read_volume(path).with_context(|| format!("cannot use {}", path.display()))?;
    for warning in found.warnings {
        eprintln!("warning: {warning}");
    }
    Ok(Loaded::of_volume(found.volume).downsampled(options.downsample.into()))
}

/// The chosen series, or the only one; where there are several, the error names the option that
/// chooses.
pub(super) fn select<'a>(found: &'a Discovery, uid: Option<&str>) -> anyhow::Result<&'a SeriesEntry> {
    found.select(uid).map_err(|error| match error {
        relief_dicom::Error::SeveralSeries { .. } => {
            anyhow::Error::new(error).context("choose a series with --series-uid UID")
        }
        other => other.into(),
    })
}

/// What `--strict` means.
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

/// Work shorter than this is done before anyone wonders.
const WORTH_TELLING: Duration = Duration::from_secs(1);

/// A progress bar on a terminal, log lines at quarters elsewhere.
struct Reporter {
    started: Instant,
    bar: Mutex<Option<ProgressBar>>,
    quarters: AtomicUsize,
}

impl Default for Reporter {
    fn default() -> Self {
        Self { started: Instant::now(), bar: Mutex::default(), quarters: AtomicUsize::default() }
    }
}

/// Progress of a retrieval from an archive.
#[derive(Default)]
pub(super) struct RetrievalBar(Reporter);

impl RetrievalBar {
    /// So many of all files have arrived.
    pub(super) fn report(&self, done: usize, all: usize) {
        self.0.report_as("retrieving slices", done, all);
    }
}

impl Reporter {
    fn report(&self, Progress { stage, done, total }: Progress) {
        self.report_as(verb(stage), done, total);
    }

    fn report_as(&self, verb: &'static str, done: usize, total: usize) {
        self.log_quarter(verb, done, total);
        let Ok(mut bar) = self.bar.lock() else { return };
        let bar = bar.get_or_insert_with(|| new_bar(verb, total));
        bar.inc(1);
        if bar.position() >= total as u64 {
            bar.finish_and_clear();
        }
    }

    fn log_quarter(&self, verb: &str, done: usize, total: usize) {
        if std::io::stderr().is_terminal() || self.started.elapsed() < WORTH_TELLING {
            return;
        }
        let quarter = done * 4 / total.max(1);
        if self.quarters.fetch_max(quarter, Ordering::Relaxed) < quarter {
            tracing::info!("{verb}: {done} of {total}");
        }
    }
}

/// Draws on a terminal only; a series that loads at once shows nothing.
fn new_bar(verb: &'static str, total: usize) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr_with_hz(10));
    let style = ProgressStyle::with_template("{prefix} {bar:40} {pos}/{len} {eta}");
    bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar())).with_prefix(verb)
}

fn verb(stage: Stage) -> &'static str {
    match stage {
        Stage::Headers => "reading headers",
        Stage::Slices => "decoding slices",
    }
}
