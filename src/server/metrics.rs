//! Counters, gauges and durations in the OpenMetrics text format. Labels are closed sets: no ids,
//! no paths.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::{Metric, Registry};

use relief_render::MemoryUse;
use relief_session::{BackendError, HostMemory, Origin, Rendered, ServiceCounts, ServiceError};

/// The media type of [`Metrics::text`].
pub(super) const MEDIA_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// Upper bounds of the buckets of durations, seconds.
const BOUNDS: [f64; 13] = [0.001, 0.002, 0.005, 0.01, 0.015, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0];

/// Method, route pattern and status of a response.
#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct ResponseLabels {
    method: &'static str,
    route: String,
    status: u32,
}

/// How a render order ended: `rendered`, `reused`, `busy`, `refused` or `failed`.
#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct OutcomeLabels {
    outcome: &'static str,
}

/// When a render order was abandoned: `waiting` or `rendering`.
#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct AbandonedLabels {
    when: &'static str,
}

/// `moving` or `still` frames.
#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct FrameLabels {
    kind: &'static str,
}

/// All metrics of a server.
#[derive(Debug)]
pub(super) struct Metrics {
    registry: Registry,
    responses: Family<ResponseLabels, Counter>,
    in_flight: Gauge,
    not_modified: Counter,
    outcomes: Family<OutcomeLabels, Counter>,
    queue: Histogram,
    render: Histogram,
    sampled: Sampled,
    pub(super) live: LiveMetrics,
}

/// Metrics of live sessions.
#[derive(Debug)]
pub(super) struct LiveMetrics {
    sessions: Gauge,
    frames: Family<FrameLabels, Counter>,
    bytes: Counter,
    dropped_poses: Counter,
    overhead: Histogram,
}

/// Metrics whose values other parts of the server keep. They are copied when `/metrics` is
/// requested.
#[derive(Debug)]
struct Sampled {
    abandoned: Family<AbandonedLabels, Counter>,
    bands: Counter,
    queue_length: Gauge,
    volumes: Gauge,
    gpu_volumes: Gauge,
    gpu_bytes: Gauge,
    gpu_limit_bytes: Gauge,
    gpu_uploads: Counter,
    gpu_evictions: Counter,
    host_bytes: Gauge,
    host_limit_bytes: Gauge,
    host_evictions: Counter,
    series_reads: Counter,
    ready: Gauge,
    uptime: Gauge<f64, AtomicU64>,
}

/// The values of [`Sampled`].
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

/// Counts one request, or one session, while it is held.
#[derive(Debug)]
pub(super) struct Counted(Gauge);

impl Counted {
    fn new(gauge: &Gauge) -> Self {
        gauge.inc();
        Self(gauge.clone())
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        self.0.dec();
    }
}

/// Registers a metric. The text format adds a full stop to `help`, and `_total` to a counter's
/// name.
fn registered<M: Metric + Clone>(registry: &mut Registry, name: &str, help: &str, metric: M) -> M {
    registry.register(name, help, metric.clone());
    metric
}

fn counter(registry: &mut Registry, name: &str, help: &str) -> Counter {
    registered(registry, name, help, Counter::default())
}

fn gauge(registry: &mut Registry, name: &str, help: &str) -> Gauge {
    registered(registry, name, help, Gauge::default())
}

fn durations(registry: &mut Registry, name: &str, help: &str) -> Histogram {
    registered(registry, name, help, Histogram::new(BOUNDS))
}

impl Default for Metrics {
    fn default() -> Self {
        let mut registry = Registry::default();
        let r = &mut registry;
        let responses = registered(r, "relief_requests", "HTTP requests answered", Family::default());
        let in_flight = gauge(r, "relief_requests_in_flight", "HTTP requests being answered");
        let not_modified = counter(r, "relief_not_modified", "Frames answered by their tag, not rendered");
        let outcomes = registered(r, "relief_render_orders", "Render orders by outcome", Family::default());
        let queue = durations(r, "relief_render_queue_seconds", "Time that orders waited");
        let render = durations(r, "relief_render_seconds", "Time of upload and rendering");
        let (sampled, live) = (Sampled::new(r), LiveMetrics::new(r));
        Self { registry, responses, in_flight, not_modified, outcomes, queue, render, sampled, live }
    }
}

impl Metrics {
    /// Counts a request as being answered, until the value is dropped.
    pub(super) fn enter(&self) -> Counted {
        Counted::new(&self.in_flight)
    }

    pub(super) fn answered(&self, method: &'static str, route: &str, status: u16) {
        let labels = ResponseLabels { method, route: route.to_owned(), status: status.into() };
        self.responses.get_or_create(&labels).inc();
    }

    pub(super) fn not_modified(&self) {
        self.not_modified.inc();
    }

    pub(super) fn rendered(&self, outcome: &Result<Rendered, ServiceError>) {
        let outcome = match outcome {
            Ok(rendered) => {
                self.queue.observe(rendered.queue_ms / 1e3);
                if rendered.origin == Origin::Rendered {
                    let timings = rendered.frame.timings;
                    let ms = timings.upload_ms + timings.render_ms + timings.overlay_ms;
                    self.render.observe(ms / 1e3);
                }
                if rendered.origin == Origin::Reused { "reused" } else { "rendered" }
            }
            Err(ServiceError::Busy(_)) => "busy",
            Err(ServiceError::Backend(BackendError::Refused(_))) => "refused",
            Err(_) => "failed",
        };
        self.outcomes.get_or_create(&OutcomeLabels { outcome }).inc();
    }

