//! Depth rules: where they put the depth of layers of known opacity, on the GPU and in the f64
//! twin; that the two agree on a head; and that skipping changes no byte.

use crate::common;
use relief_base::{Point, Vector};
use relief_render::{
    DepthRule, EmptySpaceSkipping, RenderRequest, RenderedFrame, SceneFile, Shading, render_reference,
};
use relief_volume::{Camera, ControlPoint, Grid, Orbit, PhantomKind, Projection, TransferFunction, Volume};

use super::renderer;
use super::twin::{compare, oblique_head, request as head_request};

/// Layers one behind the other: thickness in mm and opacity per mm. Voxels of 1 mm; a HU is a
/// thousandth of opacity.
type Layers = [(usize, f64)];

/// View depth of the face of the first layer, mm.
const FACE_MM: f64 = 100.0;

/// A block of layers across y, 8 voxels wide, whose front face is y = 0.
fn layered(layers: &Layers) -> Volume {
    let along_y: Vec<i16> =
        layers.iter().flat_map(|&(mm, opacity)| std::iter::repeat_n((opacity * 1000.0) as i16, mm)).collect();
    let grid = Grid::axis_aligned([8, along_y.len(), 8], [1.0; 3], [-3.5, 0.5, -3.5]).unwrap();
    let voxels = (0..8).flat_map(|_| along_y.iter().flat_map(|&hu| [hu; 8])).collect();
    Volume::new(grid, voxels).unwrap()
}

/// Opacity by value; values below a quarter are red, above green.
fn transfer() -> TransferFunction {
    let point = |opacity: f64, rgb: [f64; 3]| ControlPoint {
        hu: opacity * 1000.0,
        rgba: [rgb[0], rgb[1], rgb[2], opacity],
    };
    let (red, green) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
    TransferFunction::new(
        vec![point(0.0, red), point(0.25, red), point(0.26, green), point(0.99, green)],
        1.0,
    )
    .unwrap()
}

fn layers_request(volume: &Volume, depth: DepthRule) -> RenderRequest {
    let camera = Camera::new(
        Point::new(0.0, -FACE_MM, 0.0),
        Point::new(0.0, 20.0, 0.0),
        Vector::new(0.0, 0.0, 1.0),
        Projection::Orthographic { height_mm: 4.0 },
    );
    let scene = SceneFile::default().with_size([3, 3]).resolve(volume.grid(), &Orbit::default()).unwrap();
    RenderRequest {
        camera: camera.unwrap(),
        transfer: transfer(),
        shading: Shading::NONE,
        sample_distance_mm: 0.25,
        depth,
        ..scene.request
    }
}

/// The picture of the GPU, where there is one, and that of the twin.
fn pictures(layers: &Layers, depth: DepthRule) -> Vec<RenderedFrame> {
    let volume = layered(layers);
    let request = layers_request(&volume, depth);
    let gpu = renderer("depth rules").map(|mut renderer| renderer.render(&volume, &request).unwrap());
    gpu.into_iter().chain([render_reference(&volume, &request).unwrap()]).collect()
}

fn expect_depth(layers: &Layers, depth: DepthRule, behind_face_mm: f64, tolerance_mm: f64) {
    for frame in pictures(layers, depth) {
        for &mm in &frame.depth_mm {
            let found = f64::from(mm) - FACE_MM;
            let off = (found - behind_face_mm).abs();
            assert!(off < tolerance_mm, "{depth:?} on {layers:?}: {found} mm for {behind_face_mm} mm");
        }
    }
}

/// Half a voxel: values reach those of a layer at the middle of its first voxel.
const RAMP_MM: f64 = 0.5;

/// Invariant: A depth rule changes no colour and puts the depth where its definition says.
///
/// A weak layer, a gap, a strong layer: which rules see which.
#[test]
fn rules_choose_the_layer_that_their_definition_says() {
    // The first takes 65 % of the light and the second the rest: its steepest rise is twice that of
    // the first.
    let thick = [(5, 0.0), (10, 0.1), (10, 0.0), (10, 0.6), (5, 0.0)];
    let (first, second) = (5.0, 25.0);
    expect_depth(&thick, DepthRule::FirstHit, first - RAMP_MM, 0.1);
    expect_depth(&thick, DepthRule::MaxOpacity, second + RAMP_MM, 0.1);
    expect_depth(&thick, DepthRule::MostContributing, second + RAMP_MM, 0.15);
    expect_depth(&thick, DepthRule::Wysiwyp, first, 0.2);
    // The first takes 34 %: now the largest rise is that of the second.
    let thin = [(5, 0.0), (4, 0.1), (10, 0.0), (10, 0.6), (5, 0.0)];
    expect_depth(&thin, DepthRule::Wysiwyp, 19.0, 0.3);
    // The first takes 96 %, so that the steepest rise is its own; its opacity is still the lesser.
    let thicker = [(5, 0.0), (30, 0.1), (10, 0.0), (10, 0.6), (5, 0.0)];
    expect_depth(&thicker, DepthRule::MostContributing, first + RAMP_MM, 0.15);
    expect_depth(&thicker, DepthRule::MaxOpacity, 45.0 + RAMP_MM, 0.1);
}

