//! Region growing: limits against leaks, seeds, and stopping.

use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;

use super::shapes::{grid, mask, volume};
use relief_annotation::grow_region;
use relief_annotation::{Grow, GrowError, GrowLimits, GrowStage, GrownRegion, GrowthEnd};
use relief_base::Point;
use relief_volume::Volume;

/// Two balls of 12 mm, 40 mm apart, joined by a bridge 3 mm thick, on an oblique grid.
fn dumbbell() -> Volume {
    volume(&grid(80.0, [0.8, 0.9, 1.1], [0.3, 0.2, -0.5], false), is_dumbbell)
}

fn is_dumbbell(p: DVec3) -> bool {
    let bridge = p.x.abs() <= 20.0 && p.y.hypot(p.z) <= 1.5;
    in_ball(p, -20.0) || in_ball(p, 20.0) || bridge
}

fn in_ball(p: DVec3, x: f64) -> bool {
    p.distance(DVec3::new(x, 0.0, 0.0)) <= 12.0
}

fn from(x: f64, limits: GrowLimits) -> Grow {
    Grow { seeds: vec![Point::new(x, 0.0, 0.0)], hu: [0, 200], limits }
}

fn grown(what: &Grow) -> Result<GrownRegion, GrowError> {
    grow_region(&dumbbell(), what, &|_| true)
}

#[test]
fn without_limits_it_is_everything_that_is_connected() {
    let found = grown(&from(-20.0, GrowLimits::default())).unwrap();
    assert_eq!(found.mask, mask(dumbbell().grid(), is_dumbbell));
    assert_eq!(found.ended, GrowthEnd::Complete);
    assert_eq!(found.voxels, found.mask.voxels());
    assert!((found.volume_ml - found.mask.volume_ml()).abs() < 1e-12);
}

/// Invariant: A region that leaks is refused and nothing is stored; a mesh file is valid, or
/// refused with the place of the error.
#[test]
fn a_region_larger_than_allowed_has_leaked() {
    let ball_ml = 4.0 / 3.0 * std::f64::consts::PI * 1.728;
    let limits = GrowLimits { max_ml: Some(ball_ml * 1.2), ..GrowLimits::default() };
    let Err(GrowError::Leaked { reached_ml, allowed_ml }) = grown(&from(-20.0, limits)) else {
        panic!("it goes through the bridge")
    };
    assert!(reached_ml > allowed_ml && allowed_ml == ball_ml * 1.2, "{reached_ml} {allowed_ml}");
    let message = grown(&from(-20.0, limits)).unwrap_err().to_string();
    assert!(message.contains("leaked") && message.contains("allowed: 8.7 ml"), "{message}");
    let enough = GrowLimits { max_ml: Some(ball_ml * 2.5), ..GrowLimits::default() };
    assert_eq!(grown(&from(-20.0, enough)).unwrap().ended, GrowthEnd::Complete);
}

#[test]
fn a_radius_limits_growth_and_is_reported() {
    let limits = GrowLimits { max_radius_mm: Some(15.0), ..GrowLimits::default() };
    let found = grown(&from(-20.0, limits)).unwrap();
    let near = |p: DVec3| is_dumbbell(p) && p.distance(DVec3::new(-20.0, 0.0, 0.0)) <= 15.0;
    assert_eq!(found.mask, mask(dumbbell().grid(), near));
    assert_eq!(found.ended, GrowthEnd::AtRadius);
    let wide = GrowLimits { max_radius_mm: Some(60.0), ..GrowLimits::default() };
    assert_eq!(grown(&from(-20.0, wide)).unwrap().ended, GrowthEnd::Complete);
    // Of two seeds the nearer one counts: both balls, and the bridge but for its middle.
    let both =
        Grow { seeds: vec![Point::new(-20.0, 0.0, 0.0), Point::new(20.0, 0.0, 0.0)], ..from(0.0, limits) };
    let found = grown(&both).unwrap();
    let near = |p: DVec3| {
        is_dumbbell(p) && [-20.0, 20.0].iter().any(|x| p.distance(DVec3::new(*x, 0.0, 0.0)) <= 15.0)
    };
    assert_eq!(found.mask, mask(dumbbell().grid(), near));
}

