//! Views for a calibration: blobs identified with the nominal camera, and of thousands of frames
//! the few that differ.

use nalgebra::Vector2;

use crate::beacon::Beacon;
use crate::correspondence::{EarlierPose, Identified, IdentifyHints, identify_blobs};
use crate::pose::Pose;
use crate::report::{InputReport, SENSOR_HEIGHT, SENSOR_WIDTH};
use crate::sensor::Pinhole;
use crate::solve::{MAX_SEEN, Sighting};
use crate::tracker::{Frames, TrackerOptions};

/// The nominal camera may be wrong by 3 % and 25 px, which leaves errors of a few pixels in a view.
const NOMINAL_NOISE_PX: f64 = 2.0;
/// Poses nearer than this to a chosen one are the same view: radians and mm.
const SAME_ANGLE: f64 = 0.03;
const SAME_MM: f64 = 30.0;

/// Four LEDs in one picture.
#[derive(Clone, Debug)]
pub struct CalibrationView {
    /// LEDs and pixels.
    pub sightings: Vec<Sighting>,
    /// `sensor_from_beacon` by the nominal camera.
    pub pose: Pose,
}

/// Identifies the blobs of a recording, frame after frame.
#[derive(Clone, Debug)]
pub struct BlobIdentifier {
    frames: Frames,
    beacon: Beacon,
    camera: Pinhole,
    last: Option<(u64, Pose)>,
    options: TrackerOptions,
}

impl BlobIdentifier {
    /// With the nominal camera.
    #[must_use]
    pub fn new(beacon: Beacon, camera: Pinhole) -> Self {
        let options = TrackerOptions::default();
        Self {
            frames: Frames::new(options.accelerometer, options.gyroscope),
            beacon,
            camera,
            last: None,
            options,
        }
    }

    /// Takes a report; returns a view when the report shows four identifiable LEDs.
    pub fn push(&mut self, t_ns: u64, report: &InputReport) -> Option<CalibrationView> {
        let frame = self.frames.push(t_ns, report)?;
        let blobs = frame.blobs();
        if blobs.len() < MAX_SEEN {
            return None;
        }
        let recent = self.last.map(|(then, pose)| (pose, t_ns.saturating_sub(then) as f64 * 1e-9));
        let earlier = recent.filter(|(_, seconds)| *seconds < 0.1).map(|(pose, seconds)| EarlierPose {
            pose,
            sigma_angle: 0.05 + seconds,
            sigma_mm: 50.0 + 500.0 * seconds,
            reach_px: 15.0 + 2.0 * self.camera.fx * seconds,
        });
        let gravity = frame.gravity(&self.beacon, self.options.search_gravity_sigma);
        let hints = IdentifyHints { gravity, earlier };
        let Identified::Found { assignment, refined, .. } =
            identify_blobs(&self.camera, &self.beacon, blobs, NOMINAL_NOISE_PX, &hints)
        else {
            return None;
        };
        self.last = Some((t_ns, refined.pose));
        let sighting = |(blob, led): (&Vector2<f64>, &Option<usize>)| {
            Some(Sighting { led: self.beacon.leds()[(*led)?], pixel: *blob })
        };
        let sightings: Option<Vec<Sighting>> = blobs.iter().zip(&assignment).map(sighting).collect();
        Some(CalibrationView { sightings: sightings?, pose: refined.pose })
    }
}

/// The views in which a blob is at least two pixels from where it was in the last one: a remote
/// that rests says the same again, with the same errors of rounding.
#[must_use]
pub fn moving_views(mut views: Vec<CalibrationView>) -> Vec<CalibrationView> {
    const MOVED_PX: f64 = 2.0;
    views.dedup_by(|view, last| {
        let pairs = view.sightings.iter().zip(&last.sightings);
        pairs.into_iter().all(|(now, then)| now.led == then.led && (now.pixel - then.pixel).norm() < MOVED_PX)
    });
    views
}

/// At most `count` views, none like another, those first that differ most.
#[must_use]
pub fn choose_views(mut views: Vec<CalibrationView>, count: usize) -> Vec<CalibrationView> {
    let mut chosen: Vec<CalibrationView> = Vec::new();
    let mut nearest = vec![f64::INFINITY; views.len()];
    let mut at = 0;
    while chosen.len() < count && !views.is_empty() {
        let view = views.swap_remove(at);
        nearest.swap_remove(at);
        for (distance, other) in nearest.iter_mut().zip(&views) {
            let (angle, mm) = view.pose.distance(&other.pose);
            *distance = distance.min((angle / SAME_ANGLE).hypot(mm / SAME_MM));
        }
        chosen.push(view);
        let farthest = nearest.iter().enumerate().max_by(|(_, a), (_, b)| a.total_cmp(b));
        match farthest {
            Some((next, distance)) if *distance > 1.0 => at = next,
            _ => break,
        }
    }
    chosen
}

/// The largest angle between the directions from which two views look at the beacon; of many views,
/// some stand for all.
pub(super) fn tilt(views: &[CalibrationView]) -> f64 {
    let some = views.iter().step_by(views.len().div_ceil(500).max(1));
    let directions: Vec<_> =
        some.filter_map(|view| view.pose.inverse().position.try_normalize(1e-9)).collect();
    let angle = |a: &nalgebra::Vector3<f64>, b: &nalgebra::Vector3<f64>| a.angle(b);
    let pairs =
        directions.iter().enumerate().flat_map(|(i, a)| directions[..i].iter().map(move |b| angle(a, b)));
    pairs.fold(0.0, f64::max)
}

/// The share of the picture between the outermost blobs, across and down.
pub(super) fn coverage(views: &[CalibrationView]) -> [f64; 2] {
    let size = [f64::from(SENSOR_WIDTH), f64::from(SENSOR_HEIGHT)];
    std::array::from_fn(|axis| {
        let all = views.iter().flat_map(|view| &view.sightings).map(|sighting| sighting.pixel[axis]);
        let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        ((high - low) / size[axis]).max(0.0)
    })
}
