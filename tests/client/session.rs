//! A session and its connections: messages, composition of frames, reconnection.

use futures_util::SinkExt;
use relief_client::{Composer, Event, LinkState, Options};
use relief_display::{DisplayProfile, DisplaySettings, Header, Layout, ProfileName};
use relief_live::{ClientMessage, FrameHeader, Hello, Intent};
use tokio_tungstenite::tungstenite::Message;

use crate::client::stand_in::{
    Running, SIZE, accept, close, frame, header, listen, next, options, orbit, picture, welcome,
};

fn connected(event: &Event) -> Option<(u64, bool)> {
    match event {
        Event::State(LinkState::Connected { connection, resumed, .. }) => Some((*connection, *resumed)),
        _ => None,
    }
}

#[tokio::test]
async fn poses_intents_and_acks_arrive_in_one_row_of_numbers() {
    let (listener, address) = listen(None).await;
    let mut client = Running::start(options(address));
    let (mut socket, hello) = accept(&listener).await;
    assert_eq!((hello.resume, hello.view), (None, None));
    socket.send(welcome("t", false)).await.unwrap();
    client.until(connected).await;
    socket.send(Message::binary(frame(&header(1)))).await.unwrap();
    let received = client.frame().await;
    assert_eq!(client.handle.pose(5, orbit(1.0)), Some(1));
    assert_eq!(client.handle.intent(6, Intent::Undo {}), Some(2));
    assert_eq!(client.handle.pose(7, orbit(2.0)), Some(3));
    client.handle.ack(received.connection, received.header.sequence);
    let mut said = Vec::new();
    while said.len() < 4 {
        said.push(next(&mut socket).await.unwrap());
    }
    assert!(
        said.iter().any(|message| matches!(message, ClientMessage::Ack(ack) if ack.frame == 1)),
        "{said:?}"
    );
    let numbers: Vec<u64> = said
        .iter()
        .filter_map(|message| match message {
            ClientMessage::Pose(pose) => Some(pose.seq),
            ClientMessage::Intent(intent) => Some(intent.seq),
            _ => None,
        })
        .collect();
    assert_eq!(numbers, [1, 2, 3]);
    client.handle.stop();
    assert!(next(&mut socket).await.is_none(), "it says goodbye");
    client.ended().await.unwrap();
}

/// The display's frame is the layout of the original picture, pixel by pixel: placed here by hand.
#[tokio::test]
async fn the_composed_frame_has_picture_depth_and_header_where_the_display_looks_for_them() {
    let (listener, address) = listen(None).await;
    let mut client = Running::start(options(address));
    let (mut socket, _) = accept(&listener).await;
    socket.send(welcome("t", false)).await.unwrap();
    socket.send(Message::binary(frame(&header(3)))).await.unwrap();
    let received = client.frame().await;
    let asked = DisplaySettings::default().header();
    let composed =
        Composer::new(DisplayProfile::named(ProfileName::Philips42), Some(asked)).compose(&received).unwrap();
    assert_eq!(composed.header_problem, None);
    assert_eq!(composed.frame.size_px(), SIZE.map(|side| 2 * side as u32));
    let (color, disparity) = picture(3);
    let decoded = Layout::Wowvx.decode(&composed.frame).unwrap();
    assert_eq!(decoded.header.map(|header| header.fields()), Some(asked.fields()));
    assert_eq!(decoded.depth, relief_display::DecodedDepth::Disparity(disparity));
    let differing = decoded.color.iter().zip(&color).enumerate().filter(|(_, (a, b))| a[..] != b[..3]);
    // Only the top bit of blue, only on line 0, only at even pixels.
    for (at, (shown, sent)) in differing {
        assert!(
            at < SIZE[0] && at % 2 == 0 && shown[..2] == sent[..2] && shown[2] & 0x7f == sent[2] & 0x7f,
            "{at}"
        );
    }
    // A valid header that differs from the requested one is reported.
    let other = Header { factor: 99, use_factor: true, ..asked };
    let composer = Composer::new(DisplayProfile::named(ProfileName::Philips42), Some(other));
    assert!(composer.compose(&received).unwrap().header_problem.is_some());
    client.handle.stop();
    client.ended().await.unwrap();
}

