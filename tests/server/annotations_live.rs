//! Annotations in live sessions: events to all clients of the volume, landmarks by hand, and undo.

use std::time::Duration;

use axum::http::Method;
use serde_json::{Value, json};

use crate::server::annotations::point;
use crate::server::live_stage::{Came, Client, Running, intent, orbit};

/// The next message with events.
async fn reported(client: &mut Client) -> Value {
    loop {
        let message = client.event("annotations").await;
        if message["events"].as_array().is_some_and(|events| !events.is_empty()) {
            return message;
        }
    }
}

/// The item that a client places next.
async fn next(client: &mut Client) -> Value {
    loop {
        let message = client.event("annotations").await;
        if !message["next"].is_null() {
            return message["next"].clone();
        }
    }
}

async fn place(client: &mut Client, seq: u64, at_mm: [f64; 3]) {
    client.send(&intent(seq, json!({ "intent": "cursor", "point_mm": at_mm }))).await;
    client.send(&intent(seq + 1, json!({ "intent": "place", "phase": "preview" }))).await;
    client.send(&intent(seq + 2, json!({ "intent": "place", "phase": "commit" }))).await;
}

fn annotating(view: &str, author: &str, sets: &str) -> Value {
    json!({ "view": view, "author": author, "settings": { "annotations": sets } })
}

