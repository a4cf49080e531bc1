//! Files: PNG, JPEG and OpenEXR, read back by decoders and chunk walkers that are not the
//! encoder's.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking, its helpers too")]

use std::collections::BTreeMap;
use std::io::Cursor;

use glam::{DAffine3, DMat3, DMat4, DVec3, DVec4};
use proptest::prelude::*;
use relief_base::{DepthLimits, Transform};
use relief_display::{
    Attribute, CameraMatrices, DepthImage, EncodeError, Frame, Pixels, decode_exr, encode_exr, encode_jpeg,
    encode_png,
};

const LIMITS: DepthLimits = DepthLimits { near_mm: 123.456_789_012_345, far_mm: 987.654_321 };

/// The chunk types of a PNG file in order.
fn chunks(png: &[u8]) -> Vec<String> {
    let (mut names, mut at) = (Vec::new(), 8);
    while at < png.len() {
        let length = u32::from_be_bytes(png[at..at + 4].try_into().unwrap()) as usize;
        names.push(String::from_utf8(png[at + 4..at + 8].to_vec()).unwrap());
        at += 12 + length;
    }
    names
}

/// Whether a PNG file has no chunk but those of the size, the pixels and the end.
fn only_pixels(png: &[u8]) -> bool {
    chunks(png).iter().all(|name| ["IHDR", "IDAT", "IEND"].contains(&name.as_str()))
}

fn picture(width: usize, height: usize) -> (Vec<[u8; 4]>, Vec<f32>) {
    let color = (0..width * height)
        .map(|i| [(i % 256) as u8, (i / 7 % 256) as u8, (255 - i % 256) as u8, (i / 3 % 256) as u8]);
    let depth = (0..width * height).map(|i| if i % 5 == 0 { f32::INFINITY } else { 100.0 + 0.1 * i as f32 });
    (color.collect(), depth.collect())
}

/// Invariant: A PNG contains no chunk that makes a browser alter its colours, and with them the
/// header.
#[test]
fn a_png_holds_the_frame_and_no_chunk_that_alters_it() {
    let samples: Vec<u8> = (0..3 * 67 * 41).map(|i| (i * i % 251) as u8).collect();
    let png = encode_png(&Frame::new([67, 41], Pixels::Rgb8(samples.clone())).unwrap()).unwrap();
    assert!(only_pixels(&png), "{:?}", chunks(&png));
    let image = image::load_from_memory(&png).unwrap();
    assert_eq!(image.color(), image::ColorType::Rgb8);
    assert_eq!((image.width(), image.height(), image.as_bytes()), (67, 41, &samples[..]));
}

#[test]
fn a_depth_png_has_16_bits_of_grey() {
    let samples: Vec<u16> = (0..67 * 41).map(|i| (i * 2347 % 65536) as u16).collect();
    let png = encode_png(&Frame::new([67, 41], Pixels::Gray16(samples.clone())).unwrap()).unwrap();
    assert!(only_pixels(&png), "{:?}", chunks(&png));
    // IHDR: bit depth 16, colour type 0; samples in the file are big-endian, which the decoder
    // turns.
    assert_eq!(png[24..26], [16, 0]);
    assert_eq!(image::load_from_memory(&png).unwrap().into_luma16().into_raw(), samples);
}

#[test]
fn a_jpeg_is_close_to_the_colours() {
    let color: Vec<[u8; 4]> = (0..64 * 48).map(|i| [(i % 64 * 3) as u8, (i / 64 * 4) as u8, 90, 0]).collect();
    let jpeg = encode_jpeg([64, 48], &color, 95).unwrap();
    let decoded = image::load_from_memory(&jpeg).unwrap().into_rgb8();
    assert_eq!(decoded.dimensions(), (64, 48));
    let worst =
        decoded.pixels().zip(&color).flat_map(|(p, c)| (0..3).map(move |k| p.0[k].abs_diff(c[k]))).max();
    assert!(worst.unwrap() <= 8, "{worst:?}");
    for (size_px, quality) in [([64, 48], 0), ([64, 48], 101)] {
        assert!(matches!(encode_jpeg(size_px, &color, quality), Err(EncodeError::JpegRange { .. })));
    }
    assert!(matches!(encode_jpeg([64, 47], &color, 90), Err(EncodeError::PixelCount { expected: 3008, .. })));
    assert!(matches!(encode_jpeg([0, 48], &[], 90), Err(EncodeError::JpegRange { .. })));
    assert!(matches!(encode_jpeg([65536, 1], &vec![[0; 4]; 65536], 90), Err(EncodeError::JpegRange { .. })));
}

