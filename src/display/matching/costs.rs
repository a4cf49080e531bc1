//! The difference between a picture and the views beside it, under each disparity.
//!
//! A ray of a view is compared with the picture where that would show the same point; between pixels
//! the picture is interpolated along its row. The view itself is never interpolated: it is sparse, and
//! its mean would be another colour. Half of a cost is the pixel's own, half that of its neighbours,
//! which bridges noise and keeps thin structures.

use std::ops::Range;

use rayon::prelude::*;

use super::rows::{COST_UNIT, LEVELS, Levels, Rows, SideView};
use crate::views::Parallax;
use relief_base::Disparity;

/// Largest difference: of two colours that have nothing in common. Sums of costs fit 16 bits.
const MOST: f32 = 1500.0;
/// Range of the rays' disparities around a pixel, up to which they are one surface.
const SMOOTH: u8 = 6;
/// Coverage from which a surface is opaque: 90 %.
const OPAQUE: u8 = 230;
/// Largest cost that is added to a disparity for its difference from that of a smooth opaque surface.
/// Smaller ones are the square of the difference in levels.
const MOST_DEVIATION: f32 = 100.0;

/// The costs of every second pixel in rows of them from number `first` on, within the rows' spans;
/// 0 elsewhere.
pub(super) fn costs(
    picture: &Rows<'_>,
    sides: &[SideView<'_>; 2],
    parallax: &Parallax,
    spans: &[Range<usize>],
    first: usize,
) -> Vec<Levels> {
    let columns = picture.width.div_ceil(2);
    let shifts = sides.map(|side| shifts(parallax, side.eye, picture.width));
    let mut own = vec![[0; LEVELS]; spans.len() * columns];
    let rows = own.par_chunks_exact_mut(columns).zip(spans).enumerate();
    rows.for_each_init(Scratch::default, |scratch, (y, (out, span))| {
        if span.is_empty() {
            return;
        }
        let line = picture.row(2 * (first + y));
        scratch.sums.clear();
        scratch.sums.resize(LEVELS * span.len(), 0.0);
        for (side, shifts) in sides.iter().zip(&shifts) {
            scratch.add(line, &side.color[(first + y) * columns..][..columns], span, shifts);
        }
        for (column, out) in out[span.clone()].iter_mut().enumerate() {
            for (level, out) in out.iter_mut().enumerate() {
                *out = (0.5 * f32::from(COST_UNIT) * scratch.sums[level * span.len() + column]) as i16;
            }
        }
    });
    let mut costs = with_neighbours(&own, columns, spans);
    costs.par_chunks_exact_mut(columns).zip(spans).enumerate().for_each(|(y, (costs, span))| {
        for column in span.clone() {
            if let Some(disparity) = picture.surface([2 * column, 2 * (first + y)]) {
                prefer(&mut costs[column], disparity);
            }
        }
    });
    costs
}

/// Adds to each cost for the difference of its disparity from this one. This decides where a surface
/// has no texture, and where a highlight moves over it. The parabola of [`super::best`] finds
/// disparities between the levels.
fn prefer(costs: &mut Levels, disparity: u8) {
    let place = f32::from(disparity) * (LEVELS - 1) as f32 / 255.0;
    for (level, cost) in costs.iter_mut().enumerate() {
        let deviation = (level as f32 - place).abs();
        let added = (deviation * deviation).min(MOST_DEVIATION) * f32::from(COST_UNIT);
        *cost = cost.wrapping_add(added as i16);
    }
}

impl Rows<'_> {
    /// The disparity of the rays at a pixel of a smooth opaque surface; `None` elsewhere.
    fn surface(&self, [x, y]: [usize; 2]) -> Option<u8> {
        let rows = y.saturating_sub(1)..(y + 2).min(self.height());
        let columns = x.saturating_sub(1)..(x + 2).min(self.width);
        let around = rows.flat_map(|row| &self.rays[row * self.width..][columns.clone()]);
        let (least, most) = around.fold((u8::MAX, 0), |(least, most), d| (least.min(*d), most.max(*d)));
        let at = y * self.width + x;
        (self.color[at][3] >= OPAQUE && most - least <= SMOOTH).then_some(self.rays[at])
    }
}

/// The shift of each level, pixels.
fn shifts(parallax: &Parallax, eye: f64, width: usize) -> [f32; LEVELS] {
    let most = width as f64;
    std::array::from_fn(|level| {
        let disparity = Disparity(255.0 * level as f64 / (LEVELS - 1) as f64);
        parallax.shift_px(disparity, eye).clamp(-most, most) as f32
    })
}

/// Buffers of a row. Those of the view and of differences reach beyond the span by a margin on both
/// sides, those of the picture by two.
#[derive(Default)]
struct Scratch {
    /// The sums of both views: columns of a level side by side.
    sums: Vec<f32>,
    /// Even and odd pixels of each channel of the picture's row.
    picture: [[Vec<f32>; 2]; 3],
    view: [Vec<f32>; 3],
    /// The differences of the view's rays under one shift.
    differences: Vec<f32>,
}

