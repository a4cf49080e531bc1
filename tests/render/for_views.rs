//! Rule `views`: depth that is made for displays, against true renders and beside the depth of rays.

use std::ops::ControlFlow;

use serde_json::json;

use crate::common;
use relief_display::{Layout, psnr_db};
use relief_render::{
    DepthRule, RenderRequest, RenderedFrame, Renderer, Scene, SceneFile, Subject, eye_cameras, true_views,
};
use relief_volume::{Orbit, PhantomKind, Volume};

use super::renderer;

/// A scene from an oblique direction, for nine views over four eye separations.
fn scene(volume: &Volume, preset: &str, size_px: [u32; 2]) -> Scene {
    let json =
        json!({ "transfer": preset, "size_px": size_px, "display": { "layout": "views-9", "view_span": 4 } });
    let scene = SceneFile::parse(json.to_string().as_bytes()).unwrap();
    let orbit = Orbit { azimuth_deg: 25.0, elevation_deg: 10.0, ..Orbit::default() };
    scene.resolve_for(&Subject::of(volume, None), &orbit).unwrap()
}

fn by(rule: DepthRule, scene: &Scene) -> RenderRequest {
    RenderRequest { depth: rule, ..scene.request.clone() }
}

/// Mean PSNR of the outer views to true ones, dB: made of a picture by the depth of rays, of one by rule
/// `views` without its back layer, and with it.
fn likeness(renderer: &mut Renderer, volume: &Volume, scene: &Scene) -> [f64; 3] {
    let encoder = scene.display.encoder().unwrap();
    let [rays, two] = RULES.map(|rule| renderer.render(volume, &by(rule, scene)).unwrap());
    assert!(two.back.is_some());
    let frames = [rays, RenderedFrame { back: None, ..two.clone() }, two];
    let limits = frames[0].limits_for(&scene.display).unwrap();
    let setup = true_views(&scene.display, &frames[0].camera, frames[0].size_px, limits).unwrap();
    let cameras = eye_cameras(&setup, &frames[0].camera, &encoder.eyes()).unwrap();
    let truth: Vec<Vec<[u8; 3]>> = cameras
        .into_iter()
        .map(|camera| {
            let seen = renderer.render(volume, &scene.request.seen_by(camera)).unwrap();
            seen.color_rgba.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect()
        })
        .collect();
    frames.map(|frame| {
        let views = encoder.views(&frame.picture().unwrap(), limits).unwrap();
        let pairs = truth.iter().zip(views.pictures()).enumerate().filter(|(view, _)| *view != 4);
        pairs.map(|(_, (truth, view))| psnr_db(truth, view)).sum::<f64>() / 8.0
    })
}

const RULES: [DepthRule; 2] = [DepthRule::Threshold { fraction: 0.5 }, DepthRule::Views];

/// One layer gains this much over the depth of rays, and two layers lose nothing to one.
fn check(what: &str, [rays, one, two]: [f64; 3], gain_db: f64) {
    println!("{what}: {rays:.2} dB by rays, {one:.2} dB for views, {two:.2} dB with two layers");
    assert!(one > rays + gain_db, "{what}: {rays} dB by rays, {one} dB for views");
    assert!(two > one - 0.02, "{what}: {one} dB with one layer, {two} dB with two");
}

/// Invariant: Views made of depth by rule `views` are nearer to true ones than those by the depth of
/// rays, and on opaque surfaces no farther; its back layer never makes them worse.
#[test]
fn views_of_phantoms_come_nearer_to_true_ones() {
    let mut renderer = Renderer::on_processor();
    for (kind, preset, gain_db) in [
        (PhantomKind::Head, "skin-and-bone", 1.5),
        (PhantomKind::Head, "bone", 0.1),
        (PhantomKind::Sphere, "skin", -0.1),
    ] {
        let volume = common::volume(kind, 96);
        let scene = scene(&volume, preset, [480, 270]);
        check(&format!("{kind:?}, {preset}"), likeness(&mut renderer, &volume, &scene), gain_db);
    }
}

