//! Where a landmark would be set down is shown before it is: by a ghost in the picture and in the
//! state, for hands and for pointers.

use std::time::Instant;

use relief_live::Parts;
use relief_render::OverlayItem;
use serde_json::{Value, json};

use crate::server::live_stage::{Came, Client, PATIENCE, Running, intent};
use crate::server::stage::SPHERE_MM;

fn xyz(value: &Value) -> [f64; 3] {
    serde_json::from_value(value.clone()).unwrap_or_else(|error| panic!("{error}: {value}"))
}

fn length(xyz: [f64; 3]) -> f64 {
    xyz.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// The distance between two places, mm.
fn between(a: [f64; 3], b: [f64; 3]) -> f64 {
    length([a[0] - b[0], a[1] - b[1], a[2] - b[2]])
}

/// The state that shows where the cursor, as it is now, would be set down.
async fn previewed(client: &mut Client) -> Value {
    let start = Instant::now();
    loop {
        assert!(start.elapsed() < PATIENCE, "no preview of where the cursor is");
        let message = client.event("state").await;
        if message["snapped"].is_null() {
            continue;
        }
        let (at, shift) = (xyz(&message["snapped"]["at_mm"]), xyz(&message["snapped"]["shift_mm"]));
        let from: [f64; 3] = std::array::from_fn(|axis| at[axis] - shift[axis]);
        if between(from, xyz(&message["state"]["cursor_mm"])) < 1e-9 {
            return message;
        }
    }
}

async fn state_where(client: &mut Client, holds: impl Fn(&Value) -> bool) -> Value {
    loop {
        let message = client.event("state").await;
        if holds(&message) {
            return message;
        }
    }
}

async fn edited(client: &mut Client) -> Value {
    loop {
        let message = client.event("annotations").await;
        if let Some(event) = message["events"].as_array().and_then(|events| events.first()) {
            return event.clone();
        }
    }
}

/// Places of the balls that have a label with a length, in the picture that was rendered last.
fn ghosts(running: &Running) -> Vec<([f64; 3], String)> {
    let last = running.stage.gate.last.lock().unwrap();
    let ghost = |item: &OverlayItem| match item {
        OverlayItem::Landmark(landmark) => {
            let label = landmark.label.as_deref().filter(|label| label.ends_with(" mm"))?;
            Some((landmark.at.xyz.to_array(), label.to_owned()))
        }
        _ => None,
    };
    last.as_ref().map(|last| last.overlays.items.iter().filter_map(ghost).collect()).unwrap_or_default()
}

fn pose(seq: u64, x_mm: f64, buttons: &Value) -> Value {
    json!({ "type": "pose", "seq": seq, "t_ns": seq * 20_000_000, "state": "tracking",
        "position_mm": [x_mm, 0, 1480], "orientation_xyzw": [0, 0, 0, 1], "buttons": buttons })
}

/// Halfway between the ball and the air around it.
const BALL_HU: f64 = -350.0;

fn annotating(snap: &Value) -> Value {
    let settings = json!({ "annotations": "s", "snap": snap });
    json!({ "view": "theatre", "author": "anna", "settings": settings })
}

/// Invariant: The preview shows where a landmark will be placed; frames keep their rate meanwhile.
///
/// A hand that holds A near the surface sees the place on it, with the shift, and letting go sets
/// the landmark down there.
#[tokio::test]
async fn while_a_is_held_the_snapped_place_is_shown_and_letting_go_sets_it_down_there() {
    let running = Running::annotated_sphere().await;
    let (mut anna, _) = running.hello(annotating(&json!({ "to": "surface", "hu": BALL_HU }))).await;
    let (mut ben, _) = running.hello(json!({ "view": "theatre", "role": "watcher" })).await;
    anna.send(&pose(1, 0.0, &json!([]))).await;
    // Long enough for the hand's mean to be where the hand is.
    for seq in 2..80 {
        anna.send(&pose(seq, 18.5, &json!([]))).await;
    }
    let before = state_where(&mut anna, |message| !message["state"]["cursor_mm"].is_null()).await;
    assert!(before["snapped"].is_null(), "nothing is being placed: {before}");
    for seq in 80..90 {
        anna.send(&pose(seq, 18.5, &json!(["a"]))).await;
    }
    let message = previewed(&mut anna).await;
    let (at, shift) = (xyz(&message["snapped"]["at_mm"]), xyz(&message["snapped"]["shift_mm"]));
    assert!((length(at) - SPHERE_MM).abs() < 0.15, "on the surface: {at:?}");
    assert!((1.0..2.2).contains(&length(shift)), "{shift:?}");
    assert_eq!(previewed(&mut ben).await["snapped"], message["snapped"], "every client sees it");
    // The picture has it, with the distance beside it.
    anna.still(89).await;
    let shown = ghosts(&running);
    assert_eq!(shown.len(), 1, "{shown:?}");
    assert!(between(shown[0].0, at) < 1e-9 && shown[0].1 == format!("{:.1} mm", length(shift)), "{shown:?}");
    anna.send(&pose(90, 18.5, &json!([]))).await;
    let item = edited(&mut anna).await["item"].clone();
    assert_eq!(item["geometry"], json!({ "kind": "point", "at_mm": at }), "the place that was shown");
    assert_eq!(item["placement"]["snapped_mm"], json!(shift));
    anna.still(90).await;
    assert!(ghosts(&running).is_empty(), "it is set down");
}

/// Invariant: The preview shows where a landmark will be placed; frames keep their rate meanwhile.
///
/// The ghost follows the cursor, in a picture along the line of sight, and goes where nothing is
/// near, and when it is over.
#[tokio::test]
async fn the_ghost_follows_the_cursor_and_goes_when_nothing_is_near() {
    let running = Running::annotated_sphere().await;
    let (mut anna, _) = running.hello(annotating(&json!({ "to": "surface", "hu": BALL_HU }))).await;
    anna.still(0).await;
    let lead = |seq, at: [f64; 3]| intent(seq, json!({ "intent": "cursor", "point_mm": at }));
    anna.send(&lead(1, [0.0, 0.0, 21.0])).await;
    anna.send(&intent(2, json!({ "intent": "place", "phase": "preview" }))).await;
    let first = xyz(&previewed(&mut anna).await["snapped"]["at_mm"]);
    assert!(between(first, [0.0, 0.0, SPHERE_MM]) < 0.2, "{first:?}");
    anna.send(&lead(3, [0.0, -18.6, 0.0])).await;
    let second = xyz(&previewed(&mut anna).await["snapped"]["at_mm"]);
    assert!(between(second, [0.0, -SPHERE_MM, 0.0]) < 0.2, "{second:?}");
    // Nothing within 3 mm of the middle.
    anna.send(&lead(4, [0.0; 3])).await;
    state_where(&mut anna, |message| {
        message["snapped"].is_null() && message["state"]["cursor_mm"] == json!([0.0, 0.0, 0.0])
    })
    .await;
    // A place from a pixel snaps along the line of sight.
    anna.send(&intent(5, json!({ "intent": "cursor", "at_px": [500.5, 240.5] }))).await;
    let message = previewed(&mut anna).await;
    let (at, shift) = (xyz(&message["snapped"]["at_mm"]), xyz(&message["snapped"]["shift_mm"]));
    let frame = anna.still(5).await;
    let eye = frame.header.eye_mm.map(f64::from);
    let sight: [f64; 3] = std::array::from_fn(|axis| at[axis] - eye[axis]);
    let dot = (0..3).map(|axis| sight[axis] * shift[axis]).sum::<f64>();
    let off = length(shift) * (1.0 - (dot.abs() / length(sight) / length(shift)).min(1.0));
    assert!(off < 1e-3, "{shift:?} lies along {sight:?}");
    // Another snapping target gives another ghost, and no snapping gives none.
    anna.send(&json!({ "type": "settings", "snap": { "to": "minimum", "radius_mm": 0.5 } })).await;
    state_where(&mut anna, |message| message["snapped"].is_null()).await;
    anna.send(&json!({ "type": "settings", "snap": { "to": "surface", "hu": BALL_HU } })).await;
    previewed(&mut anna).await;
    anna.send(&intent(9, json!({ "intent": "place", "phase": "cancel" }))).await;
    let over = state_where(&mut anna, |message| message["state"]["placing"] == false).await;
    assert!(over["snapped"].is_null(), "{over}");
}

/// Moves the cursor as often as frames show its last place, until a preview comes; gives the newest
/// place and the number of frames.
async fn tremble_until_previewed(anna: &mut Client, first: u64) -> ([f64; 3], usize) {
    let place = |seq: u64| [(seq % 7) as f64 * 0.2, (seq % 5) as f64 * 0.2, 10.0];
    let mut seq = first;
    loop {
        anna.send(&intent(seq, json!({ "intent": "cursor", "point_mm": place(seq) }))).await;
        let mut is_shown = false;
        while !is_shown {
            match anna.next().await {
                Came::Frame(frame) => {
                    anna.ack(&frame).await;
                    is_shown = Parts::of(&frame).unwrap().header.shows_seq >= seq;
                }
                Came::Text(message) if message["type"] == "state" && !message["snapped"].is_null() => {
                    return (place(seq), (seq - first) as usize);
                }
                Came::Text(message) => assert_ne!(message["type"], "error", "{message}"),
                Came::Closed(code) => panic!("closed with {code:?} before a preview"),
            }
        }
        seq += 1;
    }
}

/// Invariant: The preview shows where a landmark will be placed; frames keep their rate meanwhile.
///
/// During one long search the cursor moves on and frames show it. A search that held up the server
/// would leave time for one frame before it and one after it. The newest place is previewed in the
/// end.
#[tokio::test]
async fn snapping_holds_up_no_pictures_and_ends_at_the_newest_place() {
    let running = Running::annotated_fine_sphere().await;
    let (mut anna, _) = running.hello(annotating(&json!({ "to": "gradient", "radius_mm": 20 }))).await;
    anna.still(0).await;
    anna.send(&intent(1, json!({ "intent": "cursor", "point_mm": [0, 0, 10] }))).await;
    anna.send(&intent(2, json!({ "intent": "place", "phase": "preview" }))).await;
    let (newest, frames) = tremble_until_previewed(&mut anna, 3).await;
    assert!(frames >= 4, "{frames} frames during a search");
    let message = loop {
        let message = previewed(&mut anna).await;
        if between(xyz(&message["state"]["cursor_mm"]), newest) < 1e-9 {
            break message;
        }
    };
    let at = xyz(&message["snapped"]["at_mm"]);
    assert!((length(at) - SPHERE_MM).abs() < 0.1, "{at:?}");
}
