//! Pictures whose pixels can be written down: absorption of a slab, depth of a sphere, orientation,
//! step invariance.

use glam::DVec3;

use super::renderer;
use crate::common;
use relief_base::{Point, Vector};
use relief_render::{DepthRule, RenderRequest, RenderedFrame, SceneFile, Shading};
use relief_volume::{
    Camera, ControlPoint, GradientOpacity, Grid, Orbit, Phantom, PhantomKind, Projection, SurfaceShape,
    TransferFunction, Volume,
};

fn white(points: &[(f64, f64)]) -> TransferFunction {
    let point = |&(hu, opacity): &(f64, f64)| ControlPoint { hu, rgba: [1.0, 1.0, 1.0, opacity] };
    TransferFunction::new(points.iter().map(point).collect(), 1.0).unwrap()
}

fn unshaded(volume: &Volume, transfer: TransferFunction, camera: Camera, size_px: [u32; 2]) -> RenderRequest {
    let scene = SceneFile::default().with_size(size_px).resolve(volume.grid(), &Orbit::default()).unwrap();
    RenderRequest { camera, transfer, shading: Shading::NONE, ..scene.request }
}

fn look_along_y(projection: Projection) -> Camera {
    let (eye, at) = (Point::new(0.0, -600.0, 0.0), Point::new(0.0, 0.0, 0.0));
    Camera::new(eye, at, Vector::new(0.0, 0.0, 1.0), projection).unwrap()
}

/// Invariant: Light, absorption and depth follow their closed forms.
#[test]
fn a_slab_absorbs_by_the_exponential_law() {
    let Some(mut renderer) = renderer("a_slab_absorbs_by_the_exponential_law") else { return };
    let volume = common::volume(PhantomKind::Slab, 256);
    let camera = look_along_y(Projection::Orthographic { height_mm: 100.0 });
    for opacity_per_mm in [0.002, 0.01, 0.03] {
        for sample_distance_mm in [0.25, 0.5, 1.0, 2.0] {
            // Opacity proportional to the covered fraction keeps the slab's partial voxels exact in
            // the sum.
            let transfer = white(&[(-1000.0, 0.0), (300.0, opacity_per_mm)]);
            let mut request = unshaded(&volume, transfer, camera, [8, 8]);
            request.sample_distance_mm = sample_distance_mm;
            let frame = renderer.render(&volume, &request).unwrap();
            let expected = 255.0 * (1.0 - (1.0 - opacity_per_mm).powf(100.0));
            for pixel in &frame.color_rgba {
                let off = (f64::from(pixel[0]) - expected).abs();
                assert!(
                    off <= 1.0,
                    "{opacity_per_mm}/mm at {sample_distance_mm} mm: {} for {expected}",
                    pixel[0]
                );
            }
        }
    }
}

/// Invariant: Opacity by gradient is per opacity unit: the picture does not depend on the sample
/// distance.
///
/// Where values rise evenly every sample has the same gradient, here of (2, 4, -6) HU per mm.
#[test]
fn opacity_by_gradient_multiplies_what_a_millimetre_absorbs() {
    let Some(mut renderer) = renderer("opacity_by_gradient_multiplies") else { return };
    let volume = common::volume(PhantomKind::Ramp, 64);
    let camera = look_along_y(Projection::Orthographic { height_mm: 20.0 });
    let magnitude = 56f64.sqrt();
    for (opacity_per_mm, share) in [(0.02, 0.5), (0.05, 0.25), (0.05, 0.0), (0.05, 1.0)] {
        // Up to twice the magnitude there, so that a wrong factor or unit shows.
        let rising = vec![[0.0, 0.0], [2.0 * magnitude, 2.0 * share]];
        let opacity = if share < 1.0 { rising } else { vec![[1.0, share]] };
        let opacity = GradientOpacity::new(opacity).unwrap();
        let transfer = white(&[(-30000.0, opacity_per_mm)]).with_gradient_opacity(opacity);
        for sample_distance_mm in [0.25, 0.5, 1.0, 2.0] {
            let mut request = unshaded(&volume, transfer.clone(), camera, [8, 8]);
            request.sample_distance_mm = sample_distance_mm;
            let (center, arm) = (volume.grid().center().xyz, DVec3::splat(19.9));
            request.clip.add_box(Point::from_xyz(center - arm), Point::from_xyz(center + arm));
            let frame = renderer.render(&volume, &request).unwrap();
            let expected = 255.0 * (1.0 - (1.0 - share * opacity_per_mm).powf(39.8));
            for pixel in &frame.color_rgba {
                // The path is whole samples: up to 0.3 mm off.
                let off = (f64::from(pixel[0]) - expected).abs();
                let what = format!("{opacity_per_mm}/mm times {share} at {sample_distance_mm} mm");
                assert!(off <= 1.5, "{what}: {} for {expected}", pixel[0]);
            }
        }
    }
}

