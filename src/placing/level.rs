//! The level between two kinds of matter around a place, by the voxels alone.

use super::Search;
use super::field::Field;

/// The part of the variance that lies between the two classes, at least. Values that are all of one kind and noisy have 0.64 (a normal
/// distribution cut in its middle), two kinds far apart more than 0.9.
const LEAST_BETWEEN: f64 = 0.75;

/// Fewer voxels tell nothing.
const FEWEST: usize = 16;

/// The level at which a surface between two kinds of matter is: halfway between the means of the two classes into which the voxels of the
/// ball fall best (Otsu's threshold), HU. `None` where they are of one kind, or hardly any.
pub(super) fn around(field: &Field<'_>, search: &Search) -> Option<f64> {
    let mut values = field.voxels_within(search.at, search.radius_mm);
    if values.len() < FEWEST {
        return None;
    }
    values.sort_unstable();
    let count = values.len() as f64;
    let mean = values.iter().map(|hu| f64::from(*hu)).sum::<f64>() / count;
    let variance = values.iter().map(|hu| (f64::from(*hu) - mean).powi(2)).sum::<f64>() / count;
    let total = mean * count;
    let (mut below, mut sum) = (0.0, 0.0);
    let mut best: Option<(f64, f64)> = None;
    for pair in values.windows(2) {
        below += 1.0;
        sum += f64::from(pair[0]);
        if pair[0] == pair[1] {
            continue; // no level is between equal values
        }
        let (low, high) = (sum / below, (total - sum) / (count - below));
        let between = below * (count - below) / (count * count) * (high - low).powi(2);
        if best.is_none_or(|(most, _)| between > most) {
            best = Some((between, f64::midpoint(low, high)));
        }
    }
    best.filter(|(between, _)| *between >= LEAST_BETWEEN * variance).map(|(_, level)| level)
}
