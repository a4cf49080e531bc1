//! Depth filters: they remove outliers, make no new values, and have the same numbers as numpy and
//! VTK have.
//!
//! With `RELIEF_PEERS_PYTHON` unset the comparison with the peers says that it skipped.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking, its helpers too")]

use std::io::Write;
use std::process::{Command, Stdio};

use proptest::prelude::*;
use relief_base::DepthLimits;
use relief_display::{DecodedDepth, DepthFilter, DisplaySettings, FrameEncoder, Header, Layout, Picture};

const LIMITS: DepthLimits = DepthLimits { near_mm: 100.0, far_mm: 900.0 };
const MISS: f32 = f32::INFINITY;
const OBJECT: [u8; 4] = [220, 190, 160, 255];
const GROUND: [u8; 4] = [20, 30, 60, 255];

fn filtered(filter: DepthFilter, size_px: [u32; 2], color: &[[u8; 4]], depth_mm: &[f32]) -> Vec<f32> {
    filter.apply(&Picture::new(size_px, color, depth_mm).unwrap()).into_owned()
}

fn gray(filter: DepthFilter, size_px: [u32; 2], depth_mm: &[f32]) -> Vec<f32> {
    filtered(filter, size_px, &vec![[128; 4]; depth_mm.len()], depth_mm)
}

/// A picture from a function of column and row.
fn picture<T>([width, height]: [u32; 2], at: impl Fn(i32, i32) -> T) -> Vec<T> {
    (0..(width * height) as i32).map(|i| at(i % width as i32, i / width as i32)).collect()
}

#[test]
fn a_median_removes_what_is_smaller_than_half_of_its_window() {
    let size = [21, 17];
    for outlier in [150.0, 800.0, MISS] {
        let one = picture(size, |x, y| if (x, y) == (9, 8) { outlier } else { 400.0 });
        let corner = picture(size, |x, y| if (x, y) == (0, 0) { outlier } else { 400.0 });
        // Twelve of twenty-five pixels: the larger window just removes them, and the smaller one
        // does not.
        let twelve =
            picture(size, |x, y| if (8..11).contains(&x) && (7..11).contains(&y) { outlier } else { 400.0 });
        let flat = vec![400.0; one.len()];
        assert_eq!(gray(DepthFilter::None, size, &one), one);
        assert_eq!(gray(DepthFilter::Median3, size, &one), flat);
        assert_eq!(gray(DepthFilter::Median5, size, &one), flat);
        assert_eq!(gray(DepthFilter::Median5, size, &corner)[1..], flat[1..]);
        assert_eq!(gray(DepthFilter::Median5, size, &twelve), flat);
        assert_ne!(gray(DepthFilter::Median3, size, &twelve), flat);
    }
}

#[test]
fn straight_edges_and_slopes_stay_where_they_are() {
    let size = [24, 18];
    let upright = picture(size, |x, _| if x < 11 { 300.0 } else { MISS });
    let level = picture(size, |_, y| if y < 7 { MISS } else { 300.0 });
    let slope = picture(size, |x, y| 300.0 + x as f32 * 2.0 + y as f32 * 3.0);
    for filter in [DepthFilter::Median3, DepthFilter::Median5] {
        assert_eq!(gray(filter, size, &upright), upright, "{filter}");
        assert_eq!(gray(filter, size, &level), level, "{filter}");
        let inner = |plane: &[f32]| {
            let inside = |i: &usize| (2..22).contains(&(i % 24)) && (2..16).contains(&(i / 24));
            (0..plane.len()).filter(inside).map(|i| plane[i]).collect::<Vec<_>>()
        };
        assert_eq!(inner(&gray(filter, size, &slope)), inner(&slope), "{filter}");
    }
}

/// A disc of another colour before a background, and its depth moved to the right by some pixels.
fn misaligned_disc(shift: i32) -> (Vec<[u8; 4]>, Vec<f32>) {
    let inside = |x: i32, y: i32| (x - 32).pow(2) + (y - 32).pow(2) < 18 * 18;
    // Some shading and texture: colours are never flat.
    let noisy = |color: [u8; 4], x: i32, y: i32| {
        let off = ((x * 7 + y * 13) % 11) as u8;
        [color[0] + off, color[1] + off / 2, color[2] + off, 255]
    };
    let color = picture([64, 64], |x, y| noisy(if inside(x, y) { OBJECT } else { GROUND }, x, y));
    let depth = picture([64, 64], |x, y| if inside(x - shift, y) { 300.0 } else { MISS });
    (color, depth)
}

