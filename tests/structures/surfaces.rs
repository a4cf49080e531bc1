//! Surfaces of masks: closed, outside out, and of the area and volume that school says.

use std::f64::consts::PI;

use glam::DVec3;
use relief_annotation::{Decimation, MeshError, Smoothing, TriangleMesh, surface_nets};
use relief_volume::{Grid, Mask, PhantomKind, PhantomRecipe};

use super::shapes::{grid, mask, noise};

const GRIDS: [([f64; 3], [f64; 3], bool); 4] = [
    ([1.0, 1.0, 1.0], [0.0; 3], false),
    ([0.7, 0.7, 1.5], [0.4, -0.3, 0.9], false),
    ([0.7, 0.7, 1.5], [0.4, -0.3, 0.9], true),
    ([1.3, 0.6, 0.9], [-1.1, 0.5, 0.2], false),
];

#[test]
fn a_sphere_of_80_mm_has_its_volume_and_smoothed_its_area() {
    let volume = PhantomRecipe::new(PhantomKind::Sphere).make().volume;
    let mask = Mask::of_range(&volume, [-250, 600]);
    let (truth_ml, truth_mm2) = (4.0 / 3.0 * PI * 512.0, 4.0 * PI * 6400.0);
    let mesh = surface_nets(&mask).unwrap();
    let raw = mesh.measures();
    let smooth = mesh.smoothed(Smoothing::default()).unwrap();
    let smooth_measures = smooth.measures();
    let worst = smooth.vertices.iter().map(|v| (v.xyz.length() - 80.0).abs()).fold(0.0, f64::max);
    let light = smooth.decimated(Decimation::to(5000)).unwrap();
    let light_measures = light.measures();
    println!(
        "voxels {:.2} ml; nets {:+.3} % ml, {:+.2} % mm2; smoothed {:+.3} %, {:+.2} %, worst {worst:.3} mm; {} triangles {:+.3} %, {:+.2} %",
        mask.volume_ml(),
        100.0 * (raw.volume_ml.unwrap() / truth_ml - 1.0),
        100.0 * (raw.area_mm2 / truth_mm2 - 1.0),
        100.0 * (smooth_measures.volume_ml.unwrap() / truth_ml - 1.0),
        100.0 * (smooth_measures.area_mm2 / truth_mm2 - 1.0),
        light.triangles.len(),
        100.0 * (light_measures.volume_ml.unwrap() / truth_ml - 1.0),
        100.0 * (light_measures.area_mm2 / truth_mm2 - 1.0),
    );
    for measures in [raw, smooth_measures, light_measures] {
        assert!(measures.is_manifold && measures.euler == Some(2), "{measures:?}");
        assert!((measures.volume_ml.unwrap() / truth_ml - 1.0).abs() < 0.003, "{measures:?}");
    }
    assert!((raw.area_mm2 / truth_mm2 - 1.0).abs() < 0.08, "steps of voxels add to the area: {raw:?}");
    for measures in [smooth_measures, light_measures] {
        assert!((measures.area_mm2 / truth_mm2 - 1.0).abs() < 0.01, "{measures:?}");
    }
    assert!(worst < 0.6, "{worst} mm of a voxel of 1 mm");
    assert!(light.triangles.len() <= 5000);
}

/// Invariant: Every mask has a closed manifold surface that is oriented outwards, on any grid;
/// results do not depend on the number of threads.
#[test]
fn ellipsoids_lie_where_they_are_on_oblique_and_mirrored_grids() {
    let radii = DVec3::new(22.0, 15.0, 11.0);
    let center = DVec3::new(3.0, -5.0, 2.0);
    let is_in = |place: DVec3| ((place - center) / radii).length() <= 1.0;
    let truth_ml = 4.0 / 3.0 * PI * radii.element_product() / 1000.0;
    for (spacing, angles, is_mirrored) in GRIDS {
        let mask = mask(&grid(64.0, spacing, angles, is_mirrored), is_in);
        let mesh = surface_nets(&mask).unwrap().smoothed(Smoothing::default()).unwrap();
        let measures = mesh.measures();
        assert!(measures.is_manifold && measures.euler == Some(2), "{measures:?}");
        let volume_ml = measures.volume_ml.unwrap();
        assert!((volume_ml / truth_ml - 1.0).abs() < 0.015, "{volume_ml} of {truth_ml} ml: outside is out");
        assert!((volume_ml / mask.volume_ml() - 1.0).abs() < 0.015);
        let [low, high] = mesh.span();
        for (found, expected) in [(low, center - radii), (high, center + radii)] {
            assert!((found - expected).abs().max_element() < 1.0, "{found} for {expected}");
        }
        // Every corner is on the ellipsoid to a voxel's half diagonal.
        let half = spacing.iter().map(|step| step * step).sum::<f64>().sqrt() / 2.0;
        for vertex in &mesh.vertices {
            let from = vertex.xyz - center;
            let on = from / (from / radii).length();
            assert!((from - on).length() < half * 1.2, "{from}");
        }
    }
}

