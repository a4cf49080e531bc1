//! Live views without a WebSocket: JPEGs without end, one frame at a time, intents by POST.

use std::time::Duration;

use axum::body::Body;
use axum::http::Request;
use image::ImageDecoder;
use relief_display::{DisplayProfile, Pixels, ProfileName};
use serde_json::json;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

use crate::server::live_stage::{PATIENCE, Running, intent};
use crate::server::stage::{Answer, Stage};

const HOST: (&str, &str) = ("host", "localhost");

async fn post(stage: &Stage, view: &str, intent: &str) -> Answer {
    let request = Request::post(format!("/v1/session/{view}/intent"))
        .header(HOST.0, HOST.1)
        .header("content-type", "application/json");
    stage.ask(request.body(Body::from(intent.to_owned())).unwrap()).await
}

#[tokio::test]
async fn a_plain_viewer_gets_the_very_frame_of_a_session() {
    let running = Running::new().await;
    let stage = &running.stage;
    let answer = post(stage, "desk", r#"{"intent":"look","azimuth_deg":40,"elevation_deg":10}"#).await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    assert_eq!(answer.json()["volume"], stage.id.as_str());
    let png = stage.get_with("/v1/session/desk/frame", &[HOST, ("accept", "image/png")]).await;
    assert_eq!((png.status.as_u16(), png.header("content-type")), (200, "image/png"));
    assert_eq!(png.header("cache-control"), "no-store");
    let decoder = image::codecs::png::PngDecoder::new(std::io::Cursor::new(&png.body[..])).unwrap();
    assert_eq!(decoder.dimensions(), (1920, 1080), "in the layout of the view");
    let mut samples = vec![0; usize::try_from(decoder.total_bytes()).unwrap()];
    decoder.read_image(&mut samples).unwrap();
    let (mut watcher, _) = running.hello(json!({ "view": "desk", "role": "watcher" })).await;
    let frame = watcher.still(0).await.compose(&DisplayProfile::named(ProfileName::Philips42)).unwrap();
    let Pixels::Rgb8(composed) = frame.pixels() else { panic!("colour") };
    assert!(*composed == samples);

    // A longer poll waits for the next frame.
    let number: u64 = png.header("relief-frame").parse().unwrap();
    let path = format!("/v1/session/desk/frame?after={number}&wait_ms=20000");
    let (_, next) = tokio::join!(
        async {
            tokio::time::sleep(Duration::from_millis(50)).await;
            post(stage, "desk", r#"{"intent":"orbit","azimuth_deg":5}"#).await
        },
        stage.get_with(&path, &[HOST, ("accept", "image/jpeg")]),
    );
    assert_eq!((next.status.as_u16(), next.header("content-type")), (200, "image/jpeg"));
    assert!(next.header("relief-frame").parse::<u64>().unwrap() > number);
    assert!(next.body.starts_with(&[0xFF, 0xD8]));
}

#[tokio::test]
async fn a_poll_for_what_does_not_come_ends_empty() {
    let running = Running::new().await;
    post(&running.stage, "desk", r#"{"intent":"reset"}"#).await;
    let first = running.stage.get_with("/v1/session/desk/frame", &[HOST]).await;
    let number = first.header("relief-frame").to_owned();
    let (mut watcher, _) = running.hello(json!({ "view": "desk", "role": "watcher" })).await;
    watcher.still(0).await;
    let newest: u64 = number.parse::<u64>().unwrap() + 100;
    let path = format!("/v1/session/desk/frame?after={newest}&wait_ms=100");
    let empty = running.stage.get_with(&path, &[HOST]).await;
    assert_eq!((empty.status.as_u16(), empty.body.len()), (204, 0));
}

#[tokio::test]
async fn views_at_rest_are_seen_from_beside_and_end_with_a_movement() {
    let running = Running::new().await;
    let stage = &running.stage;
    let settings = json!({ "size_px": [320, 180], "display": { "layout": "rgbd" } });
    let (mut presenter, _) = running.hello(json!({ "view": "desk", "settings": settings })).await;
    let still = presenter.still(0).await;
    let [width, height] = still.header.size_px.map(u32::from);
    for quality in ["true", "refined"] {
        let path = format!("/v1/session/desk/views?eyes=-16,0,16&quality={quality}");
        let answer = stage.get_with(&path, &[HOST]).await;
        assert_eq!((answer.status.as_u16(), answer.header("content-type")), (200, "image/png"));
        let views = image::load_from_memory(&answer.body).unwrap().into_rgb8();
        assert_eq!(views.dimensions(), (width, 3 * height));
        // The sphere stays where the camera looks, so that only the shift of the lens moves it.
        let middle = |view: u32| {
            let row = view * height + height / 2;
            let red: Vec<u32> = (0..width).filter(|x| views.get_pixel(*x, row)[0] > 100).collect();
            f64::from(red[0] + red[red.len() - 1]) / 2.0 - f64::from(width - 1) / 2.0
        };
        let [left, own, right] = [0, 1, 2].map(middle);
        assert!((left + right - 2.0 * own).abs() < 1.1 && right > own + 1.0, "{left}, {own}, {right} pixels");
        let own =
            views.as_raw().chunks_exact(3).skip((width * height) as usize).take((width * height) as usize);
        assert!(own.eq(still.color.iter()), "the eye in the middle sees the picture itself");
    }
    let path = format!("/v1/session/desk/views?eyes=0&frame={}", u64::MAX);
    assert_eq!(stage.get_with(&path, &[HOST]).await.status, 204);
}

#[tokio::test]
async fn jpegs_come_without_end_as_the_view_moves() {
    let running = Running::new().await;
    let (mut presenter, _) = running.hello(json!({ "view": "desk" })).await;
    presenter.still(0).await;
    let mut stream = TcpStream::connect(running.address).await.unwrap();
    stream.write_all(b"GET /v1/session/desk/mjpeg HTTP/1.1\r\nHost: localhost\r\n\r\n").await.unwrap();
    let mut received = Vec::new();
    let (mut seq, mut buffer) = (0, vec![0; 1 << 16]);
    let jpegs = |bytes: &[u8]| bytes.windows(3).filter(|three| *three == [0xFF, 0xD8, 0xFF]).count();
    while jpegs(&received) < 4 {
        seq += 1;
        presenter.send(&intent(seq, json!({ "intent": "orbit", "azimuth_deg": 3 }))).await;
        presenter.still(seq).await;
        let read = tokio::time::timeout(PATIENCE, stream.read(&mut buffer)).await.unwrap().unwrap();
        assert!(read > 0, "the stream ended");
        received.extend(&buffer[..read]);
    }
    let text = String::from_utf8_lossy(&received);
    assert!(text.starts_with("HTTP/1.1 200"), "{}", &text[..300]);
    assert!(text.contains("multipart/x-mixed-replace; boundary=relief-frame-boundary"));
    assert!(text.contains("--relief-frame-boundary\r\n") && text.contains("Content-Type: image/jpeg\r\n"));
    drop(stream);
    let peers = loop {
        let peers = presenter.event("peers").await;
        if peers["watchers"] == 0 {
            break peers;
        }
    };
    assert_eq!(peers["presenters"], 1);
}

#[tokio::test]
async fn streams_end_with_the_server() {
    let mut running = Running::new().await;
    post(&running.stage, "desk", r#"{"intent":"reset"}"#).await;
    let mut stream = TcpStream::connect(running.address).await.unwrap();
    stream.write_all(b"GET /v1/session/desk/mjpeg HTTP/1.1\r\nHost: localhost\r\n\r\n").await.unwrap();
    let mut buffer = [0; 1024];
    assert!(stream.read(&mut buffer).await.unwrap() > 0);
    running.stop();
    assert_eq!(running.ended().await, relief_server::Shutdown::Whole);
}

#[tokio::test]
async fn invalid_messages_are_answered_with_the_reason() {
    let running = Running::new().await;
    let stage = &running.stage;
    for (path, status, kind) in [
        ("nowhere/frame", 404, "no-such-view"),
        ("nowhere/mjpeg", 404, "no-such-view"),
        ("a%20b/frame", 400, "malformed-name"),
        ("nowhere/frame?wait_ms=60000", 422, "out-of-range"),
        ("nowhere/frame?after=x", 400, "malformed-parameter"),
        ("nowhere/frame?before=1", 400, "malformed-parameter"),
        ("nowhere/views?eyes=0", 404, "no-such-view"),
        ("nowhere/views", 400, "malformed-parameter"),
        ("nowhere/views?eyes=0,x", 422, "out-of-range"),
        ("nowhere/views?eyes=-16.5", 422, "out-of-range"),
    ] {
        let problem = stage.get_with(&format!("/v1/session/{path}"), &[HOST]).await.problem(status);
        assert_eq!(problem["type"], format!("urn:relief:problem:{kind}"), "{path}");
    }
    let text = stage.get_with("/v1/session/nowhere/frame", &[HOST, ("accept", "text/html")]).await;
    text.problem(406);
    post(stage, "desk", "{").await.problem(400);
    post(stage, "desk", r#"{"intent":"zoom","factor":1e9}"#).await.problem(422);
    let unknown = Request::post("/v1/session/desk/intent?volume=none")
        .header(HOST.0, HOST.1)
        .header("content-type", "application/json");
    stage.ask(unknown.body(Body::from(r#"{"intent":"reset"}"#)).unwrap()).await.problem(404);
    assert_eq!(stage.get_with("/v1/session/desk/frame", &[HOST]).await.status, 404, "nothing was made");
    let cross = Request::post("/v1/session/desk/intent")
        .header(HOST.0, HOST.1)
        .header("origin", "http://evil.example")
        .header("content-type", "application/json");
    stage.ask(cross.body(Body::from(r#"{"intent":"reset"}"#)).unwrap()).await.problem(403);
}
