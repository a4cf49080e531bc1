//! Projections with closed forms: extremes of a cone, sums through a slab, what clip planes and
//! misses do to them.

use crate::common;
use relief_base::{Point, Vector};
use relief_render::{
    Clip, ClipPlane, EmptySpaceSkipping, Mode, RenderRequest, RenderedFrame, SceneFile, Shading,
};
use relief_volume::{
    Camera, ControlPoint, Grid, Orbit, PhantomKind, Projection, TransferFunction, Volume, Window,
};

use super::{in_mode, renderer};

/// Of `EYE_MM`, along y.
const EYE_MM: f64 = 600.0;

fn looking_along_y(volume: &Volume, mode: Mode, transfer: TransferFunction, height_mm: f64) -> RenderRequest {
    let (eye, at) = (Point::new(0.0, -EYE_MM, 0.0), Point::new(0.0, 0.0, 0.0));
    let projection = Projection::Orthographic { height_mm };
    let camera = Camera::new(eye, at, Vector::new(0.0, 0.0, 1.0), projection).unwrap();
    let scene = SceneFile::default().with_size([31, 31]).resolve(volume.grid(), &Orbit::default()).unwrap();
    RenderRequest { camera, mode, transfer, shading: Shading::NONE, sample_distance_mm: 0.5, ..scene.request }
}

fn white(points: &[(f64, f64)]) -> TransferFunction {
    let point = |&(hu, opacity): &(f64, f64)| ControlPoint { hu, rgba: [1.0, 1.0, 1.0, opacity] };
    TransferFunction::new(points.iter().map(point).collect(), 1.0).unwrap()
}

/// Of each pixel: mm from the picture's middle, its red and its depth.
fn pixels(frame: &RenderedFrame, height_mm: f64) -> Vec<(f64, f64, f64)> {
    let off_axis = |at: u32| (f64::from(at) + 0.5) / 31.0 * height_mm - height_mm / 2.0;
    let colors_and_depths = frame.color_rgba.iter().zip(&frame.depth_mm);
    (0u32..)
        .zip(colors_and_depths)
        .map(|(i, (rgba, mm))| (off_axis(i % 31).hypot(off_axis(i / 31)), f64::from(rgba[0]), f64::from(*mm)))
        .collect()
}

/// HU at the centre of a cone are -9000 and rise by 300 per mm, or the negative of that: steep, so
/// that whole HU do not flatten the bottom of a ray that passes far off. Voxels lie on y = 0, since
/// between two layers all would be bottom.
fn cone(sign: f64) -> Volume {
    let grid = Grid::axis_aligned([63; 3], [1.5; 3], [-46.5; 3]).unwrap();
    let hu = |i: usize, j: usize, k: usize| {
        let position = grid.patient_from_voxel() * Point::new(i as f64, j as f64, k as f64);
        (sign * (300.0 * position.xyz.length() - 9000.0)).round() as i16
    };
    let voxels = (0..63usize.pow(3)).map(|at| hu(at % 63, at / 63 % 63, at / 63 / 63)).collect();
    Volume::new(grid, voxels).unwrap()
}

/// Invariant: Extremes and sums along a ray follow their closed forms at any sample distance,
/// within clip planes.
#[test]
fn extremes_of_a_cone_lie_where_rays_pass_its_axis() {
    let Some(mut renderer) = renderer("extremes_of_a_cone") else { return };
    for (mode, sign) in [(Mode::Minip, 1.0), (Mode::Mip, -1.0)] {
        let volume = cone(sign);
        let window = Window::grey(0.0, 21000.0).translucent().unwrap();
        let mut request = looking_along_y(&volume, mode, window, 60.0);
        request.sample_distance_mm = 0.7;
        let frame = renderer.render(&volume, &request).unwrap();
        for (off_mm, red, depth_mm) in pixels(&frame, 60.0) {
            // The extreme is passed at the ray's closest approach, in the plane y = 0.
            let expected = 255.0 * (sign * (300.0 * off_mm - 9000.0) + 10500.0) / 21000.0;
            assert!((red - expected).abs() < 3.0, "{mode:?}, {off_mm} mm off: {red} for {expected}");
            assert!((depth_mm - EYE_MM).abs() < 0.25, "{mode:?}, {off_mm} mm off: {depth_mm} mm");
        }
    }
}

/// Invariant: Extremes and sums along a ray follow their closed forms at any sample distance,
/// within clip planes.
#[test]
fn clipped_values_are_no_extremes() {
    let Some(mut renderer) = renderer("clipped_values_are_no_extremes") else { return };
    for (mode, sign) in [(Mode::Minip, 1.0), (Mode::Mip, -1.0)] {
        let volume = cone(sign);
        let window = Window::grey(0.0, 21000.0).translucent().unwrap();
        let mut request = looking_along_y(&volume, mode, window, 60.0);
        // The part behind y = 20 mm remains: the extreme is on the plane.
        let plane = ClipPlane { point: Point::new(0.0, 20.0, 0.0), normal: Vector::new(0.0, 1.0, 0.0) };
        request.clip = Clip { planes: vec![plane], ..Clip::default() };
        let frame = renderer.render(&volume, &request).unwrap();
        for (off_mm, red, depth_mm) in pixels(&frame, 60.0) {
            let expected = 255.0 * (sign * (300.0 * off_mm.hypot(20.0) - 9000.0) + 10500.0) / 21000.0;
            assert!((red - expected).abs() < 4.0, "{mode:?}, {off_mm} mm off: {red} for {expected}");
            assert!((depth_mm - EYE_MM - 20.0).abs() <= 0.5, "{mode:?}, {off_mm} mm off: {depth_mm} mm");
        }
    }
}

