//! Time budgets over HTTP: reductions, their marks, and no reduction without a budget.
//!
//! The backend says that every picture took 2 ms, so that plans can be foreseen.

use serde_json::{Value, json};

use crate::server::stage::{Answer, Stage};

/// The settings that the answer names.
#[track_caller]
fn quality(answer: &Answer) -> Value {
    assert_eq!(answer.status, 200, "{}", answer.text());
    serde_json::from_str(answer.header("relief-quality")).unwrap()
}

fn size(answer: &Answer) -> [u32; 2] {
    let image = image::load_from_memory(&answer.body).unwrap();
    [image.width(), image.height()]
}

const SIZE: &str = "layout=color&size_px=400,200";

#[tokio::test]
async fn a_budget_reduces_by_the_speed_of_earlier_pictures_and_delivers_the_size() {
    let stage = Stage::new();
    let ask = |azimuth: u32, more: &str| format!("frame?{SIZE}&azimuth_deg={azimuth}{more}");
    // 2 ms for the whole picture.
    assert!(!stage.get(&stage.path(&ask(0, ""))).await.headers.contains_key("relief-quality"));
    for (budget, rays, reduced) in [
        ("2.1", [400, 200], false),
        ("1.9", [336, 168], true), // 0.84 of each side
        ("1.1", [284, 142], true), // 0.71
    ] {
        let stage = Stage::new();
        stage.get(&stage.path(&ask(0, ""))).await;
        let answer = stage.get(&stage.path(&ask(1, &format!("&budget_ms={budget}")))).await;
        let used = quality(&answer);
        assert_eq!((&used["rays_px"], &used["reduced"]), (&json!(rays), &json!(reduced)), "{budget}: {used}");
        assert_eq!(used["budget_ms"], budget.parse::<f64>().unwrap());
        assert!(used["expected_ms"].as_f64().unwrap() <= used["budget_ms"].as_f64().unwrap(), "{used}");
        assert_eq!(size(&answer), [400, 200]);
    }
}

/// Invariant: A time budget is kept by measured speed; a reduced picture has the requested size and
/// depths that were rendered; without a budget nothing is reduced.
#[tokio::test]
async fn a_tiny_budget_gives_the_least_and_none_the_whole() {
    let stage = Stage::new();
    let path = stage.path("frame?layout=color&size_px=2000,1600&sample_distance_mm=0.5");
    // Nothing is measured yet: a careful guess.
    let used = quality(&stage.get(&format!("{path}&budget_ms=1")).await);
    assert_eq!((&used["reduced"], &used["rays_px"]), (&json!(true), &json!([250, 200])));
    // From that of a moving picture, half of 10 mm.
    assert_eq!(used["sample_distance_mm"], 20.0);
    let whole = stage.get(&path).await;
    assert!(!whole.headers.contains_key("relief-quality"));
    assert!(whole.header("cache-control").contains("max-age"));
    assert_eq!(size(&whole), [2000, 1600]);
}

#[tokio::test]
async fn light_paths_lose_passes() {
    let stage = Stage::new();
    let body = json!({ "mode": "path-traced", "path_trace": { "passes": 1024 }, "size_px": [64, 48], "budget_ms": 20,
                       "display": { "layout": "color" } });
    let answer = stage.post(&stage.path("frame"), "application/json", body.to_string()).await;
    let used = quality(&answer);
    let passes = used["passes"].as_u64().unwrap();
    assert!((1..1024).contains(&passes) && used["reduced"] == true, "{used}");
}

#[tokio::test]
async fn budgeted_pictures_are_not_cached_and_name_their_quality() {
    let stage = Stage::new();
    let path = stage.path(&format!("frame?{SIZE}"));
    stage.get(&path).await;
    let first = stage.get(&format!("{path}&budget_ms=1.1&azimuth_deg=5")).await;
    assert_eq!(first.header("cache-control"), "private, no-cache");
    let tag = first.header("etag").to_owned();
    let headers = [("if-none-match", tag.as_str())];
    let renders = stage.gate.count();
    // 2 ms for the reduced picture were slow, so that the next plan is another one, with another
    // tag.
    let second = stage.get_with(&format!("{path}&budget_ms=1.1&azimuth_deg=5"), &headers).await;
    assert_eq!(second.status, 200);
    assert_ne!(second.header("etag"), tag);
    assert!(stage.gate.count() > renders);
    let tag = second.header("etag").to_owned();
    // With time enough both are the whole picture.
    let roomy = format!("{path}&budget_ms=1000&azimuth_deg=5");
    let whole = stage.get(&roomy).await;
    assert_eq!(quality(&whole)["reduced"], false);
    assert_ne!(whole.header("etag"), tag);
    let known = stage.get_with(&roomy, &[("if-none-match", whole.header("etag"))]).await;
    assert_eq!((known.status.as_u16(), known.header("cache-control")), (304, "private, no-cache"));
    let unhurried = stage.get(&format!("{path}&azimuth_deg=5")).await;
    assert!(unhurried.header("server-timing").contains("reused"), "the same request is the same frame");
    assert_eq!(unhurried.body, whole.body);
}

#[tokio::test]
async fn depth_slices_and_picks_have_budgets_and_wrong_ones_are_refused() {
    let stage = Stage::new();
    let depth = stage.get(&stage.path("depth?size_px=64,48&budget_ms=1000")).await;
    assert_eq!(quality(&depth)["rays_px"], json!([64, 48]));
    assert!(
        quality(&stage.get(&stage.path("slice?plane=axial&size_px=64,48&budget_ms=1000")).await)["reduced"]
            == false
    );
    let pick = stage.get(&stage.path("pick?u=32&v=24&size_px=64,48&budget_ms=1")).await;
    assert_eq!(pick.json()["hit"], true);
    for budget in ["0.5", "60001"] {
        let problem = stage.get(&stage.path(&format!("frame?budget_ms={budget}"))).await.problem(422);
        assert_eq!(problem["path"], "budget_ms");
        assert_eq!(problem["allowed"], "1 to 60000 ms");
        let body = format!(r#"{{"budget_ms": {budget}}}"#);
        let problem = stage.post(&stage.path("frame"), "application/json", body).await.problem(422);
        assert_eq!(problem["path"], "budget_ms");
    }
    assert_eq!(stage.get(&stage.path("frame?budget_ms=soon")).await.problem(400)["path"], "budget_ms");
    assert_eq!(stage.gate.count(), 3);
}
