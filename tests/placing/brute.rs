//! Snapping against a search of every place in f64: dense, plain, and with no code in common.

use glam::DVec3;
use relief_annotation::{SnapError, SnapFeature, snap_point};
use relief_volume::{Grid, Volume};

use super::{at, to};

const DIMS: [usize; 3] = [26, 24, 22];

/// Rough ground: smooth hills, then noise; voxels of 1 mm from the origin.
fn rough(seed: u64) -> Volume {
    let grid = Grid::axis_aligned(DIMS, [1.0; 3], [0.0; 3]).unwrap();
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut random = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let hills: Vec<(DVec3, f64, f64)> = (0..14)
        .map(|_| {
            let place = DVec3::new(random(), random(), random()) * DVec3::new(26.0, 24.0, 22.0);
            (place, 2.0 + 2.0 * random(), 1600.0 * random() - 800.0)
        })
        .collect();
    let mut hus = Vec::new();
    for k in 0..DIMS[2] {
        for j in 0..DIMS[1] {
            for i in 0..DIMS[0] {
                let place = DVec3::new(i as f64, j as f64, k as f64);
                let hill = |(middle, width, height): &(DVec3, f64, f64)| {
                    height * (-place.distance_squared(*middle) / (2.0 * width * width)).exp()
                };
                hus.push((hills.iter().map(hill).sum::<f64>() + 20.0 * random()).round() as i16);
            }
        }
    }
    Volume::new(grid, hus).unwrap()
}

fn hu(volume: &Volume, [i, j, k]: [i64; 3]) -> f64 {
    let inside = |index: i64, count: usize| index.clamp(0, count as i64 - 1) as usize;
    f64::from(volume.hu([inside(i, DIMS[0]), inside(j, DIMS[1]), inside(k, DIMS[2])]))
}

fn trilinear(volume: &Volume, place: DVec3) -> f64 {
    let low = place.floor();
    let share = place - low;
    let [i, j, k] = low.to_array().map(|index| index as i64);
    let mix = |a: f64, b: f64, share: f64| a + (b - a) * share;
    let row = |j: i64, k: i64| mix(hu(volume, [i, j, k]), hu(volume, [i + 1, j, k]), share.x);
    let plane = |k: i64| mix(row(j, k), row(j + 1, k), share.y);
    mix(plane(k), plane(k + 1), share.z)
}

/// The volume under a Gaussian of 1 mm. Voxels beyond the border repeat it.
struct Smoothed {
    /// HU of the volume and of a border of [`Smoothed::BORDER`] voxels.
    padded: Vec<f64>,
}

impl Smoothed {
    /// Voxels of the Gaussian on either side.
    const REACH: usize = 5;
    /// Places lie up to four voxels outside.
    const BORDER: usize = Self::REACH + 4;
    const SIZE: [usize; 3] =
        [DIMS[0] + 2 * Self::BORDER, DIMS[1] + 2 * Self::BORDER, DIMS[2] + 2 * Self::BORDER];

    fn new(volume: &Volume) -> Self {
        let [nx, ny, nz] = Self::SIZE;
        let inside = |index: usize| index as i64 - Self::BORDER as i64;
        let padded = (0..nx * ny * nz).map(|n| hu(volume, [n % nx, n / nx % ny, n / (nx * ny)].map(inside)));
        Self { padded: padded.collect() }
    }

    /// The Gaussian, summed over a cube of voxels.
    fn at(&self, place: DVec3) -> f64 {
        let middle = place.round();
        let first = middle.to_array().map(|index| (index + (Self::BORDER - Self::REACH) as f64) as usize);
        // The Gaussian of a distance is the product of those along the axes.
        let along = |off: f64| -> [f64; 2 * Self::REACH + 1] {
            std::array::from_fn(|at| (-0.5 * (at as f64 - Self::REACH as f64 + off).powi(2)).exp())
        };
        let [x, y, z] = (middle - place).to_array().map(along);
        let (mut sum, [nx, ny, _]) = (0.0, Self::SIZE);
        for (k, z) in (first[2]..).zip(z) {
            for (j, y) in (first[1]..).zip(y) {
                let row = &self.padded[(k * ny + j) * nx + first[0]..][..x.len()];
                let mut line = 0.0;
                for n in 0..x.len() {
                    line += x[n] * row[n];
                }
                sum += z * y * line;
            }
        }
        sum / [x, y, z].iter().map(|weights| weights.iter().sum::<f64>()).product::<f64>()
    }