#[test]
fn balls_rings_and_hollows_have_their_euler_characteristic() {
    let grid = grid(60.0, [1.0, 1.2, 0.9], [0.2, 0.3, -0.4], false);
    let euler = |is_in: &dyn Fn(DVec3) -> bool| {
        let measures = surface_nets(&mask(&grid, is_in)).unwrap().measures();
        assert!(measures.is_manifold, "{measures:?}");
        measures.euler.unwrap()
    };
    let ball = |place: DVec3, x: f64, radius: f64| place.distance(DVec3::new(x, 0.0, 0.0)) <= radius;
    assert_eq!(euler(&|p| ball(p, 0.0, 20.0)), 2);
    assert_eq!(euler(&|p| (p.truncate().length() - 18.0).hypot(p.z) <= 6.0), 0, "a ring");
    assert_eq!(euler(&|p| ball(p, -14.0, 9.0) || ball(p, 14.0, 9.0)), 4);
    assert_eq!(euler(&|p| ball(p, 0.0, 20.0) && !ball(p, 3.0, 8.0)), 4, "a hollow has a surface of its own");
}

/// Invariant: Every mask has a closed manifold surface that is oriented outwards, on any grid;
/// results do not depend on the number of threads.
#[test]
fn every_mask_has_a_closed_manifold_whatever_its_voxels() {
    let mut knotted = 0;
    for (seed, percent) in (1..).zip([3, 10, 25, 40, 50, 60, 75, 90, 97, 100]) {
        for dims in [[70, 12, 9], [5, 31, 17], [64, 2, 1], [1, 1, 1]] {
            let mask = noise(dims, percent, seed);
            if mask.voxels() == 0 {
                assert_eq!(surface_nets(&mask), Err(MeshError::Empty));
                continue;
            }
            let mesh = surface_nets(&mask).unwrap();
            let measures = mesh.measures();
            assert!(measures.is_manifold, "{percent} % of {dims:?}: {measures:?}");
            let volume_ml = measures.volume_ml.unwrap();
            assert!(volume_ml > 0.0 && volume_ml <= mask.volume_ml() * 1.2, "{volume_ml} {mask:?}");
            // Quadrilaterals have two triangles and a corner for each but where sheets meet twice.
            knotted += usize::from(mesh.triangles.len() % 2 == 1 || has_fan_of_more(&mesh));
        }
    }
    assert!(knotted > 5, "noise has sheets that meet twice: {knotted}");
}

/// Middles of knots are the last corners that are made, each with five triangles or more.
fn has_fan_of_more(mesh: &TriangleMesh) -> bool {
    let last = mesh.vertices.len() as u32 - 1;
    mesh.triangles.iter().filter(|corners| corners[2] == last).count() >= 5
}

#[test]
fn sheets_that_meet_twice_get_corners_of_their_own() {
    // Two voxels across a face's corners, joined by bridges on both sides of the face: the surface
    // goes through the ring.
    let mut mask = Mask::empty(Grid::axis_aligned([2, 2, 3], [1.0; 3], [0.0; 3]).unwrap());
    for k in [0, 2] {
        [[0, 0, k], [1, 0, k], [1, 1, k]].into_iter().for_each(|index| mask.set(index, true));
    }
    [[0, 0, 1], [1, 1, 1]].into_iter().for_each(|index| mask.set(index, true));
    let measures = surface_nets(&mask).unwrap().measures();
    assert!(measures.is_manifold && measures.euler == Some(0), "a ring: {measures:?}");
}

/// Invariant: Every mask has a closed manifold surface that is oriented outwards, on any grid;
/// results do not depend on the number of threads.
#[test]
fn meshes_are_the_same_on_any_number_of_threads() {
    let mask = noise([90, 40, 50], 35, 4);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mesh = surface_nets(&mask).unwrap().smoothed(Smoothing { rounds: 3 }).unwrap();
            let measures = mesh.measures();
            (mesh, measures)
        })
    };
    let alone = on(1);
    assert!(on(2) == alone && on(5) == alone);
}

#[test]
fn the_asymmetric_phantom_is_not_mirrored() {
    let phantom = PhantomRecipe::new(PhantomKind::Axes).make();
    let mesh = surface_nets(&Mask::of_range(&phantom.volume, [50, i16::MAX])).unwrap();
    assert!(mesh.measures().is_manifold);
    // Six balls; each has corners around its own centre and nowhere else.
    let mut seen = 0;
    for surface in &phantom.truth.surfaces {
        if let relief_volume::SurfaceShape::Sphere { center_mm, radius_mm } = &surface.shape {
            let center = DVec3::from(*center_mm);
            let own = mesh.vertices.iter().filter(|vertex| vertex.xyz.distance(center) < radius_mm + 2.0);
            let distances: Vec<f64> = own.map(|vertex| vertex.xyz.distance(center)).collect();
            assert!(distances.len() > 50, "nothing at {center}");
            assert!(distances.iter().all(|distance| (distance - radius_mm).abs() < 1.5), "{center}");
            seen += distances.len();
        }
    }
    assert_eq!(seen, mesh.vertices.len());
}

