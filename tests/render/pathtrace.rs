//! Mode path-traced: the same bytes for a seed, convergence as the law of large numbers has it, and
//! closed forms.
//!
//! Colours are read back as linear light, 8 bits a pixel; means over many noisy pixels are finer
//! than that.

use std::ops::ControlFlow;

use super::renderer;
use crate::common;
use relief_base::{Point, Vector};
use relief_render::{
    Light, Mode, PathTrace, Placement, Progress, RenderRequest, RenderedFrame, Renderer, SceneFile, Shading,
};
use relief_volume::{
    Camera, ControlPoint, Grid, PhantomKind, Projection, TransferFunction, Volume, linear_from_srgb,
};

const SLAB_MM: f64 = 100.0;

fn transfer(points: &[(f64, f64)], rgb: [f64; 3]) -> TransferFunction {
    let point = |&(hu, a): &(f64, f64)| ControlPoint { hu, rgba: [rgb[0], rgb[1], rgb[2], a] };
    TransferFunction::new(points.iter().map(point).collect(), 1.0).unwrap()
}

/// A medium of this extinction per mm where the slab is.
fn slab_of(extinction: f64, rgb: [f64; 3]) -> TransferFunction {
    transfer(&[(-1000.0, 0.0), (300.0, 1.0 - (-extinction).exp())], rgb)
}

fn along_y(height_mm: f64) -> Camera {
    let (eye, at) = (Point::new(0.0, -600.0, 0.0), Point::new(0.0, 0.0, 0.0));
    Camera::new(eye, at, Vector::new(0.0, 0.0, 1.0), Projection::Orthographic { height_mm }).unwrap()
}

/// Only the given light, no surfaces: a scattering medium.
fn dark(volume: &Volume, transfer: TransferFunction, camera: Camera, side_px: u32) -> RenderRequest {
    let scene = SceneFile::default().with_mode(Mode::PathTraced).with_size([side_px, side_px]);
    let request = scene.resolve(volume.grid(), &relief_volume::Orbit::default()).unwrap().request;
    let path_trace = PathTrace { environment: 0.0, exposure: 1.0, surface: 0.0, ..PathTrace::default() };
    RenderRequest {
        camera,
        transfer,
        path_trace,
        shading: Shading::NONE,
        lights: vec![],
        sample_distance_mm: 2.0,
        ..request
    }
}

fn distant(direction: [f64; 3]) -> Light {
    let [x, y, z] = direction;
    Light {
        placement: Placement::ViewDirection(Vector::new(x, y, z)),
        rgb: [1.0; 3],
        intensity: 1.0,
        size: 0.0,
    }
}

/// The head, lit as by default, small.
fn head_request(volume: &Volume, passes: u32) -> RenderRequest {
    let scene = SceneFile::default().with_mode(Mode::PathTraced).with_size([32, 32]).with_passes(passes);
    let orbit = relief_volume::Orbit { azimuth_deg: 25.0, zoom: 1.3, ..Default::default() };
    scene.resolve(volume.grid(), &orbit).unwrap().request
}

