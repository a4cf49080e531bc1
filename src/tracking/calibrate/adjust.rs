//! The bundle adjustment itself.

use nalgebra::{Matrix2x3, Matrix2x6, Matrix6, SMatrix, SVector, Vector2, Vector3, Vector6};

use super::{CalibrationModel, CalibrationView};
use crate::pose::{Pose, cross_matrix};
use crate::sensor::Pinhole;

/// The camera's numbers, in the order of the covariance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// Focal length along u.
    Fx,
    /// Focal length along v.
    Fy,
    /// Skew.
    Skew,
    /// Principal point, u.
    Cx,
    /// Principal point, v.
    Cy,
    /// First radial term.
    K1,
    /// Second radial term.
    K2,
}

const COUNT: usize = 7;
type ParameterVector = SVector<f64, COUNT>;
/// Covariance of the seven numbers, and matrices of its shape.
pub type Square = SMatrix<f64, COUNT, COUNT>;
type ByNumbers = SMatrix<f64, 2, COUNT>;
type Mixed = SMatrix<f64, COUNT, 6>;

/// The result of an adjustment.
#[derive(Clone, Debug)]
pub(crate) struct Adjustment {
    /// The camera.
    pub camera: Pinhole,
    /// Covariance of the camera's numbers by the noise that is left over; 0 where they were not
    /// looked for.
    pub covariance: Square,
    /// See [`super::Calibration::focal_distance_correlation`].
    pub focal_distance_correlation: f64,
    /// All views, px.
    pub rms_px: f64,
    /// Each view, px.
    pub view_rms_px: Vec<f64>,
    /// Left over per degree of freedom, px.
    pub noise_px: f64,
}

/// How the camera follows from the numbers that are looked for.
struct FreeParameters {
    model: CalibrationModel,
}

impl FreeParameters {
    fn is_free(&self, at: usize) -> bool {
        match self.model {
            // With one focal length, fy follows fx.
            CalibrationModel::Square => matches!(at, 0 | 3 | 4),
            CalibrationModel::Pinhole => matches!(at, 0 | 1 | 3 | 4),
            CalibrationModel::Skew => at <= 4,
            CalibrationModel::Radial => matches!(at, 0 | 1 | 3 | 4 | 5),
        }
    }

    fn count(&self) -> usize {
        (0..COUNT).filter(|at| self.is_free(*at)).count()
    }

    /// The covariance of the free parameters, expanded to all seven: fy follows fx where there is
    /// one focal length.
    fn spread(&self, covariance: &Square) -> Square {
        let source = |at: usize| if self.model == CalibrationModel::Square && at == 1 { 0 } else { at };
        let is_known = |at: usize| self.is_free(source(at));
        Square::from_fn(|row, column| {
            let of = (source(row), source(column));
            if is_known(row) && is_known(column) { covariance[of] } else { 0.0 }
        })
    }

    fn moved(&self, camera: &Pinhole, step: &ParameterVector) -> Pinhole {
        let mut moved = *camera;
        moved.fx += step[0];
        moved.fy += if self.model == CalibrationModel::Square { step[0] } else { step[1] };
        moved.skew += step[2];
        moved.cx += step[3];
        moved.cy += step[4];
        moved.distortion[0] += step[5];
        moved.distortion[1] += step[6];
        moved
    }

    /// Derivative of a pixel by the camera's numbers, at a point before it.
    fn jacobian(&self, camera: &Pinhole, point: &Vector3<f64>) -> ByNumbers {
        let unit = Pinhole { fx: 1.0, fy: 1.0, skew: 0.0, cx: 0.0, cy: 0.0, ..*camera };
        let ray = [point.x / point.z, point.y / point.z];
        let bent = unit.pixel_of_ray(ray);
        let r2 = ray[0] * ray[0] + ray[1] * ray[1];
        let radial = |weight: f64| {
            let (x, y) = (ray[0] * weight, ray[1] * weight);
            Vector2::new(camera.fx * x + camera.skew * y, camera.fy * y)
        };
        let mut jacobian = ByNumbers::zeros();
        let square = self.model == CalibrationModel::Square;
        jacobian.set_column(0, &Vector2::new(bent.x, if square { bent.y } else { 0.0 }));
        jacobian.set_column(1, &Vector2::new(0.0, bent.y));
        jacobian.set_column(2, &Vector2::new(bent.y, 0.0));
        jacobian.set_column(3, &Vector2::x());
        jacobian.set_column(4, &Vector2::y());
        jacobian.set_column(5, &radial(r2));
        jacobian.set_column(6, &radial(r2 * r2));
        for at in (0..COUNT).filter(|at| !self.is_free(*at)) {
            jacobian.set_column(at, &Vector2::zeros());
        }
        jacobian
    }
}

/// Normal equations of one view.
struct Block {
    numbers: Square,
    mixed: Mixed,
    pose: Matrix6<f64>,
    by_numbers: ParameterVector,
    by_pose: Vector6<f64>,
    cost: f64,
}

