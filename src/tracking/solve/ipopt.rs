//! The way of the 2009 paper with its own solver, IPOPT: for builds with the cargo feature `ipopt`.
//!
//! The same energy, equality and inequalities as in [`paper`](super::paper), passed to the library
//! unchanged: seven numbers, the quaternion (w, x, y, z) and t in beacon radii, with exact first
//! and second derivatives. It is neither faster nor better than [`paper`](super::paper); it exists
//! for comparison. It allocates.

use ipopt::{BasicProblem, ConstrainedProblem, Index, Ipopt, SolveStatus};
use nalgebra::{Vector3, Vector4};
use parking_lot::Mutex;

use super::PoseView;
use super::paper::{Energy, PaperSolution, Point, QuadraticForm};
use crate::pose::Pose;

/// Numbers of a pose.
const NUMBERS: usize = 7;
/// Entries of the lower triangle of a matrix of that size.
const TRIANGLE: usize = NUMBERS * (NUMBERS + 1) / 2;

/// MUMPS, the linear solver in IPOPT, keeps state of its own: one problem at a time.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

struct Problem {
    energy: Energy,
    start: Point,
    /// The factor of the energy.
    weight: f64,
}

fn numbers(at: &Point) -> [f64; NUMBERS] {
    [at.q[0], at.q[1], at.q[2], at.q[3], at.t.x, at.t.y, at.t.z]
}

fn point(x: &[f64]) -> Point {
    Point { q: Vector4::from_fn(|i, _| x[i]), t: Vector3::from_fn(|i, _| x[4 + i]) }
}

/// The slope of a form by all seven numbers.
fn slope(form: &QuadraticForm, at: &Point) -> [f64; NUMBERS] {
    numbers(&Point { q: form.a * at.q * 2.0, t: form.b })
}

/// Adds `weight` times the second derivative of a form: it is quadratic in the quaternion, linear
/// in t.
fn add_curvature(form: &QuadraticForm, weight: f64, sum: &mut [f64]) {
    for (sum, (row, column)) in sum.iter_mut().zip(triangle()) {
        if row < 4 && column < 4 {
            *sum += weight * 2.0 * form.a[(row, column)];
        }
    }
}

fn triangle() -> impl Iterator<Item = (usize, usize)> {
    (0..NUMBERS).flat_map(|row| (0..=row).map(move |column| (row, column)))
}

impl BasicProblem for Problem {
    fn num_variables(&self) -> usize {
        NUMBERS
    }

    fn bounds(&self, low: &mut [f64], high: &mut [f64]) -> bool {
        low.fill(-1e20); // what IPOPT takes for none
        high.fill(1e20);
        true
    }

    fn initial_point(&self, x: &mut [f64]) -> bool {
        x.copy_from_slice(&numbers(&self.start));
        true
    }

    fn objective(&self, x: &[f64], value: &mut f64) -> bool {
        *value = self.weight * self.energy.energy(&point(x));
        true
    }

    fn objective_grad(&self, x: &[f64], gradient: &mut [f64]) -> bool {
        let at = point(x);
        gradient.fill(0.0);
        for error in self.energy.errors() {
            let factor = 2.0 * self.weight * error.value(&at);
            gradient.iter_mut().zip(slope(error, &at)).for_each(|(sum, part)| *sum += factor * part);
        }
        true
    }
}

/// The first constraint is the length of the quaternion, squared; the others are depths.
impl ConstrainedProblem for Problem {
    fn num_constraints(&self) -> usize {
        1 + self.energy.depths().len()
    }

    fn num_constraint_jacobian_non_zeros(&self) -> usize {
        self.num_constraints() * NUMBERS
    }

    fn constraint(&self, x: &[f64], values: &mut [f64]) -> bool {
        let at = point(x);
        values[0] = at.q.norm_squared();
        values[1..].iter_mut().zip(self.energy.depths()).for_each(|(value, depth)| *value = depth.value(&at));
        true
    }

    fn constraint_bounds(&self, low: &mut [f64], high: &mut [f64]) -> bool {
        low.fill(0.0);
        high.fill(1e20);
        (low[0], high[0]) = (1.0, 1.0);
        true
    }

    fn constraint_jacobian_indices(&self, rows: &mut [Index], columns: &mut [Index]) -> bool {
        for (at, (row, column)) in rows.iter_mut().zip(columns).enumerate() {
            (*row, *column) = ((at / NUMBERS) as Index, (at % NUMBERS) as Index);
        }
        true
    }

    fn constraint_jacobian_values(&self, x: &[f64], values: &mut [f64]) -> bool {
        let at = point(x);
        let length = numbers(&Point { q: at.q * 2.0, t: Vector3::zeros() });
        let depths = self.energy.depths().iter().map(|depth| slope(depth, &at));
        let rows = std::iter::once(length).chain(depths).flatten();
        values.iter_mut().zip(rows).for_each(|(value, slope)| *value = slope);
        true
    }

    fn num_hessian_non_zeros(&self) -> usize {
        TRIANGLE
    }

    fn hessian_indices(&self, rows: &mut [Index], columns: &mut [Index]) -> bool {
        for ((row, column), at) in rows.iter_mut().zip(columns).zip(triangle()) {
            (*row, *column) = (at.0 as Index, at.1 as Index);
        }
        true
    }

    fn hessian_values(&self, x: &[f64], factor: f64, multipliers: &[f64], values: &mut [f64]) -> bool {
        let at = point(x);
        values.fill(0.0);
        for error in self.energy.errors() {
            let (value, slope) = (error.value(&at), slope(error, &at));
            let weight = 2.0 * factor * self.weight;
            for (sum, (row, column)) in values.iter_mut().zip(triangle()) {
                *sum += weight * slope[row] * slope[column];
            }
            add_curvature(error, weight * value, values);
        }
        for (depth, multiplier) in self.energy.depths().iter().zip(&multipliers[1..]) {
            add_curvature(depth, *multiplier, values);
        }
        for (sum, (row, column)) in values.iter_mut().zip(triangle()) {
            if row == column && row < 4 {
                *sum += 2.0 * multipliers[0];
            }
        }
        true
    }
}

/// Minimises the energy from `start`; `None` when there are fewer than three LEDs, or IPOPT ends
/// without a minimum. Steps are not counted.
#[must_use]
pub fn solve_with_ipopt(view: &PoseView<'_>, start: &Pose) -> Option<PaperSolution> {
    let energy = Energy::new(view)?;
    let scale = energy.scale;
    let start = Point::of_pose(start, scale);
    // About px², as the depths of LEDs are: IPOPT's tolerances are absolute.
    let weight = (view.camera.fx / start.t.z.max(1.0)).powi(2);
    let problem = Problem { energy, start, weight };
    let _alone = ONE_AT_A_TIME.lock();
    let mut ipopt = Ipopt::new(problem).ok()?;
    ipopt.set_option("print_level", 0)?;
    ipopt.set_option("sb", "yes")?; // no banner
    ipopt.set_option("tol", 1e-10)?;
    let found = ipopt.solve();
    let energy = found.objective_value / weight * view.camera.fx.powi(2);
    let converged = match found.status {
        SolveStatus::SolveSucceeded => true,
        // As near as rounding allows, where that is farther than the tolerance.
        SolveStatus::SolvedToAcceptableLevel | SolveStatus::SearchDirectionBecomesTooSmall => false,
        _ => return None,
    };
    let at = point(found.solver_data.solution.primal_variables);
    let pose = at.pose(scale);
    Some(PaperSolution { pose, energy, iterations: 0, converged })
}
