//! Limits of live sessions: pings, and views of one caller.

use axum::body::Body;
use axum::http::Request;
use relief_live::SUBPROTOCOL;
use relief_server::{Config, LiveConfig};
use serde_json::json;
use tokio_tungstenite::tungstenite::Message;

use crate::server::live_stage::{Came, Running};
use crate::server::owners::{ANNA, BEN, known};

/// Invariant: A client that sends pings and reads nothing is disconnected before its pongs fill the memory.
#[tokio::test]
async fn pings_without_end_end_the_connection() {
    for greets in [false, true] {
        let running = Running::new().await;
        let mut client = running.connect(&[("sec-websocket-protocol", SUBPROTOCOL)]).await.unwrap();
        if greets {
            client.send(&json!({ "type": "hello" })).await;
            client.event("welcome").await;
        }
        // Far more than the limit and the buffers of the socket.
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

/// Invariant: One caller has at most half of the views. Views without viewers are closed for its next ones,
/// and other callers can open views.
#[tokio::test]
async fn one_caller_leaves_views_for_others() {
    let known = known();
    // The limit of views is twice that of sessions: 8.
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
