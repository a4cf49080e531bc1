//! Balls of patient mm on grids of any axes: which voxels of a row lie in one, and masks made
//! thinner and thicker by one.
//!
//! In voxel indices a ball is an ellipsoid. Each of its rows is an interval, so a mask is made
//! thicker by an interval of every row of the ellipsoid: with words of 64 voxels and intervals by
//! doubling that is a handful of operations a word.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::DVec3;
use rayon::prelude::*;

use relief_base::{Patient, Point};
use relief_volume::{Grid, Mask};

/// The voxels of row (., j, k) whose centres are at most `radius_mm` from `center`.
pub(super) fn span(grid: &Grid, center: Point<Patient>, radius_mm: f64, [j, k]: [usize; 2]) -> Range<usize> {
    let affine = grid.patient_from_voxel().affine;
    let start = affine.transform_point3(DVec3::new(0.0, j as f64, k as f64)) - center.xyz;
    interval(affine.matrix3.x_axis, start, radius_mm).map_or(0..0, |[low, high]| {
        let nx = grid.dims()[0] as f64;
        // Saturates: negative numbers become 0.
        let [low, end] = [low.ceil().clamp(0.0, nx), (high.floor() + 1.0).clamp(0.0, nx)];
        low as usize..(end as usize).max(low as usize)
    })
}

/// The interval of t where `start + t * step` is at most `radius` long. Widened by a billionth
/// against rounding: voxels at exactly the radius are in.
fn interval(step: DVec3, start: DVec3, radius: f64) -> Option<[f64; 2]> {
    let square = step.length_squared();
    let middle = -step.dot(start) / square;
    let nearest = (start + step * middle).length_squared();
    let rest = (radius * radius * (1.0 + 1e-9) - nearest).max(-1.0);
    (rest >= 0.0).then(|| {
        let half = (rest / square).sqrt();
        [middle - half - 1e-9, middle + half + 1e-9]
    })
}

/// Sets the bits of a range.
pub(super) fn set_bits(words: &mut [u64], bits: Range<usize>) {
    if bits.is_empty() {
        return;
    }
    let (first, last) = (bits.start / 64, (bits.end - 1) / 64);
    let (low, high) = (u64::MAX << (bits.start % 64), u64::MAX >> (63 - (bits.end - 1) % 64));
    if first == last {
        words[first] |= low & high;
        return;
    }
    words[first] |= low;
    words[first + 1..last].fill(u64::MAX);
    words[last] |= high;
}

/// A ball in voxel indices: for each of its rows the offset and the interval of i.
pub(super) struct Ball {
    rows: Vec<([isize; 2], [isize; 2])>,
    reach: [usize; 2],
}

impl Ball {
    /// The offsets of voxels that are at most `radius_mm` apart.
    pub(super) fn new(grid: &Grid, radius_mm: f64) -> Self {
        let linear = grid.patient_from_voxel().linear();
        // A ball reaches as far along an index as the length of that index's gradient says.
        let inverse = linear.inverse().transpose();
        let reach = [inverse.y_axis, inverse.z_axis].map(|row| (row.length() * radius_mm + 1e-9) as usize);
        let [far_j, far_k] = reach.map(|n| n as isize);
        let mut rows = Vec::new();
        for dk in -far_k..=far_k {
            for dj in -far_j..=far_j {
                let start = linear * DVec3::new(0.0, dj as f64, dk as f64);
                let found = interval(linear.x_axis, start, radius_mm);
                let found = found.map(|[low, high]| [low.ceil() as isize, high.floor() as isize]);
                rows.extend(found.filter(|[low, high]| low <= high).map(|found| ([dj, dk], found)));
            }
        }
        Self { rows, reach }
    }

    /// Rows that it has: what making a row thinner or thicker costs.
    pub(super) fn rows(&self) -> usize {
        self.rows.len()
    }

