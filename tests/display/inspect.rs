//! The inspection: intact frames are recognized by layout, damaged ones by their errors.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking, its helpers too")]

use std::io::Cursor;

use proptest::prelude::*;
use relief_base::DepthLimits;
use relief_display::{
    ContentType, DisplaySettings, Frame, FrameReport, InspectError, Layout, Picture, Pixels, encode_png,
    inspect_frame, inspect_png,
};
use serde_json::{Value, json};

const LIMITS: DepthLimits = DepthLimits { near_mm: 0.0, far_mm: 1.0 };

/// A frame of a coloured disc that is nearest at its centre, on black.
fn disc(settings: &DisplaySettings) -> Frame {
    let encoder = settings.encoder().unwrap();
    let size_px @ [width, height] = encoder.render_size_px().unwrap_or([320, 200]);
    let radius = |x: u32, y: u32| {
        let (dx, dy) = (f64::from(x) / f64::from(width) - 0.5, f64::from(y) / f64::from(height) - 0.5);
        2.5 * dx.hypot(dy)
    };
    let pixels = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let color: Vec<[u8; 4]> = pixels()
        .map(|(x, y)| if radius(x, y) < 1.0 { [200, (x % 256) as u8, (y % 256) as u8, 255] } else { [0; 4] })
        .collect();
    let depth_mm: Vec<f32> =
        pixels().map(|(x, y)| if radius(x, y) < 1.0 { radius(x, y) as f32 } else { f32::INFINITY }).collect();
    // Behind it, for layouts that carry that: a wall.
    let (wall, wall_mm) = (vec![[30, 40, 50, 255]; color.len()], vec![0.9; color.len()]);
    let picture = Picture::new(size_px, &color, &depth_mm).unwrap().with_back(&wall, &wall_mm).unwrap();
    encoder.encode(&picture, LIMITS).unwrap()
}

fn disc_of(layout: Layout) -> Frame {
    disc(&DisplaySettings { layout, ..DisplaySettings::default() })
}

fn samples(frame: &Frame) -> Vec<u8> {
    match frame.pixels() {
        Pixels::Rgb8(samples) => samples.clone(),
        Pixels::Gray16(_) => panic!("expected 8-bit RGB"),
    }
}

fn codes(report: &FrameReport) -> Vec<&'static str> {
    report.problems.iter().map(relief_display::FrameProblem::code).collect()
}

fn inspect_samples(size_px: [u32; 2], samples: Vec<u8>) -> FrameReport {
    inspect_frame(&Frame::new(size_px, Pixels::Rgb8(samples)).unwrap())
}

/// The PNG with a chunk put behind IHDR, its CRC as the format wants it.
fn with_chunk(png: &[u8], name: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let mut crc = u32::MAX;
    for byte in name.iter().chain(data) {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = crc >> 1 ^ if crc & 1 == 1 { 0xEDB8_8320 } else { 0 };
        }
    }
    let length = u32::try_from(data.len()).unwrap().to_be_bytes();
    [&png[..33], &length, name, data, &(!crc).to_be_bytes(), &png[33..]].concat()
}

#[test]
fn whole_frames_have_their_layout_and_no_problem() {
    for layout in Layout::ALL.into_iter().filter(|layout| layout.view_count() == 0) {
        let report = inspect_png(&encode_png(&disc_of(layout)).unwrap()).unwrap();
        assert_eq!((report.layout, codes(&report)), (layout, vec![]), "{layout}");
        assert_eq!(report.header_hex.is_some(), layout.has_header(), "{layout}");
        let nearest = report.depth.map(|depth| (depth.farthest, depth.nearest));
        let expected = match layout {
            Layout::Color => None,
            Layout::Depth16 => Some((0, 65535)),
            _ => Some((0, 255)),
        };
        assert_eq!(nearest, expected, "{layout}");
    }
}

