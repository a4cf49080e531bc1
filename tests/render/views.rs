//! Views beside each other: shifted lenses against point projection and the f64 twin, and the views
//! that a display would make of one picture against true renders.

use serde_json::json;

use super::renderer;
use super::twin::{compare, oblique_head, request};
use crate::common;
use relief_base::{DepthLimits, Point};
use relief_display::{DisplaySettings, Layout, Picture, psnr_db};
use relief_render::{
    DepthRule, RenderRequest, RenderedFrame, SceneFile, depth_limits, eye_cameras, true_views,
    with_span_of_cone,
};
use relief_volume::{Orbit, PhantomKind, Volume};

/// Invariant: Synthesised views agree with true renders, which agree with point projection.
#[test]
fn gpu_and_twin_agree_through_shifted_lenses() {
    let volume = oblique_head();
    let request = request(&volume, "bone", 25.0);
    for (right_mm, converging_mm, up) in [(60.0, 700.0, 0.0), (-150.0, 500.0, 0.05)] {
        let beside = request.camera.seen_from_beside(right_mm, converging_mm).unwrap();
        let [x, _] = beside.lens_shift();
        let camera = beside.with_lens_shift([x, up]).unwrap();
        compare(&volume, &RenderRequest { camera, ..request.clone() }, &format!("lens shifted by {x}, {up}"));
    }
}

/// Invariant: Synthesised views agree with true renders, which agree with point projection.
///
/// Balls of the sphere phantom's series and an overlay's: where `project` says, with the depth that
/// a pick finds again.
#[test]
fn shifted_views_agree_with_the_projection_and_with_picks() {
    let Some(mut renderer) = renderer("what_is_seen_from_beside") else { return };
    let volume = common::volume(PhantomKind::Sphere, 64);
    let overlays = json!({ "items": [
        { "landmark": { "at_mm": [40, -150, 30], "radius_mm": 6, "rgb": [1, 0, 0] } },
        { "landmark": { "at_mm": [-60, 90, 70], "radius_mm": 6, "rgb": [0, 1, 0] } },
    ] });
    let json = json!({ "transfer": "bone", "size_px": [240, 160], "overlays": overlays }).to_string();
    let scene = SceneFile::parse(json.as_bytes()).unwrap();
    let mut request = scene.resolve(volume.grid(), &Orbit::default()).unwrap().request;
    for right_mm in [0.0, 80.0, -45.0] {
        request.camera = request.camera.seen_from_beside(right_mm, request.camera.distance_mm()).unwrap();
        let frame = renderer.render(&volume, &request).unwrap();
        for (channel, at) in [(0, Point::new(40.0, -150.0, 30.0)), (1, Point::new(-60.0, 90.0, 70.0))] {
            let (u, v, depth) = request.camera.project(at, request.size_px).unwrap();
            let seen: Vec<(f64, f64)> = (0..240 * 160u32)
                .filter(|i| {
                    let color = frame.color_rgba[*i as usize];
                    color[channel] > 80 && color[1 - channel] < 40 && color[2] < 40
                })
                .map(|i| (f64::from(i % 240) + 0.5, f64::from(i / 240) + 0.5))
                .collect();
            let mean = |pick: fn(&(f64, f64)) -> f64| seen.iter().map(pick).sum::<f64>() / seen.len() as f64;
            let (found_u, found_v) = (mean(|at| at.0), mean(|at| at.1));
            assert!(
                (found_u - u).abs() < 0.5 && (found_v - v).abs() < 0.5,
                "{found_u} {found_v} for {u} {v}"
            );
            let picked = frame.pick([u as u32, v as u32]).unwrap();
            let (pu, pv, pd) = request.camera.project(picked, request.size_px).unwrap();
            assert!((pu - u).abs() < 1.0 && (pv - v).abs() < 1.0 && (pd - (depth - 6.0)).abs() < 1.0);
        }
    }
}

/// Synthesised views, and the renders by a camera for each of their eyes.
fn both(
    volume: &Volume,
    display: &DisplaySettings,
    request: &RenderRequest,
) -> Option<[Vec<Vec<[u8; 3]>>; 2]> {
    let mut renderer = renderer("views against true renders")?;
    let encoder = display.encoder().unwrap();
    let frame: RenderedFrame = renderer.render(volume, request).unwrap();
    let limits = display.limits(depth_limits(&request.camera, volume.grid())).unwrap();
    let mut picture = Picture::new(frame.size_px, &frame.color_rgba, &frame.depth_mm).unwrap();
    if let Some(back) = &frame.back {
        picture = picture.with_back(&back.color_rgba, &back.depth_mm).unwrap();
    }
    let synthesised = encoder.views(&picture, limits).unwrap().pictures().to_vec();
    let [half_width, _] = request.camera.half_extent(request.size_px);
    let width = request.size_px[0];
    let cameras = encoder.parallax(width).true_views(limits, half_width, width).unwrap();
    let rendered = encoder.eyes().into_iter().map(|eye| {
        let camera =
            request.camera.seen_from_beside(eye * cameras.baseline_mm, cameras.converging_mm).unwrap();
        let seen = renderer.render(volume, &RenderRequest { camera, ..request.clone() }).unwrap();
        seen.color_rgba.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect()
    });
    let rendered = rendered.collect();
    Some([synthesised, rendered])
}

