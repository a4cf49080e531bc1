//! Refining a region: smoothing its surface, filling its holes, keeping its largest part.
//!
//! The work is done in the box around the region, a byte for each of its voxels. Distances are
//! counted in voxels, whatever their shape.

use rayon::prelude::*;

use relief_volume::{Grid, Mask};

/// A step of refining.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RefineStep {
    /// A voxel is in where most voxels of the cube of 27 around it are: steps, bridges and specks of a
    /// voxel go.
    Smooth,
    /// Voxels that the region encloses come in.
    FillHoles,
    /// Of parts that share no face of voxels, the largest stays; of equal ones the first.
    KeepLargest,
}

impl RefineStep {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Smooth, Self::FillHoles, Self::KeepLargest];

    /// The name in requests and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Smooth => "smooth",
            Self::FillHoles => "fill-holes",
            Self::KeepLargest => "keep-largest",
        }
    }

    /// The step of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|step| step.name() == name)
    }
}

/// The region after a step; it may be empty.
#[must_use]
pub fn refine_region(mask: &Mask, step: RefineStep) -> Mask {
    let Some(region) = Crop::of(mask) else { return mask.clone() };
    let refined = match step {
        RefineStep::Smooth => region.smoothed(),
        RefineStep::FillHoles => region.filled(),
        RefineStep::KeepLargest => region.largest_part(),
    };
    refined.in_grid(mask.grid())
}

/// Voxels of more than half of a cube of 27.
const MAJORITY: usize = 14;

/// The box around a region with a border of one voxel, which may reach beyond the grid and has no
/// voxel of the region.
struct Crop {
    /// Voxel of the grid at index 1 along each axis.
    first: [usize; 3],
    dims: [usize; 3],
    /// x fastest.
    is_in: Vec<bool>,
}

impl Crop {
    /// `None` of an empty mask.
    fn of(mask: &Mask) -> Option<Self> {
        let [_, ny, _] = mask.grid().dims();
        let (mut low, mut high) = ([usize::MAX; 3], [0; 3]);
        for (row, words) in mask.words().chunks_exact(mask.row_words()).enumerate() {
            let Some(start) = words.iter().position(|word| *word != 0) else { continue };
            let end = words.iter().rposition(|word| *word != 0).unwrap_or(start);
            let (j, k) = (row % ny, row / ny);
            let first = [64 * start + words[start].trailing_zeros() as usize, j, k];
            let last = [64 * end + 63 - words[end].leading_zeros() as usize, j, k];
            for axis in 0..3 {
                low[axis] = low[axis].min(first[axis]);
                high[axis] = high[axis].max(last[axis]);
            }
        }
        if low[0] == usize::MAX {
            return None;
        }
        let dims: [usize; 3] = std::array::from_fn(|axis| high[axis] - low[axis] + 3);
        let mut crop = Self { first: low, dims, is_in: vec![false; dims.iter().product()] };
        let [dx, dy, _] = dims;
        crop.is_in.par_chunks_mut(dx).enumerate().for_each(|(row, values)| {
            let [j, k] = [row % dy, row / dy];
            if j == 0 || k == 0 || j == dy - 1 || k == dims[2] - 1 {
                return;
            }
            for (i, value) in values.iter_mut().enumerate().take(dx - 1).skip(1) {
                *value = mask.contains([low[0] + i - 1, low[1] + j - 1, low[2] + k - 1]);
            }
        });
        Some(crop)
    }

    /// The voxels on their grid. No step puts the border in, so that all of them are on it.
    fn in_grid(&self, grid: &Grid) -> Mask {
        let mut mask = Mask::empty(grid.clone());
        for index in (0..self.is_in.len()).filter(|index| self.is_in[*index]) {
            let place = self.place(index);
            mask.set(std::array::from_fn(|axis| self.first[axis] + place[axis] - 1), true);
        }
        mask
    }

    fn place(&self, index: usize) -> [usize; 3] {
        let [dx, dy, _] = self.dims;
        [index % dx, index / dx % dy, index / (dx * dy)]
    }

    fn with(&self, is_in: Vec<bool>) -> Self {
        Self { first: self.first, dims: self.dims, is_in }
    }

    /// Indices of the voxels that share a face with one.
    fn neighbours(&self, index: usize) -> impl Iterator<Item = usize> {
        let (place, dims) = (self.place(index), self.dims);
        let steps = [1, dims[0], dims[0] * dims[1]];
        (0..3).flat_map(move |axis| {
            let before = (place[axis] > 0).then(|| index - steps[axis]);
            let after = (place[axis] + 1 < dims[axis]).then(|| index + steps[axis]);
            [before, after].into_iter().flatten()
        })
    }

    /// Marks the voxels that are connected to one by voxels for which `is_wanted` holds; returns their
    /// number.
    fn flood(&self, from: usize, marked: &mut [bool], is_wanted: impl Fn(usize) -> bool) -> usize {
        let (mut open, mut count) = (vec![from], 1);
        marked[from] = true;
        while let Some(index) = open.pop() {
            for next in self.neighbours(index) {
                if !marked[next] && is_wanted(next) {
                    marked[next] = true;
                    count += 1;
                    open.push(next);
                }
            }
        }
        count
    }

