//! Checks before the handlers: who may ask, how long an answer may take, how much a request may
//! send.
//!
//! There is no CORS: pages of other sites can neither read nor embed answers. Requests with host
//! names that a page could resolve to a loopback address are refused by `Host`, cross-site writes
//! by `Origin`.

use std::any::Any;
use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::body::{Body, Bytes};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, Uri, header, uri::Authority};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use http_body_util::BodyExt;

use super::annotations::decoded;
use super::problem::Problem;
use super::state::Config;

/// Lowest mean rate of a body that is read into memory, after an initial
/// [`body_timeout`](Config::body_timeout).
const SLOWEST_BYTES_PER_S: u64 = 8 << 10;

/// Refuses requests under a foreign name, and writes that come from another site's page.
pub(super) async fn same_site(State(config): State<Arc<Config>>, request: Request, next: Next) -> Response {
    // This check and a proxy might read different ones (RFC 9112 3.2).
    if request.headers().get_all(header::HOST).iter().nth(1).is_some() {
        let detail = "the request has several Host headers";
        return Problem::new(StatusCode::BAD_REQUEST, "malformed-host", detail).into_response();
    }
    let named = authority(request.headers().get(header::HOST)).or_else(|| request.uri().authority().cloned());
    if let Some(allowed) = &config.allowed_hosts {
        let known = named.as_ref().is_some_and(|name| allowed.accept(name.host()));
        if !known {
            let detail = "this server does not answer to the name in Host; start it with --allow-host NAME if it should";
            return Problem::new(StatusCode::MISDIRECTED_REQUEST, "unknown-host", detail).into_response();
        }
    }
    if !request.method().is_safe() && is_cross_site(request.headers(), request.uri()) {
        let detail = "writes from pages of another site are refused";
        return Problem::new(StatusCode::FORBIDDEN, "cross-site", detail).into_response();
    }
    next.run(request).await
}

/// Refuses a path that is not UTF-8 once it is decoded, with a problem document as for any other
/// malformed request.
pub(super) async fn readable_path(request: Request, next: Next) -> Response {
    if decoded(request.uri().path()).is_none() {
        let detail = "the path is not percent-encoded UTF-8";
        return Problem::new(StatusCode::BAD_REQUEST, "malformed-path", detail)
            .with("path", "path")
            .into_response();
    }
    next.run(request).await
}

/// Whether a page of another site sends this. Programs, which send no `Origin`, are no page.
pub(super) fn is_cross_site(headers: &HeaderMap, uri: &Uri) -> bool {
    let Some(origin) = headers.get(header::ORIGIN) else { return false };
    let named = authority(headers.get(header::HOST)).or_else(|| uri.authority().cloned());
    let site = origin.to_str().ok().and_then(|origin| origin.split_once("://")).map(|(_, site)| site);
    site.is_none() || site != named.as_ref().map(Authority::as_str)
}

fn authority(host: Option<&HeaderValue>) -> Option<Authority> {
    host?.to_str().ok()?.parse().ok()
}

/// Ends a request that takes too long. Its order leaves the render queue with it. That is no 503:
/// the same order would take as long again.
pub(super) async fn deadline(State(config): State<Arc<Config>>, request: Request, next: Next) -> Response {
    let limit = config.request_timeout;
    match tokio::time::timeout(limit, next.run(request)).await {
        Ok(response) => response,
        Err(_) => {
            let detail = format!("no answer within {} s", limit.as_secs_f64());
            Problem::new(StatusCode::GATEWAY_TIMEOUT, "timeout", detail).into_response()
        }
    }
}

/// Headers that keep browsers from guessing types, embedding and leaking addresses.
pub(super) async fn harden(request: Request, next: Next) -> Response {
    const POLICY: &str = "default-src 'none'; frame-ancestors 'none'";
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    headers.entry(header::CONTENT_SECURITY_POLICY).or_insert(HeaderValue::from_static(POLICY));
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    let corp = HeaderName::from_static("cross-origin-resource-policy");
    headers.insert(corp, HeaderValue::from_static("same-origin"));
    response
}

