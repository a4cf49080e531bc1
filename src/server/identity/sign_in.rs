//! Signing in from the pages: a token becomes a cookie that no script can read, and a ticket opens
//! one WebSocket.

use std::sync::Arc;

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use serde::Deserialize;
use serde_json::{Value, json};

use super::admission::unauthorized;
use super::admit::{COOKIE, Door, cookie};
use super::caller::{Caller, Peer};
use super::tickets::{LIFETIME, Tickets};
use crate::guard::{expect_content_type, read_body};
use crate::problem::Problem;
use crate::state::AppState;

/// Time that a browser stays signed in, seconds.
const SIGNED_IN_S: u64 = 12 * 3600;
/// Largest request to sign in.
const MOST_BYTES: usize = 4 << 10;

/// Routes that need no identity.
pub(crate) fn routes() -> Router<AppState> {
    Router::new()
        .route("/v1/identity", get(identity))
        .route("/v1/sign-in", post(sign_in))
        .route("/v1/sign-out", post(sign_out))
}

/// Whether callers must sign in, and the identity of this one.
async fn identity(State(door): State<Door>, request: Request) -> Result<Response, Problem> {
    let admission = &door.config.admission;
    let peer = request.extensions().get::<Peer>();
    let found = if admission.is_open() { None } else { door.identify(request.headers(), peer, true)? };
    let by_cookie = cookie(request.headers()).is_some();
    let body = json!({
        "required": !admission.is_open(),
        "sign_in": admission.tokens.is_some(),
        "name": found.as_ref().map(|identity| identity.name.as_str()),
        "scope": found.as_ref().map(|identity| identity.scope),
        "sign_out": found.is_some() && by_cookie,
    });
    Ok(([(header::CACHE_CONTROL, "no-store")], Json(body)).into_response())
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SignInBody {
    token: String,
}

async fn sign_in(
    State(door): State<Door>,
    peer: Option<axum::Extension<Peer>>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    expect_content_type(&headers, "application/json")?;
    let body = read_body(body, MOST_BYTES, door.config.body_timeout).await?;
    let SignInBody { token } = serde_json::from_slice(&body).map_err(|_| {
        let detail = "the body is not {\"token\": \"...\"}";
        Problem::new(StatusCode::BAD_REQUEST, "malformed-json", detail).with("path", "token")
    })?;
    let Some(tokens) = &door.config.admission.tokens else {
        let detail = "this server has no tokens: start it with --token-file";
        return Err(Problem::new(StatusCode::NOT_FOUND, "no-sign-in", detail));
    };
    let entry = tokens.find(token.trim());
    let entry = entry.ok_or_else(|| unauthorized("the token is unknown or has expired"))?;
    let set = set_cookie(token.trim(), SIGNED_IN_S, peer.is_some_and(|peer| peer.is_encrypted));
    let body = json!({ "name": entry.name, "scope": entry.scope });
    Ok((set, [(header::CACHE_CONTROL, "no-store")], Json(body)).into_response())
}

async fn sign_out(peer: Option<axum::Extension<Peer>>) -> Response {
    let is_encrypted = peer.is_some_and(|peer| peer.is_encrypted);
    (StatusCode::NO_CONTENT, set_cookie("", 0, is_encrypted)).into_response()
}

/// No script reads the cookie, and no other site's page sends it.
fn set_cookie(value: &str, seconds: u64, is_encrypted: bool) -> [(header::HeaderName, HeaderValue); 1] {
    let secure = if is_encrypted { "; Secure" } else { "" };
    let text = format!("{COOKIE}={value}; Path=/; HttpOnly; SameSite=Strict; Max-Age={seconds}{secure}");
    let value = HeaderValue::from_str(&text).unwrap_or(HeaderValue::from_static(""));
    [(header::SET_COOKIE, value)]
}

/// `POST /v1/session/ticket`: a ticket for one WebSocket; 204 where the server is open.
pub(crate) async fn ticket(State(tickets): State<Arc<Tickets>>, caller: Caller) -> Result<Response, Problem> {
    let no_store = [(header::CACHE_CONTROL, "no-store")];
    let Some(identity) = caller.identity else {
        return Ok((StatusCode::NO_CONTENT, no_store).into_response());
    };
    let ticket = tickets.give(identity, LIFETIME)?;
    let body: Json<Value> = Json(json!({ "ticket": ticket, "expires_in_s": LIFETIME.as_secs() }));
    Ok((no_store, body).into_response())
}
