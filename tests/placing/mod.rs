//! Snapping: places in closed form on balls and slabs, and an independent search by brute force on
//! rough ground.
#![expect(clippy::unwrap_used, reason = "helpers of tests")]

mod brute;
mod closed_forms;
mod refusals;

use relief_annotation::{Snap, SnapError, SnapFeature, Snapped, snap_point};
use relief_base::{Patient, Point, Vector};
use relief_volume::Volume;

fn to(target: SnapFeature, radius_mm: f64) -> Snap {
    Snap { to: target, radius_mm }
}

fn at(place: [f64; 3]) -> Point<Patient> {
    Point::from_xyz(place.into())
}

fn snapped(volume: &Volume, place: [f64; 3], ray: Option<[f64; 3]>, how: &Snap) -> Snapped {
    let ray = ray.map(|ray| Vector::from_xyz(ray.into()));
    let found = snap_point(volume, at(place), ray, how).unwrap_or_else(|error| panic!("{place:?}: {error}"));
    assert!(found.at.distance(at(place) + found.shift) < 1e-9, "the shift leads there");
    assert!(found.shift.length() <= how.radius_mm + 1e-9, "{found:?}");
    let again = snap_point(volume, at(place), ray, how).unwrap();
    assert_eq!(found, again, "the same twice");
    found
}

fn error(volume: &Volume, place: [f64; 3], ray: Option<[f64; 3]>, how: &Snap) -> SnapError {
    snap_point(volume, at(place), ray.map(|ray| Vector::from_xyz(ray.into())), how).unwrap_err()
}
