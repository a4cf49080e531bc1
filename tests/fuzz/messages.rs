//! Whatever bytes come over a live session, as frames, colour, depth, messages and intents.

use relief_display::{DisplayProfile, LensPanel, ProcessorViews, ProfileName};
use relief_live::{
    ClientMessage, ColorFormat, DepthFormat, EncodedColor, EncodedDepth, FrameHeader, HEADER_BYTES, Intent,
    LiveLayout, Parts, ReceivedFrame, ServerMessage, ViewsOutput, assemble, decode_color, decode_d8,
    decode_z16, encode_color, encode_d8,
};

/// A header that is read is written the same; a frame that is read composes or says why not.
pub(crate) fn frame(bytes: &[u8]) {
    if let Ok(header) = FrameHeader::decode(bytes) {
        assert_eq!(header.encode()[..], bytes[..HEADER_BYTES]);
    }
    let _ = Parts::of(bytes);
    if let Ok(frame) = ReceivedFrame::decode(bytes) {
        let _ = frame.compose(&DisplayProfile::named(ProfileName::Philips42));
    }
    let size = [16, 8];
    for format in ColorFormat::ALL {
        let _ = decode_color(size, bytes, format);
    }
    for format in DepthFormat::ALL {
        let _ = decode_d8(size, bytes, format);
        let _ = decode_z16(size, bytes, format);
    }
}

/// The frame that a display gets of a received one, by every layout: a frame whose header is intact, of pictures of these
/// bytes, or of what else a server packs.
pub(crate) fn views(bytes: &[u8]) {
    let Some((&[flags, width, rows, wider, higher, layout, span, eyes, rest @ ..], packed)) =
        bytes.split_first_chunk::<16>()
    else {
        return;
    };
    let sides = [width, rows].map(|side| u16::from(side % 24 + 1));
    let header =
        header(flags, sides, [sides[0] + u16::from(wider % 48), sides[1] + u16::from(higher % 48)], &rest);
    let (color, depth) = if flags & 1 == 0 { pictures(&header, packed) } else { unchecked(flags, packed) };
    let Ok(frame) = ReceivedFrame::decode(&assemble(&header, &color, &depth)) else { return };
    let curve = DisplayProfile::named(ProfileName::ALL[usize::from(flags >> 4) % ProfileName::ALL.len()]);
    let _ = frame.compose(&curve);
    let Some(LiveLayout::Of(layout)) = LiveLayout::all().nth(usize::from(layout) % LiveLayout::all().count())
    else {
        return;
    };
    let output = ViewsOutput {
        layout,
        panel: LensPanel {
            pitch_px: 1.0 + f64::from(rest[6]) / 8.0,
            slant: f64::from(rest[7] as i8) / 64.0,
            ..LensPanel::default()
        },
        view_span: (span != 0).then(|| f64::from(span) / 32.0),
        view_cone_deg: (span == 255).then_some(35.0),
        tracked_eyes: (eyes != 0).then(|| [-f64::from(eyes), f64::from(eyes)].map(|eye| eye / 64.0)),
    };
    let composed = frame
        .layers(&curve, layout)
        .and_then(|layers| layers.compose_views(&curve, &output, &ProcessorViews));
    if let Ok(composed) = composed {
        let [width, height] = composed.size_px();
        assert!(width >= header.full_px[0].into() && height >= header.full_px[1].into(), "{layout:?}");
    }
}

fn header(flags: u8, size_px: [u16; 2], full_px: [u16; 2], rest: &[u8; 8]) -> FrameHeader {
    FrameHeader {
        still: flags & 2 != 0,
        back_layer: flags & 4 != 0,
        color: ColorFormat::RgbDeflate,
        depth: DepthFormat::D8Deflate,
        sequence: 1,
        shows_seq: 0,
        shows_t_ns: 0,
        total_us: 0,
        render_us: 0,
        wait_us: 0,
        encode_us: 0,
        size_px,
        full_px,
        limits_mm: [100.0, 900.0],
        display: [rest[0], rest[1], rest[2], rest[3]],
        layout: LiveLayout::all().nth(usize::from(rest[4])).unwrap_or(LiveLayout::None),
        color_bytes: 0,
        depth_bytes: 0,
        eye_mm: [0.0, -500.0, 0.0],
        look_at_mm: [0.0; 3],
        up: [0.0, 0.0, 1.0],
        projection: [30.0, 0.0],
    }
}

/// Colour and depth of the right size, of these bytes in turn.
fn pictures(header: &FrameHeader, bytes: &[u8]) -> (EncodedColor, EncodedDepth) {
    let size = [usize::from(header.size_px[0]), header.rows()];
    let mut endless = bytes.iter().copied().chain(std::iter::repeat(0));
    let disparity: Vec<u8> = endless.by_ref().take(size[0] * size[1]).collect();
    let color: Vec<[u8; 4]> =
        (0..size[0] * size[1]).map(|_| [(); 4].map(|()| endless.next().unwrap_or(0))).collect();
    (
        EncodedColor {
            format: header.color,
            bytes: encode_color(size, &color, header.color, 90).expect("colours of this size"),
        },
        EncodedDepth {
            format: header.depth,
            bytes: encode_d8(size, &disparity, header.depth).expect("depths of this size"),
        },
    )
}

/// Colour and depth in any format, of any bytes.
fn unchecked(flags: u8, bytes: &[u8]) -> (EncodedColor, EncodedDepth) {
    let (color, depth) = bytes.split_at(bytes.len() / 2);
    let format = usize::from(flags >> 3);
    (
        EncodedColor { format: ColorFormat::ALL[format % ColorFormat::ALL.len()], bytes: color.to_vec() },
        EncodedDepth { format: DepthFormat::ALL[format % DepthFormat::ALL.len()], bytes: depth.to_vec() },
    )
}

/// A message that is read is written as one that can be read.
pub(crate) fn message(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    if let Ok(message) = ClientMessage::parse(text) {
        assert!(ClientMessage::parse(&message.to_text()).is_ok());
    }
    let _ = ServerMessage::parse(text);
}

pub(crate) fn intent(bytes: &[u8]) {
    let _ = Intent::from_json(bytes);
}
