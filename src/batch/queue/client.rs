//! The connection of a worker to its queue: fetches jobs, renews their acknowledgement while they
//! are in progress, reports their outcomes.
//!
//! It runs inside an executor while the worker loads, renders and writes on threads of its own.

use std::collections::{HashMap, VecDeque};
use std::future::Future;
use std::pin::{Pin, pin};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use async_nats::jetstream::consumer::{Consumer, pull};
use async_nats::jetstream::message::Acker;
use async_nats::jetstream::{AckKind, Message};
use futures_util::StreamExt;
use tokio::sync::mpsc::{Receiver, Sender};
use tokio::task::JoinSet;
use tokio::time::{MissedTickBehavior, interval, sleep, timeout};

use super::{Queue, QueueError};
use crate::manifest::{Job, JobKey, read_manifest};

/// The time for which the queue waits for a job.
const POLL: Duration = Duration::from_secs(2);
/// The longest time of an answer of the queue.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(12);
/// A worker without a finished job for this time is stuck. Its jobs go to another one.
pub(super) const STUCK_AFTER: Duration = Duration::from_secs(900);
/// Pauses between attempts to report an outcome; without a report the queue redelivers the job.
const REPORT_PAUSES_S: [u64; 5] = [1, 2, 4, 8, 16];
/// The longest time of outstanding reports when the worker ends.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(15);

/// A job that was taken from the queue.
#[derive(Debug)]
pub(super) struct TakenJob {
    pub(super) job: Job,
    /// The number of its message in the stream.
    pub(super) message: u64,
    /// The number of deliveries to a worker, this one included.
    pub(super) delivered: i64,
}

/// A message of the worker.
#[derive(Debug)]
pub(super) enum WorkerMessage {
    /// A job has ended.
    Ended(JobKey, JobOutcome),
    /// This worker should end: see [`WorkEnd::Unfit`].
    Unfit,
}

/// The outcome of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum JobOutcome {
    /// Its outputs exist.
    Done,
    /// It failed permanently.
    Failed,
    /// It failed; another attempt may follow after this pause.
    Retry(Duration),
    /// It was not started.
    Returned,
}

/// The outcome of asking the queue for jobs.
enum FetchedJobs {
    Messages(Vec<Message>),
    /// No job waits.
    Empty {
        /// No worker has a job in progress either.
        all_done: bool,
    },
    /// The consumer was missing, or the connection was lost; this is a new consumer.
    Reopened(Box<Consumer<pull::Config>>),
    /// The queue cannot be reached.
    Unreachable(async_nats::Error),
}

/// Delivers jobs to the worker, and takes its messages.
pub(super) struct QueueClient {
    queue: Queue,
    consumer: Consumer<pull::Config>,
    ack_wait: Duration,
    take: usize,
    idle_exit: Option<Duration>,
    messages: Receiver<WorkerMessage>,
    stopping: Arc<AtomicBool>,
    /// Jobs of this worker whose outcome the queue does not know.
    held: HashMap<JobKey, Acker>,
    /// Those of them that the worker has not received yet.
    waiting: VecDeque<TakenJob>,
    /// Reports under way.
    reports: JoinSet<()>,
    last_progress: Instant,
    idle_since: Instant,
    is_lost: bool,
}

impl QueueClient {
    /// Opens the stream and its consumer, and creates what is missing.
    pub(super) async fn new(
        queue: &Queue,
        ack_wait: Duration,
        take: usize,
        idle_exit: Option<Duration>,
        messages: Receiver<WorkerMessage>,
        stopping: Arc<AtomicBool>,
    ) -> Result<Self, QueueError> {
        let consumer = queue.consumer(ack_wait).await?;
        Ok(Self {
            queue: queue.clone(),
            // The first worker of a stream decides it for all.
            ack_wait: consumer.cached_info().config.ack_wait,
            consumer,
            take,
            idle_exit,
            messages,
            stopping,
            held: HashMap::new(),
            waiting: VecDeque::new(),
            reports: JoinSet::new(),
            last_progress: Instant::now(),
            idle_since: Instant::now(),
            is_lost: false,
        })
    }

