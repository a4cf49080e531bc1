//! Blocking work on threads of its own, limited by permits of a semaphore.
//!
//! Encoding, snapping and reading files would stall async tasks. What it is not: the render thread
//! (see `service`).

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use tokio::sync::OwnedSemaphorePermit;

/// A blocking job that did not finish.
#[derive(Debug, thiserror::Error)]
pub enum JobError {
    /// The job panicked.
    #[error("{what} panicked: {source}")]
    Panicked {
        /// Name of the job.
        what: &'static str,
        /// The panic.
        source: tokio::task::JoinError,
    },
    /// The semaphore was closed: the process shuts down.
    #[error("{what} was not started: the server stops")]
    Closed {
        /// Name of the job.
        what: &'static str,
    },
    /// The caller was dropped or timed out.
    #[error("the client left before the job finished")]
    Abandoned,
}

/// Runs `job` on a blocking thread, which holds `permit` until the job ends. Dropping the returned
/// future does not stop the job.
///
/// # Errors
/// [`JobError::Panicked`].
pub async fn on_blocking_thread<T: Send + 'static>(
    permit: OwnedSemaphorePermit,
    what: &'static str,
    job: impl FnOnce() -> T + Send + 'static,
) -> Result<T, JobError> {
    let (span, since) = (tracing::debug_span!("job", what), Instant::now());
    let job = tokio::task::spawn_blocking(move || {
        let (_permit, _span) = (permit, span.entered());
        let waited_ms = since.elapsed().as_secs_f64() * 1e3;
        let done = job();
        let ms = since.elapsed().as_secs_f64() * 1e3 - waited_ms;
        tracing::trace!(waited_ms, ms, "finished");
        done
    });
    job.await.map_err(|source| JobError::Panicked { what, source })
}

/// As [`on_blocking_thread`], with a [`Waiting`] handle that tells the job when the returned future
/// was dropped.
///
/// # Errors
/// [`JobError`], and the errors of the job.
pub async fn while_awaited<T: Send + 'static, E: From<JobError> + Send + 'static>(
    permit: OwnedSemaphorePermit,
    what: &'static str,
    job: impl FnOnce(&Waiting) -> Result<T, E> + Send + 'static,
) -> Result<T, E> {
    let stop = Stop::default();
    let waiting = Waiting(Arc::clone(&stop.0));
    let job = move || {
        waiting.expect()?; // the caller may have left while the job waited for a thread
        job(&waiting)
    };
    on_blocking_thread(permit, what, job).await?
}

/// Tells a job whether its caller still waits for it.
#[derive(Debug)]
pub struct Waiting(Arc<AtomicBool>);

impl Waiting {
    /// Whether the caller still waits.
    #[must_use]
    pub fn is_there(&self) -> bool {
        !self.0.load(Ordering::Relaxed)
    }

    /// Fails once the caller has left, so that a job can stop with `?`.
    ///
    /// # Errors
    /// [`JobError::Abandoned`].
    pub fn expect(&self) -> Result<(), JobError> {
        if self.is_there() { Ok(()) } else { Err(JobError::Abandoned) }
    }
}

/// Sets the flag of [`Waiting`] when the caller's future is dropped.
#[derive(Default)]
struct Stop(Arc<AtomicBool>);

impl Drop for Stop {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::sync_channel;

    use tokio::sync::Semaphore;

    use super::*;

    #[tokio::test]
    async fn a_job_keeps_its_permit_after_its_caller_left() {
        let permits = Arc::new(Semaphore::new(1));
        let permit = Arc::clone(&permits).try_acquire_owned().unwrap();
        let ((go, gate), (starting, started)) = (sync_channel::<()>(1), tokio::sync::oneshot::channel());
        let caller = tokio::spawn(on_blocking_thread(permit, "waiting", move || {
            starting.send(()).unwrap();
            gate.recv().unwrap();
        }));
        started.await.unwrap();
        caller.abort();
        assert!(caller.await.unwrap_err().is_cancelled());
        assert_eq!(permits.available_permits(), 0, "the job still runs");
        go.send(()).unwrap();
        permits.acquire().await.unwrap().forget();
    }

    #[tokio::test]
    async fn a_job_learns_that_its_caller_left() {
        let permits = Arc::new(Semaphore::new(1));
        let permit = Arc::clone(&permits).try_acquire_owned().unwrap();
        let (starting, started) = tokio::sync::oneshot::channel();
        let caller = tokio::spawn(while_awaited(permit, "waiting", move |waiting: &Waiting| {
            starting.send(waiting.is_there()).unwrap();
            while waiting.is_there() {
                std::thread::yield_now();
            }
            waiting.expect()
        }));
        assert!(started.await.unwrap(), "the caller waits");
        assert_eq!(permits.available_permits(), 0);
        caller.abort();
        // The job ends by itself and releases its permit.
        permits.acquire().await.unwrap().forget();
        // A job whose caller stays runs to its end.
        let permit = Arc::new(Semaphore::new(1)).try_acquire_owned().unwrap();
        let done: Result<_, JobError> =
            while_awaited(permit, "working", |waiting: &Waiting| waiting.expect().map(|()| 7)).await;
        assert_eq!(done.unwrap(), 7);
    }

    #[tokio::test]
    async fn a_job_that_panics_releases_its_permit() {
        let permits = Arc::new(Semaphore::new(1));
        let permit = Arc::clone(&permits).try_acquire_owned().unwrap();
        assert!(on_blocking_thread(permit, "panicking", || panic!("unlucky")).await.is_err());
        assert_eq!(permits.available_permits(), 1);
    }
}