/// Layers that touch: a weak skin on something strong.
#[test]
fn rules_see_an_edge_inside_of_what_is_visible() {
    let nested = [(5, 0.0), (6, 0.02), (10, 0.7), (5, 0.0)];
    expect_depth(&nested, DepthRule::FirstHit, 5.0 - RAMP_MM, 0.1);
    for rule in [DepthRule::MaxOpacity, DepthRule::MostContributing, DepthRule::Wysiwyp] {
        expect_depth(&nested, rule, 11.0, RAMP_MM + 0.1);
    }
}

/// Mean depth of light that is absorbed exponentially over a slab, mm behind its face.
fn mean_depth(opacity_per_mm: f64, thickness_mm: f64) -> f64 {
    let per_mm = -(1.0 - opacity_per_mm).ln();
    let through = (-per_mm * thickness_mm).exp();
    1.0 / per_mm - thickness_mm * through / (1.0 - through)
}

#[test]
fn the_expected_depth_is_the_mean_of_what_is_absorbed() {
    for opacity in [0.005, 0.05, 0.2] {
        let slab = [(10, 0.0), (40, opacity), (10, 0.0)];
        expect_depth(&slab, DepthRule::Expected, 10.0 + mean_depth(opacity, 40.0), 0.15);
    }
    // Two slabs: each by its share. It lies between them, where there is nothing.
    let two = [(5, 0.0), (10, 0.05), (30, 0.0), (20, 0.1), (5, 0.0)];
    let (front, back) = (1.0 - 0.95f64.powi(10), 1.0 - 0.9f64.powi(20));
    let behind = (1.0 - front) * back;
    let mean =
        (front * (5.0 + mean_depth(0.05, 10.0)) + behind * (45.0 + mean_depth(0.1, 20.0))) / (front + behind);
    assert!((15.0..45.0).contains(&mean));
    expect_depth(&two, DepthRule::Expected, mean, 0.15);
}

/// Where a slab's own accumulated opacity crosses a fraction of its final one, mm behind its face.
fn threshold_depth(opacity_per_mm: f64, thickness_mm: f64, fraction: f64) -> f64 {
    let whole = 1.0 - (1.0 - opacity_per_mm).powf(thickness_mm);
    (1.0 - fraction * whole).ln() / (1.0 - opacity_per_mm).ln()
}

/// Invariant: A depth rule changes no colour and puts the depth where its definition says.
#[test]
fn two_layers_have_a_threshold_each_and_the_back_has_its_own_colour() {
    let layers = [(5, 0.0), (10, 0.1), (10, 0.0), (20, 0.3), (5, 0.0)];
    let through = 0.9f64.powi(10);
    for fraction in [0.2, 0.5, 0.8] {
        for frame in pictures(&layers, DepthRule::TwoLayer { fraction }) {
            let back = frame.back.as_ref().expect("a second layer");
            let (front_mm, back_mm) =
                (5.0 + threshold_depth(0.1, 10.0, fraction), 25.0 + threshold_depth(0.3, 20.0, fraction));
            for i in 0..9 {
                let (front, behind) = (f64::from(frame.depth_mm[i]), f64::from(back.depth_mm[i]));
                assert!(
                    (front - FACE_MM - front_mm).abs() < 0.15,
                    "{front} mm for {front_mm} mm at {fraction}"
                );
                assert!(
                    (behind - FACE_MM - back_mm).abs() < 0.15,
                    "{behind} mm for {back_mm} mm at {fraction}"
                );
                // The back is green but for the ramp of its edge; the picture is the red front, and
                // the back through it.
                let [red, green, _, coverage] = back.color_rgba[i].map(f64::from);
                assert!(green > 200.0 && coverage >= 254.0, "{:?}", back.color_rgba[i]);
                let [whole_red, whole_green, ..] = frame.color_rgba[i].map(f64::from);
                assert!((whole_red - 255.0 * (1.0 - through) - red * through).abs() < 2.0, "{whole_red}");
                assert!((whole_green - green * through).abs() < 2.0, "{whole_green}");
            }
        }
    }
}

#[test]
fn a_layer_needs_a_gap_behind_it_to_hide_a_surface() {
    let rule = DepthRule::TwoLayer { fraction: 0.5 };
    // 26 % is below what makes a layer: both slabs are one.
    let faint = [(5, 0.0), (3, 0.1), (10, 0.0), (20, 0.3), (5, 0.0)];
    let endless = [(5, 0.0), (40, 0.3)];
    for frame in pictures(&faint, rule).into_iter().chain(pictures(&endless, rule)) {
        let back = frame.back.expect("a second layer");
        assert!(back.depth_mm.iter().all(|mm| *mm == f32::INFINITY));
        assert!(back.color_rgba.iter().all(|rgba| *rgba == [0; 4]));
        assert!(frame.depth_mm.iter().all(|mm| mm.is_finite()));
    }
    for frame in pictures(&faint, DepthRule::Threshold { fraction: 0.5 }) {
        assert!(frame.back.is_none(), "other rules have one layer");
    }
}

