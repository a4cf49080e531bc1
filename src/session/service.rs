//! The render thread and the bounded queue before it.
//!
//! One thread owns the backend, because a device is used from one place at a time; orders wait in a queue of fixed
//! length, and one more is refused rather than kept. An order that nobody waits for any more is skipped.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use super::cache::{FrameCache, FrameKey};
use super::ticket::{Promise, Ticket, pair};
use super::{BackendError, Origin, RenderBackend, Rendered, ServiceError};
use crate::render::{RenderRequest, RenderedFrame};
use crate::volume::Volume;

/// How much a service keeps.
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

/// Owns the thread that renders. Dropping it, or [`RenderService::shut_down`], lets the queue run empty first.
#[derive(Debug)]
pub struct RenderService {
    queue: Mutex<Option<SyncSender<Order>>>,
    thread: Mutex<Option<JoinHandle<()>>>,
    shared: Arc<Shared>,
    capacity: usize,
}

/// What the service and its thread both see.
#[derive(Debug)]
struct Shared {
    waiting: AtomicUsize,
    recent: Mutex<FrameCache>,
}

struct Order {
    volume: Volume,
    key: FrameKey,
    promise: Promise,
    since: Instant,
}

impl RenderService {
    /// Starts the render thread.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn start(backend: impl RenderBackend, config: QueueConfig) -> std::io::Result<Self> {
        let (sender, receiver) = sync_channel(config.capacity);
        let recent = Mutex::new(FrameCache::new(config.recent_bytes));
        let shared = Arc::new(Shared { waiting: AtomicUsize::new(0), recent });
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

    /// Orders a picture. The answer comes through the ticket; dropping that cancels the order.
    ///
    /// # Errors
    /// [`ServiceError::Busy`] when the queue is full, [`ServiceError::Stopped`] when the thread has ended.
    pub fn render(&self, volume: &Volume, request: RenderRequest) -> Result<Ticket, ServiceError> {
        let key = FrameKey { volume: volume.content_hash(), request };
        if let Some(frame) = lock(&self.shared.recent).get(&key) {
            return Ok(Ticket::ready(Rendered { frame, queue_ms: 0.0, origin: Origin::Reused }));
        }
        let (ticket, promise) = pair();
        let order = Order { volume: volume.clone(), key, promise, since: Instant::now() };
        let queue = lock(&self.queue);
        let sender = queue.as_ref().ok_or(ServiceError::Stopped)?;
        // Counted first: the thread may take the order, and count it off, before `try_send` returns.
        self.shared.waiting.fetch_add(1, Ordering::Relaxed);
        sender.try_send(order).map_err(|error| {
            self.shared.waiting.fetch_sub(1, Ordering::Relaxed);
            match error {
                TrySendError::Full(_) => ServiceError::Busy(self.capacity),
                TrySendError::Disconnected(_) => ServiceError::Stopped,
            }
        })?;
        Ok(ticket)
    }

    /// Orders in the queue, without the one that renders.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.shared.waiting.load(Ordering::Relaxed)
    }

    /// Whether the thread takes orders.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        lock(&self.thread).as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// Takes no more orders, lets the queue run empty and waits for the thread; blocks. A second call does nothing.
    pub fn shut_down(&self) {
        drop(lock(&self.queue).take());
        let thread = lock(&self.thread).take();
        if let Some(thread) = thread
            && thread.join().is_err()
        {
            tracing::error!("the render thread ended by a panic outside a render");
        }
    }
}

/// The render thread: until the queue is closed and empty.
fn work(mut backend: impl RenderBackend, orders: &Receiver<Order>, shared: &Shared) {
    while let Ok(order) = orders.recv() {
        shared.waiting.fetch_sub(1, Ordering::Relaxed);
        if !order.promise.is_wanted() {
            tracing::debug!("skipped an order that nobody waits for");
            continue;
        }
        let queue_ms = order.since.elapsed().as_secs_f64() * 1e3;
        // An equal order may have been rendered while this one waited.
        let recent = lock(&shared.recent).get(&order.key);
        let outcome = match recent {
            Some(frame) => Ok(Rendered { frame, queue_ms, origin: Origin::Reused }),
            None => render(&mut backend, &order).map(|frame| {
                let frame = Arc::new(frame);
                lock(&shared.recent).put(order.key, Arc::clone(&frame));
                Rendered { frame, queue_ms, origin: Origin::Rendered }
            }),
        };
        order.promise.keep(outcome);
    }
}

/// One render. A panic in it is answered as an error and the thread goes on: one bad request must not stop the
/// frames of all others. The backend is used again afterwards, so it must not rely on having finished a call.
fn render(backend: &mut impl RenderBackend, order: &Order) -> Result<RenderedFrame, ServiceError> {
    let attempt = AssertUnwindSafe(|| backend.render(&order.volume, &order.key.request));
    match catch_unwind(attempt) {
        Ok(outcome) => outcome.map_err(|error: BackendError| error.into()),
        Err(panic) => Err(ServiceError::Panicked(panic_text(panic.as_ref()))),
    }
}

fn panic_text(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().copied();
    text.or_else(|| panic.downcast_ref::<String>().map(String::as_str)).unwrap_or("no message").to_owned()
}

/// What is locked here is whole between statements, so a panic elsewhere leaves it usable.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
