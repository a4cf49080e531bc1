//! Sets of cells of a few millimetres: distances, components and filled holes.
//!
//! Spaces: cell index, x fastest; distances in mm. Outside of the volume there is nothing: a set that
//! reaches its faces has no end there.

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

/// A component of a set.
#[derive(Clone, Debug)]
pub(crate) struct Component {
    pub(crate) cells: Vec<u32>,
    /// First and last cell along each axis.
    pub(crate) bounds: [[usize; 3]; 2],
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

    /// The cells of which at least one voxel in `of_voxels` has a value from `hu` on.
    pub(crate) fn at_least(&self, volume: &Volume, hu: i16, of_voxels: usize) -> Vec<bool> {
        let [nx, ny, _] = volume.grid().dims();
        let least = self.edges.iter().product::<usize>().div_ceil(of_voxels) as u32;
        let layer = |slab: &[i16]| {
            let mut counts = vec![0u32; self.layer_cells()];
            for (row, values) in slab.chunks_exact(nx).enumerate() {
                let cells = &mut counts[row % ny / self.edges[1] * self.dims[0]..][..self.dims[0]];
                for (count, run) in cells.iter_mut().zip(values.chunks(self.edges[0])) {
                    *count += run.iter().map(|&value| u32::from(value >= hu)).sum::<u32>();
                }
            }
            counts.into_iter().map(move |count| count >= least)
        };
        volume.voxels_hu().par_chunks(nx * ny * self.edges[2]).flat_map_iter(layer).collect()
    }

    /// Squared distance of each cell's middle to the nearest cell for which `is_in` holds, mm²,
    /// exact up to `most_mm` and infinite or larger beyond.
    pub(crate) fn squared_distances(&self, is_in: impl Fn(usize) -> bool + Sync, most_mm: f64) -> Vec<f32> {
        let [nx, ny, nz] = self.dims;
        let start = |cell: usize| if is_in(cell) { 0.0 } else { f32::INFINITY };
        let mut along_i = vec![f32::INFINITY; nx * ny * nz];
        along_i.par_chunks_exact_mut(nx).enumerate().for_each_init(
            || vec![0.0; nx],
            |values, (row, lowest)| {
                values.iter_mut().enumerate().for_each(|(i, value)| *value = start(row * nx + i));
                for by in 0..=((most_mm / self.spacing_mm[0]) as usize).min(nx - 1) {
                    lower(lowest, &values[by..], 0, by, self.spacing_mm[0]);
                    lower(&mut lowest[by..], values, 0, by, self.spacing_mm[0]);
                }
            },
        );
        let along_j: Vec<f32> = along_i
            .par_chunks(self.layer_cells())
            .flat_map_iter(|layer| {
                lowered(nx, ny, most_mm, self.spacing_mm[1], |row| &layer[row * nx..(row + 1) * nx])
            })
            .collect();
        let size = self.layer_cells();
        let layers = (0..nz).into_par_iter().flat_map_iter(|k| {
            let reach = (most_mm / self.spacing_mm[2]) as usize;
            let (first, end) = (k.saturating_sub(reach), (k + reach + 1).min(nz));
            let mut lowest = vec![f32::INFINITY; size];
            for other in first..end {
                lower(&mut lowest, &along_j[other * size..(other + 1) * size], k, other, self.spacing_mm[2]);
            }
            lowest
        });
        layers.collect()
    }

    /// The cells within `mm` of a set.
    pub(crate) fn within(&self, set: &[bool], mm: f64) -> Vec<bool> {
        let squared = (mm * mm) as f32;
        self.squared_distances(|cell| set[cell], mm).into_iter().map(|distance| distance <= squared).collect()
    }

    /// The components of a set; cells touch by a face, or also by edges and corners.
    pub(crate) fn components(&self, set: &[bool], by_corners: bool) -> Vec<Component> {
        let mut is_left = set.to_vec();
        let mut components = Vec::new();
        for start in 0..is_left.len() {
            if !std::mem::take(&mut is_left[start]) {
                continue;
            }
            let (mut cells, mut next) = (vec![start as u32], 0);
            let mut bounds = [self.place(start); 2];
            while let Some(&cell) = cells.get(next) {
                next += 1;
                let at = self.place(cell as usize);
                for axis in 0..3 {
                    bounds[0][axis] = bounds[0][axis].min(at[axis]);
                    bounds[1][axis] = bounds[1][axis].max(at[axis]);
                }
                self.for_each_beside(at, by_corners, |beside| {
                    if std::mem::take(&mut is_left[beside]) {
                        cells.push(beside as u32);
                    }
                });
            }
            components.push(Component { cells, bounds });
        }
        components
    }

