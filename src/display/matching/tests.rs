//! Scenes whose views are known in closed form: smooth textures on planes across the viewing axis.

use super::*;
use crate::profile::{DisplayProfile, ProfileName};
use relief_base::Disparity;

const EYE: f64 = 1.0;

fn parallax(width: u32) -> Parallax {
    Parallax::new(&DisplayProfile::named(ProfileName::Philips42), 64, 128, width)
}

/// A texture that is known between pixels too: waves of several directions, 0 to 1.
fn texture(x: f64, y: f64, phase: f64) -> [f64; 3] {
    [0.0, 1.3, 2.9].map(|channel| {
        let waves = (0.61 * x + 0.23 * y + phase + channel).sin()
            + (0.37 * x - 0.71 * y + 2.0 * phase).sin()
            + (0.13 * x + 0.19 * y - phase).cos();
        0.5 + waves / 6.0
    })
}

/// The pictures of a scene: colours in 0 to 1 as a function of place and eye.
struct Views {
    size_px: [u32; 2],
    picture: Vec<[u8; 4]>,
    sides: [Vec<[u8; 4]>; 2],
}

impl Views {
    fn of(size_px: [u32; 2], scene: impl Fn(f64, f64, f64) -> [f64; 3]) -> Self {
        let draw = |[width, height]: [u32; 2], step: f64, eye: f64| {
            let pixels = (0..height).flat_map(|y| (0..width).map(move |x| [x, y].map(f64::from)));
            let bytes =
                pixels.map(|[x, y]| scene(step * x, step * y, eye).map(|v| (255.0 * v).round() as u8));
            bytes.map(|[r, g, b]| [r, g, b, 255]).collect::<Vec<_>>()
        };
        let side_px = side_size_px(size_px);
        let sides = [-EYE, EYE].map(|eye| draw(side_px, 2.0, eye));
        Self { size_px, picture: draw(size_px, 1.0, 0.0), sides }
    }

    fn disparity(&self) -> Vec<f32> {
        let [left, right] = &self.sides;
        let sides = [SideView { eye: -EYE, color: left }, SideView { eye: EYE, color: right }];
        let rays = uneven(self.picture.len());
        disparity_for_views(self.size_px, &self.picture, &rays, &sides, &parallax(self.size_px[0]))
    }
}

/// Disparities of rays that are no surface: they say nothing.
fn uneven(count: usize) -> Vec<u8> {
    (0..count).map(|at| if at.is_multiple_of(2) { 0 } else { 255 }).collect()
}

/// The share of chosen pixels whose disparity is farther than `most` from the expected one.
fn wrong(found: &[f32], width: u32, most: f32, expected: impl Fn(u32, u32) -> Option<f32>) -> f64 {
    let pixels = found.iter().zip(0u32..).filter_map(|(d, at)| Some((d, expected(at % width, at / width)?)));
    let far: Vec<bool> = pixels.map(|(d, expected)| (d - expected).abs() > most).collect();
    assert!(far.len() > 100, "pixels to compare");
    far.iter().filter(|far| **far).count() as f64 / far.len() as f64
}

/// Invariant: Rule `views` finds the disparity of opaque surfaces.
#[test]
fn planes_have_their_disparity_to_their_edges() {
    let size_px = [963, 121];
    let parallax = parallax(size_px[0]);
    let is_plate = |x: f64, y: f64| (300.0..520.0).contains(&x) && (30.0..90.0).contains(&y);
    let views = Views::of(size_px, |x, y, eye| {
        let at = |d: f64| x - parallax.shift_px(Disparity(d), eye);
        if is_plate(at(200.0), y) { texture(at(200.0), y, 2.0) } else { texture(at(50.0), y, 0.0) }
    });
    let truth = |x: u32, y: u32| if is_plate(f64::from(x), f64::from(y)) { 200.0 } else { 50.0 };
    let found = views.disparity();
    let all = wrong(&found, size_px[0], 6.0, |x, y| Some(truth(x, y)));
    let inside = wrong(&found, size_px[0], 6.0, |x, y| {
        let near = |x: u32, y: u32| truth(x.min(size_px[0] - 1), y.min(size_px[1] - 1));
        let is_uniform =
            [near(x.saturating_sub(6), y), near(x + 6, y), near(x, y.saturating_sub(6)), near(x, y + 6)]
                .iter()
                .all(|d| *d == truth(x, y));
        is_uniform.then(|| truth(x, y))
    });
    assert!(all < 0.02 && inside < 0.004, "{all} of all pixels, {inside} of those away from edges");
}

