//! Over real sockets: slow, stalled or vanished clients affect no other client, and a shutdown
//! finishes running work.

use std::net::SocketAddr;
use std::time::Duration;

use relief_server::{ConnectionLimits, Shutdown, serve};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

use crate::server::stage::Stage;

struct Running {
    stage: Stage,
    address: SocketAddr,
    stop: Option<oneshot::Sender<()>>,
    ended: JoinHandle<Shutdown>,
}

async fn start(limits: ConnectionLimits) -> Running {
    let stage = Stage::new();
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let (stop, stopped) = oneshot::channel::<()>();
    let app = stage.app.clone();
    let ended = tokio::spawn(async move {
        serve(listener, None, app, limits, async move {
            let _ = stopped.await;
        })
        .await
    });
    Running { stage, address, stop: Some(stop), ended }
}

impl Running {
    async fn send(&self, path: &str) -> TcpStream {
        let mut stream = TcpStream::connect(self.address).await.unwrap();
        let head = format!("GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
        stream.write_all(head.as_bytes()).await.unwrap();
        stream
    }

    async fn get(&self, path: &str) -> String {
        read(self.send(path).await).await
    }

    fn stop(&mut self) {
        self.stop.take().unwrap().send(()).unwrap();
    }
}

async fn read(mut stream: TcpStream) -> String {
    let mut answer = Vec::new();
    let whole = tokio::time::timeout(Duration::from_secs(60), stream.read_to_end(&mut answer)).await;
    whole.expect("an answer in time").unwrap();
    String::from_utf8_lossy(&answer).into_owned()
}

#[tokio::test]
async fn stopping_finishes_what_runs_and_takes_nothing_new() {
    let mut running = start(ConnectionLimits::default()).await;
    running.stage.gate.close();
    let slow = running.send(&running.stage.path("frame?zoom=2")).await;
    let idle = TcpStream::connect(running.address).await.unwrap();
    running.stage.gate.held().await;
    running.stop();
    while TcpStream::connect(running.address).await.is_ok() {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    assert!(!running.ended.is_finished(), "a request is running");
    running.stage.gate.open();
    assert!(read(slow).await.starts_with("HTTP/1.1 200"));
    assert_eq!(running.ended.await.unwrap(), Shutdown::Whole);
    drop(idle);
}

#[tokio::test]
async fn stopping_does_not_wait_for_ever() {
    let limits = ConnectionLimits { drain_timeout: Duration::from_millis(50), ..ConnectionLimits::default() };
    let mut running = start(limits).await;
    running.stage.gate.close();
    let _slow = running.send(&running.stage.path("frame")).await;
    running.stage.gate.held().await;
    running.stop();
    assert_eq!(running.ended.await.unwrap(), Shutdown::CutOff);
    running.stage.gate.open();
}

#[tokio::test]
async fn a_head_that_dawdles_is_cut_off() {
    let limits = ConnectionLimits { head_timeout: Duration::from_millis(100), ..ConnectionLimits::default() };
    let running = start(limits).await;
    let mut stream = TcpStream::connect(running.address).await.unwrap();
    stream.write_all(b"GET /healthz HT").await.unwrap();
    let answer = read(stream).await;
    assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 408"), "{answer}");
    assert!(running.get("/healthz").await.starts_with("HTTP/1.1 200"));
}

/// Invariant: A request of a client that left is cancelled; a slow client delays no other.
#[tokio::test]
async fn a_client_that_takes_nothing_gives_its_place_away() {
    let limits = ConnectionLimits {
        connections: 1,
        stall_timeout: Duration::from_millis(200),
        ..ConnectionLimits::default()
    };
    let running = start(limits).await;
    let socket = TcpSocket::new_v4().unwrap();
    socket.set_recv_buffer_size(4096).unwrap();
    let mut stalled = socket.connect(running.address).await.unwrap();
    // 8 MB: more than the buffers of both sides hold.
    let path = running.stage.path("frame?layout=color&size_px=1000,1000");
    let head = format!("GET {path} HTTP/1.1\r\nHost: localhost\r\nAccept: application/octet-stream\r\n\r\n");
    stalled.write_all(head.as_bytes()).await.unwrap();
    while running.stage.gate.count() == 0 {
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    assert!(running.get("/healthz").await.starts_with("HTTP/1.1 200"), "the only place is free again");
    let mut rest = Vec::new();
    let whole = 8_000_000;
    let ended = stalled.read_to_end(&mut rest).await;
    assert!(ended.is_err() || rest.len() < whole, "it was cut off after {} bytes", rest.len());
}

/// Invariant: A request of a client that left is cancelled; a slow client delays no other.
#[tokio::test]
async fn the_order_of_a_vanished_client_is_not_rendered() {
    let running = start(ConnectionLimits::default()).await;
    running.stage.gate.close();
    let first = running.send(&running.stage.path("frame?zoom=2")).await;
    running.stage.gate.held().await;
    let vanishing = running.send(&running.stage.path("frame?zoom=3")).await;
    while running.stage.service.waiting() < 1 {
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    drop(vanishing);
    let in_flight = |text: &str, count: u32| text.contains(&format!("relief_requests_in_flight {count}\n"));
    while !in_flight(&running.get("/metrics").await, 2) {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    let last = running.send(&running.stage.path("frame?zoom=4")).await;
    while running.stage.service.waiting() < 2 {
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    running.stage.gate.open();
    for answer in [read(first).await, read(last).await] {
        assert!(answer.starts_with("HTTP/1.1 200"));
    }
    assert_eq!(running.stage.gate.count(), 2, "the vanished client's frame was not rendered");
}

/// Invariant: A request of a client that left is cancelled; a slow client delays no other.
#[tokio::test]
async fn the_render_of_a_vanished_client_ends_and_the_next_is_served() {
    let running = start(ConnectionLimits::default()).await;
    running.stage.gate.close();
    let vanishing = running.send(&running.stage.path("frame?zoom=2")).await;
    running.stage.gate.held().await;
    drop(vanishing);
    // The gate stays closed: the render ends only because no client waits for it.
    let ended = "relief_render_abandoned_total{when=\"rendering\"} 1\n";
    while !running.get("/metrics").await.contains(ended) {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    running.stage.gate.open();
    assert!(running.get(&running.stage.path("frame?zoom=3")).await.starts_with("HTTP/1.1 200"));
    assert!(
        running.get("/readyz").await.starts_with("HTTP/1.1 200"),
        "a cancelled render says nothing of the adapter"
    );
}

#[tokio::test]
async fn a_connection_serves_one_request_after_another() {
    let running = start(ConnectionLimits::default()).await;
    let mut stream = TcpStream::connect(running.address).await.unwrap();
    for _ in 0..3 {
        stream.write_all(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n").await.unwrap();
        let mut buffer = [0; 4096];
        let read = stream.read(&mut buffer).await.unwrap();
        assert!(buffer[..read].starts_with(b"HTTP/1.1 200"));
    }
}
