//! `relief batch submit` and `relief batch work`: jobs through a queue in NATS JetStream.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::Context;
use serde_json::json;

use super::copies::BucketSeriesArguments;
use super::shared::{MemoryShare, TRY_AGAIN, read};
use crate::adapter::AdapterArguments;
use crate::memory::parse_bytes;
use crate::output::{print_json, say};
use relief_batch::work_queue;
use relief_batch::{Location, Queue, QueueAccess, RunEvent, WorkEnd, WorkOptions, WorkSummary};

/// The queue, and how to get in.
#[derive(Debug, clap::Args)]
struct QueueArguments {
    /// NATS server with JetStream: nats://HOST:4222, or tls://; several of one cluster with commas
    /// between them
    #[arg(long, value_name = "URL", env = "RELIEF_NATS", hide_env_values = true)]
    nats: String,
    /// Stream of the jobs; made where it is not there
    #[arg(long, value_name = "NAME", default_value = "relief-jobs")]
    stream: String,
    /// File of credentials, as nsc writes them
    #[arg(long, value_name = "FILE", env = "RELIEF_NATS_CREDS")]
    nats_creds: Option<PathBuf>,
    /// File that has a token; RELIEF_NATS_TOKEN may have the token itself
    #[arg(long, value_name = "FILE", env = "RELIEF_NATS_TOKEN_FILE")]
    nats_token_file: Option<PathBuf>,
    /// Certificates of the authorities that the server's is checked with, PEM; the system's
    /// otherwise
    #[arg(long, value_name = "FILE")]
    nats_ca: Option<PathBuf>,
}

/// Put the jobs of a manifest into a queue
#[derive(Debug, clap::Args)]
pub(crate) struct SubmitArguments {
    /// The manifest
    #[arg(long, value_name = "JOBS.jsonl")]
    manifest: PathBuf,
    #[command(flatten)]
    queue: QueueArguments,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Render jobs of a queue until stopped
#[derive(Debug, clap::Args)]
pub(crate) struct WorkArguments {
    #[command(flatten)]
    queue: QueueArguments,
    /// Place of the outputs: a folder, or s3://BUCKET/PREFIX
    #[arg(long, value_name = "DIR")]
    out: Location,
    #[command(flatten)]
    series: BucketSeriesArguments,
    /// Render series below this folder or s3://BUCKET/PREFIX alone, whatever a job names; may be given
    /// several times [default: anywhere, which trusts every publisher of the stream]
    #[arg(long, value_name = "DIR")]
    root: Vec<Location>,
    /// Exit after this time without jobs [default: wait for jobs]
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u32).range(1..=86_400))]
    idle_exit: Option<u32>,
    /// After so long without a sign of life the jobs of a worker are given to another; the first
    /// worker says it for all
    #[arg(long, value_name = "SECONDS", default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=3600))]
    ack_wait: u32,
    /// Most starts of a job before it fails
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    tries: u32,
    /// Jobs to take at a time; those of one series lie side by side and share its volume
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=1000))]
    take: u16,
    /// Memory for volumes on this machine and its adapter together [default: half of the available
    /// memory]
    #[arg(long, value_name = "BYTES", value_parser = parse_bytes)]
    memory: Option<u64>,
    #[command(flatten)]
    adapter: AdapterArguments,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl QueueArguments {
    fn access(&self) -> QueueAccess {
        QueueAccess {
            url: self.nats.clone(),
            credentials: self.nats_creds.clone(),
            token: std::env::var("RELIEF_NATS_TOKEN").ok().filter(|token| !token.is_empty()),
            token_file: self.nats_token_file.clone(),
            authorities: self.nats_ca.clone(),
        }
    }
}