/// Invariant: Rule `views` gives translucent tissue the disparity of what changes colour behind it.
#[test]
fn a_veil_before_a_texture_has_the_disparity_of_the_texture() {
    let size_px = [640, 80];
    let parallax = parallax(size_px[0]);
    let views = Views::of(size_px, |x, y, eye| {
        let at = |d: f64| x - parallax.shift_px(Disparity(d), eye);
        let [behind, veil] = [texture(at(90.0), y, 0.5), texture(at(220.0) / 9.0, y / 9.0, 1.0)];
        std::array::from_fn(|channel| 0.45 * veil[channel] + 0.55 * behind[channel])
    });
    let share = wrong(&views.disparity(), size_px[0], 20.0, |_, _| Some(90.0));
    assert!(share < 0.02, "{share}");
}

/// Invariant: The back layer of rule `views` is what the views beside a picture show behind its edges.
#[test]
fn the_hidden_layer_is_what_the_plate_hides_beside_its_edges() {
    let size_px = [641, 61];
    let parallax = parallax(960);
    let (near, far) = (200, 50);
    let plate = 200..420;
    let shift = |d: u8, eye: f64| parallax.shift_px(Disparity(f64::from(d)), eye);
    let background = |x: f64, y: f64| texture(x / 5.0, y / 5.0, 0.0);
    let views = Views::of(size_px, |x, y, eye| {
        let [on_plate, behind] = [near, far].map(|d| x - shift(d, eye));
        let is_plate = (199.5..419.5).contains(&on_plate);
        if is_plate { texture(on_plate, y, 2.0) } else { background(behind, y) }
    });
    let disparity: Vec<u8> = (0..size_px[1])
        .flat_map(|_| (0..size_px[0]).map(|x| if plate.contains(&x) { near } else { far }))
        .collect();
    let [left, right] = &views.sides;
    let sides = [SideView { eye: -EYE, color: left }, SideView { eye: EYE, color: right }];
    let layer = hidden_layer(size_px, &views.picture, &disparity, &sides, &parallax);
    let revealed = (shift(near, EYE) - shift(far, EYE)).abs();
    let (mut seen, mut differences) = (0, 0.0);
    for at in 0..disparity.len() as u32 {
        let [x, y] = [at % size_px[0], at / size_px[0]];
        let at = at as usize;
        if layer.disparity[at] == disparity[at] {
            assert_eq!(layer.color[at], views.picture[at], "({x}, {y})");
            continue;
        }
        let from_edge = (x - plate.start).min(plate.end - 1 - x);
        assert!(plate.contains(&x) && f64::from(from_edge) < revealed + 1.0, "({x}, {y})");
        assert_eq!((layer.disparity[at], layer.color[at][3]), (far, 255), "({x}, {y})");
        let truth = background(f64::from(x), f64::from(y)).map(|v| 255.0 * v);
        let channels = truth.iter().zip(layer.color[at]);
        differences += channels.map(|(truth, found)| (truth - f64::from(found)).abs()).sum::<f64>() / 3.0;
        seen += 1;
    }
    let expected = 2.0 * (revealed - 1.0) * f64::from(size_px[1]);
    assert!(f64::from(seen) > expected, "{seen} pixels behind the plate, at least {expected}");
    let mean = differences / f64::from(seen);
    assert!(mean < 6.0, "colours differ by {mean} in the mean");
}

