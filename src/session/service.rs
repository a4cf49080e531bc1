//! The render thread and the bounded queue before it.
//!
//! One thread owns the backend, because a device must be used by one thread at a time. Requests
//! wait in a bounded queue; a request beyond the limit is refused. A request whose ticket was
//! dropped is skipped, or cancelled if it is being rendered. Small pictures go before large ones
//! (see `waiting`), and a large one makes room for much smaller ones between two bands or passes: it
//! is continued where it was interrupted. A backend that failed is recreated, and the request
//! that met the failure is tried once more. Forgetting a volume uses the same queue and is never
//! refused, because it frees memory.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use parking_lot::Mutex;

use super::budget::{BudgetedRequest, SpeedBook};
use super::cache::{FrameCache, FrameKey};
use super::guard::guarded;
use super::healing::Healing;
use super::ticket::{Ticket, pair};
use super::waiting::{RenderJob, Waiting, WaitingJobs};
use super::{BackendError, Origin, RenderBackend, Rendered, ServiceError};
use relief_render::{MemoryUse, Progress, RenderRequest, RenderedFrame, Timings};
use relief_volume::{ContentHash, Grid, Volume};

/// The limits of what a service keeps.
#[derive(Clone, Copy, Debug)]
pub struct QueueConfig {
    /// Orders that may wait while one renders.
    pub capacity: usize,
    /// Bytes of recent frames to keep for picks and other encodings.
    pub recent_bytes: usize,
}

impl Default for QueueConfig {
    fn default() -> Self {
        Self { capacity: 32, recent_bytes: 64 << 20 }
    }
}

/// The longest time without progress of a picture while the service shuts down.
const SHUT_DOWN_PATIENCE: Duration = Duration::from_secs(5);

/// Owns the thread that renders. Dropping it, or [`RenderService::shut_down`], lets the queue run
/// empty first.
#[derive(Debug)]
pub struct RenderService {
    queue: Mutex<Option<Sender<Job>>>,
    thread: Mutex<Option<JoinHandle<()>>>,
    shared: Arc<ServiceState>,
    capacity: usize,
}

/// State that the service and its thread share.
#[derive(Debug)]
struct ServiceState {
    /// Orders in the queue: it bounds them, since the channel does not.
    waiting: AtomicUsize,
    recent: Mutex<FrameCache>,
    is_healthy: AtomicBool,
    skipped: AtomicU64,
    cancelled: AtomicU64,
    bands: AtomicU64,
    memory: Mutex<MemoryUse>,
    /// While a picture is rendered, the time of its last sign of life.
    alive_at: Mutex<Option<Instant>>,
    speeds: Mutex<SpeedBook>,
}

/// Counters since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ServiceCounts {
    /// Requests that were skipped in the queue.
    pub skipped: u64,
    /// Requests that were cancelled while they were rendered.
    pub cancelled: u64,
    /// Bands of pictures that were rendered.
    pub bands: u64,
}

/// A message for the thread.
enum Job {
    Render(Box<RenderJob>),
    Forget(ContentHash),
}

