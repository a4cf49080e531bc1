//! Views of a picture and its disparity: closed forms of planes, slopes and holes; layouts of views
//! and their decoders.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking, its helpers too")]

use proptest::prelude::*;
use relief_base::{DepthLimits, Disparity};
use relief_display::{
    DecodedLayer, DisplayProfile, DisplaySettings, Frame, FrameProblem, Layout, LayoutError, LensPanel,
    Parallax, Picture, Pixels, ProfileName, Views, decode_wiggle, encode_views, eyes, inspect_png,
    synthesize,
};

const LIMITS: DepthLimits = DepthLimits { near_mm: 100.0, far_mm: 300.0 };

/// A line as wide as a real picture: shifts are those of a display.
const WIDTH: u32 = 960;

fn parallax(factor: u8) -> Parallax {
    Parallax::new(&DisplayProfile::named(ProfileName::Philips42), factor, 128, WIDTH)
}

/// One line of colours and disparities.
fn line(pixel: impl Fn(usize) -> ([u8; 3], u8)) -> DecodedLayer {
    let (color, disparity) = (0..WIDTH as usize).map(pixel).unzip();
    DecodedLayer { color, disparity }
}

fn seen(front: &DecodedLayer, back: Option<&DecodedLayer>, factor: u8, eye: f64) -> Vec<[u8; 3]> {
    let views = synthesize([WIDTH, 1], front, back, &parallax(factor), &[eye]).unwrap();
    views.pictures()[0].clone()
}

/// Waves of three lengths: smooth, and nowhere the same.
fn texture(x: f64) -> [f64; 3] {
    [0.11, 0.07, 0.05].map(|frequency| 128.0 + 100.0 * (x * frequency).sin())
}

fn bytes(color: [f64; 3]) -> [u8; 3] {
    color.map(|channel| channel.round() as u8)
}

fn noise(seed: u64, count: usize) -> Vec<[u8; 4]> {
    let mut state = seed | 1;
    let mut next = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 33) as u32).to_le_bytes()
    };
    (0..count).map(|_| next()).collect()
}

/// Invariant: A synthesised view straight ahead equals the picture, planes move rigidly, slopes
/// have no cracks, and holes have the correct width.
#[test]
fn without_a_baseline_every_view_is_the_picture_byte_for_byte() {
    let color = noise(5, 77 * 9);
    let depth_mm: Vec<f32> = noise(9, 77 * 9).iter().map(|[a, ..]| 100.0 + f32::from(*a)).collect();
    let picture = Picture::new([77, 9], &color, &depth_mm).unwrap();
    let expected: Vec<[u8; 3]> = color.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect();
    for (settings, which) in [
        (DisplaySettings { view_span: Some(0.0), factor: 255, ..DisplaySettings::default() }, 0..3),
        (DisplaySettings { factor: 0, ..DisplaySettings::default() }, 0..3),
        // The middle one of an odd number is straight ahead.
        (DisplaySettings { view_span: Some(9.0), factor: 255, ..DisplaySettings::default() }, 1..2),
    ] {
        let settings = DisplaySettings { layout: "views-3".parse().unwrap(), ..settings };
        let views = settings.encoder().unwrap().views(&picture, LIMITS).unwrap();
        assert!(views.pictures()[which].iter().all(|view| *view == expected), "{settings:?}");
    }
}

