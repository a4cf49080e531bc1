//! Global starts for a view: poses from which a local method finds every minimum that matters.
//!
//! For a given rotation the best translation is linear in it, so that the object-space cost is `r'
//! Omega r` with r the nine numbers of the rotation (Terzakis and Lourakis, "A consistently fast
//! and globally optimal solution to the perspective-n-point problem", ECCV 2020). [`global`] starts
//! at the rotations nearest to the eigenvectors of the smallest eigenvalues, as they do, and goes
//! down by Newton's method on SO(3) in place of their quadratic programmes. [`upright`] needs but
//! two LEDs: with up known, one angle is left, of which the cost is a trigonometric polynomial of
//! degree two.

use nalgebra::{Matrix3, Matrix3x1, Rotation3, SMatrix, SVector, Unit, Vector3};

use super::{MAX_SEEN, PoseView};
use crate::pose::{Pose, cross_matrix};

type Matrix9 = SMatrix<f64, 9, 9>;
type Matrix3x9 = SMatrix<f64, 3, 9>;
type Vector9 = SVector<f64, 9>;

/// Poses to begin at.
#[derive(Clone, Debug, Default)]
pub(crate) struct Starts {
    poses: [Option<Pose>; CAPACITY],
    count: usize,
}

/// Eigenvectors that are tried, each with both signs.
const EIGENVECTORS: usize = 6;
const CAPACITY: usize = 2 * EIGENVECTORS + 4;

impl Starts {
    /// The poses found.
    pub(crate) fn poses(&self) -> impl Iterator<Item = &Pose> {
        self.poses[..self.count].iter().flatten()
    }

    fn push(&mut self, pose: Pose) {
        let is_known = self.poses().any(|known| {
            let (angle, distance) = known.distance(&pose);
            angle < 1e-3 && distance < 1e-3 * pose.translation.norm()
        });
        if !is_known && self.count < CAPACITY {
            self.poses[self.count] = Some(pose);
            self.count += 1;
        }
    }
}

/// The object-space cost of a view.
struct ObjectSpace {
    omega: Matrix9,
    /// Translation (in units of `scale`, for centred LEDs) from the rotation's nine numbers.
    translation: Matrix3x9,
    centre: Vector3<f64>,
    scale: f64,
}

impl ObjectSpace {
    /// `None` when a pixel has no ray, or all rays are one.
    fn new(view: &PoseView<'_>) -> Option<Self> {
        let count = view.sightings.len().min(MAX_SEEN);
        let centre = view.sightings.iter().map(|s| s.led).sum::<Vector3<f64>>() / count as f64;
        let scale = view.sightings.iter().map(|s| (s.led - centre).norm()).fold(0.0, f64::max);
        if count == 0 || scale <= 0.0 {
            return None;
        }
        let mut sum = Matrix3::zeros();
        let mut by_rotation = Matrix3x9::zeros();
        let mut omega = Matrix9::zeros();
        for sighting in view.sightings.iter().take(MAX_SEEN) {
            let [x, y] = view.camera.ray_of_pixel(&sighting.pixel)?;
            let led = (sighting.led - centre) / scale;
            let q = Matrix3::new(1.0, 0.0, -x, 0.0, 1.0, -y, -x, -y, x * x + y * y);
            sum += q;
            let outer = led * led.transpose();
            for row in 0..3 {
                for column in 0..3 {
                    let mut part = by_rotation.fixed_view_mut::<1, 3>(row, 3 * column);
                    part += led.transpose() * q[(row, column)];
                    let mut block = omega.fixed_view_mut::<3, 3>(3 * row, 3 * column);
                    block += outer * q[(row, column)];
                }
            }
        }
        let translation = -(sum.try_inverse()? * by_rotation);
        omega += by_rotation.tr_mul(&translation);
        let omega = (omega + omega.transpose()) * 0.5;
        omega.iter().all(|entry| entry.is_finite()).then_some(Self { omega, translation, centre, scale })
    }

