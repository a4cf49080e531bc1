//! `relief batch`: many views of many series.

use std::io::{BufReader, IsTerminal};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::{Map, Value, json};

use super::adapter::AdapterArguments;
use super::memory::{available_bytes, parse_bytes};
use super::output::{GrowingFile, print_json, say};
use crate::batch::{
    Failure, Job, JobKey, Lasting, Options, Product, Request, Root, Shard, Step, Summary, ViewSet, plan,
    read_manifest, run as run_jobs, write_report,
};
use crate::camera::Orbit;
use crate::render::SceneFile;

/// Render many views of many series, as jobs that are done once.
///
/// `plan` finds the series under a folder, or those of a table, and writes one job for each view of each. `run` renders the jobs
/// that are not done: run it again, on as many machines as you like, until nothing is left. A job is known by a hash of its series'
/// files, its scene and its products.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  relief batch plan --root archive --views turntable:8 --preset bone --out jobs.jsonl
  relief batch run --manifest jobs.jsonl --out views
  relief batch run --manifest jobs.jsonl --out views --shard 0/4     one of four machines
  relief batch report --manifest jobs.jsonl --out views              pages and sheets after shards

Exit status of run: 0 all done, 1 some jobs failed for good, 75 some failed that may succeed when run again.")]
pub(super) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    Plan(PlanArguments),
    Run(RunArguments),
    Report(ReportArguments),
}