    /// Its gradient, by differences.
    fn gradient(&self, place: DVec3) -> DVec3 {
        let along = |axis: DVec3| (self.at(place + axis * 0.01) - self.at(place - axis * 0.01)) / 0.02;
        DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
    }
}

/// Places of a fine lattice in a ball.
fn ball(middle: DVec3, radius: f64, step: f64) -> impl Iterator<Item = DVec3> {
    let count = (radius / step).ceil() as i32;
    let axis = move || -count..=count;
    axis()
        .flat_map(move |c| {
            axis().flat_map(move |b| axis().map(move |a| DVec3::new(a.into(), b.into(), c.into())))
        })
        .map(move |offset| middle + offset * step)
        .filter(move |place| place.distance(middle) <= radius)
}

fn places() -> [DVec3; 4] {
    [(9.3, 10.1, 9.8), (14.7, 12.2, 11.4), (11.1, 13.6, 8.3), (16.2, 9.4, 12.9)].map(DVec3::from)
}

#[test]
fn surfaces_are_as_near_as_any_place_on_them() {
    expect_surfaces(1..3, 6);
}

#[test]
#[ignore = "takes a minute: more volumes, in scripts/test --all"]
fn surfaces_of_more_volumes_are_as_near_as_any_place_on_them() {
    expect_surfaces(3..6, 9);
}

/// `least`: how many searches must find one.
fn expect_surfaces(seeds: std::ops::Range<u64>, least: usize) {
    let mut compared = 0;
    for seed in seeds {
        let volume = rough(seed);
        for from in places() {
            // Any place on the surface lies within a step of a pair of places on different sides of
            // it.
            let level = trilinear(&volume, from) + 40.0;
            let near = ball(from, 3.0, 0.05)
                .filter(|place| trilinear(&volume, *place) >= level)
                .map(|place| place.distance(from))
                .fold(f64::INFINITY, f64::min);
            match snap_point(&volume, at(from.into()), None, &to(SnapFeature::Surface { hu: level }, 3.0)) {
                Ok(found) => {
                    let distance = found.shift.length();
                    assert!((distance - near).abs() < 0.1, "{seed}, {from}: {distance} for {near}");
                    assert!((trilinear(&volume, found.at.xyz) - level).abs() < 0.1, "{found:?}");
                    compared += 1;
                }
                Err(_) => assert!(near > 2.9, "{seed}, {from}: {near} was missed"),
            }
        }
    }
    assert!(compared >= least, "{compared}");
}

/// Invariant: Snapping finds the surfaces, edges and extremes of closed forms and of an exhaustive
/// search, or reports that it found nothing.
#[test]
fn crossings_along_rays_are_the_nearest() {
    let mut compared = 0;
    for seed in 1..6 {
        let volume = rough(seed);
        for from in places() {
            for ray in [DVec3::new(1.0, 0.3, -0.2), DVec3::new(-0.1, 0.8, 0.6)].map(DVec3::normalize) {
                let level = trilinear(&volume, from) - 30.0;
                // Surfaces lie 1/64 HU higher than said, off whole HU.
                let drawn = level + 1.0 / 64.0;
                let offs = (0..6000).map(|i| f64::from(i) * 0.0005);
                let crossed = |off: &f64| {
                    [1.0, -1.0].into_iter().any(|side| trilinear(&volume, from + ray * side * *off) < drawn)
                };
                let near = offs.clone().find(crossed);
                let ray = Some(relief_base::Vector::from_xyz(ray * 3.0));
                let found =
                    snap_point(&volume, at(from.into()), ray, &to(SnapFeature::Surface { hu: level }, 3.0));
                match (near, found) {
                    (Some(near), Ok(found)) => {
                        assert!((found.shift.length() - near).abs() < 0.001, "{found:?} for {near}");
                        compared += 1;
                    }
                    (near, found) => assert!(near.is_none() && found.is_err(), "{near:?}: {found:?}"),
                }
            }
        }
    }
    assert!(compared >= 25, "{compared}");
}

/// Invariant: Snapping finds the surfaces, edges and extremes of closed forms and of an exhaustive
/// search, or reports that it found nothing.
#[test]
fn edges_are_the_steepest_and_nearest_on_them() {
    expect_edges(1..2);
}

#[test]
#[ignore = "takes a minute: more volumes, in scripts/test --all"]
fn edges_of_more_volumes_are_the_steepest_and_nearest_on_them() {
    expect_edges(2..4);
}

