//! Recordings of a Wiimote that is not there: a path, a beacon, a camera, and everything that goes
//! wrong on the way.
//!
//! The camera sees LEDs with noise, rounds to whole units, reports four blobs at most, and sees two
//! LEDs that are close as one. A blob keeps its slot while it is seen. Reports come at about 98 Hz
//! with jitter; some are lost, doubled or swapped. Accelerometer and MotionPlus follow the path.
//! Equal settings make equal recordings.

use nalgebra::{UnitQuaternion, Vector2, Vector3};

use super::beacon::Beacon;
use super::pose::SensorPose;
use super::report::calibration::AccelerometerCalibration;
use super::report::motion_plus::GyroCalibration;
use super::report::{
    Blob, BlobExtent, Buttons, DataReport, Extension, Half, InputReport, InterleavedHalf, Layout,
    SENSOR_HEIGHT, SENSOR_WIDTH,
};
use super::sensor::{Pinhole, ThinLens};
use super::solve::random::Random;
use super::tracker::body_from_sensor;

/// The rate that was measured on a real remote, reports a second.
pub(crate) const REPORT_HZ: f64 = 98.27;
/// Standard gravity, mm/s².
const GRAVITY_MM_S2: f64 = 9806.65;

/// The sensor's pose at a time (seconds): `beacon_from_sensor`.
pub trait SensorPath {
    /// The pose at this time.
    fn at(&self, seconds: f64) -> SensorPose;
}

/// The camera's effects on a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorModel {
    /// Standard deviation of a blob's coordinates before rounding, px.
    pub noise_px: f64,
    /// Whether coordinates are rounded to whole units, as a Wiimote's are.
    pub whole_pixels: bool,
    /// LEDs whose pictures are nearer than this, or touch, are one blob, px.
    pub merge_px: f64,
    /// Diameter of the LEDs, mm, which makes the blobs' sizes.
    pub led_mm: f64,
    /// The lens, when it is not sharp at every distance: blobs out of focus are larger. Its pixels
    /// are the camera's.
    pub lens: Option<ThinLens>,
}

impl SensorModel {
    /// LEDs of 5 mm, always sharp, with half a pixel of noise and whole pixels; one blob when
    /// nearer than two pixels of the sensor.
    pub const TYPICAL: Self =
        Self { noise_px: 0.5, whole_pixels: true, merge_px: 16.0, led_mm: 5.0, lens: None };

    /// Diameter of an LED's picture at this depth, px.
    fn diameter_px(&self, camera: &Pinhole, depth_mm: f64) -> f64 {
        let sharp = camera.fx * self.led_mm / depth_mm;
        self.lens.map_or(sharp, |lens| lens.dot_px(self.led_mm, depth_mm))
    }
}

/// Faults of reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReportDelivery {
    /// Standard deviation of the time between reports, ms.
    pub jitter_ms: f64,
    /// Share of reports that are lost.
    pub lost: f64,
    /// Share of reports that come twice.
    pub doubled: f64,
    /// Share of reports that are overtaken by the next.
    pub swapped: f64,
}

impl ReportDelivery {
    /// All arrive, at even intervals.
    pub const PERFECT: Self = Self { jitter_ms: 0.0, lost: 0.0, doubled: 0.0, swapped: 0.0 };
    /// As over the air: the measured spread of 4 Hz is 0.4 ms, and 1 % of each mishap.
    pub const RADIO: Self = Self { jitter_ms: 0.4, lost: 0.01, doubled: 0.01, swapped: 0.01 };
}

/// An LED that is hidden for a while.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HiddenLed {
    /// The LED.
    pub led: usize,
    /// From when to when, seconds.
    pub seconds: [f64; 2],
}

/// A button that is held for a while.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PressedButton {
    /// The button, or several.
    pub buttons: Buttons,
    /// From when to when, seconds.
    pub seconds: [f64; 2],
}