impl RenderService {
    /// Starts the render thread.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn start(backend: impl RenderBackend, config: QueueConfig) -> std::io::Result<Self> {
        #[expect(
            clippy::disallowed_methods,
            reason = "`waiting` bounds the orders, the volumes bound the rest"
        )]
        let (sender, receiver) = channel();
        let recent = Mutex::new(FrameCache::new(config.recent_bytes));
        let shared = Arc::new(ServiceState {
            waiting: AtomicUsize::new(0),
            recent,
            is_healthy: AtomicBool::new(true),
            skipped: AtomicU64::new(0),
            cancelled: AtomicU64::new(0),
            bands: AtomicU64::new(0),
            memory: Mutex::new(backend.memory()),
            alive_at: Mutex::default(),
            speeds: Mutex::default(),
        });
        let seen = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("relief-render".into())
            .spawn(move || work(backend, &receiver, &seen))?;
        Ok(Self {
            queue: Mutex::new(Some(sender)),
            thread: Mutex::new(Some(thread)),
            shared,
            capacity: config.capacity,
        })
    }

    /// Orders a picture. The answer comes through the ticket; dropping that cancels the order,
    /// in the queue as while it renders.
    ///
    /// # Errors
    /// [`ServiceError::Busy`] when the queue is full, [`ServiceError::Stopped`] when the thread has
    /// ended.
    pub fn render(&self, volume: &Volume, request: RenderRequest) -> Result<Ticket, ServiceError> {
        self.render_for(None, volume, request)
    }

    /// Orders a picture for a caller, as [`Self::render`]. The time of the render thread is shared
    /// out fairly among callers that wait.
    ///
    /// # Errors
    /// Those of [`Self::render`].
    pub fn render_for(
        &self,
        caller: Option<Arc<str>>,
        volume: &Volume,
        request: RenderRequest,
    ) -> Result<Ticket, ServiceError> {
        let key = FrameKey { volume: volume.content_hash(), request };
        if let Some(frame) = self.shared.recent.lock().get(&key) {
            tracing::trace!("reused a recent frame");
            return Ok(Ticket::ready(Rendered { frame, queue_ms: 0.0, origin: Origin::Reused }));
        }
        let (ticket, promise) = pair();
        let span = tracing::Span::current();
        let order = RenderJob { volume: volume.clone(), key, promise, caller, since: Instant::now(), span };
        let queue = self.queue.lock();
        let sender = queue.as_ref().ok_or(ServiceError::Stopped)?;
        // Counted first: the thread may take the request, and decrement the count, before
        // `send` returns.
        let waiting = &self.shared.waiting;
        let one_more = |count: usize| (count < self.capacity).then_some(count + 1);
        waiting
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, one_more)
            .map_err(|_| ServiceError::Busy(self.capacity))?;
        sender.send(Job::Render(Box::new(order))).map_err(|_| {
            waiting.fetch_sub(1, Ordering::Relaxed);
            ServiceError::Stopped
        })?;
        Ok(ticket)
    }

    /// A request, reduced so that it can be expected to render within a budget (ms), by the speed
    /// of earlier pictures of this volume and mode.
    #[must_use]
    pub fn plan(
        &self,
        volume: ContentHash,
        grid: &Grid,
        request: &RenderRequest,
        budget_ms: f64,
    ) -> BudgetedRequest {
        self.shared.speeds.lock().plan(volume, grid, request, budget_ms)
    }

    /// The request of a view that moves, see [`SpeedBook::plan_moving`](crate::SpeedBook::plan_moving).
    #[must_use]
    pub fn plan_moving(&self, volume: ContentHash, grid: &Grid, request: &RenderRequest) -> BudgetedRequest {
        self.shared.speeds.lock().plan_moving(volume, grid, request)
    }

    /// Drops cached data of a volume: its recent frames at once, the backend's data after the
    /// requests before.
    pub fn forget(&self, volume: ContentHash) {
        self.shared.recent.lock().forget(volume);
        self.shared.speeds.lock().forget(volume);
        if let Some(sender) = self.queue.lock().as_ref() {
            let _ = sender.send(Job::Forget(volume)); // a thread that has ended keeps nothing
        }
    }

    /// Orders in the queue, without the one that renders.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.shared.waiting.load(Ordering::Relaxed)
    }

    /// Counters since the start.
    #[must_use]
    pub fn counts(&self) -> ServiceCounts {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        let ServiceState { skipped, cancelled, bands, .. } = &*self.shared;
        ServiceCounts { skipped: read(skipped), cancelled: read(cancelled), bands: read(bands) }
    }

    /// Memory of volumes on the adapter, after the last request.
    #[must_use]
    pub fn memory(&self) -> MemoryUse {
        *self.shared.memory.lock()
    }

    /// Whether the thread takes orders.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.thread.lock().as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// The time without progress of the picture that is being rendered; zero while nothing is
    /// rendered.
    #[must_use]
    pub fn stalled_for(&self) -> Duration {
        let alive_at = *self.shared.alive_at.lock();
        alive_at.map_or(Duration::ZERO, |at| at.elapsed())
    }

    /// Whether the backend works, as far as is known: not after it failed, until a render succeeds.
    #[must_use]
    pub fn is_healthy(&self) -> bool {
        self.shared.is_healthy.load(Ordering::Relaxed)
    }

    /// Refuses further orders, and waits until the queue is empty and the thread has ended; blocks. A
    /// thread that makes no progress is not waited for. A second call does nothing.
    pub fn shut_down(&self) {
        drop(self.queue.lock().take());
        let Some(thread) = self.thread.lock().take() else { return };
        while !thread.is_finished() {
            if self.stalled_for() > SHUT_DOWN_PATIENCE {
                tracing::error!("the render thread makes no progress; it is left behind");
                return;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        if thread.join().is_err() {
            tracing::error!("the render thread ended by a panic outside a render");
        }
    }
}

/// The render thread: until the queue is closed and empty.
fn work(mut backend: impl RenderBackend, jobs: &Receiver<Job>, shared: &ServiceState) {
    let (mut waiting, mut healing) = (WaitingJobs::default(), Healing::default());
    loop {
        if waiting.is_empty() {
            // A broken backend is recreated while nothing waits, too: a server that is taken out of
            // rotation gets no requests.
            let wait = healing.wait().filter(|_| backend.can_be_renewed());
            match wait
                .map_or_else(|| jobs.recv().map_err(RecvTimeoutError::from), |wait| jobs.recv_timeout(wait))
            {
                Ok(job) => take(job, &mut waiting, shared),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
        }
        if healing.wait().is_some() && healing.attempt(&mut backend) {
            shared.is_healthy.store(true, Ordering::Relaxed);
        }
        take_all(jobs, &mut waiting, shared);
        for volume in waiting.forgettable() {
            forget(&mut backend, volume, shared);
        }
        if let Some(next) = waiting.pop() {
            answer(&mut backend, next, jobs, &mut healing, &mut waiting, shared);
        }
    }
}

/// Takes the messages that have arrived, without waiting.
fn take_all(jobs: &Receiver<Job>, waiting: &mut WaitingJobs, shared: &ServiceState) {
    while let Ok(job) = jobs.try_recv() {
        take(job, waiting, shared);
    }
}

fn take(job: Job, waiting: &mut WaitingJobs, shared: &ServiceState) {
    match job {
        Job::Render(order) => {
            let FrameKey { volume, request } = &order.key;
            let expected_ms = shared.speeds.lock().expected_ms(*volume, order.volume.grid(), request);
            waiting.push(*order, expected_ms);
        }
        Job::Forget(volume) => waiting.forget(volume),
    }
}

/// Forgets a volume a second time: requests that were queued before have cached frames since.
fn forget(backend: &mut impl RenderBackend, volume: ContentHash, shared: &ServiceState) {
    shared.recent.lock().forget(volume);
    if let Err(panic) = guarded(|| backend.forget(volume)) {
        tracing::error!(panic, "forgetting a volume panicked");
    }
    *shared.memory.lock() = backend.memory();
}

/// Answers one order, from the recent frames if it can. An interrupted one waits again.
fn answer(
    backend: &mut impl RenderBackend,
    mut next: Waiting,
    jobs: &Receiver<Job>,
    healing: &mut Healing,
    waiting: &mut WaitingJobs,
    shared: &ServiceState,
) {
    let _request = next.job.span.clone().entered();
    let order = &next.job;
    let left = || shared.waiting.fetch_sub(1, Ordering::Relaxed);
    if !order.promise.is_wanted() {
        left();
        shared.skipped.fetch_add(1, Ordering::Relaxed);
        tracing::debug!("skipped the frame: its client left");
        return waiting.ended(&next);
    }
    let queue_ms = order.since.elapsed().as_secs_f64() * 1e3;
    tracing::trace!(queue_ms, expected_ms = next.expected_ms, "left the queue");
    // An equal order may have been rendered while this one waited.
    let recent = shared.recent.lock().get(&order.key);
    let outcome = match recent {
        Some(frame) => {
            left();
            Ok(Rendered { frame, queue_ms, origin: Origin::Reused })
        }
        None => {
            left();
            let since = Instant::now();
            backend.expect_others(waiting.is_shared());
            let rendered = render(backend, &next, jobs, waiting, shared);
            waiting.rendered(&mut next, since.elapsed());
            match rendered {
                Ok(None) => {
                    tracing::trace!("made room for a smaller picture");
                    shared.waiting.fetch_add(1, Ordering::Relaxed);
                    return waiting.push_back(next);
                }
                Ok(Some(frame)) => {
                    let frame = Arc::new(frame);
                    // The same part of a picture is not requested twice.
                    if !frame.is_partial {
                        shared.recent.lock().put(next.job.key.clone(), Arc::clone(&frame));
                    }
                    Ok(Rendered { frame, queue_ms, origin: Origin::Rendered })
                }
                Err(ServiceError::Backend(BackendError::Failed(error))) => {
                    tracing::error!(cause = %error, "rendering failed");
                    healing.failed();
                    if !next.was_retried && healing.attempt(backend) {
                        shared.is_healthy.store(true, Ordering::Relaxed);
                        shared.waiting.fetch_add(1, Ordering::Relaxed);
                        return waiting.retry(next);
                    }
                    Err(BackendError::Failed(error).into())
                }
                Err(error) => Err(error),
            }
        }
    };
    waiting.ended(&next);
    next.job.promise.keep(outcome);
}

/// Renders one request and updates the health of the backend; `None` when it was interrupted by a
/// much smaller one. A refusal does not change the health: it concerns the request.
fn render(
    backend: &mut impl RenderBackend,
    next: &Waiting,
    jobs: &Receiver<Job>,
    waiting: &mut WaitingJobs,
    shared: &ServiceState,
) -> Result<Option<RenderedFrame>, ServiceError> {
    let (order, is_healthy) = (&next.job, &shared.is_healthy);
    let RenderRequest { mode, size_px: [width, height], .. } = order.key.request;
    let _frame = tracing::debug_span!("frame", mode = mode.name(), width, height).entered();
    let (mut last, mut is_interrupted) = (Progress::default(), false);
    let mut goes_on = |progress: Progress| {
        shared.bands.fetch_add(progress.bands - last.bands, Ordering::Relaxed);
        tracing::trace!(bands = progress.bands, passes = progress.passes, "rendered a band");
        if progress.is_kept {
            take_all(jobs, waiting, shared);
            is_interrupted = waiting.interrupts(next);
        }
        last = progress;
        *shared.alive_at.lock() = Some(Instant::now());
        let goes_on = order.promise.is_wanted() && !is_interrupted;
        if goes_on { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    };
    *shared.alive_at.lock() = Some(Instant::now());
    let outcome = guarded(|| backend.render(&order.volume, &order.key.request, &mut goes_on));
    *shared.alive_at.lock() = None;
    // Before the answer, because its receiver may read these values.
    *shared.memory.lock() = backend.memory();
    match &outcome {
        Ok(Ok(frame)) => {
            is_healthy.store(true, Ordering::Relaxed);
            let FrameKey { volume, request } = &order.key;
            let passes = last.passes.saturating_sub(last.continued);
            let grid = order.volume.grid();
            // Moving pictures, which are planned by this speed, cast no views beside them.
            let ms = frame.timings.render_ms - frame.timings.views_ms;
            let Timings { upload_ms, overlay_ms, .. } = frame.timings;
            tracing::trace!(upload_ms, render_ms = ms, overlay_ms, passes, "rendered");
            if !frame.is_partial {
                shared.speeds.lock().record(*volume, grid, request, passes, ms);
            }
        }
        Ok(Err(BackendError::Failed(_))) => is_healthy.store(false, Ordering::Relaxed),
        Ok(Err(BackendError::Cancelled)) if is_interrupted && order.promise.is_wanted() => return Ok(None),
        Ok(Err(BackendError::Cancelled)) => {
            shared.cancelled.fetch_add(1, Ordering::Relaxed);
            tracing::debug!("cancelled the frame: its client left");
        }
        Ok(Err(BackendError::Refused(_))) | Err(_) => {}
    }
    Ok(Some(outcome.map_err(ServiceError::Panicked)??))
}
