//! The sphere that is cut away: the walls of its hole are where the sphere is, nothing else
//! changes, and moving it uploads nothing.

use crate::common;
use relief_base::{Point, Vector};
use relief_render::{ClipSphere, DepthRule, EmptySpaceSkipping, Mode, RenderRequest, SceneFile, Shading};
use relief_volume::{Camera, ControlPoint, Orbit, PhantomKind, Projection, TransferFunction, Volume, Window};

use super::twin::{compare, oblique_head, request as head_request};
use super::{in_mode, renderer};

const RADIUS_MM: f64 = 30.0;
const SIDE: u32 = 96;
const HEIGHT_MM: f64 = 96.0;

/// The slab, opaque, seen along y from 600 mm: its face is 550 mm away.
fn slab_request(volume: &Volume, depth: DepthRule) -> RenderRequest {
    let scene =
        SceneFile::default().with_size([SIDE, SIDE]).resolve(volume.grid(), &Orbit::default()).unwrap();
    let (eye, at) = (Point::new(0.0, -600.0, 0.0), Point::new(0.0, 0.0, 0.0));
    let parallel = Projection::Orthographic { height_mm: HEIGHT_MM };
    let point = |hu: f64, opacity: f64| ControlPoint { hu, rgba: [1.0, 1.0, 1.0, opacity] };
    RenderRequest {
        camera: Camera::new(eye, at, Vector::new(0.0, 0.0, 1.0), parallel).unwrap(),
        transfer: TransferFunction::new(vec![point(-351.0, 0.0), point(-349.0, 1.0)], 1.0).unwrap(),
        shading: Shading::NONE,
        sample_distance_mm: 1.0,
        depth,
        ..scene.request
    }
}

/// A hole in the middle of the slab's face.
fn hole() -> ClipSphere {
    ClipSphere { center: Point::new(0.0, -50.0, 0.0), radius_mm: RADIUS_MM }
}

/// Invariant: The wall of a cut sphere lies on the sphere, and moving the sphere uploads nothing.
#[test]
fn the_far_wall_of_the_hole_is_where_the_sphere_is() {
    let Some(mut renderer) = renderer("the_far_wall_of_the_hole") else { return };
    let volume = common::volume(PhantomKind::Slab, 256);
    for depth in ["first-hit", "threshold", "wysiwyp", "max-opacity", "most-contributing"] {
        let mut request = slab_request(&volume, DepthRule::from_name(depth).unwrap());
        let whole = renderer.render(&volume, &request).unwrap();
        request.clip.sphere = Some(hole());
        let frame = renderer.render(&volume, &request).unwrap();
        let mut walls = 0;
        for pixel in (0..SIDE).flat_map(|row| (0..SIDE).map(move |column| [column, row])) {
            let off = pixel.map(|at| (f64::from(at) + 0.5) / f64::from(SIDE) * HEIGHT_MM - HEIGHT_MM / 2.0);
            let from_axis = off[0].hypot(off[1]);
            let found = f64::from(frame.depth_at(pixel).0);
            if from_axis < 0.98 * RADIUS_MM {
                let expected = 550.0 + (RADIUS_MM * RADIUS_MM - from_axis * from_axis).sqrt();
                // Accumulation over opaque samples starts at the wall; half a part of 1/64 mm is
                // the threshold's own step.
                assert!(
                    (found - expected).abs() < 0.02,
                    "{depth} at {pixel:?}: {found} mm for {expected} mm"
                );
                let picked = frame.pick(pixel).unwrap();
                assert!((picked.distance(hole().center) - RADIUS_MM).abs() < 0.02, "{depth}: {picked:?}");
                walls += 1;
            } else if from_axis > 1.02 * RADIUS_MM {
                assert_eq!(frame.depth_at(pixel), whole.depth_at(pixel), "{depth}: beside the hole");
            }
        }
        assert!(walls > 2500, "{walls} pixels see the hole");
    }
}

#[test]
fn a_hole_right_through_shows_what_is_behind() {
    let Some(mut renderer) = renderer("a_hole_right_through") else { return };
    let volume = common::volume(PhantomKind::Slab, 256);
    let mut request = slab_request(&volume, DepthRule::FirstHit);
    request.clip.sphere = Some(ClipSphere { center: Point::new(0.0, 0.0, 0.0), radius_mm: 70.0 });
    let frame = renderer.render(&volume, &request).unwrap();
    // The slab is 100 mm thick: rays closer than sqrt(70² - 50²) mm to the axis meet only the
    // sphere.
    for pixel in (0..SIDE).flat_map(|row| (0..SIDE).map(move |column| [column, row])) {
        let off = pixel.map(|at| (f64::from(at) + 0.5) - f64::from(SIDE) / 2.0);
        let from_axis = off[0].hypot(off[1]);
        if from_axis < 48.0 {
            assert!(!frame.depth_at(pixel).is_hit(), "{pixel:?} is hit at {from_axis} mm from the axis");
        } else if from_axis > 50.0 {
            assert!(frame.depth_at(pixel).is_hit(), "{pixel:?} misses at {from_axis} mm from the axis");
        }
    }
}

