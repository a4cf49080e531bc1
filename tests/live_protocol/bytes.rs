//! Frames, colour and depth as bytes: they read back, damage is named, and a composed frame is the
//! encoder's own.

use proptest::prelude::*;
use relief_base::DepthLimits;
use relief_display::{DisplayProfile, DisplaySettings, Layout, Picture, Pixels, ProfileName};
use relief_live::{
    ColorFormat, DepthFormat, EncodedColor, EncodedDepth, FrameError, FrameHeader, LiveLayout, Parts,
    ReceivedDepth, ReceivedFrame, assemble, decode_color, decode_d8, decode_z16, encode_color, encode_d8,
    encode_z16,
};

use crate::live_protocol::header;

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
            layout: LiveLayout::all().nth(layout).unwrap(),
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

    /// Invariant: docs/LIVE.md, `protocol.json` and the code agree about header, names and
    /// messages; any bytes are read or refused.
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
fn streams_of_the_wrong_size_are_refused_without_allocating_it() {
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
    let color = (0..pixels).map(|i| [(i * 7) as u8, (i * 13 / 8) as u8, (i * 29 / 4) as u8, 255]).collect();
    let depth = |i: usize| if i.is_multiple_of(11) { f32::INFINITY } else { 90.0 + (i % 231) as f32 };
    (color, (0..pixels).map(depth).collect())
}

/// Invariant: A live frame of a still view, composed from lossless colour, equals the PNG of the
/// same scene, pixel by pixel.
#[test]
fn a_composed_frame_is_the_encoders_own_in_every_layout() {
    let limits = DepthLimits::new(100.0, 300.0).unwrap();
    for layout in LiveLayout::all() {
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
    for layout in [Layout::Depth16, Layout::Stereo, Layout::Lines, Layout::Anaglyph] {
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
