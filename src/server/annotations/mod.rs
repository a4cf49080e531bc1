//! Annotations over HTTP: items of a volume, their log, sets, templates and files.
//!
//! What it is: the routes under `/v1/volumes/{id}/annotations`. What it is not: the annotations of
//! a server behind them (see `annotation_service`), storage (see `relief_store`), file formats (see
//! `relief_exchange`) or drawing (see `relief_session`).
//!
//! An author is the verified name of the caller. On an open server it is a name that the request
//! states, and a blinded set relies on readers who use their own names. A request about a volume affects only items of its frame of
//! reference. Patient mm.

mod asked;
mod author;
mod drawing;
mod edit;
mod files;
mod item;
mod list;
mod log;
mod order;
mod sets;
mod snap;
mod structures;
mod templates;

use axum::Router;
use axum::routing::{get, post};

use super::annotation_service::HistoryStep;
use super::state::AppState;

pub(super) use author::{author_of, check as check_author, decoded, missing as missing_author, set_author};
pub(super) use drawing::draw;

/// The routes under a volume.
pub(super) fn routes() -> Router<AppState> {
    Router::new()
        .route("/v1/volumes/{id}/annotations", get(list::list).post(edit::post))
        .route("/v1/volumes/{id}/annotations/undo", edit::steps(HistoryStep::Undo))
        .route("/v1/volumes/{id}/annotations/redo", edit::steps(HistoryStep::Redo))
        .route("/v1/volumes/{id}/annotations/log", get(log::log))
        .route("/v1/volumes/{id}/annotations/grow", post(structures::grow))
        .route("/v1/volumes/{id}/annotations/paint", post(structures::paint))
        .route("/v1/volumes/{id}/annotations/refine", post(structures::refine))
        .route("/v1/volumes/{id}/annotations/fill", post(structures::fill))
        .route("/v1/volumes/{id}/annotations/mesh", post(structures::mesh))
        .route("/v1/volumes/{id}/annotations/import", post(files::import))
        .route("/v1/volumes/{id}/annotations/export", get(files::export))
        .route("/v1/volumes/{id}/annotations/store", post(files::store))
        .route("/v1/volumes/{id}/annotations/snap", post(snap::snap))
        .route("/v1/volumes/{id}/annotations/templates", get(templates::names))
        .route("/v1/volumes/{id}/annotations/contents/{sha256}", get(files::content))
        .route("/v1/volumes/{id}/annotations/sets/{name}", get(sets::show).put(sets::put))
        .route("/v1/volumes/{id}/annotations/templates/{name}", get(templates::show).put(templates::put))
        .route("/v1/volumes/{id}/annotations/templates/{name}/apply", post(templates::apply))
        .route("/v1/volumes/{id}/annotations/{item}", get(item::show).put(item::put).delete(item::delete))
}
