//! Every refusal: its status, and a document that names the error, its place and the allowed
//! values.

use std::time::Duration;

use axum::body::Body;
use axum::http::Request;
use proptest::prelude::*;
use proptest::sample::select;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;
use relief_server::{AllowedHosts, Config};
use relief_session::QueueConfig;
use serde_json::{Value, json};

use crate::server::stage::{FAILS, PANICS, REFUSES, Stage};

#[tokio::test]
async fn parameters_are_refused_by_name_value_and_range() {
    let stage = Stage::new();
    for (query, status, path, parts) in [
        ("presett=bone", 400, "presett", &["not a parameter", "preset, window_hu"][..]),
        ("zoom=1&zoom=2", 400, "zoom", &["twice"]),
        ("zoom=big", 400, "zoom", &["\"big\"", "a finite number"]),
        ("zoom=inf", 400, "zoom", &["\"inf\"", "a finite number"]),
        ("zoom=100", 422, "zoom", &["zoom is 100", "0.05 to 50"]),
        ("elevation_deg=91", 422, "elevation_deg", &["elevation_deg is 91", "-90 to 90"]),
        ("vertical_fov_deg=171", 422, "vertical_fov_deg", &["171", "5 to 150"]),
        ("size_px=960", 400, "size_px", &["\"960\"", "2 whole number"]),
        ("size_px=-1,5", 400, "size_px", &["\"-1,5\""]),
        ("size_px=9000,540&layout=color", 422, "size_px", &["size_px is 9000", "1 to 8192"]),
        ("preset=bones", 422, "preset", &["preset is bones", "bone, skin"]),
        ("mode=xray", 400, "mode", &["xray", "composite"]),
        ("window_hu=40,0", 422, "window_hu", &["window_hu is 0", "1 to 65536"]),
        ("preset=bone&window_hu=40,400", 422, "window_hu", &["exclude each other"]),
        ("look_at_mm=0,0,0", 422, "look_at_mm", &["means nothing without eye_mm"]),
        ("eye_mm=0,0,0", 422, "look_at_mm", &["0 mm from eye_mm"]),
        ("eye_mm=0,-100,0&zoom=2", 422, "zoom", &["exclude each other"]),
        ("sample_distance_mm=0", 422, "sample_distance_mm", &["is 0", "0.000001 to 100"]),
        ("depth_rule=nearest", 400, "depth_rule", &["nearest", "first-hit"]),
        ("depth_rule=threshold&depth_fraction=2", 422, "depth_fraction", &["depth_fraction is 2"]),
        ("lights=disco", 422, "lights", &["lights is disco", "headlight, studio"]),
        ("mode=mip&lights=studio", 422, "lights", &["2 lights", "none in this mode"]),
        ("shadows=1", 422, "shadows", &["means nothing without lights"]),
        ("lights=studio&shadows=2", 422, "shadows", &["shadows is 2", "0 to 1"]),
        ("lights=headlight&shadows=1", 422, "shadows", &["shadows is 1", "without lights"]),
        ("occlusion=-1", 422, "occlusion", &["occlusion is -1", "0 to 1"]),
        ("occlusion_radius_mm=5", 422, "occlusion_radius_mm", &["means nothing without occlusion"]),
        ("occlusion=1&occlusion_radius_mm=0", 422, "occlusion_radius_mm", &["is 0", "0.5 to 500"]),
        ("clip_box_mm=5,5,5,-5,-5,-5", 422, "clip_box_mm", &["min < max"]),
        ("clip_planes_mm=1,2,3,4,5,x", 400, "clip_planes_mm", &["1,2,3,4,5,x", "groups of 6 numbers"]),
        ("clip_planes_mm=1,2,3,4,5,6,7", 422, "clip_planes_mm", &["7 numbers", "groups of 6 numbers"]),
        ("clip_planes_mm=0,0,0,0,0,0", 422, "clip_planes_mm", &["a direction"]),
        ("layout=plasma", 400, "layout", &["plasma", "wowvx"]),
        ("profile=vhs", 400, "profile", &["vhs", "philips-42"]),
        ("layout=wowvx-4k&profile=philips-20", 422, "profile", &["wowvx-4k"]),
        ("content=opera", 400, "content", &["opera", "movie"]),
        ("factor=300", 400, "factor", &["300", "0 to 255"]),
        ("near_mm=5&far_mm=4", 422, "near_mm", &["near_mm is 5"]),
        ("background_rgb=0,0,2", 422, "background_rgb", &["is 2", "0 to 1"]),
    ] {
        let problem = stage.get(&stage.path(&format!("frame?{query}"))).await.problem(status);
        let detail = problem["detail"].as_str().unwrap();
        assert_eq!(problem["path"], path, "{query}: {problem}");
        for part in parts {
            assert!(detail.contains(part), "{query}: {detail:?} lacks {part:?}");
        }
        stage.get(&stage.path(&format!("depth?{query}"))).await.problem(status);
    }
    assert_eq!(stage.gate.count(), 0, "nothing wrong reaches the renderer");
}

