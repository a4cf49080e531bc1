//! The protocol of live sessions: whatever is written reads back, whatever comes from outside is a value or an error, and
//! LIVE.md, protocol.json and the code say the same.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::collections::BTreeSet;

use proptest::prelude::*;
use relief::display::{DisplayProfile, DisplaySettings, Layout, Picture, Pixels, ProfileName};
use relief::live::{
    ClientMessage, ColorFormat, DepthFormat, EncodedColor, EncodedDepth, FIELDS, FLAGS, FrameError,
    FrameHeader, HEADER_BYTES, LiveLayout, PROTOCOL, Parts, ReceivedDepth, ReceivedFrame, SUBPROTOCOL,
    ServerMessage, assemble, decode_color, decode_d8, decode_z16, encode_color, encode_d8, encode_z16,
};
use relief::units::DepthLimits;
use serde_json::Value;

const LIVE_MD: &str = include_str!("../LIVE.md");

fn header() -> FrameHeader {
    FrameHeader {
        still: true,
        back_layer: false,
        color: ColorFormat::RgbZstd,
        depth: DepthFormat::D8Zstd,
        sequence: 7,
        shows_seq: 1 << 40,
        shows_t_ns: 123_456_789_012,
        total_us: 50_000,
        render_us: 40_000,
        wait_us: 6_000,
        encode_us: 3_000,
        size_px: [8, 4],
        full_px: [8, 4],
        limits_mm: [100.0, 300.0],
        display: DisplaySettings::default().header().fields(),
        layout: LiveLayout::Of(Layout::Wowvx),
        color_bytes: 0,
        depth_bytes: 0,
        eye_mm: [0.0, -900.0, 40.0],
        look_at_mm: [0.0, 0.0, 40.0],
        up: [0.0, 0.0, 1.0],
        projection: [22.0, 0.0],
    }
}

/// Headers whose fields agree with one another, as encoders write them.
fn headers() -> impl Strategy<Value = FrameHeader> {
    let sizes = (1u16..=400, 1u16..=400, 0u16..=400, 0u16..=400);
    let formats = (0usize..3, 0usize..5, 0usize..8, any::<(bool, bool)>());
    let counts = (any::<[u64; 2]>(), any::<[u32; 5]>(), 0u32..1 << 20, 1u32..1 << 20);
    let numbers = (-1e6f32..1e6, 0.1f32..1e4, proptest::array::uniform9(-1e6f32..1e6), 0.0f32..170.0);
    (sizes, formats, counts, numbers).prop_map(|((w, h, more_w, more_h), formats, counts, numbers)| {
        let (color, depth, layout, (still, back_layer)) = formats;
        let (
            [shows_seq, shows_t_ns],
            [sequence, total_us, render_us, wait_us, encode_us],
            color_bytes,
            depth_bytes,
        ) = counts;
        let (near, range, camera, fov) = numbers;
        let depth = DepthFormat::ALL[depth];
        FrameHeader {
            still,
            back_layer,
            color: ColorFormat::ALL[color],
            depth,
            sequence,
            shows_seq,
            shows_t_ns,
            total_us,
            render_us,
            wait_us,
            encode_us,
            size_px: [w, h],
            full_px: [w + more_w, h + more_h],
            limits_mm: [near, near + range],
            display: [4, 64, 128, 0xC0],
            layout: LiveLayout::ALL[layout],
            color_bytes,
            depth_bytes: if depth == DepthFormat::None { 0 } else { depth_bytes },
            eye_mm: [camera[0], camera[1], camera[2]],
            look_at_mm: [camera[3], camera[4], camera[5]],
            up: [camera[6], camera[7], camera[8]],
            projection: [fov, 0.0],
        }
    })
}

