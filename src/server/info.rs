//! What is on offer and how the server is: presets, health, metrics, the description for programs.

use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use axum::http::header;
use axum::response::IntoResponse;
use serde_json::{Value, json};

use super::metrics::Gauges;
use super::metrics::Metrics;
use super::problem::Problem;
use super::state::{Config, Started};
use relief_display::{DepthFilter, Layout, ProfileName};
use relief_render::{DepthRule, Lighting, preset_json};
use relief_session::Engine;
use relief_volume::PRESETS;

/// OpenAPI 3.1, written by hand; tests compare its paths and parameters with the code's.
const OPENAPI: &str = include_str!("openapi.json");

pub(super) async fn presets() -> Json<Value> {
    let presets: Vec<Value> = PRESETS.iter().map(preset_json).collect();
    let layouts = Layout::ALL.map(Layout::name);
    let profiles = ProfileName::ALL.map(ProfileName::name);
    let filters = DepthFilter::ALL.map(DepthFilter::name);
    Json(json!({ "presets": presets, "layouts": layouts, "profiles": profiles, "depth_filters": filters,
        "depth_rules": DepthRule::NAMES, "lights": Lighting::ALL.map(|lighting| lighting.name) }))
}

/// The process runs and answers.
pub(super) async fn healthz() -> Json<Value> {
    Json(json!({ "status": "alive", "version": env!("CARGO_PKG_VERSION") }))
}

/// The number of volumes when the server can do what it is for: the renderer works, every series of the operator is
/// loaded, and there is a volume or a client may bring one.
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
) -> impl IntoResponse {
    let gauges = Gauges {
        waiting: engine.service.waiting(),
        counts: engine.service.counts(),
        memory: engine.service.memory(),
        host: engine.volumes.memory(),
        volumes: engine.volumes.count().0,
        ready: readiness(&engine, &config).is_ok(),
        uptime: started.elapsed(),
    };
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], metrics.text(gauges))
}

pub(super) async fn openapi() -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "application/vnd.oai.openapi+json;version=3.1")], OPENAPI)
}

#[cfg(test)]
mod tests {
    use relief_render::Overlays;
    use std::collections::BTreeSet;

    use super::*;
    use crate::query::parameter_names;
    use relief_display::ContentType;

    fn document() -> Value {
        serde_json::from_str(OPENAPI).unwrap()
    }

    #[test]
    fn openapi_lists_every_route_but_the_pages_files() {
        // axum keeps no list of its routes; the calls that make them are one.
        let sources = [include_str!("lib.rs"), include_str!("annotations/mod.rs")];
        let routes = sources.iter().flat_map(|source| source.split(".route(\"").skip(1));
        let routed: BTreeSet<&str> = routes.filter_map(|rest| rest.split('"').next()).collect();
        let document = document();
        let listed: BTreeSet<&str> =
            document["paths"].as_object().unwrap().keys().map(String::as_str).collect();
        assert_eq!(routed, listed);
    }

    #[test]
    fn openapi_lists_every_parameter_of_a_scene() {
        let document = document();
        let own: BTreeSet<&str> = parameter_names().collect();
        for operation in ["frame", "depth", "slice", "pick"] {
            let parameters =
                &document["paths"][format!("/v1/volumes/{{id}}/{operation}")]["get"]["parameters"];
            let references = parameters.as_array().unwrap().iter().map(|p| p["$ref"].as_str().unwrap());
            let listed: BTreeSet<&str> =
                references.map(|r| r.strip_prefix("#/components/parameters/").unwrap()).collect();
            assert_eq!(own, listed, "{operation}");
        }
        let names = |name: &str| document["components"]["parameters"][name]["schema"]["enum"].clone();
        let layouts = &document["components"]["parameters"]["layout"]["schema"]["anyOf"][0]["enum"];
        assert_eq!(*layouts, json!(Layout::ALL.map(Layout::name)));
        assert_eq!(names("profile"), json!(ProfileName::ALL.map(ProfileName::name)));
        assert_eq!(names("depth_filter"), json!(DepthFilter::ALL.map(DepthFilter::name)));
        assert_eq!(names("depth_rule"), json!(DepthRule::NAMES));
        assert_eq!(names("lights"), json!(Lighting::ALL.map(|lighting| lighting.name)));
        assert_eq!(names("content"), json!(ContentType::ALL.map(ContentType::name)));
        let overlays = &document["components"]["parameters"]["overlay"]["schema"]["items"]["enum"];
        assert_eq!(*overlays, json!(Overlays::SWITCHES.map(|(name, _)| name)));
        for (name, parameter) in document["components"]["parameters"].as_object().unwrap() {
            assert_eq!(parameter["name"], name.as_str());
        }
    }
}
