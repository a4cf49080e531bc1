//! Balls, slabs and blobs: where surfaces, edges and extremes are is known.

use glam::DVec3;

use super::{snapped, to};
use crate::common;
use relief_annotation::SnapFeature;
use relief_base::{Patient, Transform, Voxel};
use relief_volume::{Grid, PhantomKind, Volume};

/// Half of the way from air to the ball or slab: where anti-aliased voxels have their edge.
const BALL_HU: f64 = -250.0;
const SLAB_HU: f64 = -350.0;

/// Directions all around, none of them along an axis.
fn directions(count: u32) -> impl Iterator<Item = DVec3> {
    (0..count).map(move |i| {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
        let (sin, cos) = (f64::from(i) * 2.399_963).sin_cos();
        let flat = (1.0 - z * z).sqrt();
        DVec3::new(flat * cos, flat * sin, z)
    })
}

/// A ball whose edge is as soft as a scanner's: a Gaussian of `soft_mm` over a step.
fn soft_ball(radius_mm: f64, spacing_mm: f64, soft_mm: f64) -> Volume {
    let count = (2.0 * radius_mm / spacing_mm).ceil() as usize + 24;
    let origin = [-(count as f64 - 1.0) / 2.0 * spacing_mm + 0.13; 3];
    let grid = Grid::axis_aligned([count; 3], [spacing_mm; 3], origin).unwrap();
    let place = |index: usize| origin[0] + index as f64 * spacing_mm;
    let mut hus = Vec::with_capacity(count * count * count);
    for k in 0..count {
        for j in 0..count {
            for i in 0..count {
                let off = DVec3::new(place(i), place(j), place(k)).length() - radius_mm;
                hus.push((BALL_HU - 750.0 * erf(off / soft_mm / 2f64.sqrt())).round() as i16);
            }
        }
    }
    Volume::new(grid, hus).unwrap()
}

/// The error function by its series.
fn erf(x: f64) -> f64 {
    if x.abs() > 5.0 {
        return x.signum();
    }
    let (mut term, mut sum) = (x, x);
    for n in 1..120 {
        term *= -x * x / f64::from(n);
        sum += term / f64::from(2 * n + 1);
    }
    sum * 2.0 / std::f64::consts::PI.sqrt()
}

/// Invariant: Snapping finds the surfaces, edges and extremes of closed forms and of an exhaustive
/// search, or reports that it found nothing.
#[test]
fn a_balls_surface_is_met_along_rays_and_at_its_nearest_point() {
    // Linear interpolation between voxels displaces sharp edges by up to 0.086 voxel in any
    // program; soft edges stay.
    let sharp = (common::volume(PhantomKind::Sphere, 256), 80.0, [0.05, 0.1, 0.7]);
    let soft = (soft_ball(15.0, 0.8, 0.9), 15.0, [0.02, 0.04, 0.1]);
    for (volume, radius_mm, [rms_limit, worst_limit, aside_limit]) in [sharp, soft] {
        let (mut squares, mut worst) = (0.0, 0.0f64);
        for (number, direction) in (0..).zip(directions(60)) {
            let off = f64::from(number % 13) * 0.4 - 2.4;
            let from = direction * (radius_mm + off);
            let how = to(SnapFeature::Surface { hu: BALL_HU }, 4.0);
            let nearest = snapped(&volume, from.into(), None, &how).at.xyz;
            // A ray across the surface at an angle of its own.
            let ray = (direction + DVec3::new(0.3, -0.2, 0.4)).normalize();
            let found = snapped(&volume, from.into(), Some((ray * 7.0).into()), &how);
            let across = (found.at.xyz - from).cross(ray).length();
            assert!(across < 1e-9 && (found.hu - BALL_HU).abs() < 0.1, "{direction}: {found:?}");
            for off in [nearest.length() - radius_mm, found.at.xyz.length() - radius_mm] {
                squares += off * off;
                worst = worst.max(off.abs());
            }
            // Of facets between voxels another one may be nearest.
            let aside = nearest.angle_between(direction) * radius_mm;
            assert!(aside < aside_limit, "{direction}, {off} mm off: {nearest} is {aside} mm aside");
        }
        let rms = (squares / 120.0).sqrt();
        println!("ball of {radius_mm} mm: {rms:.4} mm rms, {worst:.4} mm at most");
        assert!(rms < rms_limit && worst < worst_limit, "{rms} rms, {worst} at most");
    }
}

#[test]
fn a_balls_edge_is_where_its_surface_is() {
    let volume = common::volume(PhantomKind::Sphere, 256);
    for (number, direction) in (0..).zip(directions(24)) {
        let from = direction * (80.0 + f64::from(number % 7) * 0.5 - 1.5);
        let how = to(SnapFeature::Gradient, 4.0);
        let found = snapped(&volume, from.into(), None, &how);
        assert!((found.at.xyz.length() - 80.0).abs() < 0.05, "{direction}: {found:?}");
        assert!(found.at.xyz.distance(direction * 80.0) < 0.1, "{direction}: {found:?}");
        // 1500 HU through a Gaussian of 1 mm and a voxel's own width: 1500 / sqrt(2 pi (1 + 1/12)).
        assert!((found.gradient_hu_per_mm - 575.0).abs() < 25.0, "{found:?}");
        let ray = (direction + DVec3::new(-0.3, 0.2, 0.1)).normalize();
        let found = snapped(&volume, from.into(), Some(ray.into()), &how);
        assert!((found.at.xyz.length() - 80.0).abs() < 0.05, "{direction}: {found:?}");
    }
}

