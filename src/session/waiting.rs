//! The requests that wait for the render thread, and which of them is next.
//!
//! Weighted fair queueing (Demers, Keshav and Shenker, SIGCOMM 1989) with equal weights: the next
//! request is the one that would be finished first if all callers were served at once, each with an
//! equal share of the thread. So a small picture does not wait for large ones of others, a caller
//! of many pictures delays its own first, and each request has its turn in the end. A request
//! without a caller counts as a caller of its own. Requests that would be finished at the same time
//! keep their order. Times in ms.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::cache::FrameKey;
use super::ticket::TicketSender;
use relief_volume::{ContentHash, Volume};

/// A request interrupts a running one only if it is this much shorter.
const MUCH_SHORTER: f64 = 8.0;

/// Most interruptions of a picture: the other picture may replace its prepared illumination.
const MOST_INTERRUPTIONS: u32 = 64;

/// The time for which the thread counts as shared after requests of two callers.
const SHARED_FOR: Duration = Duration::from_secs(2);

/// A request is charged at most this many times its expected time: it may have compiled a shader or
/// uploaded a volume, for all callers.
const MOST_CHARGE: f64 = 4.0;

/// A request for the thread.
pub(super) struct RenderJob {
    pub(super) volume: Volume,
    pub(super) key: FrameKey,
    pub(super) promise: TicketSender,
    /// The caller; requests without one have a share each.
    pub(super) caller: Option<Arc<str>>,
    pub(super) since: Instant,
    /// The request that waits for it.
    pub(super) span: tracing::Span,
}

/// Requests, and volumes to be forgotten when the requests before are done.
#[derive(Default)]
pub(super) struct WaitingJobs {
    jobs: Vec<Waiting>,
    forgotten: Vec<(u64, ContentHash)>,
    arrivals: u64,
    /// Virtual time: the rendering time of a caller who has had a request waiting from the start.
    virtual_ms: f64,
    /// The virtual times at which the requests of callers are finished.
    finished_ms: HashMap<Arc<str>, f64>,
    /// The caller of the latest request, and when a request last came from another one than before.
    latest: Option<Arc<str>>,
    changed: Option<Instant>,
}

/// A request and its expected time.
pub(super) struct Waiting {
    pub(super) job: RenderJob,
    pub(super) expected_ms: f64,
    /// Whether it met a failure of the backend already.
    pub(super) was_retried: bool,
    /// The number of its interruptions.
    interruptions: u32,
    /// Time that it was rendered.
    spent_ms: f64,
    /// The virtual time of its end.
    finish_ms: f64,
    arrival: u64,
}

