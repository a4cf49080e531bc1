//! Servers that do wrong: the client ends with an error, or goes on, and never panics.

use std::time::Duration;

use futures_util::SinkExt;
use proptest::prelude::*;
use relief_client::{
    ClientError, Composer, Event, Journal, JournalEntry, LinkState, MAX_FRAME_BYTES, Received,
};
use relief_display::{DisplayProfile, ProfileName};
use relief_live::{FrameHeader, HEADER_BYTES};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio_tungstenite::tungstenite::Message;

use crate::client::stand_in::{Running, accept, close, frame, header, listen, options, welcome};

fn lost(event: &Event) -> Option<String> {
    match event {
        Event::State(LinkState::Lost { reason, .. }) => Some(reason.clone()),
        _ => None,
    }
}

#[tokio::test]
async fn an_unreachable_server_is_reported_with_its_address() {
    let (listener, address) = listen(None).await;
    drop(listener);
    let error = Running::start(options(address)).ended().await.unwrap_err();
    assert!(matches!(error, ClientError::Unreachable { .. }), "{error}");
    assert!(error.to_string().contains(&address.to_string()), "{error}");
}

/// Answers one connection with these bytes, and returns the client's result.
async fn answered(answer: &'static [u8]) -> ClientError {
    let (listener, address) = listen(None).await;
    let client = Running::start(options(address));
    let (mut stream, _) = listener.accept().await.unwrap();
    let mut request = [0; 4096];
    let _ = stream.read(&mut request).await.unwrap();
    stream.write_all(answer).await.unwrap();
    drop(stream);
    client.ended().await.unwrap_err()
}

