//! The way of the 2009 paper: an algebraic energy, minimised by an interior-point method.
//!
//! With (X, Y, Z) = R P + t, each LED gives two equations that are linear in the camera's matrix,
//! `u Z = fx X + skew Y + cx Z` and `v Z = fy Y + cy Z`; the energy is the sum of their squared
//! errors. R is a quaternion of length 1 (an equality), and every LED lies before the camera
//! (inequalities, kept by a logarithmic barrier that fades). Errors weigh as the depth of their
//! LED, so this minimum is not that of the pixels' errors.
//!
//! Everything is of the form `q' A q + b t`, so derivatives are exact. Each step is Newton's in the
//! space tangent to the equality, after a step back onto it.

use nalgebra::{Matrix4, Matrix6, Quaternion, UnitQuaternion, Vector3, Vector4, Vector6};

use super::{MAX_SEEN, PoseView};
use crate::pose::Pose;

/// The last pose of the iteration.
#[derive(Clone, Copy, Debug)]
pub struct PaperSolution {
    /// `sensor_from_beacon`.
    pub pose: Pose,
    /// The energy there, px² of an LED at unit depth of one beacon radius.
    pub energy: f64,
    /// Newton steps taken.
    pub iterations: usize,
    /// Whether it converged.
    pub converged: bool,
}

/// `q' a q + b t`.
#[derive(Clone, Copy)]
pub(super) struct QuadraticForm {
    pub(super) a: Matrix4<f64>,
    pub(super) b: Vector3<f64>,
}

#[derive(Clone, Copy)]
pub(super) struct Point {
    pub(super) q: Vector4<f64>, // w, x, y, z
    pub(super) t: Vector3<f64>,
}

/// Value, slope and curvature in the tangent space: a small turn (as `q * (1, w / 2)`, beacon
/// axes), then t.
struct Tangent {
    value: f64,
    slope: Vector6<f64>,
    curvature: Matrix6<f64>,
}

const MAX_ITERATIONS: usize = 100;
const FIRST_BARRIER: f64 = 1e-2;
const LAST_BARRIER: f64 = 1e-14;

impl Point {
    /// Lengths are in units of `scale`.
    pub(super) fn of_pose(pose: &Pose, scale: f64) -> Self {
        let q = UnitQuaternion::from_rotation_matrix(&pose.rotation);
        Self { q: Vector4::new(q.w, q.i, q.j, q.k), t: pose.translation / scale }
    }

    pub(super) fn pose(&self, scale: f64) -> Pose {
        let turn =
            UnitQuaternion::from_quaternion(Quaternion::new(self.q[0], self.q[1], self.q[2], self.q[3]));
        Pose { rotation: turn.to_rotation_matrix(), translation: self.t * scale }
    }
}

impl QuadraticForm {
    pub(super) fn value(&self, at: &Point) -> f64 {
        at.q.dot(&(self.a * at.q)) + self.b.dot(&at.t)
    }

    fn slope(&self, at: &Point, tangent: &[Vector4<f64>; 3]) -> Vector6<f64> {
        let by_q = self.a * at.q * 2.0;
        let [x, y, z] = tangent.map(|direction| direction.dot(&by_q));
        Vector6::new(x, y, z, self.b.x, self.b.y, self.b.z)
    }

    /// The second derivative along the sphere: that of the form, and what following the sphere's
    /// bend adds.
    fn add_curvature(&self, at: &Point, tangent: &[Vector4<f64>; 3], weight: f64, sum: &mut Matrix6<f64>) {
        let bend = at.q.dot(&(self.a * at.q)) / 2.0;
        for i in 0..3 {
            for j in 0..3 {
                let own = 2.0 * tangent[i].dot(&(self.a * tangent[j]));
                sum[(i, j)] += weight * (own - if i == j { bend } else { 0.0 });
            }
        }
    }
}

/// The three directions along the sphere of unit quaternions: q times half of i, j, k.
fn tangent(q: &Vector4<f64>) -> [Vector4<f64>; 3] {
    let [w, x, y, z] = [q[0], q[1], q[2], q[3]];
    [Vector4::new(-x, w, z, -y), Vector4::new(-y, -z, w, x), Vector4::new(-z, y, -x, w)].map(|v| v * 0.5)
}

/// The row `weights` of R(q) P as a form: R is quadratic in q.
fn rotated(weights: &Vector3<f64>, p: &Vector3<f64>) -> Matrix4<f64> {
    let c = weights.cross(p);
    let dot = weights.dot(p);
    let outer = weights * p.transpose();
    let mut a = Matrix4::zeros();
    a[(0, 0)] = dot;
    for i in 0..3 {
        // w * 2 (v x p) . weights is -2 w v . c
        a[(0, i + 1)] = -c[i];
        a[(i + 1, 0)] = -c[i];
        for j in 0..3 {
            let diagonal = if i == j { dot } else { 0.0 };
            a[(i + 1, j + 1)] = outer[(i, j)] + outer[(j, i)] - diagonal;
        }
    }
    a
}

pub(super) struct Energy {
    errors: [QuadraticForm; 2 * MAX_SEEN],
    depths: [QuadraticForm; MAX_SEEN],
    count: usize,
    /// The beacon's radius, mm.
    pub(super) scale: f64,
}

