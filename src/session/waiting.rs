//! The requests that wait for the render thread, and which of them is next.
//!
//! Weighted fair queueing (Demers, Keshav and Shenker, SIGCOMM 1989) with equal weights: the next
//! request is the one that would be finished first if all callers were served at once, each with an
//! equal share of the thread. So a small picture does not wait for large ones of others, a caller
//! who asks for much delays its own pictures first, and each request has its turn in the end. A
//! request without a caller counts as a caller of its own. Requests that would be finished at the
//! same time keep their order. Times in ms.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;
use std::time::Duration;

use super::service::RenderJob;
use relief_volume::ContentHash;

/// A request interrupts a running one only if it is this much shorter.
const MUCH_SHORTER: f64 = 8.0;

/// How often a picture may be interrupted: each time may cost another preparation of its light.
const MOST_INTERRUPTIONS: u32 = 64;

/// A request is charged at most this many times its expected time: it may have compiled a shader or
/// uploaded a volume, for all callers.
const MOST_CHARGE: f64 = 4.0;

/// Requests, and volumes to be forgotten when the requests before are done.
#[derive(Default)]
pub(super) struct WaitingJobs {
    jobs: Vec<Waiting>,
    forgotten: Vec<(u64, ContentHash)>,
    arrivals: u64,
    /// The service that a caller who always waits has received.
    virtual_ms: f64,
    /// The virtual times at which the requests of callers are finished.
    finished_ms: HashMap<Arc<str>, f64>,
}

/// A request and how long it is expected to take.
pub(super) struct Waiting {
    pub(super) job: RenderJob,
    pub(super) expected_ms: f64,
    /// Whether it met a failure of the backend already.
    pub(super) was_retried: bool,
    /// How often it was interrupted.
    interruptions: u32,
    /// Time that it was rendered.
    spent_ms: f64,
    /// The virtual time at which it is finished.
    finish_ms: f64,
    arrival: u64,
}

impl WaitingJobs {
    /// Adds a request.
    pub(super) fn push(&mut self, job: RenderJob, expected_ms: f64) {
        self.arrivals += 1;
        let mut finish_ms = self.virtual_ms + expected_ms;
        if let Some(caller) = &job.caller {
            let (now_ms, before) = (self.virtual_ms, self.finished_ms.get(caller));
            finish_ms = before.map_or(now_ms, |before_ms| before_ms.max(now_ms)) + expected_ms;
            self.finished_ms.insert(Arc::clone(caller), finish_ms);
        }
        let arrival = self.arrivals;
        self.jobs.push(Waiting {
            job,
            expected_ms,
            was_retried: false,
            interruptions: 0,
            spent_ms: 0.0,
            finish_ms,
            arrival,
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
        let ends = self.jobs.iter().map(|waiting| (waiting.finish_ms, waiting.arrival));
        let first = ends.enumerate().min_by(|(_, a), (_, b)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        first.map(|(at, _)| self.jobs.swap_remove(at))
    }

    /// Shares out the time that a request was rendered among those who waited.
    pub(super) fn rendered(&mut self, rendered: &mut Waiting, took: Duration) {
        let took_ms = took.as_secs_f64() * 1e3;
        rendered.spent_ms += took_ms;
        let named: HashSet<&str> =
            self.jobs.iter().filter_map(|waiting| waiting.job.caller.as_deref()).collect();
        let unnamed = self.jobs.iter().filter(|waiting| waiting.job.caller.is_none()).count();
        let callers = 1 + named.len() + unnamed; // the one whose request was rendered, too
        self.virtual_ms += took_ms / callers as f64;
    }

    /// Charges the caller of a request for its time, in place of the expected time.
    pub(super) fn ended(&mut self, ended: &Waiting) {
        let charged_ms = ended.spent_ms.min(MOST_CHARGE * ended.expected_ms);
        let more_ms = charged_ms - ended.expected_ms;
        if let Some(caller) = &ended.job.caller {
            let of_caller =
                self.jobs.iter_mut().filter(|waiting| waiting.job.caller.as_ref() == Some(caller));
            of_caller.for_each(|waiting| waiting.finish_ms += more_ms);
            self.finished_ms.entry(Arc::clone(caller)).and_modify(|finish_ms| *finish_ms += more_ms);
        }
        self.finished_ms.retain(|_, finish_ms| *finish_ms > self.virtual_ms);
    }

    /// Whether a request goes before the rest of the running one.
    pub(super) fn interrupts(&self, running: &Waiting) -> bool {
        let goes_before = |waiting: &Waiting| {
            waiting.expected_ms * MUCH_SHORTER < running.expected_ms
                && waiting.finish_ms < running.finish_ms
                && waiting.job.promise.is_wanted()
        };
        running.interruptions < MOST_INTERRUPTIONS && self.jobs.iter().any(goes_before)
    }

    /// Takes the volumes whose requests are all done.
    pub(super) fn forgettable(&mut self) -> Vec<ContentHash> {
        let oldest = self.jobs.iter().map(|waiting| waiting.arrival).min().unwrap_or(u64::MAX);
        let (done, rest) = self.forgotten.drain(..).partition(|(arrival, _)| *arrival < oldest);
        self.forgotten = rest;
        let done: Vec<(u64, ContentHash)> = done;
        done.into_iter().map(|(_, volume)| volume).collect()
    }

    /// Whether nothing waits.
    pub(super) fn is_empty(&self) -> bool {
        self.jobs.is_empty() && self.forgotten.is_empty()
    }
}