impl WaitingJobs {
    /// Adds a request.
    pub(super) fn push(&mut self, job: RenderJob, expected_ms: f64) {
        self.arrivals += 1;
        if self.latest != job.caller {
            self.changed = self.latest.is_some().then(Instant::now);
            self.latest.clone_from(&job.caller);
        }
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

    /// Whether several callers sent requests in the last seconds.
    pub(super) fn is_shared(&self) -> bool {
        self.changed.is_some_and(|at| at.elapsed() < SHARED_FOR)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ticket::{Ticket, pair};
    use relief_render::SceneFile;
    use relief_volume::{Grid, Orbit};

    /// A queue, and the tickets that keep its requests wanted.
    struct Bench {
        volume: Volume,
        waiting: WaitingJobs,
        tickets: Vec<Ticket>,
    }

    impl Bench {
        fn new() -> Self {
            let grid = Grid::axis_aligned([2; 3], [1.0; 3], [0.0; 3]).unwrap();
            let volume = Volume::new(grid, vec![0; 8]).unwrap();
            Self { volume, waiting: WaitingJobs::default(), tickets: Vec::new() }
        }

        fn push(&mut self, caller: Option<&str>, expected_ms: f64) {
            let scene = SceneFile::default().resolve(self.volume.grid(), &Orbit::default()).unwrap();
            let key = FrameKey { volume: self.volume.content_hash(), request: scene.request };
            let (ticket, promise) = pair();
            self.tickets.push(ticket);
            let (caller, span) = (caller.map(Into::into), tracing::Span::none());
            let job =
                RenderJob { volume: self.volume.clone(), key, promise, caller, since: Instant::now(), span };
            self.waiting.push(job, expected_ms);
        }

        /// Renders the next request, for the expected time or the given one, and returns its caller.
        fn next(&mut self, took_ms: Option<f64>) -> String {
            let mut next = self.waiting.pop().unwrap();
            let took_ms = took_ms.unwrap_or(next.expected_ms);
            self.waiting.rendered(&mut next, Duration::from_secs_f64(took_ms * 1e-3));
            self.waiting.ended(&next);
            next.job.caller.as_deref().unwrap_or("nobody").to_owned()
        }
    }

    /// Invariant: Callers that wait have equal shares of the render thread, however much each asks for.
    #[test]
    fn callers_take_turns() {
        let mut bench = Bench::new();
        (0..4).for_each(|_| bench.push(Some("greedy"), 10.0));
        (0..2).for_each(|_| bench.push(Some("modest"), 10.0));
        let order: Vec<String> = (0..6).map(|_| bench.next(None)).collect();
        assert_eq!(order, ["greedy", "modest", "greedy", "modest", "greedy", "greedy"]);
    }

    #[test]
    fn a_small_picture_does_not_wait_for_large_ones_that_came_long_before() {
        let mut bench = Bench::new();
        ["a", "b", "c", "d"].into_iter().for_each(|caller| bench.push(Some(caller), 300.0));
        assert_eq!([bench.next(None), bench.next(None)], ["a", "b"]);
        bench.push(None, 3.0);
        assert_eq!([bench.next(None), bench.next(None)], ["nobody", "c"]);
        assert_eq!(bench.next(None), "d");
        // A caller who asks for small ones all the time lets a large one through.
        bench.push(Some("e"), 300.0);
        let small = (0..1000).take_while(|_| {
            bench.push(Some("stream"), 3.0);
            bench.next(None) == "stream"
        });
        assert!((50..150).contains(&small.count()), "the large one has its share");
    }

    #[test]
    fn callers_are_charged_for_the_time_that_pictures_took() {
        // An estimate that is far too long does not delay the caller's later requests.
        let mut bench = Bench::new();
        bench.push(Some("unlucky"), 500.0);
        bench.next(Some(2.0));
        bench.push(Some("other"), 3.0);
        bench.push(Some("unlucky"), 3.0);
        bench.push(Some("other"), 3.0);
        let order: Vec<String> = (0..3).map(|_| bench.next(None)).collect();
        assert_eq!(order, ["other", "unlucky", "other"]);
        // One that is too short does, because its pictures cost more than expected.
        let mut bench = Bench::new();
        (0..3).for_each(|_| bench.push(Some("costly"), 1.0));
        (0..3).for_each(|_| bench.push(Some("honest"), 1.5));
        let order: Vec<String> = (0..2).map(|_| bench.next(Some(4.0))).collect();
        assert_eq!(order, ["costly", "honest"]);
        // A picture that compiled a shader costs its caller a few times the estimate.
        let mut bench = Bench::new();
        bench.push(Some("first"), 2.0);
        bench.push(Some("second"), 2.5);
        bench.next(Some(5000.0));
        bench.push(Some("first"), 2.0);
        (0..9).for_each(|_| bench.push(Some("second"), 2.5));
        let order: Vec<String> = (0..10).map(|_| bench.next(None)).collect();
        assert!(order[..6].iter().any(|caller| caller == "first"), "{order:?}");
    }

    #[test]
    fn a_large_picture_is_interrupted_by_much_smaller_ones_before_its_turn() {
        let mut bench = Bench::new();
        bench.push(Some("a"), 300.0);
        let running = bench.waiting.pop().unwrap();
        assert!(!bench.waiting.interrupts(&running), "nothing waits");
        assert!(!bench.waiting.is_shared());
        bench.push(Some("b"), 100.0);
        assert!(bench.waiting.is_shared());
        assert!(!bench.waiting.interrupts(&running), "not much smaller");
        bench.push(Some("c"), 3.0);
        assert!(bench.waiting.interrupts(&running));
        bench.tickets.pop();
        assert!(!bench.waiting.interrupts(&running), "its client left");
    }
}
