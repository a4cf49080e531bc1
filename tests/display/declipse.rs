//! Layouts with a background: what went in comes out, the header announces it, the inspection knows
//! it, and a frame that lacks a background or is damaged is refused.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking, its helpers too")]

use relief_base::{DepthLimits, ScaledDepth};
use relief_display::{
    DecodedDepth, DepthFilter, DisplayProfile, DisplaySettings, ExtendedPart, Frame, FrameEncoder,
    FrameProblem, Header, HeaderReading, Layout, LayoutError, Picture, Pixels, ProfileName, encode_png,
    inspect_frame, inspect_png,
};

const LIMITS: DepthLimits = DepthLimits { near_mm: 100.0, far_mm: 300.0 };
const SIZE: [u32; 2] = [960, 540];
const BOTH: [Layout; 2] = [Layout::Declipse, Layout::DeclipseLines];

/// A picture of slopes: each pixel has a nearly unique colour and depth.
fn layer(seed: u32) -> (Vec<[u8; 4]>, Vec<f32>) {
    let pixel = |i: u32| {
        let (x, y) = (i % SIZE[0], i / SIZE[0]);
        let color = [(x + seed) as u8, (y / 2 + seed) as u8, (x / 4 + y / 4) as u8, 255];
        (
            color,
            if (x + y + seed).is_multiple_of(97) {
                f32::INFINITY
            } else {
                100.0 + ((x + 3 * y + seed) % 200) as f32
            },
        )
    };
    (0..SIZE[0] * SIZE[1]).map(pixel).unzip()
}

fn encoder(layout: Layout) -> FrameEncoder {
    DisplaySettings { layout, ..DisplaySettings::default() }.encoder().unwrap()
}

fn frame(layout: Layout) -> Frame {
    let ((color, depth), (back_color, back_depth)) = (layer(0), layer(50));
    let picture = Picture::new(SIZE, &color, &depth).unwrap().with_back(&back_color, &back_depth).unwrap();
    encoder(layout).encode(&picture, LIMITS).unwrap()
}

fn samples(frame: &Frame) -> &[u8] {
    match frame.pixels() {
        Pixels::Rgb8(samples) => samples,
        Pixels::Gray16(_) => panic!("expected 8-bit RGB"),
    }
}

/// D of a view depth by the display's published curve.
fn disparity(mm: f32) -> u8 {
    let z = if mm.is_finite() { (f64::from(mm) - 100.0) / 200.0 } else { 1.0 };
    DisplayProfile::named(ProfileName::Philips42).disparity(ScaledDepth(z)).to_byte()
}

#[test]
fn both_layers_come_back_and_the_header_announces_them() {
    for layout in BOTH {
        assert_eq!(encoder(layout).render_size_px(), Some(SIZE));
        let frame = frame(layout);
        assert_eq!(frame.size_px(), [1920, 1080]);
        let decoded = layout.decode(&frame).unwrap();
        assert_eq!(decoded.size_px, SIZE);
        assert_eq!(decoded.header.unwrap().extended, Some(ExtendedPart::DeclipseFull));
        assert_eq!(decoded.header, encoder(layout).header());
        let ((color, depth), (back_color, back_depth)) = (layer(0), layer(50));
        let back = decoded.back.unwrap();
        let DecodedDepth::Disparity(front) = decoded.depth else { panic!("{layout} has disparity") };
        assert!(front.iter().zip(&depth).all(|(d, mm)| *d == disparity(*mm)), "{layout}: disparity");
        assert!(
            back.disparity.iter().zip(&back_depth).all(|(d, mm)| *d == disparity(*mm)),
            "{layout}: behind"
        );
        assert!(back.color.iter().zip(&back_color).all(|(a, b)| *a == b[..3]), "{layout}: colour behind");
        for (i, (found, went_in)) in decoded.color.iter().zip(&color).enumerate() {
            let mask = if i < 511 && i % 2 == 0 { 0x7F } else { 0xFF };
            let expected = [went_in[0], went_in[1], went_in[2] & mask];
            assert_eq!([found[0], found[1], found[2] & mask], expected, "{layout} pixel {i}");
        }
    }
}

