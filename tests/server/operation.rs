//! Health, metrics, descriptions, the page, and that other requests are served while one renders.

use std::collections::BTreeSet;
use std::time::Duration;

use axum::body::Body;
use axum::http::Request;
use relief_server::Config;
use relief_session::{LoadedVolume, QueueConfig};
use serde_json::{Value, json};

use crate::server::stage::{FAILS, REFUSES, Stage, cube};

#[tokio::test]
async fn readiness_follows_volumes_and_the_render_thread() {
    let config = Config { adapter: "a test".to_owned(), uploads: None, ..Config::default() };
    let stage = Stage::empty(config, QueueConfig::default());
    assert_eq!(stage.get("/healthz").await.status, 200);
    assert_eq!(stage.get("/readyz").await.problem(503)["type"], "urn:relief:problem:no-volume");
    stage.server.expect_volumes(2);
    for loading in [2, 1] {
        assert_eq!(stage.get("/readyz").await.problem(503)["loading"], loading);
        assert!(stage.get("/metrics").await.text().contains("relief_ready 0\n"));
        stage.server.add_volume(LoadedVolume {
            volume: cube(),
            warnings: Vec::new(),
            identity: None,
            reference: None,
            labels: None,
        });
    }
    let ready = stage.get("/readyz").await;
    assert_eq!(ready.status, 200);
    assert_eq!(ready.json(), json!({ "status": "ready", "adapter": "a test", "volumes": 1 }));
    stage.service.shut_down();
    assert_eq!(stage.get("/readyz").await.problem(503)["type"], "urn:relief:problem:renderer-ended");
    // A restart helps.
    assert_eq!(stage.get("/healthz").await.problem(503)["type"], "urn:relief:problem:renderer-stuck");
}

#[tokio::test]
async fn a_server_that_waits_for_uploads_is_ready() {
    let stage = Stage::empty(Config::default(), QueueConfig::default());
    assert_eq!(stage.get("/readyz").await.json()["volumes"], 0);
    assert!(stage.get("/metrics").await.text().contains("relief_ready 1\n"));
}

#[tokio::test]
async fn a_failing_adapter_is_not_ready_until_it_renders() {
    let stage = Stage::new();
    for (query, status) in [(REFUSES, 200), (FAILS, 503), (REFUSES, 503), ("zoom=2", 200)] {
        stage.get(&stage.path(&format!("frame?{query}"))).await;
        let ready = stage.get("/readyz").await;
        assert_eq!(ready.status, status, "{query}");
        assert!(!ready.text().contains("secret"), "{}", ready.text());
    }
}

/// Invariant: Metrics and volume descriptions name no patient.
#[tokio::test]
async fn a_volume_is_described_by_geometry_and_values_alone() {
    let stage = Stage::new();
    let listed = stage.get("/v1/volumes").await.json();
    let shown = stage.get(&format!("/v1/volumes/{}", stage.id)).await.json();
    assert_eq!(listed, json!({ "volumes": [shown], "loading": 0 }));
    assert_eq!(shown["dims"], json!([4, 4, 4]));
    assert_eq!(shown["spacing_mm"], json!([10.0, 10.0, 10.0]));
    assert_eq!(shown["direction"], json!([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]));
    assert_eq!(shown["bounds_mm"], json!([[-20.0, -20.0, -20.0], [20.0, 20.0, 20.0]]));
    assert_eq!((&shown["hu_range"], &shown["warnings"]), (&json!([0, 63]), &json!(2)));
    let warning = &shown["reading_warnings"][0];
    assert_eq!((&warning["code"], &warning["count"]), (&json!("bad-file"), &json!(2)));
    let mut keys: Vec<&str> = shown.as_object().unwrap().keys().map(String::as_str).collect();
    keys.sort_unstable();
    assert_eq!(shown["name"], "Object, 4 × 4 × 4");
    let known = [
        "anatomy",
        "bounds_mm",
        "center_mm",
        "dims",
        "direction",
        "framing",
        "hu_range",
        "id",
        "links",
        "name",
        "origin_mm",
        "phase",
        "radius_mm",
        "reading_warnings",
        "removable",
        "segments",
        "spacing_mm",
        "unit",
        "warnings",
    ];
    assert_eq!(keys, known, "a new key must not tell who was scanned");
}

