//! The nearest local minimum or maximum of the smoothed field that stands out.

use glam::DVec3;

use super::error::SnapError;
use super::field::Field;
use super::lattice::Lattice;
use super::search::Search;

/// Smaller contrasts do not count as extremes, HU.
const LEAST_HU: f64 = 1.0;

/// Of the height of the highest one.
const STANDS_OUT: f64 = 0.5;

/// A voxel is higher than its neighbours by this, or it is rounding on an even plain, HU.
const HIGHER_HU: f64 = 1e-6;

/// Most that are followed to the place between voxels, the nearest first.
const MOST_SEEDS: usize = 256;

/// The nearest one; `sign` is 1 for a maximum, -1 for a minimum.
///
/// # Errors
/// When the ball holds too many voxels.
pub(super) fn find(field: &Field<'_>, search: &Search, sign: f64) -> Result<Option<DVec3>, SnapError> {
    let Search { at, radius_mm, .. } = *search;
    let Some(lattice) = Lattice::around(field, at, radius_mm)? else { return Ok(None) };
    // One more voxel around the ball, because an extreme between voxels may be inside.
    let reach_mm = radius_mm + field.volume.grid().spacing_mm().into_iter().fold(0.0, f64::max);
    let (mut sum, mut count) = (0.0, 0.0);
    let mut peaks: Vec<(f64, f64, DVec3)> = Vec::new();
    for (place, index) in lattice.voxels() {
        let position = field.patient_from_voxel.transform_point3(index);
        let distance = position.distance(at);
        let height = sign * lattice.value(place);
        if distance <= radius_mm {
            sum += height;
            count += 1.0;
        }
        let is_peak = distance <= reach_mm
            && lattice.knows_around(place)
            && lattice.neighbours(place).all(|beside| height > sign * lattice.value(beside) + HIGHER_HU);
        if is_peak {
            peaks.push((distance, height, position));
        }
    }
    let mean = if count > 0.0 { sum / count } else { f64::NEG_INFINITY };
    let highest = peaks.iter().map(|peak| peak.1).fold(f64::NEG_INFINITY, f64::max);
    let least = mean + ((highest - mean) * STANDS_OUT).max(LEAST_HU);
    peaks.retain(|peak| count == 0.0 || peak.1 >= least);
    peaks.sort_by(|a, b| a.0.total_cmp(&b.0));
    let settled = peaks.into_iter().take(MOST_SEEDS).map(|(_, _, seed)| settle(field, seed, sign));
    let inside = settled.filter(|place| place.distance(at) <= radius_mm && field.value(*place).is_some());
    Ok(inside.min_by(|a, b| a.distance(at).total_cmp(&b.distance(at))))
}

/// Newton's steps from a voxel to where the gradient vanishes, at most a voxel away; the voxel
/// itself if they diverge.
fn settle(field: &Field<'_>, seed: DVec3, sign: f64) -> DVec3 {
    let mut place = seed;
    for _ in 0..20 {
        let smooth = field.smooth(place);
        let hessian = smooth.hessian * sign;
        if !is_negative(hessian) {
            return seed;
        }
        let step = -(hessian.inverse() * (smooth.gradient * sign));
        place += step;
        let off = field.voxel_from_patient.transform_vector3(place - seed);
        if off.is_nan() || off.abs().max_element() > 1.0 {
            return seed;
        }
        if step.length() < 1e-6 {
            break;
        }
    }
    place
}

/// Whether the field curves down in every direction: minors of alternating sign.
fn is_negative(hessian: glam::DMat3) -> bool {
    let [a, b, c] = [hessian.x_axis, hessian.y_axis, hessian.z_axis];
    a.x < 0.0 && a.x * b.y - a.y * b.x > 0.0 && hessian.determinant() < 0.0 && c.z < 0.0
}