#[tokio::test]
async fn a_lost_connection_is_made_again_with_the_token_and_no_old_acknowledgement() {
    let (listener, address) = listen(None).await;
    let mut client = Running::start(options(address));
    let (mut socket, _) = accept(&listener).await;
    socket.send(welcome("first", false)).await.unwrap();
    client.until(connected).await;
    socket.send(Message::binary(frame(&header(1)))).await.unwrap();
    let old = client.frame().await;
    drop(socket);
    client.until(|event| matches!(event, Event::State(LinkState::Lost { .. })).then_some(())).await;
    let (mut socket, hello) = accept(&listener).await;
    assert_eq!(hello.resume.as_deref(), Some("first"));
    socket.send(welcome("first", true)).await.unwrap();
    assert_eq!(client.until(connected).await, (2, true));
    // An acknowledgement of the old connection's frame does not count for the new one.
    client.handle.ack(old.connection, 77);
    client.handle.pose(9, orbit(9.0));
    match next(&mut socket).await {
        Some(ClientMessage::Pose(pose)) => assert_eq!(pose.t_ns, 9),
        other => panic!("{other:?}"),
    }
    client.handle.stop();
    client.ended().await.unwrap();
}

/// Invariant: Whatever a server sends, the client reports an error or goes on, in bounded memory; a
/// lost session resumes by its token or its view.
#[tokio::test]
async fn a_server_that_was_started_anew_gets_volume_preset_and_view() {
    let (listener, address) = listen(None).await;
    let mut client = Running::start(options(address));
    let (mut socket, _) = accept(&listener).await;
    socket.send(welcome("first", false)).await.unwrap();
    socket.send(Message::binary(frame(&header(1)))).await.unwrap();
    client.frame().await;
    drop((socket, listener));
    // Away for a while: attempts fail, and go on.
    for _ in 0..3 {
        client.until(|event| matches!(event, Event::State(LinkState::Lost { .. })).then_some(())).await;
    }
    let (listener, _) = listen(Some(address)).await;
    let (mut socket, hello) = accept(&listener).await;
    assert_eq!(hello.view.as_deref(), Some("desk"));
    assert_eq!(hello.volume.as_deref(), Some("0123456789abcdef"));
    assert_eq!(hello.settings.and_then(|settings| settings.preset).as_deref(), Some("bone"));
    socket.send(welcome("second", false)).await.unwrap();
    let mut intents = Vec::new();
    while intents.last() != Some(&Intent::Release {}) {
        match next(&mut socket).await {
            Some(ClientMessage::Intent(message)) => intents.push(message.intent),
            other => panic!("{other:?}"),
        }
    }
    assert!(matches!(intents[0], Intent::Look { zoom: Some(1.0), .. }), "{intents:?}");
    client.handle.stop();
    client.ended().await.unwrap();
}

#[tokio::test]
async fn a_session_that_is_over_is_not_begun_again() {
    // A volume that was removed ends a client that does not wait.
    for (code, word) in [(4001, "resumed"), (4002, "removed")] {
        let (listener, address) = listen(None).await;
        let client = Running::start(options(address));
        let (mut socket, _) = accept(&listener).await;
        socket.send(welcome("t", false)).await.unwrap();
        close(&mut socket, code, "").await;
        let error = client.ended().await.unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    }
}

/// A display box without `--volume` shows whatever the server has first.
#[tokio::test]
async fn a_client_that_waits_takes_the_first_volume_when_its_own_is_gone() {
    let (listener, address) = listen(None).await;
    let mut client = Running::start(Options { wait: true, ..options(address) });
    let (mut socket, hello) = accept(&listener).await;
    assert_eq!(hello.volume, None);
    socket.send(welcome("t", false)).await.unwrap();
    client.until(connected).await;
    close(&mut socket, 4002, "").await;
    let (mut socket, hello) = accept(&listener).await;
    assert_eq!((hello.volume, hello.resume), (None, None), "from its beginning");
    socket.send(welcome("u", false)).await.unwrap();
    client.until(connected).await;
    // The server was restarted with another volume: it does not know the last one.
    drop(socket);
    let (mut socket, hello) = accept(&listener).await;
    assert_eq!(hello.volume.as_deref(), Some("0123456789abcdef"));
    let problem = serde_json::json!({
        "type": "error", "problem": { "type": "urn:relief:problem:no-such-volume", "status": 404, "title": "none" }, "fatal": true,
    });
    socket.send(Message::text(problem.to_string())).await.unwrap();
    close(&mut socket, 1008, "").await;
    let (_socket, hello) = accept(&listener).await;
    assert_eq!((hello.volume, hello.resume), (None, None));
    client.handle.stop();
    client.ended().await.unwrap();
}

