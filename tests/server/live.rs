//! Live sessions over real sockets: negotiation, pictures for each role, and refusals.

use std::time::Duration;

use image::ImageDecoder;
use relief_display::{DisparityConstants, DisplayProfile, Pixels, ProfileName};
use relief_live::{ReceivedFrame, SUBPROTOCOL};
use relief_server::{AllowedHosts, Config, LiveConfig, Shutdown};
use relief_tracking::{Beacon, Simulation, hex_of_bytes};
use serde_json::{Value, json};
use tokio_tungstenite::tungstenite::{Error, Message};

use crate::server::live_stage::{Came, Client, Running, intent, orbit};

const CAMERA: &str = r#"{"eye_mm":[30,-200,10],"look_at_mm":[1,2,3],"up":[0,0,1],
    "projection":{"perspective":{"vertical_fov_deg":22}}}"#;

fn camera() -> Value {
    serde_json::from_str(CAMERA).unwrap()
}

/// Pixels of a composed frame.
fn composed(frame: &ReceivedFrame) -> Vec<u8> {
    let frame = frame.compose(&DisplayProfile::named(ProfileName::Philips42)).unwrap();
    let Pixels::Rgb8(samples) = frame.pixels() else { panic!("colour") };
    samples.clone()
}

/// Pixels of a PNG.
fn decoded(png: &[u8]) -> Vec<u8> {
    let decoder = image::codecs::png::PngDecoder::new(std::io::Cursor::new(png)).unwrap();
    let mut samples = vec![0; usize::try_from(decoder.total_bytes()).unwrap()];
    decoder.read_image(&mut samples).unwrap();
    samples
}

/// Invariant: A live frame of a still view, composed from lossless colour, equals the PNG of the
/// same scene, pixel by pixel.
#[tokio::test]
async fn a_still_frame_is_lossless_and_composes_to_the_served_png() {
    let running = Running::new().await;
    for (display, depth) in [
        (json!({}), "d8-zstd"),
        (
            json!({ "layout": "wowvx-full-height", "factor": 99, "offset": 7, "depth_filter": "median-3" }),
            "d8-deflate",
        ),
        (json!({ "layout": "rgbd", "near_mm": 150.0, "far_mm": 260.0 }), "d8-zstd"),
    ] {
        let accept = json!({ "color": ["jpeg", "rgb-deflate"], "depth": [depth] });
        let settings = json!({ "display": display, "preset": "skin" });
        let (mut client, welcome) = running.hello(json!({ "accept": accept, "settings": settings })).await;
        assert_eq!(welcome["color"], json!({ "moving": "jpeg", "still": "rgb-deflate" }));
        assert_eq!((&welcome["depth"], &welcome["role"]), (&json!(depth), &json!("presenter")));
        assert_eq!(welcome["volume"]["id"], running.stage.id.as_str());
        assert_eq!(welcome["state"]["preset"], "skin");
        client.send(&json!({ "type": "pose", "seq": 5, "t_ns": 77, "camera": camera() })).await;
        let still = client.still(5).await;
        assert!(still.header.lossless() && still.header.full_size(), "{:?}", still.header);
        assert_eq!((still.header.shows_seq, still.header.shows_t_ns), (5, 77));
        let scene = json!({ "camera": camera(), "transfer": "skin", "display": display }).to_string();
        let png = running.stage.post(&running.stage.path("frame"), "application/json", scene).await;
        assert_eq!(png.status, 200, "{}", png.text());
        assert!(composed(&still) == decoded(&png.body), "{display}");
        let eye = still.header.camera().unwrap().eye().xyz.to_array();
        assert_eq!(eye, [30.0, -200.0, 10.0]);
        assert!(
            client.gets_no_frame_for(Duration::from_millis(300)).await,
            "a still view has one last frame"
        );
    }
}

