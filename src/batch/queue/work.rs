//! Working: jobs of a queue go through the pipeline of [`run`](mod@crate::run), and their results
//! back to the queue.

use std::collections::HashMap;
use std::future::Future;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::runtime::Runtime;
use tokio::sync::mpsc::{Receiver, Sender, channel};

use super::courier::{JobVerdict, QueueClient, STUCK, TakenJob, WorkerMessage};
use super::setback::FailedAttempt;
use super::{Queue, QueueError};
use crate::copies::Copies;
use crate::error::{Failure, FailureKind};
use crate::gate::MemoryBudget;
use crate::manifest::{Job, JobKey};
use crate::queue::courier::WorkEnd;
use crate::record::Record;
use crate::run::{RunEvent, RunState, render_groups};
use crate::sink::Sink;
use relief_render::Renderer;

/// How a worker works.
#[derive(Clone, Debug)]
pub struct WorkOptions {
    /// Where outputs go.
    pub out: Sink,
    /// Copies of series in buckets.
    pub copies: Copies,
    /// Bytes of voxels in memory: of the series that is rendered and of the next one.
    pub voxel_bytes: u64,
    /// After so long without a sign of life the jobs of a worker are given to another; the first
    /// worker of a stream says it for all.
    pub ack_wait: Duration,
    /// How often a job is begun before it is given up. A first time, when a worker was killed that
    /// had several, leaves no trace and does not count.
    pub tries: u32,
    /// Jobs that are taken at a time: those of one series lie side by side and share its volume.
    pub take: usize,
    /// Exit after this time without jobs for any worker.
    pub idle_exit: Option<Duration>,
}

/// The summary of a worker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WorkSummary {
    /// Rendered.
    pub done: usize,
    /// Done before, by another worker or another run.
    pub skipped: usize,
    /// Given up for good.
    pub failed: usize,
    /// Failed, and left to be tried again.
    pub put_off: usize,
    /// Taken and given back when the worker left.
    pub handed_back: usize,
    /// Series that were loaded.
    pub loaded: usize,
    /// Why it left.
    pub ended: WorkEnd,
}

/// Words that may wait for the courier, who is never busy for long.
const WORDS: usize = 64;
/// Failures in a row, all of a kind that may pass, after which a worker leaves.
const UNFIT: u32 = 5;
/// Pauses before a job is tried again: the first one, and the longest.
const PAUSES: [Duration; 2] = [Duration::from_secs(5), Duration::from_secs(300)];

/// Takes jobs from the queue and renders them, until `stop` is done or there is no need for it any
/// more. `report` hears of each job, from several threads. `runtime` has the queue's connection;
/// must be called from outside of it.
///
/// # Errors
/// When the stream or the place of the outputs cannot be opened. Later ones are waited out.
pub fn work_queue(
    renderer: &mut Renderer,
    runtime: &Runtime,
    queue: &Queue,
    options: &WorkOptions,
    stop: impl Future<Output = ()> + Send + 'static,
    report: &(dyn Fn(RunEvent<'_>) + Sync),
) -> Result<WorkSummary, QueueError> {
    options.out.prepare()?;
    let (feed, jobs) = channel(1);
    let (words, heard) = channel(WORDS);
    let stopping = Arc::new(AtomicBool::new(false));
    let WorkOptions { ack_wait, take, idle_exit, .. } = *options;
    let courier = QueueClient::new(queue, ack_wait, take, idle_exit, heard, Arc::clone(&stopping));
    let courier = runtime.block_on(courier)?;
    let courier = runtime.spawn(courier.run(feed, stop));
    let bench = Bench {
        sink: &options.out,
        limit: options.tries,
        words,
        stopping,
        begun: Mutex::default(),
        ended: Condvar::new(),
        in_a_row: AtomicU32::new(0),
        counts: Mutex::default(),
        report,
    };
    let hear = |step: RunEvent<'_>| bench.hear(step);
    let shared = RunState::new(&options.out, &hear);
    let source = Source { jobs, bench: &bench, shared: &shared, is_alone: false };
    let gate = MemoryBudget::new(options.voxel_bytes);
    render_groups(renderer, source, &options.copies, &gate, &shared);
    let counts = *lock(&bench.counts);
    let summary = shared.into_summary();
    drop(bench); // the courier waits for words no longer
    let ended = runtime.block_on(courier).map_err(std::io::Error::other)?;
    let WorkCounts { skipped, failed, put_off, handed_back } = counts;
    Ok(WorkSummary {
        done: summary.done,
        skipped,
        failed,
        put_off,
        handed_back,
        loaded: summary.loaded,
        ended,
    })
}

#[derive(Clone, Copy, Debug, Default)]
struct WorkCounts {
    skipped: usize,
    failed: usize,
    put_off: usize,
    handed_back: usize,
}

/// State that the worker's threads share.
struct Bench<'a> {
    sink: &'a Sink,
    limit: u32,
    words: Sender<WorkerMessage>,
    stopping: Arc<AtomicBool>,
    begun: Mutex<HashMap<JobKey, RunningJob>>,
    /// One of them ended.
    ended: Condvar,
    in_a_row: AtomicU32,
    counts: Mutex<WorkCounts>,
    report: &'a (dyn Fn(RunEvent<'_>) + Sync),
}

/// A job that is being done.
#[derive(Clone, Copy, Debug, Default)]
struct RunningJob {
    message: u64,
    /// How often it was begun, this time included.
    tries: u32,
}

/// The jobs of the queue, one by one, without those that are done.
struct Source<'a> {
    jobs: Receiver<TakenJob>,
    bench: &'a Bench<'a>,
    shared: &'a RunState<'a>,
    /// Whether the last job was redelivered: it may be one that kills workers, and is done alone,
    /// so that only it is blamed.
    is_alone: bool,
}