/// A recording to be made.
#[derive(Clone, Debug)]
pub struct Simulation {
    /// The true camera.
    pub camera: Pinhole,
    /// The true beacon.
    pub beacon: Beacon,
    /// Noise.
    pub sensing: SensorModel,
    /// Mishaps.
    pub delivery: ReportDelivery,
    /// LEDs that are hidden at times.
    pub hidden: Vec<HiddenLed>,
    /// Buttons that are held at times.
    pub pressed: Vec<PressedButton>,
    /// Whether a MotionPlus is plugged in.
    pub gyroscope: bool,
    /// Whether blobs come in full, each picture in two reports; without a MotionPlus' rates then.
    pub full: bool,
    /// Seed of all that is random.
    pub seed: u64,
}

/// A report, when it arrives, and the truth when it was made.
#[derive(Clone, Debug)]
pub struct SimulatedReport {
    /// Time stamp, ns.
    pub t_ns: u64,
    /// The report.
    pub report: InputReport,
    /// The sensor's pose.
    pub truth: SensorPose,
}

impl Simulation {
    /// A typical camera that sees the beacon with half a pixel of noise.
    #[must_use]
    pub fn new(beacon: Beacon, seed: u64) -> Self {
        Self {
            camera: Pinhole::TYPICAL,
            beacon,
            sensing: SensorModel::TYPICAL,
            delivery: ReportDelivery::PERFECT,
            hidden: Vec::new(),
            pressed: Vec::new(),
            gyroscope: false,
            full: false,
            seed,
        }
    }

    /// The reports of `seconds` along a path, in the order in which they arrive.
    pub fn record(&self, path: &impl SensorPath, seconds: f64) -> Vec<SimulatedReport> {
        let mut random = Random::new(self.seed);
        let mut slots = Slots::default();
        let mut reports: Vec<SimulatedReport> = Vec::new();
        let mut at = 0.0;
        while at < seconds {
            let truth = path.at(at);
            let seen = self.see(&truth, at, &mut random);
            let report = self.report(path, at, slots.place(&seen), &mut random);
            for report in if self.full { halves(report) } else { vec![report] } {
                let t_ns = (at * 1e9) as u64 + 1_000_000_000;
                self.deliver(SimulatedReport { t_ns, report, truth }, &mut reports, &mut random);
                let period = 1.0 / REPORT_HZ + self.delivery.jitter_ms * 1e-3 * random.normal();
                at += period.max(1e-3);
            }
        }
        reports
    }

    /// Lets a report arrive, if it does.
    fn deliver(&self, made: SimulatedReport, reports: &mut Vec<SimulatedReport>, random: &mut Random) {
        let mishap = |share: f64, random: &mut Random| random.between(0.0, 1.0) < share;
        if mishap(self.delivery.lost, random) {
            return;
        }
        let again = mishap(self.delivery.doubled, random)
            .then(|| SimulatedReport { t_ns: made.t_ns + 300_000, ..made.clone() });
        reports.push(made);
        reports.extend(again);
        let last = reports.len() - 1;
        if last > 0 && mishap(self.delivery.swapped, random) {
            reports.swap(last - 1, last);
        }
    }

    /// The LEDs that are seen, as blobs: (LED, blob).
    fn see(&self, truth: &SensorPose, at: f64, random: &mut Random) -> Vec<(usize, Blob)> {
        let pose = truth.inverse();
        let mut seen: Vec<(usize, Vector2<f64>, f64)> = Vec::new();
        for (led, position) in self.beacon.leds().iter().enumerate() {
            let is_hidden = |h: &HiddenLed| h.led == led && (h.seconds[0]..h.seconds[1]).contains(&at);
            let point = pose.place(position);
            // Noise is drawn for every LED, so that hiding one leaves the others as they were.
            let noise = Vector2::new(random.normal(), random.normal()) * self.sensing.noise_px;
            let Some(pixel) = self.camera.project(&point) else { continue };
            if self.hidden.iter().any(is_hidden) {
                continue;
            }
            let pixel = pixel + noise;
            let diameter = self.sensing.diameter_px(&self.camera, point.z);
            let is_one = |other: &Vector2<f64>, others: f64| {
                (other - pixel).norm() < self.sensing.merge_px.max((others + diameter) / 2.0)
            };
            let near = seen.iter_mut().find(|(_, other, others)| is_one(other, *others));
            if let Some((_, other, _)) = near {
                *other = (*other + pixel) / 2.0;
            } else {
                seen.push((led, pixel, diameter));
            }
        }
        // Sizes are in pixels of the sensor, eight units wide.
        let blobs = seen.into_iter().filter_map(|(led, pixel, px)| Some((led, self.blob(pixel, px / 8.0)?)));
        blobs.take(4).collect()
    }

