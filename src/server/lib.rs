//! HTTP: volumes, frames, depth and picks for display boxes, batch jobs and browsers, and the page
//! at `/`.
//!
//! What it is: [`app`], a pure function from a [`Server`] to routes, tested without sockets, and
//! [`serve`], the loop that accepts connections within limits and drains them at the end. What it
//! is not: rendering (see `relief_session`) or DICOM (see [`VolumeLoader`]). Callers are recognised
//! by [`Admission`]; without it the server is open.
//!
//! Requests say mm, degrees and HU; depth is view depth in mm. No patient's name or id enters this
//! module.
//!
//! | path | methods | what |
//! |---|---|---|
//! | `/v1/volumes` | GET, POST | list; upload a zip |
//! | `/v1/volumes/{id}` | GET, DELETE | one volume; remove an uploaded one |
//! | `/v1/volumes/{id}/frame` | GET, POST | the picture in a display's layout, or colour, or raw |
//! | `/v1/volumes/{id}/slice` | GET | a slice, by its query |
//! | `/v1/volumes/{id}/depth` | GET, POST | view depth |
//! | `/v1/volumes/{id}/pick` | GET, POST | the patient position that a pixel shows |
//! | `/v1/volumes/{id}/annotations/...` | GET, POST, PUT, DELETE | items, their log, sets, templates and files |
//! | `/v1/volumes/{id}/presets/{name}/thumbnail` | GET | a small picture of the volume with a preset |
//! | `/studies/{study}/series/{series}/rendered3D`, `.../renderedmpr` | GET | DICOM Supplement 228 |
//! | `/v1/session` | GET | a live session, over a WebSocket; see `docs/LIVE.md` |
//! | `/v1/session/ticket` | POST | opens one WebSocket of a page |
//! | `/v1/session/protocol.json` | GET | its protocol for programs |
//! | `/v1/session/{view}/mjpeg`, `.../frame` | GET | a live view without a WebSocket |
//! | `/v1/session/{view}/intent` | POST | moves it |
//! | `/v1/identity`, `/v1/sign-in`, `/v1/sign-out` | GET, POST | who the caller is; the sign-in of the pages |
//! | `/v1/presets` | GET | transfer functions by name |
//! | `/healthz`, `/readyz`, `/metrics` | GET | operation |
//! | `/openapi.json` | GET | this table for programs |
//! | `/` and its files | GET | the page |

mod annotation_service;
mod annotations;
mod archived;
mod archives;
mod audit;
mod camera;
mod dicomweb;
mod following;
mod frame;
mod guard;
mod identity;
mod idle;
mod info;
mod labels;
mod listen;
mod live;
mod metrics;
mod negotiate;
mod observe;
mod openapi;
mod page;
mod problem;
mod quality;
mod query;
mod results;
mod shares;
mod stall;
mod state;
mod thumbnail;
mod tls;
mod upload;
mod views;
mod volumes;

use std::sync::Arc;

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::http::{Method, StatusCode, Uri};
use axum::middleware::{from_fn, from_fn_with_state};
use axum::routing::{get, post};
use tower_http::catch_panic::CatchPanicLayer;

use problem::Problem;
use relief_session::Product;
use state::AppState;

/// A header name, for [`TrustedProxy`].
pub use axum::http::HeaderName;

pub use archived::{ArchivedSeries, LoadSteps, SeriesArchives, SeriesQuery, StoredResult};
pub use audit::{AuditError, AuditLog, AuditSummary, verify_audit_log};
pub use identity::{
    Admission, NewToken, Scope, TokenEntry, TokenFileError, Tokens, TrustedProxy, add_token, read_tokens,
    remove_token,
};
pub use listen::{ConnectionLimits, Shutdown, serve};
pub use live::LiveConfig;
pub use state::{
    AllowedHosts, AnnotationsLoader, Config, ImportError, LabelsLoader, LoadError, Server, TraceHeaders,
    UploadLimits, VolumeLoader,
};
pub use tls::{Tls, TlsError, TlsFiles, fingerprint, self_signed};

