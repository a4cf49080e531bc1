//! A user in simulation: a hand that trembles and drifts, tracked as in the experiment, and eyes
//! that lead the cursor to a place.
//!
//! Tracker and gestures are the product's own; hand and user are simulated. A figure without a
//! source is an assumption. View axes equal the beacon's axes; mm.

use std::f64::consts::TAU;

use glam::DVec3;
use rayon::prelude::*;

use crate::StudyError;
use relief_live::{Gestures, HandOptions, HandPose, HandSample, Intent, PlacePhase};
use relief_tracking::{
    Beacon, Buttons, ExperimentSetting, Pinhole, PointingHand, Random, ReportDelivery, SensorPath,
    SensorPose, Simulation, TYPICAL_FOCAL_PX, Tracker, TrackerOptions, TrackingState, simulate_survey,
};

/// The difference of the focal length from a typical one, as in the experiment.
const FOCAL_ERROR: f64 = 0.03;

/// Postural tremor of a hand: a peak at about 7 Hz, and physiological tremor up to 12 Hz.
const TREMOR_HZ: [f64; 5] = [7.0, 8.3, 9.4, 10.6, 12.0];
/// From the wrist, about which a hand trembles, to where its acceleration is measured, mm.
const HAND_MM: f64 = 100.0;
/// Drift of a hand in the air: rms of each coordinate, mm, and of each angle, degrees.
const DRIFT_HZ: [f64; 3] = [0.3, 0.7, 1.6];
const DRIFT_MM: f64 = 0.5;
const DRIFT_DEG: f64 = 0.1;

/// Interval of the user's corrections, and the window before each over which the displayed position
/// is averaged, s: pictures are late, and eyes take time.
const LOOKS_S: f64 = 0.3;
const SEES_S: [f64; 2] = [0.3, 0.1];
/// How well the user sees how far the cursor is off (standard deviation), mm: a pixel across, twice
/// that in depth.
const SIGHT_MM: [f64; 3] = [0.25, 0.25, 0.5];
/// The part of that by which the user moves the hand, for how long, and how well.
pub(super) const CORRECTS: f64 = 0.7;
pub(super) const MOVES_S: f64 = 0.25;
const CLUMSY: f64 = 0.1;
/// The cursor begins so far off, mm at most along each axis.
const FROM_MM: f64 = 30.0;

/// The user presses A when the cursor seems this near, after a minimum time and at the latest after
/// a maximum, and releases it.
const PRESS_MM: f64 = 2.0;
const PRESS_S: [f64; 2] = [1.5, 3.5];
pub(super) const LET_GO_MM: f64 = 0.5;
const LET_GO_S: [f64; 2] = [1.0, 3.0];
/// The length of a recording of a hand.
pub(super) const SECONDS: f64 = PRESS_S[1] + LET_GO_S[1] + 1.0;

/// The hand and its tremor, and its distance from the beacon.
#[derive(Clone, Copy, Debug)]
pub(super) struct SimulatedHand {
    pub(super) distance_mm: f64,
    /// Peak acceleration of the tremor, standard gravities.
    pub(super) tremor_g: f64,
    pub(super) seed: u64,
}

/// One of the movements that a hand does not want.
struct Tremor {
    /// 0 to 2: a shift along an axis, mm; 3 to 5: a turn about it, radians.
    axis: usize,
    hertz: f64,
    amplitude: f64,
    phase: f64,
}

/// A hand that wants to rest.
pub(super) struct RestingHand {
    rest: SensorPose,
    waves: Vec<Tremor>,
}

impl RestingHand {
    pub(super) fn new(rest: SensorPose, tremor_g: f64, random: &mut Random) -> Self {
        let mut waves = Vec::new();
        for axis in 0..6 {
            for hertz in TREMOR_HZ {
                // Together as strong as one wave of that peak.
                let mm_s2 = tremor_g * 9806.65 / (TREMOR_HZ.len() as f64).sqrt();
                let shift_mm = mm_s2 / (TAU * hertz).powi(2);
                let amplitude = if axis < 3 { shift_mm } else { shift_mm / HAND_MM };
                waves.push(Tremor { axis, hertz, amplitude, phase: random.between(0.0, TAU) });
            }
            for hertz in DRIFT_HZ {
                let rms = if axis < 3 { DRIFT_MM } else { DRIFT_DEG.to_radians() };
                let amplitude = rms * (2.0 / DRIFT_HZ.len() as f64).sqrt();
                waves.push(Tremor { axis, hertz, amplitude, phase: random.between(0.0, TAU) });
            }
        }
        Self { rest, waves }
    }
}

