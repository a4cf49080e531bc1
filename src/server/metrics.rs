//! Counters and durations in the Prometheus text format (0.0.4). Labels are closed sets: no ids, no
//! paths.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use relief_render::MemoryUse;
use relief_session::{HostMemory, Origin, Rendered, ServiceCounts, ServiceError};

/// Method, route pattern and status of an answer.
type Answer = (&'static str, String, u16);

/// Everything that is counted.
#[derive(Debug, Default)]
pub(super) struct Metrics {
    answers: Mutex<BTreeMap<Answer, u64>>,
    in_flight: AtomicI64,
    not_modified: AtomicU64,
    outcomes: [AtomicU64; OUTCOMES.len()],
    queue: Histogram,
    render: Histogram,
    pub(super) live: LiveMetrics,
}

/// Counters of live sessions.
#[derive(Debug, Default)]
pub(super) struct LiveMetrics {
    pub(super) sessions: AtomicI64,
    frames: [AtomicU64; 2],
    bytes: AtomicU64,
    dropped_poses: AtomicU64,
    overhead: Histogram,
}

impl LiveMetrics {
    /// A frame is handed to the socket.
    pub(super) fn sent(&self, is_still: bool, bytes: usize) {
        self.frames[usize::from(is_still)].fetch_add(1, Ordering::Relaxed);
        self.bytes.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    /// Server time of a frame of a moving view, without rendering and waiting.
    pub(super) fn overhead(&self, ms: f64) {
        self.overhead.observe(ms);
    }

    /// A pose that no picture showed.
    pub(super) fn pose_dropped(&self) {
        self.dropped_poses.fetch_add(1, Ordering::Relaxed);
    }

    fn write(&self, text: &mut String) {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        head(text, "relief_live_sessions", "gauge", "Live sessions that are connected.");
        line(text, "relief_live_sessions", "", self.sessions.load(Ordering::Relaxed));
        head(text, "relief_live_frames_total", "counter", "Frames sent in live sessions.");
        for (kind, count) in ["moving", "still"].into_iter().zip(&self.frames) {
            line(text, "relief_live_frames_total", &format!("kind=\"{kind}\""), read(count));
        }
        head(text, "relief_live_bytes_total", "counter", "Bytes of those frames.");
        line(text, "relief_live_bytes_total", "", read(&self.bytes));
        head(text, "relief_live_dropped_poses_total", "counter", "Poses that newer ones replaced.");
        line(text, "relief_live_dropped_poses_total", "", read(&self.dropped_poses));
        let help = "From a message to its frame's hand-over, without rendering and waiting, of moving views.";
        self.overhead.write(text, "relief_live_overhead_seconds", help);
    }
}

/// Values that are read when `/metrics` is requested.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gauges {
    pub(super) waiting: usize,
    pub(super) counts: ServiceCounts,
    pub(super) memory: MemoryUse,
    pub(super) host: HostMemory,
    pub(super) volumes: usize,
    pub(super) ready: bool,
    pub(super) uptime: Duration,
}

/// How a render order ended; the index is that of [`Metrics::outcomes`].
const OUTCOMES: [&str; 5] = ["rendered", "reused", "busy", "refused", "failed"];

/// ServiceCounts a request while it is held.
#[derive(Debug)]
pub(super) struct InFlight<'a>(&'a AtomicI64);

