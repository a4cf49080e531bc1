//! The layers that let requests pass, refuse them, or lead a browser to the sign-in page.

use std::sync::Arc;

use axum::extract::{FromRef, MatchedPath, Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::admission::unauthorized;
use super::caller::{Caller, Identity, Peer};
use super::scope::Scope;
use super::sign_ins::SignIns;
use super::tickets::Tickets;
use crate::annotations::{author_of, set_author};
use crate::audit::{AuditLog, PendingRecord, Subject};
use crate::problem::Problem;
use crate::shares::Shares;
use crate::state::{AppState, Config};

/// The name of the cookie of a browser that is signed in. Its value is the token: every server of a
/// cluster recognises it, and none accepts it once the token is removed.
pub(super) const COOKIE: &str = "relief_sign_in";
/// The route of live sessions. Browsers send cookies with any WebSocket, from any page,
/// so here a cookie is no proof: pages redeem a ticket.
const SESSION: &str = "/v1/session";

/// The parts that admit requests.
#[derive(Clone)]
pub(crate) struct Door {
    pub(super) config: Arc<Config>,
    tickets: Arc<Tickets>,
    requests: Arc<Shares>,
    audit: Option<Arc<AuditLog>>,
    pub(super) sign_ins: Arc<SignIns>,
}

impl FromRef<AppState> for Door {
    fn from_ref(AppState(server): &AppState) -> Self {
        Self {
            config: Arc::clone(&server.config),
            tickets: Arc::clone(&server.tickets),
            requests: Arc::clone(&server.requests),
            audit: server.audit.clone(),
            sign_ins: Arc::clone(&server.sign_ins),
        }
    }
}

impl Door {
    /// The identity of a request: by itself, or by the cookie of a browser.
    ///
    /// # Errors
    /// 401 when a token is given that is not valid.
    pub(super) fn identify(
        &self,
        headers: &HeaderMap,
        peer: Option<&Peer>,
        by_cookie: bool,
    ) -> Result<Option<Identity>, Problem> {
        let admission = &self.config.admission;
        let found = admission.identify(headers, peer)?;
        Ok(found.or_else(|| admission.identify_token(cookie(headers).filter(|_| by_cookie)?)))
    }

    /// Refuses a request that the audit log could not record.
    pub(super) fn expect_audited(&self) -> Result<(), Problem> {
        match &self.audit {
            Some(log) if !log.is_kept() => {
                log.count_refused();
                Err(Problem::unavailable("audit-failed", "the audit log cannot be written"))
            }
            _ => Ok(()),
        }
    }

    /// Begins the record of a request.
    pub(super) fn record(&self, caller: &Caller, request: &Request, route: &str) -> Option<PendingRecord> {
        let log = self.audit.clone()?;
        Some(log.begin(caller.clone(), Subject::of(request.method(), route, request.uri())))
    }

    /// Whether a request for a page has an identity.
    fn knows(&self, request: &Request) -> bool {
        let peer = request.extensions().get::<Peer>();
        matches!(self.identify(request.headers(), peer, true), Ok(Some(_)))
    }

    /// The caller of a route, and whether the caller is admitted.
    fn admit(&self, request: &Request, route: &str) -> (Caller, Result<(), Problem>) {
        let peer = request.extensions().get::<Peer>();
        let mut caller = Caller { identity: None, address: peer.map(|peer| peer.address.ip()) };
        if self.config.admission.is_open() {
            return (caller, Ok(()));
        }
        let found = self.identify(request.headers(), peer, route != SESSION).and_then(|identity| {
            let by_ticket = || ticket(request.uri()).and_then(|ticket| self.tickets.redeem(ticket));
            let identity = if route == SESSION { identity.or_else(by_ticket) } else { identity };
            let detail = "sign in at /sign-in, or send a token: Authorization: Bearer TOKEN";
            identity.ok_or_else(|| unauthorized(detail))
        });
        match found {
            Ok(identity) => caller.identity = Some(identity),
            Err(problem) => return (caller, Err(problem)),
        }
        let allowed = caller.may(Scope::needed(request.method(), route)).and_then(|()| {
            let stated = author_of(request.headers())?;
            caller.author(stated).map(drop)
        });
        (caller, allowed)
    }
}

/// Admits requests for data, limits the number of one caller's requests at a time, and records
/// them.
pub(crate) async fn admit_data(State(door): State<Door>, request: Request, next: Next) -> Response {
    let route = request.extensions().get::<MatchedPath>().map_or("", |path| path.as_str()).to_owned();
    if let Err(problem) = door.expect_audited() {
        return problem.into_response();
    }
    let (caller, allowed) = door.admit(&request, &route);
    let mut pending = door.record(&caller, &request, &route);
    let admitted = allowed.and_then(|()| share(&door, &caller, &route));
    let response = match admitted {
        Ok(_share) => answered(&caller, request, next).await,
        Err(problem) => problem.into_response(),
    };
    if let Some(pending) = &mut pending {
        pending.answered(response.status().as_u16());
    }
    response
}

/// The answer to an admitted caller.
async fn answered(caller: &Caller, mut request: Request, next: Next) -> Response {
    request.extensions_mut().insert(caller.clone());
    let Some(identity) = &caller.identity else { return next.run(request).await };
    set_author(request.headers_mut(), &identity.name);
    let mut response = next.run(request).await;
    // An answer for one caller is not one for another who uses the same browser or proxy.
    response.headers_mut().append(header::VARY, HeaderValue::from_static("Authorization, Cookie"));
    response
}

/// One place among the requests of a caller. Live routes wait for frames; they have limits of their
/// own.
fn share(door: &Door, caller: &Caller, route: &str) -> Result<Option<crate::shares::Share>, Problem> {
    if route.starts_with(SESSION) {
        return Ok(None);
    }
    door.requests.take(caller).map_err(|most| {
        let detail = format!("{most} of your requests are being answered, as many as one caller may have");
        Problem::new(StatusCode::TOO_MANY_REQUESTS, "too-many-requests", detail).with("allowed", most)
    })
}

/// Leads browsers that are not signed in from a page to the sign-in page.
pub(crate) async fn admit_page(State(door): State<Door>, request: Request, next: Next) -> Response {
    if door.config.admission.is_open() || door.knows(&request) {
        return next.run(request).await;
    }
    let location = format!("/sign-in?next={}", request.uri().path());
    let headers = [(header::LOCATION, location), (header::CACHE_CONTROL, "no-store".to_owned())];
    (StatusCode::SEE_OTHER, headers).into_response()
}

/// The value of the sign-in cookie.
pub(super) fn cookie(headers: &HeaderMap) -> Option<&str> {
    let pairs = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
    pairs
        .flat_map(|value| value.split(';'))
        .find_map(|pair| pair.trim().strip_prefix(COOKIE)?.strip_prefix('='))
}

/// The value of `ticket` in a query.
fn ticket(uri: &Uri) -> Option<&str> {
    uri.query()?.split('&').find_map(|pair| pair.strip_prefix("ticket="))
}