    /// Delivers jobs to the worker until `stop` completes, no job is left, or the worker is unfit.
    pub(super) async fn run(mut self, jobs: Sender<TakenJob>, stop: impl Future<Output = ()>) -> WorkEnd {
        let mut stop = pin!(stop);
        let mut heartbeat = interval(self.ack_wait / 3);
        heartbeat.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut fetching: Option<Pin<Box<dyn Future<Output = FetchedJobs> + Send>>> = None;
        let ended = loop {
            if self.waiting.is_empty() && fetching.is_none() {
                let (queue, consumer) = (self.queue.clone(), self.consumer.clone());
                fetching = Some(Box::pin(fetch(queue, consumer, self.take, self.ack_wait)));
            }
            tokio::select! {
                () = &mut stop => break WorkEnd::Stopped,
                message = self.messages.recv() => match message {
                    Some(WorkerMessage::Ended(job, outcome)) => self.end(&job, outcome),
                    Some(WorkerMessage::Unfit) => break WorkEnd::Unfit,
                    None => break WorkEnd::Stopped,
                },
                _ = heartbeat.tick() => self.renew().await,
                room = jobs.reserve(), if !self.waiting.is_empty() => {
                    if let (Ok(room), Some(taken)) = (room, self.waiting.pop_front()) {
                        room.send(taken);
                    }
                }
                fetched = wait(&mut fetching) => {
                    fetching = None;
                    if self.receive(fetched) {
                        break WorkEnd::Idle;
                    }
                }
            }
        };
        drop((fetching, jobs));
        self.shut_down(heartbeat).await;
        ended
    }

    /// Receives messages of the queue; returns whether nothing is left to wait for.
    fn receive(&mut self, fetched: FetchedJobs) -> bool {
        if let FetchedJobs::Unreachable(reason) = &fetched {
            if !std::mem::replace(&mut self.is_lost, true) {
                tracing::warn!("the queue does not answer: {reason}; trying again");
            }
            return false;
        }
        self.is_lost = false;
        match fetched {
            FetchedJobs::Messages(messages) => messages.into_iter().for_each(|message| self.take(message)),
            FetchedJobs::Reopened(consumer) => self.consumer = *consumer,
            FetchedJobs::Empty { all_done: true } if self.held.is_empty() => {
                return self.idle_exit.is_some_and(|patience| self.idle_since.elapsed() >= patience);
            }
            _ => {}
        }
        self.idle_since = Instant::now();
        false
    }

    fn take(&mut self, message: Message) {
        let (number, delivered) = match message.info() {
            Ok(info) => (info.stream_sequence, info.delivered),
            Err(_) => return, // not a message of a stream
        };
        let (message, acker) = message.split();
        let job = match read_manifest(&message.payload[..]) {
            Ok(jobs) if jobs.len() == 1 => jobs.into_iter().next(),
            other => {
                let reason = other.err().map_or("it contains no job".to_owned(), |error| error.to_string());
                tracing::warn!("message {number} of the queue is not a job and is removed: {reason}");
                None
            }
        };
        let Some(job) = job else {
            self.report(acker, AckKind::Term);
            return;
        };
        if self.held.is_empty() {
            self.last_progress = Instant::now();
        }
        // A renewal can get lost, and the queue then redelivers a job that is in progress here. It is
        // not started twice.
        if self.held.insert(job.job.clone(), acker).is_none() {
            self.waiting.push_back(TakenJob { job, message: number, delivered });
        }
    }

    /// Reports the outcome of a job to the queue.
    fn end(&mut self, job: &JobKey, outcome: JobOutcome) {
        self.last_progress = Instant::now();
        let Some(acker) = self.held.remove(job) else { return };
        let kind = match outcome {
            JobOutcome::Done => AckKind::Ack,
            JobOutcome::Failed => AckKind::Term,
            JobOutcome::Retry(pause) => AckKind::Nak(Some(pause)),
            JobOutcome::Returned => AckKind::Nak(None),
        };
        self.report(acker, kind);
    }

