//! The requests that wait for the render thread, and which of them is next.
//!
//! A small picture goes before a large one: the next request is the one with the least expected
//! time, less twice the time that it has waited. So a large picture waits at most half of its own
//! time longer than in order of arrival, and a small one does not wait for a queue of large ones.
//! Requests of equal cost keep their order. Times in ms.

use super::service::RenderJob;
use relief_volume::ContentHash;

/// How much a millisecond of waiting counts against one of rendering.
const WAITING_COUNTS: f64 = 2.0;

/// A request interrupts a running one only if it is this much shorter.
const MUCH_SHORTER: f64 = 8.0;

/// How often a picture may be interrupted.
const MOST_INTERRUPTIONS: u32 = 8;

/// Requests, and volumes to be forgotten when the requests before are done.
#[derive(Default)]
pub(super) struct WaitingJobs {
    jobs: Vec<Waiting>,
    forgotten: Vec<(u64, ContentHash)>,
    arrivals: u64,
}

/// A request and how long it is expected to take.
pub(super) struct Waiting {
    pub(super) job: RenderJob,
    pub(super) expected_ms: f64,
    /// How often it was interrupted.
    pub(super) interruptions: u32,
    /// Whether it met a failure of the backend already.
    pub(super) was_retried: bool,
    arrival: u64,
}

impl Waiting {
    /// Whether a request of this expected time may interrupt this one.
    pub(super) fn yields_to(&self, expected_ms: f64) -> bool {
        self.interruptions < MOST_INTERRUPTIONS && expected_ms * MUCH_SHORTER < self.expected_ms
    }

    fn score(&self) -> f64 {
        self.expected_ms - WAITING_COUNTS * self.job.since.elapsed().as_secs_f64() * 1e3
    }
}

impl WaitingJobs {
    /// Adds a request.
    pub(super) fn push(&mut self, job: RenderJob, expected_ms: f64) {
        self.arrivals += 1;
        self.jobs.push(Waiting {
            job,
            expected_ms,
            interruptions: 0,
            was_retried: false,
            arrival: self.arrivals,
        });
    }

    /// Adds a request that was interrupted, in its old place.
    pub(super) fn push_back(&mut self, waiting: Waiting) {
        self.jobs.push(Waiting { interruptions: waiting.interruptions + 1, ..waiting });
    }

    /// Adds a request that met a failure of the backend, in its old place.
    pub(super) fn retry(&mut self, waiting: Waiting) {
        self.jobs.push(Waiting { was_retried: true, ..waiting });
    }

    /// A volume to be forgotten after all requests that are there now.
    pub(super) fn forget(&mut self, volume: ContentHash) {
        self.forgotten.push((self.arrivals, volume));
    }

    /// Takes the next request.
    pub(super) fn pop(&mut self) -> Option<Waiting> {
        let scores = self.jobs.iter().map(|waiting| (waiting.score(), waiting.arrival));
        let least = scores.enumerate().min_by(|(_, a), (_, b)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        least.map(|(at, _)| self.jobs.swap_remove(at))
    }

    /// Takes the volumes whose requests are all done.
    pub(super) fn forgettable(&mut self) -> Vec<ContentHash> {
        let oldest = self.jobs.iter().map(|waiting| waiting.arrival).min().unwrap_or(u64::MAX);
        let (done, rest) = self.forgotten.drain(..).partition(|(arrival, _)| *arrival < oldest);
        self.forgotten = rest;
        let done: Vec<(u64, ContentHash)> = done;
        done.into_iter().map(|(_, volume)| volume).collect()
    }

    /// The least expected time of a request that somebody waits for.
    pub(super) fn shortest_ms(&self) -> Option<f64> {
        let wanted = self.jobs.iter().filter(|waiting| waiting.job.promise.is_wanted());
        wanted.map(|waiting| waiting.expected_ms).min_by(f64::total_cmp)
    }

    /// Whether nothing waits.
    pub(super) fn is_empty(&self) -> bool {
        self.jobs.is_empty() && self.forgotten.is_empty()
    }
}
