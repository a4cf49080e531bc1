//! Regions and meshes over HTTP: grown, painted, filled, made into a mesh, drawn, and refused.

use axum::body::Body;
use axum::http::{Method, Request};
use relief_render::OverlayItem;
use relief_server::Config;
use serde_json::{Value, json};

use crate::server::stage::{Answer, Stage};

async fn make(stage: &Stage, part: &str, body: Value) -> Answer {
    stage.annotate(Method::POST, part, "anna", body).await
}

/// The item that an answer's event made.
#[track_caller]
fn made(answer: &Answer) -> Value {
    assert_eq!(answer.status, 201, "{}", answer.text());
    answer.json()["events"][0]["item"].clone()
}

/// A log whose regions and meshes have as many bytes as allowed takes no more of them, from any route.
#[tokio::test]
async fn regions_and_meshes_beyond_the_limit_are_refused() {
    let seed = json!({ "seed_mm": [5.0, 5.0, 5.0], "hu": [0, 63], "name": "all" });
    let roomy = Stage::annotated().await;
    let region = made(&make(&roomy, "/grow", seed.clone()).await);
    let content = region["geometry"]["content"].as_str().unwrap();
    let bytes = roomy.get(&roomy.path(&format!("annotations/contents/{content}"))).await.body.len() as u64;

    let stage = Stage::annotated_with(Config { content_bytes: bytes, ..Config::default() }).await;
    let region = made(&make(&stage, "/grow", seed.clone()).await);
    let mut again = seed;
    again["hu"] = json!([1, 63]);
    for (part, body) in [("/grow", again), ("/mesh", json!({ "region": region["id"] }))] {
        let problem = make(&stage, part, body).await.problem(507);
        assert_eq!(
            (&problem["type"], &problem["allowed"]),
            (&json!("urn:relief:problem:contents-full"), &json!(bytes)),
            "{part}"
        );
    }
    let file = stage.get(&stage.path(&format!("annotations/contents/{content}"))).await;
    let path = stage.path("annotations/import?format=seg.nrrd&set=copies&duplicate=true");
    let import = Request::post(path)
        .header("content-type", "application/octet-stream")
        .header("relief-author", "anna")
        .body(Body::from(file.body))
        .unwrap();
    stage.ask(import).await.problem(507);
    let list = stage.annotate(Method::GET, "", "", Value::Null).await.json();
    assert_eq!(list["seq"], 1, "nothing of what was refused is in the log");
}

/// Invariant: Regions grow within their limits, are painted, filled and meshed over HTTP, and are
/// drawn as surfaces and outlines.
#[tokio::test]
async fn a_region_grows_within_its_limits_and_becomes_a_mesh() {
    let stage = Stage::annotated().await;
    // 64 voxels of 1 ml each, whose values are 0 to 63.
    let seed = json!({ "seed_mm": [5.0, 5.0, 5.0], "hu": [0, 63], "name": "all", "set": "s" });
    let mut preview = seed.clone();
    preview["preview"] = true.into();
    let preview = make(&stage, "/grow", preview).await;
    assert_eq!(
        (preview.status.as_u16(), &preview.json()["volume_ml"]),
        (200, &json!(64.0)),
        "{}",
        preview.text()
    );
    let list = stage.annotate(Method::GET, "", "", Value::Null).await.json();
    assert_eq!(list["seq"], 0, "a preview makes nothing");
    let mut small = seed.clone();
    small["max_ml"] = 10.into();
    let leaked = make(&stage, "/grow", small).await.problem(422);
    assert_eq!((&leaked["type"], &leaked["allowed_ml"]), (&json!("urn:relief:problem:leaked"), &json!(10.0)));
    assert!(leaked["reached_ml"].as_f64().unwrap() > 10.0, "{leaked}");

    let region = made(&make(&stage, "/grow", seed).await);
    assert_eq!(
        (&region["name"], &region["set"], &region["state"]),
        (&json!("all"), &json!("s"), &json!("defined"))
    );
    assert_eq!((&region["geometry"]["voxels"], &region["geometry"]["volume_ml"]), (&json!(64), &json!(64.0)));
    let content = region["geometry"]["content"].as_str().unwrap();
    let file = stage.get(&stage.path(&format!("annotations/contents/{content}"))).await;
    assert!(file.status == 200 && file.body.starts_with(b"NRRD"), "a .seg.nrrd file");
    let previewed =
        data_encoding::BASE64.decode(preview.json()["content"].as_str().unwrap().as_bytes()).unwrap();
    assert!(previewed == file.body && preview.json()["label"] == 1, "the preview shows what is made");

    let wanted = json!({ "region": region["id"], "smoothing": 0, "name": "surface" });
    let mesh = made(&make(&stage, "/mesh", wanted).await);
    let volume = mesh["geometry"]["volume_ml"].as_f64().unwrap();
    assert!((50.0..=64.0).contains(&volume), "closed, its edges beveled: {volume}");
    let content = mesh["geometry"]["content"].as_str().unwrap();
    let file = stage.get(&stage.path(&format!("annotations/contents/{content}"))).await;
    assert!(file.body.starts_with(b"ply"), "a PLY file");

    // Both are drawn: as surfaces in a view, as outlines in a slice.
    let answer = stage.get(&stage.path("frame?layout=color&annotations=true")).await;
    assert_eq!(answer.header("relief-annotations"), "drawn=2, left_out=0");
    let count = |wanted: fn(&OverlayItem) -> bool| {
        let last = stage.gate.last.lock().unwrap();
        last.as_ref().unwrap().overlays.items.iter().filter(|item| wanted(item)).count()
    };
    assert_eq!(count(|item| matches!(item, OverlayItem::Mesh(_))), 2);
    let answer = stage.get(&stage.path("slice?plane=coronal&annotations=true")).await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    assert_eq!(count(|item| matches!(item, OverlayItem::Curve(curve) if curve.points.len() > 8)), 2);
    assert_eq!(count(|item| matches!(item, OverlayItem::Mesh(_))), 0);
}