fn linear(frame: &RenderedFrame, channel: usize) -> Vec<f64> {
    let light = |pixel: &[u8; 4]| linear_from_srgb(f64::from(pixel[channel]) / 255.0);
    frame.color_rgba.iter().map(light).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn mean_light(renderer: &mut Renderer, volume: &Volume, request: &RenderRequest) -> f64 {
    mean(&linear(&renderer.render(volume, request).unwrap(), 0))
}

/// Invariant: A seed decides every byte of a path-traced picture, however its passes are grouped;
/// its error falls with their square root.
#[test]
fn a_seed_decides_every_byte_however_passes_are_grouped() {
    let Some(mut renderer) = renderer("a_seed_decides_every_byte") else { return };
    let volume = common::volume(PhantomKind::Head, 64);
    let at_once = renderer.render(&volume, &head_request(&volume, 12)).unwrap();
    let mut reported = Vec::new();
    for passes in [1, 4, 12] {
        let request = head_request(&volume, passes);
        let mut report = |progress: Progress| {
            reported.push(progress.passes);
            ControlFlow::Continue(())
        };
        let frame = renderer.render_watched(&volume, &request, &mut report).unwrap();
        if passes == 12 {
            assert!(frame.color_rgba == at_once.color_rgba, "continued passes are other passes");
        }
    }
    reported.dedup();
    assert_eq!(reported, [0, 1, 0, 4, 0, 12]);
    // With another picture in between nothing can be continued.
    let mut other = head_request(&volume, 12);
    other.path_trace.seed = 2;
    let reseeded = renderer.render(&volume, &other).unwrap();
    assert!(reseeded.color_rgba != at_once.color_rgba, "the seed changes nothing");
    let again = renderer.render(&volume, &head_request(&volume, 12)).unwrap();
    assert!(again.color_rgba == at_once.color_rgba, "the same request gave other bytes");
    let bits = |frame: &RenderedFrame| frame.depth_mm.iter().map(|mm| mm.to_bits()).collect::<Vec<_>>();
    assert!(bits(&again) == bits(&reseeded), "depth is not by chance");
}

/// Invariant: A seed decides every byte of a path-traced picture, however its passes are grouped;
/// its error falls with their square root.
#[test]
fn error_falls_with_the_square_root_of_the_passes() {
    let Some(mut renderer) = renderer("error_falls_with_the_square_root_of_the_passes") else { return };
    let volume = common::volume(PhantomKind::Head, 64);
    let dim = |passes, seed| {
        let mut request = head_request(&volume, passes);
        // Nothing may clip: a clipped mean is no mean.
        request.path_trace.exposure = 0.4;
        request.path_trace.seed = seed;
        request
    };
    let converged = linear(&renderer.render(&volume, &dim(768, 7)).unwrap(), 1);
    let errors = [1u32, 4, 16, 64].map(|passes| {
        let noisy = linear(&renderer.render(&volume, &dim(passes, 8)).unwrap(), 1);
        let squares = noisy.iter().zip(&converged).map(|(a, b)| (a - b).powi(2));
        (squares.sum::<f64>() / converged.len() as f64).sqrt()
    });
    println!("rms errors after 1, 4, 16 and 64 passes: {errors:.5?}");
    assert!(errors[0] > 0.02, "{errors:?}: there is nothing to converge");
    for pair in errors.windows(2) {
        let ratio = pair[0] / pair[1];
        assert!(
            (1.75..2.25).contains(&ratio),
            "four times the passes: error falls {ratio} times, {errors:?}"
        );
    }
}

/// Invariant: The denoiser removes noise that its guides explain, never adds much, and converges with
/// the passes.
#[test]
fn sixteen_passes_without_noise_are_as_near_to_the_truth_as_many_more() {
    let Some(mut renderer) = renderer("sixteen_passes_without_noise") else { return };
    let volume = common::volume(PhantomKind::Head, 96);
    let mut picture = |passes, denoise, seed| {
        let scene = SceneFile::default().with_preset("skin").with_mode(Mode::PathTraced).with_size([80, 60]);
        let mut request = scene.resolve(volume.grid(), &relief_volume::Orbit::default()).unwrap().request;
        (request.path_trace.passes, request.path_trace.denoise) = (passes, denoise);
        request.path_trace.seed = seed;
        renderer.render(&volume, &request).unwrap().color_rgba
    };
    let squares = |a: &[[u8; 4]], b: &[[u8; 4]]| {
        let pixel = |(a, b): (&[u8; 4], &[u8; 4])| {
            (0..3).map(|i| (f64::from(a[i]) - f64::from(b[i])).powi(2)).sum::<f64>()
        };
        a.iter().zip(b).map(pixel).sum::<f64>() / (3 * a.len()) as f64
    };
    let converged = picture(768, false, 2);
    let [raw, many] =
        [16, 64].map(|passes| picture(passes, false, 1)).map(|picture| squares(&picture, &converged));
    let at_once = picture(16, true, 1);
    let found = squares(&at_once, &converged);
    let db = |squares: f64| 10.0 * (255.0f64.powi(2) / squares).log10();
    println!(
        "16 passes {:.1} dB, 64 passes {:.1} dB, 16 without noise {:.1} dB",
        db(raw),
        db(many),
        db(found)
    );
    assert!(found < many, "{found} in place of {many}");
    // A picture that continues another one has the same bytes.
    picture(4, true, 1);
    assert!(picture(16, true, 1) == at_once);
    assert!(squares(&picture(16, false, 1), &converged) == raw, "the passes themselves have changed");
}

/// Invariant: Path-traced absorption, scattering and shadows follow their closed forms, and energy
/// is conserved.
#[test]
fn a_slab_lets_light_through_by_the_exponential_law() {
    let Some(mut renderer) = renderer("a_slab_lets_light_through") else { return };
    let volume = common::volume(PhantomKind::Slab, 128);
    for extinction in [0.003, 0.012, 0.04] {
        for density in [0.5, 1.0] {
            let mut request = dark(&volume, slab_of(extinction, [0.0; 3]), along_y(60.0), 48);
            request.background_rgb = [1.0; 3];
            request.path_trace.density = density;
            let frame = renderer.render(&volume, &request).unwrap();
            let expected = (-extinction * density * SLAB_MM).exp();
            // 48 * 48 pixels of 64 passes: a share of p has a deviation of sqrt(p (1 - p)) / 384.
            let through = mean(&linear(&frame, 2));
            assert!((through - expected).abs() < 0.004, "{extinction}/mm: {through} for {expected}");
            let covered: Vec<f64> = frame.color_rgba.iter().map(|p| f64::from(p[3]) / 255.0).collect();
            assert!((mean(&covered) - (1.0 - expected)).abs() < 0.004, "coverage {}", mean(&covered));
        }
    }
}

/// One scattering in a slab under distant light, by quadrature along the ray: extinction on the way
/// in and out.
fn slab_scatter(extinction: f64, cosine: f64, phase: f64) -> f64 {
    let steps = 20_000;
    let ds = SLAB_MM / f64::from(steps);
    let at = |s: f64| extinction * (-extinction * s).exp() * phase / 4.0 * (-extinction * s / cosine).exp();
    (0..steps).map(|i| at((f64::from(i) + 0.5) * ds) * ds).sum()
}

/// Invariant: Path-traced absorption, scattering and shadows follow their closed forms, and energy
/// is conserved.
#[test]
fn one_scattering_in_a_slab_is_its_quadrature() {
    let Some(mut renderer) = renderer("one_scattering_in_a_slab") else { return };
    let volume = common::volume(PhantomKind::Slab, 128);
    for (extinction, angle_deg, anisotropy) in
        [(0.01, 0.0f64, 0.0), (0.03, 40.0, 0.0), (0.03, 40.0, 0.5), (0.03, 30.0, -0.4), (0.2, 50.0, 0.0)]
    {
        let (sine, cosine) = angle_deg.to_radians().sin_cos();
        let mut request = dark(&volume, slab_of(extinction, [1.0; 3]), along_y(20.0), 48);
        request.lights = vec![distant([sine, 0.0, cosine])];
        request.path_trace.anisotropy = anisotropy;
        request.path_trace.passes = 96;
        // Light is turned from -light towards the eye: by the angle whose cosine is minus that
        // between them.
        let g = anisotropy;
        let phase = (1.0 - g * g) / (1.0 + g * g + 2.0 * g * cosine).powf(1.5);
        let expected = slab_scatter(extinction, cosine, phase);
        let found = mean_light(&mut renderer, &volume, &request);
        println!("{extinction}/mm, {angle_deg} degrees, g {g}: {found:.5} for {expected:.5}");
        assert!(
            (found / expected - 1.0).abs() < 0.03,
            "{extinction}/mm at {angle_deg}, g {g}: {found} for {expected}"
        );
    }
}

#[test]
fn a_near_light_reaches_no_further_than_what_is_before_it() {
    let Some(mut renderer) = renderer("a_near_light") else { return };
    let volume = common::volume(PhantomKind::Slab, 128);
    // A lamp in the middle of the slab, on the line of sight: only the way between it and the
    // collision counts.
    let extinction = 0.02;
    let mut request = dark(&volume, slab_of(extinction, [1.0; 3]), along_y(1.0), 32);
    request.lights = vec![Light {
        placement: Placement::PatientPosition(Point::new(0.0, 0.0, 0.0)),
        rgb: [1.0; 3],
        intensity: 1.0,
        size: 0.0,
    }];
    request.path_trace.passes = 256;
    let steps = 20_000;
    let ds = SLAB_MM / f64::from(steps);
    let at = |s: f64| extinction * (-extinction * (s + (s - 50.0).abs())).exp() / 4.0;
    let expected: f64 = (0..steps).map(|i| at((f64::from(i) + 0.5) * ds) * ds).sum();
    let found = mean_light(&mut renderer, &volume, &request);
    assert!((found / expected - 1.0).abs() < 0.03, "{found} for {expected}");
}

/// The exponential integral E2, by quadrature of exp(-x / mu) over mu.
fn e2(x: f64) -> f64 {
    let steps = 2000;
    (0..steps).map(|i| (-x * f64::from(steps) / (f64::from(i) + 0.5)).exp() / f64::from(steps)).sum()
}

/// Invariant: Path-traced absorption, scattering and shadows follow their closed forms, and energy
/// is conserved.
#[test]
fn a_furnace_gives_what_one_scattering_can_and_never_more() {
    let Some(mut renderer) = renderer("a_furnace") else { return };
    let volume = common::volume(PhantomKind::Slab, 128);
    for extinction in [0.06, 0.15] {
        let mut request = dark(&volume, slab_of(extinction, [1.0; 3]), along_y(10.0), 48);
        request.path_trace.environment = 1.0;
        // White light from everywhere: the mean over directions of what passes is half of E2 to
        // either face.
        let steps = 400;
        let ds = SLAB_MM / f64::from(steps);
        let open = |s: f64| 0.5 * (e2(extinction * s) + e2(extinction * (SLAB_MM - s)));
        let at = |s: f64| extinction * (-extinction * s).exp() * open(s) * ds;
        let expected: f64 = (0..steps).map(|i| at((f64::from(i) + 0.5) * ds)).sum();
        let isotropic = mean_light(&mut renderer, &volume, &request);
        println!("furnace at {extinction}/mm: {isotropic:.4} for {expected:.4}");
        assert!((isotropic / expected - 1.0).abs() < 0.03, "{isotropic} for {expected}");
    }
    // Nothing in a white furnace is brighter than the furnace, whatever scatters.
    let head = common::volume(PhantomKind::Head, 64);
    let mut request = head_request(&head, 128);
    request.transfer = transfer(&[(-500.0, 0.0), (0.0, 0.6)], [1.0; 3]);
    request.lights = vec![];
    request.shading = Shading::NONE;
    (request.path_trace.environment, request.path_trace.exposure) = (0.25, 1.0);
    let brightest = linear(&renderer.render(&head, &request).unwrap(), 0).into_iter().fold(0.0, f64::max);
    assert!(brightest <= 0.255 && brightest > 0.1, "{brightest} in a furnace of 0.25");
}

/// Light that a slab of isotropic scatterers sends straight back to the eye for distant light from
/// the given cosine, for paths of up to `scatterings` scatterings. An integral over the slab with the
/// kernel E1 gives the source function of a scattering from that of the previous one. Differences of
/// E2 integrate the kernel exactly over a cell.
fn slab_scattered(extinction: f64, cosine: f64, albedo: f64, scatterings: usize) -> f64 {
    let cells = 400;
    let thickness = extinction * SLAB_MM;
    let width = thickness / cells as f64;
    let middle = |i: usize| (i as f64 + 0.5) * width;
    let e2_at: Vec<f64> =
        (0..=cells).map(|i| if i == 0 { 1.0 } else { e2((i as f64 - 0.5) * width) }).collect();
    // The part of the light of a cell that arrives in the middle of another, for both sides.
    let kernel = |i: usize, j: usize| match i.abs_diff(j) {
        0 => 2.0 * (e2_at[0] - e2_at[1]),
        apart => e2_at[apart] - e2_at[apart + 1],
    };
    let mut source: Vec<f64> = (0..cells).map(|i| albedo / 4.0 * (-middle(i) / cosine).exp()).collect();
    let mut light = 0.0;
    for _ in 0..scatterings {
        light += (0..cells).map(|i| source[i] * (-middle(i)).exp() * width).sum::<f64>();
        let next = |i: usize| (0..cells).map(|j| albedo / 2.0 * kernel(i, j) * source[j]).sum();
        source = (0..cells).map(next).collect();
    }
    light
}

/// Invariant: Path-traced absorption, scattering and shadows follow their closed forms, and energy
/// is conserved.
#[test]
fn each_further_scattering_in_a_slab_is_its_integral_over_the_one_before() {
    let Some(mut renderer) = renderer("each_further_scattering_in_a_slab") else { return };
    let volume = common::volume(PhantomKind::Slab, 128);
    let (extinction, albedo, angle_deg) = (0.08f64, 0.9f64, 30.0f64);
    let (sine, cosine) = angle_deg.to_radians().sin_cos();
    let once = slab_scattered(extinction, cosine, albedo, 1);
    let direct = albedo * slab_scatter(extinction, cosine, 1.0);
    assert!((once / direct - 1.0).abs() < 1e-3, "two quadratures: {once} and {direct}");
    let mut before = 0.0;
    for scatterings in [1, 3, 16] {
        // Colours of a transfer function are display-referred.
        let white =
            if albedo <= 0.003_130_8 { 12.92 * albedo } else { 1.055 * albedo.powf(1.0 / 2.4) - 0.055 };
        let mut request = dark(&volume, slab_of(extinction, [white; 3]), along_y(10.0), 48);
        request.lights = vec![distant([sine, 0.0, cosine])];
        (request.path_trace.scatterings, request.path_trace.passes) = (scatterings, 128);
        let expected = slab_scattered(extinction, cosine, albedo, scatterings as usize);
        let found = mean_light(&mut renderer, &volume, &request);
        println!("{scatterings} scatterings: {found:.5} for {expected:.5}");
        assert!((found / expected - 1.0).abs() < 0.01, "{scatterings}: {found} for {expected}");
        assert!(expected > 1.02 * before, "further scatterings add nothing: {expected} after {before}");
        before = expected;
    }
}

/// Invariant: Path-traced absorption, scattering and shadows follow their closed forms, and energy
/// is conserved.
#[test]
fn a_furnace_is_as_bright_inside_as_outside_after_many_scatterings() {
    let Some(mut renderer) = renderer("a_furnace_after_many_scatterings") else { return };
    let volume = common::volume(PhantomKind::Slab, 128);
    for (anisotropy, extinction) in [(0.0, 0.03f64), (0.6, 0.05), (-0.5, 0.02)] {
        let mut request = dark(&volume, slab_of(extinction, [1.0; 3]), along_y(10.0), 48);
        (request.path_trace.environment, request.path_trace.anisotropy) = (0.5, anisotropy);
        (request.path_trace.scatterings, request.path_trace.passes) = (64, 64);
        let expected = 0.5 * (1.0 - (-extinction * SLAB_MM).exp());
        let found = mean_light(&mut renderer, &volume, &request);
        println!("furnace, g {anisotropy}: {found:.4} for {expected:.4}");
        assert!((found / expected - 1.0).abs() < 0.01, "g {anisotropy}: {found} for {expected}");
    }
}

/// A ball whose HU fall by 60 per mm from its centre: 400 HU at 60 mm, and everywhere a gradient
/// along the radius.
fn cone() -> Volume {
    let grid = Grid::axis_aligned([96; 3], [1.5; 3], [-71.25; 3]).unwrap();
    let hu = |i: usize, j: usize, k: usize| {
        let position = grid.patient_from_voxel() * Point::new(i as f64, j as f64, k as f64);
        (4000.0 - 60.0 * position.xyz.length()).round() as i16
    };
    let voxels = (0..96usize.pow(3)).map(|at| hu(at % 96, at / 96 % 96, at / 96 / 96)).collect();
    Volume::new(grid, voxels).unwrap()
}

/// Invariant: Path-traced absorption, scattering and shadows follow their closed forms, and energy
/// is conserved.
///
/// A dense ball is locally a half-space of parallel layers: light that comes at a cosine m and
/// leaves at a cosine n scatters once with the weight m / (m + n), whatever the layers' profile,
/// and Lambert's surface adds a factor m.
#[test]
fn a_dense_ball_is_lit_from_the_side_as_parallel_layers_are() {
    let Some(mut renderer) = renderer("a_dense_ball_is_lit_from_the_side") else { return };
    let volume = cone();
    let mut request = dark(&volume, transfer(&[(390.0, 0.0), (410.0, 0.9995)], [1.0; 3]), along_y(130.0), 33);
    (request.path_trace.surface, request.path_trace.surface_hu_per_mm) = (1.0, 0.01);
    request.path_trace.passes = 768;
    let toward = glam::DVec3::new(0.6, 0.3, 0.8).normalize();
    request.lights = vec![distant(toward.to_array())];
    let found = linear(&renderer.render(&volume, &request).unwrap(), 1);
    let mut errors = Vec::new();
    for (i, &light) in (0u32..).zip(&found) {
        let off_axis = |at: u32| (f64::from(at) + 0.5) / 33.0 * 130.0 - 65.0;
        let (x, y) = (off_axis(i % 33) / 60.0, -off_axis(i / 33) / 60.0);
        let towards_eye = (1.0 - x * x - y * y).max(0.0).sqrt();
        let towards_light = glam::DVec3::new(x, y, towards_eye).dot(toward);
        if towards_eye < 0.6 || towards_light.abs() < 0.2 {
            continue;
        }
        let expected = if towards_light > 0.0 {
            towards_light * towards_light / (towards_light + towards_eye)
        } else {
            0.0
        };
        errors.push(light - expected);
    }
    let rms = (errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64).sqrt();
    let worst = errors.iter().fold(0.0f64, |worst, error| worst.max(error.abs()));
    println!("ball: {} pixels, mean {:.4}, rms {rms:.4}, worst {worst:.4}", errors.len(), mean(&errors));
    // The noise of 768 paths, and the ball's curvature within a pixel of 4 mm.
    assert!(errors.len() > 300, "{} pixels", errors.len());
    assert!(mean(&errors).abs() < 0.005 && rms < 0.015 && worst < 0.06, "rms {rms}, worst {worst}");
}

#[test]
fn depth_is_that_of_the_composite_picture() {
    let Some(mut renderer) = renderer("depth_is_that_of_the_composite_picture") else { return };
    let volume = common::volume(PhantomKind::Head, 64);
    let traced = head_request(&volume, 1);
    let cast = RenderRequest { mode: Mode::Composite, lights: vec![], ..traced.clone() };
    let traced = renderer.render(&volume, &traced).unwrap();
    let cast = renderer.render(&volume, &cast).unwrap();
    assert!(traced.depth_mm == cast.depth_mm && traced.color_rgba != cast.color_rgba);
    assert!(cast.depth_mm.iter().filter(|mm| mm.is_finite()).count() > 200);
}

#[test]
fn clipped_voxels_are_invisible_and_cast_no_shadow() {
    let Some(mut renderer) = renderer("what_is_clipped_neither_shows") else { return };
    let volume = common::volume(PhantomKind::Slab, 128);
    let extinction = 0.03;
    let mut request = dark(&volume, slab_of(extinction, [1.0; 3]), along_y(20.0), 48);
    request.lights = vec![distant([0.0, 0.0, 1.0])];
    let whole = mean_light(&mut renderer, &volume, &request);
    // The front half is cut; a slab of 50 mm remains in the light.
    let plane =
        relief_render::ClipPlane { point: Point::new(0.0, 0.0, 0.0), normal: Vector::new(0.0, 1.0, 0.0) };
    request.clip.planes.push(plane);
    let half = mean_light(&mut renderer, &volume, &request);
    let of = |mm: f64| (1.0 - (-2.0 * extinction * mm).exp()) / 8.0;
    assert!((whole / of(100.0) - 1.0).abs() < 0.03, "{whole} for {}", of(100.0));
    assert!((half / of(50.0) - 1.0).abs() < 0.03, "{half} for {}", of(50.0));
}