/// Invariant: Live viewers are notified of every edit in the order of the log, from any server of
/// the log; a server that loses its connection catches up.
#[tokio::test]
async fn two_clients_see_one_anothers_landmarks_at_once() {
    let running = Running::annotated().await;
    let (mut anna, _) = running.hello(annotating("theatre", "anna", "s")).await;
    let (mut ben, _) = running.hello(annotating("other", "ben", "true")).await;
    place(&mut anna, 1, [1.0, 2.0, 3.0]).await;
    let heard = [reported(&mut anna).await, reported(&mut ben).await];
    assert_eq!(heard[0]["events"], heard[1]["events"]);
    let event = &heard[0]["events"][0];
    assert_eq!((&heard[0]["seq"], &event["author"], &event["set"]), (&json!(1), &json!("anna"), &json!("s")));
    let item = &event["item"];
    assert_eq!(item["name"], "1");
    assert_eq!(item["geometry"], json!({ "kind": "point", "at_mm": [1.0, 2.0, 3.0] }));
    assert!(item.get("frame_of_reference").is_none(), "{item}");
    let placement = &item["placement"];
    assert_eq!((&placement["method"], &placement["device"]["kind"]), (&json!("typed"), &json!("pointer")));
    assert!(placement["camera"]["vertical_fov_deg"].is_number(), "{placement}");
    // Both pictures have it.
    ben.still(0).await;
    while !running.stage.gate.labels().contains(&"1".to_owned()) {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    // An edit over HTTP is pushed in the same way.
    running.stage.create("cleo", json!([point("nasion", [0.0; 3])])).await;
    for client in [&mut anna, &mut ben] {
        assert_eq!(reported(client).await["events"][0]["item"]["name"], "nasion");
    }
    // The number goes on.
    place(&mut ben, 1, [4.0, 0.0, 0.0]).await;
    let event = reported(&mut anna).await["events"][0].clone();
    assert_eq!(
        (&event["item"]["name"], &event["set"]),
        (&json!("1"), &json!("default")),
        "in a set of its own"
    );
    place(&mut anna, 10, [5.0, 0.0, 0.0]).await;
    assert_eq!(reported(&mut ben).await["events"][0]["item"]["name"], "1", "its own, before anna's");
    assert_eq!(reported(&mut ben).await["events"][0]["item"]["name"], "2");
}

#[tokio::test]
async fn a_template_is_placed_in_its_order_and_labels_can_be_passed_over() {
    let running = Running::annotated().await;
    let stage = &running.stage;
    let items = json!([{ "name": "nasion" }, { "name": "width", "kind": "line" }, { "name": "menton" }, { "name": "gonion" }]);
    stage.annotate(Method::PUT, "/templates/skull", "chief", json!({ "items": items })).await;
    stage.annotate(Method::POST, "/templates/skull/apply?set=s", "chief", Value::Null).await;
    let (mut anna, _) = running.hello(json!({ "author": "anna" })).await;
    anna.send(&json!({ "type": "settings", "annotations": ["s"] })).await;
    assert_eq!(next(&mut anna).await["name"], "nasion");
    anna.send(&intent(1, json!({ "intent": "next_label" }))).await;
    assert_eq!(next(&mut anna).await["name"], "menton", "a line is no landmark");
    place(&mut anna, 2, [1.0, 0.0, 0.0]).await;
    let after = next(&mut anna).await;
    assert_eq!((&after["set"], &after["name"]), (&json!("s"), &json!("gonion")));
    anna.send(&intent(9, json!({ "intent": "next_label" }))).await;
    assert_eq!(next(&mut anna).await["name"], "nasion", "around");
    for seq in [10, 20] {
        place(&mut anna, seq, [2.0, 0.0, 0.0]).await;
        next(&mut anna).await;
    }
    let list = stage.annotate(Method::GET, "?set=s", "", Value::Null).await.json();
    let state = |name: &str| {
        let items = list["items"].as_array().unwrap();
        items.iter().find(|known| known["item"]["name"] == name).unwrap()["item"]["state"].clone()
    };
    assert_eq!(
        ["nasion", "width", "menton", "gonion"].map(state),
        ["defined", "missing", "defined", "defined"]
    );
    place(&mut anna, 30, [3.0, 0.0, 0.0]).await;
    let number = next(&mut anna).await;
    assert_eq!((&number["name"], &number["id"]), (&json!("2"), &Value::Null), "then points with numbers");
}

#[tokio::test]
async fn undo_takes_back_the_authors_edit_while_annotations_are_drawn() {
    let running = Running::annotated().await;
    let (mut anna, _) = running.hello(annotating("theatre", "anna", "true")).await;
    let (mut ben, _) = running.hello(json!({ "view": "theatre", "author": "ben" })).await;
    anna.send(&intent(1, json!({ "intent": "orbit", "azimuth_deg": 30 }))).await;
    let eye = anna.still(1).await.header.eye_mm;
    place(&mut anna, 2, [1.0, 0.0, 0.0]).await;
    reported(&mut ben).await;
    anna.send(&intent(9, json!({ "intent": "undo" }))).await;
    let undone = reported(&mut ben).await;
    assert_eq!((&undone["events"][0]["kind"], &undone["events"][0]["item"]), (&json!("undo"), &Value::Null));
    ben.send(&intent(1, json!({ "intent": "undo" }))).await;
    let refused = ben.event("error").await;
    assert_eq!(refused["problem"]["type"], "urn:relief:problem:nothing-to-undo", "each author their own");
    assert_eq!(refused["fatal"], false);
    anna.send(&json!({ "type": "settings", "annotations": false })).await;
    anna.send(&intent(11, json!({ "intent": "undo" }))).await;
    let back = anna.still(11).await.header.eye_mm;
    assert_ne!(eye, back, "the view's last change, now that none are drawn");
}

/// Invariant: Live viewers are notified of every edit in the order of the log, from any server of
/// the log; a server that loses its connection catches up.
#[tokio::test]
async fn blinded_readers_are_notified_of_their_own_set_only() {
    let running = Running::annotated().await;
    for (set, reader) in [("a", "anna"), ("b", "ben")] {
        let body = json!({ "reader": reader, "blinded": true });
        running.stage.annotate(Method::PUT, &format!("/sets/{set}"), "chief", body).await;
    }
    let (mut anna, _) = running.hello(annotating("va", "anna", "true")).await;
    let (mut ben, _) = running.hello(annotating("vb", "ben", "true")).await;
    let (mut nobody, _) = running.hello(json!({ "view": "vc" })).await;
    place(&mut anna, 1, [1.0, 0.0, 0.0]).await;
    assert_eq!(reported(&mut anna).await["events"][0]["set"], "a", "into their own");
    place(&mut ben, 1, [2.0, 0.0, 0.0]).await;
    assert_eq!(reported(&mut ben).await["events"][0]["set"], "b", "the first that is heard");
    running.stage.create("chief", json!([point("open", [0.0; 3])])).await;
    assert_eq!(reported(&mut nobody).await["events"][0]["item"]["name"], "open", "the first that is heard");
}

#[tokio::test]
async fn placing_needs_an_author_and_a_log() {
    let running = Running::annotated().await;
    let (mut client, _) = running.hello(json!({ "settings": { "annotations": true } })).await;
    place(&mut client, 1, [1.0, 0.0, 0.0]).await;
    let refused = client.event("error").await;
    assert_eq!(refused["problem"]["type"], "urn:relief:problem:no-author");
    client.send(&orbit(9, 3.0)).await;
    client.still(9).await; // the session goes on
    client.send(&json!({ "type": "settings", "scene": { "annotations": true } })).await;
    assert_eq!(client.event("error").await["problem"]["path"], "scene.annotations");
    let bare = Running::new().await;
    let (mut client, _) = bare.hello(json!({})).await;
    client.send(&json!({ "type": "settings", "annotations": true })).await;
    assert_eq!(client.event("error").await["problem"]["type"], "urn:relief:problem:annotations-off");
    // Without annotations a placed point belongs to the view only.
    place(&mut client, 1, [1.0, 0.0, 0.0]).await;
    client.still(3).await;
}

#[tokio::test]
async fn a_tracked_hand_leaves_its_pose_in_the_record() {
    let running = Running::annotated().await;
    let (mut anna, _) = running.hello(annotating("theatre", "anna", "s")).await;
    let pose = |seq: u64, buttons: Value| {
        json!({ "type": "pose", "seq": seq, "t_ns": seq * 20_000_000, "state": "tracking",
            "position_mm": [12.5, -30, 1480], "orientation_xyzw": [0, 0, 0, 1], "buttons": buttons })
    };
    for (seq, buttons) in
        [(1, json!([])), (2, json!([])), (3, json!(["a"])), (4, json!(["a"])), (5, json!([]))]
    {
        anna.send(&pose(seq, buttons)).await;
    }
    let item = reported(&mut anna).await["events"][0]["item"].clone();
    let device = &item["placement"]["device"];
    assert_eq!((&device["kind"], &device["position_mm"][2]), (&json!("wiimote"), &json!(1480.0)));
    assert_eq!(item["placement"]["method"], "tip");
}

/// The next event and the next `next` message, in any order.
async fn made(client: &mut Client) -> (Value, Value) {
    let (mut event, mut next) = (Value::Null, Value::Null);
    while event.is_null() || next.is_null() {
        let message = client.event("annotations").await;
        if message["next"].is_object() {
            next = message["next"].clone();
        } else {
            event = message["events"][0].clone();
        }
    }
    (event, next)
}

fn lead(seq: u64, at_mm: [f64; 3]) -> Value {
    intent(seq, json!({ "intent": "cursor", "point_mm": at_mm }))
}

fn phase(seq: u64, phase: &str) -> Value {
    intent(seq, json!({ "intent": "place", "phase": phase }))
}

/// Invariant: Moving a point is one edit that can be undone, and it never overwrites a change of
/// another author.
#[tokio::test]
async fn a_landmark_is_taken_hold_of_and_moved() {
    let running = Running::annotated().await;
    let (mut anna, _) = running.hello(annotating("theatre", "anna", "s")).await;
    assert_eq!(next(&mut anna).await["name"], "1");
    place(&mut anna, 1, [1.0, 2.0, 3.0]).await;
    let (event, after) = made(&mut anna).await;
    let item = event["item"].clone();
    assert_eq!(after["name"], "2");
    // Somewhat beside it: it keeps its distance from the cursor.
    anna.send(&lead(10, [1.5, 2.0, 3.0])).await;
    anna.send(&phase(11, "take")).await;
    let held = next(&mut anna).await;
    assert_eq!((&held["id"], &held["name"], &held["set"]), (&item["id"], &json!("1"), &json!("s")));
    // The picture shows it going along.
    anna.send(&lead(12, [11.5, 2.0, 3.0])).await;
    anna.still(12).await;
    let labels = running.stage.gate.labels();
    let count = labels.iter().filter(|label| *label == "1").count();
    assert_eq!(count, 2, "where it was and where it is: {labels:?}");
    anna.send(&phase(13, "commit")).await;
    let (event, after) = made(&mut anna).await;
    assert_eq!((&event["id"], &event["version"], &event["author"]), (&item["id"], &json!(2), &json!("anna")));
    assert_eq!(event["item"]["geometry"], json!({ "kind": "point", "at_mm": [11.0, 2.0, 3.0] }));
    assert_eq!(after["name"], "2", "then the next again");
    anna.send(&intent(14, json!({ "intent": "undo" }))).await;
    let (event, _) = made(&mut anna).await;
    assert_eq!(event["item"]["geometry"]["at_mm"], json!([1.0, 2.0, 3.0]), "as it was");
    // Cancelled, or not moved at all: nothing happens.
    for (seq, end) in [(20, "cancel"), (30, "commit")] {
        anna.send(&lead(seq, [1.0, 2.0, 3.0])).await;
        anna.send(&phase(seq + 1, "take")).await;
        assert_eq!(next(&mut anna).await["id"], item["id"]);
        anna.send(&phase(seq + 2, end)).await;
        assert_eq!(next(&mut anna).await["name"], "2", "{end}");
    }
    // Far from everything something new is set down.
    anna.send(&lead(40, [-20.0, 0.0, 0.0])).await;
    anna.send(&phase(41, "take")).await;
    assert_eq!(next(&mut anna).await["id"], Value::Null);
    anna.send(&phase(42, "commit")).await;
    let (event, _) = made(&mut anna).await;
    assert_eq!((&event["version"], &event["item"]["name"]), (&json!(1), &json!("2")));
    assert_eq!(event["seq"], 4, "place, move, undo, place");
}

/// Invariant: Moving a point is one edit that can be undone, and it never overwrites a change of
/// another author.
#[tokio::test]
async fn a_move_does_not_overwrite_the_change_of_another_author() {
    let running = Running::annotated().await;
    let (mut anna, _) = running.hello(annotating("theatre", "anna", "s")).await;
    let (mut ben, _) = running.hello(annotating("other", "ben", "s")).await;
    place(&mut anna, 1, [1.0, 2.0, 3.0]).await;
    // Events and `next` messages come in any order: anna's own event must not be taken for a later
    // one.
    made(&mut anna).await;
    let item = reported(&mut ben).await["events"][0]["item"].clone();
    for (client, to) in [(&mut anna, [9.0, 2.0, 3.0]), (&mut ben, [1.0, 9.0, 3.0])] {
        client.send(&lead(10, [1.0, 2.0, 3.0])).await;
        client.send(&phase(11, "take")).await;
        while next(client).await["id"] != item["id"] {}
        client.send(&lead(12, to)).await;
    }
    anna.send(&phase(13, "commit")).await;
    let (moved, _) = made(&mut anna).await;
    assert_eq!((&moved["version"], &moved["item"]["geometry"]["at_mm"][0]), (&json!(2), &json!(9.0)));
    ben.send(&phase(13, "commit")).await;
    let refused = ben.event("error").await;
    assert_eq!(refused["problem"]["status"], 409, "{refused}");
    // Locked, it cannot be taken hold of.
    let mut locked = moved["item"].clone();
    locked["locked"] = true.into();
    let path = running.stage.path(&format!("annotations/{}", locked["id"].as_str().unwrap()));
    let request = axum::http::Request::put(path)
        .header("content-type", "application/json")
        .header("relief-author", "anna")
        .header("if-match", "\"2\"")
        .body(axum::body::Body::from(locked.to_string()));
    let done = running.stage.ask(request.unwrap()).await;
    assert_eq!(done.status, 200, "{}", done.text());
    anna.send(&lead(20, [9.0, 2.0, 3.0])).await;
    anna.send(&phase(21, "take")).await;
    assert_eq!(next(&mut anna).await["id"], Value::Null, "something new");
}

/// Invariant: Requests about one volume, or about another author's set, change nothing else.
#[tokio::test]
async fn changing_the_volume_releases_a_held_item() {
    let running = Running::annotated().await;
    let zip = crate::server::uploads::series_zip(9);
    let other = running.stage.post("/v1/volumes", "application/zip", zip).await.json()["id"].clone();
    let (mut anna, _) = running.hello(annotating("theatre", "anna", "s")).await;
    let (mut ben, _) = running.hello(json!({ "view": "theatre", "author": "ben" })).await;
    assert_eq!(
        (next(&mut anna).await["name"].clone(), next(&mut ben).await["name"].clone()),
        (json!("1"), json!("1"))
    );
    place(&mut anna, 1, [1.0, 2.0, 3.0]).await;
    let (event, _) = made(&mut anna).await;
    let id = event["id"].clone();
    let take = |seq: u64| [lead(seq, [1.0, 2.0, 3.0]), phase(seq + 1, "take")];
    let commit = |seq: u64| [lead(seq, [11.0, 2.0, 3.0]), phase(seq + 1, "commit")];
    // Other sets are drawn: the grabbed point stays at its old place.
    for message in take(10) {
        anna.send(&message).await;
    }
    while next(&mut anna).await["id"] != id {}
    ben.send(&json!({ "type": "settings", "annotations": true })).await;
    assert_eq!(next(&mut ben).await["id"], Value::Null, "ben holds nothing");
    for message in commit(20) {
        anna.send(&message).await;
    }
    assert_eq!(next(&mut anna).await["id"], Value::Null);
    // The newest frame may still be one from before the settings.
    let goes_with_the_cursor =
        || running.stage.gate.labels().iter().filter(|label| *label == "1").count() > 1;
    for _ in 0..200 {
        if !goes_with_the_cursor() {
            break;
        }
        tokio::time::sleep(Duration::from_millis(25)).await;
    }
    assert!(!goes_with_the_cursor(), "{:?}", running.stage.gate.labels());
    // Another volume is shown: likewise.
    for message in take(30) {
        anna.send(&message).await;
    }
    while next(&mut anna).await["id"] != id {}
    ben.send(&json!({ "type": "settings", "volume": other })).await;
    while ben.event("state").await["volume"] != other {}
    for message in commit(40) {
        anna.send(&message).await;
    }
    assert_eq!(next(&mut anna).await["id"], Value::Null);
    // There were no other events before this one, and it belongs to this volume.
    place(&mut anna, 50, [4.0, 4.0, 4.0]).await;
    let (event, _) = made(&mut anna).await;
    assert_eq!((&event["seq"], &event["version"]), (&json!(2), &json!(1)));
    let here = running.stage.annotate(Method::GET, "", "", Value::Null).await.json();
    assert_eq!(here["items"].as_array().unwrap().len(), 1);
    assert_eq!(here["items"][0]["item"]["geometry"]["at_mm"], json!([1.0, 2.0, 3.0]));
}

/// A hand releases A and requests a preset in one message: the release is applied, the preset is
/// refused.
#[tokio::test]
async fn intents_before_a_refused_one_stay_applied() {
    let running = Running::annotated().await;
    let mut hello = annotating("theatre", "anna", "s");
    // The preset before this one is a projection, which is never pre-integrated.
    hello["settings"]["preset"] = "x-ray".into();
    hello["settings"]["scene"] = json!({ "classification": "pre-integrated" });
    let (mut anna, _) = running.hello(hello).await;
    let pose = |seq: u64, buttons: Value| {
        json!({ "type": "pose", "seq": seq, "t_ns": seq * 20_000_000, "state": "tracking",
            "position_mm": [12.5, -30, 1480], "orientation_xyzw": [0, 0, 0, 1], "buttons": buttons })
    };
    for (seq, buttons) in [(1, json!([])), (2, json!(["a"])), (3, json!(["left"]))] {
        anna.send(&pose(seq, buttons)).await;
    }
    let (mut placed, mut refused) = (Value::Null, Value::Null);
    let until = std::time::Instant::now() + crate::server::live_stage::PATIENCE;
    while placed.is_null() || refused.is_null() {
        assert!(std::time::Instant::now() < until, "{placed} {refused}");
        match anna.next().await {
            Came::Text(message) if message["type"] == "error" => refused = message["problem"].clone(),
            Came::Text(message) if message["type"] == "annotations" && message["events"][0].is_object() => {
                placed = message["events"][0].clone();
            }
            Came::Frame(frame) => anna.ack(&frame).await,
            Came::Text(_) => {}
            Came::Closed(code) => panic!("closed with {code:?}"),
        }
    }
    assert_eq!((&placed["item"]["name"], &placed["version"]), (&json!("1"), &json!(1)));
    assert_eq!(refused["path"], "classification", "{refused}");
}

#[tokio::test]
async fn an_edit_too_large_for_a_message_is_announced_without_events() {
    let running = Running::annotated().await;
    let (mut client, _) = running.hello(json!({})).await;
    let many: Vec<Value> = (0..500u16).map(|i| point(&format!("p{i}"), [f64::from(i), 0.0, 0.0])).collect();
    running.stage.create("anna", many.into()).await;
    let message = client.event("annotations").await;
    assert_eq!(message, json!({ "type": "annotations", "seq": 500, "events": [], "more": true }));
}

#[tokio::test]
async fn a_plain_intent_places_too() {
    let running = Running::annotated().await;
    let (mut anna, _) = running.hello(annotating("desk", "anna", "s")).await;
    let post = |intent: Value, author: &'static str| {
        let stage = &running.stage;
        async move {
            let mut request = axum::http::Request::post("/v1/session/desk/intent")
                .header("content-type", "application/json");
            if !author.is_empty() {
                request = request.header("relief-author", author);
            }
            stage.ask(request.body(axum::body::Body::from(intent.to_string())).unwrap()).await
        }
    };
    post(json!({ "intent": "cursor", "point_mm": [7, 0, 0] }), "").await;
    post(json!({ "intent": "place", "phase": "commit" }), "").await.problem(422);
    let placed = post(json!({ "intent": "place", "phase": "commit" }), "ben").await;
    assert_eq!(
        (placed.status.as_u16(), &placed.json()["next"]["name"]),
        (200, &json!("2")),
        "{}",
        placed.text()
    );
    assert_eq!(reported(&mut anna).await["events"][0]["author"], "ben");
}