/// Where straight lines between voxels that carry their covered share have half of it, for a face
/// at 50 mm.
fn drawn_face_mm(size: usize) -> f64 {
    let spacing = 256.0 / size as f64;
    let centre = |index: usize| (index as f64 - (size as f64 - 1.0) / 2.0) * spacing;
    let share = |index: usize| ((50.0 - centre(index)) / spacing + 0.5).clamp(0.0, 1.0);
    let last = (size / 2..size).rfind(|index| share(*index) >= 0.5).unwrap();
    let [inside, outside] = [share(last), share(last + 1)];
    centre(last) + spacing * (inside - 0.5) / (inside - outside)
}

/// Invariant: Snapping finds the surfaces, edges and extremes of closed forms and of an exhaustive
/// search, or reports that it found nothing.
#[test]
fn a_slabs_faces_are_met_at_the_foot_of_the_perpendicular() {
    for size in [100, 256] {
        let volume = common::volume(PhantomKind::Slab, size);
        assert!((drawn_face_mm(size) - 50.0).abs() < 0.086 * 256.0 / size as f64);
        for (x, y, z) in [(3.3, 48.7, -7.1), (-20.2, 51.4, 0.6), (0.0, -49.2, 11.9)] {
            // The smoothed edge has its steepest place where the true face is.
            let targets =
                [(SnapFeature::Surface { hu: SLAB_HU }, drawn_face_mm(size)), (SnapFeature::Gradient, 50.0)];
            for (target, face_mm) in targets {
                let face = DVec3::new(x, face_mm.copysign(y), z);
                let found = snapped(&volume, [x, y, z], None, &to(target, 5.0));
                let limit = 0.02 * 256.0 / size as f64;
                assert!(found.at.xyz.distance(face) < limit, "{target:?} of {size}: {found:?}");
                let ray = DVec3::new(0.5, 1.0, -0.25);
                let found = snapped(&volume, [x, y, z], Some(ray.into()), &to(target, 5.0));
                let expected = DVec3::new(x, y, z) + ray * (face.y - y);
                assert!(found.at.xyz.distance(expected) < 1.2 * limit, "{target:?} of {size}: {found:?}");
            }
        }
    }
}

/// A Gaussian blob on an oblique, anisotropic grid.
fn blob(middle: DVec3, width_mm: f64, height: f64) -> Volume {
    let turn = glam::DMat3::from_rotation_z(0.4) * glam::DMat3::from_rotation_x(-0.3);
    let axes = [turn.x_axis * 0.7, turn.y_axis * 0.9, turn.z_axis * 1.4];
    let placed: Transform<Patient, Voxel> =
        Transform::from_axes(axes[0], axes[1], axes[2], DVec3::new(-14.0, -17.0, -13.0));
    let grid = Grid::new([40, 40, 24], placed).unwrap();
    let mut hus = Vec::new();
    for (k, j, i) in (0..24).flat_map(|k| (0..40).flat_map(move |j| (0..40).map(move |i| (k, j, i)))) {
        let place = placed * relief_base::Point::new(f64::from(i), f64::from(j), f64::from(k));
        let off = place.xyz.distance(middle) / width_mm;
        hus.push((40.0 + height * (-0.5 * off * off).exp()).round() as i16);
    }
    Volume::new(grid, hus).unwrap()
}

#[test]
fn the_middle_of_a_blob_is_found_between_voxels() {
    let middle = DVec3::new(1.234, -0.777, 2.345);
    for (target, height) in [(SnapFeature::Maximum, 900.0), (SnapFeature::Minimum, -900.0)] {
        let volume = blob(middle, 2.5, height);
        for direction in directions(12) {
            let from = middle + direction * 2.0;
            let found = snapped(&volume, from.into(), None, &to(target, 3.0));
            assert!(found.at.xyz.distance(middle) < 0.05, "{target:?} from {direction}: {found:?}");
            assert!((found.hu - 40.0 - height).abs() < 60.0, "{found:?}");
        }
    }
}

#[test]
fn the_nearest_of_two_peaks_counts_and_a_bump_beside_does_not() {
    let (near, far) = (DVec3::new(-3.0, 0.0, 0.0), DVec3::new(4.0, 1.0, 0.0));
    let (one, other) = (blob(near, 1.6, 600.0), blob(far, 1.6, 900.0));
    let bump = blob(DVec3::new(0.5, -0.5, 0.0), 0.8, 60.0);
    let sum = |a: &Volume, b: &Volume| {
        let hus = a.voxels_hu().iter().zip(b.voxels_hu()).map(|(a, b)| a + b - 40).collect();
        Volume::new(a.grid().clone(), hus).unwrap()
    };
    let volume = sum(&sum(&one, &other), &bump);
    for (from, expected) in [([0.0; 3], near), ([1.4, 0.5, 0.0], far)] {
        let found = snapped(&volume, from, None, &to(SnapFeature::Maximum, 6.0));
        assert!(found.at.xyz.distance(expected) < 0.1, "{from:?}: {found:?}");
    }
}