proptest! {
    #[test]
    fn headers_read_back(header in headers()) {
        let bytes = header.encode();
        prop_assert_eq!(FrameHeader::decode(&bytes), Ok(header));
    }

    #[test]
    fn any_bytes_are_a_frame_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        let _ = ReceivedFrame::decode(&bytes);
        let _ = Parts::of(&bytes);
    }

    /// Damage behind a right checksum: what only the fields' own checks can refuse.
    #[test]
    fn any_fields_are_a_frame_or_refused(
        at in 0usize..124, value: u8, payload in proptest::collection::vec(any::<u8>(), 0..64),
    ) {
        let mut bytes = FrameHeader { color_bytes: 30, depth_bytes: 34, ..header() }.encode();
        bytes[at] = value;
        let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&bytes[..124]);
        bytes[124..].copy_from_slice(&crc.to_le_bytes());
        if let Ok(header) = FrameHeader::decode(&bytes) {
            prop_assert_eq!(header.encode(), bytes, "what is read is written the same");
        }
        let _ = ReceivedFrame::decode(&[&bytes[..], &payload].concat());
    }

    #[test]
    fn any_text_is_a_message_or_refused(text in "\\PC{0,200}") {
        let _ = ClientMessage::parse(&text);
        let _ = ServerMessage::parse(&text);
    }

    #[test]
    fn colour_and_depth_read_back(
        (size, color, z) in (1usize..40, 1usize..40).prop_flat_map(|(w, h)| (
            Just([w, h]),
            proptest::collection::vec(any::<[u8; 4]>(), w * h),
            proptest::collection::vec(any::<u16>(), w * h),
        )),
    ) {
        let rgb: Vec<[u8; 3]> = color.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect();
        for format in [ColorFormat::RgbZstd, ColorFormat::RgbDeflate] {
            let bytes = encode_color(size, &color, format, 90).unwrap();
            prop_assert_eq!(&decode_color(size, &bytes, format).unwrap(), &rgb);
        }
        let disparity: Vec<u8> = z.iter().map(|z| z.to_le_bytes()[0]).collect();
        for format in [DepthFormat::D8Zstd, DepthFormat::D8Deflate] {
            let bytes = encode_d8(size, &disparity, format).unwrap();
            prop_assert_eq!(&decode_d8(size, &bytes, format).unwrap(), &disparity);
        }
        for format in [DepthFormat::Z16Zstd, DepthFormat::Z16Deflate] {
            let bytes = encode_z16(size, &z, format).unwrap();
            prop_assert_eq!(&decode_z16(size, &bytes, format).unwrap(), &z);
        }
    }
}

/// By hand: the first pixel to the one above, others to the left, wrapping.
#[test]
fn differences_are_those_of_the_document() {
    let bytes = encode_d8([3, 2], &[10, 12, 11, 250, 4, 4], DepthFormat::D8Zstd).unwrap();
    assert_eq!(zstd::bulk::decompress(&bytes, 6).unwrap(), [10, 2, 255, 240, 10, 0]);
    let bytes = encode_z16([2, 2], &[300, 298, 65535, 0], DepthFormat::Z16Zstd).unwrap();
    let numbers = [300u16, 65534, 65235, 1];
    assert_eq!(zstd::bulk::decompress(&bytes, 8).unwrap(), numbers.map(u16::to_le_bytes).as_flattened());
    let bytes = encode_color([2, 1], &[[1, 2, 3, 9], [2, 1, 3, 9]], ColorFormat::RgbZstd, 90).unwrap();
    assert_eq!(zstd::bulk::decompress(&bytes, 6).unwrap(), [1, 2, 3, 1, 255, 0]);
}

#[test]
fn what_unpacks_to_more_or_less_is_refused_without_memory_for_it() {
    let bomb = zstd::bulk::compress(&vec![0; 64 << 20], 1).unwrap();
    assert!(bomb.len() < 20_000);
    let most = allocation_counter::measure(|| {
        assert!(decode_d8([4, 4], &bomb, DepthFormat::D8Zstd).is_err());
    });
    assert!(most.bytes_max < 1 << 20, "{most:?}");
    let short = encode_d8([4, 3], &[0; 12], DepthFormat::D8Deflate).unwrap();
    let refused = decode_d8([4, 4], &short, DepthFormat::D8Deflate).unwrap_err().to_string();
    assert!(refused.contains("12 bytes, expected 16"), "{refused}");
    let long = encode_d8([4, 5], &[7; 20], DepthFormat::D8Deflate).unwrap();
    assert!(decode_d8([4, 4], &long, DepthFormat::D8Deflate).is_err());
    // A header that claims the largest picture, with nothing behind it.
    let full_px = [16384, 16384];
    let claims = FrameHeader { size_px: full_px, full_px, color_bytes: 1, depth_bytes: 1, ..header() };
    let frame = [&claims.encode()[..], &[0, 0]].concat();
    let most = allocation_counter::measure(|| assert!(ReceivedFrame::decode(&frame).is_err()));
    assert!(most.bytes_max < 1 << 20, "{most:?}");
    // A JPEG of another size than the header says.
    let jpeg = encode_color([64, 64], &[[9; 4]; 64 * 64], ColorFormat::Jpeg, 90).unwrap();
    let refused = decode_color([8, 8], &jpeg, ColorFormat::Jpeg).unwrap_err().to_string();
    assert!(refused.contains("64x64"), "{refused}");
}