/// Invariant: A synthesised view straight ahead equals the picture, planes move rigidly, slopes
/// have no cracks, and holes have the correct width.
///
/// A plane moves as a whole by the formula's shift, also by fractions of a pixel: between pixels
/// the picture is linear.
#[test]
fn a_plane_at_one_depth_moves_rigidly_by_the_exact_amount() {
    for (d, factor, eye) in [(255, 64, 1.0), (255, 64, -0.37), (0, 64, 0.5), (200, 255, 2.0), (128, 255, 7.0)]
    {
        let plane = line(|x| (bytes(texture(x as f64)), d));
        let shift = parallax(factor).shift_px(Disparity(f64::from(d)), eye);
        let view = seen(&plane, None, factor, eye);
        for (x, seen) in view.iter().enumerate().take(WIDTH as usize - 40).skip(40) {
            let source = x as f64 - shift;
            let (at, part) = (source.floor() as usize, source.rem_euclid(1.0));
            for (channel, seen) in seen.iter().enumerate() {
                let [a, b] = [at, at + 1].map(|at| f64::from(plane.color[at][channel]));
                let expected = a * (1.0 - part) + b * part;
                let off = (f64::from(*seen) - expected).abs();
                assert!(off < 0.6, "D {d}, eye {eye}, pixel {x}: {seen} for {expected}");
            }
        }
        // The edge of the picture fills the side, not black.
        assert!(view.iter().all(|color| color.iter().all(|channel| *channel >= 27)));
    }
}

/// Invariant: A synthesised view straight ahead equals the picture, planes move rigidly, slopes
/// have no cracks, and holes have the correct width.
///
/// On a slope place is linear in place, so the view is the picture stretched, without cracks.
#[test]
fn a_slope_is_stretched_without_cracks() {
    for eye in [1.5, -1.5] {
        let d = |x: usize| (x / 4) as u8;
        let slope = line(|x| (bytes(texture(x as f64)), d(x)));
        let per_step = parallax(255).shift_px(Disparity(129.0), eye);
        let view = seen(&slope, None, 255, eye);
        let mut worst: f64 = 0.0;
        for (x, color) in view.iter().enumerate().skip(60).take(WIDTH as usize - 120) {
            // x = s + (D(s) - 128) per_step, with D rising by 1/4 a pixel, from pixel 1.5 on
            // average.
            let source = (x as f64 + 128.0 * per_step + 0.375 * per_step) / (1.0 + per_step / 4.0);
            for (channel, expected) in color.iter().zip(texture(source)) {
                worst = worst.max((f64::from(*channel) - expected).abs());
            }
        }
        // Disparities are whole numbers: a place is off by up to 3/8 of a step, 0.08 px, and a step
        // of colours is 11.
        assert!(worst < 5.0, "eye {eye}: {worst}");
    }
}

/// Invariant: A synthesised view straight ahead equals the picture, planes move rigidly, slopes
/// have no cracks, and holes have the correct width.
///
/// A near strip before a far wall: the strip is where its disparity puts it, whole; beside it the
/// wall is uncovered by the difference of both shifts, and the hole shows wall.
#[test]
fn a_hole_is_as_wide_as_the_shifts_differ_and_shows_the_background_alone() {
    let strip = 400..460usize;
    let wall = [10, 60, 200];
    let scene = line(|x| if strip.contains(&x) { ([250, 20, 30], 230) } else { (wall, 40) });
    for (factor, eye) in [(64, 1.0), (64, -1.0), (200, 0.8), (255, -2.0)] {
        let [near, far] = [230.0, 40.0].map(|d| parallax(factor).shift_px(Disparity(d), eye));
        let view = seen(&scene, None, factor, eye);
        let strip_width: f64 = view
            .iter()
            .map(|color| (f64::from(color[0]) - f64::from(wall[0])) / (250.0 - f64::from(wall[0])))
            .sum();
        assert!((strip_width - 60.0).abs() < 0.05, "no part of the strip is lost or smeared: {strip_width}");
        let (from, to) = (400.0 + near, 460.0 + near);
        for (x, color) in view.iter().enumerate() {
            let covered = (to.min(x as f64 + 1.0) - from.max(x as f64)).clamp(0.0, 1.0);
            for channel in 0..3 {
                let expected =
                    f64::from(wall[channel]) * (1.0 - covered) + f64::from([250, 20, 30][channel]) * covered;
                assert!(
                    (f64::from(color[channel]) - expected).abs() < 0.7,
                    "eye {eye}, pixel {x}: {color:?}"
                );
            }
        }
        // With a second layer of another colour, only the hole has that colour.
        let behind = line(|_| ([10, 255, 200], 40));
        let view = seen(&scene, Some(&behind), factor, eye);
        let hole: f64 = view
            .iter()
            .filter(|color| color[2] > 100) // not the strip
            .map(|color| (f64::from(color[1]) - 60.0) / 195.0)
            .filter(|share| *share > 0.0)
            .sum();
        // Pixels that the strip covers more than half are not counted.
        assert!((hole - (near - far).abs()).abs() < 1.0, "eye {eye}: a hole of {hole} for {}", near - far);
        assert!(hole > (near - far).abs() - 0.6);
    }
}