    /// The voxels whose ball lies completely in the mask. Space outside of the grid counts as
    /// inside, because a structure that the scan cuts off is not thin. `is_wanted` is called once
    /// per slice; `None` when it returns false.
    pub(super) fn thinned(&self, mask: &Mask, is_wanted: &(dyn Fn() -> bool + Sync)) -> Option<Mask> {
        each_row(mask, is_wanted, |[j, k], out, scratch| {
            let [_, ny, nz] = mask.grid().dims();
            let Some(own) = mask.row(j, k).filter(|row| row.iter().any(|word| *word != 0)) else { return };
            out.copy_from_slice(own);
            for &([dj, dk], interval) in &self.rows {
                let (Some(j), Some(k)) = (moved(j, dj, ny), moved(k, dk, nz)) else { continue };
                let Some(row) = mask.row(j, k) else { continue };
                // Thinner where others are thicker.
                scratch.iter_mut().zip(row).enumerate().for_each(|(n, (s, w))| *s = !w & mask.valid(n));
                thicken(scratch, [-interval[1], -interval[0]]);
                out.iter_mut().zip(&*scratch).for_each(|(out, taken)| *out &= !taken);
                if out.iter().all(|word| *word == 0) {
                    return;
                }
            }
        })
    }

    /// The voxels that lie in the ball of a voxel of the mask. `is_wanted` as of [`Ball::thinned`].
    pub(super) fn thickened(&self, mask: &Mask, is_wanted: &(dyn Fn() -> bool + Sync)) -> Option<Mask> {
        let [_, ny, nz] = mask.grid().dims();
        let has: Vec<bool> =
            mask.words().par_chunks(mask.row_words()).map(|row| row.iter().any(|word| *word != 0)).collect();
        let used = |axis: usize| {
            let indices = (0..has.len()).filter(|at| has[*at]).map(|at| [at % ny, at / ny][axis]);
            let (low, high) = indices.fold((usize::MAX, 0), |(low, high), at| (low.min(at), high.max(at)));
            low.saturating_sub(self.reach[axis])..=high + self.reach[axis]
        };
        let (near_j, near_k) = (used(0), used(1));
        each_row(mask, is_wanted, |[j, k], out, scratch| {
            if !near_j.contains(&j) || !near_k.contains(&k) {
                return;
            }
            for &([dj, dk], interval) in &self.rows {
                let (Some(j), Some(k)) = (moved(j, -dj, ny), moved(k, -dk, nz)) else { continue };
                let Some(row) = mask.row(j, k).filter(|_| has[k * ny + j]) else { continue };
                scratch.copy_from_slice(row);
                thicken(scratch, interval);
                out.iter_mut().zip(&*scratch).for_each(|(out, word)| *out |= word);
            }
            out.iter_mut().enumerate().for_each(|(n, word)| *word &= mask.valid(n));
        })
    }
}

/// A mask made row by row, each from its place and a row to work in.
fn each_row(
    mask: &Mask,
    is_wanted: &(dyn Fn() -> bool + Sync),
    row: impl Fn([usize; 2], &mut [u64], &mut [u64]) + Sync,
) -> Option<Mask> {
    let mut made = Mask::empty(mask.grid().clone());
    let (words, ny) = (mask.row_words(), mask.grid().dims()[1]);
    let is_over = AtomicBool::new(false);
    made.words_mut().par_chunks_mut(words).enumerate().for_each_init(
        || vec![0u64; words],
        |scratch, (at, out)| {
            if at % ny == 0 && !is_wanted() {
                is_over.store(true, Ordering::Relaxed);
            }
            if !is_over.load(Ordering::Relaxed) {
                row([at % ny, at / ny], out, scratch);
            }
        },
    );
    (!is_over.into_inner()).then_some(made)
}

fn moved(index: usize, by: isize, n: usize) -> Option<usize> {
    index.checked_add_signed(by).filter(|&index| index < n)
}

/// Each bit becomes the bits from `low` to `high` around it.
fn thicken(words: &mut [u64], [low, high]: [isize; 2]) {
    if words.iter().all(|word| *word == 0) {
        return;
    }
    let (mut reached, wanted) = (1, high - low + 1);
    while reached < wanted {
        let by = reached.min(wanted - reached);
        spread(words, by as usize);
        reached += by;
    }
    if low < 0 {
        shift_down(words, low.unsigned_abs());
    } else {
        shift_up(words, low as usize);
    }
}

/// Each bit is also set `by` bits higher.
fn spread(words: &mut [u64], by: usize) {
    let (whole, bits) = (by / 64, by % 64);
    for n in (whole..words.len()).rev() {
        words[n] |= above(words, n, whole, bits);
    }
}

