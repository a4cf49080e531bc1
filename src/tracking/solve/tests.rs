//! Solvers compared with known truth, and with the Cramer-Rao bound.

use nalgebra::{Rotation3, Unit, Vector6};

use super::random::{Random, ViewRange, random_sightings};
use super::*;
use crate::beacon::Beacon;

fn tetra() -> Beacon {
    Beacon::new(&[[-100.0, -57.7, 0.0], [100.0, -57.7, 0.0], [0.0, 115.5, 0.0], [0.0, 0.0, 100.0]]).unwrap()
}

fn gravity(pose: &Pose, beacon: &Beacon, random: &mut Random, sigma: f64) -> Gravity {
    let tilt = Rotation3::from_scaled_axis(random.normal3() * sigma);
    let up = tilt * pose.rotation * beacon.up().into_inner();
    Gravity { up_in_beacon: *beacon.up(), up_in_sensor: Unit::new_normalize(up), sigma }
}

const BENT: Pinhole = Pinhole {
    fx: 1320.0,
    fy: 1345.0,
    skew: 2.0,
    cx: 500.0,
    cy: 390.0,
    distortion: [-0.1, 0.05, 0.001, -0.001, 0.0],
};

#[test]
fn exact_pixels_give_the_exact_pose() {
    let (beacon, mut random) = (tetra(), Random::new(1));
    for at in 0..1000 {
        let truth = random.view(&beacon, &BENT, &ViewRange::USUAL);
        let seen = random_sightings(&beacon, &BENT, &truth, 0.0, &mut random);
        let view = PoseView { camera: &BENT, sightings: &seen, noise_px: 0.5, gravity: None };
        let best = view.solve().unwrap().best;
        let (angle, distance) = best.pose.distance(&truth);
        assert!(angle < 1e-7 && distance < 1e-4, "view {at}: {angle} rad, {distance} mm");
    }
}

/// Invariant: The pose of a view is the global minimum, with an error close to the Cramer-Rao
/// bound.
///
/// No start out of 300 random ones leads lower than the starts that
/// [`PoseView::solve_as_published`] tries.
#[test]
fn the_minimum_found_is_the_global_one() {
    let (beacon, mut random) = (tetra(), Random::new(2));
    let range = ViewRange { tilt: 1.0, roll: 3.0, ..ViewRange::USUAL };
    for at in 0..150 {
        let truth = random.view(&beacon, &BENT, &range);
        let seen = random_sightings(&beacon, &BENT, &truth, 2.0, &mut random);
        let view = PoseView { camera: &BENT, sightings: &seen, noise_px: 0.5, gravity: None };
        let best = view.solve().unwrap().best;
        for _ in 0..300 {
            let rotation = Rotation3::from_scaled_axis(random.normal3() * 2.0);
            let start = Pose { rotation, translation: truth.translation };
            let Some(other) = view.refine(&start) else { continue };
            assert!(best.cost <= other.cost + 1e-6, "view {at}: {} above {}", best.cost, other.cost);
        }
    }
}

/// Invariant: The pose of a view is the global minimum, with an error close to the Cramer-Rao
/// bound.
///
/// Errors over the bound, over many views at one to two metres: an efficient estimate has a ratio
/// of 1.
#[test]
fn errors_reach_the_bound() {
    let (beacon, mut random) = (tetra(), Random::new(3));
    let noise_px = bound::quantised_noise(0.5);
    let mut sums = Vector6::<f64>::zeros();
    const VIEWS: usize = 3000;
    for _ in 0..VIEWS {
        let truth = random.view(&beacon, &BENT, &ViewRange::USUAL);
        let mut seen = random_sightings(&beacon, &BENT, &truth, 0.5, &mut random);
        for sighting in &mut seen {
            sighting.pixel.apply(|c| *c = c.round());
        }
        let view = PoseView { camera: &BENT, sightings: &seen, noise_px, gravity: None };
        let found = view.solve().unwrap().best.pose.inverse();
        let bound = view.bound(&truth).unwrap();
        let turn = (found.orientation * truth.inverse().orientation.inverse()).scaled_axis();
        let shift = found.position - truth.inverse().position;
        let error = Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z);
        sums += Vector6::from_fn(|i, _| error[i].powi(2) / bound[(i, i)]);
    }
    for (axis, sum) in sums.iter().enumerate() {
        let ratio = (sum / VIEWS as f64).sqrt();
        assert!((0.95..1.10).contains(&ratio), "axis {axis}: {ratio} of the bound");
    }
}