/// Invariant: Other requests are served while one renders.
#[tokio::test]
async fn others_are_served_while_one_renders() {
    let stage = Stage::new();
    let known = stage.get(&stage.path("frame?preset=skin")).await.header("etag").to_owned();
    stage.gate.close();
    let (app, path) = (stage.app.clone(), stage.path("frame?preset=bone&zoom=2"));
    let slow = tokio::spawn(tower::ServiceExt::oneshot(app, Request::get(path).body(Body::empty()).unwrap()));
    stage.gate.held().await;
    let others = async {
        for path in ["/healthz", "/readyz", "/metrics", "/v1/volumes", "/v1/presets", "/"] {
            assert_eq!(stage.get(path).await.status, 200, "{path}");
        }
        let again = stage.get_with(&stage.path("frame?preset=skin"), &[("if-none-match", &known)]).await;
        assert_eq!(again.status, 304);
        let reused = stage.get_with(&stage.path("frame?preset=skin"), &[("accept", "image/x-exr")]).await;
        assert!(reused.header("server-timing").contains("reused"));
    };
    tokio::time::timeout(Duration::from_secs(60), others)
        .await
        .expect("nobody waits for the one that renders");
    assert!(!slow.is_finished());
    stage.gate.open();
    assert_eq!(slow.await.unwrap().unwrap().status(), 200);
}

/// The table of metrics.
const METRICS: &str = include_str!("../../src/server/metrics.rs");

/// Invariant: Alerts and the dashboard ask for metrics that a server has.
#[tokio::test]
async fn alerts_and_dashboard_know_the_metrics() {
    let stage = Stage::new();
    assert_eq!(stage.get(&stage.path("frame")).await.status, 200);
    let answer = stage.get("/metrics").await;
    let served = answer.text();
    let known: Vec<&str> =
        served.lines().filter_map(|line| line.strip_prefix("# TYPE ")?.split(' ').next()).collect();
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/monitoring");
    for file in ["alerts.yaml", "dashboard.json"] {
        let text = std::fs::read_to_string(folder.join(file)).unwrap();
        let is_name = |c: char| c.is_ascii_lowercase() || c == '_';
        let asked = text.split(|c: char| !is_name(c)).filter(|word| word.starts_with("relief_"));
        let asked: BTreeSet<&str> = asked.collect();
        assert!(asked.len() > 4, "{file}: {asked:?}");
        for name in asked {
            let base = ["_total", "_bucket"].iter().find_map(|end| name.strip_suffix(end)).unwrap_or(name);
            // Families without a value yet are not in the text; their names are in the table of metrics.
            let is_registered = METRICS.contains(&format!("\"{base}\""));
            assert!(
                known.contains(&base) || is_registered,
                "{file} asks for {name}, which /metrics does not have"
            );
        }
    }
    let dashboard = std::fs::read_to_string(folder.join("dashboard.json")).unwrap();
    let dashboard: Value = serde_json::from_str(&dashboard).unwrap();
    assert!(dashboard["panels"].as_array().unwrap().len() > 10);
}

/// Invariant: Metrics and volume descriptions name no patient.
#[tokio::test]
async fn metrics_count_without_naming() {
    let stage = Stage::new();
    stage.get(&stage.path("frame")).await;
    stage.get(&stage.path("frame")).await;
    stage.get("/who/are/you").await;
    stage.ask(Request::builder().method("BREW").uri("/").body(Body::empty()).unwrap()).await;
    let answer = stage.get("/metrics").await;
    assert!(answer.header("content-type").starts_with("application/openmetrics-text; version=1.0.0"));
    let text = answer.text();
    for line in [
        "relief_requests_total{method=\"GET\",route=\"/v1/volumes/{id}/frame\",status=\"200\"} 2",
        "relief_requests_total{method=\"GET\",route=\"unmatched\",status=\"404\"} 1",
        "relief_requests_total{method=\"other\",route=\"/\",status=\"405\"} 1",
        "relief_render_orders_total{outcome=\"rendered\"} 1",
        "relief_render_orders_total{outcome=\"reused\"} 1",
        "relief_requests_in_flight 1",
        "relief_render_queue_length 0",
        "relief_volumes 1",
        "relief_ready 1",
        "relief_render_seconds_bucket{le=\"0.005\"} 1",
        "relief_render_seconds_count 1",
    ] {
        assert!(text.lines().any(|found| found == line), "{line} is not in\n{text}");
    }
    assert!(!text.contains(&stage.id));
    for line in text.lines().filter(|line| !line.starts_with('#')) {
        let (_, value) = line.rsplit_once(' ').unwrap();
        assert!(value.parse::<f64>().is_ok(), "{line}");
    }
}

