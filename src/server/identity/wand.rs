//! `POST /v1/session/wand`: the address of the page that makes a phone a wand for a view, and its QR
//! code. The address has a ticket, where callers are known: it opens one session.

use std::sync::Arc;
use std::time::Duration;

use axum::Json;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::IntoResponse;
use qrcode::{EcLevel, QrCode};
use serde::Deserialize;
use serde_json::json;
use url::{Origin, Url};

use super::caller::Caller;
use super::tickets::Tickets;
use crate::guard::{expect_content_type, read_body};
use crate::problem::{Problem, parse};
use crate::state::Config;

/// The longest time from the code to its scan by a phone.
const LIFETIME: Duration = Duration::from_secs(120);
/// Largest body, bytes.
const MOST_BYTES: usize = 4 << 10;

/// The view that the wand moves, and how phones reach this server.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WandRequest {
    view: String,
    /// Such as `https://ct-server:8443`: the page knows it, a server behind a proxy does not.
    origin: String,
}

pub(crate) async fn wand(
    State(tickets): State<Arc<Tickets>>,
    State(config): State<Arc<Config>>,
    caller: Caller,
    headers: HeaderMap,
    body: Body,
) -> Result<impl IntoResponse, Problem> {
    expect_content_type(&headers, "application/json")?;
    let wanted: WandRequest = parse(&read_body(body, MOST_BYTES, config.body_timeout).await?)?;
    relief_live::check_view_name(&wanted.view)
        .map_err(|error| unusable("view", &error.source.to_string()))?;
    let mut url = page_of(&wanted.origin)?;
    url.query_pairs_mut().append_pair("view", &wanted.view);
    if let Some(identity) = caller.identity {
        url.query_pairs_mut().append_pair("ticket", &tickets.give(identity, LIFETIME)?);
    }
    let code = QrCode::with_error_correction_level(url.as_str(), EcLevel::M);
    let code = code.map_err(|error| Problem::internal("drawing the QR code", error))?;
    let dark = code
        .to_colors()
        .iter()
        .map(|module| if module.select(true, false) { '1' } else { '0' })
        .collect::<Vec<_>>();
    let rows: Vec<String> = dark.chunks(code.width()).map(|row| row.iter().collect()).collect();
    let body = json!({ "url": url.as_str(), "rows": rows, "expires_in_s": LIFETIME.as_secs() });
    Ok(([(header::CACHE_CONTROL, "no-store")], Json(body)))
}

/// The page, at an origin of HTTP.
fn page_of(origin: &str) -> Result<Url, Problem> {
    let allowed = "an origin such as https://ct-server:8443";
    let url = Url::parse(origin).map_err(|_| unusable("origin", allowed))?;
    let is_origin = matches!(url.origin(), Origin::Tuple(..)) && url.origin().ascii_serialization() == origin;
    if !is_origin || !matches!(url.scheme(), "http" | "https") {
        return Err(unusable("origin", allowed));
    }
    url.join("/wand").map_err(|_| unusable("origin", allowed))
}

fn unusable(path: &str, allowed: &str) -> Problem {
    let detail = format!("{path} is not usable; expected {allowed}");
    Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "out-of-range", detail)
        .with("path", path)
        .with("allowed", allowed)
}
