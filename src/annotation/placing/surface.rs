//! The nearest point of an isosurface of the trilinear field, along a ray or in any direction.

use glam::DVec3;

use super::climb::{SurfacePoint, climb};
use super::error::SnapError;
use super::field::{Field, expect_few_voxels};
use super::search::Search;

/// A level is looked for this much higher, as isosurfaces are: off the whole HU that voxels have.
const OFF_HU: f64 = 1.0 / 64.0;

/// Steps along a line, parts of the finest spacing.
const STEP: f64 = 0.25;

/// Halvings of a step: far below a micrometre.
const HALVINGS: usize = 30;

/// First places that are followed to the surface.
const MOST_SEEDS: usize = 24;

/// Largest number of cells among which the nearest are selected.
const MOST_FOUND: usize = 1 << 16;

/// The place on the surface of `hu` that is nearest.
///
/// # Errors
/// When the ball holds too many voxels; along a ray they are not looked at.
pub(super) fn find(field: &Field<'_>, search: &Search, hu: f64) -> Result<Option<DVec3>, SnapError> {
    let Search { at, ray, radius_mm } = *search;
    let level = hu + OFF_HU;
    match ray {
        Some(ray) => Ok(crossing(field, at, ray, level, radius_mm).map(|off| at + ray * off)),
        None => nearest(field, at, level, radius_mm),
    }
}

/// How far from `from` along a unit vector, to either side, the level is crossed first; at most
/// `reach_mm`.
fn crossing(field: &Field<'_>, from: DVec3, along: DVec3, level: f64, reach_mm: f64) -> Option<f64> {
    let above = |off: f64| field.value(from + along * off).map(|hu| hu >= level);
    let steps = (reach_mm / (STEP * field.spacing_mm)).ceil().max(1.0);
    let step = reach_mm / steps;
    let mut ends = [above(0.0); 2];
    let mut number = 1.0;
    while number <= steps {
        let mut found: Option<f64> = None;
        for (side, end) in [1.0, -1.0].into_iter().zip(&mut ends) {
            let (near, far) = (side * step * (number - 1.0), side * step * number);
            let here = above(far);
            if let (Some(before), Some(after)) = (*end, here)
                && before != after
            {
                let off = bisect(near, far, |off| above(off) == Some(before));
                found = found.filter(|known| known.abs() <= off.abs()).or(Some(off));
            }
            *end = here;
        }
        if found.is_some() {
            return found;
        }
        number += 1.0;
    }
    None
}

/// The end of the stretch from `near` in which the condition holds.
fn bisect(mut near: f64, mut far: f64, holds: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..HALVINGS {
        let middle = f64::midpoint(near, far);
        if holds(middle) { near = middle } else { far = middle }
    }
    f64::midpoint(near, far)
}

fn nearest(field: &Field<'_>, at: DVec3, level: f64, radius_mm: f64) -> Result<Option<DVec3>, SnapError> {
    let project = |place: DVec3| {
        let normal = field.slope(place).try_normalize()?;
        let off = crossing(field, place, normal, level, 2.0 * field.spacing_mm)?;
        let on = place + normal * off;
        let normal = field.slope(on).try_normalize().unwrap_or(normal);
        Some(SurfacePoint { at: on, normal, score: -on.distance(at) })
    };
    let seeds = seeds(field, at, level, radius_mm)?;
    let climbed =
        seeds.into_iter().filter_map(project).map(|seed| climb(seed, field.spacing_mm / 2.0, project));
    let best = climbed.max_by(|a, b| a.score.total_cmp(&b.score));
    Ok(best.filter(|best| -best.score <= radius_mm).map(|best| best.at))
}

/// The middles of the cells nearest to `at` that the surface goes through.
fn seeds(field: &Field<'_>, at: DVec3, level: f64, radius_mm: f64) -> Result<Vec<DVec3>, SnapError> {
    let Some(ends) = field.voxels_around(at, radius_mm, 1.0) else { return Ok(Vec::new()) };
    expect_few_voxels(ends.map(|[low, high]| high + 1 - low), radius_mm)?;
    let ranges = ends.map(|[low, high]| low..high.max(low + 1));
    let axes = field.patient_from_voxel.matrix3;
    let diagonal_mm = (axes.x_axis.length() + axes.y_axis.length() + axes.z_axis.length()) / 2.0;
    let mut found: Vec<(f64, DVec3)> = Vec::new();
    let [xs, ys, zs] = ranges;
    for k in zs {
        for j in ys.clone() {
            for i in xs.clone() {
                let middle = DVec3::new(i as f64, j as f64, k as f64) + 0.5;
                let place = field.patient_from_voxel.transform_point3(middle);
                let distance = place.distance(at);
                if distance <= radius_mm + diagonal_mm && is_crossed(field, [i, j, k], level) {
                    if found.len() == MOST_FOUND {
                        keep_nearest(&mut found);
                    }
                    found.push((distance, place));
                }
            }
        }
    }
    keep_nearest(&mut found);
    Ok(found.into_iter().map(|(_, place)| place).collect())
}

/// Leaves the places with the least distances.
fn keep_nearest(found: &mut Vec<(f64, DVec3)>) {
    if found.len() > MOST_SEEDS {
        found.select_nth_unstable_by(MOST_SEEDS, |a, b| a.0.total_cmp(&b.0));
        found.truncate(MOST_SEEDS);
    }
}

/// Whether the eight voxels around a cell lie on both sides.
fn is_crossed(field: &Field<'_>, low: [usize; 3], level: f64) -> bool {
    let dims = field.volume.grid().dims();
    let (mut above, mut below) = (false, false);
    for corner in 0..8usize {
        let at = std::array::from_fn(|axis| (low[axis] + (corner >> axis & 1)).min(dims[axis] - 1));
        let is_above = f64::from(field.volume.hu(at)) >= level;
        above |= is_above;
        below |= !is_above;
    }
    above && below
}