/// Invariant: Foreground is never smeared into a hole, and no view direction is preferred.
///
/// Translucent edges leave a pixel of foreground colour at the background's depth: it neither fills
/// the hole nor stays as a ghost of the edge.
#[test]
fn a_mixed_pixel_beside_an_edge_is_not_smeared_into_the_hole() {
    let wall = [100, 110, 120];
    let pixel = |x: usize| match x {
        400..460 => ([255, 255, 255], 230),
        399 | 460 => ([180, 180, 180], 40),
        _ => (wall, 40),
    };
    for eye in [2.0, -2.0] {
        let view = seen(&line(pixel), None, 255, eye);
        let near = parallax(255).shift_px(Disparity(230.0), eye);
        let inside = |x: usize| (x as f64) > 398.0 + near && (x as f64) < 461.0 + near;
        // On the side where the wall is uncovered; on the other one the strip covers it.
        assert!((300..600).filter(|x| !inside(*x)).all(|x| view[x] == wall), "eye {eye}");
    }
}

/// Brute force, with nothing in common with the code but the formula: 64 points in each pixel, each
/// asking every pixel of the picture whether it lies there and which is nearest.
#[test]
fn views_show_the_nearest_surface_at_every_covered_pixel() {
    let scene = line(|x| {
        let near = (x / 37) % 3 == 1;
        (bytes(texture(3.0 * x as f64)), if near { 180 + (x / 100) as u8 } else { 60 + (x / 16) as u8 })
    });
    for (factor, eye) in [(64, 1.0), (255, -1.3), (255, 2.0)] {
        let shift = |x: usize| parallax(factor).shift_px(Disparity(f64::from(scene.disparity[x])), eye);
        let edge = |a: usize, b: usize| {
            let same =
                scene.disparity[a].abs_diff(scene.disparity[b]) <= 4 && (shift(a) - shift(b)).abs() < 1.0;
            if same { f64::midpoint(shift(a), shift(b)) } else { shift(a) }
        };
        let last = WIDTH as usize - 1;
        let spans: Vec<(f64, f64)> = (0..=last)
            .map(|x| (x as f64 + edge(x, x.saturating_sub(1)), x as f64 + 1.0 + edge(x, (x + 1).min(last))))
            .collect();
        let view = seen(&scene, None, factor, eye);
        let (mut whole, mut holes) = (0, 0);
        for (x, color) in view.iter().enumerate().skip(60).take(WIDTH as usize - 120) {
            let mut sum = [0.0; 3];
            let mut points = 0;
            for part in 0..64 {
                let at = x as f64 + (f64::from(part) + 0.5) / 64.0;
                let near = (x - 50..x + 51).filter(|i| spans[*i].0 <= at && at < spans[*i].1);
                let Some(nearest) = near.max_by_key(|i| scene.disparity[*i]) else { continue };
                points += 1;
                for (sum, channel) in sum.iter_mut().zip(scene.color[nearest]) {
                    *sum += f64::from(channel);
                }
            }
            if points < 64 {
                holes += 1;
                continue;
            }
            whole += 1;
            // Beside a hole a pixel of the background gives way to the filling.
            let by_hole = (x - 2..x + 3).any(|x| {
                (0..64).any(|part| {
                    let at = x as f64 + (f64::from(part) + 0.5) / 64.0;
                    !(x - 50..x + 51).any(|i| spans[i].0 <= at && at < spans[i].1)
                })
            });
            for channel in 0..3 {
                let off = (f64::from(color[channel]) - sum[channel] / 64.0).abs();
                assert!(by_hole || off < 4.0, "eye {eye}, pixel {x}, channel {channel}: off by {off}");
            }
        }
        assert!(whole > 500 && holes > 20, "{whole} pixels compared, {holes} with holes");
    }
}

