//! `clear-edge`: depth edges that lie on colour edges, and a foreground that is a little too wide
//! rather than too narrow.
//!
//! A 2D-plus-depth display shifts each pixel by its disparity and interpolates between them. Where
//! depth steps beside the outline of an object and not on it, a rim of the object is torn off or a
//! rim of the background sticks to it. So near depth edges, in this order:
//!
//! 1. A pixel's depth becomes the weighted median of the pixels around it, weighted by the
//!    similarity of their colours: the rim takes the depth of the object or background that has its
//!    colour.
//! 2. The nearest depth within a few pixels wins: interpolation happens beside the object, on the
//!    background, where it does no harm.
//!
//! Elsewhere depth is unchanged: an edge is a step between neighbouring pixels, a slope is not. The
//! median rounds the outline of objects without a colour edge, and removes parts thinner than four
//! pixels.

use rayon::prelude::*;

use super::padded::{Padded, miss_if_unknown};
use crate::layout::Picture;
use relief_base::DepthLimits;

/// The width by which the foreground is widened at depth edges, pixels.
pub(super) const WIDENED_PX: usize = 2;
/// The reach of the filter, pixels to each side.
pub(super) const REACH_PX: usize = 4;
/// Neighbours whose depths differ by more than this share of the depth range have an edge between
/// them: four of 255 disparities.
const EDGE_SHARE: f64 = 1.0 / 64.0;
/// Standard deviation of the weight over the difference of colours: the sum over red, green and
/// blue, 0..765.
const COLOR_DEVIATION: f64 = 30.0;
/// The weight of the same colour. Whole numbers add up to the same in any order.
const FULL_WEIGHT: f64 = 65535.0;
/// Pixels in a window.
const WINDOW: usize = (2 * REACH_PX + 1).pow(2);
/// Numbers that are worked on side by side.
const LANES: usize = 8;

/// Both steps. View depth in mm, `+inf` for a miss.
pub(super) fn clear_edge(picture: &Picture<'_>, limits: DepthLimits) -> Vec<f32> {
    let width = picture.size_px()[0] as usize;
    let edges = Edges::new(limits);
    let depth: Vec<f32> = picture.depth_mm().iter().map(|&mm| miss_if_unknown(mm)).collect();
    let near_edge = edges.near_edge(&depth, width);
    let aligned = aligned(picture, &depth, &near_edge);
    let nearest = extreme(&aligned, width, WIDENED_PX, lesser);
    let widened = |i: usize| near_edge[i] && edges.is_between(nearest[i], aligned[i]);
    (0..depth.len()).map(|i| if widened(i) { nearest[i] } else { aligned[i] }).collect()
}

/// The differences of depth that are edges.
struct Edges {
    near_mm: f32,
    far_mm: f32,
    least_mm: f32,
}

impl Edges {
    fn new(limits: DepthLimits) -> Self {
        let least_mm = (EDGE_SHARE * (limits.far_mm - limits.near_mm)) as f32;
        Self { near_mm: limits.near_mm as f32, far_mm: limits.far_mm as f32, least_mm }
    }

    /// Whether there is an edge between two depths. Depths beyond the same limit look equal on a
    /// display.
    fn is_between(&self, near: f32, far: f32) -> bool {
        let shown = |mm: f32| mm.clamp(self.near_mm, self.far_mm);
        shown(far) - shown(near) > self.least_mm
    }

    /// The pixels with an edge in reach.
    fn near_edge(&self, depth: &[f32], width: usize) -> Vec<bool> {
        let (nearest, farthest) = (extreme(depth, width, 1, lesser), extreme(depth, width, 1, greater));
        let pairs = nearest.iter().zip(&farthest);
        let edge: Vec<f32> = pairs.map(|(&a, &b)| if self.is_between(a, b) { 1.0 } else { 0.0 }).collect();
        extreme(&edge, width, REACH_PX, greater).iter().map(|&edge| edge > 0.0).collect()
    }
}