#[test]
fn a_neck_is_not_passed_and_the_leak_behind_it_does_not_count() {
    let limits = GrowLimits { neck_mm: Some(6.0), max_ml: Some(9.0), ..GrowLimits::default() };
    let found = grown(&from(-20.0, limits)).unwrap();
    assert_eq!(found.ended, GrowthEnd::AtNeck);
    let ball = mask(dumbbell().grid(), |p| in_ball(p, -20.0)).voxels();
    let share = found.voxels as f64 / ball as f64;
    // A ball of 6 mm does not reach into the bridge by more than its own curvature, and misses few
    // voxels of the large ball.
    assert!((0.97..1.02).contains(&share), "{share} of the ball");
    for index in super::shapes::indices(dumbbell().grid()) {
        if found.mask.contains(index) {
            let place = dumbbell_place(index);
            assert!(place.x < 0.0, "nothing of the other ball: {place}");
        }
    }
    // A bridge that is thick enough is passed.
    let thin = GrowLimits { neck_mm: Some(1.5), ..GrowLimits::default() };
    let through = grown(&from(-20.0, thin)).unwrap();
    assert!(through.voxels > 19 * ball / 10, "{} of {ball}", through.voxels);
    let refused = grown(&from(0.0, limits)).unwrap_err();
    assert_eq!(refused, GrowError::Thin { neck_mm: 6.0 }, "a seed on the bridge");
}

fn dumbbell_place(index: [usize; 3]) -> DVec3 {
    let grid = grid(80.0, [0.8, 0.9, 1.1], [0.3, 0.2, -0.5], false);
    grid.patient_from_voxel().affine.transform_point3(DVec3::from(index.map(|i| i as f64)))
}

#[test]
fn seeds_and_arguments_that_are_wrong_are_named() {
    let says = |what: &Grow, text: &str| {
        let refused = grown(what).unwrap_err().to_string();
        assert!(refused.contains(text), "{refused}");
    };
    let none = GrowLimits::default();
    says(&from(500.0, none), "seed 500.0 0.0 0.0 mm is outside of the volume");
    says(&from(f64::NAN, none), "outside of the volume");
    says(
        &Grow { seeds: vec![Point::new(0.0, 30.0, 0.0)], ..from(0.0, none) },
        "seed 1 has -1000 HU, allowed: 0 to 200 HU",
    );
    says(&Grow { seeds: vec![], ..from(0.0, none) }, "seeds is 0 points, allowed: 1 to 1000");
    says(&Grow { hu: [10, 5], ..from(0.0, none) }, "hu is 10 to 5");
    says(&from(-20.0, GrowLimits { max_ml: Some(0.0), ..none }), "max_ml is 0, allowed: more than 0");
    says(&from(-20.0, GrowLimits { max_radius_mm: Some(f64::NAN), ..none }), "max_radius_mm is NaN");
    says(
        &from(-20.0, GrowLimits { neck_mm: Some(51.0), ..none }),
        "neck_mm is 51, allowed: more than 0, at most 50",
    );
}

#[test]
fn growing_stops_at_every_stage_when_the_caller_leaves() {
    let neck = from(-20.0, GrowLimits { neck_mm: Some(6.0), ..GrowLimits::default() });
    let calls = AtomicUsize::new(0);
    let stages = std::sync::Mutex::new(Vec::new());
    let found = grow_region(&dumbbell(), &neck, &|progress| {
        calls.fetch_add(1, Ordering::Relaxed);
        stages.lock().unwrap().push(progress.stage);
        true
    });
    found.unwrap();
    for stage in [GrowStage::Range, GrowStage::Growing, GrowStage::Necks] {
        assert!(stages.lock().unwrap().contains(&stage), "{stage:?} is reported");
    }
    let total = calls.into_inner();
    for allowed in [0, 1, 2, total / 4, total / 2, total - 1] {
        let asked = AtomicUsize::new(0);
        let found = grow_region(&dumbbell(), &neck, &|_| asked.fetch_add(1, Ordering::Relaxed) < allowed);
        assert_eq!(found.unwrap_err(), GrowError::Cancelled, "after {allowed} of {total}");
    }
}

/// Invariant: Every mask has a closed manifold surface that is oriented outwards, on any grid;
/// results do not depend on the number of threads.
#[test]
fn regions_are_the_same_on_any_number_of_threads() {
    let noisy = super::shapes::noise([100, 60, 70], 33, 7);
    let values = super::shapes::indices(noisy.grid()).map(|index| i16::from(noisy.contains(index))).collect();
    let noisy_volume = Volume::new(noisy.grid().clone(), values).unwrap();
    let seed =
        super::shapes::indices(noisy.grid()).find(|index| noisy.contains(*index) && index[2] == 35).unwrap();
    let seed = Point::new(seed[0] as f64, seed[1] as f64, seed[2] as f64);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let limited = GrowLimits { max_ml: Some(0.02), ..GrowLimits::default() };
        let what = |limits| Grow { seeds: vec![seed], hu: [1, 1], limits };
        pool.install(|| {
            let whole = grow_region(&noisy_volume, &what(GrowLimits::default()), &|_| true).unwrap().mask;
            (whole, grow_region(&noisy_volume, &what(limited), &|_| true).map(|grown| grown.voxels))
        })
    };
    let alone = on(1);
    assert!(on(2) == alone && on(4) == alone, "the volume at which a leak is reported is the same too");
}
