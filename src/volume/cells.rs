//! Sets of cells of a few millimetres: distances, components and filled holes.
//!
//! Spaces: cell index, x fastest; distances in mm. Outside of the volume there is nothing: a set that
//! reaches its faces has no end there.

use std::ops::Range;

use rayon::prelude::*;

use crate::Volume;

/// Cells along i, j, k.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CellGrid {
    /// Number of cells.
    pub(crate) dims: [usize; 3],
    /// Sides of a cell, mm.
    pub(crate) spacing_mm: [f64; 3],
    /// Voxels of a cell.
    pub(crate) edges: [usize; 3],
}

/// Cells of a row, one behind the other: the first, and the one behind the last.
type Run = [u32; 2];

/// The rule by which a cell counts: a share of its voxels has at least a value.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Level {
    /// The lowest value, HU.
    pub(crate) hu: i16,
    /// The share is one voxel in this number.
    pub(crate) of_voxels: usize,
}

/// A component of a set.
#[derive(Clone, Debug)]
pub(crate) struct Component {
    runs: Vec<Run>,
    /// First and last cell along each axis.
    pub(crate) bounds: [[usize; 3]; 2],
}

impl Component {
    /// The number of its cells.
    pub(crate) fn len(&self) -> usize {
        self.runs.iter().map(|[start, end]| (end - start) as usize).sum()
    }

    /// Whether one of its cells is in a set.
    pub(crate) fn meets(&self, set: &[bool]) -> bool {
        self.runs.iter().any(|&[start, end]| set[start as usize..end as usize].contains(&true))
    }

    /// Puts all its cells into a set.
    pub(crate) fn join(&self, set: &mut [bool]) {
        self.runs.iter().for_each(|&[start, end]| set[start as usize..end as usize].fill(true));
    }

    /// The runs of its cells, ascending: within one row each.
    pub(crate) fn runs(&self) -> impl Iterator<Item = Range<usize>> {
        self.runs_in(0..usize::MAX)
    }

    /// Those of its runs that begin with one of these cells.
    pub(crate) fn runs_in(&self, cells: Range<usize>) -> impl Iterator<Item = Range<usize>> {
        let [first, end] =
            [cells.start, cells.end].map(|cell| self.runs.partition_point(|run| (run[0] as usize) < cell));
        self.runs[first..end].iter().map(|&[start, end]| start as usize..end as usize)
    }
}

impl CellGrid {
    /// Cells of about `side_mm` of a volume.
    pub(crate) fn of(volume: &Volume, side_mm: f64) -> Self {
        let (voxels, spacing) = (volume.grid().dims(), volume.grid().spacing_mm());
        let edges: [usize; 3] = spacing.map(|mm| ((side_mm / mm).round() as usize).max(1));
        let dims = std::array::from_fn(|axis| voxels[axis].div_ceil(edges[axis]));
        let spacing_mm = std::array::from_fn(|axis| spacing[axis] * edges[axis] as f64);
        Self { dims, spacing_mm, edges }
    }

    pub(crate) fn layer_cells(&self) -> usize {
        self.dims[0] * self.dims[1]
    }

    /// Column, row and layer of a cell.
    pub(crate) fn place(&self, cell: usize) -> [usize; 3] {
        let [nx, ny, _] = self.dims;
        [cell % nx, cell / nx % ny, cell / (nx * ny)]
    }