impl SensorPath for RestingHand {
    fn at(&self, seconds: f64) -> SensorPose {
        let mut off = [0.0; 6];
        for Tremor { axis, hertz, amplitude, phase } in &self.waves {
            off[*axis] += amplitude * (TAU * hertz * seconds + phase).sin();
        }
        let SensorPose { mut position, orientation } = self.rest;
        let mut turn = position;
        for axis in 0..3 {
            position[axis] += off[axis];
            turn[axis] = off[3 + axis];
        }
        SensorPose { position, orientation: orientation.append_axisangle_linearized(&turn) }
    }
}

/// The tracker's poses of a hand that no user steers.
pub(super) type Tracked = Vec<(u64, TrackingState, Option<SensorPose>)>;

/// For each of `count` placings, and each mapping: how far from the place that was meant the cursor
/// was set down, mm along view axes.
///
/// # Errors
/// When the survey does not calibrate the camera, or a hand is not tracked.
pub(super) fn place(
    placer: SimulatedHand,
    mappings: &[HandOptions],
    count: usize,
) -> Result<Vec<Vec<DVec3>>, StudyError> {
    let SimulatedHand { distance_mm, tremor_g, seed } = placer;
    let setting = ExperimentSetting::new(Pinhole::simple(TYPICAL_FOCAL_PX * (1.0 + FOCAL_ERROR)), seed);
    let camera = simulate_survey(&setting)?.camera;
    let beacon = Beacon::recommended();
    let hand = PointingHand::before(&beacon, distance_mm, seed);
    (0..count)
        .into_par_iter()
        .map(|number| {
            let own = seed ^ (number as u64 + 1) << 24;
            // Somewhere on the way of a hand that moves about.
            let rest = hand.at(number as f64 * 1.37);
            let simulation = Simulation {
                camera: setting.camera,
                sensing: setting.sensing,
                delivery: ReportDelivery::RADIO,
                ..Simulation::new(beacon.clone(), own)
            };
            let mut tracker = Tracker::new(camera, beacon.clone(), TrackerOptions::default());
            let path = RestingHand::new(rest, tremor_g, &mut Random::new(own));
            let mut tracked = Tracked::new();
            for made in simulation.record(&path, SECONDS) {
                tracked.extend(
                    tracker
                        .push(made.t_ns, &made.report)
                        .map(|sample| (sample.t_ns, sample.state, sample.pose)),
                );
            }
            mappings.iter().map(|mapping| place_tracked(&tracked, mapping, own)).collect()
        })
        .collect()
}

/// The cursor's error when it is set down with a tracked hand.
///
/// # Errors
/// When the mapping is invalid, or the hand is not tracked.
pub(super) fn place_tracked(
    tracked: &Tracked,
    mapping: &HandOptions,
    seed: u64,
) -> Result<DVec3, StudyError> {
    User::new(mapping, seed)?.place(tracked)
}

/// The eyes of a user, and where the cursor is to be.
pub(super) struct Watcher {
    pub(super) random: Random,
    pub(super) wanted: DVec3,
    /// The cursor, and when it was there, s.
    shown: Vec<(f64, DVec3)>,
    looked_s: f64,
}

impl Watcher {
    pub(super) fn new(seed: u64) -> Self {
        let mut random = Random::new(seed ^ 0x5eed);
        let wanted = DVec3::from(std::array::from_fn(|_| random.between(-FROM_MM, FROM_MM)));
        Self { random, wanted, shown: Vec::new(), looked_s: 0.0 }
    }

