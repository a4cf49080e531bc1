//! Signing in from the pages: a token becomes a cookie that no script can read, and a ticket opens
//! one WebSocket.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Request, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use serde::Deserialize;
use serde_json::{Value, json};

use super::admission::unauthorized;
use super::admit::{COOKIE, Door, cookie};
use super::caller::{Caller, Peer};
use super::tickets::{LIFETIME, Tickets};
use super::token_file::TokenEntry;
use crate::guard::{expect_content_type, read_body};
use crate::problem::Problem;
use crate::state::AppState;

/// Time that a browser stays signed in, seconds.
const SIGNED_IN_S: u64 = 12 * 3600;
/// Largest request to sign in.
const MOST_BYTES: usize = 4 << 10;
/// Longest time for that request to arrive.
const MOST_TIME: Duration = Duration::from_secs(5);

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
    let found = if admission.is_open() { Ok(None) } else { door.identify(request.headers(), peer, true) };
    // An invalid token is 401 on every route. Behind a proxy, this route describes the problem, so that its
    // operator can find it.
    let (found, problem) = match found {
        Err(problem) if admission.proxy.is_none() => return Err(problem),
        Err(problem) => (None, Some(problem.detail().to_owned())),
        Ok(found) => (found, None),
    };
    let by_cookie = cookie(request.headers()).is_some();
    let body = json!({
        "required": !admission.is_open(),
        "sign_in": admission.tokens.is_some(),
        "name": found.as_ref().map(|identity| identity.name.as_str()),
        "scope": found.as_ref().map(|identity| identity.scope),
        "problem": problem,
        "sign_out": found.is_some() && by_cookie,
    });
    Ok(([(header::CACHE_CONTROL, "no-store")], Json(body)).into_response())
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SignInBody {
    token: String,
}

async fn sign_in(State(door): State<Door>, request: Request) -> Response {
    if let Err(problem) = door.expect_audited() {
        return problem.into_response();
    }
    let peer = request.extensions().get::<Peer>();
    let mut caller = Caller { identity: None, address: peer.map(|peer| peer.address.ip()) };
    let is_encrypted = is_encrypted(&request);
    let mut pending = door.record(&caller, &request, "/v1/sign-in");
    let response = match entry_of(&door, &caller, request).await {
        Ok((token, entry)) => {
            let body = json!({ "name": entry.name, "scope": entry.scope });
            caller.identity = Some(entry.into());
            let set = set_cookie(&token, SIGNED_IN_S, is_encrypted);
            (set, [(header::CACHE_CONTROL, "no-store")], Json(body)).into_response()
        }
        Err(problem) => problem.into_response(),
    };
    if let Some(pending) = &mut pending {
        pending.answered_to(caller, response.status().as_u16());
    }
    response
}

/// The token in the body of a request, with its entry in the token file.
async fn entry_of(door: &Door, caller: &Caller, request: Request) -> Result<(String, TokenEntry), Problem> {
    let Some(tokens) = &door.config.admission.tokens else {
        let detail = "this server has no tokens: start it with --token-file";
        return Err(Problem::new(StatusCode::NOT_FOUND, "no-sign-in", detail));
    };
    let _place = door.sign_ins.take(caller).ok_or_else(|| {
        let detail = "too many callers are signing in; try again in a few seconds";
        Problem::new(StatusCode::TOO_MANY_REQUESTS, "too-many-sign-ins", detail)
    })?;
    expect_content_type(request.headers(), "application/json")?;
    let reading = read_body(request.into_body(), MOST_BYTES, door.config.body_timeout);
    let body = tokio::time::timeout(MOST_TIME, reading).await.map_err(|_| {
        let detail = format!("the body did not come within {} s", MOST_TIME.as_secs());
        Problem::new(StatusCode::REQUEST_TIMEOUT, "slow-body", detail)
    })??;
    let SignInBody { token } = serde_json::from_slice(&body).map_err(|_| {
        let detail = "the body is not {\"token\": \"...\"}";
        Problem::new(StatusCode::BAD_REQUEST, "malformed-json", detail).with("path", "token")
    })?;
    let token = token.trim().to_owned();
    let entry = tokens.find(&token).ok_or_else(|| unauthorized("the token is unknown or has expired"))?;
    Ok((token, entry))
}

async fn sign_out(request: Request) -> Response {
    (StatusCode::NO_CONTENT, set_cookie("", 0, is_encrypted(&request))).into_response()
}

/// Whether the browser's connection to this server or to its proxy is encrypted. A client can send a false
/// `X-Forwarded-Proto`; then its own browser does not send the cookie over plain connections.
fn is_encrypted(request: &Request) -> bool {
    let by_proxy = request.headers().get("x-forwarded-proto").is_some_and(|value| value == "https");
    by_proxy || request.extensions().get::<Peer>().is_some_and(|peer| peer.is_encrypted)
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
