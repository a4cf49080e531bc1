//! Random numbers for simulations, and random views of a beacon.
//!
//! Simulations guarantee the sequence of a seed, so it is written out here:
//! `SplitMix64` (Steele, Lea and Flood 2014), and normal numbers by Box and Muller's formula.

use nalgebra::{Vector2, Vector3};

use super::{MAX_SEEN, Sighting};
use crate::beacon::Beacon;
use crate::pose::{Pose, SensorPose};
use crate::report::{SENSOR_HEIGHT, SENSOR_WIDTH};
use crate::sensor::Pinhole;

/// A sequence of random numbers that follows from its seed.
#[derive(Clone, Debug)]
pub struct Random {
    state: u64,
}

impl Random {
    /// The sequence of this seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Evenly between `low` and `high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        let unit = (self.bits() >> 11) as f64 / (1_u64 << 53) as f64;
        low + (high - low) * unit
    }

    /// Normal, mean 0, standard deviation 1.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.between(0.0, 1.0)).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.between(0.0, 1.0)).cos()
    }

    /// Three normal numbers.
    pub fn normal3(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.normal())
    }

    /// A sensor that sees the whole beacon: `distance_mm` away, within `tilt` radians of the
    /// beacon's z axis sideways and up and down, rolled by up to `roll` radians, the beacon
    /// anywhere in the picture.
    pub fn view(&mut self, beacon: &Beacon, camera: &Pinhole, range: &ViewRange) -> Pose {
        loop {
            let distance = self.between(range.distance_mm[0], range.distance_mm[1]);
            let (yaw, pitch) = (self.between(-range.tilt, range.tilt), self.between(-range.tilt, range.tilt));
            let from = Vector3::new(yaw.sin() * pitch.cos(), pitch.sin(), yaw.cos() * pitch.cos());
            let aside = Vector3::from_fn(|_, _| self.between(-0.25, 0.25) * distance);
            let target = beacon.centroid() + aside;
            let position = beacon.centroid() + from * distance;
            let roll = self.between(-range.roll, range.roll);
            let Some(pose) = SensorPose::looking_at(position, target, beacon.up(), roll) else { continue };
            let pose = pose.inverse();
            if beacon.leds().iter().all(|led| is_seen(camera, &pose, led)) {
                return pose;
            }
        }
    }
}

/// From where views are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewRange {
    /// Nearest and farthest, mm.
    pub distance_mm: [f64; 2],
    /// Largest angle off the beacon's axis, radians, both sideways and up and down.
    pub tilt: f64,
    /// Largest roll, radians.
    pub roll: f64,
}

impl ViewRange {
    /// 1 to 2 m, 30 degrees off the axis, 30 degrees of roll.
    pub const USUAL: Self = Self {
        distance_mm: [1000.0, 2000.0],
        tilt: std::f64::consts::FRAC_PI_6,
        roll: std::f64::consts::FRAC_PI_6,
    };
}

/// The first four LEDs as a camera at this pose sees them, with normal noise of `noise_px`; LEDs
/// behind it are left out.
#[must_use]
pub fn random_sightings(
    beacon: &Beacon,
    camera: &Pinhole,
    pose: &Pose,
    noise_px: f64,
    random: &mut Random,
) -> Vec<Sighting> {
    let see = |led: &Vector3<f64>| {
        let noise = Vector2::new(random.normal(), random.normal()) * noise_px;
        Some(Sighting { led: *led, pixel: camera.project(&pose.place(led))? + noise })
    };
    beacon.leds().iter().take(MAX_SEEN).filter_map(see).collect()
}

/// Whether an LED is inside the picture, off its border.
#[must_use]
pub(crate) fn is_seen(camera: &Pinhole, pose: &Pose, led: &Vector3<f64>) -> bool {
    let inside = |pixel: Vector2<f64>| {
        (1.0..f64::from(SENSOR_WIDTH) - 2.0).contains(&pixel.x)
            && (1.0..f64::from(SENSOR_HEIGHT) - 2.0).contains(&pixel.y)
    };
    camera.project(&pose.place(led)).is_some_and(inside)
}
