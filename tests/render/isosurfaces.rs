//! Isosurfaces with closed forms: where they lie, how they are lit, in which order they come, and
//! what clips them.

use crate::common;
use relief_base::{Point, Vector};
use relief_render::{
    ClipPlane, DepthRule, EmptySpaceSkipping, Mode, RenderRequest, RenderedFrame, SceneFile, Shading, Surface,
};
use relief_volume::{Camera, Grid, Orbit, PhantomKind, Projection, Volume};

use super::closed_forms::sphere_depth_errors;
use super::renderer;

const EYE_MM: f64 = 600.0;
const RED: [f64; 3] = [1.0, 0.0, 0.0];
const BLUE: [f64; 3] = [0.0, 0.0, 1.0];

fn surface(hu: f64, rgb: [f64; 3], opacity: f64) -> Surface {
    Surface { hu, rgb, opacity }
}

/// Unshaded, along y, `side` pixels of 1 mm.
fn looking_along_y(volume: &Volume, side: u32, surfaces: &[Surface]) -> RenderRequest {
    let (eye, at) = (Point::new(0.0, -EYE_MM, 0.0), Point::new(0.0, 0.0, 0.0));
    let projection = Projection::Orthographic { height_mm: f64::from(side) };
    let camera = Camera::new(eye, at, Vector::new(0.0, 0.0, 1.0), projection).unwrap();
    let scene = SceneFile::default().with_mode(Mode::Isosurface).with_size([side, side]);
    let request = scene.resolve(volume.grid(), &Orbit::default()).unwrap().request;
    let (surfaces, shading) = (surfaces.to_vec(), Shading::NONE);
    RenderRequest { camera, surfaces, shading, sample_distance_mm: 1.0, ..request }
}

/// HU fall by 60 per mm from 4000 at the centre: 400 HU at 60 mm, 2200 HU at 30 mm.
fn cone() -> Volume {
    let grid = Grid::axis_aligned([96; 3], [1.5; 3], [-71.25; 3]).unwrap();
    let hu = |i: usize, j: usize, k: usize| {
        let position = grid.patient_from_voxel() * Point::new(i as f64, j as f64, k as f64);
        (4000.0 - 60.0 * position.xyz.length()).round() as i16
    };
    let voxels = (0..96usize.pow(3)).map(|at| hu(at % 96, at / 96 % 96, at / 96 / 96)).collect();
    Volume::new(grid, voxels).unwrap()
}

/// Distance of a pixel from the picture's middle, mm.
fn off_axis(frame: &RenderedFrame, i: usize) -> f64 {
    let side = frame.size_px[0] as usize;
    let from_middle = |at: usize| at as f64 + 0.5 - side as f64 / 2.0;
    from_middle(i % side).hypot(from_middle(i / side))
}

#[test]
fn a_spheres_surface_lies_where_it_is() {
    let Some(mut renderer) = renderer("a_spheres_surface_lies_where_it_is") else { return };
    let volume = common::volume(PhantomKind::Sphere, 256);
    // Half of a voxel's coverage is the surface: half-way between air and sphere.
    let half = [surface(-250.0, RED, 1.0)];
    for depth in [DepthRule::FirstHit, DepthRule::Threshold { fraction: 0.5 }] {
        let mut request = looking_along_y(&volume, 170, &half);
        (request.camera, request.depth) = (request.camera.orbited(0.4), depth);
        let errors = sphere_depth_errors(&renderer.render(&volume, &request).unwrap());
        let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
        let worst = errors.iter().fold(0.0f64, |worst, e| worst.max(e.abs()));
        println!("{depth:?}: rms {rms:.4} mm, worst {worst:.4} mm of {} pixels", errors.len());
        assert!(errors.len() > 15_000, "{} pixels see the sphere", errors.len());
        assert!(rms <= 0.07 && worst <= 0.3, "{depth:?}: rms {rms} mm, worst {worst} mm");
    }
}

/// Invariant: Isosurfaces lie where their closed forms put them, are lit by their slope, come in
/// their order, and are open where they are cut.
#[test]
fn a_crossing_is_found_to_a_hundredth_of_a_sample_distance() {
    let Some(mut renderer) = renderer("a_crossing_is_found_to_a_hundredth") else { return };
    let volume = cone();
    let mut render = |sample_distance_mm| {
        let request = looking_along_y(&volume, 100, &[surface(400.0, RED, 1.0)]);
        renderer.render(&volume, &RenderRequest { sample_distance_mm, ..request }).unwrap().depth_mm
    };
    let fine = render(0.02);
    for sample_distance_mm in [0.5, 1.0, 2.0] {
        let coarse = render(sample_distance_mm);
        let apart = coarse.iter().zip(&fine).map(|(a, b)| f64::from((a - b).abs()) / sample_distance_mm);
        let worst = apart.fold(0.0, f64::max);
        println!("{sample_distance_mm} mm: {worst:.5} of a sample distance at worst");
        assert!(worst < 0.01, "{sample_distance_mm} mm: {worst} of a sample distance");
    }
}