/// A pick is on the pixel's ray, in the depth of the rule.
#[test]
fn every_rule_answers_picks() {
    let layers = [(5, 0.0), (10, 0.1), (10, 0.0), (10, 0.6), (5, 0.0)];
    for rule in every_rule() {
        for frame in pictures(&layers, rule) {
            let picked = frame.pick([1, 1]).unwrap();
            assert!(
                picked.distance(Point::new(0.0, f64::from(frame.depth_mm[4]) - FACE_MM, 0.0)) < 1e-4,
                "{rule:?}"
            );
            assert!((4.0..36.0).contains(&picked.xyz.y), "{rule:?}: {:?}", picked.xyz);
        }
    }
}

fn every_rule() -> Vec<DepthRule> {
    let rules = DepthRule::TABLE.iter().map(|entry| entry.rule);
    rules.chain([DepthRule::TwoLayer { fraction: 0.9 }]).collect()
}

/// Invariant: The GPU and the f64 reference agree in every mode, projection and depth rule.
#[test]
fn gpu_and_twin_agree_by_every_depth_rule() {
    let volume = oblique_head();
    for rule in every_rule() {
        for (preset, fov) in [("bone", 25.0), ("soft-tissue", 0.0), ("vessels", 25.0)] {
            let request = RenderRequest { depth: rule, ..head_request(&volume, preset, fov) };
            compare(&volume, &request, &format!("{rule:?}, {preset}"));
        }
    }
}

/// Invariant: The GPU and the f64 reference agree in every mode, projection and depth rule.
#[test]
fn gpu_and_twin_agree_about_what_lies_behind() {
    let Some(mut renderer) = renderer("gpu_and_twin_agree_about_what_lies_behind") else { return };
    let volume = oblique_head();
    for preset in ["bone", "skin", "vessels"] {
        let request = RenderRequest {
            depth: DepthRule::TwoLayer { fraction: 0.5 },
            ..head_request(&volume, preset, 25.0)
        };
        let gpu = renderer.render(&volume, &request).unwrap().back.unwrap();
        let twin = render_reference(&volume, &request).unwrap().back.unwrap();
        let pairs = || gpu.depth_mm.iter().zip(&twin.depth_mm);
        let depths =
            pairs().filter(|(a, b)| a.is_finite() != b.is_finite() || (*a - *b).abs() > 0.05).count();
        let apart = |(a, b): (&[u8; 4], &[u8; 4])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > 1);
        let colors = gpu.color_rgba.iter().zip(&twin.color_rgba).filter(|pair| apart(*pair)).count();
        let hits = twin.depth_mm.iter().filter(|mm| mm.is_finite()).count();
        println!(
            "{preset}: {colors} colours and {depths} depths differ, {hits} of {} hit",
            twin.depth_mm.len()
        );
        assert!(hits > 200, "{preset}: {hits} hits behind show too little to compare");
        assert!(colors <= 19 && depths <= 19, "{preset}: {colors} colours and {depths} depths differ");
    }
}

/// Invariant: EmptySpaceSkipping empty space changes no byte of a picture.
#[test]
fn skipping_changes_no_byte_of_any_depth_rule() {
    let Some(mut renderer) = renderer("skipping_changes_no_byte_of_any_depth_rule") else { return };
    let volume = common::volume(PhantomKind::Head, 64);
    for (i, rule) in every_rule().into_iter().enumerate() {
        for preset in ["bone", "vessels", "soft-tissue"] {
            let orbit = Orbit {
                azimuth_deg: 37.0 * i as f64,
                elevation_deg: 15.0,
                zoom: 1.3,
                vertical_fov_deg: 20.0,
            };
            let scene = SceneFile::default().with_preset(preset).with_size([97, 61]);
            let mut request = scene.resolve(volume.grid(), &orbit).unwrap().request;
            request.sample_distance_mm = [0.7, 1.0, 2.3][i % 3];
            request.depth = rule;
            let [on, off] = [EmptySpaceSkipping::On, EmptySpaceSkipping::Off]
                .map(|skipping| renderer.render_with(&volume, &request, skipping).unwrap());
            let bits = |depth: &[f32]| depth.iter().map(|mm| mm.to_bits()).collect::<Vec<_>>();
            assert!(on.color_rgba == off.color_rgba, "{rule:?}, {preset}: colour");
            assert!(bits(&on.depth_mm) == bits(&off.depth_mm), "{rule:?}, {preset}: depth");
            let back = |frame: &RenderedFrame| frame.back.clone().map(|b| (b.color_rgba, bits(&b.depth_mm)));
            assert!(back(&on) == back(&off), "{rule:?}, {preset}: what lies behind");
        }
    }
}
