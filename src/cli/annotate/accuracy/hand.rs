//! The noise of a resting hand's tip, by the tracking of the experiment.

use anyhow::Context;
use glam::DVec3;
use rayon::prelude::*;

use crate::cli::track_experiment::survey;
use crate::tracking::Beacon;
use crate::tracking::experiment::Setting;
use crate::tracking::pose::SensorPose;
use crate::tracking::sensor::{Pinhole, TYPICAL_FOCAL_PX};
use crate::tracking::simulate::{Delivery, Hand, Path, Simulation};
use crate::tracking::tracker::{Options, Tracker};

/// How long a hand rests before it places something, seconds, and the part of it in which the user sees where the cursor is.
const RESTS_S: f64 = 2.0;
const SEES_S: f64 = 1.0;

/// By how much the focal length differs from a typical one, as the experiment has it.
const FOCAL_ERROR: f64 = 0.03;

/// A hand that does not move.
struct Resting(SensorPose);

impl Path for Resting {
    fn at(&self, _seconds: f64) -> SensorPose {
        self.0
    }
}

/// For each of `count` placings, and each lever: how far the tip is from where the user brought it, mm along the beacon's axes.
///
/// # Errors
/// When the survey does not calibrate the camera, or a hand is not tracked.
pub(super) fn noise(
    distance_mm: f64,
    levers_mm: &[f64],
    count: usize,
    seed: u64,
) -> anyhow::Result<Vec<Vec<DVec3>>> {
    let setting = Setting::new(Pinhole::simple(TYPICAL_FOCAL_PX * (1.0 + FOCAL_ERROR)), seed);
    let camera = survey(&setting).context("the simulated survey did not calibrate the camera")?.camera;
    let beacon = Beacon::recommended();
    let hand = Hand::before(&beacon, distance_mm, seed);
    (0..count)
        .into_par_iter()
        .map(|number| {
            // Somewhere on the way of a hand that moves about.
            let resting = Resting(hand.at(number as f64 * 1.37));
            let simulation = Simulation {
                camera: setting.camera,
                sensing: setting.sensing,
                delivery: Delivery::RADIO,
                ..Simulation::new(beacon.clone(), seed ^ (number as u64 + 1) << 24)
            };
            let mut tracker = Tracker::new(camera, beacon.clone(), Options::default());
            let mut poses = Vec::new();
            for made in simulation.record(&resting, RESTS_S) {
                let sample = tracker.push(made.t_ns, &made.report);
                poses.extend(sample.and_then(|sample| Some((sample.t_ns, sample.pose?))));
            }
            let last = poses.last().map(|(t_ns, _)| *t_ns).context("a resting hand was not tracked")?;
            poses.retain(|(t_ns, _)| (last - t_ns) as f64 * 1e-9 <= SEES_S);
            Ok(levers_mm.iter().map(|lever_mm| off_mean(&poses, *lever_mm)).collect())
        })
        .collect()
}

/// How far the last tip is from the mean one: where the user sees the cursor.
fn off_mean(poses: &[(u64, SensorPose)], lever_mm: f64) -> DVec3 {
    let tip = |pose: &SensorPose| {
        let turned = pose.orientation.to_rotation_matrix();
        let tip = pose.position + turned.matrix().column(2) * lever_mm;
        DVec3::new(tip.x, tip.y, tip.z)
    };
    let mean = poses.iter().map(|(_, pose)| tip(pose)).sum::<DVec3>() / poses.len().max(1) as f64;
    poses.last().map_or(DVec3::ZERO, |(_, pose)| tip(pose) - mean)
}