impl Iterator for Source<'_> {
    type Item = Vec<Job>;

    fn next(&mut self) -> Option<Vec<Job>> {
        loop {
            let taken = self.jobs.blocking_recv()?;
            let comes_again = taken.delivered > 1;
            if std::mem::replace(&mut self.is_alone, comes_again) || comes_again {
                self.bench.await_all();
            }
            // A worker may live long: what failed is beside the outputs and not kept here.
            self.shared.change(|summary| summary.failures.clear());
            if self.bench.begin(&taken) {
                tracing::debug!("begun: {}", taken.job.name());
                return Some(vec![taken.job]);
            }
        }
    }
}

impl Bench<'_> {
    fn say(&self, job: &JobKey, verdict: JobVerdict) {
        // Sending fails only when the courier has ended; then the queue redelivers the job.
        let _ = self.words.blocking_send(WorkerMessage::Of(job.clone(), verdict));
    }

    /// Waits until no job is being done; no longer than for one that is stuck.
    fn await_all(&self) {
        let waited = self.ended.wait_timeout_while(lock(&self.begun), STUCK, |begun| !begun.is_empty());
        drop(waited.unwrap_or_else(PoisonError::into_inner));
    }

    /// A job is done, or not to be done by this worker.
    fn end(&self, job: &JobKey) -> RunningJob {
        let begun = lock(&self.begun).remove(job).unwrap_or_default();
        self.ended.notify_all();
        begun
    }

    /// Whether a job is to be done now. Leaves a trace of one that came before: should it be this
    /// worker's end, too, then the next one knows how often it was begun.
    fn begin(&self, TakenJob { job, message, delivered }: &TakenJob) -> bool {
        if self.stopping.load(Ordering::Relaxed) {
            lock(&self.counts).handed_back += 1;
            self.say(&job.job, JobVerdict::Back);
            return false;
        }
        if Record::of_done(job, self.sink).is_some() {
            lock(&self.counts).skipped += 1;
            (self.report)(RunEvent::Skipped(job));
            self.say(&job.job, JobVerdict::Done);
            return false;
        }
        // One that was handed back, or lay behind one that killed its worker, comes again, too: it
        // was begun if it left a trace.
        let traced = || FailedAttempt::read(job, self.sink).filter(|known| known.message == *message);
        let before = (*delivered > 1).then(traced).flatten().map_or(0, |known| known.tries);
        let begun = RunningJob { message: *message, tries: before.saturating_add(1) };
        lock(&self.begun).insert(job.job.clone(), begun);
        if *delivered <= 1 {
            return true;
        }
        let mut failure = Failure {
            job: job.job.0.clone(),
            name: job.name(),
            kind: FailureKind::Retryable,
            reason: "a worker began it, and nothing was heard of either since".to_owned(),
        };
        if before >= self.limit {
            failure.reason =
                format!("it was begun {before} times or more, and never was a worker done with it");
            failure.kind = FailureKind::Permanent;
            lock(&self.begun).insert(job.job.clone(), RunningJob { tries: before, ..begun });
            self.fail(&failure);
            return false;
        }
        let setback = FailedAttempt { failure, tries: begun.tries, message: *message };
        if let Err(error) = setback.write(self.sink) {
            self.fail(&Failure { reason: format!("cannot write: {error}"), ..setback.failure });
            return false;
        }
        true
    }

    /// The reports of the pipeline.
    fn hear(&self, step: RunEvent<'_>) {
        match step {
            RunEvent::Done(job, _) => {
                self.in_a_row.store(0, Ordering::Relaxed);
                self.end(&job.job);
                if let Err(error) = FailedAttempt::remove(&job.name(), self.sink) {
                    tracing::debug!("a setback stays beside the outputs: {error}");
                }
                (self.report)(step);
                self.say(&job.job, JobVerdict::Done);
            }
            RunEvent::Failed(failure) => self.fail(failure),
            RunEvent::Skipped(_) => (self.report)(step),
        }
    }

    fn fail(&self, failure: &Failure) {
        let job = JobKey(failure.job.clone());
        let RunningJob { message, tries } = self.end(&job);
        let setback = FailedAttempt { failure: failure.clone(), tries, message };
        let is_recorded = setback.write(self.sink).is_ok();
        let is_over = failure.kind == FailureKind::Permanent || tries >= self.limit;
        // An outcome that cannot be recorded must not be lost.
        let verdict =
            if is_over && is_recorded { JobVerdict::Never } else { JobVerdict::Later(pause_after(tries)) };
        {
            let mut counts = lock(&self.counts);
            *(if verdict == JobVerdict::Never { &mut counts.failed } else { &mut counts.put_off }) += 1;
        }
        (self.report)(RunEvent::Failed(failure));
        self.say(&job, verdict);
        if failure.kind == FailureKind::Permanent {
            self.in_a_row.store(0, Ordering::Relaxed);
        } else if self.in_a_row.fetch_add(1, Ordering::Relaxed) + 1 == UNFIT {
            let _ = self.words.blocking_send(WorkerMessage::Unfit);
        }
    }
}

fn pause_after(tries: u32) -> Duration {
    let [first, longest] = PAUSES;
    first.saturating_mul(2_u32.saturating_pow(tries.saturating_sub(1))).min(longest)
}

/// Numbers and a map are whole after a panic elsewhere, too.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_grow_up_to_the_longest() {
        let pauses = [1, 2, 3, 7, 8, u32::MAX].map(|tries| pause_after(tries).as_secs());
        assert_eq!(pauses, [5, 10, 20, 300, 300, 300]);
    }
}
