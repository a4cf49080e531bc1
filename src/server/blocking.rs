//! Work that would hold up the async threads, on threads of its own, as much at a time as there are places.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use tokio::sync::OwnedSemaphorePermit;

use super::problem::Problem;

/// Runs `job` on a blocking thread. It holds its place to its end: when a client leaves, the handler that waits is
/// dropped, but the job runs on.
///
/// # Errors
/// When the job panics; `what` says what failed.
pub(super) async fn on_blocking_thread<T: Send + 'static>(
    place: OwnedSemaphorePermit,
    what: &str,
    job: impl FnOnce() -> T + Send + 'static,
) -> Result<T, Problem> {
    let job = tokio::task::spawn_blocking(move || {
        let _place = place;
        job()
    });
    job.await.map_err(|panic| Problem::internal(what, panic))
}

/// As [`on_blocking_thread`]; the job is told when the client leaves or the deadline comes, and nobody waits for it any more.
///
/// # Errors
/// When the job panics, or says so.
pub(super) async fn while_awaited<T: Send + 'static>(
    place: OwnedSemaphorePermit,
    what: &str,
    job: impl FnOnce(&Waiting) -> Result<T, Problem> + Send + 'static,
) -> Result<T, Problem> {
    let stop = Stop::default();
    let waiting = Waiting(Arc::clone(&stop.0));
    let job = move || {
        waiting.expect()?; // nobody may have waited for the thread
        job(&waiting)
    };
    on_blocking_thread(place, what, job).await?
}

/// Whether anybody still waits for what is worked on.
pub(super) struct Waiting(Arc<AtomicBool>);

impl Waiting {
    pub(super) fn is_there(&self) -> bool {
        !self.0.load(Ordering::Relaxed)
    }

    /// Goes on while somebody waits.
    ///
    /// # Errors
    /// When nobody does; nobody hears of it.
    pub(super) fn expect(&self) -> Result<(), Problem> {
        if self.is_there() {
            return Ok(());
        }
        Err(Problem::unavailable("stopped", "nobody waits for this any more"))
    }
}

/// Ends the work when whoever waits for it is gone.
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
    async fn a_job_keeps_its_place_when_nobody_waits_for_it() {
        let places = Arc::new(Semaphore::new(1));
        let place = Arc::clone(&places).try_acquire_owned().unwrap();
        let ((go, gate), (starting, started)) = (sync_channel::<()>(1), tokio::sync::oneshot::channel());
        let waits = tokio::spawn(on_blocking_thread(place, "waiting", move || {
            starting.send(()).unwrap();
            gate.recv().unwrap();
        }));
        started.await.unwrap();
        waits.abort();
        assert!(waits.await.unwrap_err().is_cancelled());
        assert_eq!(places.available_permits(), 0, "the job still runs");
        go.send(()).unwrap();
        places.acquire().await.unwrap().forget();
    }

    #[tokio::test]
    async fn a_job_is_told_that_nobody_waits_for_it() {
        let places = Arc::new(Semaphore::new(1));
        let place = Arc::clone(&places).try_acquire_owned().unwrap();
        let (starting, started) = tokio::sync::oneshot::channel();
        let waits = tokio::spawn(while_awaited(place, "waiting", move |waiting: &Waiting| {
            starting.send(waiting.is_there()).unwrap();
            while waiting.is_there() {
                std::thread::yield_now();
            }
            waiting.expect()
        }));
        assert!(started.await.unwrap(), "somebody waits");
        assert_eq!(places.available_permits(), 0);
        waits.abort();
        // The job ends by itself, and its place is free.
        places.acquire().await.unwrap().forget();
        // One that is awaited is let be.
        let place = Arc::new(Semaphore::new(1)).try_acquire_owned().unwrap();
        let done = while_awaited(place, "working", |waiting: &Waiting| waiting.expect().map(|()| 7)).await;
        assert_eq!(done.unwrap(), 7);
    }

    #[tokio::test]
    async fn a_job_that_panics_gives_its_place_back() {
        let places = Arc::new(Semaphore::new(1));
        let place = Arc::clone(&places).try_acquire_owned().unwrap();
        assert!(on_blocking_thread(place, "panicking", || panic!("unlucky")).await.is_err());
        assert_eq!(places.available_permits(), 1);
    }
}
