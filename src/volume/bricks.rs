//! Min-max bricks and the distance map over them: what lets a ray step over empty space.
//!
//! A brick covers `edge`³ cells between voxel centres, so its range takes in the voxels on its far
//! faces too: every value that trilinear interpolation can give inside the brick lies within it.

use rayon::prelude::*;

use super::Volume;

/// Smallest and largest HU of every brick of a volume, x fastest.
#[derive(Clone, Debug)]
pub struct BrickRanges {
    edge: usize,
    dims: [usize; 3],
    ranges_hu: Vec<(i16, i16)>,
}

/// For every brick the Chebyshev distance, in bricks, to the nearest one that shows something; 0
/// where one does.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DistanceMap {
    /// Edge of a brick in voxels.
    pub edge: usize,
    /// Bricks along i, j, k.
    pub dims: [usize; 3],
    /// x fastest; distances above 255 are 255.
    pub distances: Vec<u8>,
}

impl DistanceMap {
    /// The first and the last brick along each axis that shows something; `None` where none does.
    #[must_use]
    pub fn visible_bounds(&self) -> Option<[[usize; 3]; 2]> {
        let mut bounds: Option<[[usize; 3]; 2]> = None;
        let [nx, ny, _] = self.dims;
        for (row, distances) in self.distances.chunks_exact(nx).enumerate() {
            let Some(first) = distances.iter().position(|&distance| distance == 0) else { continue };
            let last = distances.iter().rposition(|&distance| distance == 0).unwrap_or(first);
            let (j, k) = (row % ny, row / ny);
            let [low, high] = bounds.unwrap_or([[first, j, k], [last, j, k]]);
            bounds =
                Some([[low[0].min(first), low[1].min(j), low[2]], [high[0].max(last), high[1].max(j), k]]);
        }
        bounds
    }
}

impl BrickRanges {
    /// The ranges of bricks of `edge` voxels.
    ///
    /// # Panics
    /// When `edge` is 0.
    #[must_use]
    pub fn new(volume: &Volume, edge: usize) -> Self {
        assert!(edge > 0, "a brick has at least one voxel");
        let dims = volume.grid().dims().map(|n| n.div_ceil(edge));
        let ranges_hu =
            (0..dims[2]).into_par_iter().flat_map_iter(|c| layer(volume, edge, dims, c)).collect();
        Self { edge, dims, ranges_hu }
    }

    /// Smallest and largest HU of each brick, x fastest.
    #[must_use]
    pub fn ranges_hu(&self) -> &[(i16, i16)] {
        &self.ranges_hu
    }

    /// The distance map of the bricks for which `is_visible(low, high)` holds.
    #[must_use]
    pub fn distance_map(&self, is_visible: impl Fn(i16, i16) -> bool + Sync) -> DistanceMap {
        self.distance_map_by(|_, low, high| is_visible(low, high))
    }

    /// As [`BrickRanges::distance_map`], of the bricks for which `is_visible(brick, low, high)`
    /// holds; bricks are numbered x fastest.
    #[must_use]
    pub fn distance_map_by(&self, is_visible: impl Fn(usize, i16, i16) -> bool + Sync) -> DistanceMap {
        let start = |(brick, &(low, high)): (usize, &(i16, i16))| {
            if is_visible(brick, low, high) { 0 } else { u8::MAX }
        };
        let bricks = self.ranges_hu.par_iter().enumerate().with_min_len(1 << 12);
        let mut distances: Vec<u8> = bricks.map(start).collect();
        sweep(&mut distances, self.dims);
        // The map is symmetric, so the backward sweep is the forward one on the reversed array.
        distances.reverse();
        sweep(&mut distances, self.dims);
        distances.reverse();
        DistanceMap { edge: self.edge, dims: self.dims, distances }
    }
}

/// The ranges of one layer of bricks. The rows that meet a row of bricks are joined first, whole, and
/// then cut into bricks.
fn layer(volume: &Volume, edge: usize, dims: [usize; 3], c: usize) -> Vec<(i16, i16)> {
    let [nx, ny, nz] = volume.grid().dims();
    let voxels = |brick: usize, n: usize| brick * edge..((brick + 1) * edge + 1).min(n);
    let mut ranges = Vec::with_capacity(dims[0] * dims[1]);
    let (mut low, mut high) = (vec![i16::MAX; nx], vec![i16::MIN; nx]);
    for b in 0..dims[1] {
        low.fill(i16::MAX);
        high.fill(i16::MIN);
        for (k, j) in voxels(c, nz).flat_map(|k| voxels(b, ny).map(move |j| (k, j))) {
            let row = &volume.voxels_hu()[(k * ny + j) * nx..][..nx];
            for ((low, high), &hu) in low.iter_mut().zip(&mut high).zip(row) {
                (*low, *high) = ((*low).min(hu), (*high).max(hu));
            }
        }
        ranges.extend((0..dims[0]).map(|a| {
            let along = voxels(a, nx);
            let lowest = low[along.clone()].iter().fold(i16::MAX, |least, &hu| least.min(hu));
            (lowest, high[along].iter().fold(i16::MIN, |most, &hu| most.max(hu)))
        }));
    }
    ranges
}