    /// For each level the cells of which at least one voxel in `of_voxels` has a value from `hu` on.
    pub(crate) fn at_least<const N: usize>(&self, volume: &Volume, levels: [Level; N]) -> [Vec<bool>; N] {
        let [nx, ny, _] = volume.grid().dims();
        let least = levels.map(|level| self.edges.iter().product::<usize>().div_ceil(level.of_voxels) as u32);
        let slab_voxels = nx * ny * self.edges[2];
        // A bit for each level.
        let mut found = vec![0u8; self.dims.iter().product()];
        found.par_chunks_exact_mut(self.dims[0]).enumerate().for_each(|(row, cells)| {
            let (first, slab) = (row % self.dims[1] * self.edges[1], row / self.dims[1]);
            let slab = &volume.voxels_hu()[slab * slab_voxels..];
            let slab = &slab[..slab.len().min(slab_voxels)];
            // Counts of each column's voxels, so that whole rows are added. They saturate at 65535, which
            // takes voxels of 0.008 mm.
            let mut counts = [const { Vec::new() }; N];
            counts.iter_mut().for_each(|counts| counts.resize(nx, 0u16));
            for layer in slab.chunks_exact(nx * ny) {
                for values in layer.chunks_exact(nx).skip(first).take(self.edges[1]) {
                    for (counts, level) in counts.iter_mut().zip(levels) {
                        let counted = values.iter().map(|&value| u16::from(value >= level.hu));
                        counts
                            .iter_mut()
                            .zip(counted)
                            .for_each(|(count, one)| *count = count.saturating_add(one));
                    }
                }
            }
            for level in 0..N {
                let columns = counts[level].chunks(self.edges[0]);
                let counts = columns.map(|counts| counts.iter().map(|&count| u32::from(count)).sum::<u32>());
                for (bits, count) in cells.iter_mut().zip(counts) {
                    *bits |= u8::from(count >= least[level]) << level;
                }
            }
        });
        std::array::from_fn(|level| {
            found.par_iter().with_min_len(1 << 16).map(|bits| bits >> level & 1 == 1).collect()
        })
    }

    /// The cells within `mm` of a set, between middles of cells.
    pub(crate) fn within(&self, set: &[bool], mm: f64) -> Vec<bool> {
        self.grown(set, true, mm, |squared| squared <= (mm * mm) as f32)
    }

    /// The cells of a set that are farther than `mm` from all cells outside it.
    pub(crate) fn deeper_than(&self, set: &[bool], mm: f64) -> Vec<bool> {
        self.grown(set, false, mm, |squared| squared <= (mm * mm) as f32)
    }

    /// The cells of a set that are at least `mm` from all cells outside it.
    pub(crate) fn at_least_deep(&self, set: &[bool], mm: f64) -> Vec<bool> {
        self.grown(set, false, mm, |squared| squared < (mm * mm) as f32)
    }

    /// Grows the cells of a set (`grown` is true), or the cells outside it, and returns the set
    /// afterwards. Growth reaches the squared distances, mm², for which `is_near` holds, and at most
    /// `most_mm`. Rows are widened along i and joined along j and k, in words of 64 cells: fresh memory
    /// costs more than the arithmetic.
    fn grown(&self, set: &[bool], grown: bool, most_mm: f64, is_near: impl Fn(f32) -> bool) -> Vec<bool> {
        let [nx, ny, nz] = self.dims;
        let reach: [usize; 3] = self.spacing_mm.map(|side_mm| (most_mm / side_mm) as usize);
        let squared = |axis: usize, by: usize| (by as f64 * self.spacing_mm[axis]).powi(2) as f32;
        // How far rows at this distance along j and k reach along i.
        let width = |j: usize, k: usize| {
            (0..=reach[0]).rev().find(|&i| is_near(squared(0, i) + squared(1, j) + squared(2, k)))
        };
        let near = |j: usize| (0..=reach[2]).map(move |k| [j, k]);
        let rows = (0..=reach[1]).flat_map(near);
        let rows: Vec<_> = rows.filter_map(|[j, k]| width(j, k).map(|width| (width, [j, k]))).collect();
        let row_words = nx.div_ceil(64);
        let mut widened = vec![packed(set, nx, grown)];
        for by in 0..rows.iter().map(|(width, _)| *width).max().unwrap_or(0) {
            widened.push(wider(&widened[by], row_words));
        }
        let mut result = vec![!grown; set.len()];
        result.par_chunks_exact_mut(nx).enumerate().with_min_len(64).for_each_init(
            || vec![0u64; row_words],
            |words, (row, out)| {
                let (j, k) = (row % ny, row / ny);
                words.fill(0);
                for &(width, by) in &rows {
                    for j in beside(j, by[0], ny) {
                        for k in beside(k, by[1], nz) {
                            let from = &widened[width][(k * ny + j) * row_words..][..row_words];
                            words.iter_mut().zip(from).for_each(|(word, from)| *word |= from);
                        }
                    }
                }
                for (out, word) in out.chunks_mut(64).zip(words).filter(|(_, word)| **word != 0) {
                    out.iter_mut().enumerate().for_each(|(at, out)| *out = (*word >> at & 1 == 1) == grown);
                }
            },
        );
        result
    }