    /// Sends an acknowledgement until the queue confirms it.
    fn report(&mut self, acker: Acker, kind: AckKind) {
        while self.reports.try_join_next().is_some() {}
        self.reports.spawn(async move {
            for pause in REPORT_PAUSES_S {
                if acker.double_ack_with(kind).await.is_ok() {
                    return;
                }
                sleep(Duration::from_secs(pause)).await;
            }
            tracing::debug!("the outcome of a job cannot be reported; the queue redelivers the job");
        });
    }

    /// Renews the acknowledgement of every job in progress.
    async fn renew(&self) {
        if self.last_progress.elapsed() > STUCK_AFTER {
            return; // the queue may give them to another worker
        }
        for acker in self.held.values() {
            // Without a connection, the next renewal does.
            let _ = timeout(Duration::from_millis(200), acker.ack_with(AckKind::Progress)).await;
        }
    }

    /// Returns jobs that were not started, and waits for those in progress.
    async fn shut_down(mut self, mut heartbeat: tokio::time::Interval) {
        self.stopping.store(true, Ordering::Relaxed);
        for TakenJob { job, .. } in std::mem::take(&mut self.waiting) {
            self.end(&job.job, JobOutcome::Returned);
        }
        loop {
            tokio::select! {
                message = self.messages.recv() => match message {
                    Some(WorkerMessage::Ended(job, outcome)) => self.end(&job, outcome),
                    Some(WorkerMessage::Unfit) => {}
                    None => break,
                },
                _ = heartbeat.tick() => self.renew().await,
            }
        }
        let _ = timeout(SHUTDOWN_TIMEOUT, async { while self.reports.join_next().await.is_some() {} }).await;
    }
}

async fn wait(fetching: &mut Option<Pin<Box<dyn Future<Output = FetchedJobs> + Send>>>) -> FetchedJobs {
    match fetching {
        Some(fetching) => fetching.await,
        None => std::future::pending().await,
    }
}

/// Requests up to `take` jobs. If the queue is empty, the request waits briefly for the next job.
async fn fetch(
    queue: Queue,
    consumer: Consumer<pull::Config>,
    take: usize,
    ack_wait: Duration,
) -> FetchedJobs {
    let asked = timeout(ANSWER_TIMEOUT, async {
        let there = collect(consumer.fetch().max_messages(take).messages().await?).await?;
        if !there.is_empty() {
            return Ok((there, false));
        }
        let one = collect(consumer.batch().max_messages(1).expires(POLL).messages().await?).await?;
        if !one.is_empty() {
            return Ok((one, false));
        }
        let info = consumer.get_info().await?;
        Ok::<_, async_nats::Error>((one, info.num_pending == 0 && info.num_ack_pending == 0))
    });
    let reason = match asked.await {
        Ok(Ok((messages, all_done))) if messages.is_empty() => return FetchedJobs::Empty { all_done },
        Ok(Ok((messages, _))) => return FetchedJobs::Messages(messages),
        Ok(Err(error)) => error,
        Err(_) => "it does not answer".into(),
    };
    sleep(Duration::from_secs(1)).await;
    match timeout(ANSWER_TIMEOUT, queue.consumer(ack_wait)).await {
        Ok(Ok(consumer)) => FetchedJobs::Reopened(Box::new(consumer)),
        Ok(Err(error)) => FetchedJobs::Unreachable(error.into()),
        Err(_) => FetchedJobs::Unreachable(reason),
    }
}

/// All messages of one answer. Messages before an error are kept.
async fn collect(mut batch: pull::Batch) -> Result<Vec<Message>, async_nats::Error> {
    let mut messages = Vec::new();
    while let Some(message) = batch.next().await {
        match message {
            Ok(message) => messages.push(message),
            Err(error) if messages.is_empty() => return Err(error),
            Err(_) => break,
        }
    }
    Ok(messages)
}

/// Why a worker ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WorkEnd {
    /// There was nothing left to do.
    Idle,
    /// A signal stopped it.
    Stopped,
    /// Several jobs in a row failed in ways that this worker may have caused. Other workers, or this
    /// one after a restart, may succeed.
    Unfit,
}