/// One forward sweep of a chamfer transform over all 26 neighbours at distance 1: exact for
/// Chebyshev distance once both directions have been swept.
fn sweep(distances: &mut [u8], [nx, ny, nz]: [usize; 3]) {
    for k in 0..nz {
        for j in 0..ny {
            let (rows, row) = distances.split_at_mut((k * ny + j) * nx);
            let row = &mut row[..nx];
            // Rows already final for this sweep: three of the layer before, one of this layer.
            let before = [
                (k > 0 && j > 0).then(|| ((k - 1) * ny + j - 1) * nx),
                (k > 0).then(|| ((k - 1) * ny + j) * nx),
                (k > 0 && j + 1 < ny).then(|| ((k - 1) * ny + j + 1) * nx),
                (j > 0).then(|| (k * ny + j - 1) * nx),
            ];
            for start in before.into_iter().flatten() {
                take_nearer(row, &rows[start..start + nx]);
            }
            for i in 1..nx {
                row[i] = row[i].min(row[i - 1].saturating_add(1));
            }
        }
    }
}

/// Lowers each distance to one more than the nearest of the three neighbours in another row.
fn take_nearer(row: &mut [u8], other: &[u8]) {
    let farther = |other: &u8| other.saturating_add(1);
    row.iter_mut().zip(other).for_each(|(own, other)| *own = (*own).min(farther(other)));
    row.iter_mut().zip(&other[1..]).for_each(|(own, other)| *own = (*own).min(farther(other)));
    row[1..].iter_mut().zip(other).for_each(|(own, other)| *own = (*own).min(farther(other)));
}

#[cfg(test)]
mod tests {
    use super::super::Grid;
    use super::*;

    /// Deterministic noise: most voxels are empty.
    fn sparse_volume(dims: [usize; 3]) -> Volume {
        let grid = Grid::axis_aligned(dims, [1.0; 3], [0.0; 3]).unwrap();
        let mut state = 12345u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            if state >> 24 == 7 { (state >> 16) as i16 } else { -1000 }
        };
        Volume::new(grid, (0..dims.iter().product()).map(|_| next()).collect()).unwrap()
    }

    #[test]
    fn a_brick_covers_every_value_that_interpolation_inside_it_can_give() {
        let volume = sparse_volume([11, 9, 10]);
        let bricks = BrickRanges::new(&volume, 4);
        assert_eq!(bricks.dims, [3, 3, 3]);
        for (c, b, a) in (0..3).flat_map(|c| (0..3).flat_map(move |b| (0..3).map(move |a| (c, b, a)))) {
            let mut expected = (i16::MAX, i16::MIN);
            for k in c * 4..(c * 4 + 5).min(10) {
                for j in b * 4..(b * 4 + 5).min(9) {
                    for i in a * 4..(a * 4 + 5).min(11) {
                        let hu = volume.hu([i, j, k]);
                        expected = (expected.0.min(hu), expected.1.max(hu));
                    }
                }
            }
            assert_eq!(bricks.ranges_hu[(c * 3 + b) * 3 + a], expected, "brick {a}, {b}, {c}");
        }
    }

    #[test]
    fn distances_equal_an_exhaustive_search() {
        let bricks = BrickRanges::new(&sparse_volume([37, 23, 29]), 2);
        let map = bricks.distance_map(|_, high| high > 0);
        let [nx, ny, nz] = map.dims;
        let cells: Vec<[i32; 3]> = (0..nz as i32)
            .flat_map(|k| (0..ny as i32).flat_map(move |j| (0..nx as i32).map(move |i| [i, j, k])))
            .collect();
        let occupied: Vec<&[i32; 3]> =
            cells.iter().zip(&bricks.ranges_hu).filter(|(_, range)| range.1 > 0).map(|(c, _)| c).collect();
        assert!(occupied.len() > 3, "the search needs something to find");
        for (cell, &distance) in cells.iter().zip(&map.distances) {
            let chebyshev = |o: &&[i32; 3]| (0..3).map(|x| (o[x] - cell[x]).abs()).max();
            let nearest = occupied.iter().copied().filter_map(|o| chebyshev(&o)).min();
            assert_eq!(Some(i32::from(distance)), nearest, "{cell:?}");
        }
    }

    #[test]
    fn bounds_hold_all_that_is_visible_and_no_more() {
        let map =
            |distances: [u8; 24]| DistanceMap { edge: 4, dims: [4, 3, 2], distances: distances.to_vec() };
        let mut distances = [9; 24];
        assert_eq!(map(distances).visible_bounds(), None);
        distances[12 + 4 + 2] = 0; // (2, 1, 1)
        assert_eq!(map(distances).visible_bounds(), Some([[2, 1, 1], [2, 1, 1]]));
        distances[8 + 1] = 0; // (1, 2, 0)
        distances[12 + 3] = 0; // (3, 0, 1)
        assert_eq!(map(distances).visible_bounds(), Some([[1, 0, 0], [3, 2, 1]]));
    }

    #[test]
    fn nothing_visible_is_as_far_as_the_map_can_say() {
        let map = BrickRanges::new(&sparse_volume([8, 8, 8]), 4).distance_map(|_, _| false);
        assert!(map.distances.iter().all(|&distance| distance == u8::MAX));
    }
}