fn attributes() -> BTreeMap<String, Attribute> {
    BTreeMap::from([
        ("eye_mm".to_owned(), Attribute::Vector([-674.601, 0.1, 1e-9])),
        ("vertical_fov_deg".to_owned(), Attribute::Number(22.1)),
        ("projection".to_owned(), Attribute::Text("perspective".to_owned())),
        ("depth_rule".to_owned(), Attribute::Text("threshold".to_owned())),
    ])
}

#[test]
fn an_exr_gives_back_depth_colour_and_attributes_exactly() {
    let (color, depth_mm) = picture(37, 50);
    let attributes = attributes();
    let image = DepthImage {
        size_px: [37, 50],
        depth_mm: &depth_mm,
        color: Some(&color),
        limits: LIMITS,
        camera: None,
        attributes: &attributes,
    };
    let decoded = decode_exr(&encode_exr(&image).unwrap()).unwrap();
    assert_eq!((decoded.size_px, decoded.depth_mm), ([37, 50], depth_mm));
    assert_eq!(decoded.color, Some(color));
    let mut expected = attributes.clone();
    expected.insert("near_mm".to_owned(), Attribute::Number(LIMITS.near_mm));
    expected.insert("far_mm".to_owned(), Attribute::Number(LIMITS.far_mm));
    assert_eq!(decoded.attributes, expected);
}

/// Read with the OpenEXR crate directly: channel names and types as documented, +inf for a miss,
/// linear colours.
#[test]
fn an_exr_has_the_documented_channels() {
    use exr::prelude::{FlatSamples, ReadChannels, ReadLayers, SampleType};
    let (mut color, depth_mm) = picture(16, 4);
    color[1] = [0, 128, 255, 51];
    let attributes = attributes();
    let image = DepthImage {
        size_px: [16, 4],
        depth_mm: &depth_mm,
        color: Some(&color),
        limits: LIMITS,
        camera: None,
        attributes: &attributes,
    };
    let file = encode_exr(&image).unwrap();
    let read =
        exr::image::read::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let layer = read.all_attributes().from_buffered(Cursor::new(&file)).unwrap().layer_data;
    let kinds: Vec<(String, SampleType)> = layer
        .channel_data
        .list
        .iter()
        .map(|channel| {
            let kind = match channel.sample_data {
                FlatSamples::F16(_) => SampleType::F16,
                FlatSamples::F32(_) => SampleType::F32,
                FlatSamples::U32(_) => SampleType::U32,
            };
            (channel.name.to_string(), kind)
        })
        .collect();
    let named = |name: &str, kind| (name.to_owned(), kind);
    let half = SampleType::F16;
    assert_eq!(
        kinds,
        [named("A", half), named("B", half), named("G", half), named("R", half), named("Z", SampleType::F32)]
    );
    let second: Vec<f32> =
        layer.channel_data.list.iter().map(|c| c.sample_data.value_by_flat_index(1).to_f32()).collect();
    // sRGB 128 is 0.2159 of linear light.
    for (found, expected) in second.iter().zip([0.2, 1.0, 0.215_86, 0.0, 100.1]) {
        assert!((found - expected).abs() < 1e-4 * expected.max(1.0), "{second:?}");
    }
    assert_eq!(layer.channel_data.list[4].sample_data.value_by_flat_index(0).to_f32(), f32::INFINITY);
}

/// OpenEXR's camera looks along +z; its matrices multiply row vectors; (0, 0) of NDC is the top
/// left.
#[test]
fn the_camera_matrices_are_the_standard_ones() {
    // The eye at (0, -900, 40) looks along +y with z up: view x = x, y = z - 40, z = -(y + 900).
    let linear = DMat3::from_cols(DVec3::X, -DVec3::Z, DVec3::Y);
    let view_from_patient =
        DAffine3::from_mat3_translation(linear, -(linear * DVec3::new(0.0, -900.0, 40.0)));
    let (tan, aspect) = (11f64.to_radians().tan(), 16.0 / 9.0);
    let camera = CameraMatrices {
        view_from_patient: Transform::from_affine(view_from_patient),
        ndc_from_view: DMat4::from_cols(
            DVec4::new(0.5 / (tan * aspect), 0.0, 0.0, 0.0),
            DVec4::new(0.0, -0.5 / tan, 0.0, 0.0),
            DVec4::new(-0.5, -0.5, 1.0, -1.0),
            DVec4::ZERO,
        ),
    };
    let none = BTreeMap::new();
    let image = DepthImage {
        size_px: [1, 1],
        depth_mm: &[1.0],
        color: None,
        limits: LIMITS,
        camera: Some(camera),
        attributes: &none,
    };
    let file = encode_exr(&image).unwrap();
    let meta = exr::meta::MetaData::read_from_buffered(Cursor::new(&file), true).unwrap();
    let own = &meta.headers[0].own_attributes;
    let times = |matrix: [f32; 16], p: [f32; 3]| -> [f32; 4] {
        std::array::from_fn(|j| (0..3).map(|i| p[i] * matrix[4 * i + j]).sum::<f32>() + matrix[12 + j])
    };
    // 900 mm in front of the eye, 10 mm to the patient's left (the picture's right), 20 mm up.
    let seen = times(own.world_to_camera.unwrap(), [10.0, 0.0, 60.0]);
    for (found, expected) in seen.iter().zip([10.0, 20.0, 900.0, 1.0]) {
        assert!((found - expected).abs() < 1e-3, "{seen:?}");
    }
    let [x, y, _, w] = times(own.world_to_normalized_device.unwrap(), [10.0, 0.0, 60.0]);
    let half_height = 900.0 * 11f32.to_radians().tan();
    assert!((x / w - (0.5 + 0.5 * 10.0 / (half_height * 16.0 / 9.0))).abs() < 1e-5, "{x} {w}");
    assert!((y / w - (0.5 - 0.5 * 20.0 / half_height)).abs() < 1e-5, "{y} {w}");
}

