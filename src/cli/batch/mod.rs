//! `relief batch`: many views of many series.

mod copies;
mod plan;
#[cfg(feature = "queue")]
mod queue;
#[cfg(feature = "archives")]
mod send;
mod shared;

use std::io::IsTerminal;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use indicatif::ProgressBar;
use parking_lot::Mutex;
use serde_json::json;

use crate::adapter::AdapterArguments;
use crate::bucket::BucketArguments;
use crate::memory::parse_bytes;
use crate::output::{print_json, say};
use copies::BucketSeriesArguments;
use plan::{PlanArguments, write_plan};
use relief_batch::run as run_jobs;
use relief_batch::{
    Failure, FailureKind, FilmChoice, FilmWriter, Job, JobKey, Location, Options, REPORT, Record, RunError,
    RunEvent, Shard, Sink, Summary, write_report,
};
use shared::{MemoryShare, TRY_AGAIN, bar, read};

/// Render many views of many series, as jobs that are done once.
///
/// `plan` finds the series under a folder, or those of a table, and writes one job for each view of
/// each. `run` renders the jobs that are not done: run it again, on as many machines as you like,
/// until nothing is left. A job is known by a hash of its series' files, its scene and its
/// products.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  relief batch plan --root archive --views turntable:8 --preset bone --out jobs.jsonl
  relief batch run --manifest jobs.jsonl --out views
  relief batch run --manifest jobs.jsonl --out views --shard 0/4     one of four machines
  relief batch plan --root archive --where 'slices>=40' --views landmarks --annotations head.db --products annotated --out jobs.jsonl
  relief batch plan --root archive --views turntable:60 --products dataset --size 800x800 --out jobs.jsonl
  relief batch report --manifest jobs.jsonl --out views              pages and sheets after shards
  relief batch run --manifest jobs.jsonl --out s3://bucket/views     into a bucket; AWS_... have credentials and endpoint
  relief batch plan --root s3://bucket/archive --views sides --out jobs.jsonl    of series in a bucket
  relief batch run --manifest jobs.jsonl --out views --send dicomweb+https://ct-server/dicom-web    captures into a PACS
  relief batch submit --manifest jobs.jsonl --nats nats://HOST:4222  into a queue, for any number of
  relief batch work --nats nats://HOST:4222 --out s3://bucket/views  workers

Exit status of run: 0 all done, 1 some jobs failed for good, 75 some failed that may succeed when run again.
Exit status of work: 0 after a signal or when no job is left, 75 when it should be restarted.")]
pub(super) struct BatchArguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    Plan(PlanArguments),
    Run(RunArguments),
    Report(ReportArguments),
    #[cfg(feature = "queue")]
    Submit(queue::SubmitArguments),
    #[cfg(feature = "queue")]
    Work(queue::WorkArguments),
}