    fn pose(&self, rotation: Rotation3<f64>) -> Pose {
        let moved = self.translation * numbers(&rotation) * self.scale;
        Pose { rotation, translation: moved - rotation * self.centre }
    }

    /// Newton's method on SO(3), damped where the cost is not convex.
    fn descend(&self, mut rotation: Rotation3<f64>) -> Rotation3<f64> {
        let mut damping = 1e-3;
        let mut cost = self.cost(&numbers(&rotation));
        for _ in 0..25 {
            let (gradient, hessian) = self.derivatives(&rotation);
            let damped = hessian + Matrix3::identity() * damping;
            let Some(step) = damped.cholesky().map(|factor| factor.solve(&-gradient)) else {
                damping = (damping * 8.0).max(1e-3);
                continue;
            };
            let next = Rotation3::from_scaled_axis(step) * rotation;
            let next_cost = self.cost(&numbers(&next));
            if next_cost <= cost {
                (rotation, cost) = (next, next_cost);
                damping *= 0.1;
            } else {
                damping = (damping * 8.0).max(1e-6);
            }
            if step.norm_squared() < 1e-14 {
                break;
            }
        }
        rotation.renormalize();
        rotation
    }

    fn cost(&self, r: &Vector9) -> f64 {
        r.dot(&(self.omega * r))
    }

    /// Gradient and second derivative of half the cost by a small turn to the left.
    fn derivatives(&self, rotation: &Rotation3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| cross_matrix(&axis));
        let by_r = self.omega * numbers(rotation);
        let turns = axes.map(|axis| row_major(&(axis * rotation.matrix())));
        let gradient = Vector3::from(turns.map(|turn| turn.dot(&by_r)));
        let hessian = Matrix3::from_fn(|i, j| {
            let bend = (axes[i] * axes[j] + axes[j] * axes[i]) * rotation.matrix() * 0.5;
            turns[i].dot(&(self.omega * turns[j])) + row_major(&bend).dot(&by_r)
        });
        (gradient, hessian)
    }
}

fn row_major(matrix: &Matrix3<f64>) -> Vector9 {
    Vector9::from_fn(|i, _| matrix[(i / 3, i % 3)])
}

fn numbers(rotation: &Rotation3<f64>) -> Vector9 {
    row_major(rotation.matrix())
}

/// The rotation nearest to the matrix of these nine numbers.
fn nearest_rotation(numbers: &Vector9) -> Option<Rotation3<f64>> {
    let matrix = Matrix3::from_fn(|row, column| numbers[3 * row + column]);
    let svd = matrix.try_svd(true, true, f64::EPSILON * 4.0, 100)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let mut signs = Matrix3::identity();
    // Singular values come in descending order: the least certain axis is turned round.
    signs[(2, 2)] = (u * v_t).determinant().signum();
    Some(Rotation3::from_matrix_unchecked(u * signs * v_t))
}

/// Starts for three or four LEDs.
pub(crate) fn global(view: &PoseView<'_>, starts: &mut Starts) {
    let Some(object) = ObjectSpace::new(view) else { return };
    let Some(eigen) = object.omega.try_symmetric_eigen(f64::EPSILON, 200) else { return };
    let mut order: [usize; 9] = std::array::from_fn(|i| i);
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    for &at in &order[..EIGENVECTORS] {
        let vector = eigen.eigenvectors.column(at).into_owned();
        for signed in [vector, -vector] {
            let Some(rotation) = nearest_rotation(&signed) else { continue };
            let pose = object.pose(object.descend(rotation));
            if is_before_camera(view, &pose) {
                starts.push(pose);
            }
        }
    }
}

fn is_before_camera(view: &PoseView<'_>, pose: &Pose) -> bool {
    view.sightings.iter().all(|sighting| pose.place(&sighting.led).z > 1.0)
}

