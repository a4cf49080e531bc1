//! Rule `views`: depth that is made for displays, against true renders and beside the depth of rays.

use std::ops::ControlFlow;

use serde_json::json;

use crate::common;
use rayon::prelude::*;
use relief_base::{DepthLimits, Disparity};
use relief_display::{DecodedLayer, FrameEncoder, Layout, Parallax, Views, psnr_db, synthesize};
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

/// Mean PSNR between synthesised and rendered views, without the middle one, dB.
#[derive(Clone, Copy, Debug)]
struct Likeness {
    /// Views synthesised with the depth of rays.
    rays: f64,
    /// Views synthesised with the depth of rule `views`, in one layer.
    one: f64,
    /// The same with the back layer.
    two: f64,
}

/// A scene rendered with both depth rules, and its nine views rendered one by one.
struct Comparison {
    encoder: FrameEncoder,
    limits: DepthLimits,
    /// By rule `threshold`.
    rays: RenderedFrame,
    /// By rule `views`.
    views: RenderedFrame,
    /// The rendered views, from left to right.
    truth: Vec<Vec<[u8; 3]>>,
}

impl Comparison {
    fn of(renderer: &mut Renderer, volume: &Volume, scene: &Scene) -> Self {
        let encoder = scene.display.encoder().unwrap();
        let [rays, views] = RULES.map(|rule| renderer.render(volume, &by(rule, scene)).unwrap());
        let limits = rays.limits_for(&scene.display).unwrap();
        let setup = true_views(&scene.display, &rays.camera, rays.size_px, limits).unwrap();
        let cameras = eye_cameras(&setup, &rays.camera, &encoder.eyes()).unwrap();
        let truth = cameras
            .into_iter()
            .map(|camera| {
                let seen = renderer.render(volume, &scene.request.seen_by(camera)).unwrap();
                seen.color_rgba.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect()
            })
            .collect();
        Self { encoder, limits, rays, views, truth }
    }

    fn likeness(&self) -> Likeness {
        assert!(self.views.back.is_some());
        let one = RenderedFrame { back: None, ..self.views.clone() };
        let [rays, one, two] = [&self.rays, &one, &self.views]
            .map(|frame| self.mean_db(&self.encoder.views(&frame.picture().unwrap(), self.limits).unwrap()));
        Likeness { rays, one, two }
    }

    fn mean_db(&self, views: &Views) -> f64 {
        let pairs = self.truth.iter().zip(views.pictures()).enumerate().filter(|(view, _)| *view != 4);
        pairs.map(|(_, (truth, view))| psnr_db(truth, view)).sum::<f64>() / 8.0
    }

    /// Mean PSNR of views synthesised with the disparities that [`Sweep`] finds, in one layer, dB.
    fn best_db(&self) -> f64 {
        let (size_px, eyes) = (self.rays.size_px, self.encoder.eyes());
        let parallax = self.encoder.parallax(size_px[0]);
        let sweep = Sweep::over(&self.rays, &self.truth, &eyes, &parallax);
        let found = [3, 5, 7].map(|side| {
            let front = DecodedLayer { color: self.truth[4].clone(), disparity: sweep.best(side) };
            self.mean_db(&synthesize(size_px, &front, None, &parallax, &eyes).unwrap())
        });
        found.into_iter().fold(f64::NEG_INFINITY, f64::max)
    }
}

/// An exhaustive search for the disparity of each pixel. It is the oracle of rule `views`: it compares the
/// picture with four rendered views of full size, the rule with two views that have a quarter of the pixels.
struct Sweep {
    size_px: [usize; 2],
    /// For each of [`Sweep::LEVELS`] disparities, the difference of each pixel from the four views.
    costs: Vec<Vec<f32>>,
    is_transparent: Vec<bool>,
}

impl Sweep {
    const LEVELS: usize = 52;

    fn disparity(level: usize) -> u8 {
        (255 * level / (Self::LEVELS - 1)) as u8
    }

    /// Compares a picture with four of its nine rendered views.
    fn over(frame: &RenderedFrame, truth: &[Vec<[u8; 3]>], eyes: &[f64], parallax: &Parallax) -> Self {
        let [width, height] = frame.size_px.map(|side| side as usize);
        let difference = |level: usize, x: usize, y: usize, view: usize| {
            let place =
                x as f64 + parallax.shift_px(Disparity(f64::from(Self::disparity(level))), eyes[view]);
            let (left, share) = (place.floor(), place.fract().rem_euclid(1.0) as f32);
            let at =
                |x: f64| truth[view][y * width + x.clamp(0.0, width as f64 - 1.0) as usize].map(f32::from);
            let (near, next, own) = (at(left), at(left + 1.0), truth[4][y * width + x].map(f32::from));
            let squares = (0..3).map(|c| (near[c] * (1.0 - share) + next[c] * share - own[c]).powi(2));
            (squares.sum::<f32>() / 3.0).min(1500.0)
        };
        let cost = |level: usize, at: usize| {
            [0, 2, 6, 8].map(|view| difference(level, at % width, at / width, view)).iter().sum()
        };
        let levels = (0..Self::LEVELS).into_par_iter();
        let costs = levels.map(|level| (0..width * height).map(|at| cost(level, at)).collect());
        let is_transparent = frame.color_rgba.iter().map(|color| color[3] < 13).collect();
        Self { size_px: [width, height], costs: costs.collect(), is_transparent }
    }