/// Spheres in and around the head: the eye's side, the middle, and one that cuts nothing.
fn spheres(volume: &Volume) -> [ClipSphere; 3] {
    let center = volume.grid().center();
    let at = |x: f64, y: f64, z: f64| center + Vector::new(x, y, z);
    [
        ClipSphere { center: at(40.0, -70.0, 20.0), radius_mm: 45.0 },
        ClipSphere { center, radius_mm: 95.0 },
        ClipSphere { center: at(0.0, 0.0, 4000.0), radius_mm: 50.0 },
    ]
}

#[test]
fn gpu_and_twin_agree_about_the_sphere_in_modes_and_rules() {
    let volume = oblique_head();
    let [side, middle, far] = spheres(&volume);
    for (i, name) in DepthRule::names().iter().enumerate() {
        let depth = DepthRule::from_name(name).unwrap();
        let mut request = RenderRequest { depth, ..head_request(&volume, "bone", [25.0, 0.0][i % 2]) };
        request.clip.sphere = Some([side, middle][i % 2]);
        compare(&volume, &request, &format!("a sphere, {name}"));
    }
    for (mode, sphere) in [
        (Mode::Mip, side),
        (Mode::Mip, middle),
        (Mode::Composite, far),
        (Mode::Average, middle),
        (Mode::Additive, side),
        (Mode::Isosurface, side),
        (Mode::Isosurface, middle),
    ] {
        let mut request = in_mode(mode, head_request(&volume, "soft-tissue", 25.0));
        request.clip.sphere = Some(sphere);
        compare(&volume, &request, &format!("{mode:?} with a sphere"));
    }
    let transfer = Window::grey(-400.0, 2000.0).translucent().unwrap();
    let mut request = RenderRequest { transfer, ..in_mode(Mode::Mean, head_request(&volume, "bone", 0.0)) };
    request.clip.sphere = Some(middle);
    compare(&volume, &request, "the mean with a sphere");
}

/// Invariant: The wall of a cut sphere lies on the sphere, and moving the sphere uploads nothing.
#[test]
fn skipping_changes_no_byte_beside_a_sphere_and_moving_it_uploads_nothing() {
    let Some(mut renderer) = renderer("skipping_changes_no_byte_beside_a_sphere") else { return };
    let volume = common::volume(PhantomKind::Head, 64);
    let orbit = Orbit { azimuth_deg: 30.0, elevation_deg: 10.0, zoom: 1.4, vertical_fov_deg: 22.0 };
    let scene = SceneFile::default().with_preset("skin").with_size([97, 61]);
    let mut request = scene.resolve(volume.grid(), &orbit).unwrap().request;
    let plain = renderer.render(&volume, &request).unwrap();
    for (i, sphere) in spheres(&volume).into_iter().enumerate() {
        request.clip.sphere = Some(sphere);
        request = in_mode(Mode::Composite, request);
        request.depth = DepthRule::Threshold { fraction: 0.5 };
        let on = renderer.render_with(&volume, &request, EmptySpaceSkipping::On).unwrap();
        assert_eq!(on.timings.upload_ms, 0.0, "a sphere that moves uploads nothing");
        assert_eq!(on.color_rgba == plain.color_rgba, i == 2, "spheres 0 and 1 are seen, 2 is far off");
        for (mode, rule) in [
            (Mode::Composite, "threshold"),
            (Mode::Composite, "two-layer"),
            (Mode::Mip, "threshold"),
            (Mode::Additive, "threshold"),
            (Mode::Isosurface, "threshold"),
        ] {
            request = in_mode(mode, request);
            request.depth = DepthRule::from_name(rule).unwrap();
            let [on, off] = [EmptySpaceSkipping::On, EmptySpaceSkipping::Off]
                .map(|skipping| renderer.render_with(&volume, &request, skipping).unwrap());
            let bits = |depth: &[f32]| depth.iter().map(|mm| mm.to_bits()).collect::<Vec<_>>();
            assert!(on.color_rgba == off.color_rgba, "{mode:?}, {rule}, sphere {i}: colour");
            assert!(bits(&on.depth_mm) == bits(&off.depth_mm), "{mode:?}, {rule}, sphere {i}: depth");
        }
    }
}