impl Scratch {
    /// Adds the costs of one view within the span.
    fn add(&mut self, line: &[[u8; 4]], view: &[[u8; 4]], span: &Range<usize>, shifts: &[f32; LEVELS]) {
        let farthest = shifts.iter().fold(0.0_f32, |most, shift| most.max(shift.abs()));
        let margin = farthest as usize / 2 + 2;
        self.load(line, view, span, margin);
        for (shift, sums) in shifts.iter().zip(self.sums.chunks_exact_mut(span.len())) {
            differences(&mut self.differences, &self.picture, &self.view, -shift, margin);
            // The rays on both sides of the place at which the view shows a pixel.
            let place = shift / 2.0;
            let left = place.floor();
            let share = place - left;
            let first = (margin as f32 + left) as usize;
            let [left, right] = [first, first + 1].map(|first| &self.differences[first..][..sums.len()]);
            for ((sum, left), right) in sums.iter_mut().zip(left).zip(right) {
                *sum += left * (1.0 - share) + right * share;
            }
        }
    }

    /// Pixels beyond the ends of the row are those at the ends.
    fn load(&mut self, line: &[[u8; 4]], view: &[[u8; 4]], span: &Range<usize>, margin: usize) {
        for channel in 0..3 {
            for (parity, plane) in self.picture[channel].iter_mut().enumerate() {
                let pixel = |at: usize| {
                    let x = (2 * (span.start + at) + parity).saturating_sub(4 * margin).min(line.len() - 1);
                    f32::from(line[x][channel])
                };
                plane.clear();
                plane.extend((0..span.len() + 4 * margin).map(pixel));
            }
            let ray = |at: usize| {
                let column = (span.start + at).saturating_sub(margin).min(view.len() - 1);
                f32::from(view[column][channel])
            };
            self.view[channel].clear();
            self.view[channel].extend((0..span.len() + 2 * margin).map(ray));
        }
    }
}

/// The differences of a view's rays from the picture `shift` pixels to the right of them.
fn differences(
    out: &mut Vec<f32>,
    picture: &[[Vec<f32>; 2]; 3],
    view: &[Vec<f32>; 3],
    shift: f32,
    margin: usize,
) {
    out.clear();
    out.resize(view[0].len(), 0.0);
    let left = shift.floor();
    let share = shift - left;
    let left = left as isize + 2 * margin as isize;
    let place = |at: isize| (usize::from(at % 2 != 0), (at / 2) as usize);
    for (planes, view) in picture.iter().zip(view) {
        let [left, right] = [left, left + 1].map(|at| {
            let (parity, first) = place(at);
            &planes[parity][first..][..view.len()]
        });
        for (((out, view), left), right) in out.iter_mut().zip(view).zip(left).zip(right) {
            let difference = left * (1.0 - share) + right * share - view;
            *out += difference * difference;
        }
    }
    out.iter_mut().for_each(|sum| *sum = (*sum / 3.0).min(MOST));
}

/// The mean of each cost and of those around it, by binomial weights over 3x3.
fn with_neighbours(own: &[Levels], columns: usize, spans: &[Range<usize>]) -> Vec<Levels> {
    // Costs are at most 6000, so four of them stay within 16 bits.
    let binomial = |a: &Levels, b: &Levels, c: &Levels| -> Levels {
        std::array::from_fn(|level| {
            a[level].wrapping_add(b[level].wrapping_mul(2)).wrapping_add(c[level]) / 4
        })
    };
    let mut across = vec![[0; LEVELS]; own.len()];
    let rows = across.par_chunks_exact_mut(columns).zip(own.par_chunks_exact(columns)).zip(spans);
    rows.for_each(|((out, row), span)| {
        for at in span.clone() {
            let [before, behind] = [at.saturating_sub(1).max(span.start), (at + 1).min(span.end - 1)];
            out[at] = binomial(&row[before], &row[at], &row[behind]);
        }
    });
    let mut mixed = vec![[0; LEVELS]; own.len()];
    mixed.par_chunks_exact_mut(columns).zip(spans).enumerate().for_each(|(y, (out, span))| {
        // A pixel that is compared, or else the one of this row.
        let beside = |row: usize, x: usize| {
            let is_compared = spans.get(row).is_some_and(|span| span.contains(&x));
            &across[if is_compared { row } else { y } * columns + x]
        };
        for x in span.clone() {
            let around = binomial(beside(y.wrapping_sub(1), x), &across[y * columns + x], beside(y + 1, x));
            let own = &own[y * columns + x];
            out[x] = std::array::from_fn(|level| own[level].wrapping_add(around[level]) / 2);
        }
    });
    mixed
}
