//! Refused requests and their errors.

use crate::common;
use relief_annotation::{Snap, SnapFeature};
use relief_volume::{Grid, PhantomKind, Volume};

use super::{error, to};

#[test]
fn values_out_of_range_are_named_with_what_is_allowed() {
    let volume = common::volume(PhantomKind::Sphere, 16);
    let surface = |hu| to(SnapFeature::Surface { hu }, 3.0);
    for (message, key, allowed) in [
        (
            error(&volume, [0.0; 3], None, &to(SnapFeature::Gradient, 0.05)),
            "radius_mm is 0.05",
            "0.1 to 20 mm",
        ),
        (
            error(&volume, [0.0; 3], None, &to(SnapFeature::Gradient, 20.5)),
            "radius_mm is 20.5",
            "0.1 to 20 mm",
        ),
        (
            error(&volume, [0.0; 3], None, &to(SnapFeature::Gradient, f64::NAN)),
            "radius_mm is NaN",
            "0.1 to 20",
        ),
        (error(&volume, [0.0; 3], None, &surface(40000.0)), "hu is 40000", "-32768 to 32767 HU"),
        (error(&volume, [0.0; 3], None, &surface(f64::INFINITY)), "hu is inf", "-32768 to 32767 HU"),
        (error(&volume, [0.0, f64::NAN, 0.0], None, &surface(0.0)), "at_mm is", "finite"),
        (error(&volume, [0.0; 3], Some([0.0; 3]), &surface(0.0)), "ray is", "some length"),
    ] {
        let message = message.to_string();
        assert!(message.contains(key) && message.contains(allowed), "{message}");
    }
}

/// Invariant: Snapping looks at a bounded number of voxels, at any radius and voxel size.
#[test]
fn a_radius_with_too_many_voxels_is_refused_with_one_that_fits() {
    let grid = Grid::axis_aligned([400; 3], [0.05; 3], [0.0; 3]).unwrap();
    let volume = Volume::new(grid, vec![0; 400 * 400 * 400]).unwrap();
    for (target, what) in [
        (SnapFeature::Maximum, "no local maximum"),
        (SnapFeature::Gradient, "no edge"),
        (SnapFeature::Boundary, "no boundary"),
        (SnapFeature::Surface { hu: 100.0 }, "no surface"),
    ] {
        let message = error(&volume, [10.0; 3], None, &to(target, 10.0)).to_string();
        assert!(message.contains("radius_mm is 10") && message.contains("at most 3.9 mm"), "{message}");
        let fits = error(&volume, [10.0; 3], None, &to(target, 3.9)).to_string();
        assert!(fits.contains(what), "{fits}");
    }
}

/// Invariant: Snapping finds the surfaces, edges and extremes of closed forms and of an exhaustive
/// search, or reports that it found nothing.
#[test]
fn places_without_a_surface_are_reported() {
    let volume = common::volume(PhantomKind::Sphere, 64); // 4 mm voxels
    let far = [0.0, 0.0, 500.0];
    for (target, what) in [
        (SnapFeature::Surface { hu: -250.0 }, "surface of -250 HU"),
        (SnapFeature::Gradient, "edge"),
        (SnapFeature::Minimum, "local minimum"),
        (SnapFeature::Maximum, "local maximum"),
    ] {
        for place in [[0.0; 3], far] {
            for ray in [None, Some([0.0, 1.0, 0.0])] {
                let message = error(&volume, place, ray, &to(target, 5.0)).to_string();
                assert!(message.contains(what) && message.contains("within 5 mm"), "{place:?}: {message}");
            }
        }
    }
    assert_eq!(Snap::DEFAULT_RADIUS_MM, 3.0);
}

#[test]
fn volumes_of_one_voxel_or_slice_are_no_trouble() {
    for dims in [[1, 1, 1], [8, 8, 1], [1, 8, 8]] {
        let count = dims.iter().product::<usize>();
        let grid = Grid::axis_aligned(dims, [1.0; 3], [0.0; 3]).unwrap();
        let hus = (0..count).map(|i| (i as i16 * 37) % 400).collect();
        let volume = Volume::new(grid, hus).unwrap();
        for target in [
            SnapFeature::Surface { hu: 100.0 },
            SnapFeature::Gradient,
            SnapFeature::Minimum,
            SnapFeature::Maximum,
        ] {
            for ray in [None, Some(relief_base::Vector::new(0.3, 0.4, 0.1))] {
                let place = relief_base::Point::new(0.2, 0.1, 0.1);
                if let Ok(found) = relief_annotation::snap_point(&volume, place, ray, &to(target, 2.0)) {
                    assert!(
                        found.shift.length() <= 2.0 + 1e-9 && found.hu.is_finite(),
                        "{dims:?}: {found:?}"
                    );
                }
            }
        }
    }
}
