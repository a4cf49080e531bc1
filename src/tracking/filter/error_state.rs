//! An error-state Kalman filter on SE(3).
//!
//! State: position p (mm) and velocity v (mm/s) in beacon space, orientation q
//! (`beacon_from_sensor`), angular velocity w (rad/s, sensor axes), gyroscope bias b (rad/s). The
//! error state is their difference, 15 numbers, the turn by sensor axes: `q exp(d)`. Measurements
//! are independent numbers, so they are taken one after another, without a matrix inverse and
//! without allocation; the sum of their squared normalised innovations is that of the whole
//! measurement.

use nalgebra::{Matrix3, Matrix6, RowVector3, SMatrix, SVector, UnitQuaternion, Vector3};

use super::MotionDensity;
use crate::pose::{Pose, SensorPose, cross_matrix};
use crate::sensor::Pinhole;
use crate::solve::{Gravity, Sighting};

/// Length of the error state.
const N: usize = 15;
const POSITION: usize = 0;
const VELOCITY: usize = 3;
const TURN: usize = 6;
const RATE: usize = 9;
const BIAS: usize = 12;

type Covariance = SMatrix<f64, N, N>;
type Row = SVector<f64, N>;

/// The prior of components that a single view does not determine.
const FIRST_SPEED_MM_S: f64 = 500.0;
const FIRST_RATE: f64 = 2.0;
const FIRST_BIAS: f64 = 0.02;
/// How a gyroscope's bias wanders, rad²/s³.
const BIAS_WALK: f64 = 1e-8;

/// The estimated state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// Position and orientation of the sensor in the beacon's frame.
    pub pose: SensorPose,
    /// mm/s, beacon axes.
    pub velocity: Vector3<f64>,
    /// rad/s, sensor axes.
    pub rate: Vector3<f64>,
    /// rad/s, sensor axes.
    pub bias: Vector3<f64>,
}

/// The innovation of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// It was taken.
    Accepted,
    /// It is too unlikely, or an LED would be behind the camera; the state is as before.
    Rejected,
}

/// A measurement's verdict, its squared normalised innovation, and its number of components.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Update {
    /// Whether it was taken.
    pub verdict: Verdict,
    /// Sum of squared innovations over their variances; infinite when it cannot be computed.
    pub nis: f64,
    /// The number of measured values.
    pub count: usize,
}

/// The filter. It has no clock: its caller passes the elapsed time.
#[derive(Clone, Debug)]
pub struct ErrorStateFilter {
    state: State,
    covariance: Covariance,
    motion: MotionDensity,
}

/// Gates by the number of components of a measurement: a right one is beyond in 1 of 100,000 cases.
fn gate(count: usize) -> f64 {
    const GATES: [f64; 9] = [0.0, 19.5, 23.0, 25.9, 28.5, 30.9, 33.1, 35.3, 37.3];
    GATES[count.min(GATES.len() - 1)]
}

/// Measurements taken one by one, all linear about the same state.
struct Correction {
    error: Row,
    covariance: Covariance,
    nis: f64,
    count: usize,
}

impl Correction {
    /// One number: its innovation, derivative by the error state, and variance.
    fn take(&mut self, innovation: f64, row: &Row, variance: f64) {
        let by_error = self.covariance * row;
        let total = row.dot(&by_error) + variance;
        let left = innovation - row.dot(&self.error);
        self.error += by_error * (left / total);
        self.covariance.ger(-1.0 / total, &by_error, &by_error, 1.0);
        self.nis += left * left / total;
        self.count += 1;
    }
}