fn expect_edges(seeds: std::ops::Range<u64>) {
    let radius = 2.5;
    for seed in seeds {
        let volume = rough(seed);
        let smoothed = Smoothed::new(&volume);
        for from in places() {
            let nearness = |place: DVec3| 1.0 - place.distance_squared(from) / (radius * radius);
            // An edge: steeper than a little before and behind it.
            let is_edge = |place: &DVec3| {
                let along = smoothed.gradient(*place);
                let off = along.normalize() * 0.15;
                [off, -off].into_iter().all(|off| smoothed.gradient(*place + off).length() < along.length())
            };
            let edges: Vec<(DVec3, f64)> = ball(from, radius, 0.25)
                .filter(is_edge)
                .map(|place| (place, smoothed.gradient(place).length()))
                .collect();
            let best = edges.iter().map(|(place, steep)| steep * nearness(*place)).fold(0.0, f64::max);
            match snap_point(&volume, at(from.into()), None, &to(SnapFeature::Gradient, radius)) {
                Ok(found) => {
                    let steep = smoothed.gradient(found.at.xyz).length();
                    assert!((steep - found.gradient_hu_per_mm).abs() < 0.01 * steep, "{found:?}: {steep}");
                    // At the very end of an edge its maximum is flat.
                    let off = smoothed.gradient(found.at.xyz).normalize() * 0.05;
                    for beside in [off, -off].map(|off| smoothed.gradient(found.at.xyz + off).length()) {
                        assert!(
                            beside <= steep * 1.0005,
                            "{seed}, {from}: {found:?}, {beside} beside {steep}"
                        );
                    }
                    assert!(steep >= 0.5 * best, "{seed}, {from}: {steep} for {best}");
                    // Nothing beside it that is as steep is nearer.
                    let nearer = edges.iter().find(|(place, beside)| {
                        place.distance(found.at.xyz) < 0.4
                            && *beside >= 1.01 * steep
                            && place.distance(from) < found.shift.length() - 0.2
                    });
                    assert!(nearer.is_none(), "{seed}, {from}: {nearer:?} is nearer than {found:?}");
                }
                Err(error) => {
                    assert!(matches!(error, SnapError::NotFound { .. }));
                    // At the very rim of the ball an edge is worth nothing.
                    let missed = edges.iter().find(|(place, _)| nearness(*place) > 0.15);
                    assert!(missed.is_none(), "{seed}, {from}: {missed:?} was missed");
                }
            }
        }
    }
}

#[test]
fn extremes_are_the_nearest_that_stand_out() {
    expect_extremes(5..7, 4);
}

#[test]
#[ignore = "takes a minute: more volumes, in scripts/test --all"]
fn extremes_of_more_volumes_are_the_nearest_that_stand_out() {
    expect_extremes(1..4, 1);
    expect_extremes(4..5, 1);
}

/// `least`: how many searches must find one.
fn expect_extremes(seeds: std::ops::Range<u64>, least: usize) {
    let (radius, mut compared) = (4.0, 0);
    for seed in seeds {
        let volume = rough(seed);
        let smoothed = Smoothed::new(&volume);
        for from in places() {
            // On a lattice of 0.25 mm: higher than all six neighbours.
            let is_peak = |place: &DVec3| {
                let here = smoothed.at(*place);
                [DVec3::X, DVec3::Y, DVec3::Z]
                    .into_iter()
                    .all(|axis| [0.25, -0.25].into_iter().all(|off| smoothed.at(*place + axis * off) < here))
            };
            let near: Vec<DVec3> = ball(from, radius, 0.25).filter(is_peak).collect();
            match snap_point(&volume, at(from.into()), None, &to(SnapFeature::Maximum, radius)) {
                Ok(found) => {
                    let place = found.at.xyz;
                    let one = near.iter().map(|peak| peak.distance(place)).fold(f64::INFINITY, f64::min);
                    assert!(
                        one < 0.3 || place.distance(from) > radius - 0.3,
                        "{seed}, {from}: {found:?}, {near:?}"
                    );
                    assert!(smoothed.gradient(place).length() < 0.5, "{found:?}");
                    compared += 1;
                }
                Err(_) => assert!(near.is_empty(), "{seed}, {from}: {near:?} was missed"),
            }
        }
    }
    assert!(compared >= least, "{compared}");
}