    /// The apparent distance of the cursor from its target; `None` between two looks.
    pub(super) fn watch(&mut self, now: f64, cursor: DVec3) -> Option<DVec3> {
        self.shown.push((now, cursor));
        if now - self.looked_s < LOOKS_S {
            return None;
        }
        self.looked_s = now;
        let seen = |at: f64| (now - SEES_S[0]..=now - SEES_S[1]).contains(&at);
        let places: Vec<DVec3> =
            self.shown.iter().filter(|(at, _)| seen(*at)).map(|(_, place)| *place).collect();
        let mean = places.iter().sum::<DVec3>() / places.len() as f64;
        let blur = DVec3::from(SIGHT_MM.map(|sight| sight * self.random.normal()));
        (!places.is_empty()).then(|| self.wanted - mean + blur)
    }

    /// A movement as the hand makes it.
    pub(super) fn clumsily(&mut self, movement: DVec3) -> DVec3 {
        movement + DVec3::from([0; 3].map(|_| self.random.normal())) * (CLUMSY * movement.length())
    }
}

/// The present target of a hand: smoothly from one place to another, from `since` on.
pub(super) fn led([from, to]: [DVec3; 2], since: f64, now: f64) -> DVec3 {
    let share = ((now - since) / MOVES_S).clamp(0.0, 1.0);
    from.lerp(to, share * share * (3.0 - 2.0 * share))
}

/// A user who watches the cursor and steers it.
struct User<'a> {
    mapping: &'a HandOptions,
    gestures: Gestures,
    watcher: Watcher,
    cursor: DVec3,
    /// The hand's way: from where to where, since when.
    way: (DVec3, DVec3, f64),
    /// Since when A is held.
    pressed_s: Option<f64>,
}

impl<'a> User<'a> {
    fn new(mapping: &'a HandOptions, seed: u64) -> Result<Self, StudyError> {
        Ok(Self {
            mapping,
            gestures: Gestures::new(mapping.clone())?,
            watcher: Watcher::new(seed),
            cursor: DVec3::ZERO,
            way: (DVec3::ZERO, DVec3::ZERO, 0.0),
            pressed_s: None,
        })
    }

    /// The cursor's error when it is set down.
    fn place(mut self, tracked: &Tracked) -> Result<DVec3, StudyError> {
        let first = tracked.first().ok_or(StudyError::HandLost)?.0;
        for (t_ns, state, pose) in tracked {
            let now = (t_ns - first) as f64 * 1e-9;
            // The hand goes where the user leads it; a few millimetres change nothing of how well
            // it is tracked.
            let led = self.hand(now);
            let pose = pose.and_then(|pose| {
                let position = DVec3::from_array(pose.position.into()) + led;
                HandPose::new(position.to_array(), pose.orientation_xyzw()).ok()
            });
            let intents = self.gestures.track(&HandSample { t_ns: *t_ns, state: *state, pose });
            self.follow(&intents);
            let Some(off) = self.watcher.watch(now, self.cursor) else { continue };
            let is_due = |since: f64, [least, most]: [f64; 2], near: f64| {
                now - since >= least && (off.length() <= near || now - since >= most)
            };
            let buttons = match self.pressed_s {
                None if is_due(0.0, PRESS_S, PRESS_MM) => Some(Buttons::A),
                Some(since) if is_due(since, LET_GO_S, LET_GO_MM) => Some(Buttons::default()),
                _ => None,
            };
            let Some(buttons) = buttons else {
                self.correct(now, off);
                continue;
            };
            let intents = self.gestures.hold(*t_ns, buttons);
            self.follow(&intents);
            if intents.contains(&Intent::Place { phase: PlacePhase::Commit }) {
                return Ok(self.cursor - self.watcher.wanted);
            }
            self.pressed_s = Some(now);
        }
        Err(StudyError::HandLost)
    }

    fn follow(&mut self, intents: &[Intent]) {
        for intent in intents {
            if let Intent::Cursor { at_view_mm: Some(at), .. } = intent {
                self.cursor = DVec3::from_array(*at);
            }
        }
    }

    /// The present target of the hand.
    fn hand(&self, now: f64) -> DVec3 {
        let (from, to, since) = self.way;
        led([from, to], since, now)
    }

    fn correct(&mut self, now: f64, off: DVec3) {
        let share = if self.pressed_s.is_some() { self.mapping.precise_gain } else { 1.0 };
        let move_by = self.watcher.clumsily(off * (CORRECTS / (self.mapping.gain * share)));
        let from = self.hand(now);
        self.way = (from, from + move_by, now);
    }
}