/// Write the jobs: one for each view of each series
#[derive(Debug, clap::Args)]
struct PlanArguments {
    /// Folder of series: each folder, zip, .nii, .nii.gz and .nrrd in it is looked at
    #[arg(long, value_name = "DIR", required_unless_present = "table", conflicts_with = "table")]
    root: Option<PathBuf>,
    /// Table of series, CSV with a header line: path, and if wanted series_uid and name (what its outputs are called)
    #[arg(long, value_name = "FILE.csv")]
    table: Option<PathBuf>,
    /// Views with commas between them: turntable:N, sides (six), planes (axial, coronal, sagittal), or a file: a JSON array of
    /// {"name", "azimuth_deg", "elevation_deg", "scene"}
    #[arg(long, value_name = "SETS")]
    views: String,
    /// Scene that all views share, as JSON
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Preset of colours and light of all views
    #[arg(long, value_name = "NAME")]
    preset: Option<String>,
    /// Width and height of pictures, where the layout does not say
    #[arg(long, value_name = "WxH", value_parser = super::scene::parse_size)]
    size: Option<[u32; 2]>,
    /// 1 fits the whole volume; larger is closer
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    zoom: f64,
    /// What is written of each view: frame (2D plus depth), color, depth (EXR, mm)
    #[arg(long, value_name = "PRODUCTS", value_delimiter = ',', default_value = "frame,color")]
    products: Vec<Product>,
    /// The manifest: a job a line
    #[arg(long, value_name = "JOBS.jsonl")]
    out: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Render the jobs that are not done
#[derive(Debug, clap::Args)]
struct RunArguments {
    /// The manifest
    #[arg(long, value_name = "JOBS.jsonl")]
    manifest: PathBuf,
    /// The folder of outputs
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// One of N equal shares, from 0: all views of a series are in one
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,
    /// This job alone; may be given several times
    #[arg(long, value_name = "KEY")]
    job: Vec<String>,
    /// Memory for volumes on this machine and its adapter together; half of what is available where left out
    #[arg(long, value_name = "BYTES", value_parser = parse_bytes)]
    memory: Option<u64>,
    #[command(flatten)]
    adapter: AdapterArguments,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Write report.html, contact sheets and turntables of what is done
#[derive(Debug, clap::Args)]
struct ReportArguments {
    /// The manifest
    #[arg(long, value_name = "JOBS.jsonl")]
    manifest: PathBuf,
    /// The folder of outputs
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// A run that failed in a way that may pass: EX_TEMPFAIL of sysexits.
const TRY_AGAIN: u8 = 75;
/// Share of the memory for voxels that are not on the adapter: theirs there take five times as much, with gradients.
const VOXEL_SHARE: f64 = 0.25;
/// What the program and a software adapter take beside volumes.
const BESIDE_BYTES: u64 = 512 << 20;

pub(super) fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    match arguments.command {
        Command::Plan(arguments) => write_plan(&arguments),
        Command::Run(arguments) => run_manifest(&arguments),
        Command::Report(ReportArguments { manifest, out }) => {
            write_report(&read(&manifest)?, &[], &out).context("cannot write the report")?;
            say!("{}", out.join("report.html").display());
            Ok(ExitCode::SUCCESS)
        }
    }
}

fn write_plan(arguments: &PlanArguments) -> anyhow::Result<ExitCode> {
    let root = match (&arguments.root, &arguments.table) {
        (Some(folder), _) => Root::Folder(folder.clone()),
        (None, Some(table)) => Root::Table(table.clone()),
        (None, None) => bail!("give --root or --table"),
    };
    let mut products = arguments.products.clone();
    products.sort_unstable();
    products.dedup();
    let orbit = Orbit { zoom: arguments.zoom, ..Orbit::default() };
    orbit.validate()?;
    let request = Request {
        root,
        views: ViewSet::parse(&arguments.views)?,
        scene: shared_scene(arguments)?,
        orbit,
        products,
    };
    let bar = bar("looking for series");
    let planned = plan(&request, &mut |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    for (path, reason) in &planned.skipped {
        eprintln!("warning: {}: {reason}", path.display());
    }
    let mut manifest = GrowingFile::create(&arguments.out)?;
    planned.jobs.iter().try_for_each(|job| manifest.line(&serde_json::to_string(job)?))?;
    manifest.finish()?;
    if arguments.json {
        let skipped: Vec<_> =
            planned.skipped.iter().map(|(path, reason)| json!({ "path": path, "reason": reason })).collect();
        print_json(&json!({
            "out": arguments.out, "series": planned.series, "jobs": planned.jobs.len(), "skipped": skipped,
        }))?;
    } else {
        let (jobs, series) = (planned.jobs.len(), planned.series);
        say!("{}: {jobs} jobs of {series} series", arguments.out.display());
    }
    Ok(ExitCode::SUCCESS)
}

/// Keys of the scene that all views share.
fn shared_scene(arguments: &PlanArguments) -> anyhow::Result<Map<String, Value>> {
    let mut scene = Map::new();
    if let Some(path) = &arguments.scene {
        let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
        let file = SceneFile::parse(&bytes).with_context(|| format!("{} is not a scene", path.display()))?;
        if file.has_camera() || file.is_slice() {
            bail!("{} has a view of its own; put it into a file for --views", path.display());
        }
        scene = serde_json::from_slice(&bytes)?;
    }
    if let Some(preset) = &arguments.preset {
        scene.insert("transfer".to_owned(), preset.clone().into());
    }
    if let Some(size_px) = arguments.size {
        scene.insert("size_px".to_owned(), size_px.to_vec().into());
    }
    if scene.contains_key("budget_ms") {
        bail!("budget_ms makes pictures depend on the machine; leave it out of a batch");
    }
    if scene.contains_key("annotations") {
        bail!("annotations are in a log that a batch has not; leave them out");
    }
    SceneFile::parse(Value::Object(scene.clone()).to_string().as_bytes())?;
    Ok(scene)
}

fn read(manifest: &Path) -> anyhow::Result<Vec<Job>> {
    let file =
        std::fs::File::open(manifest).with_context(|| format!("cannot read {}", manifest.display()))?;
    read_manifest(BufReader::new(file)).with_context(|| format!("{} is no manifest", manifest.display()))
}

fn run_manifest(arguments: &RunArguments) -> anyhow::Result<ExitCode> {
    let jobs = read(&arguments.manifest)?;
    let only: Vec<JobKey> = arguments.job.iter().cloned().map(JobKey).collect();
    if let Some(unknown) = only.iter().find(|key| !jobs.iter().any(|job| job.job == **key)) {
        bail!("no job of {} has the key {}", arguments.manifest.display(), unknown.0);
    }
    let memory = arguments.memory.or_else(|| available_bytes().map(|bytes| bytes / 2)).unwrap_or(4 << 30);
    let Some(for_volumes) = memory.checked_sub(BESIDE_BYTES).filter(|bytes| *bytes >= BESIDE_BYTES / 2)
    else {
        bail!(
            "--memory is {} MiB, allowed: {} MiB and more",
            memory >> 20,
            (BESIDE_BYTES + BESIDE_BYTES / 2) >> 20
        );
    };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of bytes")]
    let voxel_bytes = (for_volumes as f64 * VOXEL_SHARE) as u64;
    let mut renderer = arguments.adapter.open_renderer()?;
    let mut limits = renderer.volume_limits();
    limits.memory_bytes = limits.memory_bytes.min(for_volumes - voxel_bytes);
    renderer.set_volume_limits(limits);
    let options = Options { out: arguments.out.clone(), shard: arguments.shard, only, voxel_bytes };
    let teller = Teller::new(jobs.len());
    let started = Instant::now();
    let summary = run_jobs(&mut renderer, &jobs, &options, &|step| teller.tell(step))
        .with_context(|| format!("cannot write into {}", arguments.out.display()))?;
    teller.bar.finish_and_clear();
    let is_whole = options.shard.is_none() && options.only.is_empty();
    let has_news = summary.done > 0 || !arguments.out.join("report.html").exists();
    if is_whole && has_news {
        write_report(&jobs, &summary.failures, &arguments.out).context("cannot write the report")?;
    }
    tell(arguments, &summary, started.elapsed())
}

fn tell(arguments: &RunArguments, summary: &Summary, took: Duration) -> anyhow::Result<ExitCode> {
    let Summary { jobs, done, skipped, loaded, failures } = summary;
    let again = failures.iter().filter(|failure| failure.kind == Lasting::Retryable).count();
    if arguments.json {
        print_json(&json!({
            "out": arguments.out, "jobs": jobs, "done": done, "skipped": skipped, "series_loaded": loaded,
            "failed": failures, "seconds": took.as_secs_f64(),
        }))?;
    } else {
        let seconds = took.as_secs_f64();
        say!(
            "{done} rendered, {skipped} done before, {} failed, of {jobs} jobs, in {seconds:.1} s",
            failures.len()
        );
        if again > 0 {
            say!("{again} of those that failed may succeed when run again");
        }
    }
    Ok(match (failures.len(), again) {
        (0, _) => ExitCode::SUCCESS,
        (_, 0) => ExitCode::FAILURE,
        _ => ExitCode::from(TRY_AGAIN),
    })
}

fn bar(what: &'static str) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::stderr_with_hz(5));
    let style = ProgressStyle::with_template("{prefix} {bar:40} {pos}/{len} {per_sec}, {eta} left {msg}");
    bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar())).with_prefix(what)
}

/// Progress of a run: a bar on a terminal, a line now and then elsewhere.
struct Teller {
    bar: ProgressBar,
    told: Mutex<(Instant, usize)>,
}

impl Teller {
    const BETWEEN: Duration = Duration::from_secs(10);

    fn new(jobs: usize) -> Self {
        let bar = bar("rendering");
        bar.set_length(jobs as u64);
        Self { bar, told: Mutex::new((Instant::now(), 0)) }
    }

    fn tell(&self, step: Step<'_>) {
        self.bar.inc(1);
        let Ok(mut told) = self.told.lock() else { return };
        if let Step::Failed(Failure { name, reason, .. }) = step {
            told.1 += 1;
            self.bar.set_message(format!("({} failed)", told.1));
            self.bar.suspend(|| eprintln!("failed: {name}: {reason}"));
        }
        if !std::io::stderr().is_terminal() && told.0.elapsed() > Self::BETWEEN {
            told.0 = Instant::now();
            tracing::info!(
                "{} of {} jobs, {} failed",
                self.bar.position(),
                self.bar.length().unwrap_or(0),
                told.1
            );
        }
    }
}
