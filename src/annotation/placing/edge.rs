//! The steepest edge near a place: where the smoothed gradient's magnitude is a maximum along its
//! own direction, or along a ray.
//!
//! Magnitude times nearness selects the edge; only distance selects the point on it, because along
//! a homogeneous edge the magnitude varies with noise and with the position of the edge between
//! voxels.

use glam::DVec3;

use super::climb::{SurfacePoint, climb};
use super::error::SnapError;
use super::field::{Field, Smooth};
use super::lattice::Lattice;
use super::search::Search;

/// Smaller gradients count as zero, HU per mm.
const LEAST_HU_PER_MM: f64 = 1.0;

/// An edge continues while it has this part of the magnitude that it was chosen for.
const GOES_ON: f64 = 0.5;

/// Number of first places that are followed to their edges, and of those that are climbed along.
const MOST_SEEDS: usize = 24;
const MOST_CLIMBED: usize = 3;

/// Cosine between the gradient where a line to an edge begins and that at the edge.
const MOST_TURNED: f64 = 0.3;

/// The distance before and behind an edge at which the magnitude is less, parts of the Gaussian's
/// width.
const BESIDE: f64 = 0.15;

/// Steps along a line, parts of the Gaussian's width, and how often a zero between them is closed
/// in on.
const STEP: f64 = 0.4;
const CLOSER: usize = 24;

/// The edge with the largest magnitude times nearness.
///
/// # Errors
/// When the ball holds too many voxels.
pub(super) fn find(field: &Field<'_>, search: &Search) -> Result<Option<DVec3>, SnapError> {
    let Search { at, ray, radius_mm } = *search;
    let nearness = |place: DVec3| 1.0 - place.distance_squared(at) / (radius_mm * radius_mm);
    if let Some(ray) = ray {
        return Ok(along_ray(field, at, ray, radius_mm));
    }
    let Some(lattice) = Lattice::around(field, at, radius_mm)? else { return Ok(None) };
    let project = |place: DVec3| {
        let on = ridge(field, place)?;
        let gradient = field.smooth(on).gradient;
        // Outside the ball the score is 0, so that a search outside moves inwards first.
        let near = nearness(on);
        let score = if near > 0.0 { gradient.length() * near } else { near };
        let counts = gradient.length() >= LEAST_HU_PER_MM && field.value(on).is_some();
        counts.then_some(SurfacePoint { at: on, normal: gradient.normalize(), score })
    };
    let mut edges: Vec<SurfacePoint> =
        seeds(field, &lattice, nearness).into_iter().filter_map(project).collect();
    edges.sort_by(|a, b| b.score.total_cmp(&a.score));
    let climbed =
        edges.into_iter().take(MOST_CLIMBED).map(|edge| climb(edge, field.spacing_mm / 2.0, project));
    let steepest = climbed.filter(|edge| edge.score > 0.0).max_by(|a, b| a.score.total_cmp(&b.score));
    Ok(steepest.map(|edge| {
        let least = GOES_ON * edge.score / nearness(edge.at);
        let nearer = |place: DVec3| {
            let found = project(place)?;
            let goes_on = found.score / nearness(found.at) >= least && nearness(found.at) > 0.0;
            goes_on.then_some(SurfacePoint { score: -found.at.distance(at), ..found })
        };
        climb(SurfacePoint { score: -edge.at.distance(at), ..edge }, field.spacing_mm / 2.0, nearer).at
    }))
}

/// Voxels in and around the ball, apart from one another, with the largest magnitude times
/// nearness: first those whose magnitude is no less than that of the voxels before and behind them.
fn seeds(field: &Field<'_>, lattice: &Lattice, nearness: impl Fn(DVec3) -> f64) -> Vec<DVec3> {
    let to_voxel = field.voxel_from_patient.matrix3;
    let gradient = |place: [usize; 3]| to_voxel.transpose() * lattice.differences(place);
    let mut steepest: Vec<(f64, DVec3)> = Vec::new();
    let mut others: Vec<(f64, DVec3)> = Vec::new();
    for (place, index) in lattice.voxels() {
        let here = gradient(place);
        let position = field.patient_from_voxel.transform_point3(index);
        // Voxels outside of the ball count too: an edge inside of it may lie next to them.
        let near = nearness(position).max(1e-6);
        if here.length() < LEAST_HU_PER_MM / 2.0 {
            continue;
        }
        let way = to_voxel * here;
        let way = (way / way.abs().max_element()).round();
        let is_steepest = [way, -way].into_iter().all(|way| {
            lattice.beside(place, way).is_none_or(|beside| gradient(beside).length() <= here.length())
        });
        let list = if is_steepest { &mut steepest } else { &mut others };
        list.push((here.length() * near, position));
    }
    let mut kept: Vec<DVec3> = Vec::new();
    // Where the gradient turns within a voxel its neighbours say little: some of the others too.
    for (most, mut list) in [(MOST_SEEDS, steepest), (2 * MOST_SEEDS, others)] {
        list.sort_by(|a, b| b.0.total_cmp(&a.0));
        for (_, position) in list {
            if kept.len() < most && kept.iter().all(|one| one.distance(position) > field.sigma_mm) {
                kept.push(position);
            }
        }
    }
    kept
}