#[tokio::test]
async fn a_named_volume_is_waited_for() {
    let (listener, address) = listen(None).await;
    let named = Hello { volume: Some("feed".to_owned()), ..Hello::default() };
    let client = Running::start(Options { wait: true, hello: named, ..options(address) });
    for _ in 0..2 {
        let (mut socket, hello) = accept(&listener).await;
        assert_eq!(hello.volume.as_deref(), Some("feed"));
        let problem = serde_json::json!({
            "type": "error", "problem": { "type": "urn:relief:problem:no-such-volume", "status": 404, "title": "none" }, "fatal": true,
        });
        socket.send(Message::text(problem.to_string())).await.unwrap();
        close(&mut socket, 1008, "").await;
    }
    client.handle.stop();
    client.ended().await.unwrap();
}

/// A server that answers no ping is silent; it is heard when it answers.
#[tokio::test]
async fn silence_and_its_end_are_reported() {
    let (listener, address) = listen(None).await;
    let mut client = Running::start(options(address));
    let (mut socket, _) = accept(&listener).await;
    socket.send(welcome("t", false)).await.unwrap();
    client.until(connected).await;
    let state = |wanted: LinkState| {
        move |event: &Event| matches!(event, Event::State(state) if *state == wanted).then_some(())
    };
    client.until(state(LinkState::Silent)).await; // nothing reads the pings here
    let answering = tokio::spawn(async move { next(&mut socket).await });
    client.until(state(LinkState::Heard)).await;
    client.handle.stop();
    client.ended().await.unwrap();
    assert!(answering.await.unwrap().is_none());
}

/// While a client stops reading, messages wait in bounded memory; afterwards it receives the newest
/// pose.
#[tokio::test]
async fn a_server_that_reads_nothing_costs_no_memory_and_gets_the_newest_pose() {
    let (listener, address) = listen(None).await;
    let mut client = Running::start(options(address));
    let (mut socket, _) = accept(&listener).await;
    socket.send(welcome("t", false)).await.unwrap();
    client.until(connected).await;
    let last = 200_000_u32;
    for azimuth in 1..=last {
        client.handle.pose(1, orbit(f64::from(azimuth % 3600)));
        if azimuth % 1000 == 0 {
            tokio::task::yield_now().await;
            while client.events.try_recv().is_ok() {}
        }
    }
    client.handle.intent(2, Intent::Reset {});
    let mut poses = 0;
    loop {
        match next(&mut socket).await.unwrap() {
            ClientMessage::Pose(_) => poses += 1,
            ClientMessage::Intent(_) => break,
            other => panic!("{other:?}"),
        }
        while client.events.try_recv().is_ok() {}
    }
    assert!(poses < last, "{poses}");
    client.handle.stop();
    client.ended().await.unwrap();
}

#[tokio::test]
async fn frames_and_messages_side_by_side_do_not_wait_for_one_another() {
    let (listener, address) = listen(None).await;
    let mut client = Running::start(options(address));
    let (mut socket, _) = accept(&listener).await;
    socket.send(welcome("t", false)).await.unwrap();
    client.until(connected).await;
    // Both ends write more than the sockets hold before either reads its answers.
    let still = FrameHeader { still: false, ..header(1) };
    for sequence in 1..=500 {
        socket.send(Message::binary(frame(&FrameHeader { sequence, ..still }))).await.unwrap();
        client.handle.intent(1, Intent::Undo {});
    }
    for expected in 1..=500 {
        assert_eq!(client.frame().await.header.sequence, expected);
    }
    client.handle.stop();
    client.ended().await.unwrap();
}
