//! Pictures under a time budget: reduced by the predicted speed of the renderer, and labelled with
//! the reduction.

use axum::http::{HeaderName, HeaderValue, header};
use axum::response::Response;
use serde_json::json;

use relief_render::{Mode, Scene};
use relief_session::{Engine, VolumeEntry};

static RELIEF_QUALITY: HeaderName = HeaderName::from_static("relief-quality");

/// The reduction for a budget; `None` without a budget.
#[derive(Debug)]
pub(super) struct Quality(Option<HeaderValue>);

/// Reduces a scene that has a budget as far as it must be, so that equal answers have equal scenes,
/// and equal tags.
pub(super) fn within_budget(engine: &Engine, entry: &VolumeEntry, scene: &mut Scene) -> Quality {
    let Some(budget_ms) = scene.budget_ms else { return Quality(None) };
    let planned = engine.service.plan(entry.hash, &entry.grid, &scene.request, budget_ms);
    scene.request = planned.request;
    let request = &scene.request;
    let mut used = json!({
        "budget_ms": budget_ms,
        "expected_ms": (planned.expected_ms * 100.0).round() / 100.0,
        "reduced": planned.is_reduced,
        "rays_px": request.reduced_px.unwrap_or(request.size_px),
        "sample_distance_mm": request.sample_distance_mm,
    });
    if request.mode == Mode::PathTraced {
        used["passes"] = json!(request.path_trace.passes);
    }
    Quality(HeaderValue::from_str(&used.to_string()).ok())
}

impl Quality {
    /// Adds the header. Later pictures of the same address may be better, so caches have to
    /// revalidate; the tag still saves the transfer.
    pub(super) fn mark(self, mut response: Response) -> Response {
        if let Some(used) = self.0 {
            let headers = response.headers_mut();
            headers.insert(&RELIEF_QUALITY, used);
            headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("private, no-cache"));
        }
        response
    }
}