/// The plane of the screen goes with the cursor, and back when the setting does.
#[tokio::test]
async fn the_cursor_lies_on_the_plane_of_the_screen() {
    let running = Running::new().await;
    let settings = json!({ "display": { "screen_plane": "cursor" }, "preset": "skin" });
    let (mut client, _) = running.hello(json!({ "settings": settings })).await;
    let limits = |frame: &ReceivedFrame| frame.header.limits_mm.map(f64::from);
    let first = client.still(0).await;
    let (usual, camera) = (limits(&first), first.header.camera().unwrap());
    for (seq, share) in [(1, 0.3), (2, 0.8)] {
        // On the line of sight, between the nearest and the farthest surface.
        let depth = usual[0] + share * (usual[1] - usual[0]);
        let cursor = camera.eye() + (camera.look_at() - camera.eye()).normalized().unwrap() * depth;
        let cursor_mm = cursor.xyz.to_array();
        client.send(&intent(seq, json!({ "intent": "cursor", "point_mm": cursor_mm }))).await;
        let [near, far] = limits(&client.still(seq).await);
        let screen = near + DisparityConstants::PHILIPS_42.zd * (far - near);
        assert!((screen - depth).abs() < 0.01, "the screen is at {screen} mm, the cursor at {depth} mm");
        assert_ne!([near, far], usual);
    }
    client.send(&json!({ "type": "settings", "display": {} })).await;
    let [near, far] = limits(&client.still(0).await);
    assert!(near <= usual[0] && far == usual[1], "{near} to {far} mm, {usual:?} without the cursor");
    // A picture has no cursor.
    let scene = json!({ "display": { "screen_plane": "cursor" } }).to_string();
    let refused = running.stage.post(&running.stage.path("frame"), "application/json", scene).await;
    let problem = refused.problem(422);
    assert_eq!(problem["path"], "display.screen_plane");
}

#[tokio::test]
async fn while_the_view_moves_frames_are_small_and_lossy_within_their_budget() {
    let running = Running::new().await;
    let settings = json!({ "quality": { "budget_ms": 1 } });
    let (mut client, _) = running.hello(json!({ "settings": settings })).await;
    client.still(0).await;
    client.send(&orbit(1, 30.0)).await;
    let frame = client.frame().await;
    client.ack(&frame).await;
    let frame = ReceivedFrame::decode(&frame).unwrap().header;
    assert!(!frame.still && !frame.lossless() && !frame.full_size(), "{frame:?}");
    assert_eq!(frame.full_px, [960, 540]);
    assert_eq!((frame.shows_seq, frame.shows_t_ns), (1, 1000));
    assert!(frame.total_us >= frame.encode_us && frame.total_us >= frame.wait_us, "{frame:?}");
    let still = client.still(1).await;
    assert!(still.header.lossless() && still.header.full_size());
}

/// Invariant: Watchers change nothing, and no page of another site can open a session.
#[tokio::test]
async fn watchers_see_what_the_presenter_does_and_change_nothing() {
    let running = Running::new().await;
    let (mut presenter, welcome) = running.hello(json!({ "view": "theatre" })).await;
    assert_eq!(welcome["view"], "theatre");
    let (mut watcher, joined) = running.hello(json!({ "view": "theatre", "role": "watcher" })).await;
    assert_eq!((&joined["view"], &joined["role"]), (&json!("theatre"), &json!("watcher")));
    assert_eq!(watcher.event("peers").await, json!({ "type": "peers", "presenters": 1, "watchers": 1 }));
    presenter.send(&intent(1, json!({ "intent": "look", "azimuth_deg": 90, "elevation_deg": 0 }))).await;
    let seen = presenter.still(1).await;
    let renders = running.stage.gate.count();
    loop {
        let state = watcher.event("state").await;
        assert_eq!(state["volume"], running.stage.id.as_str());
        let frame = watcher.still(0).await;
        assert_eq!(frame.header.shows_seq, 0, "nothing of the watcher's own");
        if frame.header.eye_mm == seen.header.eye_mm {
            assert!(frame.color == seen.color && frame.depth == seen.depth);
            break;
        }
    }
    assert_eq!(running.stage.gate.count(), renders, "rendered once for both");
    for message in [
        intent(1, json!({ "intent": "reset" })),
        orbit(2, 3.0),
        json!({ "type": "settings", "preset": "skin" }),
        json!({ "type": "report", "seq": 3, "t_ns": 1, "report": "300000" }),
    ] {
        watcher.send(&message).await;
        let refused = watcher.event("error").await;
        assert_eq!((&refused["problem"]["status"], &refused["fatal"]), (&json!(403), &json!(false)));
    }
    presenter.send(&intent(2, json!({ "intent": "orbit", "azimuth_deg": 5 }))).await;
    presenter.still(2).await;
    drop(presenter);
    let peers = watcher.event("peers").await;
    assert_eq!((&peers["presenters"], &peers["watchers"]), (&json!(0), &json!(1)));
}

