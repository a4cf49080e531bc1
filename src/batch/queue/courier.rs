//! The courier between a queue and a worker: fetches jobs, keeps them acknowledged as in progress,
//! reports their results.
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

/// How long the queue is asked to wait for a job.
const POLL: Duration = Duration::from_secs(2);
/// Beyond that an answer of the queue does not come any more.
const NO_ANSWER: Duration = Duration::from_secs(12);
/// A worker that has said nothing for so long is stuck: its jobs go to another one.
pub(super) const STUCK: Duration = Duration::from_secs(900);
/// Pauses between tries to report a result; without a report the queue redelivers the job.
const PAUSES_S: [u64; 5] = [1, 2, 4, 8, 16];
/// How long the last words may take when the worker leaves.
const FAREWELL: Duration = Duration::from_secs(15);

/// A job that was taken from the queue.
#[derive(Debug)]
pub(super) struct TakenJob {
    pub(super) job: Job,
    /// The number of its message in the stream.
    pub(super) message: u64,
    /// How often it was given to a worker, this time included.
    pub(super) delivered: i64,
}

/// A message of the worker.
#[derive(Debug)]
pub(super) enum WorkerMessage {
    /// The result of a job.
    Of(JobKey, JobVerdict),
    /// This worker had better not go on.
    Unfit,
}

/// The result of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum JobVerdict {
    /// Its outputs exist.
    Done,
    /// It cannot be done.
    Never,
    /// It may be done after a pause.
    Later(Duration),
    /// It was not begun.
    Back,
}

/// The outcome of asking the queue for jobs.
enum FetchedJobs {
    Messages(Vec<Message>),
    /// None, and whether there is nothing left to do either, by any worker.
    Nothing {
        is_over: bool,
    },
    /// The consumer was not there any more, or no connection was; here it is again.
    Again(Box<Consumer<pull::Config>>),
    Lost(async_nats::Error),
}

/// Brings jobs and takes words.
pub(super) struct QueueClient {
    queue: Queue,
    consumer: Consumer<pull::Config>,
    ack_wait: Duration,
    take: usize,
    idle_exit: Option<Duration>,
    words: Receiver<WorkerMessage>,
    stopping: Arc<AtomicBool>,
    /// Jobs of this worker whose fate the queue does not know.
    held: HashMap<JobKey, Acker>,
    /// Those of them that the worker has not got yet.
    waiting: VecDeque<TakenJob>,
    settling: JoinSet<()>,
    last_word: Instant,
    idle_since: Instant,
    is_lost: bool,
}

impl QueueClient {
    /// Opens the stream and its consumer, which are made where they are not there.
    pub(super) async fn new(
        queue: &Queue,
        ack_wait: Duration,
        take: usize,
        idle_exit: Option<Duration>,
        words: Receiver<WorkerMessage>,
        stopping: Arc<AtomicBool>,
    ) -> Result<Self, QueueError> {
        let consumer = queue.consumer(ack_wait).await?;
        Ok(Self {
            queue: queue.clone(),
            // The first worker has said it for all.
            ack_wait: consumer.cached_info().config.ack_wait,
            consumer,
            take,
            idle_exit,
            words,
            stopping,
            held: HashMap::new(),
            waiting: VecDeque::new(),
            settling: JoinSet::new(),
            last_word: Instant::now(),
            idle_since: Instant::now(),
            is_lost: false,
        })
    }