    /// The components of a set, by their first cells; cells touch by a face, or also by edges and
    /// corners.
    pub(crate) fn components(&self, set: &[bool], by_corners: bool) -> Vec<Component> {
        let rows: Vec<Vec<Run>> =
            set.par_chunks_exact(self.dims[0]).enumerate().map(|(row, cells)| runs(row, cells)).collect();
        let starts = starts(&rows);
        let mut parents: Vec<u32> = (0..starts[rows.len()] as u32).collect();
        for row in 0..rows.len() {
            for before in self.rows_before(row, by_corners).into_iter().flatten() {
                join_touching(
                    [&rows[before], &rows[row]],
                    [starts[before], starts[row]],
                    ((row - before) * self.dims[0]) as u32,
                    u32::from(by_corners),
                    &mut parents,
                );
            }
        }
        let mut number = vec![u32::MAX; parents.len()];
        let mut components: Vec<Component> = Vec::new();
        for (at, &run) in rows.iter().flatten().enumerate() {
            let root = root(&mut parents, at as u32) as usize;
            if number[root] == u32::MAX {
                number[root] = components.len() as u32;
                let first = self.place(run[0] as usize);
                components.push(Component { runs: Vec::new(), bounds: [first; 2] });
            }
            let Component { runs, bounds: [low, high] } = &mut components[number[root] as usize];
            runs.push(run);
            let (first, last) = (self.place(run[0] as usize), self.place(run[1] as usize - 1));
            for axis in 0..3 {
                low[axis] = low[axis].min(first[axis]);
                high[axis] = high[axis].max(last[axis]);
            }
        }
        components
    }

    /// The rows before one that it touches.
    fn rows_before(&self, row: usize, by_corners: bool) -> [Option<usize>; 4] {
        let ny = self.dims[1];
        let (j, k) = (row % ny, row / ny);
        let below = |is_there: bool, by: usize| (k > 0 && is_there).then(|| row - ny + 1 - by);
        [
            (j > 0).then(|| row - 1),
            below(true, 1),
            below(by_corners && j > 0, 2),
            below(by_corners && j + 1 < ny, 0),
        ]
    }

    /// The longest side of a component's bounding box, mm.
    pub(crate) fn extent_mm(&self, component: &Component) -> f64 {
        let [first, last] = component.bounds;
        let side = |axis: usize| (last[axis] + 1 - first[axis]) as f64 * self.spacing_mm[axis];
        side(0).max(side(1)).max(side(2))
    }

    /// A set with the holes of each layer filled: cells from which no way in the layer leads to its
    /// first or last row. A lung that is open at the side of a picture counts as a hole.
    pub(crate) fn filled(&self, set: &[bool]) -> Vec<bool> {
        let [nx, ny, _] = self.dims;
        let mut filled = vec![false; set.len()];
        let layers = filled.par_chunks_mut(nx * ny).zip(set.par_chunks(nx * ny));
        layers.for_each(|(out, layer)| out.copy_from_slice(&filled_layer(layer, [nx, ny], Edges::Rows)));
        filled
    }
}

fn inverse(set: &[bool]) -> Vec<bool> {
    set.par_iter().with_min_len(1 << 16).map(|is_in| !is_in).collect()
}

/// The cells of rows that are, or are not, in a set: a bit each. Rows begin with a word.
fn packed(set: &[bool], row_cells: usize, is_in: bool) -> Vec<u64> {
    let row_words = row_cells.div_ceil(64);
    let mut words = vec![0u64; set.len() / row_cells * row_words];
    words.par_chunks_exact_mut(row_words).zip(set.par_chunks_exact(row_cells)).with_min_len(64).for_each(
        |(words, cells)| {
            for (word, cells) in words.iter_mut().zip(cells.chunks(64)) {
                let bits = cells.iter().enumerate();
                *word = bits.fold(0, |word, (at, cell)| word | u64::from(*cell == is_in) << at);
            }
        },
    );
    words
}

/// Rows with the cells beside theirs, too.
fn wider(rows: &[u64], row_words: usize) -> Vec<u64> {
    let mut wide = vec![0u64; rows.len()];
    for (out, row) in wide.chunks_exact_mut(row_words).zip(rows.chunks_exact(row_words)) {
        for (at, word) in row.iter().enumerate() {
            out[at] |= word | word << 1 | word >> 1;
            if at > 0 {
                out[at - 1] |= word << 63;
            }
            if at + 1 < row_words {
                out[at + 1] |= word >> 63;
            }
        }
    }
    wide
}