#[test]
fn frames_are_filtered_and_the_picture_is_not() {
    let size = [32, 8];
    let color = picture(size, |x, y| [x as u8, y as u8, 7, 255]);
    let depth = picture(size, |x, y| if (x, y) == (9, 4) { 150.0 } else { 500.0 });
    let settings =
        |layout: Layout, depth_filter| DisplaySettings { layout, depth_filter, ..DisplaySettings::default() };
    let pack = |layout: Layout, filter| {
        let encoder = settings(layout, filter).encoder().unwrap();
        assert_eq!(encoder.depth_filter(), filter);
        let frame = encoder.encode(&Picture::new(size, &color, &depth).unwrap(), LIMITS).unwrap();
        layout.decode(&frame).unwrap()
    };
    for layout in [Layout::Rgbd, Layout::Depth16] {
        let flat = |depth: &DecodedDepth| match depth {
            DecodedDepth::Disparity(bytes) => bytes.iter().all(|d| *d == bytes[0]),
            DecodedDepth::Scaled16(values) => values.iter().all(|z| *z == values[0]),
            DecodedDepth::None => panic!("{layout} has depth"),
        };
        let (plain, median) = (pack(layout, DepthFilter::None), pack(layout, DepthFilter::Median3));
        assert_eq!(plain.color, median.color);
        assert!(!flat(&plain.depth) && flat(&median.depth), "{layout}");
    }
    let plain = FrameEncoder::new(
        Layout::Rgbd,
        settings(Layout::Rgbd, DepthFilter::None).profile().unwrap(),
        Header::default(),
    );
    assert_eq!(plain.unwrap().depth_filter(), DepthFilter::None);
}

