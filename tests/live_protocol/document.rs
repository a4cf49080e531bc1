//! docs/LIVE.md, protocol.json and the code: the same header, the same names, the same messages.

use std::collections::BTreeSet;

use relief_display::Layout;
use relief_live::{
    ClientMessage, ColorFormat, DepthFormat, FIELDS, FLAGS, FrameHeader, HEADER_BYTES, LiveLayout,
    SUBPROTOCOL, ServerMessage,
};
use serde_json::Value;

use crate::live_protocol::header;

const LIVE_MD: &str = include_str!("../../docs/LIVE.md");

fn protocol() -> Value {
    serde_json::from_str(relief_live::protocol()).unwrap()
}

/// Invariant: docs/LIVE.md, `protocol.json` and the code agree about header, names and messages;
/// any bytes are read or refused.
#[test]
fn document_description_and_code_have_the_same_header() {
    let fields = protocol()["header"]["fields"].as_array().unwrap().clone();
    let rows: Vec<Vec<&str>> = LIVE_MD
        .lines()
        .skip_while(|line| !line.starts_with("| offset |"))
        .skip(2)
        .take_while(|line| line.starts_with('|'))
        .map(|line| line.trim_matches('|').split(" | ").map(str::trim).collect())
        .collect();
    assert_eq!((fields.len(), rows.len()), (FIELDS.len(), FIELDS.len()));
    let mut next = 0;
    for ((field, row), own) in fields.iter().zip(&rows).zip(FIELDS) {
        assert_eq!(own.offset, next, "{} begins where the last field ends", own.name);
        let size = own.kind[1..].parse::<usize>().unwrap() / 8;
        next += size * own.count;
        assert_eq!(field["name"], own.name);
        assert_eq!(field["offset"], own.offset, "{}", own.name);
        assert_eq!((&field["type"], &field["count"]), (&Value::from(own.kind), &Value::from(own.count)));
        let kind = if own.count == 1 { own.kind.to_owned() } else { format!("{} x{}", own.kind, own.count) };
        let expected = [
            own.offset.to_string(),
            kind,
            format!("`{}`", own.name),
            field["meaning"].as_str().unwrap().to_owned(),
        ];
        assert_eq!(*row, expected);
    }
    assert_eq!(next, HEADER_BYTES);
    assert_eq!(protocol()["header"]["bytes"], HEADER_BYTES);
    for (bit, name) in FLAGS {
        assert_eq!(protocol()["header"]["flags"][bit.to_string()], name);
    }
}

/// The encoder puts every field where the table has it: a change of the field changes its bytes and
/// the checksum, and no others.
#[test]
fn the_encoder_puts_every_field_where_the_table_has_it() {
    let base = FrameHeader { color_bytes: 1, depth_bytes: 1, full_px: [9, 9], ..header() };
    let before = base.encode();
    let changes: [(&str, FrameHeader); 19] = [
        ("sequence", FrameHeader { sequence: 0xFFFF_FFFF, ..base }),
        ("shows_seq", FrameHeader { shows_seq: u64::MAX, ..base }),
        ("shows_t_ns", FrameHeader { shows_t_ns: u64::MAX, ..base }),
        ("total_us", FrameHeader { total_us: 0, ..base }),
        ("render_us", FrameHeader { render_us: 0, ..base }),
        ("wait_us", FrameHeader { wait_us: 0, ..base }),
        ("encode_us", FrameHeader { encode_us: 0, ..base }),
        ("size_px", FrameHeader { size_px: [5, 3], ..base }),
        ("full_px", FrameHeader { full_px: [500, 600], ..base }),
        ("near_mm", FrameHeader { limits_mm: [-7.0, 300.0], ..base }),
        ("far_mm", FrameHeader { limits_mm: [100.0, 777.0], ..base }),
        ("display", FrameHeader { display: [0, 1, 2, 0x40], ..base }),
        ("layout", FrameHeader { layout: LiveLayout::Of(Layout::Rgbd), ..base }),
        ("color_bytes", FrameHeader { color_bytes: u32::MAX, ..base }),
        ("depth_bytes", FrameHeader { depth_bytes: u32::MAX, ..base }),
        ("camera_eye_mm", FrameHeader { eye_mm: [1.5; 3], ..base }),
        ("camera_look_at_mm", FrameHeader { look_at_mm: [1.5; 3], ..base }),
        ("camera_up", FrameHeader { up: [1.5; 3], ..base }),
        ("camera_projection", FrameHeader { projection: [0.0, 55.0], ..base }),
    ];
    for (name, changed) in changes {
        let field = FIELDS.iter().find(|field| field.name == name).unwrap();
        let after = changed.encode();
        let size = field.kind[1..].parse::<usize>().unwrap() / 8 * field.count;
        let range = field.offset..field.offset + size;
        for at in (0..124).filter(|at| !range.contains(at)) {
            assert_eq!(before[at], after[at], "{name} changes byte {at}");
        }
        assert_ne!(before[range.clone()], after[range], "{name}");
    }
    for (still, back_layer, flags) in [(false, false, 1), (true, false, 5), (false, true, 9)] {
        assert_eq!(FrameHeader { still, back_layer, ..base }.encode()[9], flags);
    }
    assert_eq!(FrameHeader { full_px: base.size_px, ..base }.encode()[9], 1 | 2 | 4);
}