/// The places at a distance from one, before and behind it.
fn beside(at: usize, by: usize, count: usize) -> impl Iterator<Item = usize> {
    let behind = (by > 0).then_some(at + by);
    [at.checked_sub(by), behind].into_iter().flatten().filter(move |at| *at < count)
}

/// The runs of a row.
fn runs(row: usize, cells: &[bool]) -> Vec<Run> {
    let (mut runs, mut at) = (Vec::new(), 0);
    let first = row * cells.len();
    while let Some(start) = cells[at..].iter().position(|is_in| *is_in).map(|more| at + more) {
        let end = cells[start..].iter().position(|is_in| !is_in).map_or(cells.len(), |more| start + more);
        runs.push([(first + start) as u32, (first + end) as u32]);
        at = end;
    }
    runs
}

/// The number of each row's first run, and the number of runs.
fn starts(rows: &[Vec<Run>]) -> Vec<usize> {
    let ends = rows.iter().scan(0, |sum, runs| {
        *sum += runs.len();
        Some(*sum)
    });
    std::iter::once(0).chain(ends).collect()
}

/// Joins the runs of two rows that touch, `apart` cells between the rows' starts; runs touch that
/// overlap, or that are at most `slack` cells beside each other.
fn join_touching(
    [before, behind]: [&[Run]; 2],
    starts: [usize; 2],
    apart: u32,
    slack: u32,
    parents: &mut [u32],
) {
    let (mut a, mut b) = (0, 0);
    while let (Some(&[low, end]), Some(&[other, other_end])) = (before.get(a), behind.get(b)) {
        let (low, end) = (low + apart, end + apart);
        if low < other_end + slack && other < end + slack {
            let [x, y] = [starts[0] + a, starts[1] + b].map(|at| root(parents, at as u32));
            // The first run of all becomes the root.
            parents[x.max(y) as usize] = x.min(y);
        }
        if end < other_end { a += 1 } else { b += 1 }
    }
}

/// The root of a run; the ways to it become shorter.
fn root(parents: &mut [u32], mut at: u32) -> u32 {
    while parents[at as usize] != at {
        let above = parents[parents[at as usize] as usize];
        parents[at as usize] = above;
        at = above;
    }
    at
}

/// From where the outside of a set begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Edges {
    /// The first and the last row.
    Rows,
    /// All four edges.
    All,
}

