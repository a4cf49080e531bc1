//! The phases of a series: their names and framing, and playing them in live views.

use axum::http::Method;
use relief_dicom::{Phase, SeriesIdentity};
use relief_server::Config;
use relief_session::{LoadedVolume, QueueConfig};
use relief_volume::Volume;
use serde_json::{Value, json};

use crate::server::annotations::point;
use crate::server::live_stage::{Came, Client, Running, intent};
use crate::server::stage::{Stage, cube};

const COUNT: usize = 3;

/// Adds the phases of a series to a server; gives their ids.
fn add_phases(stage: &Stage) -> Vec<String> {
    let phase = |number: usize| {
        let values = cube().voxels_hu().iter().map(|hu| hu + 100 * number as i16).collect();
        let volume = Volume::new(cube().grid().clone(), values).unwrap();
        let id = volume.content_hash().short();
        let identity = SeriesIdentity::new("1.2.6", "1.2.7").within_frame_of_reference("1.2.8");
        let identity = Some(identity.in_phase(Phase { number, count: COUNT }, 1));
        let (warnings, reference, labels) = (Vec::new(), None, None);
        stage.server.add_volume(LoadedVolume { volume, warnings, identity, reference, labels });
        id
    };
    (1..=COUNT).map(phase).collect()
}

/// Phases with equal voxels are volumes of their own: a resting organ is no missing phase.
#[tokio::test]
async fn equal_phases_stay_apart() {
    let stage = Stage::empty(Config::default(), QueueConfig::default());
    for number in [1, 2, 3] {
        let identity = SeriesIdentity::new("1.2.6", "1.2.7").in_phase(Phase { number, count: COUNT }, 1);
        let (warnings, reference, labels) = (Vec::new(), None, None);
        let identity = Some(identity);
        stage.server.add_volume(LoadedVolume { volume: cube(), warnings, identity, reference, labels });
    }
    let listed = stage.get("/v1/volumes").await.json();
    let volumes = listed["volumes"].as_array().unwrap();
    let numbers: Vec<_> = volumes.iter().map(|volume| volume["phase"]["number"].clone()).collect();
    assert_eq!(numbers, [1, 2, 3]);
    let ids: std::collections::BTreeSet<_> = volumes.iter().map(|volume| volume["id"].as_str()).collect();
    assert_eq!(ids.len(), COUNT);
}

/// The next state message; frames on the way are acknowledged.
async fn state(client: &mut Client) -> Value {
    client.event("state").await
}

/// The first state message of a view that shows a volume.
async fn state_of(client: &mut Client, id: &str) -> Value {
    loop {
        let state = state(client).await;
        if state["volume"] == id {
            return state;
        }
    }
}

#[tokio::test]
async fn phases_are_listed_with_their_number_and_framed_alike() {
    let stage = Stage::new();
    let ids = add_phases(&stage);
    let listed = stage.get("/v1/volumes").await.json();
    let volumes = listed["volumes"].as_array().unwrap();
    assert_eq!(volumes[0]["phase"], Value::Null, "no phase");
    for (number, id) in (1..).zip(&ids) {
        let volume = volumes.iter().find(|volume| volume["id"] == id.as_str()).unwrap();
        let expected = json!({ "number": number, "count": COUNT, "series": ids[0] });
        assert_eq!(volume["phase"], expected);
        assert!(volume["name"].as_str().unwrap().ends_with(&format!(", phase {number} of 3")), "{volume}");
        assert_eq!(volume["framing"], volumes[1]["framing"]);
        assert_eq!(volume["anatomy"], volumes[1]["anatomy"]);
    }
}

#[tokio::test]
async fn phases_play_from_where_the_view_is_until_they_are_stopped() {
    let running = Running::new().await;
    let ids = add_phases(&running.stage);
    let settings = json!({ "play": { "phases_per_s": 20 } });
    let (mut client, _) = running.hello(json!({ "volume": ids[0], "settings": settings })).await;
    client.send(&intent(1, json!({ "intent": "orbit", "azimuth_deg": 40 }))).await;
    let turned = loop {
        let state = state(&mut client).await;
        if state["state"]["undo"] == 1 {
            break state;
        }
    };
    let mut seen: Vec<usize> = Vec::new();
    // A busy machine leaves phases out.
    while ids.iter().enumerate().any(|(at, _)| !seen.contains(&at)) || seen.len() < 7 {
        let state = state(&mut client).await;
        assert_eq!(state["phases_per_s"], 20.0, "{state}");
        for key in ["look_at_mm", "orientation_xyzw", "zoom", "preset"] {
            assert_eq!(state["state"][key], turned["state"][key], "{key}");
        }
        let at = ids.iter().position(|id| state["volume"] == id.as_str()).expect("a phase");
        if seen.last() != Some(&at) {
            seen.push(at);
        }
    }
    client.send(&json!({ "type": "settings", "play": false, "phase": 2 })).await;
    let stopped = loop {
        let state = state_of(&mut client, &ids[1]).await;
        if state.get("phases_per_s").is_none() {
            break state;
        }
    };
    assert_eq!(stopped["state"]["orientation_xyzw"], turned["state"]["orientation_xyzw"]);
    assert_eq!(stopped["state"]["undo"], 1, "another phase is no other view");
}

