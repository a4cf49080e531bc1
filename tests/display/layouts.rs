//! Layouts: every frame decodes to its inputs, and pixels lie where displays look for them.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking, its helpers too")]

use proptest::prelude::*;
use relief_base::{DepthLimits, ScaledDepth};
use relief_display::{
    ContentType, DecodedDepth, DisparityConstants, DisplayProfile, DisplaySettings, ExtendedPart, Frame,
    FrameEncoder, FrameProblem, Header, HeaderPart, HeaderProblem, HeaderReading, Layout, LayoutError,
    Picture, Pixels, ProfileName,
};

const LIMITS: DepthLimits = DepthLimits { near_mm: 100.0, far_mm: 300.0 };

fn usual_profile(layout: Layout) -> DisplayProfile {
    DisplaySettings { layout, ..DisplaySettings::default() }.profile().unwrap()
}

/// A picture of noise from a counter, with misses and depths outside the limits.
fn noise(size_px: [u32; 2], seed: u64) -> (Vec<[u8; 4]>, Vec<f32>) {
    let mut state = seed | 1;
    let mut next = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as u32
    };
    let count = (size_px[0] * size_px[1]) as usize;
    let color = (0..count).map(|_| next().to_le_bytes()).collect();
    let depth_mm = (0..count)
        .map(|_| match next() % 8 {
            0 => f32::INFINITY,
            _ => 50.0 + (next() % 300_000) as f32 / 1000.0,
        })
        .collect();
    (color, depth_mm)
}

/// D of a view depth, from the formula as published.
fn expected_disparity(profile: &DisplayProfile, mm: f32) -> u8 {
    let DisparityConstants { zd, vz, m, c } = profile.constants();
    let z = if mm.is_finite() { ((f64::from(mm) - 100.0) / 200.0).clamp(0.0, 1.0) } else { 1.0 };
    (m * (1.0 - vz / (z - zd + vz)) + c).round().clamp(0.0, 255.0) as u8
}

fn rgb(frame: &Frame) -> &[u8] {
    match frame.pixels() {
        Pixels::Rgb8(samples) => samples,
        Pixels::Gray16(_) => panic!("expected 8-bit RGB"),
    }
}

/// Encodes and decodes; checks that what came out went in.
fn check_round_trip(encoder: &FrameEncoder, size_px: [u32; 2], seed: u64) -> Frame {
    let (color, depth_mm) = noise(size_px, seed);
    let frame = encoder.encode(&Picture::new(size_px, &color, &depth_mm).unwrap(), LIMITS).unwrap();
    let layout = encoder.layout();
    let decoded = layout.decode(&frame).unwrap();
    assert_eq!(decoded.size_px, size_px, "{layout}");
    assert_eq!(decoded.header, encoder.header(), "{layout}");
    let header_px = encoder.header().map_or(0, |header| header.width_px() as usize);
    for (i, (found, [r, g, b, _])) in decoded.color.iter().zip(&color).enumerate() {
        let under_header = i < header_px && i % 2 == 0;
        let mask = if under_header { 0x7F } else { 0xFF };
        assert_eq!([found[0], found[1], found[2] & mask], [*r, *g, b & mask], "{layout} pixel {i}");
    }
    match decoded.depth {
        DecodedDepth::None => assert_eq!(layout, Layout::Color),
        DecodedDepth::Disparity(bytes) => {
            let expected: Vec<u8> =
                depth_mm.iter().map(|&mm| expected_disparity(encoder.profile(), mm)).collect();
            assert!(bytes == expected, "{layout}: disparity");
        }
        DecodedDepth::Scaled16(values) => {
            let z = |mm: f32| {
                if mm.is_finite() { ((f64::from(mm) - 100.0) / 200.0).clamp(0.0, 1.0) } else { 1.0 }
            };
            let expected: Vec<u16> =
                depth_mm.iter().map(|&mm| ((1.0 - z(mm)) * 65535.0).round() as u16).collect();
            assert!(values == expected, "{layout}: Z");
        }
    }
    let pixels = (size_px[0] * size_px[1]) as usize;
    assert_eq!(decoded.color.len(), if layout == Layout::Depth16 { 0 } else { pixels });
    frame
}