#[tokio::test]
async fn foreign_servers_and_refusals_have_different_messages() {
    for answer in [
        &b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\nhi"[..],
        b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n",
        b"SSH-2.0-OpenSSH_9.2\r\n\r\n",
        b"\x00\x01\x02\x03\r\n\r\n",
    ] {
        let error = answered(answer).await;
        assert!(matches!(error, ClientError::NotRelief { .. }), "{error}");
    }
    let error = answered(b"HTTP/1.1 503 Service Unavailable\r\nContent-Type: application/problem+json\r\nContent-Length: 29\r\n\r\n{\"detail\":\"128 sessions open\"}").await;
    assert!(matches!(error, ClientError::Refused { passing: true, .. }), "{error}");
    let error = answered(b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\n\r\n").await;
    assert!(matches!(error, ClientError::Refused { passing: false, .. }), "{error}");
}

#[tokio::test]
async fn a_refused_hello_says_why() {
    let (listener, address) = listen(None).await;
    let client = Running::start(options(address));
    let (mut socket, _) = accept(&listener).await;
    let problem = r#"{"type":"error","problem":{"title":"Not Found","status":404,"detail":"there is no volume\u001b[2J x"},"fatal":true}"#;
    socket.send(Message::text(problem)).await.unwrap();
    close(&mut socket, 1008, "hello refused").await;
    let error = client.ended().await.unwrap_err();
    assert!(matches!(error, ClientError::Refused { .. }), "{error}");
    let text = error.to_string();
    assert!(text.contains("there is no volume") && !text.contains('\u{1b}'), "{text:?}");
}

/// The server's messages after welcome, and the client's error when it gives up the connection.
async fn after_welcome(message: Message) -> String {
    let (listener, address) = listen(None).await;
    let mut client = Running::start(options(address));
    let (mut socket, _) = accept(&listener).await;
    socket.send(welcome("t", false)).await.unwrap();
    let _ = socket.send(message).await;
    let reason = client.until(lost).await;
    client.handle.stop();
    reason
}

#[tokio::test]
async fn pings_without_end_end_the_connection() {
    for greets in [false, true] {
        let (listener, address) = listen(None).await;
        let mut client = Running::start(options(address));
        let (mut socket, _) = accept(&listener).await;
        if greets {
            socket.send(welcome("t", false)).await.unwrap();
        }
        // The server does not read what the client sends.
        let flood =
            tokio::spawn(
                async move { while socket.send(Message::Ping(vec![7; 125].into())).await.is_ok() {} },
            );
        // Before the welcome the client ends; after it, it reconnects.
        let reason = if greets {
            let reason = client.until(lost).await;
            client.handle.stop();
            reason
        } else {
            client.ended().await.unwrap_err().to_string()
        };
        assert!(reason.contains("too many pings"), "{reason}");
        tokio::time::timeout(Duration::from_secs(60), flood).await.expect("the connection ends").unwrap();
    }
}

/// Invariant: Whatever a server sends, the client reports an error or goes on, in bounded memory; a
/// lost session resumes by its token or its view.
#[tokio::test]
async fn frames_without_a_header_end_the_connection_and_not_the_client() {
    let whole = frame(&header(1));
    let mut magic = whole.clone();
    magic[0] = b'X';
    let mut sum = whole.clone();
    sum[12] ^= 1;
    let cases = [
        (whole[..HEADER_BYTES - 1].to_vec(), "127 bytes"),
        (whole[..whole.len() - 1].to_vec(), "bytes, expected"),
        ([&whole[..], &[0]].concat(), "bytes, expected"),
        (Vec::new(), "0 bytes"),
        (magic, "begins with"),
        (sum, "CRC-32"),
    ];
    for (bytes, expected) in cases {
        let reason = after_welcome(Message::binary(bytes)).await;
        assert!(reason.contains(expected), "{reason}");
    }
}

#[tokio::test]
async fn more_bytes_than_any_frame_has_are_not_taken() {
    let reason = after_welcome(Message::binary(vec![0; MAX_FRAME_BYTES + 1])).await;
    assert!(reason.contains("too long") || reason.contains("limit"), "{reason}");
}

/// Invariant: Whatever a server sends, the client reports an error or goes on, in bounded memory; a
/// lost session resumes by its token or its view.
#[tokio::test]
async fn unreadable_messages_are_reported_until_a_limit() {
    let (listener, address) = listen(None).await;
    let mut client = Running::start(options(address));
    let (mut socket, _) = accept(&listener).await;
    socket.send(welcome("t", false)).await.unwrap();
    for text in ["", "[]", "{}", "{\"type\":\"surprise\"}", "{\"type\":\"peers\",\"presenters\":-1}"] {
        socket.send(Message::text(text)).await.unwrap();
        client.until(|event| matches!(event, Event::Unreadable(_)).then_some(())).await;
    }
    socket.send(Message::binary(frame(&header(1)))).await.unwrap();
    client.frame().await;
    for _ in 0..20 {
        let _ = socket.send(Message::text("{")).await;
    }
    assert!(client.until(lost).await.contains("unreadable"));
    client.handle.stop();
    client.ended().await.unwrap();
}

#[tokio::test]
async fn a_missing_or_invalid_welcome_ends_with_an_error() {
    for (message, expected) in [
        (Message::text("{\"type\":\"welcome\"}"), "does not answer as a Relief server"),
        (Message::binary(frame(&header(1))), "a frame before welcome"),
        (Message::text("x".repeat(100_000)), "a text message of 100000 bytes"),
    ] {
        let (listener, address) = listen(None).await;
        let client = Running::start(options(address));
        let (mut socket, _) = accept(&listener).await;
        socket.send(message).await.unwrap();
        let error = client.ended().await.unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
    let (listener, address) = listen(None).await;
    let client = Running::start(options(address));
    let (socket, _) = accept(&listener).await;
    drop(socket);
    assert!(matches!(client.ended().await, Err(ClientError::Lost { .. })));
}

/// With `wait` a server that is not there yet, or has no room, is waited for.
#[tokio::test]
async fn a_server_that_comes_later_is_found() {
    let (listener, address) = listen(None).await;
    drop(listener);
    let mut client = Running::start(relief_client::Options { wait: true, ..options(address) });
    client.until(lost).await;
    client.until(lost).await;
    let (listener, _) = listen(Some(address)).await;
    let (mut socket, _) = accept(&listener).await;
    socket.send(welcome("t", false)).await.unwrap();
    client.until(|event| matches!(event, Event::State(LinkState::Connected { .. })).then_some(())).await;
    client.handle.stop();
    client.ended().await.unwrap();
}

/// Stopping does not wait for a server that says nothing.
#[tokio::test]
async fn a_client_can_be_stopped_before_it_is_welcome() {
    let (listener, address) = listen(None).await;
    let client = Running::start(options(address));
    let _held = accept(&listener).await;
    client.handle.stop();
    tokio::time::timeout(Duration::from_secs(60), client.ended()).await.unwrap().unwrap();
}

fn composer() -> Composer {
    Composer::new(DisplayProfile::named(ProfileName::Philips42), None)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Payloads that are damaged behind a good header are an error.
    #[test]
    fn damaged_pictures_compose_or_are_refused(flips in proptest::collection::vec((HEADER_BYTES..4000usize, any::<u8>()), 1..8)) {
        let mut bytes = frame(&header(1));
        for (at, byte) in flips {
            let at = at.min(bytes.len() - 1);
            bytes[at] = byte;
        }
        let received = Received { connection: 1, at_ns: 1, header: header(1), bytes: bytes.into() };
        let _ = composer().compose(&received);
    }

    /// Invariant: Whatever a server sends, the client reports an error or goes on, in bounded
    /// memory; a lost session resumes by its token or its view.
    ///
    /// Sizes and lengths that a header claims give memory for no more than there is to unpack.
    #[test]
    fn claimed_sizes_are_refused(width in 1u16.., height in 1u16.., jpeg in any::<bool>()) {
        let color = if jpeg { relief_live::ColorFormat::Jpeg } else { relief_live::ColorFormat::RgbZstd };
        let small = FrameHeader { color, ..header(1) };
        let mut bytes = frame(&small);
        let parts = FrameHeader::decode(&bytes).unwrap();
        let claimed = FrameHeader { size_px: [width, height], full_px: [width, height], ..parts };
        bytes[..HEADER_BYTES].copy_from_slice(&claimed.encode());
        let received = Received { connection: 1, at_ns: 1, header: claimed, bytes: bytes.into() };
        if claimed.size_px != small.size_px {
            prop_assert!(composer().compose(&received).is_err());
        }
    }

    /// A small picture that claims to stand for one of more than 16,777,216 pixels.
    #[test]
    fn claimed_full_sizes_are_refused(width in 4097u16..=16384, height in 4097u16..=16384) {
        let small = header(1);
        let mut bytes = frame(&small);
        let claimed = FrameHeader { full_px: [width, height], ..FrameHeader::decode(&bytes).unwrap() };
        bytes[..HEADER_BYTES].copy_from_slice(&claimed.encode());
        let received = Received { connection: 1, at_ns: 1, header: claimed, bytes: bytes.into() };
        let refused = composer().compose(&received).unwrap_err().to_string();
        prop_assert!(refused.contains("full_px") && refused.contains("16777216"), "{}", refused);
    }

    /// Any text is a session or none.
    #[test]
    fn any_file_is_a_session_or_an_error(text in "(\\{\"relief_session\":1,\"hello\":\\{\"type\":\"hello\"\\}\\}\n)?[ -~\n]{0,300}") {
        if let Ok(journal) = Journal::open(text.as_bytes()) {
            for entry in journal.take(1000) {
                let Ok(entry) = entry else { break };
                prop_assert!(matches!(entry, JournalEntry::Other | JournalEntry::Sent(..) | JournalEntry::Still(_)));
            }
        }
    }
}
