//! The level between two materials around a point, from the voxels.

use super::error::SnapError;
use super::field::Field;
use super::search::Search;

/// The part of the variance that lies between the two classes, at least. Values that are all of one
/// kind and noisy have 0.64 (a normal distribution cut in its middle), two kinds far apart more
/// than 0.9.
const LEAST_BETWEEN: f64 = 0.75;

/// Fewer voxels tell nothing.
const FEWEST: f64 = 16.0;

/// The level of the surface between two materials: halfway between the means of the two classes
/// into which Otsu's threshold divides the voxels of the ball, HU. `None` if the voxels are of one
/// class, or too few. Voxels are counted by integer HU, so memory does not grow with the ball.
///
/// # Errors
/// When the ball holds too many voxels.
pub(super) fn around(field: &Field<'_>, search: &Search) -> Result<Option<f64>, SnapError> {
    let histogram = field.histogram_within(search.at, search.radius_mm)?;
    let sum_of =
        |term: &dyn Fn(f64) -> f64| histogram.values().map(|(hu, times)| times * term(hu)).sum::<f64>();
    let count = sum_of(&|_| 1.0);
    if count < FEWEST {
        return Ok(None);
    }
    let total = sum_of(&|hu| hu);
    let mean = total / count;
    let variance = sum_of(&|hu| (hu - mean).powi(2)) / count;
    let (mut below, mut sum) = (0.0, 0.0);
    let mut best: Option<(f64, f64)> = None;
    for (hu, times) in histogram.values() {
        below += times;
        sum += times * hu;
        if below == count {
            break; // no level is above the highest value
        }
        let (low, high) = (sum / below, (total - sum) / (count - below));
        let between = below * (count - below) / (count * count) * (high - low).powi(2);
        if best.is_none_or(|(most, _)| between > most) {
            best = Some((between, f64::midpoint(low, high)));
        }
    }
    Ok(best.filter(|(between, _)| *between >= LEAST_BETWEEN * variance).map(|(_, level)| level))
}