impl Drop for InFlight<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Metrics {
    pub(super) fn enter(&self) -> InFlight<'_> {
        self.in_flight.fetch_add(1, Ordering::Relaxed);
        InFlight(&self.in_flight)
    }

    pub(super) fn answered(&self, method: &'static str, route: &str, status: u16) {
        let mut answers = self.answers.lock().unwrap_or_else(PoisonError::into_inner);
        *answers.entry((method, route.to_owned(), status)).or_default() += 1;
    }

    pub(super) fn not_modified(&self) {
        self.not_modified.fetch_add(1, Ordering::Relaxed);
    }

    pub(super) fn rendered(&self, outcome: &Result<Rendered, ServiceError>) {
        let index = match outcome {
            Ok(rendered) => {
                self.queue.observe(rendered.queue_ms);
                if rendered.origin == Origin::Rendered {
                    let timings = rendered.frame.timings;
                    self.render.observe(timings.upload_ms + timings.render_ms + timings.overlay_ms);
                }
                usize::from(rendered.origin == Origin::Reused)
            }
            Err(ServiceError::Busy(_)) => 2,
            Err(ServiceError::Backend(relief_session::BackendError::Refused(_))) => 3,
            Err(_) => 4,
        };
        self.outcomes[index].fetch_add(1, Ordering::Relaxed);
    }

    /// The text that a scraper reads.
    pub(super) fn text(&self, gauges: Gauges) -> String {
        let mut text = String::new();
        head(&mut text, "relief_requests_total", "counter", "HTTP requests answered.");
        for ((method, route, status), count) in
            self.answers.lock().unwrap_or_else(PoisonError::into_inner).iter()
        {
            let labels = format!("method=\"{method}\",route=\"{route}\",status=\"{status}\"");
            line(&mut text, "relief_requests_total", &labels, count);
        }
        head(&mut text, "relief_render_orders_total", "counter", "Render orders by how they ended.");
        for (outcome, count) in OUTCOMES.iter().zip(&self.outcomes) {
            let labels = format!("outcome=\"{outcome}\"");
            line(&mut text, "relief_render_orders_total", &labels, count.load(Ordering::Relaxed));
        }
        head(
            &mut text,
            "relief_render_abandoned_total",
            "counter",
            "Render orders that nobody waited for any more.",
        );
        let ServiceCounts { skipped, cancelled, .. } = gauges.counts;
        for (when, count) in [("waiting", skipped), ("rendering", cancelled)] {
            line(&mut text, "relief_render_abandoned_total", &format!("when=\"{when}\""), count);
        }
        for (name, kind, help, value) in self.values(gauges) {
            head(&mut text, name, kind, help);
            line(&mut text, name, "", value);
        }
        self.queue.write(&mut text, "relief_render_queue_seconds", "Time that orders waited.");
        self.render.write(&mut text, "relief_render_seconds", "Time of upload and rendering.");
        self.live.write(&mut text);
        text
    }

    /// Metrics with one value: name, kind, help, value.
    fn values(&self, gauges: Gauges) -> Vec<(&'static str, &'static str, &'static str, f64)> {
        let not_modified = self.not_modified.load(Ordering::Relaxed) as f64;
        let in_flight = self.in_flight.load(Ordering::Relaxed) as f64;
        let ready = f64::from(u8::from(gauges.ready));
        let MemoryUse { volumes, used_bytes, limit_bytes, uploads, evictions } = gauges.memory;
        let counter = |name, help, value: f64| (name, "counter", help, value);
        let gauge = |name, help, value: f64| (name, "gauge", help, value);
        vec![
            counter("relief_not_modified_total", "Frames answered by their tag, not rendered.", not_modified),
            counter("relief_render_bands_total", "Bands of pictures rendered.", gauges.counts.bands as f64),
            gauge("relief_requests_in_flight", "HTTP requests being answered.", in_flight),
            gauge("relief_render_queue_length", "Render orders that wait.", gauges.waiting as f64),
            gauge("relief_volumes", "Volumes in memory.", gauges.volumes as f64),
            gauge("relief_gpu_volumes", "Volumes in graphics memory.", volumes as f64),
            gauge("relief_gpu_memory_bytes", "Graphics memory that volumes take.", used_bytes as f64),
            gauge(
                "relief_gpu_memory_limit_bytes",
                "Graphics memory that volumes may take.",
                limit_bytes as f64,
            ),
            counter("relief_gpu_uploads_total", "Volumes that went into graphics memory.", uploads as f64),
            counter("relief_gpu_evictions_total", "Volumes that left it for others.", evictions as f64),
            gauge("relief_memory_bytes", "Memory that voxels take.", gauges.host.used_bytes as f64),
            gauge(
                "relief_memory_limit_bytes",
                "Memory that voxels may take.",
                gauges.host.limit_bytes as f64,
            ),
            counter(
                "relief_memory_evictions_total",
                "Series that left memory.",
                gauges.host.evictions as f64,
            ),
            counter("relief_series_reads_total", "Series that were read again.", gauges.host.reads as f64),
            gauge("relief_ready", "1 when frames can be rendered.", ready),
            gauge("relief_uptime_seconds", "Time since the start.", gauges.uptime.as_secs_f64()),
        ]
    }
}

/// Upper bounds of the buckets, seconds.
const BOUNDS: [f64; 13] = [0.001, 0.002, 0.005, 0.01, 0.015, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0];

/// Durations in buckets.
#[derive(Debug, Default)]
struct Histogram {
    buckets: [AtomicU64; BOUNDS.len()],
    count: AtomicU64,
    sum_us: AtomicU64,
}

impl Histogram {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "durations of a render in µs"
    )]
    fn observe(&self, ms: f64) {
        for (bucket, bound) in self.buckets.iter().zip(BOUNDS) {
            bucket.fetch_add(u64::from(ms <= bound * 1e3), Ordering::Relaxed);
        }
        self.sum_us.fetch_add((ms * 1e3) as u64, Ordering::Relaxed);
        self.count.fetch_add(1, Ordering::Relaxed);
    }

    fn write(&self, text: &mut String, name: &str, help: &str) {
        head(text, name, "histogram", help);
        let count = self.count.load(Ordering::Relaxed);
        for (bucket, bound) in self.buckets.iter().zip(BOUNDS) {
            line(text, &format!("{name}_bucket"), &format!("le=\"{bound}\""), bucket.load(Ordering::Relaxed));
        }
        line(text, &format!("{name}_bucket"), "le=\"+Inf\"", count);
        line(text, &format!("{name}_sum"), "", self.sum_us.load(Ordering::Relaxed) as f64 / 1e6);
        line(text, &format!("{name}_count"), "", count);
    }
}

fn head(text: &mut String, name: &str, kind: &str, help: &str) {
    let _ = write!(text, "# HELP {name} {help}\n# TYPE {name} {kind}\n"); // writing to a String cannot fail
}

fn line(text: &mut String, name: &str, labels: &str, value: impl std::fmt::Display) {
    let braced = if labels.is_empty() { String::new() } else { format!("{{{labels}}}") };
    let _ = writeln!(text, "{name}{braced} {value}");
}
