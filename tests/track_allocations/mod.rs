//! A step of the tracker allocates nothing, and neither does a solver.

use relief_tracking::{
    Beacon, FilterKind, Pinhole, PointingHand, PoseView, Random, SimulatedReport, Simulation, Tracker,
    TrackerOptions, ViewRange, random_sightings,
};

/// Invariant: A step of tracking allocates no memory.
#[test]
fn tracking_allocates_nothing() {
    let simulation = Simulation { gyroscope: true, ..Simulation::new(Beacon::recommended(), 1) };
    let reports = simulation.record(&PointingHand::before(&simulation.beacon, 1300.0, 1), 3.0);
    for filter in [FilterKind::ErrorState, FilterKind::Pose, FilterKind::None] {
        let options = TrackerOptions { filter, use_gyroscope: true, ..TrackerOptions::default() };
        let mut tracker = Tracker::new(simulation.camera, simulation.beacon.clone(), options);
        let mut poses = 0;
        let counted = allocation_counter::measure(|| {
            for SimulatedReport { t_ns, report, .. } in &reports {
                let sample = tracker.push(*t_ns, report);
                poses += usize::from(sample.is_some_and(|sample| sample.pose.is_some()));
            }
        });
        assert!(poses > 280, "{filter:?}: {poses} poses");
        assert_eq!(counted.count_total, 0, "{filter:?}: {counted:?}");
    }
}

/// Invariant: A step of tracking allocates no memory.
#[test]
fn solving_allocates_nothing() {
    let (beacon, camera, mut random) = (Beacon::recommended(), Pinhole::TYPICAL, Random::new(1));
    for _ in 0..50 {
        let truth = random.view(&beacon, &camera, &ViewRange::USUAL);
        let seen = random_sightings(&beacon, &camera, &truth, 0.5, &mut random);
        let view = PoseView { camera: &camera, sightings: &seen, noise_px: 0.5, gravity: None };
        let mut found = (None, None);
        let counted = allocation_counter::measure(|| {
            found = (
                view.solve(),
                relief_tracking::solve_as_published(&view, &relief_tracking::level_start(1500.0)),
            );
        });
        assert!(found.0.is_some() && found.1.is_some());
        assert_eq!(counted.count_total, 0, "{counted:?}");
    }
}
