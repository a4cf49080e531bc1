//! Volumes of other quantities than HU: volume descriptions and picks name the unit, and no HU preset
//! is chosen.

use relief_server::Config;
use relief_session::{LoadedVolume, QueueConfig};
use relief_volume::{Quantity, Volume};
use serde_json::{Value, json};

use crate::server::live_stage::Running;
use crate::server::stage::{Stage, cube};

/// Adds the cube as a map of iodine; gives its id.
fn add_iodine(stage: &Stage) -> String {
    let voxels = cube().voxels_hu().iter().map(|value| value + 1).collect();
    let volume = Volume::new(cube().grid().clone(), voxels).unwrap().of_quantity(Quantity::Concentration);
    let id = volume.content_hash().short();
    let (warnings, reference, labels) = (Vec::new(), None, None);
    stage.server.add_volume(LoadedVolume { volume, warnings, identity: None, reference, labels });
    id
}

/// Invariant: Volumes of other quantities than HU get no HU preset and no HU window by default.
#[tokio::test]
async fn volumes_name_their_unit_and_choose_no_preset() {
    let mut stage = Stage::empty(Config::default(), QueueConfig::default());
    stage.id = add_iodine(&stage);
    let shown = stage.get(stage.path("").trim_end_matches('/')).await.json();
    let range = shown["hu_range"].as_array().unwrap();
    let [low, high] = [&range[0], &range[1]].map(|value| value.as_f64().unwrap());
    assert_eq!((&shown["unit"], &shown["anatomy"]["preset"]), (&json!("MGML"), &Value::Null));
    assert_eq!(shown["anatomy"]["window_hu"], json!([(low + high) / 2.0, high - low]));
    assert!(shown["name"].as_str().unwrap().starts_with("Object (MGML), "), "{shown}");
    let pick = stage.get(&stage.path("pick?u=8&v=8&size_px=16,16&layout=color")).await;
    assert_eq!(pick.json()["unit"], "MGML", "{}", pick.text());
    for query in ["size_px=16,16&layout=color", "size_px=16,16&layout=color&preset=bone"] {
        let frame = stage.get(&stage.path(&format!("frame?{query}"))).await;
        assert_eq!(frame.status, 200, "{}", frame.text());
    }
}

#[tokio::test]
async fn live_views_show_all_values_until_a_preset_is_chosen() {
    let running = Running::new().await;
    let id = add_iodine(&running.stage);
    let (mut client, _) = running.hello(json!({ "volume": id })).await;
    let state = client.event("state").await;
    assert_eq!((&state["volume"], &state["state"]["preset"]), (&json!(id), &Value::Null), "{state}");
    for (settings, preset) in [
        (json!({ "preset": "bone" }), json!("bone")),
        (json!({ "scene": { "transfer": null } }), Value::Null),
        // Of another volume, the preset that suits it.
        (json!({ "volume": running.stage.id }), json!("skin")),
        (json!({ "volume": id }), Value::Null),
    ] {
        let mut message = settings.clone();
        message["type"] = json!("settings");
        client.send(&message).await;
        while client.event("state").await["state"]["preset"] != preset {}
    }
}
