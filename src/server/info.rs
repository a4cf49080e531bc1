//! Information about the server: presets, health, metrics, the API description.

use std::sync::Arc;
use std::time::Duration;

use axum::Json;
use axum::extract::State;
use axum::http::header;
use axum::response::IntoResponse;
use serde_json::{Value, json};

use super::metrics::{Gauges, MEDIA_TYPE, Metrics};
use super::openapi::DOCUMENT;
use super::problem::Problem;
use super::state::{Config, Started};
use relief_display::{DepthFilter, Layout, ProfileName};
use relief_render::{DepthRule, Lighting, preset_json};
use relief_session::Engine;
use relief_volume::PRESETS;

pub(super) async fn presets() -> Json<Value> {
    let presets: Vec<Value> = PRESETS.iter().map(preset_json).collect();
    let layouts = Layout::ALL.map(Layout::name);
    let profiles = ProfileName::ALL.map(ProfileName::name);
    let filters = DepthFilter::ALL.map(DepthFilter::name);
    Json(json!({ "presets": presets, "layouts": layouts, "profiles": profiles, "depth_filters": filters,
        "depth_rules": DepthRule::names(), "lights": Lighting::ALL.map(|lighting| lighting.name) }))
}

/// A picture without progress for this long: others should answer. An upload of a large volume and
/// the compilation of shaders take less.
const STALLED: Duration = Duration::from_secs(60);
/// And for this long: only a restart helps.
const DEAD: Duration = Duration::from_secs(330);

/// The process runs and answers.
///
/// # Errors
/// 503 when the render thread has ended or makes no progress: a restart helps.
pub(super) async fn healthz(State(engine): State<Arc<Engine>>) -> Result<Json<Value>, Problem> {
    let service = &engine.service;
    if !service.is_alive() || service.stalled_for() > DEAD {
        return Err(Problem::unavailable("renderer-stuck", "the render thread makes no progress"));
    }
    Ok(Json(json!({ "status": "alive", "version": env!("CARGO_PKG_VERSION") })))
}

/// The number of volumes if the server is ready: the renderer works, every series of the operator
/// is loaded, and there is a volume or uploads are allowed.
fn readiness(engine: &Engine, config: &Config) -> Result<usize, Problem> {
    let (volumes, loading) = engine.volumes.count();
    if !engine.service.is_alive() {
        return Err(Problem::unavailable("renderer-ended", "the render thread has ended"));
    }
    if !engine.service.is_healthy() {
        return Err(Problem::unavailable(
            "renderer-failed",
            "the last picture failed in the graphics adapter",
        ));
    }
    if engine.service.stalled_for() > STALLED {
        return Err(Problem::unavailable("renderer-stalled", "the picture in progress makes no progress"));
    }
    if loading > 0 {
        let detail = format!("{loading} series are being loaded");
        return Err(Problem::unavailable("loading", detail).with("loading", loading));
    }
    if volumes == 0 && config.uploads.is_none() {
        return Err(Problem::unavailable("no-volume", "no volume is loaded, and uploads are off"));
    }
    Ok(volumes)
}

/// Whether requests should be sent here.
pub(super) async fn readyz(
    State(engine): State<Arc<Engine>>,
    State(config): State<Arc<Config>>,
) -> Result<Json<Value>, Problem> {
    let volumes = readiness(&engine, &config)?;
    Ok(Json(json!({ "status": "ready", "adapter": config.adapter, "volumes": volumes })))
}

pub(super) async fn metrics(
    State(engine): State<Arc<Engine>>,
    State(config): State<Arc<Config>>,
    State(metrics): State<Arc<Metrics>>,
    State(Started(started)): State<Started>,
) -> Result<impl IntoResponse, Problem> {
    let gauges = Gauges {
        waiting: engine.service.waiting(),
        counts: engine.service.counts(),
        memory: engine.service.memory(),
        host: engine.volumes.memory(),
        volumes: engine.volumes.count().0,
        ready: readiness(&engine, &config).is_ok(),
        uptime: started.elapsed(),
    };
    let text = metrics.text(gauges).map_err(|error| Problem::internal("writing the metrics", error))?;
    Ok(([(header::CONTENT_TYPE, MEDIA_TYPE)], text))
}

pub(super) async fn openapi() -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "application/vnd.oai.openapi+json;version=3.1")], DOCUMENT.as_str())
}