/// Invariant: Every decoder of a layout returns the input of its encoder, or an error.
#[test]
fn every_layout_gives_back_what_went_in_at_its_own_size() {
    for (layout, render_px, frame_px) in [
        (Layout::Wowvx, Some([960, 540]), [1920, 1080]),
        (Layout::WowvxFullHeight, Some([960, 1080]), [1920, 1080]),
        (Layout::Wowvx4k, Some([1920, 2160]), [3840, 2160]),
        (Layout::Rgbd, None, [66, 21]),
        (Layout::Color, None, [33, 21]),
        (Layout::Depth16, None, [33, 21]),
    ] {
        let encoder = FrameEncoder::new(layout, usual_profile(layout), Header::default()).unwrap();
        assert_eq!(encoder.render_size_px(), render_px, "{layout}");
        let frame = check_round_trip(&encoder, render_px.unwrap_or([33, 21]), 7);
        assert_eq!(frame.size_px(), frame_px, "{layout}");
    }
}

/// The table of the format: line i on line 2i, picture left, disparity right with R = G = B, odd
/// lines black.
#[test]
fn wowvx_puts_every_pixel_where_displays_look_for_it() {
    let (color, depth_mm) = noise([960, 540], 3);
    let profile = DisplayProfile::named(ProfileName::Philips42);
    let encoder = FrameEncoder::new(Layout::Wowvx, profile, Header::default()).unwrap();
    let frame = encoder.encode(&Picture::new([960, 540], &color, &depth_mm).unwrap(), LIMITS).unwrap();
    let samples = rgb(&frame);
    let at = |x: usize, y: usize| &samples[3 * (1920 * y + x)..][..3];
    for (x, i) in [(0, 1), (959, 1), (123, 300), (959, 539)] {
        let source = 960 * i + x;
        assert_eq!(at(x, 2 * i), &color[source][..3]);
        assert_eq!(at(960 + x, 2 * i), [expected_disparity(&profile, depth_mm[source]); 3]);
    }
    for y in (1..1080).step_by(2) {
        assert!((0..1920).all(|x| at(x, y) == [0; 3]), "line {y}");
    }
    let header = HeaderReading::of_line(&samples[..3 * 960]);
    assert_eq!((header.header, header.problems), (Some(Header::default()), vec![]));
    // Between the header's bits the picture is untouched: odd pixels, red and green, the low bits
    // of blue.
    for (x, source) in color.iter().enumerate().take(960) {
        let [r, g, b, _] = *source;
        let mask = if x % 2 == 0 && x <= 510 { 0x7F } else { 0xFF };
        assert_eq!([at(x, 0)[0], at(x, 0)[1], at(x, 0)[2] & mask], [r, g, b & mask], "pixel {x}");
    }
}

/// The public vector, written by the encoder over black: these pixels and no others.
#[test]
fn the_encoder_sets_the_45_pixels_of_the_public_header() {
    let expected = [
        0, 2, 4, 6, 14, 30, 34, 48, 96, 98, 106, 116, 120, 122, 126, 128, 130, 134, 140, 142, 144, 148, 152,
        154, 156, 158, 160, 162, 164, 166, 172, 182, 186, 452, 454, 458, 460, 464, 470, 474, 478, 480, 492,
        500, 510,
    ];
    let header = Header { content: ContentType::Signage, ..Header::default() };
    let (color, depth_mm) = (vec![[0; 4]; 960 * 540], vec![f32::INFINITY; 960 * 540]);
    let encoder = FrameEncoder::new(Layout::Wowvx, usual_profile(Layout::Wowvx), header).unwrap();
    let frame = encoder.encode(&Picture::new([960, 540], &color, &depth_mm).unwrap(), LIMITS).unwrap();
    let lit: Vec<usize> = (0..1920 * 1080).filter(|i| rgb(&frame)[3 * i..][..3] != [0; 3]).collect();
    assert_eq!(lit, expected);
    assert!(lit.iter().all(|i| rgb(&frame)[3 * i..][..3] == [0, 0, 128]));
}

/// Behind a header of ten bytes the picture's own bits must not read as an extended part.
#[test]
fn a_picture_is_not_mistaken_for_an_extended_part() {
    let short = Header { extended: None, ..Header::default() };
    for bytes in [Header::default().to_bytes(), [&Header::default().to_bytes()[..20], &[9; 12]].concat()] {
        let mut color = vec![[1, 2, 3, 255]; 960 * 540];
        for (n, byte) in bytes.iter().enumerate() {
            for y in 0..8 {
                color[16 * n + 2 * (7 - y)][2] = (byte >> y & 1) << 7;
            }
        }
        let depth_mm = vec![200.0; 960 * 540];
        let encoder = FrameEncoder::new(Layout::Wowvx, usual_profile(Layout::Wowvx), short).unwrap();
        let frame = encoder.encode(&Picture::new([960, 540], &color, &depth_mm).unwrap(), LIMITS).unwrap();
        let decoded = Layout::Wowvx.decode(&frame).unwrap();
        assert_eq!(decoded.header, Some(short));
        let changed =
            decoded.color.iter().zip(&color).skip(160).filter(|(found, went_in)| **found != went_in[..3]);
        assert!(changed.count() <= 2);
    }
}

