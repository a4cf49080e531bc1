//! Thumbnails: one small picture of a volume for each preset, with tags, and refusals by name.

use relief_volume::PRESETS;
use serde_json::json;

use crate::server::stage::Stage;

fn path(stage: &Stage, name: &str) -> String {
    stage.path(&format!("presets/{name}/thumbnail"))
}

#[tokio::test]
async fn every_preset_has_a_thumbnail_with_a_tag_of_its_own() {
    let stage = Stage::new();
    let mut tags = std::collections::BTreeSet::new();
    for preset in PRESETS {
        let answer = stage.get(&path(&stage, preset.name)).await;
        assert_eq!(answer.status, 200, "{}", answer.text());
        assert_eq!(answer.header("content-type"), "image/png");
        assert!(answer.header("cache-control").starts_with("private, max-age="));
        let picture = image::load_from_memory(&answer.body).unwrap();
        assert_eq!([picture.width(), picture.height()], [160, 120]);
        tags.insert(answer.header("etag").to_owned());
    }
    assert_eq!(tags.len(), PRESETS.len());
    let jpeg = stage.get_with(&path(&stage, "bone"), &[("accept", "image/jpeg")]).await;
    assert_eq!(jpeg.header("content-type"), "image/jpeg");
    assert_eq!(stage.gate.count(), PRESETS.len(), "the JPEG is of the picture that is known");
}

#[tokio::test]
async fn a_known_thumbnail_is_answered_without_rendering() {
    let stage = Stage::new();
    let tag = stage.get(&path(&stage, "skin")).await.header("etag").to_owned();
    stage.service.shut_down();
    let again = stage.get_with(&path(&stage, "skin"), &[("if-none-match", &tag)]).await;
    assert_eq!((again.status.as_u16(), again.body.len()), (304, 0));
    stage.get_with(&path(&stage, "bone"), &[("if-none-match", &tag)]).await.problem(503);
}

#[tokio::test]
async fn invalid_thumbnail_requests_are_refused() {
    let stage = Stage::new();
    let unknown = stage.get(&path(&stage, "bones")).await.problem(404);
    assert!(unknown["detail"].as_str().unwrap().contains("bone, skin"), "{unknown}");
    stage.get("/v1/volumes/0000000000000000/presets/bone/thumbnail").await.problem(404);
    let extra = stage.get(&format!("{}?zoom=2", path(&stage, "bone"))).await.problem(400);
    assert_eq!(extra["path"], json!("zoom"));
    stage.get_with(&path(&stage, "bone"), &[("accept", "image/x-exr")]).await.problem(406);
    assert_eq!(stage.gate.count(), 0);
}

#[tokio::test]
async fn listed_presets_say_what_a_request_would() {
    let stage = Stage::new();
    let listed = stage.get("/v1/presets").await.json();
    for preset in listed["presets"].as_array().unwrap() {
        let pick = |key: &str| preset[key].clone();
        let mut spelt =
            json!({ "mode": pick("mode"), "transfer": pick("transfer"), "shading": pick("shading") });
        let mut named = json!({ "transfer": pick("name") });
        for scene in [&mut spelt, &mut named] {
            scene["size_px"] = json!([64, 48]);
            scene["display"] = json!({ "layout": "color" });
        }
        let [spelt, named] = [spelt, named].map(|scene| scene.to_string());
        let spelt = stage.post(&stage.path("frame"), "application/json", spelt).await;
        let named = stage.post(&stage.path("frame"), "application/json", named).await;
        assert_eq!(spelt.status, 200, "{}: {}", preset["name"], spelt.text());
        assert_eq!(spelt.header("etag"), named.header("etag"), "{}", preset["name"]);
    }
}