#[test]
fn names_come_back_and_others_are_refused_with_all_names() {
    for filter in DepthFilter::ALL {
        assert_eq!(DepthFilter::from_name(filter.name()), Some(filter));
        let settings: DisplaySettings =
            serde_json::from_str(&format!(r#"{{"depth_filter": "{filter}"}}"#)).unwrap();
        assert_eq!(settings.depth_filter, filter);
        assert_eq!(serde_json::to_value(&settings).unwrap()["depth_filter"], filter.name());
    }
    let error =
        serde_json::from_str::<DisplaySettings>(r#"{"depth_filter": "blur"}"#).unwrap_err().to_string();
    for name in ["blur", "none", "median-3", "median-5"] {
        assert!(error.contains(name), "{error}");
    }
}

/// A picture of noise: depth in a few steps, misses, no numbers, colours of few kinds.
fn noise(seed: u64, [width, height]: [u32; 2]) -> (Vec<[u8; 4]>, Vec<f32>) {
    let mut state = seed | 1;
    let mut next = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as u32
    };
    let pixel = |_| {
        let color = (next() as u8 & 0xC0, next() as u8 & 0xE0, next() as u8 & 0xF0);
        let depth = match next() % 8 {
            0 => MISS,
            1 => 50.0 + (next() % 3) as f32 * 450.0,
            _ => 100.0 + (next() % 8000) as f32 / 10.0,
        };
        ([color.0, color.1, color.2, 255], depth)
    };
    (0..width * height).map(pixel).unzip()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Invariant: Depth filters return input values only and change no pick.
    #[test]
    fn every_filter_gives_values_that_were_there_before(
        width in 1u32..40, height in 1u32..24, seed in any::<u64>(), unknown in any::<prop::sample::Index>(),
    ) {
        let (color, mut depth) = noise(seed, [width, height]);
        let at = unknown.index(depth.len());
        depth[at] = f32::NAN;
        for filter in [DepthFilter::Median3, DepthFilter::Median5] {
            let out = filtered(filter, [width, height], &color, &depth);
            prop_assert_eq!(out.len(), depth.len());
            prop_assert!(out.iter().all(|mm| depth.contains(mm) || *mm == MISS), "{}", filter);
        }
    }

    #[test]
    fn a_median_of_what_is_turned_about_is_the_median_turned_about(
        width in 1u32..30, height in 1u32..30, seed in any::<u64>(),
    ) {
        let (color, depth) = noise(seed, [width, height]);
        let turned: Vec<f32> = depth.iter().rev().copied().collect();
        let turned_color: Vec<_> = color.iter().rev().copied().collect();
        for filter in [DepthFilter::Median3, DepthFilter::Median5] {
            let mut out = filtered(filter, [width, height], &turned_color, &turned);
            out.reverse();
            prop_assert_eq!(out, filtered(filter, [width, height], &color, &depth), "{}", filter);
        }
    }
}

/// The definitions in numpy, written from docs/DEPTH.md's words; the 3x3 median by VTK as well,
/// border left out.
const PEERS: &str = r"
import sys
import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkImagingGeneral import vtkImageMedian3D
width, height = int(sys.argv[1]), int(sys.argv[2])
data = sys.stdin.buffer.read()
depth = np.frombuffer(data, '<f4').reshape(height, width)

def windows(plane, reach):
    pad = [(reach, reach), (reach, reach)] + [(0, 0)] * (plane.ndim - 2)
    side = 2 * reach + 1
    view = np.lib.stride_tricks.sliding_window_view(np.pad(plane, pad, 'edge'), (side, side), axis=(0, 1))
    return view

def median(reach):
    side = 2 * reach + 1
    return np.median(windows(depth, reach).reshape(height, width, side * side), axis=2).astype('<f4')

def vtk_median():
    image = vtkImageData()
    image.SetDimensions(width, height, 1)
    image.GetPointData().SetScalars(numpy_to_vtk(np.where(np.isinf(depth), 1e30, depth).ravel(), deep=True))
    filter = vtkImageMedian3D()
    filter.SetInputData(image)
    filter.SetKernelSize(3, 3, 1)
    filter.Update()
    out = vtk_to_numpy(filter.GetOutput().GetPointData().GetScalars()).reshape(height, width)
    return np.where(out > 1e29, np.inf, out)

three = median(1)
inside = (slice(1, -1), slice(1, -1))
assert np.array_equal(vtk_median()[inside], three[inside]), 'VTK and numpy disagree'
for plane in (three, median(2)):
    sys.stdout.buffer.write(plane.tobytes())
";

#[test]
fn numpy_and_vtk_have_the_same_numbers() {
    let Ok(python) = std::env::var("RELIEF_PEERS_PYTHON") else {
        eprintln!("SKIPPED: depth filters in numpy and VTK (RELIEF_PEERS_PYTHON is not set)");
        return;
    };
    let size = [61, 43];
    let (color, depth) = noise(11, size);
    let (disc, disc_depth) = misaligned_disc(2);
    for (size, color, depth) in [(size, color, depth), ([64, 64], disc, disc_depth)] {
        let arguments = size.map(|side| side.to_string());
        let mut command = Command::new(&python);
        command.arg("-c").arg(PEERS).args(&arguments).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let bytes: Vec<u8> = depth.iter().flat_map(|mm| mm.to_le_bytes()).collect();
        child.stdin.take().unwrap().write_all(&bytes).unwrap();
        let output = child.wait_with_output().unwrap();
        assert!(output.status.success(), "the peers failed; see above");
        let planes: Vec<f32> =
            output.stdout.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        let filters = [DepthFilter::Median3, DepthFilter::Median5];
        for (filter, peer) in filters.into_iter().zip(planes.chunks_exact(depth.len())) {
            let own = filtered(filter, size, &color, &depth);
            let apart = own.iter().zip(peer).filter(|(own, peer)| own != peer).count();
            assert_eq!(apart, 0, "{filter}: {apart} of {} pixels differ", own.len());
        }
    }
}

/// Not a test of speed: it prints the cost of a frame of 960x540, from which the figures of
/// docs/DEPTH.md come.
#[test]
fn a_frame_of_a_display_is_filtered_in_one_go() {
    let size = [960, 540];
    let color = picture(size, |x, y| if (x / 40 + y / 40) % 2 == 0 { OBJECT } else { GROUND });
    let depth = picture(size, |x, y| if (x / 40 + y / 40) % 2 == 0 { 300.0 + x as f32 / 10.0 } else { MISS });
    for filter in DepthFilter::ALL {
        let start = std::time::Instant::now();
        let out = filtered(filter, size, &color, &depth);
        println!("{filter}: {:.1} ms at 960x540", start.elapsed().as_secs_f64() * 1e3);
        let apart = out.iter().zip(&depth).filter(|(a, b)| a != b).count();
        assert!(apart < out.len() / 5, "{filter} changes {apart} pixels of a board of squares");
        assert_eq!(apart == 0, filter == DepthFilter::None, "{filter}");
    }
}
