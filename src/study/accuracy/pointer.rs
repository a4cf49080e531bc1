//! Pointers beside the Wiimote in the hand of the same simulated user.
//!
//! The product's own gestures and events turn movements into intents; devices are noise. The phone's
//! part is a page in JavaScript, whose arithmetic is repeated here. A figure without a source is an
//! assumption. View axes, mm.

use std::fmt;

use glam::DVec3;
use nalgebra::Vector3;
use rayon::prelude::*;

use super::hand::{
    self, CORRECTS, LET_GO_MM, MOVES_S, RestingHand, SECONDS, SimulatedHand, Tracked, Watcher, led,
};
use crate::StudyError;
use relief_live::{HandOptions, Intent, SPACENAV_EVENT_BYTES, SpaceMouseEvent};
use relief_tracking::{Beacon, PointingHand, Random, SensorPath, TrackingState};

/// A device with which landmarks are placed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointerKind {
    /// A Wiimote, tracked by its infrared camera.
    Wiimote,
    /// A tool of an optical tracker (OpenIGTLink).
    Tracker,
    /// A tool behind OpenTrack.
    OpenTrack,
    /// A SpaceMouse (spacenavd).
    SpaceMouse,
    /// The orientation of a phone.
    Phone,
}

/// Noise of a tracker: samples a second, standard deviations of each coordinate in mm and of each
/// angle in degrees.
struct TrackerNoise {
    hertz: f64,
    position_mm: f64,
    angle_deg: f64,
}

/// An optical tracker for surgery: 0.25 mm rms in its volume at 60 Hz, as makers state; the angle of
/// markers 100 mm apart.
const OPTICAL: TrackerNoise = TrackerNoise { hertz: 60.0, position_mm: 0.25, angle_deg: 0.2 };
/// A webcam and three lights, after OpenTrack's filter.
const WEBCAM: TrackerNoise = TrackerNoise { hertz: 30.0, position_mm: 0.5, angle_deg: 0.3 };

/// Interval of spacenavd's events, ms, and its deflection at full.
const EVENT_MS: i32 = 16;
const FULL: f64 = 350.0;
/// Full deflection moves the cursor so far in a second, mm: what the user has learned.
const LEARNED_MM_S: f64 = 60.0;
/// How unsteady a hand holds a deflection, as a share of the full one.
const UNSTEADY: f64 = 0.02;

/// A phone's events a second, and the rounding of their angles, degrees: browsers must not be more
/// precise (W3C Device Orientation and Motion, 2024, section 7).
const PHONE_HERTZ: f64 = 60.0;
const PHONE_STEP_DEG: f64 = 0.1;
/// Noise of the fused orientation, degrees.
const PHONE_NOISE_DEG: f64 = 0.05;
/// The phone turns by this for the height of the picture.
const DEGREES_A_HEIGHT: f64 = 30.0;

/// And by this share of it while Place is held.
const PRECISE_GAIN: f64 = 0.2;
/// The user presses Place when the cursor seems this near, or after this time, s.
const PRESS_MM: f64 = 2.0;
const PRESS_S: f64 = 3.5;

/// The user gives up getting nearer after this time, s.
const LONGEST_S: f64 = 8.0;
/// And takes at least this time.
const SHORTEST_S: f64 = 1.0;