/// A handler that panicked is a bug here, and one failed request for its client.
#[expect(clippy::needless_pass_by_value, reason = "the signature is tower-http's")]
pub(super) fn on_panic(panic: Box<dyn Any + Send>) -> Response {
    let text = panic.downcast_ref::<&str>().copied();
    let text = text.or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    Problem::internal("the request", format!("panic: {}", text.unwrap_or("no message"))).into_response()
}

/// Refuses a body of another media type. A page of another site cannot send these without being
/// asked first.
pub(super) fn expect_content_type(headers: &HeaderMap, expected: &'static str) -> Result<(), Problem> {
    let found = headers.get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok()).unwrap_or("");
    let essence = found.split(';').next().unwrap_or("").trim();
    if essence.eq_ignore_ascii_case(expected) {
        return Ok(());
    }
    let detail = format!("Content-Type is {essence:?}, allowed: {expected}");
    Err(Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "unsupported-media-type", detail)
        .with("allowed", expected))
}

/// The time limit of a body: a fixed time, plus the time for the received bytes at the lowest mean rate. So
/// a client that sends single bytes does not occupy a place for long.
pub(super) struct BodyTime {
    since: Instant,
    patience: Duration,
    slowest_bytes_per_s: u64,
}

impl BodyTime {
    /// Begins now.
    pub(super) fn new(patience: Duration, slowest_bytes_per_s: u64) -> Self {
        Self { since: Instant::now(), patience, slowest_bytes_per_s: slowest_bytes_per_s.max(1) }
    }

    /// The next part of a body; `None` at its end. `received` is the number of bytes before it.
    ///
    /// # Errors
    /// 408 when it comes too slowly, 400 when it is broken.
    pub(super) async fn next(&self, body: &mut Body, received: u64) -> Result<Option<Bytes>, Problem> {
        let allowed = Duration::from_secs_f64(received as f64 / self.slowest_bytes_per_s as f64);
        let left = (self.patience + allowed).saturating_sub(self.since.elapsed());
        if left.is_zero() {
            let detail = format!("the body comes slower than {} bytes per second", self.slowest_bytes_per_s);
            return Err(Problem::new(StatusCode::REQUEST_TIMEOUT, "slow-body", detail));
        }
        next_part(body, left.min(self.patience)).await
    }
}

/// The whole body.
///
/// # Errors
/// 413 when it is larger than the limit, 408 when it comes too slowly.
pub(super) async fn read_body(mut body: Body, limit: usize, patience: Duration) -> Result<Vec<u8>, Problem> {
    let (time, mut whole) = (BodyTime::new(patience, SLOWEST_BYTES_PER_S), Vec::new());
    while let Some(part) = time.next(&mut body, whole.len() as u64).await? {
        if whole.len() + part.len() > limit {
            return Err(too_large(limit as u64));
        }
        whole.extend_from_slice(&part);
    }
    Ok(whole)
}

/// The next part of a body; `None` at its end.
async fn next_part(body: &mut Body, patience: Duration) -> Result<Option<Bytes>, Problem> {
    loop {
        let frame = tokio::time::timeout(patience, body.frame()).await.map_err(|_| {
            let detail = format!("nothing more of the body came within {} s", patience.as_secs_f64());
            Problem::new(StatusCode::REQUEST_TIMEOUT, "slow-body", detail)
        })?;
        match frame {
            None => return Ok(None),
            Some(Err(_)) => {
                let detail = "the body could not be read to its end";
                return Err(Problem::new(StatusCode::BAD_REQUEST, "broken-body", detail));
            }
            // Trailers carry nothing that is needed here.
            Some(Ok(frame)) => match frame.into_data() {
                Ok(part) => return Ok(Some(part)),
                Err(_trailers) => {}
            },
        }
    }
}

pub(super) fn too_large(limit: u64) -> Problem {
    let detail = format!("the body is larger than the limit of {limit} bytes");
    Problem::new(StatusCode::PAYLOAD_TOO_LARGE, "too-large", detail).with("limit_bytes", limit)
}