#[test]
fn nearer_is_brighter_and_a_miss_is_farthest() {
    let depth_mm = [50.0, 100.0, 150.0, 200.0, 299.0, 300.0, 1e9, f32::INFINITY, f32::NAN];
    let color = [[0; 4]; 9];
    let picture = Picture::new([9, 1], &color, &depth_mm).unwrap();
    let profile = DisplayProfile::named(ProfileName::Philips20);
    let decode = |layout: Layout| {
        let encoder = FrameEncoder::new(layout, profile, Header::default()).unwrap();
        layout.decode(&encoder.encode(&picture, LIMITS).unwrap()).unwrap().depth
    };
    // D of Z = 0.25 and 0.5 as published: 183.2423 and 117.2523.
    let d = profile.disparity(ScaledDepth(0.995)).to_byte();
    assert_eq!(decode(Layout::Rgbd), DecodedDepth::Disparity(vec![255, 255, 183, 117, d, 0, 0, 0, 0]));
    let z = vec![65535, 65535, 49151, 32768, 328, 0, 0, 0, 0];
    assert_eq!(decode(Layout::Depth16), DecodedDepth::Scaled16(z));
}

#[test]
fn a_picture_of_the_wrong_size_is_refused_with_both_sizes() {
    let (color, depth_mm) = noise([960, 541], 1);
    let picture = Picture::new([960, 541], &color, &depth_mm).unwrap();
    let encoder = FrameEncoder::new(Layout::Wowvx, usual_profile(Layout::Wowvx), Header::default()).unwrap();
    let error = encoder.encode(&picture, LIMITS).unwrap_err();
    assert_eq!(
        error.to_string(),
        "layout wowvx needs a picture of 960x540, found 960x541: render at that size"
    );
    assert!(matches!(
        Picture::new([960, 540], &color, &depth_mm),
        Err(LayoutError::PixelCount { what: "the colour", expected: 518_400, found: 519_360, .. })
    ));
    assert!(matches!(Picture::new([0, 5], &[], &[]), Err(LayoutError::Size { .. })));
    assert!(matches!(Picture::new([65536, 65536], &[], &[]), Err(LayoutError::Size { .. })));
    assert!(Frame::new([2, 2], Pixels::Rgb8(vec![0; 11])).is_err());
}

#[test]
fn a_layout_that_the_display_does_not_take_is_refused() {
    let philips = DisplayProfile::named(ProfileName::Philips42);
    let dimenco = DisplayProfile::named(ProfileName::Dimenco4k);
    for (layout, profile) in [(Layout::Wowvx4k, philips), (Layout::Wowvx, dimenco)] {
        let error = FrameEncoder::new(layout, profile, Header::default()).unwrap_err();
        assert!(matches!(error, LayoutError::Profile { .. }), "{error}");
    }
    let narrow = DisplayProfile::new([1020, 10], [510, 5], philips.constants()).unwrap();
    let error = FrameEncoder::new(Layout::Wowvx, narrow, Header::default()).unwrap_err();
    assert_eq!(error, LayoutError::HeaderWidth { needed_px: 511, half_px: 510 });
    let short = Header { extended: None, ..Header::default() };
    assert!(FrameEncoder::new(Layout::Wowvx, narrow, short).is_ok());
}