/// Invariant: Views made of depth by rule `views` are nearer to true ones than those by the depth of
/// rays, and on opaque surfaces no farther; its back layer never makes them worse.
///
/// Real series, where tissue is translucent and noisy.
#[test]
fn views_of_real_series_come_nearer_to_true_ones() {
    let mut renderer = Renderer::on_processor();
    for (name, preset, gain_db) in [
        ("lidc-idri-0314", "skin-and-bone", 3.0),
        ("lidc-idri-0314", "bone", 1.5),
        ("crlm-ct-1004", "kidneys", 2.0),
        ("sts-001-thigh", "skin", -0.1),
    ] {
        let Some(folder) = common::unpacked("depth for views of real series", name, &[]) else { return };
        let found = relief_dicom::discover(&folder, relief_dicom::Strictness::Lenient, &|_| ()).unwrap();
        let loaded =
            relief_dicom::load(found.select(None).unwrap(), relief_dicom::Strictness::Lenient, &|_| ());
        let volume = loaded.unwrap().volume;
        let scene = scene(&volume, preset, [960, 540]);
        check(&format!("{name}, {preset}"), likeness(&mut renderer, &volume, &scene), gain_db);
    }
}

fn specks(frame: &RenderedFrame, scene: &Scene) -> usize {
    let encoder = scene.display.encoder().unwrap();
    let limits = frame.limits_for(&scene.display).unwrap();
    let disparity = encoder.disparity(&frame.picture().unwrap(), limits);
    let [width, height] = frame.size_px.map(|side| side as usize);
    let is_speck = |x: usize, y: usize| {
        let around = (y - 1..y + 2).flat_map(|row| (x - 1..x + 2).map(move |column| row * width + column));
        let own = disparity[y * width + x];
        let is_faint = u32::from(frame.color_rgba[y * width + x][3]) * 20 < 255;
        is_faint && around.filter(|at| *at != y * width + x).all(|at| disparity[at].abs_diff(own) > 2)
    };
    (1..height - 1)
        .flat_map(|y| (1..width - 1).map(move |x| (x, y)))
        .filter(|(x, y)| is_speck(*x, *y))
        .count()
}

/// Invariant: Rule `views` changes the depth for displays alone: colours, picks and depth in mm are
/// those of the rays, and no almost transparent pixel stands apart from all its neighbours.
#[test]
fn colours_and_picks_stay_and_there_are_no_specks() {
    let volume = common::volume(PhantomKind::Head, 96);
    let scene = scene(&volume, "skin-and-bone", [321, 203]);
    let mut processor = Renderer::on_processor();
    let mut gpu = renderer("colours_and_picks_stay");
    for renderer in std::iter::once(&mut processor).chain(gpu.as_deref_mut()) {
        let [rays, views] = RULES.map(|rule| renderer.render(&volume, &by(rule, &scene)).unwrap());
        assert!(rays.color_rgba == views.color_rgba && rays.depth_mm == views.depth_mm);
        assert_eq!(rays.pick([160, 100]), views.pick([160, 100]));
        assert!(rays.display_mm.is_none());
        let shown = views.display_mm.as_ref().unwrap();
        let changed = shown.iter().zip(&views.depth_mm).filter(|(a, b)| (*a - *b).abs() > 1.0).count();
        assert!(changed > 1000, "{changed} depths for displays differ from those of rays");
        assert_eq!(specks(&views, &scene), 0);
        let again = renderer.render(&volume, &by(DepthRule::Views, &scene)).unwrap();
        assert!(again.display_mm == views.display_mm, "equal requests have equal depth");
    }
}

