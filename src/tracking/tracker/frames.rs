//! Pictures of the camera from reports: blobs, up and rates at one time.

use nalgebra::{Unit, Vector2, Vector3};

use super::DroppedReports;
use crate::beacon::Beacon;
use crate::report::calibration::AccelerometerCalibration;
use crate::report::motion_plus::{GyroCalibration, MotionPlus};
use crate::report::{Acceleration, Blob, InputReport, Interleaver};
use crate::solve::{Gravity, MAX_SEEN};

/// Reports that are the same within this time are one report that came twice.
const REPEAT_NS: u64 = 2_000_000;
/// Time over which acceleration is averaged, seconds: it evens out the counts' rounding and a
/// hand's tremor.
const AVERAGE_S: f64 = 0.1;
/// Beyond this difference from one g the remote is being swung, and its acceleration says nothing
/// of up.
const MAX_OFF_G: f64 = 0.1;

/// A picture of the camera at one time, with the other data of that time.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// Time of the report, ns.
    pub t_ns: u64,
    pixels: [Vector2<f64>; MAX_SEEN],
    count: usize,
    /// Up in sensor space, if the remote is not being swung.
    pub up: Option<Unit<Vector3<f64>>>,
    /// Rates in sensor space, rad/s, of a MotionPlus.
    pub rates: Option<Vector3<f64>>,
}

impl Frame {
    /// A frame of these blobs (pixels, v down), of which the first four count.
    #[must_use]
    pub fn new(t_ns: u64, blobs: &[Vector2<f64>]) -> Self {
        let mut pixels = [Vector2::zeros(); MAX_SEEN];
        let count = blobs.len().min(MAX_SEEN);
        pixels[..count].copy_from_slice(&blobs[..count]);
        Self { t_ns, pixels, count, up: None, rates: None }
    }

    /// The blobs, pixels.
    #[must_use]
    pub fn blobs(&self) -> &[Vector2<f64>] {
        &self.pixels[..self.count]
    }

    /// Up as a measurement with this standard deviation, radians.
    #[must_use]
    pub fn gravity(&self, beacon: &Beacon, sigma: f64) -> Option<Gravity> {
        self.up.map(|up_in_sensor| Gravity { up_in_beacon: *beacon.up(), up_in_sensor, sigma })
    }
}

/// Accelerometer axes (x left, y to the plug, z up) in sensor axes (x right, y down, z forward).
#[must_use]
pub(crate) fn sensor_from_body([x, y, z]: [f64; 3]) -> Vector3<f64> {
    Vector3::new(-x, -z, -y)
}

/// The inverse of [`sensor_from_body`].
#[must_use]
pub(crate) fn body_from_sensor(v: &Vector3<f64>) -> [f64; 3] {
    [-v.x, -v.z, -v.y]
}

/// Makes frames of reports.
#[derive(Clone, Debug)]
pub struct Frames {
    accelerometer: AccelerometerCalibration,
    gyroscope: GyroCalibration,
    interleaver: Interleaver,
    last: Option<(u64, [Option<Blob>; 4])>,
    /// Mean acceleration in sensor axes, g, and its time.
    acceleration: Option<(u64, Vector3<f64>)>,
    rates: Option<Vector3<f64>>,
    dropped: DroppedReports,
}

impl Frames {
    /// With these calibrations.
    #[must_use]
    pub fn new(accelerometer: AccelerometerCalibration, gyroscope: GyroCalibration) -> Self {
        Self {
            accelerometer,
            gyroscope,
            interleaver: Interleaver::default(),
            last: None,
            acceleration: None,
            rates: None,
            dropped: DroppedReports::default(),
        }
    }

    /// Replaces the calibrations that are given.
    pub fn calibrate(
        &mut self,
        accelerometer: Option<AccelerometerCalibration>,
        gyroscope: Option<GyroCalibration>,
    ) {
        self.accelerometer = accelerometer.unwrap_or(self.accelerometer);
        self.gyroscope = gyroscope.unwrap_or(self.gyroscope);
    }

    /// Reports dropped so far.
    #[must_use]
    pub fn dropped(&self) -> DroppedReports {
        self.dropped
    }

    /// Takes a report; gives a frame when it has blobs, or completes a pair that has.
    pub fn push(&mut self, t_ns: u64, report: &InputReport) -> Option<Frame> {
        let (acceleration, blobs) = match report {
            InputReport::Data(data) => {
                let reading =
                    data.extension.as_ref().and_then(|extension| MotionPlus::decode(extension.bytes()));
                let rates = reading.map(|reading| sensor_from_body(self.gyroscope.rates(&reading)));
                self.rates = rates.or(self.rates);
                (data.acceleration, data.blobs)
            }
            InputReport::Interleaved(half) => {
                let (acceleration, blobs) = self.interleaver.push(*half)?;
                (Some(acceleration), Some(blobs))
            }
            _ => return None,
        };
        if !self.is_news(t_ns, blobs) {
            return None;
        }
        if let Some(counts) = acceleration {
            self.average(t_ns, counts);
        }
        let mut frame = Frame::new(t_ns, &[]);
        // A blob at the border is cut; some stacks mark an empty slot as a blob at the origin.
        for blob in blobs?.into_iter().flatten().filter(|blob| !blob.is_cut()) {
            frame.pixels[frame.count] = Vector2::from(blob.pixel());
            frame.count += 1;
        }
        frame.up = self.up();
        frame.rates = self.rates.take();
        Some(frame)
    }

    fn is_news(&mut self, t_ns: u64, blobs: Option<[Option<Blob>; 4]>) -> bool {
        let Some(blobs) = blobs else { return true };
        if let Some((last_ns, last)) = self.last {
            let late = t_ns <= last_ns;
            let repeated = !late && last == blobs && t_ns - last_ns < REPEAT_NS;
            self.dropped.late += u64::from(late);
            self.dropped.repeated += u64::from(repeated);
            if late || repeated {
                return false;
            }
        }
        self.last = Some((t_ns, blobs));
        true
    }

    fn average(&mut self, t_ns: u64, counts: Acceleration) {
        let now = sensor_from_body(self.accelerometer.acceleration_g(counts));
        let mean = match self.acceleration {
            Some((then, mean)) => {
                let seconds = super::seconds_between(then, t_ns);
                mean + (now - mean) * (1.0 - (-seconds / AVERAGE_S).exp())
            }
            None => now,
        };
        self.acceleration = Some((t_ns, mean));
    }

    fn up(&self) -> Option<Unit<Vector3<f64>>> {
        let (_, mean) = self.acceleration?;
        let steady = (mean.norm() - 1.0).abs() < MAX_OFF_G;
        Unit::try_new(mean, 1e-6).filter(|_| steady)
    }
}
