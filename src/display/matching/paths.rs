//! Sums of costs and jumps along straight paths that end in a pixel, from the left, the right, above
//! and below.
//!
//! A change by one level costs [`SLOPE`], a larger one up to [`JUMP`], the less the more colours
//! differ: surfaces may end where colours change.

use std::ops::Range;

use rayon::prelude::*;

use super::rows::{COST_UNIT, LEVELS, Levels, Rows};

/// The cost of a change by one level.
const SLOPE: i16 = 10 * COST_UNIT;
/// The cost of a larger change between equal colours.
const JUMP: i16 = 200 * COST_UNIT;
/// The difference of colours, summed over the channels, at which a jump costs half.
const EDGE: f32 = 200.0;
/// Columns that are worked on together.
const GROUP: usize = 64;

/// The state of a path: the sums that end in its last pixel, less the least of them.
#[derive(Clone, Copy)]
struct Path {
    sums: Levels,
}

impl Path {
    /// A path that has not begun: nothing came before.
    const NEW: Self = Self { sums: [0; LEVELS] };

    /// Goes on to a pixel and adds its sums to `total`.
    ///
    /// Sums are at most a cost and a jump, 7200; those of four paths fit 16 bits, so nothing wraps.
    #[inline(always)]
    fn step(&mut self, costs: &Levels, jump: i16, total: &mut Levels) {
        let mut padded = [i16::MAX / 2; LEVELS + 2];
        padded[1..=LEVELS].copy_from_slice(&self.sums);
        for level in 0..LEVELS {
            let slope = padded[level].min(padded[level + 2]).wrapping_add(SLOPE);
            let before = padded[level + 1].min(slope).min(jump);
            self.sums[level] = costs[level].wrapping_add(before);
        }
        let mut least = i16::MAX;
        for (sum, total) in self.sums.iter().zip(total.iter_mut()) {
            least = least.min(*sum);
            *total = total.wrapping_add(*sum);
        }
        self.sums.iter_mut().for_each(|sum| *sum = sum.wrapping_sub(least));
    }
}

/// The sums of the paths along rows, and of those across them, for costs of rows from number `first`
/// on; 0 outside of the rows' spans.
pub(super) fn sums(
    picture: &Rows<'_>,
    costs: &[Levels],
    spans: &[Range<usize>],
    first: usize,
) -> [Vec<Levels>; 2] {
    let columns = picture.width.div_ceil(2);
    let jumps = Jumps::new();
    let line = |y: usize| picture.row(2 * (first + y));
    let mut along = vec![[0; LEVELS]; costs.len()];
    along.par_chunks_exact_mut(columns).zip(costs.par_chunks_exact(columns)).zip(spans).enumerate().for_each(
        |(y, ((totals, costs), span))| {
            let line = line(y);
            let mut path = Path::NEW;
            for x in span.clone() {
                let jump = jumps.between(line[2 * x], line[2 * x.saturating_sub(1)]);
                path.step(&costs[x], jump, &mut totals[x]);
            }
            path = Path::NEW;
            for x in span.clone().rev() {
                let jump = jumps.between(line[2 * x], line[2 * (x + 1).min(columns - 1)]);
                path.step(&costs[x], jump, &mut totals[x]);
            }
        },
    );
    let groups: Vec<Vec<Levels>> = (0..columns.div_ceil(GROUP))
        .into_par_iter()
        .map(|group| {
            let group = group * GROUP..((group + 1) * GROUP).min(columns);
            let mut totals = vec![[0; LEVELS]; spans.len() * group.len()];
            let mut paths = vec![Path::NEW; group.len()];
            let mut step = |paths: &mut [Path], y: usize, from: usize| {
                let [line, before] = [line(y), line(from)];
                for (at, x) in group.clone().enumerate() {
                    if spans[y].contains(&x) {
                        let jump = jumps.between(line[2 * x], before[2 * x]);
                        let total = &mut totals[y * group.len() + at];
                        paths[at].step(&costs[y * columns + x], jump, total);
                    } else {
                        paths[at] = Path::NEW;
                    }
                }
            };
            (0..spans.len()).for_each(|y| step(&mut paths, y, y.saturating_sub(1)));
            paths.fill(Path::NEW);
            let last = spans.len() - 1;
            (0..spans.len()).rev().for_each(|y| step(&mut paths, y, (y + 1).min(last)));
            totals
        })
        .collect();
    let mut across = Vec::with_capacity(costs.len());
    for y in 0..spans.len() {
        for group in &groups {
            let width = group.len() / spans.len();
            across.extend_from_slice(&group[y * width..][..width]);
        }
    }
    [along, across]
}

/// The cost of a jump by the difference of two colours, summed over the channels.
struct Jumps([i16; 766]);

impl Jumps {
    fn new() -> Self {
        Self(std::array::from_fn(|sum| ((f32::from(JUMP) / (1.0 + sum as f32 / EDGE)) as i16).max(SLOPE)))
    }

    fn between(&self, a: [u8; 4], b: [u8; 4]) -> i16 {
        let difference: u16 = (0..3).map(|channel| u16::from(a[channel].abs_diff(b[channel]))).sum();
        self.0[usize::from(difference)]
    }
}