/// Invariant: Isosurfaces lie where their closed forms put them, are lit by their slope, come in
/// their order, and are open where they are cut.
#[test]
fn a_surface_is_lit_by_the_cosine_of_its_slope() {
    let Some(mut renderer) = renderer("a_surface_is_lit_by_the_cosine") else { return };
    let volume = cone();
    let mut request = looking_along_y(&volume, 119, &[surface(400.0, [1.0, 0.5, 0.0], 1.0)]);
    request.shading = Shading { ambient: 0.1, diffuse: 0.6, specular: 0.3, shininess: 8.0 };
    let frame = renderer.render(&volume, &request).unwrap();
    let mut compared = 0;
    for (i, pixel) in frame.color_rgba.iter().enumerate() {
        let sine = off_axis(&frame, i) / 60.0;
        if sine < 0.95 {
            let facing = (1.0 - sine * sine).sqrt();
            let light = |channel: f64| channel * (0.1 + 0.6 * facing) + 0.3 * facing.powi(8);
            for (found, channel) in pixel.iter().zip([1.0, 0.5, 0.0]) {
                let off = (f64::from(*found) - 255.0 * light(channel)).abs();
                assert!(off < 2.0, "{found} for {} at sine {sine}", 255.0 * light(channel));
            }
            compared += 1;
        }
    }
    assert!(compared > 8_000, "{compared} pixels");
}

/// Invariant: Isosurfaces lie where their closed forms put them, are lit by their slope, come in
/// their order, and are open where they are cut.
///
/// A red shell of 60 mm around a blue ball of 30 mm: the surfaces on a ray that passes `off_mm`
/// from the centre.
#[test]
fn nested_surfaces_blend_and_have_the_depth_of_the_rule() {
    let Some(mut renderer) = renderer("nested_surfaces_blend") else { return };
    let volume = cone();
    let surfaces = [surface(400.0, RED, 0.4), surface(2200.0, BLUE, 1.0)];
    let (front, back) = (
        |r: f64, off: f64| EYE_MM - (r * r - off * off).sqrt(),
        |off: f64| EYE_MM + (3600.0 - off * off).sqrt(),
    );
    for (depth, within, beside) in [
        (DepthRule::FirstHit, 60.0, false),
        (DepthRule::Threshold { fraction: 0.3 }, 60.0, false),
        // The shell by itself transmits 0.36: it absorbs 0.64 in all, of which its front absorbs
        // 0.4.
        (DepthRule::Threshold { fraction: 0.5 }, 30.0, false),
        (DepthRule::Threshold { fraction: 0.95 }, 30.0, true),
    ] {
        let request = RenderRequest { depth, ..looking_along_y(&volume, 111, &surfaces) };
        let frame = renderer.render(&volume, &request).unwrap();
        for (i, (rgba, mm)) in frame.color_rgba.iter().zip(&frame.depth_mm).enumerate() {
            let off_mm = off_axis(&frame, i);
            // Red, blue, coverage, depth.
            let expected = match off_mm {
                off if off < 29.0 => [102.0, 153.0, 255.0, front(within, off)],
                off if off > 31.0 && off < 55.0 => {
                    [163.2, 0.0, 163.2, if beside { back(off) } else { front(60.0, off) }]
                }
                _ => continue,
            };
            let found = [f64::from(rgba[0]), f64::from(rgba[2]), f64::from(rgba[3]), f64::from(*mm)];
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found - expected).abs() < 0.9, "{depth:?}, {off_mm} mm off: {found} for {expected}");
            }
        }
    }
}