/// The slab: 100 mm of 300 HU across y in air of -1000 HU, rays of 255 mm between outermost voxel
/// centres. At its faces values are linear over 1 mm, so brightness times an opacity that is linear
/// too adds 1/3 mm of the slab's own there.
const SLAB_MM: f64 = 99.0 + 2.0 / 3.0;

/// Invariant: Extremes and sums along a ray follow their closed forms at any sample distance,
/// within clip planes.
#[test]
fn sums_through_a_slab_are_those_of_its_thickness() {
    let Some(mut renderer) = renderer("sums_through_a_slab") else { return };
    let volume = common::volume(PhantomKind::Slab, 256);
    let window = Window::grey(-500.0, 1600.0).translucent().unwrap();
    let mean_hu = (100.0 * 300.0 - 155.0 * 1000.0) / 255.0;
    let of_the_window = (mean_hu + 500.0 + 800.0) / 1600.0;
    let faint = white(&[(-1000.0, 0.0), (300.0, 0.004)]);
    let strong = white(&[(-1000.0, 0.0), (300.0, 0.9)]);
    for (mode, transfer, expected) in [
        (Mode::Mean, window, 255.0 * of_the_window),
        (Mode::Average, strong.clone(), 255.0 * 0.9 * SLAB_MM / 255.0),
        (Mode::Additive, faint, 255.0 * 0.004 * SLAB_MM),
        (Mode::Additive, strong, 255.0),
    ] {
        for sample_distance_mm in [0.25, 0.5, 1.0, 1.7] {
            let request = looking_along_y(&volume, mode, transfer.clone(), 60.0);
            let request = RenderRequest { sample_distance_mm, ..request };
            let frame = renderer.render(&volume, &request).unwrap();
            for (_, red, depth_mm) in pixels(&frame, 60.0) {
                let what = format!("{mode:?} at {sample_distance_mm} mm");
                assert!((red - expected).abs() <= 1.5, "{what}: {red} for {expected}");
                // The slab's middle: air has no brightness.
                assert!((depth_mm - EYE_MM).abs() < 0.6, "{what}: {depth_mm} mm");
            }
        }
    }
}

#[test]
fn additive_counts_opacity_per_its_unit() {
    let Some(mut renderer) = renderer("additive_counts_opacity_per_its_unit") else { return };
    let volume = common::volume(PhantomKind::Slab, 256);
    let mut reds = Vec::new();
    for (opacity, unit_mm) in [(0.004, 1.0), (0.04, 10.0)] {
        let point = |hu, a| ControlPoint { hu, rgba: [1.0, 1.0, 1.0, a] };
        let points = vec![point(-1000.0, 0.0), point(300.0, opacity)];
        let transfer = TransferFunction::new(points, unit_mm).unwrap();
        let request = looking_along_y(&volume, Mode::Additive, transfer, 60.0);
        reds.push(renderer.render(&volume, &request).unwrap().color_rgba[400][0]);
    }
    assert!(reds[0] > 90 && reds[0].abs_diff(reds[1]) <= 1, "{reds:?}");
}

#[test]
fn rays_that_meet_nothing_show_the_background() {
    let Some(mut renderer) = renderer("rays_that_meet_nothing") else { return };
    let volume = common::volume(PhantomKind::Sphere, 64);
    for mode in Mode::RAYS {
        let window = Window::grey(-500.0, 1600.0).translucent().unwrap();
        let mut request = in_mode(mode, looking_along_y(&volume, mode, window, 2000.0));
        request.background_rgb = [0.2, 0.4, 0.6];
        let frame = renderer.render(&volume, &request).unwrap();
        assert_eq!(frame.color_rgba[0], [51, 102, 153, 0], "{mode:?}");
        assert_eq!(frame.depth_mm[0], f32::INFINITY, "{mode:?}");
        assert!(frame.depth_mm[15 * 31 + 15].is_finite(), "{mode:?} shows the sphere");
        // Halves of a byte in pixels filled in beside the cast ones, and 127.5: rounded to even
        // numbers everywhere.
        request.background_rgb = [0.3, 0.7, 0.5];
        let [cast, filled] = [EmptySpaceSkipping::Off, EmptySpaceSkipping::On]
            .map(|skipping| renderer.render_with(&volume, &request, skipping).unwrap());
        assert_eq!(filled.color_rgba[0], [76, 178, 128, 0], "{mode:?}");
        assert!(cast.color_rgba == filled.color_rgba, "{mode:?}");
    }
}

#[test]
fn greys_of_nothing_are_black_and_hit_nothing() {
    let Some(mut renderer) = renderer("greys_of_nothing") else { return };
    let volume = common::volume(PhantomKind::Sphere, 64);
    for mode in [Mode::Average, Mode::Additive] {
        let mut request = looking_along_y(&volume, mode, white(&[(2000.0, 0.0), (3000.0, 1.0)]), 60.0);
        request.background_rgb = [1.0; 3];
        for skipping in [EmptySpaceSkipping::On, EmptySpaceSkipping::Off] {
            let frame = renderer.render_with(&volume, &request, skipping).unwrap();
            assert!(frame.color_rgba.iter().all(|rgba| *rgba == [0, 0, 0, 255]), "{mode:?}");
            assert!(frame.depth_mm.iter().all(|mm| *mm == f32::INFINITY), "{mode:?}");
        }
    }
}