/// One layer with its holes filled.
pub(crate) fn filled_layer(layer: &[bool], [nx, ny]: [usize; 2], edges: Edges) -> Vec<bool> {
    let is_empty = inverse(layer);
    let rows: Vec<Vec<Run>> =
        is_empty.chunks_exact(nx).enumerate().map(|(row, cells)| runs(row, cells)).collect();
    let starts = starts(&rows);
    let mut parents: Vec<u32> = (0..starts[ny] as u32).collect();
    for row in 1..ny {
        let (rows, starts) = ([&rows[row - 1][..], &rows[row]], [starts[row - 1], starts[row]]);
        join_touching(rows, starts, nx as u32, 0, &mut parents);
    }
    let mut is_outside = vec![false; parents.len()];
    let mut filled = vec![true; layer.len()];
    let all = || rows.iter().enumerate().flat_map(|(row, runs)| runs.iter().map(move |run| (row, *run)));
    for (at, (row, run)) in all().enumerate() {
        let [first, last] = [run[0], run[1] - 1].map(|cell| cell as usize - row * nx);
        let is_at_side = edges == Edges::All && (first == 0 || last == nx - 1);
        if row == 0 || row == ny - 1 || is_at_side {
            is_outside[root(&mut parents, at as u32) as usize] = true;
        }
    }
    for (at, (_, [first, end])) in all().enumerate() {
        if is_outside[root(&mut parents, at as u32) as usize] {
            filled[first as usize..end as usize].fill(false);
        }
    }
    filled
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: CellGrid = CellGrid { dims: [9, 7, 5], spacing_mm: [1.0, 2.0, 3.0], edges: [1; 3] };

    fn set(is_in: impl FnMut([usize; 3]) -> bool) -> Vec<bool> {
        (0..9 * 7 * 5).map(|cell| GRID.place(cell)).map(is_in).collect()
    }

    #[test]
    fn sets_grow_and_shrink_by_exact_distances() {
        let seeds = [[2.0, 3.0, 1.0], [7.0, 0.0, 4.0], [64.0, 2.0, 2.0], [100.0, 5.0, 0.0]];
        // Rows of one word and of three.
        for grid in [GRID, CellGrid { dims: [130, 7, 5], ..GRID }] {
            let cells = 0..grid.dims.iter().product();
            let is_near = |cell: usize| seeds.contains(&grid.place(cell).map(|n| n as f64));
            let near: Vec<bool> = cells.clone().map(is_near).collect();
            let rest: Vec<bool> = near.iter().map(|is_in| !is_in).collect();
            for mm in [0.0, 1.0, 2.0, 2.5, 3.0, 6.0, 7.1] {
                let grown = grid.within(&near, mm);
                let (deeper, at_least) = (grid.deeper_than(&rest, mm), grid.at_least_deep(&rest, mm));
                for cell in cells.clone() {
                    let [i, j, k] = grid.place(cell).map(|n| n as f64);
                    let to = |[a, b, c]: [f64; 3]| {
                        (i - a).powi(2) + (2.0 * (j - b)).powi(2) + (3.0 * (k - c)).powi(2)
                    };
                    let inside = seeds.iter().filter(|seed| seed[0] < grid.dims[0] as f64);
                    let squared = inside.map(|seed| to(*seed)).fold(f64::INFINITY, f64::min);
                    assert_eq!(grown[cell], squared <= mm * mm, "{mm} mm, {squared}");
                    assert_eq!(deeper[cell], squared > mm * mm, "{mm} mm, {squared}");
                    assert_eq!(at_least[cell], squared >= mm * mm, "{mm} mm, {squared}");
                }
            }
        }
    }

    #[test]
    fn components_touch_by_faces_or_corners() {
        let diagonal = set(|at| at == [1, 1, 1] || at == [2, 2, 2] || at == [2, 2, 3]);
        assert_eq!(GRID.components(&diagonal, false).len(), 2);
        let [whole] = GRID.components(&diagonal, true).try_into().expect("one component");
        assert_eq!((whole.len(), whole.bounds), (3, [[1, 1, 1], [2, 2, 3]]));
        assert_eq!(GRID.extent_mm(&whole), 9.0);
    }

    /// The cells of a set that are reached from one, ascending; takes them out of the set.
    fn flooded(left: &mut [bool], start: usize, by_corners: bool) -> Vec<usize> {
        let (mut cells, mut next) = (vec![start], 0);
        left[start] = false;
        while let Some(&cell) = cells.get(next) {
            next += 1;
            let apart = |other: usize| -> [usize; 3] {
                std::array::from_fn(|axis| GRID.place(cell)[axis].abs_diff(GRID.place(other)[axis]))
            };
            for (other, is_left) in left.iter_mut().enumerate().filter(|(_, is_left)| **is_left) {
                let [i, j, k] = apart(other);
                if i.max(j).max(k) <= 1 && (by_corners || i + j + k <= 1) {
                    *is_left = false;
                    cells.push(other);
                }
            }
        }
        cells.sort_unstable();
        cells
    }

    #[test]
    fn components_are_those_of_a_flood() {
        let mut state = 1u64;
        for turn in 0..80 {
            let random = set(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                state >> 33 & 3 == 0
            });
            let by_corners = turn % 2 == 0;
            let mut left = random.clone();
            for component in GRID.components(&random, by_corners) {
                let start = left.iter().position(|is_left| *is_left).unwrap();
                let flood = flooded(&mut left, start, by_corners);
                assert_eq!(component.runs().flatten().collect::<Vec<_>>(), flood, "{turn}");
                assert_eq!(component.len(), flood.len());
            }
            assert!(!left.contains(&true));
        }
    }

    #[test]
    fn holes_are_filled_in_each_layer() {
        let is_ring = |[i, j, _]: [usize; 3]| {
            (2..=6).contains(&i) && (1..=5).contains(&j) && !((3..=5).contains(&i) && (2..=4).contains(&j))
        };
        let is_open = |at: [usize; 3]| is_ring(at) && !(at[2] == 3 && at == [6, 3, 3]);
        let filled = GRID.filled(&set(is_open));
        assert_eq!(
            filled,
            set(|at| is_open(at) || (at[2] != 3 && (3..=5).contains(&at[0]) && (2..=4).contains(&at[1])))
        );
    }
}
