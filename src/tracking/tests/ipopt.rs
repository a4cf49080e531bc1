//! IPOPT against the interior-point solver of our own, on random views: for builds with the feature
//! `ipopt`.
#![expect(clippy::unwrap_used, clippy::print_stdout, reason = "a test may panic and talk")]

use relief_tracking::{Beacon, Pinhole, PoseView, Random, ViewRange, random_sightings, solve_with_ipopt};

const VIEWS: usize = 200;

/// Invariant: IPOPT and our solver find the same minima of the published energy.
///
/// From the same start, IPOPT and the solver of our own end in the same pose with the same energy.
#[test]
fn ipopt_and_our_own_solver_find_the_same_minima() {
    let (beacon, camera, mut random) = (Beacon::recommended(), Pinhole::TYPICAL, Random::new(7));
    let (mut largest, mut energies) = ((0.0_f64, 0.0_f64), 0.0_f64);
    for at in 0..VIEWS {
        let truth = random.view(&beacon, &camera, &ViewRange::USUAL);
        let seen = random_sightings(&beacon, &camera, &truth, 0.5, &mut random);
        let view = PoseView { camera: &camera, sightings: &seen, noise_px: 0.5, gravity: None };
        let start = view.solve().unwrap().best.pose;
        let (ours, theirs) = (
            relief_tracking::solve_as_published(&view, &start).unwrap(),
            solve_with_ipopt(&view, &start).unwrap(),
        );
        let (angle, distance) = ours.pose.distance(&theirs.pose);
        assert!(angle < 1e-6 && distance < 1e-3, "view {at}: {angle} rad, {distance} mm");
        largest = (largest.0.max(angle.to_degrees()), largest.1.max(distance));
        energies = energies.max((ours.energy - theirs.energy).abs());
    }
    assert!(energies < 1e-6, "{energies} px²");
    println!("{VIEWS} views: IPOPT and ours within {:.1e} degrees, {:.1e} mm", largest.0, largest.1);
}

/// Nothing of the pose given away: most views end in the same minimum even from a level start far
/// off.
#[test]
fn both_come_from_a_level_start_to_the_same_minima() {
    let (beacon, camera, mut random) = (Beacon::recommended(), Pinhole::TYPICAL, Random::new(8));
    let mut same = 0;
    for _ in 0..VIEWS {
        let truth = random.view(&beacon, &camera, &ViewRange::USUAL);
        let seen = random_sightings(&beacon, &camera, &truth, 0.5, &mut random);
        let view = PoseView { camera: &camera, sightings: &seen, noise_px: 0.5, gravity: None };
        let start = relief_tracking::level_start(1500.0);
        let (Some(ours), Some(theirs)) =
            (relief_tracking::solve_as_published(&view, &start), solve_with_ipopt(&view, &start))
        else {
            continue;
        };
        let (angle, distance) = ours.pose.distance(&theirs.pose);
        same += usize::from(angle < 1e-6 && distance < 1e-3);
    }
    println!("from a level start {same} of {VIEWS} minima are the same");
    assert!(same * 100 >= VIEWS * 90, "{same} of {VIEWS}");
}

#[test]
fn two_leds_have_no_minimum() {
    let (beacon, camera, mut random) = (Beacon::recommended(), Pinhole::TYPICAL, Random::new(9));
    let truth = random.view(&beacon, &camera, &ViewRange::USUAL);
    let seen = random_sightings(&beacon, &camera, &truth, 0.0, &mut random);
    let view = PoseView { camera: &camera, sightings: &seen[..2], noise_px: 0.5, gravity: None };
    assert!(solve_with_ipopt(&view, &truth).is_none());
}