impl ErrorStateFilter {
    /// Begins at a solved pose and the covariance of its position (mm) and turn (radians, beacon
    /// axes).
    #[must_use]
    pub fn new(pose: &Pose, covariance: &Matrix6<f64>, motion: MotionDensity) -> Self {
        let mut full = Covariance::zeros();
        let to_sensor = pose.rotation.into_inner();
        let block = |row: usize, column: usize| covariance.fixed_view::<3, 3>(row, column).into_owned();
        full.fixed_view_mut::<3, 3>(POSITION, POSITION).copy_from(&block(0, 0));
        let cross = block(0, 3) * to_sensor.transpose();
        full.fixed_view_mut::<3, 3>(POSITION, TURN).copy_from(&cross);
        full.fixed_view_mut::<3, 3>(TURN, POSITION).copy_from(&cross.transpose());
        let turn = to_sensor * block(3, 3) * to_sensor.transpose();
        full.fixed_view_mut::<3, 3>(TURN, TURN).copy_from(&turn);
        for (at, sigma) in [(VELOCITY, FIRST_SPEED_MM_S), (RATE, FIRST_RATE), (BIAS, FIRST_BIAS)] {
            full.fixed_view_mut::<3, 3>(at, at).fill_diagonal(sigma * sigma);
        }
        let zero = Vector3::zeros();
        let state = State { pose: pose.inverse(), velocity: zero, rate: zero, bias: zero };
        Self { state, covariance: full, motion }
    }

    /// The estimate.
    #[must_use]
    pub fn state(&self) -> &State {
        &self.state
    }

    /// The same uncertainty about another pose: for bounds, which are linear about the truth.
    pub fn relinearise(&mut self, pose: &SensorPose) {
        self.state.pose = *pose;
        // Rate and velocity only move the pose, and the next call sets it.
        (self.state.velocity, self.state.rate) = (Vector3::zeros(), Vector3::zeros());
    }

    /// `sensor_from_beacon`.
    #[must_use]
    pub fn pose(&self) -> Pose {
        self.state.pose.inverse()
    }