/// Invariant: Light, absorption and depth follow their closed forms.
#[test]
fn a_translucent_slab_has_its_threshold_depth_where_the_law_says() {
    let Some(mut renderer) = renderer("a_translucent_slab_has_its_threshold_depth") else { return };
    let volume = common::volume(PhantomKind::Slab, 256);
    let camera = look_along_y(Projection::Orthographic { height_mm: 100.0 });
    for opacity_per_mm in [0.005f64, 0.02, 0.05] {
        for fraction in [0.1, 0.5, 0.9] {
            let mut request =
                unshaded(&volume, white(&[(-1000.0, 0.0), (300.0, opacity_per_mm)]), camera, [4, 4]);
            request.depth = DepthRule::Threshold { fraction };
            let frame = renderer.render(&volume, &request).unwrap();
            // Accumulated opacity 1 - (1 - a)^s after s mm; the eye is 550 mm before the slab's
            // face.
            let whole = 1.0 - (1.0 - opacity_per_mm).powf(100.0);
            let expected = 550.0 + (1.0 - fraction * whole).ln() / (1.0 - opacity_per_mm).ln();
            for &mm in &frame.depth_mm {
                let off = f64::from(mm) - expected;
                // Early termination ends the ray at 1023/1024: the final opacity is known to that.
                assert!(off.abs() < 0.15, "{opacity_per_mm}/mm, fraction {fraction}: {mm} for {expected} mm");
            }
        }
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

/// Invariant: Light, absorption and depth follow their closed forms.
#[test]
fn a_ball_is_lit_by_the_cosine_of_its_slope() {
    let Some(mut renderer) = renderer("a_ball_is_lit_by_the_cosine_of_its_slope") else { return };
    let volume = cone();
    let camera = look_along_y(Projection::Orthographic { height_mm: 130.0 }).orbited(0.7);
    let mut request = unshaded(&volume, white(&[(399.5, 0.0), (400.5, 1.0)]), camera, [131, 131]);
    request.sample_distance_mm = 0.25;
    request.shading = Shading { ambient: 0.1, diffuse: 0.6, specular: 0.3, shininess: 8.0 };
    let frame = renderer.render(&volume, &request).unwrap();
    let mut compared = 0;
    for (i, pixel) in (0u32..).zip(&frame.color_rgba) {
        let off_axis = |at: u32| (f64::from(at) + 0.5) / 131.0 * 130.0 - 65.0;
        let sine = off_axis(i % 131).hypot(off_axis(i / 131)) / 60.0;
        if sine > 0.9 {
            continue;
        }
        let facing = (1.0 - sine * sine).sqrt();
        let expected = 255.0 * (0.1 + 0.6 * facing + 0.3 * facing.powi(8));
        assert!((f64::from(pixel[0]) - expected).abs() < 2.5, "{} for {expected} at {i}", pixel[0]);
        compared += 1;
    }
    assert!(compared > 9_000, "{compared} pixels");
}

/// Errors in mm of the rendered depth of the 80 mm sphere inside 95 % of its radius.
pub(super) fn sphere_depth_errors(frame: &RenderedFrame) -> Vec<f64> {
    let [width, height] = frame.size_px;
    let eye = frame.camera.eye().xyz;
    let mut errors = Vec::new();
    for pixel in (0..height).flat_map(|row| (0..width).map(move |column| [column, row])) {
        let Some(shown) = frame.pick(pixel) else { continue };
        let (direction, origin) = match frame.camera.projection() {
            Projection::Perspective { .. } => ((shown.xyz - eye).normalize(), eye),
            Projection::Orthographic { .. } => {
                let along = (frame.camera.look_at().xyz - eye).normalize();
                (along, shown.xyz - along * f64::from(frame.depth_at(pixel).0))
            }
        };
        let to_center = -origin;
        let closest = to_center.dot(direction);
        let miss_distance = (to_center.length_squared() - closest * closest).max(0.0).sqrt();
        if miss_distance < 0.95 * 80.0 {
            let true_t = closest - (80.0f64 * 80.0 - miss_distance * miss_distance).sqrt();
            errors.push((shown.xyz - origin).length() - true_t);
        }
    }
    errors
}

/// Invariant: Light, absorption and depth follow their closed forms.
#[test]
fn a_spheres_depth_is_true_to_a_tenth_of_a_millimetre() {
    let Some(mut renderer) = renderer("a_spheres_depth_is_true") else { return };
    let volume = common::volume(PhantomKind::Sphere, 256);
    // Half of a voxel's coverage is the surface: half-way between air and sphere.
    let sharp = white(&[(-250.5, 0.0), (-249.5, 1.0)]);
    let perspective = Projection::Perspective { vertical_fov: 20f64.to_radians() };
    for projection in [perspective, Projection::Orthographic { height_mm: 170.0 }] {
        for depth in [DepthRule::FirstHit, DepthRule::Threshold { fraction: 0.5 }] {
            let camera = look_along_y(projection).orbited(0.4);
            let mut request = unshaded(&volume, sharp.clone(), camera, [240, 240]);
            request.depth = depth;
            request.sample_distance_mm = 1.0;
            let errors = sphere_depth_errors(&renderer.render(&volume, &request).unwrap());
            let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
            let worst = errors.iter().fold(0.0f64, |worst, e| worst.max(e.abs()));
            println!("{depth:?}, {projection:?}: rms {rms:.4} mm, worst {worst:.4} mm");
            assert!(errors.len() > 20_000, "{} pixels see the sphere", errors.len());
            assert!(rms <= 0.1, "{depth:?}: rms {rms} mm");
            assert!(worst <= 0.3, "{depth:?}: worst {worst} mm");
        }
    }
}

/// Invariant: A picture does not depend on its sample distance, within the smoothness of the
/// transfer function.
#[test]
fn the_picture_does_not_depend_on_the_sample_distance() {
    let Some(mut renderer) = renderer("the_picture_does_not_depend_on_the_sample_distance") else { return };
    let volume = common::volume(PhantomKind::Sphere, 256);
    // Opacity changes slowly over the sphere's blurred edge: both distances resolve it.
    let transfer = white(&[(-1000.0, 0.0), (500.0, 0.012)]);
    let camera = look_along_y(Projection::Orthographic { height_mm: 200.0 });
    let mut request = unshaded(&volume, transfer, camera, [120, 120]);
    let mut render = |sample_distance_mm| {
        request.sample_distance_mm = sample_distance_mm;
        renderer.render(&volume, &request).unwrap()
    };
    let fine = render(0.25);
    for sample_distance_mm in [0.5, 1.0] {
        let coarse = render(sample_distance_mm);
        let apart = |(a, b): (&[u8; 4], &[u8; 4])| a[0].abs_diff(b[0]);
        let worst = fine.color_rgba.iter().zip(&coarse.color_rgba).map(apart).max().unwrap();
        assert!(worst <= 1, "{sample_distance_mm} mm differs from 0.25 mm by {worst}/255");
    }
    assert!(fine.color_rgba.iter().any(|pixel| pixel[0] > 200), "the sphere is there");
}

/// Azimuth and elevation in degrees, and the patient axes that then point right, up and towards the
/// eye.
const VIEWS: [(f64, f64, [DVec3; 3]); 6] = [
    (0.0, 0.0, [DVec3::X, DVec3::Z, DVec3::NEG_Y]),
    (90.0, 0.0, [DVec3::Y, DVec3::Z, DVec3::X]),
    (180.0, 0.0, [DVec3::NEG_X, DVec3::Z, DVec3::Y]),
    (-90.0, 0.0, [DVec3::NEG_Y, DVec3::Z, DVec3::NEG_X]),
    (0.0, 90.0, [DVec3::X, DVec3::Y, DVec3::Z]),
    (0.0, -90.0, [DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z]),
];

/// Invariant: Views along the six patient axes show the correct side, not a mirror image.
#[test]
fn six_axis_views_prove_orientation_and_handedness() {
    let Some(mut renderer) = renderer("six_axis_views_prove_orientation_and_handedness") else { return };
    let phantom = Phantom::axes(64).unwrap();
    for (azimuth_deg, elevation_deg, axes) in VIEWS {
        for vertical_fov_deg in [0.0, 20.0] {
            let orbit = Orbit { azimuth_deg, elevation_deg, zoom: 1.0, vertical_fov_deg };
            let scene = SceneFile::default().with_size([151, 151]);
            let request = scene.resolve(phantom.volume.grid(), &orbit).unwrap().request;
            for surface in &phantom.truth.surfaces {
                let SurfaceShape::Sphere { center_mm, radius_mm } = surface.shape else { panic!("a ball") };
                let request = alone(request.clone(), center_mm.into());
                let frame = renderer.render(&phantom.volume, &request).unwrap();
                let what = format!("{} from {azimuth_deg}, {elevation_deg}", surface.name);
                check_ball(&frame, axes, center_mm.into(), radius_mm, &what);
            }
        }
    }
}

/// The request with everything clipped away but the ball at `center`, which is opaque.
fn alone(mut request: RenderRequest, center: DVec3) -> RenderRequest {
    let arm = DVec3::splat(20.0);
    request.clip.add_box(Point::from_xyz(center - arm), Point::from_xyz(center + arm));
    request.transfer = white(&[(-400.0, 0.0), (-300.0, 1.0)]);
    request.shading = Shading::NONE;
    request
}

/// The middle of the visible pixels is the ball's centre along the six views' own axes.
fn check_ball(frame: &RenderedFrame, axes: [DVec3; 3], center: DVec3, radius_mm: f64, what: &str) {
    let width = frame.size_px[0];
    let seen: Vec<(f64, f64, f64)> = (0u32..)
        .zip(&frame.depth_mm)
        .filter(|(_, mm)| mm.is_finite())
        .map(|(i, mm)| (f64::from(i % width) + 0.5, f64::from(i / width) + 0.5, f64::from(*mm)))
        .collect();
    assert!(seen.len() > 20, "{what} is not seen");
    let mean = |pick: fn(&(f64, f64, f64)) -> f64| seen.iter().map(pick).sum::<f64>() / seen.len() as f64;
    let nearest = seen.iter().map(|p| p.2).fold(f64::INFINITY, f64::min);
    let [right, up, towards] = axes.map(|axis| axis.dot(center));
    let depth = frame.camera.distance_mm() - towards;
    let scale = match frame.camera.projection() {
        Projection::Perspective { vertical_fov } => depth * (vertical_fov / 2.0).tan(),
        Projection::Orthographic { height_mm } => height_mm / 2.0,
    };
    let (u, v) = (75.5 * (1.0 + right / scale), 75.5 * (1.0 - up / scale));
    let (found_u, found_v) = (mean(|p| p.0), mean(|p| p.1));
    assert!(
        (found_u - u).abs() < 1.0 && (found_v - v).abs() < 1.0,
        "{what}: {found_u}, {found_v} for {u}, {v}"
    );
    assert!((nearest - (depth - radius_mm)).abs() < 0.6, "{what}: {nearest} mm for {}", depth - radius_mm);
}