/// Render the jobs that are not done
#[derive(Debug, clap::Args)]
struct RunArguments {
    /// The manifest
    #[arg(long, value_name = "JOBS.jsonl")]
    manifest: PathBuf,
    /// Place of the outputs: a folder, or s3://BUCKET/PREFIX
    #[arg(long, value_name = "DIR")]
    out: Location,
    #[command(flatten)]
    series: BucketSeriesArguments,
    /// One of N equal shares, from 0: all views of a series are in one
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,
    /// Only this job; may be given several times
    #[arg(long, value_name = "KEY")]
    job: Vec<String>,
    /// Memory for volumes on this machine and its adapter together [default: half of the available
    /// memory]
    #[arg(long, value_name = "BYTES", value_parser = parse_bytes)]
    memory: Option<u64>,
    /// Store the products capture and annotated-capture in this DICOM archive,
    /// dicomweb+https://HOST/ROOT, when the run ends; objects that it has are not sent again
    #[cfg(feature = "archives")]
    #[arg(long, value_name = "ARCHIVE", value_parser = send::parse_archive)]
    send: Option<relief_archive::ArchiveAddress>,
    #[command(flatten)]
    films: FilmArguments,
    #[command(flatten)]
    adapter: AdapterArguments,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Write report.html, contact sheets, turntables and tables of datasets for finished jobs
#[derive(Debug, clap::Args)]
struct ReportArguments {
    /// The manifest
    #[arg(long, value_name = "JOBS.jsonl")]
    manifest: PathBuf,
    /// Place of the outputs and of the report: a folder, or s3://BUCKET/PREFIX
    #[arg(long, value_name = "DIR")]
    out: Location,
    #[command(flatten)]
    bucket: BucketArguments,
    #[command(flatten)]
    films: FilmArguments,
}

#[derive(Debug, clap::Args)]
struct FilmArguments {
    /// Turntables: apng, mp4 (and apng; needs ffmpeg), or auto: apng, and mp4 where ffmpeg is. With
    /// ffmpeg, the frames of product `frame` also become a film without loss, turntable.frame.mkv
    #[arg(long, value_name = "FILM", default_value = "auto")]
    turntable: FilmChoice,
    /// The ffmpeg to use
    #[arg(long, value_name = "PATH", env = "RELIEF_FFMPEG", default_value = "ffmpeg")]
    ffmpeg: PathBuf,
}

impl FilmArguments {
    /// The films of these turntables; warns if ffmpeg is missing.
    fn films(&self, jobs: &[Job]) -> anyhow::Result<FilmWriter> {
        let films = FilmWriter::new(self.turntable, &self.ffmpeg).map_err(anyhow::Error::msg)?;
        if films.lacks_ffmpeg && jobs.iter().any(|job| relief_batch::FILMS.contains(&&*job.group)) {
            eprintln!("turntables are animated PNG alone: there is no ffmpeg to make MP4");
        }
        Ok(films)
    }
}

pub(super) fn run(arguments: BatchArguments) -> anyhow::Result<ExitCode> {
    match arguments.command {
        Command::Plan(arguments) => write_plan(&arguments),
        Command::Run(arguments) => run_manifest(&arguments),
        Command::Report(arguments) => report(&arguments),
        #[cfg(feature = "queue")]
        Command::Submit(arguments) => queue::submit(&arguments),
        #[cfg(feature = "queue")]
        Command::Work(arguments) => queue::run_worker(&arguments),
    }
}

fn report(ReportArguments { manifest, out, bucket, films }: &ReportArguments) -> anyhow::Result<ExitCode> {
    let jobs = read(manifest)?;
    let films = films.films(&jobs)?;
    let sink = bucket.open(out)?;
    write_report(&jobs, &failed_attempts(&jobs, &sink), &sink, &films)
        .with_context(|| format!("cannot write the report of {out}"))?;
    match out {
        Location::Local(folder) => say!("{}", folder.join(REPORT).display()),
        Location::Bucket { .. } | Location::Archive(_) => say!("{out}/{REPORT}"),
    }
    Ok(ExitCode::SUCCESS)
}

/// The jobs that workers of a queue have not done, and why.
#[cfg(feature = "queue")]
fn failed_attempts(jobs: &[Job], sink: &Sink) -> Vec<Failure> {
    use relief_batch::{FailedAttempt, Record};
    // Combinations that cannot work are refused where the report is requested.
    let open = jobs.iter().filter(|job| matches!(Record::read(job, sink), Ok(None)));
    open.filter_map(|job| FailedAttempt::read(job, sink)).map(|attempt| attempt.failure).collect()
}

#[cfg(not(feature = "queue"))]
fn failed_attempts(_: &[Job], _: &Sink) -> Vec<Failure> {
    Vec::new()
}

fn run_manifest(arguments: &RunArguments) -> anyhow::Result<ExitCode> {
    let jobs = read(&arguments.manifest)?;
    let only: Vec<JobKey> = arguments.job.iter().cloned().map(JobKey).collect();
    if let Some(unknown) = only.iter().find(|key| !jobs.iter().any(|job| job.job == **key)) {
        bail!("no job of {} has the key {}", arguments.manifest.display(), unknown.0);
    }
    #[cfg(feature = "archives")]
    if arguments.send.is_some() {
        send::expect_objects(&jobs)?;
    }
    let share = MemoryShare::of(arguments.memory)?;
    let films = arguments.films.films(&jobs)?;
    let out = arguments.series.copies.bucket.open(&arguments.out)?;
    let copies = arguments.series.copies_below(Vec::new())?;
    let options = Options { out, shard: arguments.shard, only, voxel_bytes: share.voxels, copies };
    let teller = RunProgress::new(jobs.len());
    let started = Instant::now();
    let open = || share.open_renderer(&arguments.adapter);
    let summary =
        run_jobs(open, &jobs, &options, &|step| teller.tell(step)).map_err(|error| match error {
            RunError::Out(error) => {
                anyhow::Error::new(error).context(format!("cannot write into {}", arguments.out))
            }
            RunError::Renderer(error) => error,
        })?;
    teller.bar.finish_and_clear();
    let is_whole = options.shard.is_none() && options.only.is_empty();
    let reporting = Instant::now();
    if is_whole && (summary.done > 0 || !options.out.has(REPORT)) {
        write_report(&jobs, &summary.failures, &options.out, &films).context("cannot write the report")?;
    }
    let took = [started, reporting].map(|since| since.elapsed());
    #[cfg(feature = "archives")]
    let sent = match &arguments.send {
        Some(archive) => Some(send::send(&jobs, &options.out, &options.copies, archive)?),
        None => None,
    };
    #[cfg(not(feature = "archives"))]
    let sent: Option<()> = None;
    let code = tell(arguments, &summary, took, &json!(sent))?;
    #[cfg(feature = "archives")]
    if let Some(sent) = sent {
        if !arguments.json {
            say!("{}", sent.describe());
        }
        if sent.refused > 0 {
            return Ok(ExitCode::FAILURE);
        }
    }
    Ok(code)
}

fn tell(
    arguments: &RunArguments,
    summary: &Summary,
    [took, report]: [Duration; 2],
    sent: &serde_json::Value,
) -> anyhow::Result<ExitCode> {
    let Summary { jobs, done, skipped, loaded, failures, seconds } = summary;
    let again = failures.iter().filter(|failure| failure.kind == FailureKind::Retryable).count();
    if arguments.json {
        print_json(&json!({
            "out": arguments.out.to_string(), "jobs": jobs, "done": done, "skipped": skipped, "series_loaded": loaded,
            "failed": failures, "seconds": took.as_secs_f64(), "seconds_of": seconds,
            "report_seconds": report.as_secs_f64(), "sent": sent,
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

/// Progress of a run: a bar on a terminal, a line now and then elsewhere.
struct RunProgress {
    bar: ProgressBar,
    printed: Mutex<(Instant, usize)>,
}

impl RunProgress {
    const BETWEEN: Duration = Duration::from_secs(10);

    fn new(jobs: usize) -> Self {
        let bar = bar("rendering");
        bar.set_length(jobs as u64);
        Self { bar, printed: Mutex::new((Instant::now(), 0)) }
    }

    fn tell(&self, step: RunEvent<'_>) {
        self.bar.inc(1);
        let mut printed = self.printed.lock();
        if let RunEvent::Done(job, Record { picture_warning: Some(warning), .. }) = step {
            self.bar.suspend(|| eprintln!("warning: {}: {warning}", job.name()));
        }
        if let RunEvent::Failed(Failure { name, reason, .. }) = step {
            printed.1 += 1;
            self.bar.set_message(format!("({} failed)", printed.1));
            self.bar.suspend(|| eprintln!("failed: {name}: {reason}"));
        }
        if !std::io::stderr().is_terminal() && printed.0.elapsed() > Self::BETWEEN {
            printed.0 = Instant::now();
            tracing::info!(
                "{} of {} jobs, {} failed",
                self.bar.position(),
                self.bar.length().unwrap_or(0),
                printed.1
            );
        }
    }
}