#[test]
fn document_description_and_code_have_the_same_names() {
    let protocol = protocol();
    assert_eq!(protocol["subprotocol"], SUBPROTOCOL);
    let listed = |key: &str| {
        let names = protocol[key].as_object().unwrap().clone();
        names
            .into_iter()
            .map(|(byte, name)| (byte, name.as_str().unwrap().to_owned()))
            .collect::<BTreeSet<_>>()
    };
    let own = ColorFormat::ALL.map(|format| (format.byte().to_string(), format.name().to_owned()));
    assert_eq!(listed("color_formats"), own.into());
    let own = DepthFormat::ALL.map(|format| (format.byte().to_string(), format.name().to_owned()));
    assert_eq!(listed("depth_formats"), own.into());
    let own = LiveLayout::all().map(|layout| (layout.byte().to_string(), layout.name().into_owned()));
    assert_eq!(listed("layouts"), own.collect());
    let limits = &protocol["limits"];
    assert_eq!(limits["text_bytes"], relief_live::MAX_TEXT_BYTES);
    assert_eq!(limits["frames_in_flight"], relief_live::MAX_IN_FLIGHT);
    for (code, _) in protocol["close_codes"].as_object().unwrap() {
        assert!(LIVE_MD.contains(&format!("| {code} | ")), "docs/LIVE.md explains close code {code}");
    }
    for (side, types) in [("client", &ClientMessage::TYPES[..]), ("server", &ServerMessage::TYPES[..])] {
        let described: BTreeSet<&str> =
            protocol[side].as_object().unwrap().keys().map(String::as_str).collect();
        assert_eq!(described, types.iter().copied().collect());
        for kind in types {
            assert!(LIVE_MD.contains(&format!("`{kind}`")), "docs/LIVE.md explains {kind}");
        }
    }
}

/// Whether the code takes a message of this side.
fn parses(side: &str, text: &str) -> Result<String, String> {
    match side {
        "client" => ClientMessage::parse(text).map(|message| message.to_text()).map_err(|e| e.to_string()),
        _ => ServerMessage::parse(text).map(|message| message.to_text()).map_err(|e| e.to_string()),
    }
}

/// Invariant: docs/LIVE.md, `protocol.json` and the code agree about header, names and messages;
/// any bytes are read or refused.
#[test]
fn every_example_is_read_and_written_and_their_keys_are_those_described() {
    let protocol = protocol();
    for side in ["client", "server"] {
        for (kind, schema) in protocol[side].as_object().unwrap() {
            let mut keys = BTreeSet::new();
            for example in schema["examples"].as_array().unwrap() {
                let text = example.to_string();
                let written = parses(side, &text).unwrap_or_else(|error| panic!("{text}: {error}"));
                assert_eq!(parses(side, &written).as_ref(), Ok(&written), "{text}");
                let written: Value = serde_json::from_str(&written).unwrap();
                keys.extend(example.as_object().unwrap().keys().cloned());
                for (key, value) in example.as_object().unwrap() {
                    assert!(same(&written[key], value), "{kind}.{key}: {} for {value}", written[key]);
                }
                let mut unknown = example.clone();
                unknown["colour"] = 1.into();
                let refused = parses(side, &unknown.to_string()).unwrap_err();
                assert!(refused.contains("colour"), "{kind}: {refused}");
            }
            let described: BTreeSet<String> =
                schema["properties"].as_object().unwrap().keys().cloned().collect();
            assert_eq!(keys, described, "{kind}: keys of the examples, and those described");
        }
    }
}

/// Whether the written object has all keys of the example; keys with a default may be added.
fn same(written: &Value, example: &Value) -> bool {
    match (written, example) {
        (Value::Number(a), Value::Number(b)) => (a.as_f64().unwrap() - b.as_f64().unwrap()).abs() < 1e-12,
        (Value::Array(a), Value::Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b)),
        (Value::Object(a), Value::Object(b)) => {
            b.iter().all(|(key, b)| a.get(key).map_or(b.is_null(), |a| same(a, b)))
        }
        _ => written == example,
    }
}

#[test]
fn every_message_in_the_document_is_read() {
    let mut found = 0;
    for block in LIVE_MD.split("```json\n").skip(1).filter_map(|rest| rest.split("```").next()) {
        let kind = serde_json::from_str::<Value>(block).unwrap()["type"].as_str().unwrap().to_owned();
        let side = if ServerMessage::TYPES.contains(&kind.as_str()) { "server" } else { "client" };
        parses(side, block).unwrap_or_else(|error| panic!("{block}: {error}"));
        found += 1;
    }
    assert!(found >= ClientMessage::TYPES.len() + ServerMessage::TYPES.len(), "{found} messages");
}