fn shift_up(words: &mut [u64], by: usize) {
    let (whole, bits) = (by / 64, by % 64);
    for n in (0..words.len()).rev() {
        words[n] = if n >= whole { above(words, n, whole, bits) } else { 0 };
    }
}

/// Word `n` after a shift up by the given numbers of words and bits.
fn above(words: &[u64], n: usize, whole: usize, bits: usize) -> u64 {
    let carried = if bits > 0 && n > whole { words[n - whole - 1] >> (64 - bits) } else { 0 };
    words[n - whole] << bits | carried
}

fn shift_down(words: &mut [u64], by: usize) {
    let (whole, bits) = (by / 64, by % 64);
    for n in 0..words.len() {
        let at = |n: usize| words.get(n).copied().unwrap_or(0);
        let carried = if bits > 0 { at(n + whole + 1) << (64 - bits) } else { 0 };
        words[n] = at(n + whole) >> bits | carried;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relief_base::Transform;

    /// Axes that are neither orthogonal to the patient's nor of equal length.
    fn oblique(dims: [usize; 3]) -> Grid {
        let turn = glam::DMat3::from_euler(glam::EulerRot::XYZ, 0.3, -0.5, 0.8);
        let axes = [turn.x_axis * 0.7, turn.y_axis * 1.1, turn.z_axis * 2.0];
        Grid::new(dims, Transform::from_axes(axes[0], axes[1], axes[2], DVec3::new(5.0, -3.0, 2.0))).unwrap()
    }

    fn noise(grid: &Grid, share: u64) -> Mask {
        let mut mask = Mask::empty(grid.clone());
        let [nx, ny, nz] = grid.dims();
        let mut state = 12345u64;
        for n in 0..nx * ny * nz {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            mask.set([n % nx, n / nx % ny, n / nx / ny], (state >> 33) % 100 < share);
        }
        mask
    }

    #[test]
    fn spans_and_balls_are_the_voxels_within_the_radius() {
        let grid = oblique([90, 20, 11]);
        let at = |index: [usize; 3]| {
            grid.patient_from_voxel().affine.transform_point3(DVec3::from(index.map(|i| i as f64)))
        };
        let center = Point::from_xyz(at([40, 9, 5]) + DVec3::new(0.21, 0.13, -0.4));
        for (j, k) in (0..20).flat_map(|j| (0..11).map(move |k| (j, k))) {
            let found = span(&grid, center, 7.3, [j, k]);
            for i in 0..90 {
                assert_eq!(found.contains(&i), at([i, j, k]).distance(center.xyz) <= 7.3, "{i} {j} {k}");
            }
        }
        assert!(Ball::new(&grid, 4.0).reach[0] >= 3);
    }

    #[test]
    fn thinning_and_thickening_ask_every_voxel_of_the_ball() {
        let grid = oblique([130, 14, 9]);
        let inside = |index: [isize; 3]| {
            index.iter().zip(grid.dims()).all(|(&index, n)| (0..n as isize).contains(&index))
        };
        for radius in [0.4, 0.75, 2.3] {
            let ball = Ball::new(&grid, radius);
            let offsets: Vec<[isize; 3]> = (-5isize..=5)
                .flat_map(|a| (-5isize..=5).flat_map(move |b| (-5isize..=5).map(move |c| [a, b, c])))
                .filter(|d| {
                    (grid.patient_from_voxel().linear() * DVec3::from(d.map(|d| d as f64))).length() <= radius
                })
                .collect();
            let [thick, thin] = [noise(&grid, 2), noise(&grid, 97)];
            let [thickened, thinned] =
                [ball.thickened(&thick, &|| true), ball.thinned(&thin, &|| true)].map(Option::unwrap);
            assert!(ball.thinned(&thin, &|| false).is_none());
            for n in 0..grid.voxel_count() {
                let index = [n % 130, n / 130 % 14, n / 130 / 14];
                let mut around = offsets
                    .iter()
                    .map(|d| std::array::from_fn(|axis| index[axis] as isize + d[axis]))
                    .filter(|index| inside(*index))
                    .map(|index| index.map(|i| i as usize));
                assert_eq!(thickened.contains(index), around.clone().any(|i| thick.contains(i)), "{index:?}");
                assert_eq!(thinned.contains(index), around.all(|i| thin.contains(i)), "{index:?}");
            }
        }
    }
}