#[tokio::test]
async fn presets_and_layouts_are_listed() {
    let listed = Stage::new().get("/v1/presets").await.json();
    let names: Vec<&str> =
        listed["presets"].as_array().unwrap().iter().map(|p| p["name"].as_str().unwrap()).collect();
    let known: Vec<&str> = relief_volume::PRESETS.iter().map(|preset| preset.name).collect();
    assert_eq!(names, known);
    assert!(listed["presets"].as_array().unwrap().iter().all(|p| !p["purpose"].as_str().unwrap().is_empty()));
    assert!(listed["layouts"].as_array().unwrap().contains(&json!("wowvx")));
    assert_eq!(listed["depth_rules"], json!(relief_render::DepthRule::names()));
    assert_eq!(listed["lights"], json!(relief_render::Lighting::ALL.map(|lighting| lighting.name)));
    assert_eq!(listed["depth_filters"], json!(["none", "median-3", "median-5"]));
}

#[tokio::test]
async fn the_page_is_whole_and_loads_nothing_from_elsewhere() {
    let stage = Stage::new();
    let page = stage.get("/").await;
    assert!(page.header("content-type").starts_with("text/html"));
    let policy = page.header("content-security-policy");
    assert!(policy.contains("default-src 'none'") && policy.contains("script-src 'self'"));
    assert!(!policy.contains("unsafe"));
    let mut wanted = vec!["/".to_owned()];
    let mut seen = BTreeSet::new();
    while let Some(path) = wanted.pop() {
        if !seen.insert(path.clone()) {
            continue;
        }
        let file = stage.get(&path).await;
        assert_eq!(file.status, 200, "{path}");
        assert_eq!(file.header("x-content-type-options"), "nosniff");
        assert!(!without_namespaces(file.text()).contains("://"), "{path} names another site");
        let tag = file.header("etag");
        for known in [tag, &format!("W/{tag}"), &format!("\"other\", {tag}"), "*"] {
            let again = stage.get_with(&path, &[("if-none-match", known)]).await;
            assert_eq!((again.status.as_u16(), again.body.len()), (304, 0), "{known}");
            assert_eq!(again.header("content-security-policy"), policy, "a reload keeps the page's policy");
        }
        wanted.extend(references(&path, file.text()));
    }
    assert!(seen.iter().any(|path| path.ends_with(".css")) && seen.iter().any(|path| path.ends_with(".js")));
}

/// The files that a page or a script at `path` names: values of `src` and `href` from the root,
/// imports from where it lies.
fn references(path: &str, text: &str) -> Vec<String> {
    let folder = path.rsplit_once('/').map_or("", |(folder, _)| folder);
    let named = |key: &'static str, base: String| {
        let names = text.split(key).skip(1).filter_map(|rest| rest.split('"').next());
        names.map(move |name| format!("{base}/{name}")).collect::<Vec<_>>()
    };
    let [sources, links] = ["src=\"/", "href=\"/"].map(|key| named(key, String::new()));
    [sources, links, named("from \"./", folder.to_owned())].concat()
}

/// XML namespaces look like addresses but are not.
fn without_namespaces(text: &str) -> String {
    text.replace("http://www.w3.org/2000/svg", "")
}

#[tokio::test]
async fn every_answer_is_hardened() {
    let stage = Stage::new();
    for path in ["/healthz", "/nothing", "/v1/volumes", "/metrics"] {
        let answer = stage.get(path).await;
        assert_eq!(answer.header("x-content-type-options"), "nosniff", "{path}");
        assert_eq!(answer.header("cross-origin-resource-policy"), "same-origin", "{path}");
        assert!(answer.header("content-security-policy").contains("default-src 'none'"), "{path}");
        assert!(!answer.headers.contains_key("access-control-allow-origin"));
    }
}

#[tokio::test]
async fn openapi_lists_exactly_the_served_methods() {
    let stage = Stage::new();
    let api = stage.get("/openapi.json").await.json();
    assert!(api["openapi"].as_str().unwrap().starts_with("3.1"));
    let modes = serde_json::json!(relief_render::Mode::ALL.map(relief_render::Mode::name));
    assert_eq!(api["components"]["parameters"]["mode"]["schema"]["enum"], modes, "the query");
    assert_eq!(api["components"]["schemas"]["Scene"]["properties"]["mode"]["enum"], modes, "the body");
    for (path, methods) in api["paths"].as_object().unwrap() {
        let at = path.replace("{id}", &stage.id);
        let patch = stage.ask(Request::patch(&at).body(Body::empty()).unwrap()).await; // nothing has that
        assert_eq!(patch.status, 405, "{path}");
        let allowed: Vec<String> =
            patch.header("allow").split(',').map(|m| m.trim().to_lowercase()).collect();
        let listed = methods.as_object().unwrap().keys().filter(|key| *key != "parameters");
        for method in listed {
            assert!(allowed.contains(method), "{path} {method}");
        }
        for method in allowed.iter().filter(|method| *method != "head") {
            assert!(methods.get(method).is_some(), "openapi.json lacks {method} of {path}");
        }
    }
}