fn head() -> (Volume, RenderRequest) {
    let volume = common::volume(PhantomKind::Head, 96);
    let orbit = Orbit { azimuth_deg: 30.0, zoom: 1.8, ..Orbit::default() };
    let scene = SceneFile::default().with_preset("bone").with_size([480, 270]);
    let request = scene.resolve(volume.grid(), &orbit).unwrap().request;
    (volume, request)
}

/// Invariant: Synthesised views agree with true renders, which agree with point projection.
#[test]
fn synthesised_views_of_a_head_come_close_to_true_renders() {
    let (volume, request) = head();
    let layout: Layout = "views-5".parse().unwrap();
    let display = DisplaySettings { layout, factor: 128, ..DisplaySettings::default() };
    let Some([synthesised, rendered]) = both(&volume, &display, &request) else { return };
    let psnr = |a: &[Vec<[u8; 3]>], b: &[Vec<[u8; 3]>]| -> Vec<f64> {
        a.iter().zip(b).map(|(a, b)| psnr_db(a, b)).collect()
    };
    let found = psnr(&synthesised, &rendered);
    let still = psnr(&vec![synthesised[2].clone(); 5], &rendered);
    let mut reversed = synthesised;
    reversed.reverse();
    let wrong = psnr(&reversed, &rendered);
    println!("synthesised {found:.2?}, the picture as it is {still:.2?}, the wrong way round {wrong:.2?}");
    assert_eq!(found[2], f64::INFINITY, "the middle view is the picture");
    for view in [0, 1, 3, 4] {
        assert!(found[view] > FLOOR_DB, "view {view}: {} dB", found[view]);
        assert!(found[view] > still[view] + 4.0 && still[view] > wrong[view] + 3.0, "view {view}");
    }
}

/// At twice the usual effect the outermost views have 36.6 and 36.7 dB, the inner ones 38.8 and
/// 38.4.
const FLOOR_DB: f64 = 35.5;

/// Invariant: The cameras of the outermost views have the angle of the view cone between them.
///
/// Measured between the lines from the middle of the screen to the outermost cameras.
#[test]
fn the_cameras_of_a_cone_are_as_far_apart_as_it_says() {
    let (_, request) = head();
    let limits = DepthLimits { near_mm: 300.0, far_mm: 700.0 };
    for (cone_deg, factor) in [(35.0, 64), (12.5, 64), (35.0, 140)] {
        let layout: Layout = "views-5".parse().unwrap();
        let display =
            DisplaySettings { layout, factor, view_cone_deg: Some(cone_deg), ..DisplaySettings::default() };
        let display = with_span_of_cone(&display, &request.camera, request.size_px, limits).unwrap();
        let setup = true_views(&display, &request.camera, request.size_px, limits).unwrap();
        let eyes = display.encoder().unwrap().eyes();
        let cameras = eye_cameras(&setup, &request.camera, &eyes).unwrap();
        let forwards = (request.camera.look_at().xyz - request.camera.eye().xyz).normalize();
        let middle = request.camera.eye().xyz + forwards * setup.converging_mm;
        let [first, last] = [&cameras[0], &cameras[4]].map(|camera| (camera.eye().xyz - middle).normalize());
        let found_deg = first.dot(last).acos().to_degrees();
        assert!((found_deg - cone_deg).abs() < 1e-6, "{found_deg} for {cone_deg}");
    }
}

/// A known second layer fills the holes: nearer to the truth than their neighbours.
#[test]
fn a_second_layer_fills_holes_nearer_to_the_truth() {
    let (volume, request) = head();
    let display = DisplaySettings {
        layout: Layout::Stereo,
        factor: 255,
        view_span: Some(2.0),
        ..DisplaySettings::default()
    };
    let two_layers = RenderRequest { depth: DepthRule::TwoLayer { fraction: 0.5 }, ..request };
    let Some([with_back, rendered]) = both(&volume, &display, &two_layers) else { return };
    let encoder = display.encoder().unwrap();
    let Some(mut renderer) = renderer("a_second_layer_fills_holes") else { return };
    let frame = renderer.render(&volume, &two_layers).unwrap();
    let front = Picture::new(frame.size_px, &frame.color_rgba, &frame.depth_mm).unwrap();
    let without = encoder.views(&front, frame.limits).unwrap().pictures().to_vec();
    for view in [0, 1] {
        let [with, without] = [&with_back[view], &without[view]].map(|seen| psnr_db(seen, &rendered[view]));
        println!("view {view}: {with:.2} dB with what lies behind, {without:.2} dB without");
        assert!(with > without, "view {view}: {with} dB with what lies behind, {without} dB without");
    }
}