#[test]
fn names_grids_and_refusals() {
    for (name, count) in [("stereo", 2), ("anaglyph", 2), ("views-45", 45), ("views-9x1", 9), ("wiggle", 9)] {
        let layout: Layout = name.parse().unwrap();
        assert_eq!((layout.view_count(), layout.to_string().as_str()), (count, name));
    }
    for name in ["views-", "views-1", "views-129", "views-3x", "views-N"] {
        let error = name.parse::<Layout>().unwrap_err().to_string();
        assert!(error.contains("views-COLUMNSxROWS with 2 to 128 views"), "{error}");
    }
    assert_eq!(eyes(2, 1.0), [-0.5, 0.5]);
    assert_eq!(eyes(5, 2.0), [-1.0, -0.5, 0.0, 0.5, 1.0]);
    let quilt: Layout = "views-128".parse().unwrap();
    assert!(matches!(quilt.check_size([8192, 2048]), Err(LayoutError::ViewPixels { count: 128, .. })));
    assert!(matches!(quilt.check_size([2000, 100]), Err(LayoutError::Size { what: "a quilt", .. })));
    assert!(quilt.check_size([960, 540]).is_ok());
    let span = DisplaySettings { view_span: Some(f64::NAN), ..DisplaySettings::default() };
    assert_eq!(span.validate().unwrap_err().path, "display.view_span");
    let wiggle = DisplaySettings { layout: Layout::Wiggle, ..DisplaySettings::default() };
    let picture = Picture::new([2, 1], &[[0; 4]; 2], &[1.0; 2]).unwrap();
    assert_eq!(wiggle.encoder().unwrap().encode(&picture, LIMITS), Err(LayoutError::Animation));
}

fn picture_views(layout: Layout, size_px: [u32; 2]) -> Views {
    let count = (size_px[0] * size_px[1]) as usize;
    let pictures = (0..layout.view_count() as u64).map(|seed| noise(seed + 1, count));
    let rgb = |picture: Vec<[u8; 4]>| picture.into_iter().map(|[r, g, b, _]| [r, g, b]).collect();
    Views::new(size_px, pictures.map(rgb).collect()).unwrap()
}

/// Invariant: Every decoder of a layout returns the input of its encoder, or an error.
#[test]
fn views_come_back_out_of_their_layout_and_their_file_says_what_it_is() {
    for (name, frame_px) in [
        ("stereo", [14, 5]),
        ("views-9", [21, 15]),
        ("views-9x1", [63, 5]),
        ("views-45", [35, 45]),
        ("wiggle", [7, 5]),
    ] {
        let layout: Layout = name.parse().unwrap();
        let views = picture_views(layout, [7, 5]);
        let file = encode_views(layout, &views, &LensPanel::default()).unwrap();
        let report = inspect_png(&file).unwrap();
        assert_eq!((report.layout, report.frame_px, report.problems.len()), (layout, frame_px, 0), "{name}");
        let reported = report.views.unwrap();
        assert_eq!((reported.count as usize, reported.size_px), (layout.view_count(), [7, 5]), "{name}");
        if layout == Layout::Wiggle {
            assert_eq!(decode_wiggle(&file).unwrap(), views);
            continue;
        }
        let frame = layout.frame_of_views(&views, &LensPanel::default()).unwrap();
        let decoded = layout.decode(&frame).unwrap();
        assert_eq!((decoded.size_px, decoded.views.as_ref(), decoded.color.len()), ([7, 5], Some(&views), 0));
        // The leftmost view is at the bottom left.
        let Pixels::Rgb8(samples) = frame.pixels() else { panic!("views are RGB") };
        let bottom = 3 * (frame_px[0] * (frame_px[1] - 5)) as usize;
        assert_eq!(samples[bottom..][..21], views.pictures()[0][..7].as_flattened()[..], "{name}");
        let odd =
            Frame::new([frame_px[0] + 1, 5], Pixels::Rgb8(vec![0; 15 * (frame_px[0] as usize + 1)])).unwrap();
        assert!(matches!(layout.decode(&odd).unwrap_err()[..], [FrameProblem::FrameSize { .. }]), "{name}");
    }
}

