//! Limits of live sessions against clients that take more than their share.

use axum::body::Body;
use axum::http::Request;
use relief_live::SUBPROTOCOL;
use relief_server::{Config, LiveConfig};
use serde_json::json;
use tokio_tungstenite::tungstenite::Message;

use crate::server::live_stage::{Came, Running};
use crate::server::owners::{ANNA, BEN, known};

/// Invariant: A client that sends pings without end, and reads nothing, is disconnected before its pongs fill the
/// memory.
#[tokio::test]
async fn pings_without_end_end_the_connection() {
    for greets in [false, true] {
        let running = Running::new().await;
        let mut client = running.connect(&[("sec-websocket-protocol", SUBPROTOCOL)]).await.unwrap();
        if greets {
            client.send(&json!({ "type": "hello" })).await;
            client.event("welcome").await;
        }
        // The two limits: the burst, and what the socket's buffers hold.
        for _ in 0..100_000 {
            client.send_raw(Message::Ping(vec![7; 125].into())).await;
        }
        let code = loop {
            match client.next().await {
                Came::Closed(code) => break code,
                Came::Text(_) | Came::Frame(_) => {}
            }
        };
        assert!(code.is_none() || code == Some(1008), "{code:?}");
        assert_eq!(running.stage.get("/healthz").await.status, 200);
    }
}

/// Invariant: One caller has at most half of the views: a view that it left makes room for the next, and other
/// callers find room.
#[tokio::test]
async fn one_caller_leaves_views_for_others() {
    let known = known();
    // Eight views: two for each session.
    let live = LiveConfig { sessions: 4, ..LiveConfig::default() };
    let running = Running::of(Config { live, ..known.config() }).await;
    for _ in 0..20 {
        known.hello(&running, BEN, json!({})).await;
    }
    known.hello(&running, ANNA, json!({})).await;
    let intent = |name: &str| {
        let path = format!("/v1/session/{name}/intent");
        let request = Request::post(path)
            .header("content-type", "application/json")
            .header("authorization", known.bearer(BEN));
        request.body(Body::from(r#"{"intent":"orbit","azimuth_deg":1,"elevation_deg":0}"#)).unwrap()
    };
    for number in 0..20 {
        assert_eq!(running.stage.ask(intent(&format!("v{number}"))).await.status, 200);
    }
    known.hello(&running, ANNA, json!({})).await;
}
