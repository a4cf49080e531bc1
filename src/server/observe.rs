//! One line of log and a few counters per request, and the id that ties a client's complaint to
//! them.
//!
//! Log lines have the pattern of the route, not the path or the query, so they do not reveal which
//! volume was requested.

use std::hash::{BuildHasher, RandomState};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock};
use std::time::Instant;

use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method};
use axum::middleware::Next;
use axum::response::Response;
use tracing::Instrument;

use super::metrics::Metrics;
use super::problem::Cause;
use super::state::{Config, TraceHeaders};

static REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

pub(super) async fn observe(
    State(metrics): State<Arc<Metrics>>,
    State(config): State<Arc<Config>>,
    request: Request,
    next: Next,
) -> Response {
    let id = request_id(request.headers().get(&REQUEST_ID));
    let route =
        request.extensions().get::<MatchedPath>().map_or("unmatched", |path| path.as_str()).to_owned();
    let method = method_label(request.method());
    let since = Instant::now();
    let in_flight = metrics.enter();
    let span = tracing::info_span!("request", id = %id.to_str().unwrap_or(""), method, route);
    if let (Some(join), Some(headers)) = (config.join_trace, trace_headers(request.headers())) {
        join(&span, headers);
    }
    let mut response = next.run(request).instrument(span.clone()).await;
    drop(in_flight);
    let status = response.status().as_u16();
    metrics.answered(method, &route, status);
    span.in_scope(|| {
        let ms = since.elapsed().as_secs_f64() * 1e3;
        match response.extensions().get::<Cause>() {
            Some(Cause(cause)) => tracing::error!(status, ms, cause, "failed"),
            None => tracing::debug!(status, ms, "answered"),
        }
    });
    response.headers_mut().insert(&REQUEST_ID, id);
    response
}

/// The headers of the caller's trace, if they are text.
fn trace_headers(headers: &HeaderMap) -> Option<TraceHeaders<'_>> {
    let text = |name: &str| headers.get(name)?.to_str().ok();
    Some(TraceHeaders { parent: text("traceparent")?, state: text("tracestate") })
}

/// The client's own id when it is one that a log line can hold, else a new one.
fn request_id(given: Option<&HeaderValue>) -> HeaderValue {
    let usable = |id: &&HeaderValue| {
        let bytes = id.as_bytes();
        let plain = |byte: &u8| byte.is_ascii_alphanumeric() || b"-_.".contains(byte);
        (1..=64).contains(&bytes.len()) && bytes.iter().all(plain)
    };
    given.filter(usable).cloned().unwrap_or_else(new_id)
}

/// Unique within a process by its count, and among processes by a random start.
fn new_id() -> HeaderValue {
    static PROCESS: LazyLock<u64> = LazyLock::new(|| RandomState::new().hash_one("relief"));
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let text = format!("{:08x}-{}", *PROCESS & 0xffff_ffff, COUNT.fetch_add(1, Ordering::Relaxed));
    HeaderValue::from_str(&text).unwrap_or(HeaderValue::from_static("none"))
}

/// Methods as labels: a closed set, whatever clients send.
fn method_label(method: &Method) -> &'static str {
    match *method {
        Method::GET => "GET",
        Method::HEAD => "HEAD",
        Method::POST => "POST",
        Method::DELETE => "DELETE",
        _ => "other",
    }
}