#[test]
fn each_wrong_field_is_named() {
    let good = FrameHeader { depth_bytes: 1, ..header() }.encode();
    let changed = |at: usize, value: u8| {
        let mut bytes = good;
        bytes[at] = value;
        let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&bytes[..124]);
        bytes[124..].copy_from_slice(&crc.to_le_bytes());
        FrameHeader::decode(&bytes).unwrap_err().to_string()
    };
    for (at, value, named) in [
        (0, b'X', "begins with"),
        (4, 2, "version"),
        (6, 0, "header_bytes"),
        (8, 9, "kind"),
        (9, 0, "flags"),
        (9, 0x87, "flags"),
        (10, 0, "color_format"),
        (10, 4, "color_format"),
        (11, 5, "depth_format"),
        (52, 4, "flags"),
        (64, 6, "display"),
        (67, 1, "display"),
        (68, 8, "layout"),
        (70, 1, "reserved"),
        (76, 0, "depth_bytes"),
    ] {
        let refused = changed(at, value);
        assert!(refused.contains(named), "{at}: {refused}");
    }
    assert!(matches!(
        FrameHeader::decode(&good[..127]),
        Err(FrameError::Length { found: 127, expected: 128 })
    ));
    let depth = FrameHeader { depth_bytes: 1, ..header() };
    for (wrong, named) in [
        (FrameHeader { eye_mm: [0.0, f32::NAN, 0.0], ..depth }, "camera_eye_mm"),
        (FrameHeader { projection: [f32::INFINITY, 0.0], ..depth }, "camera_projection"),
        (FrameHeader { limits_mm: [5.0, 5.0], ..depth }, "near_mm"),
        (FrameHeader { full_px: [20_000, 4], ..depth }, "full_px"),
        (FrameHeader { size_px: [8, 0], ..depth }, "size_px"),
        (FrameHeader { size_px: [9, 4], ..depth }, "size_px"),
    ] {
        let refused = FrameHeader::decode(&wrong.encode()).unwrap_err().to_string();
        assert!(refused.contains(named), "{refused}");
    }
    let mut damaged = good;
    damaged[20] ^= 1;
    assert!(matches!(FrameHeader::decode(&damaged), Err(FrameError::Crc { .. })));
    let longer = [&good[..], &[0; 5]].concat();
    assert!(matches!(Parts::of(&longer), Err(FrameError::Length { found: 133, expected: 129 })));
}

/// A picture with every colour bit in use and depths across the limits, misses among them.
fn picture(size: [usize; 2]) -> (Vec<[u8; 4]>, Vec<f32>) {
    let pixels = size[0] * size[1];
    let color = (0..pixels).map(|i| [(i * 7) as u8, (i * 13 >> 3) as u8, (i * 29 >> 2) as u8, 255]).collect();
    let depth = |i: usize| if i.is_multiple_of(11) { f32::INFINITY } else { 90.0 + (i % 231) as f32 };
    (color, (0..pixels).map(depth).collect())
}

#[test]
fn a_composed_frame_is_the_encoders_own_in_every_layout() {
    let limits = DepthLimits::new(100.0, 300.0).unwrap();
    for layout in LiveLayout::ALL {
        let LiveLayout::Of(layout) = layout else { continue };
        let display = DisplaySettings { layout, factor: 80, ..DisplaySettings::default() };
        let encoder = display.encoder().unwrap();
        let size_px = encoder.render_size_px().unwrap_or([37, 11]);
        let size = size_px.map(|side| side as usize);
        let (color, depth_mm) = picture(size);
        let (behind, behind_mm): (Vec<_>, Vec<_>) =
            (color.iter().rev().copied().collect(), depth_mm.iter().rev().copied().collect());
        let front = Picture::new(size_px, &color, &depth_mm).unwrap();
        let both = front.with_back(&behind, &behind_mm).unwrap();
        let expected = encoder.encode(&both, limits).unwrap();

        let back_layer = layout.needs_background();
        let (mut all_color, mut disparity) = (color.clone(), encoder.disparity(&front, limits));
        if back_layer {
            all_color.extend(&behind);
            disparity.extend(encoder.disparity(&both.back().unwrap(), limits));
        }
        let rows = [size[0], size[1] * if back_layer { 2 } else { 1 }];
        let format = ColorFormat::RgbZstd;
        let color = EncodedColor { format, bytes: encode_color(rows, &all_color, format, 90).unwrap() };
        let format = DepthFormat::D8Deflate;
        let depth = EncodedDepth { format, bytes: encode_d8(rows, &disparity, format).unwrap() };
        let side = size_px.map(|side| u16::try_from(side).unwrap());
        let header = FrameHeader {
            back_layer,
            size_px: side,
            full_px: side,
            display: display.header().fields(),
            layout: LiveLayout::of(layout),
            ..header()
        };
        let received = ReceivedFrame::decode(&assemble(&header, &color, &depth)).unwrap();
        assert!(received.header.lossless() && received.header.full_size());
        let curve = DisplayProfile::named(ProfileName::Philips20);
        assert!(received.compose(&curve).unwrap() == expected, "{layout}");
    }
    for layout in [Layout::Depth16, Layout::Stereo, Layout::Anaglyph] {
        assert_eq!(LiveLayout::of(layout), LiveLayout::None);
    }
}