#[test]
fn decimation_keeps_surfaces_closed_and_volumes_nearly() {
    // A comb of thin rods: what collapses most easily into edges of four triangles.
    let grid = grid(50.0, [1.0; 3], [0.0; 3], false);
    let is_in = |p: DVec3| {
        let rod = |x: f64| (p.x - x).hypot(p.y) <= 1.2 && p.z.abs() < 20.0;
        (-4..=4).any(|n| rod(f64::from(n) * 5.0)) || (p.z.abs() < 3.0 && p.y.abs() < 3.0 && p.x.abs() < 23.0)
    };
    let mesh = surface_nets(&mask(&grid, is_in)).unwrap();
    let before = mesh.measures();
    for triangles in [mesh.triangles.len() / 2, mesh.triangles.len() / 10, 200, 4] {
        let light = mesh.decimated(Decimation::to(triangles)).unwrap();
        let measures = light.measures();
        println!(
            "{} of {} triangles wanted {triangles}: {measures:?}",
            light.triangles.len(),
            mesh.triangles.len()
        );
        assert!(measures.is_manifold, "{measures:?}");
        assert!(light.triangles.len() < mesh.triangles.len());
    }
    let light = mesh.decimated(Decimation { triangles: 4, error_mm: 0.2 }).unwrap();
    let change = light.measures().volume_ml.unwrap() / before.volume_ml.unwrap() - 1.0;
    assert!(change.abs() < 0.05 && light.triangles.len() < mesh.triangles.len() / 2, "{change}");
    assert!(mesh.decimated(Decimation::to(3)).is_err());
    assert!(mesh.decimated(Decimation { triangles: 100, error_mm: f64::NAN }).is_err());
    assert!(mesh.smoothed(Smoothing { rounds: 201 }).is_err());
}

#[test]
fn noise_is_decimated_without_coming_apart() {
    for (seed, percent) in [(1, 25), (2, 40), (3, 60), (4, 85)] {
        let mesh = surface_nets(&noise([24, 22, 20], percent, seed)).unwrap();
        for share in [2, 5, 20, 100] {
            let light = mesh.decimated(Decimation::to(mesh.triangles.len() / share)).unwrap();
            let measures = light.measures();
            println!(
                "{percent} %: {} to {} triangles, {measures:?}",
                mesh.triangles.len(),
                light.triangles.len()
            );
            assert!(measures.is_manifold && light.check().is_ok(), "{percent} %, 1/{share}: {measures:?}");
            assert!(light.triangles.len() < mesh.triangles.len());
            let same = mesh.decimated(Decimation::to(mesh.triangles.len() / share)).unwrap();
            assert!(same == light);
        }
    }
}

#[test]
fn open_and_broken_meshes_say_so() {
    let corners = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0]];
    let vertices = corners.map(|[x, y, z]| relief_base::Point::new(x, y, z)).to_vec();
    let closed = TriangleMesh { vertices, triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] };
    let measures = closed.measures();
    assert!((measures.volume_ml.unwrap() - 1.0 / 6.0).abs() < 1e-12 && measures.euler == Some(2));
    let area = 150.0 + 3f64.sqrt() / 4.0 * 200.0;
    assert!((measures.area_mm2 - area).abs() < 1e-9);
    let mut open = closed.clone();
    open.triangles.pop();
    assert_eq!((open.measures().volume_ml, open.measures().is_closed), (None, false));
    let mut turned = closed.clone();
    turned.triangles[1] = [0, 3, 1];
    assert!(!turned.measures().is_closed, "one triangle runs the other way");
    let mut inside_out = closed.clone();
    inside_out.triangles.iter_mut().for_each(|corners| corners.reverse());
    assert!((inside_out.measures().volume_ml.unwrap() + 1.0 / 6.0).abs() < 1e-12);
    // Two tetrahedra that share a corner: closed, but no manifold.
    let mut pinched = closed.clone();
    pinched.vertices.extend(closed.vertices[1..].iter().map(|v| relief_base::Point::from_xyz(-v.xyz)));
    pinched.triangles.extend([[0, 4, 5], [0, 6, 4], [0, 5, 6], [4, 6, 5]]);
    let measures = pinched.measures();
    assert!(measures.is_closed && !measures.is_manifold, "{measures:?}");
    assert_eq!(TriangleMesh::default().measures().volume_ml, None);
}