/// The pixel of a view that a frame of two views shows at (x, y), from the names of the layouts: view, and its
/// place in a view of the whole size.
fn shown(layout: &str, [w, h]: [usize; 2], [x, y]: [usize; 2]) -> (usize, [usize; 2]) {
    match layout {
        "stereo" => (x / w, [x % w, y]),
        "top-bottom" => (y / h, [x, y % h]),
        "lines" => (y % 2, [x, y]),
        "columns" => (x % 2, [x, y]),
        "checkerboard" => ((x + y) % 2, [x, y]),
        "stereo-half" => (2 * x / w, [2 * x % w, y]),
        _ => (2 * y / h, [x, 2 * y % h]),
    }
}

/// Invariant: Every decoder of a layout returns the input of its encoder, or an error.
#[test]
fn pairs_of_views_lie_where_their_layout_says_at_every_size() {
    let halves = [("stereo-half", [1, 0]), ("top-bottom-half", [0, 1])];
    let whole = ["stereo", "top-bottom", "lines", "columns", "checkerboard"].map(|name| (name, [0, 0]));
    let even = |name: &str| match name {
        "stereo-half" | "columns" | "checkerboard" => [2, 1],
        "top-bottom-half" | "lines" => [1, 2],
        _ => [1, 1],
    };
    for (name, next) in halves.into_iter().chain(whole) {
        let layout: Layout = name.parse().unwrap();
        for size_px in (1..=9).flat_map(|w| (1..=8).map(move |h| [w, h])) {
            let views = picture_views(layout, size_px);
            let made = layout.frame_of_views(&views, &LensPanel::default());
            if (0..2).any(|axis| size_px[axis] % even(name)[axis] != 0) {
                assert!(matches!(made, Err(LayoutError::Odd { .. })), "{name} {size_px:?}");
                continue;
            }
            let frame = made.unwrap();
            let Pixels::Rgb8(samples) = frame.pixels() else { panic!("views are RGB") };
            let size = size_px.map(|side| side as usize);
            let at = |view: usize, [x, y]: [usize; 2]| views.pictures()[view][y * size[0] + x];
            let width = frame.size_px()[0] as usize;
            let mut expected = vec![Vec::new(); 2];
            for (place, pixel) in samples.chunks(3).enumerate() {
                let (view, from) = shown(name, size, [place % width, place / width]);
                let other = at(view, [from[0] + next[0], from[1] + next[1]]);
                let mean =
                    [0, 1, 2].map(|i| (u16::from(at(view, from)[i]) + u16::from(other[i])).div_ceil(2) as u8);
                assert_eq!(pixel, mean, "{name} {size_px:?} {place}");
                expected[view].push(mean);
            }
            let decoded = layout.decode(&frame).unwrap().views.unwrap();
            assert_eq!(decoded.pictures(), expected, "{name} {size_px:?}");
            let report = inspect_png(&encode_views(layout, &views, &LensPanel::default()).unwrap()).unwrap();
            assert_eq!((report.layout, report.views.unwrap().count, report.problems.len()), (layout, 2, 0));
        }
    }
}

