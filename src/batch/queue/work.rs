//! A worker: takes jobs of a queue through the pipeline of [`run`](mod@crate::run), and reports their
//! outcomes to the queue.

use std::collections::HashMap;
use std::future::Future;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use parking_lot::{Condvar, Mutex};
use tokio::runtime::Runtime;
use tokio::sync::mpsc::{Receiver, Sender, channel};

use super::attempt::FailedAttempt;
use super::client::{JobOutcome, QueueClient, STUCK_AFTER, TakenJob, WorkerMessage};
use super::{Queue, QueueError};
use crate::copies::Copies;
use crate::error::{Failure, FailureKind};
use crate::gate::MemoryBudget;
use crate::manifest::{Job, JobKey};
use crate::queue::client::WorkEnd;
use crate::record::Record;
use crate::run::render_groups;
use crate::run_state::{RunEvent, RunState};
use crate::sink::Sink;
use relief_render::Renderer;

/// Settings of a worker.
#[derive(Clone, Debug)]
pub struct WorkOptions {
    /// The destination of outputs.
    pub out: Sink,
    /// Copies of series in buckets.
    pub copies: Copies,
    /// Bytes of voxels in memory: of the series that is rendered and of the next one.
    pub voxel_bytes: u64,
    /// The queue redelivers the jobs of a worker that does not report for this time. The first worker
    /// of a stream decides it for all.
    pub ack_wait: Duration,
    /// The number of starts of a job before it fails permanently. The first start leaves no record, so
    /// it does not count where its worker was killed.
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
    /// Failed permanently.
    pub failed: usize,
    /// Failed, and left to be tried again.
    pub put_off: usize,
    /// Taken, and returned when the worker ended.
    pub handed_back: usize,
    /// Series that were loaded.
    pub loaded: usize,
    /// Why it ended.
    pub ended: WorkEnd,
}

/// Messages that may wait for the queue's client.
const WAITING_MESSAGES: usize = 64;
/// Retryable failures in a row after which a worker ends.
const UNFIT: u32 = 5;
/// Pauses before the next attempt of a job: the first one, and the longest.
const PAUSES: [Duration; 2] = [Duration::from_secs(5), Duration::from_secs(300)];

/// Takes jobs from the queue and renders them, until `stop` completes or no job is left. `report` is
/// called for each job, from several threads. `runtime` drives the queue's connection; call this from
/// outside of it.
///
/// # Errors
/// When the stream or the place of the outputs cannot be opened. After that, a lost connection is
/// awaited.
pub fn work_queue(
    renderer: &mut Renderer,
    runtime: &Runtime,
    queue: &Queue,
    options: &WorkOptions,
    stop: impl Future<Output = ()> + Send + 'static,
    report: &(dyn Fn(RunEvent<'_>) + Sync),
) -> Result<WorkSummary, QueueError> {
    options.out.prepare()?;
    let (job_sender, jobs) = channel(1);
    let (messages, received) = channel(WAITING_MESSAGES);
    let stopping = Arc::new(AtomicBool::new(false));
    let WorkOptions { ack_wait, take, idle_exit, .. } = *options;
    let client = QueueClient::new(queue, ack_wait, take, idle_exit, received, Arc::clone(&stopping));
    let client = runtime.block_on(client)?;
    let client = runtime.spawn(client.run(job_sender, stop));
    let worker = Worker {
        sink: &options.out,
        limit: options.tries,
        messages,
        stopping,
        running: Mutex::default(),
        ended: Condvar::new(),
        failures_in_a_row: AtomicU32::new(0),
        counts: Mutex::default(),
        report,
    };
    let handle = |event: RunEvent<'_>| worker.handle(event);
    let shared = RunState::new(&options.out, &handle);
    let source = Source { jobs, worker: &worker, shared: &shared, is_alone: false };
    let gate = MemoryBudget::new(options.voxel_bytes);
    render_groups(renderer, source, &options.copies, &gate, &shared);
    let counts = *worker.counts.lock();
    let summary = shared.into_summary();
    drop(worker); // ends the client's wait for messages
    let ended = runtime.block_on(client).map_err(std::io::Error::other)?;
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
struct Worker<'a> {
    sink: &'a Sink,
    limit: u32,
    messages: Sender<WorkerMessage>,
    stopping: Arc<AtomicBool>,
    running: Mutex<HashMap<JobKey, RunningJob>>,
    /// One of them has ended.
    ended: Condvar,
    failures_in_a_row: AtomicU32,
    counts: Mutex<WorkCounts>,
    report: &'a (dyn Fn(RunEvent<'_>) + Sync),
}

/// A job in progress.
#[derive(Clone, Copy, Debug, Default)]
struct RunningJob {
    message: u64,
    /// The number of starts, this one included.
    tries: u32,
}

/// The jobs of the queue, one by one, without those that are done.
struct Source<'a> {
    jobs: Receiver<TakenJob>,
    worker: &'a Worker<'a>,
    shared: &'a RunState<'a>,
    /// Whether the last job was redelivered. It may be one that kills workers, so it runs alone: no
    /// other job takes the blame.
    is_alone: bool,
}

