//! Work that would hold up the async threads, on threads of its own, as much at a time as there are places.

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

#[cfg(test)]
mod tests {
    use std::sync::Arc;
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
    async fn a_job_that_panics_gives_its_place_back() {
        let places = Arc::new(Semaphore::new(1));
        let place = Arc::clone(&places).try_acquire_owned().unwrap();
        assert!(on_blocking_thread(place, "panicking", || panic!("unlucky")).await.is_err());
        assert_eq!(places.available_permits(), 1);
    }
}