#[test]
fn a_smaller_picture_is_enlarged_by_nearest_pixels() {
    let (color, _) = picture([8, 4]);
    let format = ColorFormat::RgbZstd;
    let color = EncodedColor { format, bytes: encode_color([8, 4], &color, format, 90).unwrap() };
    let depth = EncodedDepth { format: DepthFormat::None, bytes: Vec::new() };
    let layout = LiveLayout::Of(Layout::Color);
    let header = FrameHeader { full_px: [16, 8], layout, ..header() };
    let received = ReceivedFrame::decode(&assemble(&header, &color, &depth)).unwrap();
    assert_eq!(received.depth, ReceivedDepth::None);
    let frame = received.compose(&DisplayProfile::named(ProfileName::Philips42)).unwrap();
    assert_eq!(frame.size_px(), [16, 8]);
    let Pixels::Rgb8(samples) = frame.pixels() else { panic!("colour") };
    for (i, pixel) in samples.chunks(3).enumerate() {
        let (x, y) = (i % 16, i / 16);
        assert_eq!(pixel, received.color[y / 2 * 8 + x / 2], "{x}, {y}");
    }
}

#[test]
fn z_becomes_the_disparity_of_its_curve_within_a_step() {
    let limits = DepthLimits::new(100.0, 300.0).unwrap();
    let display = DisplaySettings::default();
    let encoder = display.encoder().unwrap();
    let (color, depth_mm) = picture([960, 540]);
    let picture = Picture::new([960, 540], &color, &depth_mm).unwrap();
    let scaled = encoder.scaled16(&picture, limits);
    let format = ColorFormat::RgbZstd;
    let color = EncodedColor { format, bytes: encode_color([960, 540], &color, format, 90).unwrap() };
    let format = DepthFormat::Z16Zstd;
    let depth = EncodedDepth { format, bytes: encode_z16([960, 540], &scaled, format).unwrap() };
    let header = FrameHeader { size_px: [960, 540], full_px: [960, 540], ..header() };
    let received = ReceivedFrame::decode(&assemble(&header, &color, &depth)).unwrap();
    let composed = received.compose(&display.profile().unwrap()).unwrap();
    let expected = encoder.encode(&picture, limits).unwrap();
    let (Pixels::Rgb8(composed), Pixels::Rgb8(expected)) = (composed.pixels(), expected.pixels()) else {
        panic!("colour")
    };
    assert!(composed.iter().zip(expected).all(|(a, b)| a.abs_diff(*b) <= 1));
}

fn protocol() -> Value {
    serde_json::from_str(PROTOCOL).unwrap()
}

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

/// Every field of the table is where the encoder puts it: a change of it changes its bytes and the checksum alone.
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
    let own = LiveLayout::ALL.map(|layout| (layout.byte().to_string(), layout.name().into_owned()));
    assert_eq!(listed("layouts"), own.into());
    let limits = &protocol["limits"];
    assert_eq!(limits["text_bytes"], relief::live::MAX_TEXT_BYTES);
    assert_eq!(limits["frames_in_flight"], relief::live::MAX_IN_FLIGHT);
    for (code, _) in protocol["close_codes"].as_object().unwrap() {
        assert!(LIVE_MD.contains(&format!("| {code} | ")), "LIVE.md explains close code {code}");
    }
    for (side, types) in [("client", &ClientMessage::TYPES[..]), ("server", &ServerMessage::TYPES[..])] {
        let described: BTreeSet<&str> =
            protocol[side].as_object().unwrap().keys().map(String::as_str).collect();
        assert_eq!(described, types.iter().copied().collect());
        for kind in types {
            assert!(LIVE_MD.contains(&format!("`{kind}`")), "LIVE.md explains {kind}");
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

/// Whether what was written has all that the example has; what has a default may be there beside it.
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
        assert!(refused.path == path && refused.reason.contains(reason), "{text}: {refused:?}");
    }
    let long = format!(r#"{{"type":"ack","frame":1,"x":"{}"}}"#, "a".repeat(70_000));
    assert!(ClientMessage::parse(&long).unwrap_err().reason.contains("65536"));
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
