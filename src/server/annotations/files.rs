//! Annotations as files: contents of regions and meshes.

use std::sync::Arc;

use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::Asked;
use crate::annotation::ContentId;
use crate::server::problem::Problem;
use crate::server::state::Server;

/// A content never changes.
const CACHE_CONTROL: &str = "private, max-age=31536000, immutable";

pub(super) async fn content(
    State(server): State<Arc<Server>>,
    Path((id, sha256)): Path<(String, String)>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let asked = Asked::new(&server, &id, &headers)?;
    let content = ContentId::try_from(sha256)
        .map_err(|reason| Problem::new(StatusCode::NOT_FOUND, "no-such-content", reason))?;
    let (media_type, bytes) = asked.annotations.store.content(&content).await?;
    let media_type =
        HeaderValue::from_str(&media_type).unwrap_or(HeaderValue::from_static("application/octet-stream"));
    let headers = [
        (header::CONTENT_TYPE, media_type),
        (header::CACHE_CONTROL, HeaderValue::from_static(CACHE_CONTROL)),
    ];
    Ok((headers, bytes).into_response())
}