fn block(free: &FreeParameters, camera: &Pinhole, view: &CalibrationView, pose: &Pose) -> Option<Block> {
    let mut block = Block {
        numbers: Square::zeros(),
        mixed: Mixed::zeros(),
        pose: Matrix6::zeros(),
        by_numbers: ParameterVector::zeros(),
        by_pose: Vector6::zeros(),
        cost: 0.0,
    };
    for sighting in &view.sightings {
        let turned = pose.rotation * sighting.led;
        let point = turned + pose.translation;
        let (pixel, by_point): (Vector2<f64>, Matrix2x3<f64>) = camera.project_with_jacobian(&point)?;
        let error = pixel - sighting.pixel;
        let mut by_pose = Matrix2x6::zeros();
        by_pose.fixed_view_mut::<2, 3>(0, 0).copy_from(&(by_point * -cross_matrix(&turned)));
        by_pose.fixed_view_mut::<2, 3>(0, 3).copy_from(&by_point);
        let by_numbers = free.jacobian(camera, &point);
        block.numbers += by_numbers.tr_mul(&by_numbers);
        block.mixed += by_numbers.tr_mul(&by_pose);
        block.pose += by_pose.tr_mul(&by_pose);
        block.by_numbers += by_numbers.tr_mul(&error);
        block.by_pose += by_pose.tr_mul(&error);
        block.cost += error.norm_squared();
    }
    Some(block)
}

/// The camera's part after the poses are eliminated, with this damping; `None` when a pose is not
/// determined.
fn reduced(
    free: &FreeParameters,
    blocks: &[Block],
    damping: f64,
) -> Option<(Square, ParameterVector, Vec<Matrix6<f64>>)> {
    let (mut matrix, mut slope) = (Square::zeros(), ParameterVector::zeros());
    let mut inverses = Vec::with_capacity(blocks.len());
    for block in blocks {
        let mut pose = block.pose;
        for i in 0..6 {
            pose[(i, i)] *= 1.0 + damping;
        }
        let inverse = pose.cholesky()?.inverse();
        matrix += block.numbers - block.mixed * inverse * block.mixed.transpose();
        slope += block.by_numbers - block.mixed * inverse * block.by_pose;
        inverses.push(inverse);
    }
    for at in 0..COUNT {
        if free.is_free(at) {
            let own: f64 = blocks.iter().map(|block| block.numbers[(at, at)]).sum();
            matrix[(at, at)] += damping * own;
        } else {
            matrix[(at, at)] = 1.0; // stays where it is
        }
    }
    Some((matrix, slope, inverses))
}

/// Adjusts camera and poses from `start`; `None` when it breaks down.
#[must_use]
pub(crate) fn adjust(
    views: &[CalibrationView],
    start: &Pinhole,
    model: CalibrationModel,
) -> Option<Adjustment> {
    let free = FreeParameters { model };
    let mut camera = *start;
    let mut poses: Vec<Pose> = views.iter().map(|view| view.pose).collect();
    let blocks_at = |camera: &Pinhole, poses: &[Pose]| -> Option<Vec<Block>> {
        views.iter().zip(poses).map(|(view, pose)| block(&free, camera, view, pose)).collect()
    };
    let cost_of = |blocks: &[Block]| blocks.iter().map(|block| block.cost).sum::<f64>();
    let mut blocks = blocks_at(&camera, &poses)?;
    let mut damping = 1e-4;
    for _ in 0..100 {
        let (matrix, slope, inverses) = reduced(&free, &blocks, damping)?;
        let step = matrix.cholesky()?.solve(&-slope);
        let moved = free.moved(&camera, &step);
        let next: Vec<Pose> = poses
            .iter()
            .zip(blocks.iter().zip(&inverses))
            .map(|(pose, (block, inverse))| {
                pose.changed(&(-(inverse * (block.by_pose + block.mixed.tr_mul(&step)))))
            })
            .collect();
        let found = blocks_at(&moved, &next).filter(|next| cost_of(next) <= cost_of(&blocks));
        let still = step.norm() < 1e-9;
        if let Some(found) = found {
            (camera, poses, blocks) = (moved, next, found);
            damping = (damping * 0.2).max(1e-15);
        } else {
            damping *= 8.0;
        }
        if still || damping > 1e9 {
            break;
        }
    }
    summary(&free, camera, &poses, &blocks, views)
}

fn summary(
    free: &FreeParameters,
    camera: Pinhole,
    poses: &[Pose],
    blocks: &[Block],
    views: &[CalibrationView],
) -> Option<Adjustment> {
    let count = |view: &CalibrationView| 2.0 * view.sightings.len() as f64;
    let equations: f64 = views.iter().map(count).sum();
    let cost: f64 = blocks.iter().map(|block| block.cost).sum();
    let left = equations - 6.0 * views.len() as f64 - free.count() as f64;
    let variance = cost / left.max(1.0);
    let (matrix, _, inverses) = reduced(free, blocks, 0.0)?;
    let covariance = free.spread(&(matrix.cholesky()?.inverse() * variance));
    // The first view's distance: its own uncertainty, and the camera's contribution.
    let follow = inverses[0] * blocks[0].mixed.transpose();
    let along = poses[0].translation.normalize();
    let distance = Vector6::new(0.0, 0.0, 0.0, along.x, along.y, along.z);
    let by_numbers = -follow.tr_mul(&distance);
    let own = distance.dot(&(inverses[0] * distance)) * variance;
    let total = own + by_numbers.dot(&(covariance * by_numbers));
    let shared = (covariance * by_numbers)[0];
    Some(Adjustment {
        camera,
        covariance,
        focal_distance_correlation: shared / (covariance[(0, 0)] * total).sqrt(),
        rms_px: (cost / equations).sqrt(),
        view_rms_px: blocks.iter().zip(views).map(|(b, view)| (b.cost / count(view)).sqrt()).collect(),
        noise_px: variance.sqrt(),
    })
}