    /// The text that a scraper reads.
    pub(super) fn text(&self, gauges: Gauges) -> Result<String, std::fmt::Error> {
        self.sampled.set(gauges);
        let mut text = String::new();
        encode(&mut text, &self.registry)?;
        Ok(text)
    }
}

impl LiveMetrics {
    fn new(r: &mut Registry) -> Self {
        Self {
            sessions: gauge(r, "relief_live_sessions", "Connected live sessions"),
            frames: registered(r, "relief_live_frames", "Frames sent in live sessions", Family::default()),
            bytes: counter(r, "relief_live_bytes", "Bytes of those frames"),
            dropped_poses: counter(r, "relief_live_dropped_poses", "Poses that newer ones replaced"),
            overhead: durations(
                r,
                "relief_live_overhead_seconds",
                "Time from a message to its frame's hand-over in moving views, without rendering and waiting",
            ),
        }
    }

    /// Counts a session as connected, until the value is dropped.
    pub(super) fn connected(&self) -> Counted {
        Counted::new(&self.sessions)
    }

    /// A frame is handed to the socket.
    pub(super) fn sent(&self, is_still: bool, bytes: usize) {
        let kind = if is_still { "still" } else { "moving" };
        self.frames.get_or_create(&FrameLabels { kind }).inc();
        self.bytes.inc_by(bytes as u64);
    }

    /// Server time of a frame of a moving view, without rendering and waiting.
    pub(super) fn overhead(&self, ms: f64) {
        self.overhead.observe(ms / 1e3);
    }

    /// A pose that no picture showed.
    pub(super) fn pose_dropped(&self) {
        self.dropped_poses.inc();
    }
}

impl Sampled {
    fn new(r: &mut Registry) -> Self {
        Self {
            abandoned: registered(
                r,
                "relief_render_abandoned",
                "Render orders whose clients left",
                Family::default(),
            ),
            bands: counter(r, "relief_render_bands", "Bands of pictures rendered"),
            queue_length: gauge(r, "relief_render_queue_length", "Waiting render orders"),
            volumes: gauge(r, "relief_volumes", "Volumes in memory"),
            gpu_volumes: gauge(r, "relief_gpu_volumes", "Volumes in graphics memory"),
            gpu_bytes: gauge(r, "relief_gpu_memory_bytes", "Graphics memory of volumes"),
            gpu_limit_bytes: gauge(r, "relief_gpu_memory_limit_bytes", "Limit of graphics memory of volumes"),
            gpu_uploads: counter(r, "relief_gpu_uploads", "Volumes uploaded to graphics memory"),
            gpu_evictions: counter(r, "relief_gpu_evictions", "Volumes evicted from graphics memory"),
            host_bytes: gauge(r, "relief_memory_bytes", "Memory of voxels"),
            host_limit_bytes: gauge(r, "relief_memory_limit_bytes", "Limit of the memory of voxels"),
            host_evictions: counter(r, "relief_memory_evictions", "Series evicted from memory"),
            series_reads: counter(r, "relief_series_reads", "Series read again"),
            ready: gauge(r, "relief_ready", "1 when frames can be rendered"),
            uptime: registered(r, "relief_uptime_seconds", "Time since the start", Gauge::default()),
        }
    }

    fn set(&self, gauges: Gauges) {
        let ServiceCounts { skipped, cancelled, bands, .. } = gauges.counts;
        let MemoryUse { volumes, used_bytes, limit_bytes, uploads, evictions } = gauges.memory;
        for (when, count) in [("waiting", skipped), ("rendering", cancelled)] {
            copy(&self.abandoned.get_or_create(&AbandonedLabels { when }), count);
        }
        for (counter, count) in [
            (&self.bands, bands),
            (&self.gpu_uploads, uploads),
            (&self.gpu_evictions, evictions),
            (&self.host_evictions, gauges.host.evictions),
            (&self.series_reads, gauges.host.reads),
        ] {
            copy(counter, count);
        }
        for (gauge, value) in [
            (&self.queue_length, gauges.waiting as u64),
            (&self.volumes, gauges.volumes as u64),
            (&self.gpu_volumes, volumes as u64),
            (&self.gpu_bytes, used_bytes),
            (&self.gpu_limit_bytes, limit_bytes),
            (&self.host_bytes, gauges.host.used_bytes),
            (&self.host_limit_bytes, gauges.host.limit_bytes),
            (&self.ready, u64::from(gauges.ready)),
        ] {
            gauge.set(value.try_into().unwrap_or(i64::MAX));
        }
        self.uptime.set(gauges.uptime.as_secs_f64());
    }
}

/// Sets a counter to a count that is kept elsewhere.
fn copy(counter: &Counter, count: u64) {
    counter.inner().store(count, Ordering::Relaxed);
}