impl PointerKind {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Wiimote, Self::Tracker, Self::OpenTrack, Self::SpaceMouse, Self::Phone];

    /// Its name in options and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Wiimote => "wiimote",
            Self::Tracker => "tracker",
            Self::OpenTrack => "opentrack",
            Self::SpaceMouse => "spacemouse",
            Self::Phone => "phone",
        }
    }

    /// Ways to place: `ray` for all, `tip` for those that move a cursor in depth, too.
    pub(super) const fn ways(self) -> &'static [&'static str] {
        match self {
            Self::Phone => &["ray"],
            _ => &["ray", "tip"],
        }
    }

    /// Mappings of hand movements to cursor movements, by name. Others than those of the Wiimote
    /// have what a session begins with.
    pub(super) fn mappings(self, distance_mm: f64) -> Vec<(&'static str, HandOptions)> {
        let default = ("default", HandOptions::default());
        if self != Self::Wiimote {
            return vec![default];
        }
        let direct = HandOptions { precise_gain: 1.0, steady_s: 0.0, ..HandOptions::default() };
        let lever = HandOptions { tip_mm: distance_mm, ..direct.clone() };
        vec![("direct", direct), ("lever", lever), default]
    }

    /// For each of `count` placings, and each mapping: how far from the place that was meant the
    /// cursor was set down, mm along view axes. `height_mm` is that of the picture.
    ///
    /// # Errors
    /// When a hand is not tracked.
    pub(super) fn place(
        self,
        placer: SimulatedHand,
        mappings: &[HandOptions],
        count: usize,
        height_mm: f64,
    ) -> Result<Vec<Vec<DVec3>>, StudyError> {
        let SimulatedHand { distance_mm, tremor_g, seed } = placer;
        if self == Self::Wiimote {
            return hand::place(placer, mappings, count);
        }
        let hand = PointingHand::before(&Beacon::recommended(), distance_mm, seed);
        (0..count)
            .into_par_iter()
            .map(|number| {
                let own = seed ^ (number as u64 + 1) << 24;
                let path = RestingHand::new(hand.at(number as f64 * 1.37), tremor_g, &mut Random::new(own));
                mappings
                    .iter()
                    .map(|mapping| match self {
                        Self::SpaceMouse => by_spacemouse(own),
                        Self::Phone => by_phone(&path, height_mm, own),
                        Self::OpenTrack => hand::place_tracked(&tracked(&path, &WEBCAM, own), mapping, own),
                        _ => hand::place_tracked(&tracked(&path, &OPTICAL, own), mapping, own),
                    })
                    .collect()
            })
            .collect()
    }
}

impl fmt::Display for PointerKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Poses of a tool as a tracker gives them.
fn tracked(path: &RestingHand, noise: &TrackerNoise, seed: u64) -> Tracked {
    let mut random = Random::new(seed ^ 0x7001);
    let mut blur = |sigma: f64| Vector3::from_fn(|_, _| sigma * random.normal());
    let pose = |number: usize| {
        let seconds = number as f64 / noise.hertz;
        let mut pose = path.at(seconds);
        pose.position += blur(noise.position_mm);
        pose.orientation = pose.orientation.append_axisangle_linearized(&blur(noise.angle_deg.to_radians()));
        ((seconds * 1e9) as u64, TrackingState::Tracking, Some(pose))
    };
    (0..(SECONDS * noise.hertz) as usize).map(pose).collect()
}

/// Whether the user sets the cursor down that seems to be so far off.
fn is_due(now: f64, off: DVec3) -> bool {
    now >= SHORTEST_S && (off.length() <= LET_GO_MM || now >= LONGEST_S)
}

/// Pushes the cap for a moment after each look, while the first button is held.
fn by_spacemouse(seed: u64) -> Result<DVec3, StudyError> {
    let mut watcher = Watcher::new(seed);
    let (mut cursor, mut push, mut pushed_s) = (DVec3::ZERO, DVec3::ZERO, f64::NEG_INFINITY);
    for number in 0.. {
        let now = f64::from(number * EVENT_MS) / 1e3;
        if let Some(off) = watcher.watch(now, cursor) {
            if is_due(now, off) {
                return Ok(cursor - watcher.wanted);
            }
            let deflection = watcher.clumsily(off * (CORRECTS / (LEARNED_MM_S * MOVES_S)));
            (push, pushed_s) = (deflection.clamp(DVec3::NEG_ONE, DVec3::ONE), now);
        }
        if now - pushed_s >= MOVES_S {
            continue;
        }
        let shaken = push + DVec3::from([0; 3].map(|_| UNSTEADY * watcher.random.normal()));
        cursor += shift_of(SpaceMouseEvent::read(&motion(shaken)));
    }
    Err(StudyError::HandLost)
}