    fn largest_part(&self) -> Self {
        let mut seen = vec![false; self.is_in.len()];
        let mut largest = (0, 0);
        for index in 0..self.is_in.len() {
            if self.is_in[index] && !seen[index] {
                let count = self.flood(index, &mut seen, |next| self.is_in[next]);
                if count > largest.0 {
                    largest = (count, index);
                }
            }
        }
        let mut kept = vec![false; self.is_in.len()];
        self.flood(largest.1, &mut kept, |next| self.is_in[next]);
        self.with(kept)
    }

    fn filled(&self) -> Self {
        // The border has no voxel of the region: all that it does not reach is enclosed.
        let mut outside = vec![false; self.is_in.len()];
        self.flood(0, &mut outside, |next| !self.is_in[next]);
        self.with(outside.into_iter().map(|is_outside| !is_outside).collect())
    }

    fn smoothed(&self) -> Self {
        let [dx, dy, dz] = self.dims;
        let count = |index: usize| -> usize {
            let place = self.place(index);
            let span = |axis: usize| place[axis].saturating_sub(1)..(place[axis] + 2).min(self.dims[axis]);
            let row = |j: usize, k: usize| span(0).filter(|i| self.is_in[i + dx * (j + dy * k)]).count();
            span(2).map(|k| span(1).map(|j| row(j, k)).sum::<usize>()).sum()
        };
        let smooth = (0..dx * dy * dz).into_par_iter().map(|index| count(index) >= MAJORITY).collect();
        self.with(smooth)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(dims: [usize; 3], is_in: impl Fn([i32; 3]) -> bool) -> Mask {
        let mut mask = Mask::empty(Grid::axis_aligned(dims, [1.0; 3], [0.0; 3]).unwrap());
        for index in 0..dims.iter().product() {
            let place = [index % dims[0], index / dims[0] % dims[1], index / (dims[0] * dims[1])];
            mask.set(place, is_in(place.map(|at| at as i32)));
        }
        mask
    }

    fn squared([x, y, z]: [i32; 3], [a, b, c]: [i32; 3]) -> i32 {
        (x - a).pow(2) + (y - b).pow(2) + (z - c).pow(2)
    }

    #[test]
    fn holes_are_filled_and_dents_are_not() {
        // A hollow ball, and one that is open to the edge of the grid.
        let shell = |at| (36..=64).contains(&squared(at, [70, 10, 10]));
        let full = mask([84, 20, 20], |at| squared(at, [70, 10, 10]) <= 64);
        assert!(refine_region(&mask([84, 20, 20], shell), RefineStep::FillHoles) == full);
        let open = mask([84, 20, 20], |at| shell(at) && at[2] > 10);
        assert!(refine_region(&open, RefineStep::FillHoles) == open);
    }

    #[test]
    fn the_largest_part_stays() {
        let large = |at| squared(at, [6, 6, 6]) <= 25;
        let both = mask([140, 13, 13], |at| large(at) || squared(at, [120, 6, 6]) <= 16);
        assert!(refine_region(&both, RefineStep::KeepLargest) == mask([140, 13, 13], large));
        // Parts that touch at an edge alone share no face.
        let steps = mask([4, 4, 1], |[x, y, _]| (x < 2 && y < 2) || (x == 2 && y == 2));
        assert_eq!(refine_region(&steps, RefineStep::KeepLargest).voxels(), 4);
    }

    #[test]
    fn smoothing_takes_specks_and_bridges_and_keeps_planes() {
        // A half space to the edges of the grid keeps its face; a speck and a dent of one voxel go.
        let half = |[x, _, _]: [i32; 3]| x < 40;
        let inside = |mask: &Mask, [i, j, k]: [usize; 3]| mask.contains([i, j, k]);
        let rough = mask([80, 9, 9], |at| (half(at) && at != [39, 4, 4]) || at == [60, 4, 4]);
        let smooth = refine_region(&rough, RefineStep::Smooth);
        assert!(inside(&smooth, [39, 4, 4]) && !inside(&smooth, [60, 4, 4]));
        for j in 1..8 {
            assert!(inside(&smooth, [39, j, 4]) && !inside(&smooth, [40, j, 4]));
        }
        let bridge = mask([12, 9, 9], |at| at[0] < 4 || at[0] > 7 || (at[1], at[2]) == (4, 4));
        assert!(!inside(&refine_region(&bridge, RefineStep::Smooth), [6, 4, 4]));
    }

    #[test]
    fn an_empty_region_stays_empty() {
        let empty = mask([5, 5, 5], |_| false);
        for step in RefineStep::ALL {
            assert!(refine_region(&empty, step) == empty);
            assert_eq!(RefineStep::from_name(step.name()), Some(step));
        }
    }
}