fn text(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// The example of a described parameter, else its default, else 1.
fn usual(parameter: &Value) -> String {
    let values = [&parameter["example"], &parameter["schema"]["default"]];
    values.into_iter().find(|value| !value.is_null()).map_or_else(|| "1".to_owned(), text)
}

/// Invariant: Any query of a frame or a slice is answered by a picture or refused with a reason.
#[tokio::test]
async fn any_query_is_rendered_or_refused() {
    const VALUES: [&str; 26] = [
        "",
        "0",
        "1",
        "-1",
        "0.5",
        "90",
        "1e400",
        "-1e308",
        "nan",
        "inf",
        "true",
        "false",
        "bone",
        "composite",
        "1,2",
        "40,400",
        "1,2,3",
        "0,0,0,0,0,0",
        "0,0,1,0,0,0,5,5,5,0,1,0",
        "99999999999999999999",
        "default",
        "volume",
        "visible",
        "%00",
        "%ff",
        "a+b%26c%3Dd,%2C",
    ];
    let stage = Stage::annotated().await;
    let description = stage.get("/openapi.json").await.json();
    let parameters = description["components"]["parameters"].as_object().unwrap().values();
    let known: Vec<(String, String)> =
        parameters.filter(|one| one["in"] == "query").map(|one| (text(&one["name"]), usual(one))).collect();
    assert!(known.len() > 50, "{known:?}");
    let mut runner = TestRunner::deterministic();
    let values = prop_oneof![8 => select(&VALUES[..]).prop_map(str::to_owned), 1 => "[!-~]{0,12}"];
    let odd = (select(known.clone()), values).prop_map(|((name, _), value)| (name, value));
    let part = prop_oneof![odd, select(known)];
    let queries = (select(vec!["frame", "slice"]), proptest::collection::vec(part, 1..3));
    let (mut rendered, mut refused) = (0, 0);
    for _ in 0..2000 {
        let (route, parts) = queries.new_tree(&mut runner).unwrap().current();
        let parts: Vec<String> =
            parts.iter().map(|(name, value)| format!("{name}={}", value.replace('#', "%23"))).collect();
        let path = stage.path(&format!("{route}?size_px=16,12&layout=color&{}", parts.join("&")));
        let Ok(request) = Request::get(&path).body(Body::empty()) else { continue };
        let answer = stage.ask(request).await;
        match answer.status.as_u16() {
            200 => rendered += 1,
            status @ (400 | 404 | 406 | 422) => {
                answer.problem(status);
                refused += 1;
            }
            status => panic!("{path}: {status} {}", answer.text()),
        }
    }
    assert!(rendered > 100 && refused > 500, "{rendered} rendered, {refused} refused");
}

#[tokio::test]
async fn limits_that_clash_with_the_volumes_are_refused_before_rendering() {
    let stage = Stage::new();
    for part in ["frame", "depth"] {
        let problem = stage.get(&stage.path(&format!("{part}?near_mm=1e6"))).await.problem(422);
        assert_eq!(problem["path"], "near_mm");
    }
    stage.get(&stage.path("pick?u=1&v=1&far_mm=-1")).await.problem(422);
    let body = r#"{"display":{"near_mm":1e6}}"#;
    let posted = stage.post(&stage.path("frame"), "application/json", body).await.problem(422);
    assert_eq!(posted["path"], "display.near_mm");
    assert_eq!(stage.gate.count(), 0, "nothing is rendered for what cannot be answered");
}

#[tokio::test]
async fn bodies_are_refused_by_path_type_and_size() {
    let stage = Stage::new();
    let path = stage.path("frame");
    for (body, status, at) in [
        ("", 400, "."),
        ("{\"size_px\":[1,", 400, "size_px"),
        ("{\"sise_px\":[1,1]}", 400, "sise_px"),
        ("{\"transfer\":{\"points\":[{\"hu\":0}]}}", 400, "transfer"),
        ("{\"sample_distance_mm\":1000}", 422, "sample_distance_mm"),
        ("{\"display\":{\"layout\":\"plasma\"}}", 400, "display.layout"),
        ("{\"clip\":{\"planes\":[{\"point_mm\":[0,0,0],\"normal\":[0,0,0]}]}}", 422, "clip.planes[0].normal"),
    ] {
        let problem = stage.post(&path, "application/json", body).await.problem(status);
        assert!(problem["path"].as_str().unwrap().starts_with(at), "{body}: {problem}");
    }
    for media in ["text/plain", "application/x-www-form-urlencoded", ""] {
        stage.post(&path, media, "{}").await.problem(415);
    }
    let fine = stage.post(&path, "application/json; charset=utf-8", "{}").await;
    assert_eq!(fine.status, 200);
    stage.post(&path, "application/json", vec![b' '; (1 << 20) + 1]).await.problem(413);
    stage.post(&stage.path("frame?preset=bone"), "application/json", "{}").await.problem(400);
}

#[tokio::test]
async fn unknown_paths_volumes_and_methods() {
    let stage = Stage::new();
    stage.get("/nothing").await.problem(404);
    stage.get("/v1/volumes/0123456789abcdef").await.problem(404);
    stage.get("/v1/volumes/0123456789abcdef/frame").await.problem(404);
    stage.get(&stage.path("nothing")).await.problem(404);
    let wrong = stage.ask(Request::put(stage.path("frame")).body(Body::empty()).unwrap()).await;
    wrong.problem(405);
    let mut allowed: Vec<&str> = wrong.header("allow").split(',').map(str::trim).collect();
    allowed.sort_unstable();
    assert_eq!(allowed, ["GET", "HEAD", "POST"]);
    stage.post("/healthz", "application/json", "{}").await.problem(405);
}

#[tokio::test]
async fn a_failing_renderer_tells_the_client_nothing_of_its_insides() {
    let stage = Stage::new();
    for query in [PANICS, FAILS] {
        let answer = stage.get(&stage.path(&format!("frame?{query}"))).await;
        answer.problem(500);
        assert!(!answer.text().contains("secret"), "{}", answer.text());
    }
    let refused = stage.get(&stage.path(&format!("frame?{REFUSES}"))).await.problem(422);
    assert!(refused["detail"].as_str().unwrap().contains("larger than this adapter takes"));
    assert_eq!(stage.get(&stage.path("frame")).await.status, 200, "the next request is served");
}

#[tokio::test]
async fn a_full_queue_answers_503_with_retry_after() {
    let stage = Stage::with(Config::default(), QueueConfig { capacity: 1, ..QueueConfig::default() });
    stage.gate.close();
    let ask = |mark: f64| {
        let (app, path) = (stage.app.clone(), stage.path(&format!("frame?sample_distance_mm={mark}")));
        tokio::spawn(tower::ServiceExt::oneshot(app, Request::get(path).body(Body::empty()).unwrap()))
    };
    let first = ask(1.0);
    stage.gate.held().await;
    let second = ask(2.0);
    while stage.service.waiting() == 0 {
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    let third = stage.get(&stage.path("frame?sample_distance_mm=3")).await;
    assert_eq!(third.problem(503)["type"], "urn:relief:problem:busy");
    assert_eq!(third.header("retry-after"), "1");
    stage.gate.open();
    for answer in [first, second] {
        assert_eq!(answer.await.unwrap().unwrap().status(), 200);
    }
}

#[tokio::test]
async fn a_render_that_takes_too_long_is_given_up() {
    let config = Config { request_timeout: Duration::from_millis(50), ..Config::default() };
    let stage = Stage::with(config, QueueConfig::default());
    stage.gate.close();
    let answer = stage.get(&stage.path("frame")).await;
    assert_eq!(answer.problem(504)["type"], "urn:relief:problem:timeout");
    assert!(!answer.headers.contains_key("retry-after"), "the same order would take as long again");
    stage.gate.open();
}

#[tokio::test]
async fn a_body_that_dawdles_is_given_up() {
    let config = Config { body_timeout: Duration::from_millis(30), ..Config::default() };
    let stage = Stage::with(config, QueueConfig::default());
    stage.post(&stage.path("frame"), "application/json", Body::new(NeverEnding)).await.problem(408);
}

/// A body whose next part never comes.
struct NeverEnding;

impl axum::body::HttpBody for NeverEnding {
    type Data = axum::body::Bytes;
    type Error = std::convert::Infallible;

    fn poll_frame(
        self: std::pin::Pin<&mut Self>,
        _: &mut std::task::Context<'_>,
    ) -> std::task::Poll<Option<Result<hyper::body::Frame<Self::Data>, Self::Error>>> {
        std::task::Poll::Pending
    }
}

#[tokio::test]
async fn foreign_names_and_foreign_pages_are_refused() {
    let names = vec!["localhost".to_owned(), "127.0.0.1".to_owned()];
    let hosts = Some(AllowedHosts { names, addresses: false });
    let stage = Stage::with(Config { allowed_hosts: hosts, ..Config::default() }, QueueConfig::default());
    for host in ["localhost", "LOCALHOST:8080", "127.0.0.1:1"] {
        assert_eq!(stage.get_with("/healthz", &[("host", host)]).await.status, 200, "{host}");
    }
    for host in ["rebound.example", "localhost.example:8080", "127.0.0.1.example", ""] {
        stage.get_with("/healthz", &[("host", host)]).await.problem(421);
    }
    stage.get("/healthz").await.problem(421);
    for (origin, status) in [
        ("http://localhost:8080", 200),
        ("http://localhost:9090", 403),
        ("https://attacker.example", 403),
        ("null", 403),
    ] {
        let request = Request::post(stage.path("frame"))
            .header("host", "localhost:8080")
            .header("origin", origin)
            .header("content-type", "application/json");
        let answer = stage.ask(request.body("{}".into()).unwrap()).await;
        assert_eq!(answer.status, status, "{origin}");
    }
}

#[tokio::test]
async fn a_request_id_is_kept_when_a_log_can_hold_it() {
    let stage = Stage::new();
    let kept = stage.get_with("/healthz", &[("x-request-id", "box-7.42")]).await;
    assert_eq!(kept.header("x-request-id"), "box-7.42");
    let long = "x".repeat(65);
    for bad in ["two words", "{}", long.as_str()] {
        let answer = stage.get_with("/healthz", &[("x-request-id", bad)]).await;
        assert!(answer.header("x-request-id") != bad && answer.header("x-request-id").len() > 8);
    }
    assert_eq!(json!(stage.get("/nope").await.problem(404)["status"]), 404);
}