/// Invariant: Isosurfaces lie where their closed forms put them, are lit by their slope, come in
/// their order, and are open where they are cut.
#[test]
fn surfaces_within_one_sample_distance_come_in_their_order_along_the_ray() {
    let Some(mut renderer) = renderer("surfaces_within_one_sample_distance") else { return };
    let volume = common::volume(PhantomKind::Slab, 256);
    let surfaces = [surface(-800.0, RED, 0.5), surface(0.0, BLUE, 0.5)];
    for sample_distance_mm in [0.1, 1.0, 3.3] {
        let request = looking_along_y(&volume, 8, &surfaces);
        let request = RenderRequest { sample_distance_mm, ..request };
        let frame = renderer.render(&volume, &request).unwrap();
        for rgba in &frame.color_rgba {
            // Red before blue on the way in, blue before red on the way out.
            let expected = [0.5 + 0.0625, 0.0, 0.25 + 0.125, 0.9375].map(|share| 255.0 * share);
            for (found, expected) in rgba.iter().zip(expected) {
                assert!((f64::from(*found) - expected).abs() <= 0.6, "{rgba:?} at {sample_distance_mm} mm");
            }
        }
    }
}

/// Invariant: A body whose values all equal the value of a surface contains no surface.
#[test]
fn a_body_of_the_surfaces_very_value_has_no_surface_in_it() {
    let Some(mut renderer) = renderer("a_body_of_the_surfaces_very_value") else { return };
    let volume = common::volume(PhantomKind::Slab, 256);
    for (hu, coverage) in [(300.0, 0), (299.9, 191), (-1000.0, 191), (-1000.1, 0)] {
        let mut request = looking_along_y(&volume, 8, &[surface(hu, RED, 0.5)]);
        request.camera = request.camera.orbited(0.3);
        let frame = renderer.render(&volume, &request).unwrap();
        let covered: Vec<u8> = frame.color_rgba.iter().map(|rgba| rgba[3]).collect();
        assert!(covered.iter().all(|found| found.abs_diff(coverage) <= 1), "{hu} HU: {covered:?}");
    }
}

#[test]
fn a_clipped_surface_is_open() {
    let Some(mut renderer) = renderer("a_clipped_surface_is_open") else { return };
    let volume = common::volume(PhantomKind::Sphere, 256);
    let mut request = looking_along_y(&volume, 101, &[surface(-250.0, RED, 1.0)]);
    // The part before y = 10 mm is cut off, so the inside of the far half is visible.
    let plane = ClipPlane { point: Point::new(0.0, 10.0, 0.0), normal: Vector::new(0.0, 1.0, 0.0) };
    request.clip.planes.push(plane);
    let frame = renderer.render(&volume, &request).unwrap();
    for (i, mm) in frame.depth_mm.iter().enumerate() {
        let off_mm = off_axis(&frame, i);
        let expected = EYE_MM + (6400.0 - off_mm * off_mm).sqrt();
        assert!((f64::from(*mm) - expected).abs() < 0.3, "{off_mm} mm off: {mm} for {expected} mm");
    }
}

/// Invariant: EmptySpaceSkipping empty space changes no byte of a picture.
#[test]
fn skipping_steps_over_what_has_no_surface_and_changes_no_byte() {
    let Some(mut renderer) = renderer("skipping_steps_over_what_has_no_surface") else { return };
    let volume = common::volume(PhantomKind::Head, 64);
    let surfaces = [surface(-300.0, RED, 0.3), surface(45.0, BLUE, 0.2), surface(300.0, [1.0; 3], 0.6)];
    let bits = |depths: &[f32]| depths.iter().map(|mm| mm.to_bits()).collect::<Vec<_>>();
    for (azimuth, camera_turn) in [0.0, 0.6, 1.9, 4.0].into_iter().enumerate() {
        // Up to steps that are longer than bricks.
        for sample_distance_mm in [0.4, 1.7, 6.0, 19.0] {
            for count in [1, 3] {
                let mut request = looking_along_y(&volume, 90, &surfaces[..count]);
                request.camera = request.camera.orbited(camera_turn);
                request.sample_distance_mm = sample_distance_mm;
                request.size_px = [45, 45];
                let on = renderer.render_with(&volume, &request, EmptySpaceSkipping::On).unwrap();
                let off = renderer.render_with(&volume, &request, EmptySpaceSkipping::Off).unwrap();
                let what = format!("view {azimuth}, {sample_distance_mm} mm, {count} surfaces");
                assert!(on.color_rgba == off.color_rgba, "colour of {what}");
                assert!(bits(&on.depth_mm) == bits(&off.depth_mm), "depth of {what}");
            }
        }
    }
    let sphere = common::volume(PhantomKind::Sphere, 128);
    let request = looking_along_y(&sphere, 64, &[surface(-250.0, RED, 1.0)]);
    let taken = renderer.count_samples(&sphere, &request, EmptySpaceSkipping::On).unwrap();
    assert!(taken < 64 * 64 * 20, "{taken} samples, of some 100 on each ray to the surface");
}