    fn for_each_beside(&self, at: [usize; 3], by_corners: bool, mut visit: impl FnMut(usize)) {
        let [nx, ny, _] = self.dims;
        if !by_corners {
            let cell = at[0] + nx * (at[1] + ny * at[2]);
            for (axis, stride) in [1, nx, nx * ny].into_iter().enumerate() {
                if at[axis] > 0 {
                    visit(cell - stride);
                }
                if at[axis] + 1 < self.dims[axis] {
                    visit(cell + stride);
                }
            }
            return;
        }
        let range = |axis: usize| at[axis].saturating_sub(1)..(at[axis] + 2).min(self.dims[axis]);
        for k in range(2) {
            for j in range(1) {
                for i in range(0) {
                    visit(i + nx * (j + ny * k)); // itself too, which was visited
                }
            }
        }
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
        set.par_chunks(nx * ny).flat_map_iter(|layer| filled_layer(layer, [nx, ny], Edges::Rows)).collect()
    }
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
    let mut is_outside = vec![false; layer.len()];
    let mut open: Vec<usize> = Vec::new();
    let mut reach = |cell: usize, open: &mut Vec<usize>| {
        if !layer[cell] && !std::mem::replace(&mut is_outside[cell], true) {
            open.push(cell);
        }
    };
    (0..nx).flat_map(|i| [i, i + nx * (ny - 1)]).for_each(|cell| reach(cell, &mut open));
    let sides = if edges == Edges::All { 0..ny } else { 0..0 };
    sides.flat_map(|j| [nx * j, nx * j + nx - 1]).for_each(|cell| reach(cell, &mut open));
    while let Some(cell) = open.pop() {
        let (i, j) = (cell % nx, cell / nx);
        let beside = [
            (i > 0).then(|| cell - 1),
            (i + 1 < nx).then_some(cell + 1),
            (j > 0).then(|| cell - nx),
            (j + 1 < ny).then_some(cell + nx),
        ];
        beside.into_iter().flatten().for_each(|cell| reach(cell, &mut open));
    }
    is_outside.into_iter().map(|is_outside| !is_outside).collect()
}

/// Rows of squared distances after one more axis: each is the lowest of those near it, with the
/// squared distance between them added.
fn lowered<'a>(
    width: usize,
    count: usize,
    most_mm: f64,
    spacing_mm: f64,
    row: impl Fn(usize) -> &'a [f32],
) -> Vec<f32> {
    let reach = (most_mm / spacing_mm) as usize;
    let mut result = vec![f32::INFINITY; width * count];
    for (at, lowest) in result.chunks_exact_mut(width).enumerate() {
        for other in at.saturating_sub(reach)..(at + reach + 1).min(count) {
            lower(lowest, row(other), at, other, spacing_mm);
        }
    }
    result
}

fn lower(lowest: &mut [f32], values: &[f32], at: usize, other: usize, spacing_mm: f64) {
    let apart = (at.abs_diff(other) as f64 * spacing_mm).powi(2) as f32;
    lowest.iter_mut().zip(values).for_each(|(lowest, value)| *lowest = lowest.min(value + apart));
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: CellGrid = CellGrid { dims: [9, 7, 5], spacing_mm: [1.0, 2.0, 3.0], edges: [1; 3] };

    fn set(is_in: impl Fn([usize; 3]) -> bool) -> Vec<bool> {
        (0..9 * 7 * 5).map(|cell| is_in(GRID.place(cell))).collect()
    }

    #[test]
    fn distances_are_exact_up_to_their_limit() {
        let set = set(|at| at == [2, 3, 1] || at == [7, 0, 4]);
        let found = GRID.squared_distances(|cell| set[cell], 6.0);
        for (cell, found) in found.into_iter().enumerate() {
            let [i, j, k] = GRID.place(cell).map(|n| n as f64);
            let to =
                |[a, b, c]: [f64; 3]| (i - a).powi(2) + (2.0 * (j - b)).powi(2) + (3.0 * (k - c)).powi(2);
            let exact = to([2.0, 3.0, 1.0]).min(to([7.0, 0.0, 4.0]));
            assert!(if exact <= 36.0 { f64::from(found) == exact } else { found > 36.0 }, "{cell}: {found}");
        }
    }

    #[test]
    fn components_touch_by_faces_or_corners() {
        let diagonal = set(|at| at == [1, 1, 1] || at == [2, 2, 2] || at == [2, 2, 3]);
        assert_eq!(GRID.components(&diagonal, false).len(), 2);
        let [whole] = GRID.components(&diagonal, true).try_into().expect("one component");
        assert_eq!((whole.cells.len(), whole.bounds), (3, [[1, 1, 1], [2, 2, 3]]));
        assert_eq!(GRID.extent_mm(&whole), 9.0);
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