#[test]
fn the_json_is_as_documented() {
    let settings = DisplaySettings { content: ContentType::Signage, ..DisplaySettings::default() };
    let report = serde_json::to_value(inspect_png(&encode_png(&disc(&settings)).unwrap()).unwrap()).unwrap();
    assert_eq!(
        report,
        json!({
            "layout": "wowvx",
            "frame_px": [1920, 1080],
            "header_hex": "F10140800000C42DD3AF",
            "content": "signage",
            "factor": 64,
            "offset": 128,
            "select": { "factor": false, "offset": false },
            "extended_hex": "F2140000000000000000000000000000000036958221",
            "problems": []
        })
    );
    let plain = serde_json::to_value(inspect_frame(&disc_of(Layout::Color))).unwrap();
    for key in ["header_hex", "content", "factor", "offset", "select", "extended_hex"] {
        assert_eq!(plain[key], Value::Null, "{key}");
    }
}

#[test]
fn problems_are_named_with_code_and_numbers() {
    let whole = samples(&disc_of(Layout::Wowvx));
    let damaged = |damage: &dyn Fn(&mut Vec<u8>)| {
        let mut samples = whole.clone();
        damage(&mut samples);
        let report = inspect_samples([1920, 1080], samples);
        assert_eq!(report.layout, Layout::Wowvx);
        report
    };
    let no_header = damaged(&|samples| samples[..3 * 960].fill(0));
    assert_eq!((codes(&no_header), no_header.header_hex), (vec!["no-header"], None));

    let crc = damaged(&|samples| samples[3 * 2 * 20 + 2] ^= 0x80);
    assert_eq!(codes(&crc), ["header-crc"]);
    // Pixel 40 carries bit 3 of H2: 0x40 has become 0x48, which the report shows as it is.
    assert!(crc.header_hex.unwrap().starts_with("F10448800000"));
    assert_eq!(crc.factor, Some(0x48));

    let odd = damaged(&|samples| samples[3 * 1920 * 33 + 30] = 9);
    assert_eq!(
        odd.problems[0].to_string(),
        "odd lines that are not black: 1, with 1 coloured pixels, the first at x 10, y 33"
    );
    let tinted = damaged(&|samples| samples[3 * (1920 * 540 + 1440)] = 0);
    assert_eq!(codes(&tinted), ["depth-not-grey"]);
    assert!(tinted.problems[0].to_string().contains("x 1440, y 540 is 0, "), "{}", tinted.problems[0]);
    let json = serde_json::to_value(&tinted).unwrap();
    assert_eq!(json["problems"][0]["code"], "depth-not-grey");
    assert!(json["problems"][0]["message"].is_string());
}

/// Faults of public writers, in whole frames of them.
#[test]
fn known_wrong_writers_are_refused_with_the_reason() {
    let whole =
        samples(&disc(&DisplaySettings { content: ContentType::Signage, ..DisplaySettings::default() }));
    let with_header = |bytes: &[u8], width: usize| {
        let mut samples = whole.clone();
        for x in (0..width).step_by(2) {
            let bit = bytes.get(x / 16).map_or(0, |byte| byte >> (7 - x % 16 / 2) & 1);
            samples[3 * x + 2] = samples[3 * x + 2] & 0x7F | bit << 7;
        }
        inspect_samples([1920, 1080], samples)
    };
    let base = [0xF1, 1, 0x40, 0x80, 0, 0, 0xC4, 0x2D, 0xD3, 0xAF];
    let extended = |start: &[u8], crc: [u8; 4]| [&base, start, &vec![0; 18 - start.len()][..], &crc].concat();
    let right = extended(&[0xF2, 0x14, 0], [0x36, 0x95, 0x82, 0x21]);
    assert_eq!(codes(&with_header(&right, 512)), [""; 0]);

    let mut shader = extended(&[0xF2, 0x14, 0], [0x35, 0x95, 0x82, 0x21]);
    shader.truncate(31); // bits from column 494 on are not written
    let shader = with_header(&shader, 512);
    assert_eq!(codes(&shader), ["header-crc"]);
    assert!(
        shader.problems[0].to_string().contains("0x35958200, expected 0x36958221"),
        "{}",
        shader.problems[0]
    );

    let stray = extended(&[0xF2, 0x14, 0, 0, 0, 0, 0, 0, 0xA0], [0xF6, 0x48, 0x6E, 0xF6]);
    assert_eq!(codes(&with_header(&stray, 512)), ["header-reserved", "header-crc"]);

    let stereo = with_header(&[0xF1, 1, 0x40, 0x80, 0x10, 0, 0xD4, 0x7C, 0x48, 0xBC], 512);
    assert_eq!((codes(&stereo), stereo.content), (vec!["header-reserved"], Some(ContentType::Signage)));
    assert_eq!(stereo.extended_hex, None);
}