/// The weighted median near edges.
fn aligned(picture: &Picture<'_>, depth: &[f32], near_edge: &[bool]) -> Vec<f32> {
    let [width, height] = picture.size_px().map(|side| side as usize);
    let reach = REACH_PX;
    let weights = weights();
    let mut aligned = depth.to_vec();
    aligned.par_chunks_mut(width).enumerate().for_each(|(row, line)| {
        for (column, mm) in line.iter_mut().enumerate() {
            let at = row * width + column;
            if !near_edge[at] {
                continue;
            }
            let own = picture.color()[at];
            let mut window = [(0.0, 0); WINDOW];
            for (i, pair) in window.iter_mut().enumerate() {
                let x = (column + i % (2 * reach + 1)).saturating_sub(reach).min(width - 1);
                let y = (row + i / (2 * reach + 1)).saturating_sub(reach).min(height - 1);
                let there = y * width + x;
                *pair = (depth[there], weights[color_difference(own, picture.color()[there])]);
            }
            *mm = weighted_median(&mut window);
        }
    });
    aligned
}

/// Sum of the differences of red, green and blue, 0..765.
fn color_difference(a: [u8; 4], b: [u8; 4]) -> usize {
    (0..3).map(|channel| usize::from(a[channel].abs_diff(b[channel]))).sum()
}

/// The weight of every difference of colours.
fn weights() -> [u32; 766] {
    let weight = |difference: f64| FULL_WEIGHT * (-0.5 * (difference / COLOR_DEVIATION).powi(2)).exp();
    std::array::from_fn(|difference| weight(difference as f64).round() as u32)
}

/// The smallest value at which, with all smaller ones, half of the weight is reached. Shuffles the
/// pairs.
fn weighted_median(pairs: &mut [(f32, u32)]) -> f32 {
    let total: u32 = pairs.iter().map(|(_, weight)| weight).sum();
    let mut rest = pairs;
    let mut needed = total.div_ceil(2);
    loop {
        let pivot = rest[rest.len() / 2].0;
        let (mut less, mut equal) = (0, 0);
        for &(value, weight) in &*rest {
            less += if value < pivot { weight } else { 0 };
            equal += if value == pivot { weight } else { 0 };
        }
        if less >= needed {
            let count = gather(rest, |value| value < pivot);
            rest = &mut rest[..count];
        } else if less + equal >= needed {
            return pivot;
        } else {
            needed -= less + equal;
            let count = gather(rest, |value| value > pivot);
            rest = &mut rest[..count];
        }
    }
}

/// Moves the pairs whose value is wanted to the front and counts them.
fn gather(pairs: &mut [(f32, u32)], wanted: impl Fn(f32) -> bool) -> usize {
    let mut count = 0;
    for i in 0..pairs.len() {
        if wanted(pairs[i].0) {
            pairs.swap(count, i);
            count += 1;
        }
    }
    count
}

fn lesser(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}

fn greater(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

/// The extreme value of the square of `reach` pixels to each side: along rows, then along columns.
fn extreme(plane: &[f32], width: usize, reach: usize, pick: impl Fn(f32, f32) -> f32 + Sync) -> Vec<f32> {
    let along_rows =
        folded(plane, width, reach, |padded, row, shift| padded.run(shift, row + reach, width), &pick);
    folded(&along_rows, width, reach, |padded, row, shift| padded.run(reach, row + shift, width), &pick)
}

/// Every row folded from shifted runs of the padded plane.
fn folded(
    plane: &[f32],
    width: usize,
    reach: usize,
    run: impl Fn(&Padded, usize, usize) -> &[f32] + Sync,
    pick: &(impl Fn(f32, f32) -> f32 + Sync),
) -> Vec<f32> {
    let padded = Padded::new(plane, width, reach, LANES);
    let mut out = vec![0.0; plane.len()];
    out.par_chunks_mut(width).enumerate().for_each(|(row, line)| {
        line.copy_from_slice(run(&padded, row, 0));
        for shift in 1..=2 * reach {
            for (value, &other) in line.iter_mut().zip(run(&padded, row, shift)) {
                *value = pick(*value, other);
            }
        }
    });
    out
}
