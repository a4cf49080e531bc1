//! Messages that are wrong, and formats that are agreed on.

use proptest::prelude::*;
use relief_live::{ClientMessage, ServerMessage};

proptest! {
    /// Invariant: docs/LIVE.md, `protocol.json` and the code agree about header, names and
    /// messages; any bytes are read or refused.
    #[test]
    fn any_text_is_a_message_or_refused(text in "\\PC{0,200}") {
        let _ = ClientMessage::parse(&text);
        let _ = ServerMessage::parse(&text);
    }
}

#[test]
fn messages_are_refused_with_path_and_reason() {
    for (text, path, reason) in [
        ("", ".", "EOF"),
        ("[1]", ".", "expected a map"),
        ("{}", "type", "missing"),
        (r#"{"type":"greet"}"#, "type", "hello, pose"),
        (r#"{"type":"hello","view":"a b"}"#, "view", "letters"),
        (r#"{"type":"hello","accept":["jpeg"]}"#, "accept", "array"),
        (r#"{"type":"hello","settings":{"display":{"factor":300}}}"#, "settings.display.factor", "0 to 255"),
        (r#"{"type":"hello","settings":{"quality":{"budget_ms":0}}}"#, "settings.quality", "1 to 60000"),
        (r#"{"type":"pose","seq":1,"t_ns":1}"#, ".", "one of"),
        (r#"{"type":"pose","seq":-1,"t_ns":1}"#, "seq", "-1"),
        (r#"{"type":"pose","seq":1,"t_ns":1,"state":"tracking"}"#, "state", "position_mm"),
        (r#"{"type":"pose","seq":1,"t_ns":1,"state":"lost","buttons":["b","b"]}"#, "buttons[1]", "once"),
        (r#"{"type":"pose","seq":1,"t_ns":1,"orbit":{"azimuth_deg":"x"}}"#, "orbit.azimuth_deg", "string"),
        (r#"{"type":"intent","seq":1,"t_ns":1,"intent":"dance"}"#, "intent", "dance"),
        (r#"{"type":"intent","seq":1,"intent":"reset"}"#, "t_ns", "expected a whole number"),
        (r#"{"type":"intent","seq":1,"t_ns":2,"intent":"zoom","factor":1e9}"#, "intent", "0.01 to 100"),
        (r#"{"type":"ack","frame":1.5}"#, "frame", "1.5"),
        (r#"{"type":"ack","frame":1,"more":2}"#, "more", "unknown field"),
    ] {
        let refused = ClientMessage::parse(text).unwrap_err();
        assert!(refused.path == path && refused.source.to_string().contains(reason), "{text}: {refused:?}");
    }
    let long = format!(r#"{{"type":"ack","frame":1,"x":"{}"}}"#, "a".repeat(70_000));
    assert!(ClientMessage::parse(&long).unwrap_err().source.to_string().contains("65536"));
    assert!(ClientMessage::parse(&"[".repeat(60_000)).is_err(), "nesting has a limit");
    for digits in ["3", "3g", &"00".repeat(23)] {
        let text = format!(r#"{{"type":"report","seq":1,"t_ns":1,"report":"{digits}"}}"#);
        let ClientMessage::Report(report) = ClientMessage::parse(&text).unwrap() else { panic!("a report") };
        assert_eq!(report.bytes().unwrap_err().path, "report", "{digits}");
    }
}

#[test]
fn formats_are_agreed_on_by_the_clients_preference() {
    let agreed = |accept: &str| {
        let text = format!(r#"{{"type":"hello","accept":{accept}}}"#);
        let ClientMessage::Hello(hello) = ClientMessage::parse(&text).unwrap() else { panic!("a hello") };
        hello.accept.negotiate().map(|f| (f.color.moving.name(), f.color.still.name(), f.depth.name()))
    };
    assert_eq!(agreed("{}"), Ok(("jpeg", "rgb-zstd", "d8-zstd")));
    assert_eq!(
        agreed(r#"{"color":["webp","rgb-deflate","jpeg"],"depth":["z16-zstd","none"]}"#),
        Ok(("rgb-deflate", "rgb-deflate", "z16-zstd"))
    );
    assert_eq!(agreed(r#"{"color":["jpeg"],"depth":["x","none"]}"#), Ok(("jpeg", "jpeg", "none")));
    assert_eq!(agreed(r#"{"color":["webp"]}"#).unwrap_err().what, "color");
    assert_eq!(agreed(r#"{"depth":[]}"#).unwrap_err().what, "depth");
}
