//! Depth for views: the disparity of each pixel under which the picture best predicts what the eyes
//! beside it see.
//!
//! The depth of a ray is a point of its own. In translucent tissue it jumps from pixel to pixel, and
//! the views that a display makes of it tear. Here the picture is compared with two views rendered
//! beside it, by semi-global matching (Hirschmüller, IEEE TPAMI 30(2), 2008): of all maps of
//! disparities, nearly the one with the least sum of colour differences and of jumps.
//!
//! 1. [`costs`]: the difference of colours for each pixel and each of [`LEVELS`] disparities;
//! 2. [`paths`]: the sum of those and of jumps along paths from four directions;
//! 3. [`enlarge`]: the disparity of every pixel from those of every second one, along colours;
//! 4. [`near_ray`]: the disparity of the ray, where the found one is nearly equal.
//!
//! [`hidden_layer`] collects what the views beside the picture show and the picture does not.
//!
//! Spaces: the views beside have a ray for every second pixel of every second row, the first
//! included, and so have costs. Shifts are in pixels of the picture, disparities 0 (far) to 255.
//! Costs are mean squared differences of a pixel's bytes. All sums are of whole numbers or in a fixed
//! order, so equal pictures get equal depth.

mod costs;
mod enlarge;
mod hidden;
mod paths;
mod rows;

use std::ops::Range;

use rayon::prelude::*;

use super::views::Parallax;
pub use hidden::{HiddenLayer, hidden_layer};
pub use rows::SideView;
use rows::{LEVELS, Levels, Rows};

/// Rows of every second pixel that are matched at a time, which bounds the memory.
const STRIP_ROWS: usize = 256;
/// Rows before and behind a strip that its paths begin in.
const OVERLAP_ROWS: usize = 32;

/// Largest difference between the found disparity and that of the ray at which both mean the same
/// surface: the distance of two levels.
const SAME: f32 = 8.0;

/// Width of the background that is compared beside an outline, in places of every second pixel.
const OUTLINE: usize = 8;

/// The size of views beside a picture.
#[must_use]
pub fn side_size_px([width, height]: [u32; 2]) -> [u32; 2] {
    [width.div_ceil(2), height.div_ceil(2)]
}

/// The disparity (0 to 255) of every pixel of a picture, in rows from the top. `rays` are the
/// disparities of the rays: they decide on smooth opaque surfaces without texture, and replace found ones
/// that are nearly equal.
///
/// # Panics
/// When the pictures do not fill their sizes.
#[must_use]
pub fn disparity_for_views(
    size_px: [u32; 2],
    color: &[[u8; 4]],
    rays: &[u8],
    sides: &[SideView<'_>; 2],
    parallax: &Parallax,
) -> Vec<f32> {
    let side_px = side_size_px(size_px);
    assert_eq!(color.len() as u64, u64::from(size_px[0]) * u64::from(size_px[1]), "the picture");
    for side in sides {
        assert_eq!(side.color.len() as u64, u64::from(side_px[0]) * u64::from(side_px[1]), "a view");
    }
    let [columns, rows] = side_px.map(|side| side as usize);
    assert_eq!(color.len(), rays.len(), "a ray for each pixel");
    let picture = Rows { width: size_px[0] as usize, color, rays };
    let mut sparse = Vec::with_capacity(columns * rows);
    for first in (0..rows).step_by(STRIP_ROWS) {
        let kept = first..(first + STRIP_ROWS).min(rows);
        sparse.extend(strip(&picture, sides, parallax, kept, rows));
    }
    let mut found = enlarge::enlarge(size_px, color, &sparse);
    found.par_iter_mut().zip(rays).for_each(|(found, ray)| *found = near_ray(*found, f32::from(*ray)));
    found
}

/// The disparity of the ray up to a difference of [`SAME`], the found one from twice that difference on,
/// and a mixture in between.
///
/// Nearly equal disparities mean the same surface. The ray's is exact, changes smoothly while the
/// camera moves, and is that of overlays on the surface. The found one has the noise of its levels.
fn near_ray(found: f32, ray: f32) -> f32 {
    let apart = found - ray;
    ray + apart * (apart.abs() / SAME - 1.0).clamp(0.0, 1.0)
}

/// The disparities of these rows of every second pixel.
fn strip(
    picture: &Rows<'_>,
    sides: &[SideView<'_>; 2],
    parallax: &Parallax,
    kept: Range<usize>,
    rows: usize,
) -> Vec<f32> {
    let columns = picture.width.div_ceil(2);
    let matched = kept.start.saturating_sub(OVERLAP_ROWS)..(kept.end + OVERLAP_ROWS).min(rows);
    let lit: Vec<Range<usize>> = matched.clone().map(|y| lit_span(picture.row(2 * y))).collect();
    let spans: Vec<Range<usize>> = (0..lit.len()).map(|y| widened(&lit, y, columns)).collect();
    let costs = costs::costs(picture, sides, parallax, &spans, matched.start);
    let [along, across] = paths::sums(picture, &costs, &spans, matched.start);
    let first = kept.start - matched.start;
    let mut found = vec![0.0; kept.len() * columns];
    found.par_chunks_exact_mut(columns).enumerate().for_each(|(y, found)| {
        let span = spans[first + y].clone();
        let row = (first + y) * columns;
        for (x, found) in found[span.clone()].iter_mut().enumerate() {
            let at = row + span.start + x;
            *found = best(&std::array::from_fn(|level| along[at][level].wrapping_add(across[at][level])));
        }
    });
    found
}

/// The part of every second pixel of a row between the first and the last that show something.
fn lit_span(line: &[[u8; 4]]) -> Range<usize> {
    let is_lit = |pixel: &[u8; 4]| pixel[3] > 0;
    match (line.iter().position(is_lit), line.iter().rposition(is_lit)) {
        (Some(first), Some(last)) => first / 2..last / 2 + 1,
        _ => 0..0,
    }
}

/// The part of a row that is compared: what shows something there or in the rows around, and the
/// background beside its outline. The rest of the background is far.
fn widened(lit: &[Range<usize>], y: usize, columns: usize) -> Range<usize> {
    let around = &lit[y.saturating_sub(OUTLINE)..(y + OUTLINE + 1).min(lit.len())];
    let around = around.iter().filter(|span| !span.is_empty());
    let whole = around.cloned().reduce(|a, b| a.start.min(b.start)..a.end.max(b.end));
    whole.map_or(0..0, |span| span.start.saturating_sub(OUTLINE)..(span.end + OUTLINE).min(columns))
}

/// The disparity with the least sum, between levels by the parabola through its neighbours.
fn best(sums: &Levels) -> f32 {
    const STEP: f32 = 255.0 / (LEVELS - 1) as f32;
    let least = (0..LEVELS).min_by_key(|&level| sums[level]).unwrap_or(0);
    let neighbours = least.checked_sub(1).zip(Some(least + 1).filter(|next| *next < LEVELS));
    let offset = neighbours.map_or(0.0, |(before, behind)| {
        let [before, at, behind] = [before, least, behind].map(|level| f32::from(sums[level]));
        let bend = before - 2.0 * at + behind;
        if bend > 0.0 { (before - behind) / (2.0 * bend) } else { 0.0 }
    });
    (least as f32 + offset) * STEP
}

#[cfg(test)]
mod tests;