#[tokio::test]
async fn an_unnamed_view_is_private() {
    let running = Running::new().await;
    let (_a, first) = running.hello(json!({})).await;
    let (_b, second) = running.hello(json!({})).await;
    let names = [&first, &second].map(|welcome| welcome["view"].as_str().unwrap().to_owned());
    assert!(names[0] != names[1] && names.iter().all(|name| name.len() == 32), "{names:?}");
    assert_ne!(first["session"], second["session"]);
    let text = running.stage.get("/metrics").await;
    assert!(names.iter().all(|name| !text.text().contains(name)), "names are keys");
}

#[tokio::test]
async fn a_lost_session_is_resumed_with_its_last_state() {
    let running = Running::new().await;
    let (mut client, welcome) = running.hello(json!({})).await;
    client.send(&intent(1, json!({ "intent": "look", "azimuth_deg": 70, "elevation_deg": 20 }))).await;
    client.send(&json!({ "type": "settings", "preset": "lung" })).await;
    let eye = client.still(1).await.header.eye_mm;
    drop(client); // no farewell
    let resume =
        json!({ "resume": welcome["session"], "accept": { "color": ["rgb-zstd"], "depth": ["none"] } });
    let (mut client, again) = running.hello(resume.clone()).await;
    assert_eq!((&again["resumed"], &again["session"]), (&json!(true), &welcome["session"]));
    assert_eq!((&again["view"], &again["state"]["preset"]), (&welcome["view"], &json!("lung")));
    let frame = client.still(0).await;
    assert_eq!(frame.header.eye_mm, eye);
    assert!(frame.header.lossless() && frame.header.depth_bytes == 0);
    // A connection that only seems to live makes way.
    let (_newer, _) = running.hello(resume).await;
    assert_eq!(client.closed().await, Some(4001));
    // An unknown token starts a new session.
    let (_stranger, fresh) = running.hello(json!({ "resume": "0".repeat(32) })).await;
    assert_eq!(fresh["resumed"], false);
    assert_ne!(fresh["view"], welcome["view"]);
}