#[test]
fn the_same_picture_gives_the_same_file() {
    let (color, depth_mm) = picture(64, 64);
    let attributes = attributes();
    let image = DepthImage {
        size_px: [64, 64],
        depth_mm: &depth_mm,
        color: Some(&color),
        limits: LIMITS,
        camera: None,
        attributes: &attributes,
    };
    let first = encode_exr(&image).unwrap();
    for _ in 0..8 {
        assert!(encode_exr(&image).unwrap() == first);
    }
}

#[test]
fn exr_refuses_layouts_that_it_cannot_hold() {
    let encode = |size_px, attributes: &BTreeMap<String, Attribute>| {
        let depth_mm = &[1.0, 2.0];
        encode_exr(&DepthImage { size_px, depth_mm, color: None, limits: LIMITS, camera: None, attributes })
    };
    assert!(matches!(
        encode([3, 1], &BTreeMap::new()),
        Err(EncodeError::PixelCount { expected: 3, found: 2, .. })
    ));
    for (name, value) in [("", "x"), ("ümlaut", "x"), ("name", "→"), (&"n".repeat(256), "x")] {
        let attributes = BTreeMap::from([(name.to_owned(), Attribute::Text(value.to_owned()))]);
        assert!(matches!(encode([2, 1], &attributes), Err(EncodeError::Attribute(_))), "{name}");
    }
}

/// Invariant: No bytes from outside cause a panic: DICOM files, frames, requests.
#[test]
fn every_prefix_of_an_exr_is_refused_without_panic() {
    let (color, depth_mm) = picture(8, 8);
    let none = BTreeMap::new();
    let image = DepthImage {
        size_px: [8, 8],
        depth_mm: &depth_mm,
        color: Some(&color),
        limits: LIMITS,
        camera: None,
        attributes: &none,
    };
    let file = encode_exr(&image).unwrap();
    for length in 0..file.len() {
        assert!(decode_exr(&file[..length]).is_err(), "{length} of {} bytes", file.len());
    }
    assert!(decode_exr(&file).is_ok());
}

/// A header of a few bytes must not make the decoder allocate gigabytes.
#[test]
fn an_exr_that_is_too_large_is_refused_before_it_is_decoded() {
    let none = BTreeMap::new();
    let (size_px, depth_mm) = ([8, 1], &[1.0; 8]);
    let image =
        DepthImage { size_px, depth_mm, color: None, limits: LIMITS, camera: None, attributes: &none };
    let mut file = encode_exr(&image).unwrap();
    for name in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
        let at = file.windows(name.len()).position(|window| window == name).unwrap() + name.len() + 4;
        file[at + 8..at + 12].copy_from_slice(&20_000i32.to_le_bytes()); // largest x
    }
    let error = decode_exr(&file).unwrap_err();
    assert!(matches!(error, EncodeError::ExrSize([20_001, 1])), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn any_depth_comes_back_bit_for_bit(depth_mm in prop::collection::vec(-1e9f32..1e9, 1..200)) {
        let none = BTreeMap::new();
        let size_px = [depth_mm.len() as u32, 1];
        let image = DepthImage { size_px, depth_mm: &depth_mm, color: None, limits: LIMITS, camera: None, attributes: &none };
        let decoded = decode_exr(&encode_exr(&image).unwrap()).unwrap();
        prop_assert_eq!(decoded.depth_mm, depth_mm);
        prop_assert_eq!(decoded.color, None);
    }
}