    fn buttons(&self, at: f64) -> Buttons {
        let held = self.pressed.iter().filter(|p| (p.seconds[0]..p.seconds[1]).contains(&at));
        held.fold(Buttons::default(), |all, pressed| all.with(pressed.buttons))
    }

    fn blob(&self, pixel: Vector2<f64>, size: f64) -> Option<Blob> {
        let (width, height) = (f64::from(SENSOR_WIDTH), f64::from(SENSOR_HEIGHT));
        let (x, y) = (pixel.x.round(), height - 1.0 - pixel.y.round());
        let inside = (0.0..width).contains(&x) && (0.0..height).contains(&y);
        let size = Some(size.round().clamp(0.0, 15.0) as u8);
        inside.then(|| Blob { size, ..Blob::at(x as u16, y as u16) })
    }

    fn report(
        &self,
        path: &impl SensorPath,
        at: f64,
        blobs: [Option<Blob>; 4],
        random: &mut Random,
    ) -> InputReport {
        let pose = path.at(at);
        let to_sensor = pose.orientation.inverse();
        const STEP: f64 = 2e-3;
        let [before, after] = [path.at(at - STEP), path.at(at + STEP)];
        let bend = after.position - pose.position * 2.0 + before.position;
        let felt = bend / (STEP * STEP * GRAVITY_MM_S2) + self.beacon.up().into_inner();
        let noise = random.normal3() * 0.01;
        let counts = AccelerometerCalibration::TYPICAL.counts(body_from_sensor(&(to_sensor * felt + noise)));
        let [x, y, z] = counts;
        let turn = (before.orientation.inverse() * after.orientation).scaled_axis() / (2.0 * STEP);
        let rates = turn + random.normal3() * 0.002;
        let reading = GyroCalibration::TYPICAL.reading(body_from_sensor(&rates)).encode();
        let layout = if self.gyroscope { Layout::AccelerationIrExtension6 } else { Layout::AccelerationIr };
        let plain = |blob: Blob| if self.gyroscope { Blob::at(blob.x, blob.y) } else { blob };
        InputReport::Data(DataReport {
            layout,
            buttons: Some(self.buttons(at)),
            acceleration: Some([x, y & !1, z & !1]),
            blobs: Some(blobs.map(|blob| blob.map(plain))),
            extension: self.gyroscope.then(|| Extension::new(&reading)),
        })
    }
}

/// The two reports that carry a picture's blobs in full, as a camera sees them: outlines as wide as
/// their size.
fn halves(report: InputReport) -> Vec<InputReport> {
    let InputReport::Data(DataReport { buttons, acceleration, blobs, .. }) = report else {
        return vec![report];
    };
    let [x, y, z] = acceleration.unwrap_or_default().map(|count| (count >> 2) as u8);
    let outlined = |blob: Blob| {
        let half = blob.size.unwrap_or(1) / 2;
        let [column, row] = [blob.x, blob.y].map(|at| (at / 8) as u8);
        let extent = BlobExtent {
            x_min: column.saturating_sub(half),
            y_min: row.saturating_sub(half),
            x_max: (column + half).min(127),
            y_max: (row + half).min(95),
            intensity: 200,
        };
        Blob { extent: Some(extent), ..blob }
    };
    let [a, b, c, d] = blobs.unwrap_or_default().map(|blob| blob.map(outlined));
    let half = |half, acceleration, z_bits, blobs| {
        let buttons = buttons.unwrap_or_default();
        InputReport::Interleaved(InterleavedHalf { half, buttons, acceleration, z_bits, blobs })
    };
    vec![half(Half::First, x, z >> 4, [a, b]), half(Half::Second, y, z & 0x0f, [c, d])]
}