#[tokio::test]
async fn a_region_is_painted_and_erased_in_one_item() {
    let stage = Stage::annotated().await;
    let ball = |mode: &str, region: Value, version: Value| json!({ "center_mm": [5, 5, 5], "radius_mm": 30, "mode": mode, "region": region, "version": version });
    let region = made(&make(&stage, "/paint", ball("add", Value::Null, Value::Null)).await);
    let painted = region["geometry"]["volume_ml"].as_f64().unwrap();
    assert!(painted > 8.0, "{painted}");
    let mut smaller = ball("erase", region["id"].clone(), 1.into());
    smaller["radius_mm"] = 12.into();
    let erased = make(&stage, "/paint", smaller.clone()).await;
    let less = made(&erased)["geometry"]["volume_ml"].as_f64().unwrap();
    assert!(less < painted, "{less} of {painted}");
    assert_eq!(erased.json()["events"][0]["version"], 2);
    let conflict = make(&stage, "/paint", smaller).await.problem(409);
    assert_eq!(conflict["current"]["version"], 2);
    let back = stage.annotate(Method::POST, "/undo", "anna", Value::Null).await.json();
    assert_eq!(back["events"][0]["item"]["geometry"]["volume_ml"], painted);
    let nothing = make(&stage, "/paint", ball("erase", Value::Null, Value::Null)).await.problem(422);
    assert_eq!(nothing["type"], "urn:relief:problem:nothing-there");
}

#[tokio::test]
async fn curves_on_levels_are_filled() {
    let stage = Stage::annotated().await;
    let square = |z: f64| {
        let points = [[-10.0, -10.0, z], [10.0, -10.0, z], [10.0, 10.0, z], [-10.0, 10.0, z]];
        json!({ "name": "c", "geometry": { "kind": "curve", "closed": true, "points_mm": points } })
    };
    let open = json!({ "name": "o", "geometry": { "kind": "curve", "points_mm": [[0, 0, 0], [1, 1, 1]] } });
    let ids = stage.create("anna", json!([square(-15.0), square(-5.0), square(5.0), open])).await;
    let region = made(&make(&stage, "/fill", json!({ "curves": ids[..3], "name": "box" })).await);
    let volume = region["geometry"]["volume_ml"].as_f64().unwrap();
    assert!((8.0..=16.0).contains(&volume), "20 x 20 mm on three levels: {volume}");
    let problem = make(&stage, "/fill", json!({ "curves": [ids[3]] })).await.problem(422);
    assert_eq!(problem["path"], "curves");
    make(&stage, "/fill", json!({ "curves": [] })).await.problem(422);
    let problem = make(&stage, "/mesh", json!({ "region": ids[0] })).await.problem(422);
    assert_eq!(problem["path"], "region");
    for (body, status) in [
        (json!({ "seed_mm": [500, 0, 0], "hu": [0, 63] }), 422),
        (json!({ "seed_mm": [5, 5, 5], "hu": [0, 1] }), 422),
        (json!({ "seed_mm": [5, 5, 5] }), 400),
    ] {
        make(&stage, "/grow", body).await.problem(status);
    }
}

#[tokio::test]
async fn a_region_is_refined_in_one_edit_or_stays() {
    let stage = Stage::annotated().await;
    let seed = json!({ "seed_mm": [5.0, 5.0, 5.0], "hu": [0, 63], "name": "all", "set": "s" });
    let region = made(&make(&stage, "/grow", seed).await);
    // A hole, and a part of its own: voxels of 10 mm, of which a small ball takes one.
    let hole =
        json!({ "region": region["id"], "center_mm": [5.0, 5.0, 5.0], "radius_mm": 1.0, "mode": "erase" });
    let painted = made(&make(&stage, "/paint", hole).await);
    assert_eq!(painted["geometry"]["voxels"], 63);
    let refine =
        async |step: &str| make(&stage, "/refine", json!({ "region": region["id"], "step": step })).await;
    assert_eq!(made(&refine("fill-holes").await)["geometry"]["voxels"], 64);
    let same = refine("keep-largest").await;
    assert_eq!((same.status.as_u16(), same.json()["events"].as_array().unwrap().len()), (200, 0));
    refine("sharpen").await.problem(400);
    let other = json!({ "region": "00000000-0000-4000-8000-000000000000", "step": "smooth" });
    assert!(make(&stage, "/refine", other).await.status.is_client_error());
}