    /// Feeds the worker until `stop` is done, there is nothing left to do, or the worker says that
    /// it is unfit.
    pub(super) async fn run(mut self, feed: Sender<TakenJob>, stop: impl Future<Output = ()>) -> WorkEnd {
        let mut stop = pin!(stop);
        let mut beat = interval(self.ack_wait / 3);
        beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut fetching: Option<Pin<Box<dyn Future<Output = FetchedJobs> + Send>>> = None;
        let ended = loop {
            if self.waiting.is_empty() && fetching.is_none() {
                let (queue, consumer) = (self.queue.clone(), self.consumer.clone());
                fetching = Some(Box::pin(fetch(queue, consumer, self.take, self.ack_wait)));
            }
            tokio::select! {
                () = &mut stop => break WorkEnd::Stopped,
                word = self.words.recv() => match word {
                    Some(WorkerMessage::Of(job, verdict)) => self.settle(&job, verdict),
                    Some(WorkerMessage::Unfit) => break WorkEnd::Unfit,
                    None => break WorkEnd::Stopped,
                },
                _ = beat.tick() => self.beat().await,
                room = feed.reserve(), if !self.waiting.is_empty() => {
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
        drop((fetching, feed));
        self.leave(beat).await;
        ended
    }

    /// Receives messages of the queue; returns whether nothing is left to wait for.
    fn receive(&mut self, fetched: FetchedJobs) -> bool {
        if let FetchedJobs::Lost(reason) = &fetched {
            if !std::mem::replace(&mut self.is_lost, true) {
                tracing::warn!("the queue gives no jobs: {reason}; it is asked again");
            }
            return false;
        }
        self.is_lost = false;
        match fetched {
            FetchedJobs::Messages(messages) => messages.into_iter().for_each(|message| self.take(message)),
            FetchedJobs::Again(consumer) => self.consumer = *consumer,
            FetchedJobs::Nothing { is_over: true } if self.held.is_empty() => {
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
            Err(_) => return, // no message of a stream
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
            self.tell(acker, AckKind::Term);
            return;
        };
        if self.held.is_empty() {
            self.last_word = Instant::now();
        }
        // One that comes again while it is here, because signs of life were lost on the way, is not
        // begun twice.
        if self.held.insert(job.job.clone(), acker).is_none() {
            self.waiting.push_back(TakenJob { job, message: number, delivered });
        }
    }

    /// Reports the result of a job to the queue.
    fn settle(&mut self, job: &JobKey, verdict: JobVerdict) {
        self.last_word = Instant::now();
        let Some(acker) = self.held.remove(job) else { return };
        let kind = match verdict {
            JobVerdict::Done => AckKind::Ack,
            JobVerdict::Never => AckKind::Term,
            JobVerdict::Later(pause) => AckKind::Nak(Some(pause)),
            JobVerdict::Back => AckKind::Nak(None),
        };
        self.tell(acker, kind);
    }

    /// Says it until the queue has heard.
    fn tell(&mut self, acker: Acker, kind: AckKind) {
        while self.settling.try_join_next().is_some() {}
        self.settling.spawn(async move {
            for pause in PAUSES_S {
                if acker.double_ack_with(kind).await.is_ok() {
                    return;
                }
                sleep(Duration::from_secs(pause)).await;
            }
            tracing::debug!("the queue does not hear what became of a job, and gives it to another worker");
        });
    }

    /// Says of every job that it is in good hands.
    async fn beat(&self) {
        if self.last_word.elapsed() > STUCK {
            return; // the queue may give them to another worker
        }
        for acker in self.held.values() {
            // Where there is no connection, the next beat is as good.
            let _ = timeout(Duration::from_millis(200), acker.ack_with(AckKind::Progress)).await;
        }
    }

    /// Returns jobs that were not begun, and waits for those in progress.
    async fn leave(mut self, mut beat: tokio::time::Interval) {
        self.stopping.store(true, Ordering::Relaxed);
        for TakenJob { job, .. } in std::mem::take(&mut self.waiting) {
            self.settle(&job.job, JobVerdict::Back);
        }
        loop {
            tokio::select! {
                word = self.words.recv() => match word {
                    Some(WorkerMessage::Of(job, verdict)) => self.settle(&job, verdict),
                    Some(WorkerMessage::Unfit) => {}
                    None => break,
                },
                _ = beat.tick() => self.beat().await,
            }
        }
        let _ = timeout(FAREWELL, async { while self.settling.join_next().await.is_some() {} }).await;
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
    let asked = timeout(NO_ANSWER, async {
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
        Ok(Ok((messages, is_over))) if messages.is_empty() => return FetchedJobs::Nothing { is_over },
        Ok(Ok((messages, _))) => return FetchedJobs::Messages(messages),
        Ok(Err(error)) => error,
        Err(_) => "it does not answer".into(),
    };
    sleep(Duration::from_secs(1)).await;
    match timeout(NO_ANSWER, queue.consumer(ack_wait)).await {
        Ok(Ok(consumer)) => FetchedJobs::Again(Box::new(consumer)),
        Ok(Err(error)) => FetchedJobs::Lost(error.into()),
        Err(_) => FetchedJobs::Lost(reason),
    }
}

/// All messages of one answer. What came before an error is not given away.
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

/// Why a worker left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WorkEnd {
    /// There was nothing left to do.
    Idle,
    /// A signal stopped it.
    Stopped,
    /// Several jobs in a row failed in ways that may be its own: others, or it when restarted,
    /// may do better.
    Unfit,
}