pub(crate) fn submit(arguments: &SubmitArguments) -> anyhow::Result<ExitCode> {
    let jobs = read(&arguments.manifest)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let bar = crate::batch::shared::bar("submitting");
    bar.set_length(jobs.len() as u64);
    let submitted = runtime.block_on(async {
        let queue = Queue::connect(&arguments.queue.access(), &arguments.queue.stream).await?;
        let submitted = queue.submit(&jobs, &mut |done| bar.set_position(done as u64)).await;
        queue.close().await;
        submitted
    })?;
    bar.finish_and_clear();
    let stream = &arguments.queue.stream;
    if arguments.json {
        print_json(&json!({ "stream": stream, "submitted": submitted.sent, "known": submitted.known }))?;
    } else {
        say!("{stream}: {} jobs submitted, {} were there already", submitted.sent, submitted.known);
    }
    Ok(ExitCode::SUCCESS)
}

pub(crate) fn run_worker(arguments: &WorkArguments) -> anyhow::Result<ExitCode> {
    // The queue is opened first, so that its errors are reported before an adapter is opened.
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
    let queue = runtime.block_on(Queue::connect(&arguments.queue.access(), &arguments.queue.stream))?;
    let stop = {
        let _inside = runtime.enter();
        crate::stop::stop_signal()?
    };
    let stop = async {
        stop.await;
        eprintln!("stopping: finishing the jobs that have begun, giving the rest back");
    };
    let share = MemoryShare::of(arguments.memory)?;
    let mut renderer = share.open_renderer(&arguments.adapter)?;
    let options = WorkOptions {
        out: arguments.series.copies.bucket.open(&arguments.out)?,
        copies: arguments.series.copies_below(arguments.root.clone())?,
        voxel_bytes: share.voxels,
        ack_wait: Duration::from_secs(arguments.ack_wait.into()),
        tries: arguments.tries,
        take: arguments.take.into(),
        idle_exit: arguments.idle_exit.map(|seconds| Duration::from_secs(seconds.into())),
    };
    tracing::info!("waiting for jobs of the stream {}", arguments.queue.stream);
    let started = Instant::now();
    let tell = |step: RunEvent<'_>| match step {
        RunEvent::Failed(failure) => eprintln!("failed: {}: {}", failure.name, failure.reason),
        RunEvent::Done(job, record) => {
            tracing::debug!("done: {} in {:.0} ms", job.name(), record.render_ms);
            if let Some(warning) = &record.picture_warning {
                eprintln!("warning: {}: {warning}", job.name());
            }
        }
        RunEvent::Skipped(job) => tracing::debug!("done before: {}", job.name()),
    };
    let worked = work_queue(&mut renderer, &runtime, &queue, &options, stop, &tell)
        .with_context(|| format!("cannot work into {}", arguments.out))?;
    runtime.block_on(queue.close());
    tell_worked(arguments, &worked, started.elapsed())
}

fn tell_worked(arguments: &WorkArguments, worked: &WorkSummary, took: Duration) -> anyhow::Result<ExitCode> {
    let WorkSummary { done, skipped, failed, put_off, handed_back, loaded, ended } = worked;
    let (ended, status) = match ended {
        WorkEnd::Idle => ("idle", ExitCode::SUCCESS),
        WorkEnd::Stopped => ("stopped", ExitCode::SUCCESS),
        WorkEnd::Unfit => {
            eprintln!("leaving: several jobs in a row failed in ways that may be this worker's own");
            ("unfit", ExitCode::from(TRY_AGAIN))
        }
    };
    let seconds = took.as_secs_f64();
    if arguments.json {
        print_json(&json!({
            "out": arguments.out.to_string(), "done": done, "skipped": skipped, "failed": failed, "put_off": put_off,
            "handed_back": handed_back, "series_loaded": loaded, "ended": ended, "seconds": seconds,
        }))?;
    } else {
        say!(
            "{done} rendered, {skipped} done before, {failed} failed, {put_off} put off, {handed_back} given back, \
             in {seconds:.1} s"
        );
    }
    Ok(status)
}