    /// Covariance of position (mm) and turn (radians, beacon axes).
    #[must_use]
    pub fn covariance(&self) -> Matrix6<f64> {
        let turn = self.state.pose.orientation.to_rotation_matrix().into_inner();
        let block = |row, column| self.covariance.fixed_view::<3, 3>(row, column).into_owned();
        let mut covariance = Matrix6::zeros();
        covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&block(POSITION, POSITION));
        let cross = block(POSITION, TURN) * turn.transpose();
        covariance.fixed_view_mut::<3, 3>(0, 3).copy_from(&cross);
        covariance.fixed_view_mut::<3, 3>(3, 0).copy_from(&cross.transpose());
        covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&(turn * block(TURN, TURN) * turn.transpose()));
        covariance
    }

    /// Moves on by `seconds` (not negative).
    pub fn predict(&mut self, seconds: f64) {
        let dt = seconds.max(0.0);
        let step = UnitQuaternion::from_scaled_axis(self.state.rate * dt);
        self.state.pose.position += self.state.velocity * dt;
        self.state.pose.orientation *= step;
        let mut transition = Covariance::identity();
        transition.fixed_view_mut::<3, 3>(POSITION, VELOCITY).fill_diagonal(dt);
        transition.fixed_view_mut::<3, 3>(TURN, RATE).fill_diagonal(dt);
        let back = step.inverse().to_rotation_matrix().into_inner();
        transition.fixed_view_mut::<3, 3>(TURN, TURN).copy_from(&back);
        self.covariance = transition * self.covariance * transition.transpose();
        let densities =
            [(POSITION, VELOCITY, self.motion.acceleration), (TURN, RATE, self.motion.angular_acceleration)];
        for (place, speed, density) in densities {
            for axis in 0..3 {
                let (i, j) = (place + axis, speed + axis);
                self.covariance[(i, i)] += density * dt.powi(3) / 3.0;
                self.covariance[(i, j)] += density * dt.powi(2) / 2.0;
                self.covariance[(j, i)] += density * dt.powi(2) / 2.0;
                self.covariance[(j, j)] += density * dt;
                let bias = BIAS + axis;
                // Each axis has one bias; it is added once, with the turn.
                self.covariance[(bias, bias)] += if place == TURN { BIAS_WALK * dt } else { 0.0 };
            }
        }
    }

    /// The pose `seconds` from now, at most 0.05 of them; the filter
    /// stays.
    #[must_use]
    pub fn predicted(&self, seconds: f64) -> Self {
        let mut ahead = self.clone();
        ahead.predict(seconds.min(MAX_PREDICTION_S));
        ahead
    }

    /// How unlikely these sightings are, without taking them; `None` when an LED would be behind
    /// the camera.
    #[must_use]
    pub fn nis(&self, camera: &Pinhole, sightings: &[Sighting], noise_px: f64) -> Option<f64> {
        self.corrected(camera, sightings, noise_px).map(|correction| correction.nis)
    }

    /// Takes the pixels of known LEDs.
    pub fn update_pixels(&mut self, camera: &Pinhole, sightings: &[Sighting], noise_px: f64) -> Update {
        let correction = self.corrected(camera, sightings, noise_px);
        self.judge(correction)
    }

    /// Takes the direction of gravity.
    pub fn update_gravity(&mut self, gravity: &Gravity) -> Update {
        let mut correction = self.correction();
        let to_sensor = self.state.pose.orientation.inverse();
        let predicted = to_sensor * gravity.up_in_beacon.into_inner();
        let innovation = gravity.up_in_sensor.into_inner() - predicted;
        let by_turn = cross_matrix(&predicted);
        for axis in 0..3 {
            let mut row = Row::zeros();
            row.fixed_rows_mut::<3>(TURN).copy_from(&by_turn.row(axis).transpose());
            correction.take(innovation[axis], &row, gravity.sigma * gravity.sigma);
        }
        self.judge(Some(correction))
    }

    /// Takes the rates of a gyroscope (rad/s, sensor axes) with this standard deviation.
    pub fn update_rates(&mut self, rates: &Vector3<f64>, sigma: f64) -> Update {
        let mut correction = self.correction();
        for axis in 0..3 {
            let mut row = Row::zeros();
            row[RATE + axis] = 1.0;
            row[BIAS + axis] = 1.0;
            let innovation = rates[axis] - self.state.rate[axis] - self.state.bias[axis];
            correction.take(innovation, &row, sigma * sigma);
        }
        self.judge(Some(correction))
    }

    fn correction(&self) -> Correction {
        Correction { error: Row::zeros(), covariance: self.covariance, nis: 0.0, count: 0 }
    }

    fn corrected(&self, camera: &Pinhole, sightings: &[Sighting], noise_px: f64) -> Option<Correction> {
        let mut correction = self.correction();
        let pose = self.pose();
        let to_sensor: Matrix3<f64> = pose.rotation.into_inner();
        for sighting in sightings {
            let point = pose.place(&sighting.led);
            let (pixel, by_point) = camera.project_with_jacobian(&point)?;
            let (by_position, by_turn) = (by_point * -to_sensor, by_point * cross_matrix(&point));
            for axis in 0..2 {
                let mut row = Row::zeros();
                let part = |of: RowVector3<f64>| of.transpose();
                row.fixed_rows_mut::<3>(POSITION).copy_from(&part(by_position.row(axis).into_owned()));
                row.fixed_rows_mut::<3>(TURN).copy_from(&part(by_turn.row(axis).into_owned()));
                correction.take(sighting.pixel[axis] - pixel[axis], &row, noise_px * noise_px);
            }
        }
        Some(correction)
    }

    /// Takes a correction if it is likely enough.
    fn judge(&mut self, correction: Option<Correction>) -> Update {
        let Some(correction) = correction else {
            return Update { verdict: Verdict::Rejected, nis: f64::INFINITY, count: 0 };
        };
        let Correction { error, covariance, nis, count } = correction;
        if !nis.is_finite() || nis > gate(count) {
            return Update { verdict: Verdict::Rejected, nis, count };
        }
        let part = |at: usize| error.fixed_rows::<3>(at).into_owned();
        self.state.pose.position += part(POSITION);
        self.state.velocity += part(VELOCITY);
        self.state.pose.orientation *= UnitQuaternion::from_scaled_axis(part(TURN));
        self.state.rate += part(RATE);
        self.state.bias += part(BIAS);
        self.covariance = (covariance + covariance.transpose()) * 0.5;
        Update { verdict: Verdict::Accepted, nis, count }
    }
}

/// The time for which a pose is predicted without seeing an LED, seconds.
pub(crate) const MAX_PREDICTION_S: f64 = 0.05;