/// An event of spacenavd for a deflection along view axes.
fn motion(deflection: DVec3) -> [u8; SPACENAV_EVENT_BYTES] {
    let [x, y, z] = (deflection * FULL).round().to_array().map(|units| units as i32);
    let mut bytes = [0; SPACENAV_EVENT_BYTES];
    for (to, number) in bytes.as_chunks_mut::<4>().0.iter_mut().zip([0, x, y, -z, 0, 0, 0, EVENT_MS]) {
        *to = number.to_ne_bytes();
    }
    bytes
}

/// The movement of the cursor by an event.
fn shift_of(event: SpaceMouseEvent) -> DVec3 {
    let moved = event.intents(true).into_iter().filter_map(|intent| match intent {
        Intent::Cursor { by_view_mm, .. } => by_view_mm.map(DVec3::from_array),
        _ => None,
    });
    moved.sum()
}

/// Holds Point and turns the phone, then holds Place, too; the picture decides about depth.
fn by_phone(path: &RestingHand, height_mm: f64, seed: u64) -> Result<DVec3, StudyError> {
    let mut watcher = Watcher::new(seed);
    watcher.wanted.z = 0.0;
    let mm_per_degree = height_mm / DEGREES_A_HEIGHT;
    let mut way = ([DVec3::ZERO; 2], 0.0);
    // Where a button was pressed: the angles, the cursor, and the share of movements.
    let mut anchor = None;
    for number in 0.. {
        let now = f64::from(number) / PHONE_HERTZ;
        let forward = path.at(now).orientation * Vector3::z();
        let (right, up) = (forward.x.atan2(-forward.z), forward.y.asin());
        let led_deg = led(way.0, way.1, now);
        let mut sensed = |angle: f64, led_deg: f64| {
            let degrees = angle.to_degrees() + led_deg + PHONE_NOISE_DEG * watcher.random.normal();
            (degrees / PHONE_STEP_DEG).round() * PHONE_STEP_DEG
        };
        let angles = DVec3::new(sensed(right, led_deg.x), sensed(up, led_deg.y), 0.0);
        let (from, start, gain) = *anchor.get_or_insert((angles, DVec3::ZERO, 1.0));
        let cursor = start + (angles - from) * (mm_per_degree * gain);
        let Some(off) = watcher.watch(now, cursor).map(|off| off.with_z(0.0)) else { continue };
        if gain < 1.0 && is_due(now, off) {
            return Ok(cursor - watcher.wanted);
        }
        let is_near = off.length() <= PRESS_MM || now >= PRESS_S;
        if gain == 1.0 && now >= SHORTEST_S && is_near {
            anchor = Some((angles, cursor, PRECISE_GAIN));
            continue;
        }
        let turn = watcher.clumsily(off * (CORRECTS / (mm_per_degree * gain))).with_z(0.0);
        way = ([led_deg, led_deg + turn], now);
    }
    Err(StudyError::HandLost)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_user_ends_near_the_place_that_is_meant() {
        let placer = SimulatedHand { distance_mm: 1200.0, tremor_g: 0.01, seed: 3 };
        for pointer in PointerKind::ALL.into_iter().skip(1) {
            let offsets = pointer.place(placer, &[HandOptions::default()], 16, 120.0).unwrap();
            let mut errors: Vec<f64> = offsets.iter().map(|each| each[0].length()).collect();
            errors.sort_by(f64::total_cmp);
            let again = pointer.place(placer, &[HandOptions::default()], 16, 120.0).unwrap();
            assert_eq!(offsets, again, "{pointer}: the same seed places in the same way");
            assert!((0.1..1.5).contains(&errors[8]), "{pointer}: {errors:?}");
        }
    }

    #[test]
    fn deflections_are_events_of_the_product() {
        let moved = shift_of(SpaceMouseEvent::read(&motion(DVec3::new(1.0, -0.5, 0.2))));
        let expected = DVec3::new(1.0, -0.5, 0.2) * (LEARNED_MM_S * f64::from(EVENT_MS) / 1e3);
        assert!((moved - expected).length() < 1e-9, "{moved}");
    }
}
