//! A step of the tracker allocates nothing, and neither does a solver.

use relief_tracking::Beacon;
use relief_tracking::sensor::Pinhole;
use relief_tracking::simulate::{Hand, Simulated, Simulation};
use relief_tracking::solve::View;
use relief_tracking::solve::random::{Random, ViewRange, sightings};
use relief_tracking::tracker::{FilterKind, Options, Tracker};

#[test]
fn tracking_allocates_nothing() {
    let simulation = Simulation { gyroscope: true, ..Simulation::new(Beacon::recommended(), 1) };
    let reports = simulation.record(&Hand::before(&simulation.beacon, 1300.0, 1), 3.0);
    for filter in [FilterKind::ErrorState, FilterKind::Pose, FilterKind::None] {
        let options = Options { filter, use_gyroscope: true, ..Options::default() };
        let mut tracker = Tracker::new(simulation.camera, simulation.beacon.clone(), options);
        let mut poses = 0;
        let counted = allocation_counter::measure(|| {
            for Simulated { t_ns, report, .. } in &reports {
                let sample = tracker.push(*t_ns, report);
                poses += usize::from(sample.is_some_and(|sample| sample.pose.is_some()));
            }
        });
        assert!(poses > 280, "{filter:?}: {poses} poses");
        assert_eq!(counted.count_total, 0, "{filter:?}: {counted:?}");
    }
}

#[test]
fn solving_allocates_nothing() {
    let (beacon, camera, mut random) = (Beacon::recommended(), Pinhole::TYPICAL, Random::new(1));
    for _ in 0..50 {
        let truth = random.view(&beacon, &camera, &ViewRange::USUAL);
        let seen = sightings(&beacon, &camera, &truth, 0.5, &mut random);
        let view = View { camera: &camera, sightings: &seen, noise_px: 0.5, gravity: None };
        let mut found = (None, None);
        let counted = allocation_counter::measure(|| {
            found = (
                view.solve(),
                relief_tracking::solve::paper::solve(
                    &view,
                    &relief_tracking::solve::paper::level_start(1500.0),
                ),
            );
        });
        assert!(found.0.is_some() && found.1.is_some());
        assert_eq!(counted.count_total, 0, "{counted:?}");
    }
}