/// The LEDs in the four slots of the camera.
#[derive(Default)]
struct Slots([Option<usize>; 4]);

impl Slots {
    fn place(&mut self, seen: &[(usize, Blob)]) -> [Option<Blob>; 4] {
        for slot in &mut self.0 {
            *slot = slot.filter(|led| seen.iter().any(|(other, _)| other == led));
        }
        let mut blobs = [None; 4];
        for (led, blob) in seen {
            let known = self.0.iter().position(|slot| *slot == Some(*led));
            let Some(at) = known.or_else(|| self.0.iter().position(Option::is_none)) else { continue };
            self.0[at] = Some(*led);
            blobs[at] = Some(*blob);
        }
        blobs
    }
}

/// A hand that points at the beacon: slow sways of position, aim and roll, none of which repeat
/// together.
#[derive(Clone, Debug)]
pub struct PointingHand {
    centre: Vector3<f64>,
    target: Vector3<f64>,
    phases: [f64; 9],
}

impl PointingHand {
    /// About `distance_mm` before the beacon.
    #[must_use]
    pub fn before(beacon: &Beacon, distance_mm: f64, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let phases = std::array::from_fn(|_| random.between(0.0, std::f64::consts::TAU));
        let target = beacon.centroid();
        Self { centre: target + Vector3::z() * distance_mm, target, phases }
    }
}

impl SensorPath for PointingHand {
    fn at(&self, seconds: f64) -> SensorPose {
        let wave = |at: usize, hertz: f64| (std::f64::consts::TAU * hertz * seconds + self.phases[at]).sin();
        let sway = Vector3::new(wave(0, 0.31) * 200.0, wave(1, 0.23) * 120.0, wave(2, 0.17) * 200.0)
            + Vector3::new(wave(3, 1.1) * 15.0, wave(4, 1.3) * 15.0, 0.0);
        let aim = Vector3::new(wave(5, 0.41) * 120.0, wave(6, 0.37) * 80.0, 0.0);
        let roll = wave(7, 0.29) * 0.3 + wave(8, 1.7) * 0.02;
        let level = SensorPose { position: self.centre + sway, orientation: UnitQuaternion::identity() };
        SensorPose::looking_at(level.position, self.target + aim, &Vector3::y(), roll).unwrap_or(level)
    }
}

/// A hand that surveys: around the beacon, near and far, so that it comes everywhere in the
/// picture. For calibrations.
#[derive(Clone, Debug)]
pub struct SurveyingHand {
    target: Vector3<f64>,
    phases: [f64; 6],
}

impl SurveyingHand {
    /// Around this beacon.
    #[must_use]
    pub fn around(beacon: &Beacon, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let phases = std::array::from_fn(|_| random.between(0.0, std::f64::consts::TAU));
        Self { target: beacon.centroid(), phases }
    }
}

impl SensorPath for SurveyingHand {
    fn at(&self, seconds: f64) -> SensorPose {
        let wave = |at: usize, hertz: f64| (std::f64::consts::TAU * hertz * seconds + self.phases[at]).sin();
        let (yaw, pitch) = (wave(0, 0.061) * 0.7, wave(1, 0.083) * 0.5);
        let distance = 650.0 + wave(2, 0.047) * 200.0;
        let from = Vector3::new(yaw.sin() * pitch.cos(), pitch.sin(), yaw.cos() * pitch.cos());
        let position = self.target + from * distance;
        let across = Vector3::y().cross(&from).normalize();
        let aside = across * (wave(3, 0.19) * 0.26) + from.cross(&across) * (wave(4, 0.23) * 0.16);
        let target = self.target + aside * distance;
        let level = SensorPose { position, orientation: UnitQuaternion::identity() };
        SensorPose::looking_at(position, target, &Vector3::y(), wave(5, 0.11) * 0.6).unwrap_or(level)
    }
}