/// Lossy or scaled frames lose their header; at a display's own size that is never reported as
/// fine.
#[test]
fn a_picture_of_a_displays_size_without_header_is_a_problem() {
    let color = DisplaySettings { layout: Layout::Color, ..DisplaySettings::default() };
    assert_eq!(inspect_frame(&disc(&color)).problems, []);
    let noisy: Vec<u8> =
        (0..3 * 1920 * 1080).map(|i: u32| (i.wrapping_mul(2_654_435_761) >> 25) as u8).collect();
    let report = inspect_samples([1920, 1080], noisy);
    assert_eq!((report.layout, codes(&report)), (Layout::Color, vec!["no-header"]));
    // The whole frame shifted by one pixel, as a careless crop does.
    let mut shifted = samples(&disc_of(Layout::WowvxFullHeight));
    shifted.rotate_left(3);
    assert!(codes(&inspect_samples([1920, 1080], shifted)).contains(&"no-header"));
}

#[test]
fn a_frame_that_no_display_takes_is_named() {
    let whole = samples(&disc_of(Layout::Wowvx));
    let cropped = whole[..3 * 1920 * 1000].to_vec();
    let report = inspect_samples([1920, 1000], cropped);
    assert_eq!((report.layout, codes(&report)), (Layout::Wowvx, vec!["frame-size"]));
    assert_eq!(report.problems[0].to_string(), "the frame is 1920x1000, expected 1920x1080 or 3840x2160");
}

#[test]
fn a_scaled_frame_differs_from_a_side_by_side_picture() {
    let frame = samples(&disc_of(Layout::WowvxFullHeight));
    let scaled = (0..720).flat_map(|y| (0..1280).map(move |x| (x * 3 / 2, y * 3 / 2)));
    let scaled = scaled.flat_map(|(x, y)| frame[3 * (y * 1920 + x)..][..3].to_vec()).collect();
    let report = inspect_samples([1280, 720], scaled);
    assert_eq!(codes(&report), ["frame-size"], "{:?}", report.problems);
}

#[test]
fn colour_chunks_of_the_file_are_problems() {
    let png = encode_png(&disc_of(Layout::Wowvx)).unwrap();
    for (name, data) in [
        (b"gAMA", &45455u32.to_be_bytes()[..]),
        (b"sRGB", &[0][..]),
        (
            b"cHRM",
            &[
                0, 0, 122, 38, 0, 0, 128, 132, 0, 0, 250, 0, 0, 0, 128, 232, 0, 0, 117, 48, 0, 0, 234, 96, 0,
                0, 58, 152, 0, 0, 23, 112,
            ][..],
        ),
        (b"cICP", &[1, 13, 0, 1][..]),
    ] {
        let report = inspect_png(&with_chunk(&png, name, data)).unwrap();
        assert_eq!(codes(&report), ["color-chunk"]);
        assert!(report.problems[0].to_string().contains(std::str::from_utf8(name).unwrap()));
    }
    let harmless = inspect_png(&with_chunk(&png, b"tEXt", b"Comment\0hello")).unwrap();
    assert_eq!(codes(&harmless), [""; 0]);
}