/// Invariant: On smooth opaque surfaces rule `views` stays near the disparity of the rays.
///
/// Their highlights move with the eye, so colours alone would dig holes into them.
#[test]
fn opaque_surfaces_have_no_holes() {
    let volume = common::volume(PhantomKind::Head, 128);
    let mut renderer = Renderer::on_processor();
    for preset in ["bone", "skin"] {
        let scene = scene(&volume, preset, [960, 540]);
        let encoder = scene.display.encoder().unwrap();
        let frame = renderer.render(&volume, &scene.request).unwrap();
        let limits = frame.limits_for(&scene.display).unwrap();
        let rays = encoder.disparity_of(&frame.depth_mm, limits);
        let views = encoder.disparity_of(frame.display_mm.as_ref().unwrap(), limits);
        let is_smooth = |at: &usize| {
            let (x, y) = (at % 960, at / 960);
            let inside = (2..958).contains(&x) && (2..538).contains(&y) && frame.color_rgba[*at][3] >= 250;
            let around = || (y - 2..y + 3).flat_map(|row| &rays[row * 960 + x - 2..][..5]);
            inside && around().max().unwrap() - around().min().unwrap() <= 6
        };
        let apart: Vec<u8> =
            (0..rays.len()).filter(is_smooth).map(|at| rays[at].abs_diff(views[at])).collect();
        let share = |most: u8| apart.iter().filter(|d| **d > most).count() as f64 / apart.len() as f64;
        println!(
            "{preset}: {} pixels, {:.4} by more than 16, {:.4} by more than 40",
            apart.len(),
            share(16),
            share(40)
        );
        assert!(apart.len() > 20_000, "{preset}: {} pixels", apart.len());
        assert!(share(16) < 0.04 && share(40) < 0.006, "{preset}: {} and {}", share(16), share(40));
    }
}

/// Moving pictures cast no views beside them: their depth is that of the rays without outliers, and
/// almost transparent pixels are far.
#[test]
fn moving_pictures_have_the_depth_of_rays_without_specks() {
    let volume = common::volume(PhantomKind::Head, 96);
    let mut renderer = Renderer::on_processor();
    let scene = scene(&volume, "skin-and-bone", [320, 200]);
    let request = scene.request.clone().without_views_beside();
    let bands = |renderer: &mut Renderer, request: &RenderRequest| {
        let mut bands = 0;
        let mut counts = |progress: relief_render::Progress| {
            bands = progress.bands;
            ControlFlow::Continue(())
        };
        (renderer.render_watched(&volume, request, &mut counts).unwrap(), bands)
    };
    renderer.set_band_pixels(1);
    let (moving, few) = bands(&mut renderer, &request);
    let (_, many) = bands(&mut renderer, &scene.request);
    assert!(few < many, "{few} bands without views, {many} with them");
    assert_eq!(specks(&moving, &scene), 0);
    let shown = moving.display_mm.as_ref().unwrap();
    for (at, [.., coverage]) in moving.color_rgba.iter().enumerate().filter(|(_, color)| color[3] == 0) {
        assert!(shown[at] >= moving.depth_mm[at] || !shown[at].is_finite(), "{coverage} at {at}");
    }
    let reduced = RenderRequest { reduced_px: Some([160, 100]), ..scene.request.clone() };
    let small = renderer.render(&volume, &reduced).unwrap();
    assert_eq!(small.display_mm.unwrap().len(), 320 * 200);
}

/// Displays get the depth of an overlay where it covers the picture.
#[test]
fn displays_get_the_depth_of_overlays() {
    let volume = common::volume(PhantomKind::Sphere, 64);
    let ball = json!({ "landmark": { "at_mm": [0, -130, 0], "radius_mm": 10 } });
    let json = json!({ "transfer": "skin", "size_px": [320, 200], "overlays": { "items": [ball] } });
    let scene = SceneFile::parse(json.to_string().as_bytes()).unwrap();
    let scene = scene.resolve(volume.grid(), &Orbit::default()).unwrap();
    let frame = Renderer::on_processor().render(&volume, &scene.request).unwrap();
    let (u, v, depth) = frame.camera.project(relief_base::Point::new(0.0, -140.0, 0.0), [320, 200]).unwrap();
    let shown = frame.display_mm.as_ref().unwrap()[v as usize * 320 + u as usize];
    assert!((f64::from(shown) - depth).abs() < 0.5, "{shown} mm for {depth}");
    assert_eq!(scene.display.layout, Layout::default());
}