#[tokio::test]
async fn a_session_waits_so_long_and_no_longer() {
    let live = LiveConfig { resume: Duration::from_millis(50), ..LiveConfig::default() };
    let running = Running::with(live).await;
    let (client, welcome) = running.hello(json!({})).await;
    drop(client);
    while running.metric("relief_live_sessions").await > 0.0 {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    tokio::time::sleep(Duration::from_millis(80)).await;
    let (_client, again) = running.hello(json!({ "resume": welcome["session"] })).await;
    assert_eq!(again["resumed"], false);
}

async fn refusal(client: &mut Client, message: &str) -> Value {
    client.send_raw(Message::Text(message.into())).await;
    let error = client.event("error").await;
    error["problem"].clone()
}

#[tokio::test]
async fn malformed_messages_are_named_and_twenty_end_the_session() {
    let running = Running::new().await;
    let (mut client, _) = running.hello(json!({})).await;
    let mut errors = 0;
    for (message, path, kind) in [
        ("{", ".", "malformed-message"),
        (r#"{"type":"dance"}"#, "type", "malformed-message"),
        (r#"{"type":"pose","seq":1,"t_ns":1,"orbit":{"azimuth_deg":1}}"#, "orbit", "malformed-message"),
        (r#"{"type":"settings","display":{"factor":999}}"#, "display.factor", "malformed-message"),
        (r#"{"type":"settings","display":{"layout":"depth16"}}"#, "display.layout", "out-of-range"),
        (r#"{"type":"settings","scene":{"camera":{}}}"#, "scene.camera", "out-of-range"),
        (r#"{"type":"settings","scene":{"modus":"mip"}}"#, "modus", "malformed-scene"),
        (r#"{"type":"settings","scene":{"sample_distance_mm":0}}"#, "sample_distance_mm", "out-of-range"),
        (r#"{"type":"settings","size_px":[9,9]}"#, "size_px", "out-of-range"),
        (r#"{"type":"settings","preset":"gold"}"#, "settings.preset", "out-of-range"),
        (r#"{"type":"intent","seq":1,"t_ns":1,"intent":"preset","name":"gold"}"#, "intent", "refused-intent"),
        (r#"{"type":"report","seq":1,"t_ns":1,"report":"ff"}"#, "report", "malformed-report"),
    ] {
        let problem = refusal(&mut client, message).await;
        let named = problem["path"].as_str().unwrap_or_default();
        assert!(named.contains(path), "{message}: {problem}");
        assert_eq!(problem["type"], format!("urn:relief:problem:{kind}"), "{message}");
        errors += 1;
    }
    let problem = refusal(&mut client, r#"{"type":"settings","volume":"none"}"#).await;
    assert_eq!(problem["status"], 404);
    let problem = refusal(&mut client, r#"{"type":"hello"}"#).await;
    assert_eq!(problem["status"], 409);
    errors += 2;
    client.send(&intent(9, json!({ "intent": "orbit", "azimuth_deg": 1 }))).await;
    client.still(9).await; // the session goes on
    for _ in errors..20 {
        client.send_raw(Message::Text("[]".into())).await;
    }
    assert_eq!(client.closed().await, Some(1008));
}

#[tokio::test]
async fn invalid_sessions_are_closed_with_their_code() {
    let live = LiveConfig { hello_timeout: Duration::from_millis(100), ..LiveConfig::default() };
    let running = Running::with(live).await;
    let protocol = [("sec-websocket-protocol", SUBPROTOCOL)];
    let mut silent = running.connect(&protocol).await.unwrap();
    assert_eq!(silent.closed().await, Some(1008));
    for hello in [
        r#"{"type":"ack","frame":1}"#,
        r#"{"type":"hello","volume":"none"}"#,
        r#"{"type":"hello","accept":{"color":["webp"]}}"#,
        r#"{"type":"hello","settings":{"preset":"gold"}}"#,
        "hello",
    ] {
        let mut client = running.connect(&protocol).await.unwrap();
        client.send_raw(Message::Text(hello.into())).await;
        let Came::Text(error) = client.next().await else { panic!("an error for {hello}") };
        assert_eq!((&error["type"], &error["fatal"]), (&json!("error"), &json!(true)), "{hello}");
        assert_eq!(client.closed().await, Some(1008), "{hello}");
    }
    let (mut client, _) = running.hello(json!({})).await;
    client.send_raw(Message::Binary(vec![1, 2, 3].into())).await;
    assert_eq!(client.closed().await, Some(1003));
    let (mut client, _) = running.hello(json!({})).await;
    client.send_raw(Message::Text("x".repeat(70_000).into())).await;
    assert_eq!(client.closed().await, Some(1009));
    // If a message is not read to its end, the connection may be reset before the code arrives.
    let (mut client, _) = running.hello(json!({})).await;
    client.send_raw(Message::Text("x".repeat(4_000_000).into())).await;
    assert!(matches!(client.closed().await, Some(1009) | None));
}

fn status(error: &Error) -> u16 {
    let Error::Http(response) = error else { panic!("{error}") };
    response.status().as_u16()
}

/// Invariant: Watchers change nothing, and no page of another site can open a session.
#[tokio::test]
async fn pages_of_other_sites_and_strangers_are_refused() {
    let names = ["127.0.0.1", "localhost"].map(str::to_owned).to_vec();
    let hosts = AllowedHosts { names, addresses: false };
    let running = Running::of(Config { allowed_hosts: Some(hosts), ..Config::default() }).await;
    let own = format!("http://{}", running.address);
    let protocol = ("sec-websocket-protocol", SUBPROTOCOL);
    running.connect(&[protocol, ("origin", &own)]).await.expect("its own page");
    for origin in ["http://evil.example", "null", "https://127.0.0.1", "http://127.0.0.1:1"] {
        let refused = running.connect(&[protocol, ("origin", origin)]).await.err().unwrap();
        assert_eq!(status(&refused), 403, "{origin}");
    }
    let renamed = running.connect(&[protocol, ("host", "evil.example")]).await.err().unwrap();
    assert_eq!(status(&renamed), 421);
    let other = running.connect(&[("sec-websocket-protocol", "relief.v9")]).await.err().unwrap();
    assert_eq!(status(&other), 400);
    let plain = running.stage.get_with("/v1/session", &[("host", "localhost")]).await;
    assert_eq!(plain.problem(426)["type"], "urn:relief:problem:no-websocket");
    let description = running.stage.get_with("/v1/session/protocol.json", &[("host", "localhost")]).await;
    assert_eq!(description.json()["subprotocol"], SUBPROTOCOL);
}

#[tokio::test]
async fn there_are_as_many_sessions_as_allowed() {
    let live = LiveConfig { sessions: 2, ..LiveConfig::default() };
    let running = Running::with(live).await;
    let (first, _) = running.hello(json!({})).await;
    let (_second, _) = running.hello(json!({})).await;
    let refused = running.connect(&[("sec-websocket-protocol", SUBPROTOCOL)]).await.err().unwrap();
    assert_eq!(status(&refused), 503);
    drop(first);
    while running.metric("relief_live_sessions").await > 1.0 {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    // A place is given back with its connection.
    while running.connect(&[("sec-websocket-protocol", SUBPROTOCOL)]).await.is_err() {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}

#[tokio::test]
async fn a_wiimotes_hand_moves_the_view_by_poses_and_by_reports() {
    let running = Running::new().await;
    let (mut client, _) = running.hello(json!({})).await;
    let before = client.still(0).await.header.eye_mm;
    let turned = |deg: f64| {
        let half = deg.to_radians() / 2.0;
        json!([0, half.sin(), 0, half.cos()])
    };
    for (seq, deg) in [(1, 0.0), (2, 0.0), (3, 10.0), (4, 20.0)] {
        let buttons = if seq > 1 { json!(["b"]) } else { json!([]) };
        client
            .send(&json!({ "type": "pose", "seq": seq, "t_ns": seq * 20_000_000, "state": "tracking",
                "position_mm": [0, 0, 1500], "orientation_xyzw": turned(deg), "buttons": buttons }))
            .await;
    }
    let moved = client.still(4).await;
    assert_ne!(moved.header.eye_mm, before, "the volume followed the hand");
    client
        .send(&json!({ "type": "pose", "seq": 5, "t_ns": 100_000_000, "state": "lost", "buttons": [] }))
        .await;
    while client.event("state").await["state"]["grabbed"] != false {}

    let beacon = Beacon::recommended();
    let path = relief_tracking::PointingHand::before(&beacon, 1500.0, 3);
    let mut reports = Simulation::new(beacon, 3).record(&path, 0.4).into_iter();
    let mut seq = 100;
    let tracking = loop {
        let simulated = reports.next().expect("a pose among the reports");
        let report = hex_of_bytes(&simulated.report.encode());
        client.send(&json!({ "type": "report", "seq": seq, "t_ns": simulated.t_ns, "report": report })).await;
        seq += 1;
        if seq % 20 == 0 {
            let reported = client.event("tracking").await;
            if reported["state"] == "tracking" {
                break reported;
            }
        }
    };
    assert_eq!(tracking["leds"], 4);
    assert!(tracking["rms_px"].as_f64().unwrap() < 3.0);
}

#[tokio::test]
async fn settings_change_scene_display_and_size_and_wrong_ones_nothing() {
    let running = Running::new().await;
    let (mut client, _) = running.hello(json!({})).await;
    client.still(0).await;
    let scene = json!({ "mode": "mip", "background_rgb": [1, 0, 0] });
    let display = json!({ "layout": "color" });
    client
        .send(&json!({ "type": "settings", "scene": scene, "display": display, "size_px": [64, 48] }))
        .await;
    let frame = loop {
        let frame = client.still(0).await;
        if frame.header.full_px == [64, 48] {
            break frame;
        }
    };
    assert_eq!(frame.header.layout.name(), "color");
    client.send(&json!({ "type": "settings", "scene": { "mode": "nonsense" } })).await;
    assert_eq!(client.event("error").await["problem"]["status"], 400);
    client
        .send(&json!({ "type": "settings", "scene": { "mode": null }, "display": { "layout": "wowvx" } }))
        .await;
    let frame = loop {
        let frame = client.still(0).await;
        if frame.header.layout.name() == "wowvx" {
            break frame;
        }
    };
    assert_eq!(frame.header.full_px, [960, 540], "another layout has its own size");
    // A custom transfer function has no preset's name; a preset replaces it.
    let points = json!([{ "hu": 0, "rgba": [0, 0, 0, 0] }, { "hu": 60, "rgba": [1, 1, 1, 1] }]);
    client.send(&json!({ "type": "settings", "scene": { "transfer": { "points": points } } })).await;
    while client.event("state").await["state"]["preset"] != Value::Null {}
    client.send(&intent(5, json!({ "intent": "preset", "name": "bone" }))).await;
    while client.event("state").await["state"]["preset"] != "bone" {}
}

#[tokio::test]
async fn stopping_closes_sessions_and_takes_no_new_ones() {
    let mut running = Running::new().await;
    let (mut client, _) = running.hello(json!({})).await;
    client.still(0).await;
    let waiting = running.connect(&[("sec-websocket-protocol", SUBPROTOCOL)]).await.unwrap();
    running.stop();
    assert_eq!(client.closed().await, Some(1001));
    let mut waiting = waiting;
    assert_eq!(waiting.closed().await, Some(1001), "one that has not said hello");
    assert_eq!(running.ended().await, Shutdown::Whole);
}

#[tokio::test]
async fn sessions_of_a_removed_volume_end() {
    let running = Running::new().await;
    let zip = crate::server::uploads::series_zip(9);
    let uploaded = running.stage.post("/v1/volumes", "application/zip", zip).await.json();
    let id = uploaded["id"].as_str().unwrap();
    let (mut client, welcome) = running.hello(json!({ "volume": id })).await;
    assert_eq!(welcome["volume"]["id"], id);
    client.still(0).await;
    let removal = axum::http::Request::delete(format!("/v1/volumes/{id}"));
    let removed = running.stage.ask(removal.body(axum::body::Body::empty()).unwrap()).await;
    assert_eq!(removed.status, 204);
    assert_eq!(client.closed().await, Some(4002));
    let (_client, again) = running.hello(json!({ "resume": welcome["session"] })).await;
    assert_eq!((&again["resumed"], &again["volume"]["id"]), (&json!(false), &json!(running.stage.id)));
}
