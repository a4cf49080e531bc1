//! The flow of live frames: the newest pose wins, no intent is lost, at most two frames are
//! unacknowledged, and a moving view starves no other.

use std::time::Duration;

use relief_live::Parts;
use relief_server::LiveConfig;
use serde_json::{Value, json};

use crate::server::live_stage::{PATIENCE, Running, intent, orbit};

/// Degrees about the long axis, 0 from the front, of a header's camera.
fn azimuth_deg(header: &relief_live::FrameHeader) -> f32 {
    let arm: Vec<f32> = header.eye_mm.iter().zip(header.look_at_mm).map(|(eye, at)| eye - at).collect();
    arm[0].atan2(-arm[1]).to_degrees()
}

/// Settings under which a moving picture is another one than the still one.
fn hurried() -> Value {
    json!({ "quality": { "budget_ms": 1 } })
}

/// Invariant: The newest pose wins, no intent is lost, and continuous motion does not starve
/// frames.
#[tokio::test]
async fn the_newest_pose_wins_and_no_intent_is_lost() {
    let running = Running::new().await;
    let (mut client, _) = running.hello(json!({ "settings": hurried() })).await;
    client.still(0).await;
    running.stage.gate.close();
    client.send(&orbit(1, 1.0)).await;
    running.stage.gate.held().await;
    for seq in 2..=40u32 {
        client.send(&orbit(seq.into(), seq.into())).await;
    }
    for seq in 41..=60 {
        client.send(&intent(seq, json!({ "intent": "orbit", "azimuth_deg": 1 }))).await;
    }
    tokio::time::timeout(PATIENCE, async {
        while running.metric("relief_live_dropped_poses_total").await < 38.0 {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    })
    .await
    .expect("the poses that were replaced are counted");
    let held = running.stage.gate.count();
    running.stage.gate.open();
    let still = client.still(60).await;
    assert!(
        (azimuth_deg(&still.header) - 60.0).abs() < 0.01,
        "40 by the pose, 20 by intents: {still:?}",
        still = still.header
    );
    let renders = running.stage.gate.count() - held;
    assert!(renders <= 3, "{renders} pictures for 60 messages: newer ones alone");
}

#[tokio::test]
async fn late_poses_are_left_out() {
    let running = Running::new().await;
    let (mut client, _) = running.hello(json!({})).await;
    client.send(&orbit(5, 50.0)).await;
    client.send(&orbit(4, 10.0)).await;
    client.send(&intent(6, json!({ "intent": "orbit", "azimuth_deg": 1 }))).await;
    assert!((azimuth_deg(&client.still(6).await.header) - 51.0).abs() < 0.01);
}

/// Invariant: A client has at most two frames in flight, and a stalled client affects no other.
#[tokio::test]
async fn two_frames_are_on_their_way_and_no_more() {
    let running = Running::new().await;
    let (mut mover, _) = running.hello(json!({ "view": "v" })).await;
    let (mut lazy, _) = running.hello(json!({ "view": "v", "role": "watcher" })).await;
    let mut newest = [0.0; 3];
    for seq in 1..=4u32 {
        mover.send(&orbit(seq.into(), seq.into())).await;
        newest = mover.still(seq.into()).await.header.eye_mm;
    }
    let [first, second] = [lazy.frame().await, lazy.frame().await];
    let sequence = |frame: &[u8]| Parts::of(frame).unwrap().header.sequence;
    assert_eq!([sequence(&first), sequence(&second)], [1, 2]);
    assert!(lazy.gets_no_frame_for(Duration::from_millis(300)).await);
    lazy.ack(&first).await;
    let third = lazy.frame().await;
    let third = Parts::of(&third).unwrap().header;
    assert_eq!((third.sequence, third.still), (3, true));
    assert_eq!(third.eye_mm, newest, "the newest, and none of those between");
    assert!(lazy.gets_no_frame_for(Duration::from_millis(200)).await);
}

/// Invariant: A client has at most two frames in flight, and a stalled client affects no other.
#[tokio::test]
async fn a_stalled_client_holds_two_frames_and_delays_no_other() {
    let running = Running::new().await;
    let (mut mover, _) = running.hello(json!({ "view": "v" })).await;
    mover.still(0).await;
    let mut stalled = Vec::new();
    for _ in 0..5 {
        let mut client = running.connect_narrow().await;
        client.send(&json!({ "type": "hello", "view": "v", "role": "watcher" })).await;
        stalled.push(client); // never read from
    }
    let mut received = 2; // at the most, before
    for seq in 1..=12u32 {
        mover.send(&orbit(seq.into(), seq.into())).await;
        loop {
            let frame = mover.frame().await;
            mover.ack(&frame).await;
            received += 1;
            if Parts::of(&frame).unwrap().header.shows_seq == u64::from(seq) {
                break;
            }
        }
    }
    let sent = running.metric("relief_live_frames_total{kind=\"moving\"}").await
        + running.metric("relief_live_frames_total{kind=\"still\"}").await;
    assert!(
        sent <= f64::from(received) + 2.0 + 5.0 * 2.0,
        "{sent} sent, {received} received by the one who reads"
    );
    assert!(received >= 12);
}

/// Invariant: The newest pose wins, no intent is lost, and continuous motion does not starve
/// frames.
#[tokio::test]
async fn motion_that_does_not_rest_starves_no_frame() {
    let running = Running::new().await;
    let (mut client, _) = running.hello(json!({ "settings": hurried() })).await;
    client.still(0).await;
    let (mut moving, mut seq) = (0, 0u32);
    while moving < 20 {
        seq += 1;
        assert!(seq < 10_000, "{moving} frames of {seq} poses");
        client.send(&orbit(seq.into(), seq.into())).await;
        let next = tokio::time::timeout(Duration::from_millis(3), client.frame()).await;
        if let Ok(frame) = next {
            let header = Parts::of(&frame).unwrap().header;
            assert!(!header.still, "nothing is still while poses come every 3 ms");
            client.ack(&frame).await;
            moving += 1;
        }
    }
}

#[tokio::test]
async fn the_picture_of_a_still_view_makes_way_when_it_moves() {
    // The gate has to be closed before the view is still.
    let live = LiveConfig { still_after: Duration::from_millis(400), ..LiveConfig::default() };
    let running = Running::with(live).await;
    let (mut client, _) = running.hello(json!({ "settings": hurried() })).await;
    client.still(0).await;
    client.send(&orbit(1, 10.0)).await;
    let moving = client.frame().await;
    assert!(!Parts::of(&moving).unwrap().header.still);
    running.stage.gate.close();
    client.ack(&moving).await;
    running.stage.gate.held().await; // the still picture is being made
    client.send(&orbit(2, 20.0)).await;
    let ended = "relief_render_abandoned_total{when=\"rendering\"}";
    tokio::time::timeout(PATIENCE, async {
        while running.metric(ended).await < 1.0 {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    })
    .await
    .expect("the still picture of what has moved on is not finished");
    running.stage.gate.open();
    let frame = client.frame().await;
    let header = Parts::of(&frame).unwrap().header;
    assert_eq!((header.shows_seq, header.still), (2, false));
    client.ack(&frame).await;
    client.still(2).await;
}

#[tokio::test]
async fn sessions_frames_and_overhead_are_counted() {
    let running = Running::new().await;
    let (mut client, _) = running.hello(json!({ "settings": hurried() })).await;
    assert_eq!(running.metric("relief_live_sessions").await, 1.0);
    client.send(&orbit(1, 10.0)).await;
    client.still(1).await;
    assert!(running.metric("relief_live_frames_total{kind=\"moving\"}").await >= 1.0);
    assert!(running.metric("relief_live_frames_total{kind=\"still\"}").await >= 1.0);
    assert!(running.metric("relief_live_bytes_total").await > 1000.0);
    assert!(running.metric("relief_live_overhead_seconds_count").await >= 1.0);
}