    /// For each pixel, the disparity with the least difference, summed over a square window with sides
    /// of this many pixels.
    fn best(&self, side: usize) -> Vec<u8> {
        let [width, height] = self.size_px;
        let reach = side / 2;
        let sums = |costs: &Vec<f32>| {
            let along: Vec<f32> = (0..costs.len())
                .map(|at| {
                    let x = at % width;
                    costs[at - x..][x.saturating_sub(reach)..(x + reach + 1).min(width)].iter().sum()
                })
                .collect();
            let rows = |y: usize| y.saturating_sub(reach)..(y + reach + 1).min(height);
            (0..costs.len())
                .map(|at| rows(at / width).map(|row| along[row * width + at % width]).sum())
                .collect::<Vec<f32>>()
        };
        let sums: Vec<Vec<f32>> = self.costs.par_iter().map(sums).collect();
        (0..width * height)
            .map(|at| {
                let least = (0..Self::LEVELS).min_by(|a, b| sums[*a][at].total_cmp(&sums[*b][at]));
                if self.is_transparent[at] { 0 } else { Self::disparity(least.unwrap()) }
            })
            .collect()
    }
}

const RULES: [DepthRule; 2] = [DepthRule::Threshold { fraction: 0.5 }, DepthRule::Views];

/// Asserts that one layer gains `gain_db` over the depth of rays, and that the back layer loses nothing.
fn check(what: &str, Likeness { rays, one, two }: Likeness, gain_db: f64) {
    println!("{what}: {rays:.2} dB by rays, {one:.2} dB for views, {two:.2} dB with two layers");
    assert!(one > rays + gain_db, "{what}: {rays} dB by rays, {one} dB for views");
    assert!(two > one - 0.02, "{what}: {one} dB with one layer, {two} dB with two");
}

/// Invariant: The depth of rule `views` is at most 0.9 dB worse than that of an exhaustive search.
///
/// The search tries every fifth disparity, with windows of three sizes.
#[test]
fn a_search_by_true_views_finds_little_better() {
    let mut renderer = Renderer::on_processor();
    let volume = common::volume(PhantomKind::Head, 96);
    let mut check = |what: &str, volume: &Volume, preset: &str| {
        let comparison = Comparison::of(&mut renderer, volume, &scene(volume, preset, [480, 270]));
        let (one, best) = (comparison.likeness().one, comparison.best_db());
        println!("{what}, {preset}: {one:.2} dB for views, {best:.2} dB by search");
        assert!(one > best - 0.9, "{what}, {preset}: {one} dB for views, {best} dB by search");
    };
    check("head", &volume, "skin-and-bone");
    check("head", &volume, "bone");
    let Some(volume) = real("a search by true views", "lidc-idri-0314") else { return };
    check("lidc-idri-0314", &volume, "skin-and-bone");
}

/// The volume of a real series; `None`, and a line that says so, if the series is missing.
fn real(what: &str, name: &str) -> Option<Volume> {
    let folder = common::unpacked(what, name, &[])?;
    let found = relief_dicom::discover(&folder, relief_dicom::Strictness::Lenient, &|_| ()).unwrap();
    let loaded = relief_dicom::load(found.select(None).unwrap(), relief_dicom::Strictness::Lenient, &|_| ());
    Some(loaded.unwrap().volume)
}

/// Invariant: Views synthesised with the depth of rule `views` are nearer to rendered ones than views with
/// the depth of rays, and on opaque surfaces at most 0.1 dB farther. The back layer never makes them worse.
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
        check(
            &format!("{kind:?}, {preset}"),
            Comparison::of(&mut renderer, &volume, &scene).likeness(),
            gain_db,
        );
    }
}

/// Invariant: Views synthesised with the depth of rule `views` are nearer to rendered ones than views with
/// the depth of rays, and on opaque surfaces at most 0.1 dB farther. The back layer never makes them worse.
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
        let Some(volume) = real("depth for views of real series", name) else { return };
        let scene = scene(&volume, preset, [960, 540]);
        check(
            &format!("{name}, {preset}"),
            Comparison::of(&mut renderer, &volume, &scene).likeness(),
            gain_db,
        );
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
/// Highlights move with the eye, so a comparison of colours alone finds wrong disparities there.
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
