//! Clients that are a burden: they take nothing from their connection, or acknowledge nothing.

use std::time::Duration;

use futures_util::{SinkExt, StreamExt};
use tokio::time::{interval, sleep, timeout};
use tokio_tungstenite::tungstenite::Message;

use super::turned;
use crate::access::Access;
use crate::address::ServerAddress;
use crate::handle::Handle;
use crate::socket::{self, Socket};
use relief_live::{ClientMessage, Hello, Pose, Role};

/// Longer than a server keeps a connection that answers no ping.
const HELD: Duration = Duration::from_secs(40);
const AGAIN: Duration = Duration::from_secs(1);
const POSES: Duration = Duration::from_millis(100);

/// The results of stalled clients.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StalledLoad {
    pub(super) frames_max: u32,
    pub(super) ended: u64,
    pub(super) failed: u64,
}

impl StalledLoad {
    pub(super) fn with(self, other: Self) -> Self {
        Self {
            frames_max: self.frames_max.max(other.frames_max),
            ended: self.ended + other.ended,
            failed: self.failed + other.failed,
        }
    }
}

/// Every other client reads nothing, the others acknowledge nothing, until stopped.
pub(super) async fn stall(
    server: ServerAddress,
    access: Access,
    mut hello: Hello,
    at: usize,
    stop: Handle,
) -> StalledLoad {
    let mut burden = StalledLoad::default();
    let reads = !at.is_multiple_of(2);
    let moves = hello.role == Role::Presenter;
    let mut was_connected = false;
    let stalling = async {
        loop {
            match socket::open(&server, &access, &hello, &hello).await {
                Ok((socket, welcome)) => {
                    was_connected = true;
                    hello.resume = Some(welcome.session.clone());
                    (hello.view, hello.volume, hello.settings) = (None, None, None);
                    burden.ended += u64::from(hold(socket, reads, moves, &mut burden.frames_max).await);
                }
                Err(_) => {
                    burden.failed += u64::from(!was_connected);
                    sleep(AGAIN).await;
                }
            }
        }
    };
    tokio::select! {
        () = stalling => {}
        () = stop.stopped() => {}
    }
    burden
}

/// Holds a connection for a while; whether the server ended it.
async fn hold(socket: Socket, reads: bool, moves: bool, frames_max: &mut u32) -> bool {
    let (mut sink, mut stream) = socket.split();
    let pushing = async {
        let mut ticks = interval(POSES);
        for seq in 1.. {
            ticks.tick().await;
            let pose = Pose { seq, t_ns: seq, what: turned(seq as f64 * POSES.as_secs_f64()) };
            if moves && sink.send(Message::text(ClientMessage::Pose(pose).to_text())).await.is_err() {
                return;
            }
        }
    };
    let taking = async {
        if !reads {
            std::future::pending::<()>().await;
        }
        let mut frames = 0;
        while let Some(Ok(message)) = stream.next().await {
            if matches!(message, Message::Binary(_)) {
                frames += 1;
                *frames_max = frames.max(*frames_max);
            }
        }
    };
    let held = async {
        tokio::select! {
            () = pushing => {}
            () = taking => {}
        }
    };
    timeout(HELD, held).await.is_ok()
}