impl Energy {
    /// Lengths in units of the beacon's radius, errors in units of the focal length.
    pub(super) fn new(view: &PoseView<'_>) -> Option<Self> {
        let camera = view.camera;
        let count = view.sightings.len().min(MAX_SEEN);
        let scale = view.sightings.iter().map(|s| s.led.norm()).fold(0.0, f64::max);
        if count < 3 || scale <= 0.0 {
            return None;
        }
        let empty = QuadraticForm { a: Matrix4::zeros(), b: Vector3::zeros() };
        let mut energy = Self { errors: [empty; 2 * MAX_SEEN], depths: [empty; MAX_SEEN], count, scale };
        for (at, sighting) in view.sightings.iter().take(MAX_SEEN).enumerate() {
            // The distortion is taken out first, as if the paper's camera had seen it.
            let ray = camera.ray_of_pixel(&sighting.pixel)?;
            let form = |weights: Vector3<f64>| QuadraticForm {
                a: rotated(&weights, &(sighting.led / scale)),
                b: weights,
            };
            let v_error = ray[1] * camera.fy;
            let u_error = ray[0] * camera.fx + camera.skew * ray[1];
            energy.errors[2 * at] = form(Vector3::new(-camera.fx, -camera.skew, u_error) / camera.fx);
            energy.errors[2 * at + 1] = form(Vector3::new(0.0, -camera.fy, v_error) / camera.fx);
            energy.depths[at] = form(Vector3::z());
        }
        Some(energy)
    }

    pub(super) fn errors(&self) -> &[QuadraticForm] {
        &self.errors[..2 * self.count]
    }

    pub(super) fn depths(&self) -> &[QuadraticForm] {
        &self.depths[..self.count]
    }

    pub(super) fn energy(&self, at: &Point) -> f64 {
        self.errors().iter().map(|error| error.value(at).powi(2)).sum()
    }

    /// Energy and barrier; infinite where an LED is not before the camera.
    fn value(&self, at: &Point, barrier: f64) -> f64 {
        let mut value = self.energy(at);
        for depth in self.depths() {
            let z = depth.value(at);
            value -= if z > 0.0 { barrier * z.ln() } else { f64::NEG_INFINITY };
        }
        value
    }

    fn tangent(&self, at: &Point, barrier: f64) -> Tangent {
        let directions = tangent(&at.q);
        let mut sum =
            Tangent { value: self.value(at, barrier), slope: Vector6::zeros(), curvature: Matrix6::zeros() };
        for error in self.errors() {
            let (value, slope) = (error.value(at), error.slope(at, &directions));
            sum.slope += slope * (2.0 * value);
            sum.curvature += slope * slope.transpose() * 2.0;
            error.add_curvature(at, &directions, 2.0 * value, &mut sum.curvature);
        }
        for depth in self.depths() {
            let (value, slope) = (depth.value(at), depth.slope(at, &directions));
            sum.slope -= slope * (barrier / value);
            sum.curvature += slope * slope.transpose() * (barrier / (value * value));
            depth.add_curvature(at, &directions, -barrier / value, &mut sum.curvature);
        }
        sum
    }
}

/// The start of the paper's iteration when nothing is known: level, before the beacon, looking
/// along its
/// -z axis.
#[must_use]
pub fn level_start(distance_mm: f64) -> Pose {
    let half_turn = UnitQuaternion::from_scaled_axis(Vector3::x() * std::f64::consts::PI);
    Pose { rotation: half_turn.to_rotation_matrix(), translation: Vector3::new(0.0, 0.0, distance_mm) }
}

/// Minimises the energy from `start`; `None` when there are fewer than three LEDs, or one is not
/// before the camera at the start.
#[must_use]
pub fn solve_as_published(view: &PoseView<'_>, start: &Pose) -> Option<PaperSolution> {
    let energy = Energy::new(view)?;
    let mut at = Point::of_pose(start, energy.scale);
    let mut barrier = FIRST_BARRIER;
    let mut iterations = 0;
    let mut converged = false;
    if !energy.value(&at, barrier).is_finite() {
        return None;
    }
    while iterations < MAX_ITERATIONS && !converged {
        iterations += 1;
        let (next, moved) = step(&energy, &at, barrier)?;
        at = next;
        converged = moved < 1e-12 && barrier <= LAST_BARRIER;
        if moved < barrier.sqrt().max(1e-9) {
            barrier = (barrier * 0.05).max(LAST_BARRIER);
        }
    }
    let pose = at.pose(energy.scale);
    Some(PaperSolution { pose, energy: energy.energy(&at) * view.camera.fx.powi(2), iterations, converged })
}

/// One damped Newton step, shortened until it goes down with every LED before the camera; and its
/// length.
fn step(energy: &Energy, at: &Point, barrier: f64) -> Option<(Point, f64)> {
    let here = energy.tangent(at, barrier);
    let largest = here.curvature.diagonal().amax().max(1e-12);
    let mut damping = 0.0;
    let direction = loop {
        let damped = here.curvature + Matrix6::identity() * damping;
        if let Some(factor) = damped.cholesky() {
            break factor.solve(&-here.slope);
        }
        damping = if damping == 0.0 { largest * 1e-6 } else { damping * 10.0 };
        if damping > largest * 1e6 {
            return None;
        }
    };
    let directions = tangent(&at.q);
    let mut length = 1.0;
    for _ in 0..40 {
        let turn = (0..3).fold(Vector4::zeros(), |sum, i| sum + directions[i] * (direction[i] * length));
        let q = (at.q + turn).normalize(); // back onto the equality
        let next = Point { q, t: at.t + direction.fixed_rows::<3>(3) * length };
        let descent = here.slope.dot(&direction) * length;
        let slack = 1e-13 * here.value.abs().max(1e-12); // rounding
        if energy.value(&next, barrier) <= here.value + 1e-4 * descent + slack {
            return Some((next, direction.norm() * length));
        }
        length *= 0.5;
    }
    Some((*at, 0.0))
}