/// The routes of a listener for probes and monitoring. It has no data of volumes and needs no
/// identity.
pub fn probes(server: Arc<Server>) -> Router {
    let state = AppState(server);
    Router::new()
        .route("/healthz", get(info::healthz))
        .route("/readyz", get(info::readyz))
        .route("/metrics", get(info::metrics))
        .fallback(not_found)
        .layer(CatchPanicLayer::custom(guard::on_panic))
        .with_state(state)
}

/// All routes of a server.
pub fn app(server: Arc<Server>) -> Router {
    let state = AppState(server);
    let gate = from_fn_with_state(state.clone(), identity::admit_data);
    let bounded = Router::new()
        .route("/v1/volumes/{id}", get(volumes::show).delete(volumes::remove))
        .route("/v1/volumes/{id}/frame", frame::routes(Product::Frame))
        .route("/v1/volumes/{id}/frame/store", post(results::store_picture))
        .route("/v1/volumes/{id}/views", views::routes())
        .route("/v1/volumes/{id}/depth", frame::routes(Product::Depth))
        .route("/v1/volumes/{id}/slice", get(frame::get_slice))
        .route("/v1/volumes/{id}/pick", get(frame::get_pick).post(frame::post_pick))
        .route("/v1/volumes/{id}/presets/{name}/thumbnail", get(thumbnail::thumbnail))
        .route("/studies/{study}/series/{series}/rendered3D", get(dicomweb::rendered_3d))
        .route("/studies/{study}/series/{series}/rendered3d", get(dicomweb::rendered_3d))
        .route("/studies/{study}/series/{series}/renderedmpr", get(dicomweb::rendered_mpr))
        .route("/v1/session", get(live::connect))
        .route("/v1/session/ticket", post(identity::ticket))
        .route("/v1/session/wand", post(identity::wand))
        .route("/v1/session/{view}/mjpeg", get(live::mjpeg))
        .route("/v1/session/{view}/frame", get(live::next_frame))
        .route("/v1/session/{view}/views", get(live::eye_views))
        .route("/v1/session/{view}/intent", post(live::intent))
        .route("/v1/archives", get(archives::list))
        .route("/v1/archives/{archive}/search", post(archives::search))
        .route("/v1/archives/{archive}/series/{key}", get(archives::state).post(archives::load))
        .route("/v1/presets", get(info::presets))
        .route("/metrics", get(info::metrics))
        .merge(annotations::routes())
        .layer(from_fn_with_state(state.clone(), guard::deadline));
    let pages = page::pages().layer(from_fn_with_state(state.clone(), identity::admit_page));
    // Nothing here is about a volume.
    let open = Router::new()
        .route("/v1/session/protocol.json", get(live::protocol))
        .route("/healthz", get(info::healthz))
        .route("/readyz", get(info::readyz))
        .route("/openapi.json", get(info::openapi))
        .merge(identity::routes())
        .merge(page::files());
    // An upload may take long; it has its own limits.
    let unbounded = Router::new()
        .route("/v1/volumes", get(volumes::list).post(upload::upload))
        .route("/v1/volumes/{id}/labels", post(labels::upload));
    bounded
        .merge(unbounded)
        .layer(gate)
        .merge(pages)
        .merge(open)
        .fallback(not_found)
        .method_not_allowed_fallback(wrong_method)
        .layer(from_fn(guard::readable_path))
        .layer(from_fn_with_state(state.clone(), guard::same_site))
        .layer(CatchPanicLayer::custom(guard::on_panic))
        .layer(from_fn_with_state(state.clone(), observe::observe))
        .layer(from_fn(guard::harden))
        // Handlers read bodies with their own limits.
        .layer(DefaultBodyLimit::disable())
        .with_state(state)
}

async fn not_found() -> Problem {
    Problem::new(StatusCode::NOT_FOUND, "not-found", "there is nothing at this path; /openapi.json lists all")
}

async fn wrong_method(method: Method, uri: Uri) -> Problem {
    let detail = format!("{method} is not allowed on {}; the header Allow lists what is", uri.path());
    Problem::new(StatusCode::METHOD_NOT_ALLOWED, "method-not-allowed", detail)
}