#[test]
fn other_pixel_formats_are_problems() {
    let frame = disc_of(Layout::Wowvx);
    let rgb = image::RgbImage::from_raw(1920, 1080, samples(&frame)).unwrap();
    let inspect = |image: image::DynamicImage| {
        let mut file = Cursor::new(Vec::new());
        image.write_to(&mut file, image::ImageFormat::Png).unwrap();
        inspect_png(&file.into_inner()).unwrap()
    };
    let image = image::DynamicImage::ImageRgb8(rgb);
    assert_eq!(codes(&inspect(image.clone())), [""; 0]);
    let deep = inspect(image::DynamicImage::ImageRgb16(image.to_rgb16()));
    assert_eq!((codes(&deep), deep.layout), (vec!["pixel-format"], Layout::Wowvx));
    assert!(codes(&inspect(image::DynamicImage::ImageLuma8(image.to_luma8()))).contains(&"pixel-format"));
    let mut rgba = image.to_rgba8();
    assert_eq!(codes(&inspect(image::DynamicImage::ImageRgba8(rgba.clone()))), [""; 0]);
    rgba.get_pixel_mut(7, 8).0[3] = 254;
    assert_eq!(codes(&inspect(image::DynamicImage::ImageRgba8(rgba))), ["transparent"]);
}

#[test]
fn files_that_are_no_whole_png_are_refused() {
    let samples = (0..12 * 40 * 4).flat_map(|i| [(i % 256) as u8; 3]).collect();
    let png = encode_png(&Frame::new([12 * 40, 4], Pixels::Rgb8(samples)).unwrap()).unwrap();
    for length in 0..png.len() {
        match inspect_png(&png[..length]) {
            // Only IEND, which carries nothing, may be missing.
            Ok(report) => assert!(png.len() - length <= 12 && report.frame_px == [480, 4], "{length}"),
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }
    assert!(matches!(inspect_png(b"\xFF\xD8\xFF\xE0 JFIF"), Err(InspectError::Jpeg)));
    assert!(matches!(inspect_png(b"DICM"), Err(InspectError::NotPng(_))));
    assert!(matches!(inspect_png(b""), Err(InspectError::NotPng(_))));
}

/// Decided from IHDR only: a file of a few bytes must not make the decoder allocate gigabytes.
#[test]
fn a_picture_that_is_too_large_is_refused_before_it_is_decoded() {
    let mut png = encode_png(&Frame::new([1, 1], Pixels::Rgb8(vec![1, 2, 3])).unwrap()).unwrap();
    for (width, height) in [(16385u32, 1u32), (1, u32::MAX), (0, 1)] {
        png[16..20].copy_from_slice(&width.to_be_bytes());
        png[20..24].copy_from_slice(&height.to_be_bytes());
        assert!(matches!(inspect_png(&png), Err(InspectError::Size(size)) if size == [width, height]));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn damaged_files_never_panic(at in any::<prop::sample::Index>(), value in any::<u8>(), cut in any::<prop::sample::Index>()) {
        let samples: Vec<u8> = (0..3 * 640 * 3).map(|i| (i % 255) as u8).collect();
        let mut png = encode_png(&Frame::new([640, 3], Pixels::Rgb8(samples)).unwrap()).unwrap();
        let at = at.index(png.len());
        png[at] = value;
        let _ = inspect_png(&png);
        png.truncate(cut.index(png.len()));
        let _ = inspect_png(&png);
    }

    #[test]
    fn any_picture_is_inspected_without_panic(width in 1u32..600, height in 1u32..5, seed in any::<u64>()) {
        let samples = (0..u64::from(3 * width * height)).map(|i| (i.wrapping_mul(seed | 1) >> 40) as u8).collect();
        let report = inspect_samples([width, height], samples);
        prop_assert_eq!(report.frame_px, [width, height]);
    }
}