/// The bytes H10 to H31 of a full background, its checksum by a bitwise CRC of our own here.
#[test]
fn the_headers_extended_part_is_that_of_a_full_background() {
    for layout in BOTH {
        let frame = frame(layout);
        let reading = HeaderReading::of_line(&samples(&frame)[..3 * 960]);
        assert_eq!(reading.problems, []);
        assert_eq!(reading.bytes[10..13], [0xF2, 0x14, 0xEF]);
        let crc = reading.bytes[10..28].iter().fold(0u32, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte) << 24, |crc, _| {
                crc << 1 ^ if crc >> 31 == 1 { 0x04C1_1DB7 } else { 0 }
            })
        });
        assert_eq!(reading.bytes[28..], crc.to_be_bytes());
    }
}

#[test]
fn every_quadrant_is_where_displays_look_for_it() {
    let ((color, depth), (back_color, back_depth)) = (layer(0), layer(50));
    let [quadrants, lines] = BOTH.map(frame);
    let at = |frame: &Frame, x: usize, y: usize| samples(frame)[3 * (1920 * y + x)..][..3].to_vec();
    for (x, y) in [(1, 0), (959, 0), (3, 17), (700, 539)] {
        let i = 960 * y + x;
        for (frame, front_line, back_line) in [(&quadrants, y, 540 + y), (&lines, 2 * y, 2 * y + 1)] {
            assert_eq!(at(frame, x, front_line), color[i][..3]);
            assert_eq!(at(frame, 960 + x, front_line), [disparity(depth[i]); 3]);
            assert_eq!(at(frame, x, back_line), back_color[i][..3]);
            assert_eq!(at(frame, 960 + x, back_line), [disparity(back_depth[i]); 3]);
        }
    }
}

#[test]
fn the_inspection_tells_the_two_apart() {
    for layout in BOTH {
        let frame = frame(layout);
        for report in [inspect_frame(&frame), inspect_png(&encode_png(&frame).unwrap()).unwrap()] {
            assert_eq!((report.layout, report.problems.len()), (layout, 0), "{:?}", report.problems);
            assert!(report.extended_hex.unwrap().starts_with("F214EF"));
        }
    }
}

#[test]
fn declipse_needs_a_background_layer_and_other_layouts_omit_it() {
    let (color, depth) = layer(0);
    let picture = Picture::new(SIZE, &color, &depth).unwrap();
    for layout in BOTH {
        let error = encoder(layout).encode(&picture, LIMITS).unwrap_err();
        assert_eq!(error, LayoutError::NoBackground { layout });
        assert!(error.to_string().contains("two-layer"), "{error}");
    }
    assert!(
        picture.with_back(&color[1..], &depth).is_err() && picture.with_back(&color, &depth[1..]).is_err()
    );
    let with_back = picture.with_back(&color, &depth).unwrap();
    let plain = encoder(Layout::Wowvx);
    assert_eq!(plain.encode(&with_back, LIMITS), plain.encode(&picture, LIMITS));
    let narrow = DisplayProfile::new([1920, 1080], [960, 1080], plain.profile().constants()).unwrap();
    assert!(matches!(
        FrameEncoder::new(Layout::Declipse, narrow, Header::default()),
        Err(LayoutError::Profile { .. })
    ));
}

#[test]
fn the_background_is_filtered_as_well() {
    let (color, depth) = (vec![[9; 4]; 960 * 540], vec![200.0; 960 * 540]);
    let mut spot = depth.clone();
    spot[960 * 100 + 100] = 120.0;
    let picture = Picture::new(SIZE, &color, &depth).unwrap().with_back(&color, &spot).unwrap();
    for (filter, differs) in [(DepthFilter::None, true), (DepthFilter::Median3, false)] {
        let encoder = encoder(Layout::Declipse).with_depth_filter(filter);
        let back = Layout::Declipse.decode(&encoder.encode(&picture, LIMITS).unwrap()).unwrap().back.unwrap();
        assert_eq!(back.disparity.iter().any(|d| *d != back.disparity[0]), differs, "{filter}");
    }
}

#[test]
fn damaged_frames_are_refused_by_name() {
    for layout in BOTH {
        let frame = frame(layout);
        let mut damaged = samples(&frame).to_vec();
        damaged[3 * (1920 * 701 + 1200)] ^= 0xFF;
        let problems = layout.decode(&Frame::new([1920, 1080], Pixels::Rgb8(damaged)).unwrap()).unwrap_err();
        assert!(matches!(problems[..], [FrameProblem::DepthNotGrey { pixels: 1, first: [1200, 701], .. }]));
        let odd = Frame::new([1920, 1079], Pixels::Rgb8(vec![0; 3 * 1920 * 1079])).unwrap();
        assert!(matches!(layout.decode(&odd).unwrap_err()[..], [FrameProblem::FrameSize { .. }]));
    }
}