/// Nine views of one colour each, under lenses over three pixels: a view to a third of a pixel, one lens after
/// the other, a view farther right with each line of slant 1/3.
#[test]
fn thirds_of_pixels_under_lenses_belong_to_the_views_of_a_closed_form() {
    let layout: Layout = "lenses-9".parse().unwrap();
    let pictures = (1..=9).map(|view| vec![[10 * view; 3]; 12 * 4]).collect();
    let views = Views::new([12, 4], pictures).unwrap();
    let panel = LensPanel { pitch_px: 3.0, slant: 1.0 / 3.0 + 1e-9, center: -1e-9, ..LensPanel::default() };
    let frame = layout.frame_of_views(&views, &panel).unwrap();
    let Pixels::Rgb8(samples) = frame.pixels() else { panic!("views are RGB") };
    for (at, sample) in samples.iter().enumerate() {
        let (third, line) = (at % 36, at / 36);
        assert_eq!(usize::from(*sample), 10 * ((third + line) % 9 + 1), "{at}");
    }
    let refused = layout.decode(&frame).unwrap_err();
    assert_eq!(refused[0].code(), "inseparable");
}

/// Invariant: Every decoder of a layout returns the input of its encoder, or an error.
#[test]
fn an_anaglyph_says_that_it_cannot_be_taken_apart() {
    let views = picture_views(Layout::Anaglyph, [7, 5]);
    let file = encode_views(Layout::Anaglyph, &views, &LensPanel::default()).unwrap();
    let report = inspect_png(&file).unwrap();
    assert_eq!((report.layout, report.views.unwrap().count, report.problems.len()), (Layout::Anaglyph, 2, 0));
    let frame = Layout::Anaglyph.frame_of_views(&views, &LensPanel::default()).unwrap();
    for layout in [Layout::Anaglyph, Layout::Wiggle] {
        let problems = layout.decode(&frame).unwrap_err();
        assert!(problems[0].to_string().contains("cannot be separated"), "{problems:?}");
        assert_eq!(problems[0].code(), "inseparable");
    }
}

#[test]
fn damaged_files_of_views_end_in_an_error_or_a_report() {
    let file =
        encode_views(Layout::Wiggle, &picture_views(Layout::Wiggle, [7, 5]), &LensPanel::default()).unwrap();
    for at in 0..file.len() {
        for flip in [1, 0x80] {
            let mut damaged = file.clone();
            damaged[at] ^= flip;
            let _ = (inspect_png(&damaged).is_ok(), decode_wiggle(&damaged).is_ok()); // neither panics
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Invariant: Foreground is never smeared into a hole, and no view direction is preferred.
    ///
    /// Whatever the picture: mirrored, it has mirrored views, to the byte. Nothing prefers a side.
    #[test]
    fn a_mirrored_picture_has_mirrored_views(seed in any::<u64>(), blocks in 1usize..9, factor in any::<u8>(), eye in -3.0f64..3.0) {
        let colors = noise(seed, WIDTH as usize);
        let depths = noise(seed ^ 0x5555, WIDTH as usize);
        let scene = line(|x| ([colors[x][0], colors[x][1], colors[x][2]], depths[x / blocks * blocks % 950][1]));
        let mirrored = DecodedLayer {
            color: scene.color.iter().rev().copied().collect(),
            disparity: scene.disparity.iter().rev().copied().collect(),
        };
        let mut view = seen(&mirrored, None, factor, -eye);
        view.reverse();
        prop_assert!(view == seen(&scene, None, factor, eye));
        let mut view = seen(&mirrored, Some(&mirrored), factor, -eye);
        view.reverse();
        prop_assert!(view == seen(&scene, Some(&scene), factor, eye));
    }
}
