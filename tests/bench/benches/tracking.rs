//! Times of tracking: single views by each solver, correspondence, a filter's step, reports, and
//! the whole of it.
//!
//! cargo bench -p relief-bench --bench tracking [FILTER]
//!
//! Each number is of one view or one report, from sets of random ones, so that neither caches nor
//! luck decide. With the feature `ipopt` there is IPOPT beside the solver of our own.
#![expect(clippy::unwrap_used, reason = "views and reports are made here: what fails is the benchmark")]

use std::hint::black_box;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use nalgebra::Vector2;
use relief_tracking::{
    Beacon, EarlierPose, ErrorStateFilter, FilterKind, IdentifyHints, InputReport, MotionDensity, Pinhole,
    PointingHand, Pose, PoseView, Random, Sighting, SimulatedReport, Simulation, Tracker, TrackerOptions,
    ViewRange, identify_blobs, quantised_noise, random_sightings,
};

const VIEWS: usize = 256;
const CAMERA: Pinhole = Pinhole::TYPICAL;

/// Random views with half a pixel of noise, and their true poses.
fn views(beacon: &Beacon) -> Vec<(Pose, Vec<Sighting>)> {
    let mut random = Random::new(1);
    let mut view = || {
        let truth = random.view(beacon, &CAMERA, &ViewRange::USUAL);
        (truth, random_sightings(beacon, &CAMERA, &truth, 0.5, &mut random))
    };
    (0..VIEWS).map(|_| view()).collect()
}

fn view_of(sightings: &[Sighting]) -> PoseView<'_> {
    PoseView { camera: &CAMERA, sightings, noise_px: quantised_noise(0.5), gravity: None }
}

fn solvers(criterion: &mut Criterion) {
    let views = views(&Beacon::recommended());
    let mut group = criterion.benchmark_group("view");
    let mut at = views.iter().cycle();
    let mut next = || at.next().unwrap();
    group.bench_function("global start and LM", |b| {
        b.iter(|| view_of(&black_box(next()).1).solve().unwrap().best.cost);
    });
    group.bench_function("LM from a pose nearby", |b| {
        b.iter(|| {
            let (truth, seen) = black_box(next());
            view_of(seen).refine(truth).unwrap().cost
        });
    });
    let level = relief_tracking::level_start(1500.0);
    group.bench_function("the 2009 way from a level start", |b| {
        b.iter(|| {
            relief_tracking::solve_as_published(&view_of(&black_box(next()).1), &level)
                .map(|found| found.energy)
        });
    });
    #[cfg(feature = "ipopt")]
    group.bench_function("the 2009 way by IPOPT", |b| {
        b.iter(|| {
            relief_tracking::solve_with_ipopt(&view_of(&black_box(next()).1), &level)
                .map(|found| found.energy)
        });
    });
    group.finish();
}

fn correspondence(criterion: &mut Criterion) {
    let beacon = Beacon::recommended();
    let blobs = |(truth, seen): &(Pose, Vec<Sighting>)| {
        (*truth, seen.iter().rev().map(|sighting| sighting.pixel).collect::<Vec<Vector2<f64>>>())
    };
    let views: Vec<_> = views(&beacon).iter().map(blobs).collect();
    let mut group = criterion.benchmark_group("correspondence");
    let mut at = views.iter().cycle();
    let mut next = || at.next().unwrap();
    let noise_px = quantised_noise(0.5);
    group.bench_function("four blobs, nothing known", |b| {
        b.iter(|| {
            identify_blobs(&CAMERA, &beacon, &black_box(next()).1, noise_px, &IdentifyHints::default())
        });
    });
    group.bench_function("four blobs, an earlier pose", |b| {
        b.iter(|| {
            let (pose, blobs) = black_box(next());
            let earlier = EarlierPose { pose: *pose, sigma_angle: 0.03, sigma_mm: 60.0, reach_px: 150.0 };
            identify_blobs(
                &CAMERA,
                &beacon,
                blobs,
                noise_px,
                &IdentifyHints { gravity: None, earlier: Some(earlier) },
            )
        });
    });
    group.finish();
}

fn filter(criterion: &mut Criterion) {
    let views = views(&Beacon::recommended());
    let mut at = views.iter().cycle();
    criterion.bench_function("filter/predict and four LEDs", |b| {
        let begin = || {
            let (truth, seen) = at.next().unwrap();
            let bound = view_of(seen).bound(truth).unwrap();
            (ErrorStateFilter::new(truth, &bound, MotionDensity::HAND), seen)
        };
        let step = |(mut filter, seen): (ErrorStateFilter, &Vec<Sighting>)| {
            filter.predict(0.01);
            filter.update_pixels(&CAMERA, seen, quantised_noise(0.5));
            filter
        };
        b.iter_batched(begin, step, BatchSize::SmallInput);
    });
}

fn reports(criterion: &mut Criterion) {
    let simulation = Simulation { gyroscope: true, ..Simulation::new(Beacon::recommended(), 1) };
    let made = simulation.record(&PointingHand::before(&simulation.beacon, 1300.0, 1), 10.0);
    let bytes: Vec<_> = made.iter().map(|made| made.report.encode()).collect();
    let mut at = bytes.iter().cycle();
    criterion.bench_function("report/decode", |b| {
        b.iter(|| InputReport::decode(black_box(at.next().unwrap())).unwrap());
    });
    let mut group = criterion.benchmark_group("tracker, a report");
    for (name, filter) in
        [("error-state", FilterKind::ErrorState), ("pose", FilterKind::Pose), ("none", FilterKind::None)]
    {
        let options = TrackerOptions { filter, use_gyroscope: true, ..TrackerOptions::default() };
        let mut tracker = Tracker::new(simulation.camera, simulation.beacon.clone(), options);
        // Time goes on when the recording begins anew.
        let period_ns = made.last().unwrap().t_ns;
        let (mut rounds, mut index) = (0, 0);
        group.bench_function(name, |b| {
            b.iter(|| {
                let SimulatedReport { t_ns, report, .. } = black_box(&made[index]);
                let sample = tracker.push(t_ns + rounds * period_ns, report);
                index += 1;
                if index == made.len() {
                    (index, rounds) = (0, rounds + 1);
                }
                sample
            });
        });
    }
    group.finish();
}

criterion_group!(benches, solvers, correspondence, filter, reports);
criterion_main!(benches);