/// Three LEDs, and two, with up known to half a degree: the truth lies within the covariance.
#[test]
fn fewer_leds_do_with_gravity() {
    let (beacon, mut random) = (tetra(), Random::new(4));
    let sigma = 0.5_f64.to_radians();
    for count in [2, 3, 4] {
        let (mut inside, mut sum) = (0, 0.0);
        for _ in 0..400 {
            let truth = random.view(&beacon, &BENT, &ViewRange::USUAL);
            let mut seen = random_sightings(&beacon, &BENT, &truth, 0.4, &mut random);
            seen.truncate(count);
            let gravity = Some(gravity(&truth, &beacon, &mut random, sigma));
            let view = PoseView { camera: &BENT, sightings: &seen, noise_px: 0.4, gravity };
            let solutions = view.solve().unwrap();
            // Two LEDs leave two poses that can be equally good: one of them is the truth.
            let nearest = [Some(solutions.best), solutions.second]
                .into_iter()
                .flatten()
                .map(|found| {
                    let turn = found.pose.rotation * truth.rotation.inverse();
                    let v = found.pose.translation - truth.translation;
                    let w = turn.scaled_axis();
                    let error = Vector6::new(w.x, w.y, w.z, v.x, v.y, v.z);
                    error.dot(&(found.information * error))
                })
                .fold(f64::INFINITY, f64::min);
            sum += nearest.min(100.0);
            inside += usize::from(nearest < 22.5); // 99.9 % of a chi-square of six
        }
        // With two LEDs the turn about up is known so little that its covariance is only a first
        // guess.
        assert!(inside >= if count == 2 { 350 } else { 390 }, "{count} LEDs: {inside} of 400 are within");
        assert!(
            count == 2 || (4.0..9.5).contains(&(sum / 400.0)),
            "{count} LEDs: mean chi-square {}",
            sum / 400.0
        );
    }
}

#[test]
fn two_leds_alone_and_no_leds_have_no_pose() {
    let (beacon, mut random) = (tetra(), Random::new(5));
    let truth = random.view(&beacon, &BENT, &ViewRange::USUAL);
    let seen = random_sightings(&beacon, &BENT, &truth, 0.0, &mut random);
    for count in [0, 1, 2] {
        let view = PoseView { camera: &BENT, sightings: &seen[..count], noise_px: 0.5, gravity: None };
        assert!(view.solve().is_none(), "{count}");
    }
}

/// From exact pixels both energies vanish at the truth; from noisy ones the paper's lies near, and
/// its own energy is least there.
#[test]
fn the_papers_way_finds_its_minimum() {
    let (beacon, mut random) = (tetra(), Random::new(6));
    let (mut converged, mut worse) = (0, 0);
    for _ in 0..200 {
        let truth = random.view(&beacon, &BENT, &ViewRange::USUAL);
        let exact = random_sightings(&beacon, &BENT, &truth, 0.0, &mut random);
        let view = PoseView { camera: &BENT, sightings: &exact, noise_px: 0.5, gravity: None };
        let found = paper::solve_as_published(&view, &paper::level_start(1500.0)).unwrap();
        let (angle, distance) = found.pose.distance(&truth);
        let reached = angle < 1e-6 && distance < 1e-3;
        converged += usize::from(found.converged && reached);

        let noisy = random_sightings(&beacon, &BENT, &truth, 0.5, &mut random);
        let view = PoseView { camera: &BENT, sightings: &noisy, noise_px: 0.5, gravity: None };
        let ours = view.refine(&truth).unwrap();
        let theirs = paper::solve_as_published(&view, &ours.pose).unwrap();
        assert!(theirs.converged, "{theirs:?}");
        assert!(view.cost(&theirs.pose).unwrap() >= ours.cost - 1e-9);
        worse += usize::from(view.cost(&theirs.pose).unwrap() > ours.cost * 3.0 + 3.0);
        for axis in 0..6 {
            let mut change = Vector6::zeros();
            change[axis] = if axis < 3 { 1e-5 } else { 1e-2 };
            for change in [change, -change] {
                let near = paper_energy(&view, &theirs.pose.changed(&change));
                assert!(near >= theirs.energy * (1.0 - 1e-9), "axis {axis}: {near} below {}", theirs.energy);
            }
        }
    }
    assert!(converged >= 190, "only {converged} of 200 found the exact pose from a level start");
    assert!(worse <= 4, "{worse} of 200 are far from the least pixel error");
}

/// The energy written out, without forms.
fn paper_energy(view: &PoseView<'_>, pose: &Pose) -> f64 {
    let scale = view.sightings.iter().map(|s| s.led.norm()).fold(0.0, f64::max);
    let mut sum = 0.0;
    for sighting in view.sightings {
        let p = pose.place(&sighting.led) / scale;
        let [x, y] = view.camera.ray_of_pixel(&sighting.pixel).unwrap();
        let k = view.camera;
        let u = (k.fx * x + k.skew * y) * p.z - (k.fx * p.x + k.skew * p.y);
        let v = k.fy * y * p.z - k.fy * p.y;
        sum += u * u + v * v;
    }
    sum
}