#[tokio::test]
async fn phases_that_are_not_there_are_refused_with_those_that_are() {
    let running = Running::new().await;
    let ids = add_phases(&running.stage);
    let refused = |message: Value| {
        let (running, id) = (&running, ids[0].clone());
        async move {
            let (mut client, _) = running.hello(json!({ "volume": id })).await;
            client.send(&message).await;
            loop {
                match client.next().await {
                    Came::Text(message) if message["type"] == "error" => return message["problem"].clone(),
                    Came::Text(_) => {}
                    Came::Frame(frame) => client.ack(&frame).await,
                    Came::Closed(code) => panic!("closed with {code:?}"),
                }
            }
        }
    };
    let problem = refused(json!({ "type": "settings", "phase": 9 })).await;
    assert_eq!(
        (&problem["path"], &problem["allowed"]),
        (&json!("settings.phase"), &json!("1, 2, 3")),
        "{problem}"
    );
    let other = running.stage.id.clone();
    let play = json!({ "phases_per_s": 10 });
    let problem = refused(json!({ "type": "settings", "volume": other, "play": play })).await;
    assert_eq!(problem["path"], "settings.play", "{problem}");
    let problem = refused(json!({ "type": "settings", "play": { "phases_per_s": 1000 } })).await;
    assert!(problem.to_string().contains("0.1 to 60"), "{problem}");
}

/// Invariant: An annotation names the phase in which it was placed, and is drawn, exported and
/// grabbed in that phase only.
#[tokio::test]
async fn annotations_belong_to_the_phase_in_which_they_were_placed() {
    let mut stage = Stage::annotated().await;
    let ids = add_phases(&stage);
    stage.id.clone_from(&ids[1]);
    let made = stage.create("anna", json!([point("apex", [0.0; 3])])).await;
    let drawn = async |stage: &mut Stage, id: &String| {
        stage.id.clone_from(id);
        let frame = stage.get(&stage.path("frame?layout=color&annotations=true")).await;
        assert_eq!(frame.status, 200, "{}", frame.text());
        stage.gate.labels()
    };
    assert_eq!(drawn(&mut stage, &ids[1]).await, ["apex"]);
    assert!(drawn(&mut stage, &ids[2]).await.is_empty());
    let list = stage.annotate(Method::GET, "", "anna", Value::Null).await.json();
    assert_eq!(list["items"][0]["item"]["phase"], 2, "all phases list it: {list}");
    // Renaming leaves it there; moving it in another phase takes it along.
    let mut item = list["items"][0]["item"].clone();
    item["name"] = json!("tip");
    let update = |item: &Value, version: u64| json!({ "changes": [{ "change": "update", "version": version, "item": item }] });
    let renamed = stage.annotate(Method::POST, "", "anna", update(&item, 1)).await;
    assert_eq!(renamed.status, 201, "{}", renamed.text());
    assert_eq!(renamed.json()["events"][0]["item"]["phase"], 2);
    item["geometry"]["at_mm"] = json!([1.0, 0.0, 0.0]);
    let moved = stage.annotate(Method::POST, "", "anna", update(&item, 2)).await;
    assert_eq!(moved.json()["events"][0]["item"]["phase"], 3, "{}", moved.text());
    assert_eq!(made.len(), 1);
    assert_eq!(drawn(&mut stage, &ids[2]).await, ["tip"]);
    // Exports hold what the phase shows, and say what they leave out.
    let also = stage.create("anna", json!([point("base", [0.0; 3])])).await;
    let exported = stage.annotate(Method::GET, "/export?format=mrk.json", "anna", Value::Null).await;
    assert!(exported.text().contains("base") && exported.text().contains("tip"), "one phase");
    stage.id.clone_from(&ids[0]);
    let none = stage.annotate(Method::GET, "/export?format=mrk.json", "anna", Value::Null).await;
    assert_eq!((none.status.as_u16(), also.len()), (422, 1));
    assert!(none.text().contains("other phases"), "{}", none.text());
}

#[tokio::test]
async fn landmarks_of_other_phases_are_not_grabbed() {
    let running = Running::annotated().await;
    let ids = add_phases(&running.stage);
    let settings = json!({ "annotations": "s" });
    let hello = json!({ "volume": ids[0], "view": "theatre", "author": "anna", "settings": settings });
    let (mut client, _) = running.hello(hello).await;
    let mut seq = 0;
    let mut edit = async |client: &mut Client, phase: &str, point_mm: [f64; 3]| {
        for value in [
            json!({ "intent": "cursor", "point_mm": point_mm }),
            json!({ "intent": "place", "phase": phase }),
        ] {
            seq += 1;
            client.send(&intent(seq, value)).await;
        }
    };
    let made = async |client: &mut Client| loop {
        let event = client.event("annotations").await["events"][0].clone();
        if event.is_object() {
            return event;
        }
    };
    edit(&mut client, "commit", [1.0, 2.0, 3.0]).await;
    let placed = made(&mut client).await;
    assert_eq!(placed["item"]["phase"], 1, "{placed}");
    // Dragging from its place makes a new point in another phase, and moves it in its own.
    for (at, version) in [(1, 1), (0, 2)] {
        client.send(&json!({ "type": "settings", "volume": ids[at] })).await;
        state_of(&mut client, &ids[at]).await;
        edit(&mut client, "take", [1.0, 2.0, 3.0]).await;
        edit(&mut client, "commit", [-9.0, 2.0, 3.0]).await;
        let event = made(&mut client).await;
        assert_eq!(
            (&event["version"], &event["item"]["phase"]),
            (&json!(version), &json!(at + 1)),
            "{event}"
        );
        assert_eq!(event["id"] == placed["id"], version == 2, "{event}");
    }
}