/// Invariant: Rule `views` keeps the disparity of the rays where it finds nearly the same.
#[test]
fn nearly_the_disparity_of_the_rays_is_theirs() {
    let size_px = [640, 80];
    let parallax = parallax(size_px[0]);
    let views = Views::of(size_px, |x, y, eye| texture(x - parallax.shift_px(Disparity(120.0), eye), y, 0.0));
    let [left, right] = &views.sides;
    let sides = [SideView { eye: -EYE, color: left }, SideView { eye: EYE, color: right }];
    for (ray, expected, most) in [(117, 117.0, 0.0), (123, 123.0, 0.0), (160, 120.0, 6.0)] {
        // Every second row is of another disparity, so that no smooth surface is preferred.
        let rays: Vec<u8> = (0..640 * 80).map(|at| if at / 640 % 2 == 0 { ray } else { 255 }).collect();
        let found = disparity_for_views(size_px, &views.picture, &rays, &sides, &parallax);
        let share = wrong(&found, size_px[0], most, |_, y| (y % 2 == 0).then_some(expected));
        assert!(share < 0.02, "{share} of the pixels with rays at {ray}");
    }
    for (apart, kept) in
        [(0.0, 0.0), (8.0, 0.0), (-8.0, 0.0), (12.0, 6.0), (-12.0, -6.0), (16.0, 16.0), (99.0, 99.0)]
    {
        assert_eq!(near_ray(100.0 + apart, 100.0), 100.0 + kept);
    }
}

#[test]
fn strips_leave_no_seams() {
    let size_px = [120, 1201];
    let parallax = parallax(960);
    // A slanted plane: the disparity falls along the rows.
    let plane = |y: f64| 220.0 - y / 8.0;
    let views =
        Views::of(size_px, |x, y, eye| texture(x - parallax.shift_px(Disparity(plane(y)), eye), y, 0.0));
    let [left, right] = &views.sides;
    let sides = [SideView { eye: -EYE, color: left }, SideView { eye: EYE, color: right }];
    let rays = uneven(views.picture.len());
    let found = disparity_for_views(size_px, &views.picture, &rays, &sides, &parallax);
    let share =
        wrong(&found, size_px[0], 8.0, |x, y| (10..110).contains(&x).then(|| plane(f64::from(y)) as f32));
    assert!(share < 0.01, "{share}");
}

#[test]
fn the_smallest_pictures_have_a_disparity() {
    for size_px in [[1, 1], [2, 1], [1, 2], [3, 5], [64, 1]] {
        let views = Views::of(size_px, |x, y, _| texture(x, y, 0.0));
        let found = views.disparity();
        assert_eq!(found.len() as u32, size_px[0] * size_px[1]);
        assert!(found.iter().all(|d| (0.0..=255.0).contains(d)), "{found:?}");
    }
}

/// Invariant: Rule `views` finds the disparity of opaque surfaces.
#[test]
fn a_surface_without_texture_has_the_disparity_of_its_rays() {
    const SIZE_PX: [u32; 2] = [160, 120];
    let views = Views::of(SIZE_PX, |_, _, _| [0.6, 0.5, 0.4]);
    let [left, right] = &views.sides;
    let sides = [SideView { eye: -EYE, color: left }, SideView { eye: EYE, color: right }];
    let slope = |x: u32, y: u32| 40.0 + x as f32 / 2.0 + y as f32 / 3.0;
    let rays: Vec<u8> = (0..SIZE_PX[0] * SIZE_PX[1])
        .map(|at| slope(at % SIZE_PX[0], at / SIZE_PX[0]).round() as u8)
        .collect();
    let found = disparity_for_views(SIZE_PX, &views.picture, &rays, &sides, &parallax(960));
    let share = wrong(&found, SIZE_PX[0], 5.0, |x, y| Some(slope(x, y)));
    assert!(share < 0.01, "{share}");
}