#[test]
fn frames_that_no_encoder_writes_are_refused_by_name() {
    let layout = Layout::Wowvx;
    let encoder = FrameEncoder::new(layout, usual_profile(layout), Header::default()).unwrap();
    let (color, depth_mm) = noise([960, 540], 5);
    let frame = encoder.encode(&Picture::new([960, 540], &color, &depth_mm).unwrap(), LIMITS).unwrap();
    let damaged = |damage: fn(&mut Vec<u8>)| {
        let mut samples = rgb(&frame).to_vec();
        damage(&mut samples);
        layout.decode(&Frame::new([1920, 1080], Pixels::Rgb8(samples)).unwrap()).unwrap_err()
    };
    let no_header = damaged(|samples| samples[..3 * 960].fill(0));
    assert_eq!(no_header, [FrameProblem::Header(HeaderProblem::Magic { found: 0 })]);
    let one_bit = damaged(|samples| samples[3 * 2 * 40 + 2] ^= 0x80); // pixel 80: bit 7 of H5
    let reserved = HeaderProblem::Reserved { byte: 5, found: 0x80, reserved: 0xFF };
    let base = HeaderPart::Base;
    assert_eq!(one_bit[0], FrameProblem::Header(reserved));
    assert!(matches!(one_bit[1..], [FrameProblem::Header(HeaderProblem::Crc { part, .. })] if part == base));
    let odd = damaged(|samples| {
        samples[3 * (1920 * 7 + 5)] = 1;
        samples[3 * (1920 * 7 + 9) + 1] = 1;
        samples[3 * (1920 * 1079 + 1919) + 2] = 1;
    });
    assert_eq!(odd, [FrameProblem::OddLinesNotBlack { lines: 2, pixels: 3, first: [5, 7] }]);
    let gray = damaged(|samples| samples[3 * (1920 * 10 + 1000)..][..3].copy_from_slice(&[1, 2, 3]));
    assert_eq!(gray, [FrameProblem::DepthNotGrey { pixels: 1, first: [1000, 10], rgb: [1, 2, 3] }]);
    for (other, size) in
        [(Layout::Wowvx4k, [1920, 1080]), (Layout::Rgbd, [2025, 1024]), (layout, [2048, 1025])]
    {
        let frame = Frame::new(size, Pixels::Rgb8(vec![0; 3 * size[0] as usize * size[1] as usize])).unwrap();
        assert!(matches!(other.decode(&frame).unwrap_err()[..], [FrameProblem::FrameSize { .. }]));
    }
    let gray = Frame::new([2, 1], Pixels::Gray16(vec![0, 1])).unwrap();
    assert!(matches!(Layout::Rgbd.decode(&gray).unwrap_err()[..], [FrameProblem::PixelFormat { .. }]));
}

#[test]
fn names_of_layouts_come_back_and_others_list_what_there_is() {
    for layout in Layout::ALL {
        assert_eq!(layout.name().parse(), Ok(layout));
    }
    let error = "wowv".parse::<Layout>().unwrap_err().to_string();
    assert_eq!(
        error,
        "no layout \"wowv\"; available: wowvx, wowvx-full-height, wowvx-4k, declipse, declipse-lines, rgbd, stereo, stereo-half, \
         top-bottom, top-bottom-half, lines, columns, checkerboard, views-9, lenses-9, anaglyph, wiggle, color, depth16"
    );
    assert!("x".repeat(1 << 20).parse::<Layout>().unwrap_err().to_string().len() < 300);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Displays of other sizes, every header: the halves of a frame come back whatever they are.
    #[test]
    fn frames_of_any_size_decode_to_what_went_in(
        half_width in 159u32..600,
        height in 1u32..9,
        seed in any::<u64>(),
        factor in any::<u8>(),
        content in prop::sample::select(&ContentType::ALL[..]),
        extended in prop::option::of(prop::sample::select(&ExtendedPart::ALL[..])),
        layout in prop::sample::select(&[Layout::Wowvx, Layout::WowvxFullHeight][..]),
    ) {
        let frame_px = [2 * half_width, 2 * height];
        let constants = DisparityConstants::from_viewing_distance(5.0).unwrap();
        let profile = DisplayProfile::new(frame_px, [half_width, height], constants).unwrap();
        // The extended part needs 511 pixels.
        let extended = extended.filter(|_| half_width >= 511);
        let header = Header { content, factor, extended, use_factor: true, ..Header::default() };
        let encoder = FrameEncoder::new(layout, profile, header).unwrap();
        let frame = check_round_trip(&encoder, encoder.render_size_px().unwrap(), seed);
        prop_assert_eq!(frame.size_px(), frame_px);
    }

    #[test]
    fn layouts_without_header_take_any_size(
        width in 1u32..80,
        height in 1u32..20,
        seed in any::<u64>(),
        layout in prop::sample::select(&[Layout::Rgbd, Layout::Color, Layout::Depth16][..]),
    ) {
        let encoder = FrameEncoder::new(layout, usual_profile(layout), Header::default()).unwrap();
        prop_assert_eq!(encoder.header(), None);
        check_round_trip(&encoder, [width, height], seed);
    }
}

/// Invariant: docs/RENDERING.md lists every layout with its frame and its number in live frames.
#[test]
fn every_layout_is_in_the_table_of_the_documents() {
    let table = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/RENDERING.md")).unwrap();
    for info in Layout::TABLE {
        let number = info.live_byte.map(|byte| format!("{byte} ")).unwrap_or_default();
        let row = format!("| `{}` | {} | {number}|", info.name, info.summary);
        assert!(table.contains(&row), "docs/RENDERING.md lacks the row\n{row}");
    }
}
