//! Picks against the display: in every mode, by every depth rule, under every kind of clip and in
//! every layout, a picked place lies on its pixel's ray at the depth from which the frame was
//! packed, and this depth is the f64 twin's.

use relief_base::{Disparity, Point, ScaledDepth, Vector, ViewDepth};
use relief_display::{DecodedDepth, DepthFilter, DisplaySettings, Layout, Picture, ScreenPlane, decode_exr};
use relief_render::{Clip, ClipPlane, ClipSphere, DepthRule, Mode, RenderRequest, RenderedFrame, SceneFile};
use relief_session::{FileFormat, Product, encode};
use relief_volume::{Orbit, Volume};

use super::twin::oblique_head;
use super::{in_mode, renderer};

/// The tolerance of picks, mm.
const TOLERANCE_MM: f64 = 0.05;

const SIZE: [u32; 2] = [64, 48];

fn clips(volume: &Volume) -> [(&'static str, Clip); 4] {
    let center = volume.grid().center();
    let arm = glam::DVec3::splat(60.0);
    let mut boxed = Clip::default();
    boxed.add_box(Point::from_xyz(center.xyz - arm), Point::from_xyz(center.xyz + arm));
    let mut cut = Clip::default();
    cut.planes.push(ClipPlane { point: center, normal: Vector::new(0.3, -1.0, 0.2) });
    let hollow = Clip { sphere: Some(ClipSphere { center, radius_mm: 45.0 }), ..Clip::default() };
    [("unclipped", Clip::default()), ("box", boxed), ("plane", cut), ("sphere", hollow)]
}

/// The request of a mode, as the server makes it from a scene.
fn request(volume: &Volume, mode: Mode, vertical_fov_deg: f64) -> RenderRequest {
    let orbit = Orbit { azimuth_deg: 31.0, elevation_deg: 17.0, zoom: 1.2, vertical_fov_deg };
    let scene = if let Mode::Slice(blend) = mode {
        let blend = blend.name();
        let plane = r#"{"normal": [0.4, -0.8, 0.3], "up": [0.2, 0.1, 1]}"#;
        let slice = format!(r#""slice": {{"plane": {plane}, "slab_mm": 9, "blend": "{blend}"}}"#);
        SceneFile::parse(format!(r#"{{"mode": "slice", {slice}}}"#).as_bytes()).unwrap().with_size(SIZE)
    } else {
        SceneFile::default().with_preset("bone").with_size(SIZE)
    };
    // A slice has a camera of its own.
    let orbit = if matches!(mode, Mode::Slice(_)) { Orbit::default() } else { orbit };
    let request = scene.resolve(volume.grid(), &orbit).unwrap().request;
    let mut request = if matches!(mode, Mode::Slice(_)) { request } else { in_mode(mode, request) };
    request.path_trace.passes = 1;
    request
}

/// Every picked place is projected back: to its own pixel's middle, at the frame's depth. Returns
/// how many there are.
fn expect_picks(frame: &RenderedFrame, what: &str) -> usize {
    let mut hits = 0;
    for (row, column) in (0..frame.size_px[1]).flat_map(|row| (0..frame.size_px[0]).map(move |at| (row, at)))
    {
        let depth = frame.depth_at([column, row]);
        let Some(place) = frame.pick([column, row]) else {
            assert!(!depth.is_hit(), "{what}: no pick at {column}, {row}");
            continue;
        };
        hits += 1;
        let (u, v, depth_mm) = frame.camera.project(place, frame.size_px).unwrap();
        let off = (u - f64::from(column) - 0.5).abs().max((v - f64::from(row) - 0.5).abs());
        assert!(off < 1e-6, "{what}: the pick of {column}, {row} is at {u}, {v}");
        assert!((depth_mm - f64::from(depth.0)).abs() < 1e-3, "{what}: {depth_mm} mm for {} mm", depth.0);
    }
    hits
}

fn expect_twin(volume: &Volume, request: &RenderRequest, frame: &RenderedFrame, what: &str) {
    let twin = relief_render::render_reference(volume, request).unwrap();
    let mut apart = 0;
    for row in 0..SIZE[1] {
        for column in 0..SIZE[0] {
            let near = match (frame.pick([column, row]), twin.pick([column, row])) {
                (Some(a), Some(b)) => a.distance(b) <= TOLERANCE_MM * 1.05,
                (a, b) => a.is_none() && b.is_none(),
            };
            apart += usize::from(!near);
        }
    }
    // Rounding moves a sample across an edge now and then.
    let allowed = (SIZE[0] * SIZE[1]) as usize / 500;
    assert!(apart <= allowed, "{what}: {apart} of {} picks differ from the twin's", SIZE[0] * SIZE[1]);
}

/// Invariant: A picked point lies on the ray of its pixel at the depth of the frame, and where the
/// f64 reference has it.
#[test]
fn picks_are_the_frames_depth_in_every_mode_rule_and_clip_and_the_twins() {
    let Some(mut renderer) = renderer("picks in every mode, rule and clip") else { return };
    let volume = oblique_head();
    let mut pictures = 0;
    for mode in Mode::ALL {
        for (number, name) in DepthRule::names().iter().enumerate() {
            // Modes with a depth of their own know no rules.
            if number > 0 && !matches!(mode, Mode::Composite | Mode::PathTraced) {
                continue;
            }
            for (clip_name, clip) in clips(&volume) {
                let fov = if number % 2 == 0 { 25.0 } else { 0.0 };
                let mut request = request(&volume, mode, fov);
                if matches!(mode, Mode::Composite | Mode::PathTraced) {
                    request.depth = DepthRule::from_name(name).unwrap();
                }
                request.clip = clip;
                let what = format!("{mode:?}, {name}, {clip_name}");
                if request.validate_on(volume.grid()).is_err() {
                    println!("{what}: not a request");
                    continue;
                }
                let frame = renderer.render(&volume, &request).unwrap();
                let hits = expect_picks(&frame, &what);
                assert!(hits > 60 || matches!(mode, Mode::Minip | Mode::Mean), "{what}: {hits} hits");
                expect_twin(&volume, &request, &frame, &what);
                pictures += 1;
            }
        }
    }
    assert!(pictures >= 60, "{pictures}");
}

/// Invariant: A picked point lies on the ray of its pixel at the depth of the frame, and where the
/// f64 reference has it.
#[test]
fn picks_are_what_every_layouts_frame_was_packed_from() {
    let Some(mut renderer) = renderer("picks in every layout") else { return };
    let volume = oblique_head();
    for layout in Layout::ALL {
        let display =
            DisplaySettings { layout, depth_filter: DepthFilter::None, ..DisplaySettings::default() };
        let encoder = display.encoder().unwrap();
        let size = encoder.render_size_px().unwrap_or([160, 90]);
        let orbit = Orbit { azimuth_deg: 31.0, elevation_deg: 17.0, zoom: 1.2, vertical_fov_deg: 25.0 };
        let scene = SceneFile::default().with_preset("bone").with_size(size);
        let mut request = scene.resolve(volume.grid(), &orbit).unwrap().request;
        if matches!(layout, Layout::Declipse | Layout::DeclipseLines) {
            request.depth = DepthRule::TwoLayer { fraction: 0.5 };
        }
        let frame = renderer.render(&volume, &request).unwrap();
        let limits = display.limits(frame.limits).unwrap();
        // The files that carry depth in mm: to the bit.
        let exr = decode_exr(&encode(&frame, &display, Product::Depth, FileFormat::Exr).unwrap()).unwrap();
        assert!(
            exr.depth_mm.iter().zip(&frame.depth_mm).all(|(a, b)| a.to_bits() == b.to_bits()),
            "{layout}"
        );
        if layout.view_count() > 0 || layout == Layout::Anaglyph {
            continue; // views carry no depth
        }
        let mut picture = Picture::new(size, &frame.color_rgba, &frame.depth_mm).unwrap();
        if let Some(back) = &frame.back {
            picture = picture.with_back(&back.color_rgba, &back.depth_mm).unwrap();
        }
        let decoded = layout.decode(&encoder.encode(&picture, limits).unwrap()).unwrap();
        let profile = display.profile().unwrap();
        let mut compared = 0;
        for (at, mm) in frame.depth_mm.iter().enumerate().step_by(7).filter(|(_, mm)| mm.is_finite()) {
            let pixel = [at as u32 % size[0], at as u32 / size[0]];
            let place = frame.pick(pixel).unwrap();
            let (.., picked_mm) = frame.camera.project(place, size).unwrap();
            assert!((picked_mm - f64::from(*mm)).abs() < 1e-3, "{layout}");
            let z = limits.scaled(ViewDepth(picked_mm as f32));
            match &decoded.depth {
                DecodedDepth::None => {}
                DecodedDepth::Disparity(bytes) => {
                    let expected: Disparity = profile.disparity(z);
                    let off = f64::from(bytes[at]) - f64::from(expected.to_byte());
                    assert!(off.abs() <= 1.0, "{layout}: D is {} for {}", bytes[at], expected.to_byte());
                }
                DecodedDepth::Scaled16(values) => {
                    let z = ScaledDepth(1.0 - f64::from(values[at]) / 65535.0);
                    let shown_mm = f64::from(limits.view_depth(z).0);
                    assert!(
                        (shown_mm - picked_mm).abs() < TOLERANCE_MM,
                        "{layout}: {shown_mm} for {picked_mm}"
                    );
                }
            }
            compared += 1;
        }
        assert!(compared > 150, "{layout}: {compared}");
    }
}

/// A point of interest lies on the plane of the screen, and no visible surface is cut off for it.
#[test]
fn a_picked_point_lies_on_the_plane_of_the_screen() {
    let Some(mut renderer) = renderer("a_picked_point_lies_on_the_plane_of_the_screen") else { return };
    let volume = oblique_head();
    let request = request(&volume, Mode::Composite, 20.0);
    let frame = renderer.render(&volume, &request).unwrap();
    let usual = frame.limits_for(&DisplaySettings::default()).unwrap();
    let mut points = 0;
    for pixel in
        (0..SIZE[1]).step_by(5).flat_map(|row| (0..SIZE[0]).step_by(5).map(move |column| [column, row]))
    {
        let Some(point) = frame.pick(pixel) else { continue };
        let screen_plane = Some(ScreenPlane::PointMm(point.xyz.to_array()));
        let display = DisplaySettings { screen_plane, ..DisplaySettings::default() };
        let limits = frame.limits_for(&display).unwrap();
        let depth = f64::from(frame.depth_at(pixel).0);
        if depth <= usual.near_mm || depth >= usual.far_mm {
            continue; // an outlier
        }
        let disparity = display.profile().unwrap().disparity(limits.scaled(frame.depth_at(pixel)));
        assert!((disparity.0 - 127.5).abs() < 0.1, "{pixel:?}: {disparity:?}");
        assert!(limits.near_mm <= usual.near_mm + 1e-9 && limits.far_mm >= usual.far_mm - 1e-9, "{limits:?}");
        points += 1;
    }
    assert!(points > 10, "{points} points");
}