impl Iterator for Source<'_> {
    type Item = Vec<Job>;

    fn next(&mut self) -> Option<Vec<Job>> {
        loop {
            let taken = self.jobs.blocking_recv()?;
            let is_redelivered = taken.delivered > 1;
            if std::mem::replace(&mut self.is_alone, is_redelivered) || is_redelivered {
                self.worker.await_all();
            }
            // A worker may run for weeks. Failures are recorded beside the outputs, not here.
            self.shared.change(|summary| summary.failures.clear());
            if self.worker.begin(&taken) {
                tracing::debug!("started: {}", taken.job.name());
                return Some(vec![taken.job]);
            }
        }
    }
}

impl Worker<'_> {
    fn send(&self, job: &JobKey, outcome: JobOutcome) {
        // Sending fails only when the client has ended; then the queue redelivers the job.
        let _ = self.messages.blocking_send(WorkerMessage::Ended(job.clone(), outcome));
    }

    /// Waits until no job is in progress, at most until one counts as stuck.
    fn await_all(&self) {
        let mut running = self.running.lock();
        self.ended.wait_while_for(&mut running, |running| !running.is_empty(), STUCK_AFTER);
    }

    /// Removes a job from those in progress here.
    fn end(&self, job: &JobKey) -> RunningJob {
        let ended = self.running.lock().remove(job).unwrap_or_default();
        self.ended.notify_all();
        ended
    }

    /// Whether a job is to be done now. Records the start of a redelivered job: if it kills this
    /// worker, too, the next one knows how often it was started.
    fn begin(&self, TakenJob { job, message, delivered }: &TakenJob) -> bool {
        if self.stopping.load(Ordering::Relaxed) {
            self.counts.lock().handed_back += 1;
            self.send(&job.job, JobOutcome::Returned);
            return false;
        }
        if Record::of_done(job, self.sink).is_some() {
            self.counts.lock().skipped += 1;
            (self.report)(RunEvent::Skipped(job));
            self.send(&job.job, JobOutcome::Done);
            return false;
        }
        // A job that was returned, or waited behind one that killed its worker, is redelivered, too.
        // Only a record shows that it was started.
        let recorded = || FailedAttempt::read(job, self.sink).filter(|known| known.message == *message);
        let before = (*delivered > 1).then(recorded).flatten().map_or(0, |known| known.tries);
        let running = RunningJob { message: *message, tries: before.saturating_add(1) };
        self.running.lock().insert(job.job.clone(), running);
        if *delivered <= 1 {
            return true;
        }
        let mut failure = Failure {
            job: job.job.0.clone(),
            name: job.name(),
            kind: FailureKind::Retryable,
            reason: "a worker started it and did not report since".to_owned(),
        };
        if before >= self.limit {
            failure.reason = format!("it was started at least {before} times, and no worker finished it");
            failure.kind = FailureKind::Permanent;
            self.running.lock().insert(job.job.clone(), RunningJob { tries: before, ..running });
            self.fail(&failure);
            return false;
        }
        let attempt = FailedAttempt { failure, tries: running.tries, message: *message };
        if let Err(error) = attempt.write(self.sink) {
            self.fail(&Failure { reason: format!("cannot write: {error}"), ..attempt.failure });
            return false;
        }
        true
    }

    /// Handles an event of the pipeline.
    fn handle(&self, event: RunEvent<'_>) {
        match event {
            RunEvent::Done(job, _) => {
                self.failures_in_a_row.store(0, Ordering::Relaxed);
                self.end(&job.job);
                if let Err(error) = FailedAttempt::remove(&job.name(), self.sink) {
                    tracing::debug!("the record of a failed attempt cannot be removed: {error}");
                }
                (self.report)(event);
                self.send(&job.job, JobOutcome::Done);
            }
            RunEvent::Failed(failure) => self.fail(failure),
            RunEvent::Skipped(_) => (self.report)(event),
        }
    }

    fn fail(&self, failure: &Failure) {
        let job = JobKey(failure.job.clone());
        let RunningJob { message, tries } = self.end(&job);
        let attempt = FailedAttempt { failure: failure.clone(), tries, message };
        let is_recorded = attempt.write(self.sink).is_ok();
        let is_final = failure.kind == FailureKind::Permanent || tries >= self.limit;
        // A failure that cannot be recorded must not be lost.
        let outcome =
            if is_final && is_recorded { JobOutcome::Failed } else { JobOutcome::Retry(pause_after(tries)) };
        {
            let mut counts = self.counts.lock();
            *(if outcome == JobOutcome::Failed { &mut counts.failed } else { &mut counts.put_off }) += 1;
        }
        (self.report)(RunEvent::Failed(failure));
        self.send(&job, outcome);
        if failure.kind == FailureKind::Permanent {
            self.failures_in_a_row.store(0, Ordering::Relaxed);
        } else if self.failures_in_a_row.fetch_add(1, Ordering::Relaxed) + 1 == UNFIT {
            let _ = self.messages.blocking_send(WorkerMessage::Unfit);
        }
    }
}

fn pause_after(tries: u32) -> Duration {
    let [first, longest] = PAUSES;
    first.saturating_mul(2_u32.saturating_pow(tries.saturating_sub(1))).min(longest)
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