/// Starts for two to four LEDs and a known up.
pub(crate) fn upright(view: &PoseView<'_>, starts: &mut Starts) {
    let (Some(gravity), Some(object)) = (view.gravity, ObjectSpace::new(view)) else { return };
    let Some(level) = turn_between(&gravity.up_in_beacon, &gravity.up_in_sensor) else { return };
    let axis = gravity.up_in_sensor;
    // r = base + cosine * cos + sine * sin over the angle about up (Rodrigues' formula).
    let along = axis.into_inner() * axis.transpose();
    let base = row_major(&(along * level.matrix()));
    let cosine = row_major(&((Matrix3::identity() - along) * level.matrix()));
    let sine = row_major(&(cross_matrix(&axis) * level.matrix()));
    let product = |a: &Vector9, b: &Vector9| a.dot(&(object.omega * b));
    let wave = Wave {
        cos: 2.0 * product(&base, &cosine),
        sin: 2.0 * product(&base, &sine),
        cos2: (product(&cosine, &cosine) - product(&sine, &sine)) / 2.0,
        sin2: product(&cosine, &sine),
    };
    let pose = |angle| object.pose(Rotation3::from_axis_angle(&axis, angle) * level);
    let mut minima =
        wave.minima().into_iter().flatten().map(pose).filter(|pose| is_before_camera(view, pose));
    if let Some(first) = minima.next() {
        starts.push(first);
        minima.for_each(|pose| starts.push(pose));
        return;
    }
    // Noise can push a minimum of the object's cost, which knows no before and behind, across the
    // camera.
    let before = pieces().map(|(angle, _)| (wave.value(angle), pose(angle)));
    let before = before.filter(|(_, pose)| is_before_camera(view, pose));
    if let Some((_, least)) = before.min_by(|(a, _), (b, _)| a.total_cmp(b)) {
        starts.push(least);
    }
}

/// A turn in pieces that are far shorter than half a wave: the first and the last angle of each.
fn pieces() -> impl Iterator<Item = (f64, f64)> {
    const PIECES: usize = 72;
    let at = |piece: usize| piece as f64 * std::f64::consts::TAU / PIECES as f64;
    (0..PIECES).map(move |piece| (at(piece), at(piece + 1)))
}

/// A rotation that takes one direction to another; any of them when they are opposite.
fn turn_between(from: &Unit<Vector3<f64>>, to: &Unit<Vector3<f64>>) -> Option<Rotation3<f64>> {
    Rotation3::rotation_between(from, to).or_else(|| {
        let across: Matrix3x1<f64> = from.cross(&Vector3::x());
        let across =
            Unit::try_new(across, 1e-3).or_else(|| Unit::try_new(from.cross(&Vector3::y()), 1e-3))?;
        Some(Rotation3::from_axis_angle(&across, std::f64::consts::PI))
    })
}

/// `cos * cos x + sin * sin x + cos2 * cos 2x + sin2 * sin 2x`, which has at most two minima.
struct Wave {
    cos: f64,
    sin: f64,
    cos2: f64,
    sin2: f64,
}

impl Wave {
    fn slope(&self, x: f64) -> f64 {
        self.sin * x.cos() - self.cos * x.sin()
            + 2.0 * (self.sin2 * (2.0 * x).cos() - self.cos2 * (2.0 * x).sin())
    }

    fn value(&self, x: f64) -> f64 {
        let (double_sin, double_cos) = (2.0 * x).sin_cos();
        self.cos * x.cos() + self.sin * x.sin() + self.cos2 * double_cos + self.sin2 * double_sin
    }

    /// The place at which the slope turns from falling to rising, by halving.
    fn minima(&self) -> [Option<f64>; 2] {
        let mut found = [None; 2];
        let mut count = 0;
        for (mut low, mut high) in pieces() {
            if !(self.slope(low) < 0.0 && self.slope(high) >= 0.0) || count == found.len() {
                continue;
            }
            for _ in 0..40 {
                let middle = (low + high) / 2.0;
                if self.slope(middle) < 0.0 { low = middle } else { high = middle }
            }
            found[count] = Some((low + high) / 2.0);
            count += 1;
        }
        found
    }
}