/// From near an edge to the edge: where the magnitude is a maximum along the local gradient.
///
/// There the derivative along the gradient is zero. The magnitude a little before and behind
/// decides whether that is a maximum: where the gradient turns on the way, the derivative may rise
/// through zero at a maximum.
fn ridge(field: &Field<'_>, place: DVec3) -> Option<DVec3> {
    let normal = field.smooth(place).gradient.try_normalize()?;
    let rise = |at: DVec3| {
        let Smooth { gradient, hessian } = field.smooth(at);
        gradient.dot(hessian * gradient) * gradient.dot(normal).signum()
    };
    let is_edge = |off: &f64| {
        let at = place + normal * *off;
        let gradient = field.smooth(at).gradient;
        let magnitude = gradient.length();
        let Some(along) = gradient.try_normalize() else { return false };
        // Where the gradient turns across the line the sign changes too.
        let turns = along.dot(normal).abs() <= MOST_TURNED;
        let beside = along * (BESIDE * field.sigma_mm);
        let is_top = || {
            [beside, -beside]
                .into_iter()
                .all(|beside| field.smooth(at + beside).gradient.length() < magnitude)
        };
        !turns && is_top()
    };
    let offs = zeros(place, normal, 2.0 * field.sigma_mm, field.sigma_mm, rise);
    let offs = offs.into_iter().map(|(off, _)| off).filter(is_edge);
    offs.min_by(|a, b| a.abs().total_cmp(&b.abs())).map(|nearest| place + normal * nearest)
}

/// Offsets along a line, within a reach, where `rise` is zero, and whether it falls there.
fn zeros(
    from: DVec3,
    along: DVec3,
    reach_mm: f64,
    sigma_mm: f64,
    rise: impl Fn(DVec3) -> f64,
) -> Vec<(f64, bool)> {
    let steps = (reach_mm / (STEP * sigma_mm)).ceil().max(2.0);
    let step = reach_mm / steps;
    let rises = |off: f64| rise(from + along * off) > 0.0;
    let signs: Vec<bool> = (0..=2 * steps as usize).map(|i| rises((i as f64 - steps) * step)).collect();
    let changes = (1..signs.len()).filter(|&i| signs[i - 1] != signs[i]);
    let closed_in = changes.map(|i| {
        let (mut low, mut high) = ((i as f64 - 1.0 - steps) * step, (i as f64 - steps) * step);
        for _ in 0..CLOSER {
            let middle = f64::midpoint(low, high);
            if rises(middle) == signs[i - 1] { low = middle } else { high = middle }
        }
        (f64::midpoint(low, high), signs[i - 1])
    });
    closed_in.collect()
}

/// The edge along the ray with the largest magnitude times nearness.
fn along_ray(field: &Field<'_>, at: DVec3, ray: DVec3, radius_mm: f64) -> Option<DVec3> {
    let rise = |place: DVec3| {
        let Smooth { gradient, hessian } = field.smooth(place);
        gradient.dot(hessian * ray)
    };
    let offs = zeros(at, ray, radius_mm, field.sigma_mm, rise).into_iter();
    let edges = offs.filter(|(_, falls)| *falls).filter_map(|(off, _)| {
        let place = at + ray * off;
        let magnitude = field.smooth(place).gradient.length();
        let counts = magnitude >= LEAST_HU_PER_MM && field.value(place).is_some();
        counts.then_some((place, magnitude * (1.0 - (off / radius_mm).powi(2))))
    });
    edges.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(place, _)| place)
}
