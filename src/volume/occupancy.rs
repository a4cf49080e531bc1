//! The values in coarse cells of a volume: they bound the visible part under any transfer function
//! in a few milliseconds, also when the voxels are out of memory.
//!
//! Spaces: voxel index and patient mm. A cell is a box of voxels of about 1/96 of the volume's
//! longest side; a band is a range of 64 HU.

use std::sync::Arc;

use parking_lot::Mutex;
use rayon::prelude::*;

use super::cells::{CellGrid, Component};
use super::{Framing, Grid, Volume};
use relief_base::{Patient, Point, Voxel};

/// Cells along the longest side of a volume.
const CELLS: f64 = 96.0;
/// HU of a band; the first and the last one take in all values beyond.
const BAND_HU: i16 = 64;
/// Lowest value of the first band.
const LOWEST_HU: i16 = -1024;
/// Bands, one for each bit of a word.
const BANDS: usize = 64;
/// Most framings that are kept.
const KEPT: usize = 4;

/// The bands of values that occur in each cell of a volume.
pub struct Occupancy {
    cells: CellGrid,
    /// A bit for each band, x fastest.
    bands: Vec<u64>,
    /// The latest framings; the last one was used last.
    framings: Mutex<Vec<KeptFraming>>,
}

/// The framing of the cells with a visible value.
struct KeptFraming {
    /// A bit for each visible band.
    visible: u64,
    /// See [`Cells::without_specks`].
    speck: f64,
    framing: Option<Arc<Framing>>,
}

/// Cells are left out: there are hundreds of thousands.
impl std::fmt::Debug for Occupancy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Occupancy").field("cells", &self.cells).finish_non_exhaustive()
    }
}

/// Some cells of an occupancy.
#[derive(Clone, Debug)]
pub struct Cells<'a> {
    occupancy: &'a Occupancy,
    is_in: Vec<bool>,
}

impl Occupancy {
    /// The occupancy of a volume.
    #[must_use]
    pub fn new(volume: &Volume) -> Self {
        let (voxels, spacing) = (volume.grid().dims(), volume.grid().spacing_mm());
        let longest = (0..3).map(|axis| voxels[axis] as f64 * spacing[axis]).fold(0.0, f64::max);
        let cells = CellGrid::of(volume, longest / CELLS);
        let plane = voxels[0] * voxels[1];
        let slabs = volume.voxels_hu().par_chunks(plane * cells.edges[2]);
        let bands = slabs.flat_map_iter(|slab| layer(slab, voxels, &cells)).collect();
        Self { cells, bands, framings: Mutex::default() }
    }

    /// Bytes in memory.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        size_of_val(self.bands.as_slice()) as u64
    }

    /// The cells with a value in a band for which `is_visible(low_hu, high_hu)` holds. The first and
    /// the last band reach to the lowest and the highest HU.
    #[must_use]
    pub fn cells(&self, is_visible: impl Fn(i16, i16) -> bool) -> Cells<'_> {
        self.cells_of(visible_bands(is_visible))
    }

    fn cells_of(&self, visible: u64) -> Cells<'_> {
        Cells { occupancy: self, is_in: self.bands.iter().map(|bands| bands & visible != 0).collect() }
    }

    /// The framing of [`Occupancy::cells`] without specks, see [`Cells::without_specks`], on the grid of
    /// the volume; `None` where nothing is visible. The latest framings are kept: a server needs one
    /// for every picture whose request has no camera.
    #[must_use]
    pub fn framing(
        &self,
        grid: &Grid,
        speck: f64,
        is_visible: impl Fn(i16, i16) -> bool,
    ) -> Option<Arc<Framing>> {
        let visible = visible_bands(is_visible);
        // The value is whole between statements, so a panic elsewhere leaves it usable.
        let lock = || self.framings.lock();
        let mut kept = lock();
        if let Some(at) = kept.iter().position(|known| known.visible == visible && known.speck == speck) {
            kept[at..].rotate_left(1);
            return kept.last().and_then(|known| known.framing.clone());
        }
        drop(kept);
        let points = self.cells_of(visible).without_specks(speck).points(grid);
        let framing = Framing::of_points(&points).map(Arc::new);
        let mut kept = lock();
        if kept.len() >= KEPT {
            kept.remove(0);
        }
        kept.push(KeptFraming { visible, speck, framing: framing.clone() });
        framing
    }
}

/// A bit for each band for which `is_visible(low_hu, high_hu)` holds.
fn visible_bands(is_visible: impl Fn(i16, i16) -> bool) -> u64 {
    let visible = (0..BANDS).filter(|&band| {
        let low = LOWEST_HU + band as i16 * BAND_HU;
        let ends = [if band == 0 { i16::MIN } else { low }, low + (BAND_HU - 1)];
        is_visible(ends[0], if band == BANDS - 1 { i16::MAX } else { ends[1] })
    });
    visible.fold(0, |bits, band| bits | 1 << band)
}

/// The bands of one layer of cells: of the columns of each row of cells first, and then of the cells.
fn layer(slab: &[i16], [nx, ny, _]: [usize; 3], &CellGrid { edges, dims, .. }: &CellGrid) -> Vec<u64> {
    let mut bands = Vec::with_capacity(dims[0] * dims[1]);
    let mut columns = vec![0u64; nx];
    for first in (0..ny).step_by(edges[1]) {
        columns.fill(0);
        let rows = first * nx..(first + edges[1]).min(ny) * nx;
        for row in slab.chunks_exact(nx * ny).flat_map(|plane| plane[rows.clone()].chunks_exact(nx)) {
            for (column, &hu) in columns.iter_mut().zip(row) {
                *column |= 1 << band_of(hu);
            }
        }
        bands.extend(columns.chunks(edges[0]).map(|columns| columns.iter().fold(0, |all, bits| all | bits)));
    }
    bands
}

/// The number of a value's band.
fn band_of(hu: i16) -> u32 {
    let above = hu.saturating_sub(LOWEST_HU).max(0) as u32;
    (above / BAND_HU as u32).min(BANDS as u32 - 1)
}

impl Cells<'_> {
    /// Without cells for which `is_kept` does not hold; it is given the voxels of a cell: the first
    /// and the one behind the last along each axis.
    #[must_use]
    pub fn kept(mut self, grid: &Grid, is_kept: impl Fn([[usize; 3]; 2]) -> bool) -> Self {
        let occupancy = self.occupancy;
        for (index, is_in) in self.is_in.iter_mut().enumerate() {
            *is_in = *is_in && is_kept(occupancy.voxels_of(index, grid.dims()));
        }
        self
    }

    /// Without groups of touching cells that are smaller than this share of the largest group: noise,
    /// and marks on the skin.
    #[must_use]
    pub fn without_specks(mut self, share: f64) -> Self {
        let groups = self.occupancy.cells.components(&self.is_in, false);
        let largest = groups.iter().map(Component::len).max().unwrap_or(0);
        let least = share * largest as f64;
        for group in groups.iter().filter(|group| (group.len() as f64) < least) {
            group.runs().for_each(|run| self.is_in[run].fill(false));
        }
        self
    }

    /// The middles of the cells, on the grid of their volume.
    #[must_use]
    pub fn points(&self, grid: &Grid) -> Vec<Point<Patient>> {
        let (patient_from_voxel, dims) = (grid.patient_from_voxel(), grid.dims());
        let cells = self.is_in.iter().enumerate().filter(|(_, is_in)| **is_in);
        let points = cells.map(|(index, _)| {
            let [first, end] = self.occupancy.voxels_of(index, dims);
            let middle = |axis: usize| (first[axis] + end[axis]) as f64 / 2.0 - 0.5;
            patient_from_voxel * Point::<Voxel>::new(middle(0), middle(1), middle(2))
        });
        points.collect()
    }
}

impl Occupancy {
    /// The first voxel of a cell and the one behind its last, along each axis.
    fn voxels_of(&self, index: usize, voxels: [usize; 3]) -> [[usize; 3]; 2] {
        let (at, edges) = (self.cells.place(index), self.cells.edges);
        let first: [usize; 3] = std::array::from_fn(|axis| at[axis] * edges[axis]);
        [first, std::array::from_fn(|axis| (first[axis] + edges[axis]).min(voxels[axis]))]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Air with a box of bone in it and a lone voxel of metal.
    fn volume() -> Volume {
        let dims = [200, 100, 60];
        let grid = Grid::axis_aligned(dims, [1.0, 1.0, 2.0], [10.0, 20.0, 30.0]).unwrap();
        let mut voxels = vec![-1000i16; grid.voxel_count()];
        for (index, hu) in voxels.iter_mut().enumerate() {
            let at = [index % 200, index / 200 % 100, index / 20_000];
            if (20..60).contains(&at[0]) && (40..80).contains(&at[1]) && (10..50).contains(&at[2]) {
                *hu = 900;
            }
        }
        voxels[190 + 200 * (5 + 100 * 2)] = 3000;
        Volume::new(grid, voxels).unwrap()
    }

    /// Smallest and largest coordinates along an axis.
    fn extent(points: &[Point<Patient>], axis: usize) -> [f64; 2] {
        let along = points.iter().map(|point| point.xyz[axis]);
        [along.clone().fold(f64::INFINITY, f64::min), along.fold(f64::NEG_INFINITY, f64::max)]
    }

    #[test]
    fn cells_lie_where_the_values_are() {
        let volume = volume();
        let occupancy = Occupancy::new(&volume);
        assert_eq!(occupancy.cells.edges, [2, 2, 1]);
        let cells = occupancy.cells(|_, high| high >= 300);
        let points = cells.points(volume.grid());
        assert_eq!(points.len(), 20 * 20 * 40 + 1);
        let bone = cells.without_specks(0.01).points(volume.grid());
        assert_eq!(bone.len(), 20 * 20 * 40);
        // Voxels 20 to 59 along i: the first cell's middle is at 20.5, the last one's at 58.5.
        assert_eq!(extent(&bone, 0), [30.5, 68.5]);
        assert_eq!(extent(&bone, 1), [60.5, 98.5]);
        assert_eq!(extent(&bone, 2), [50.0, 128.0]);
    }

    #[test]
    fn framings_are_kept_by_their_visible_bands_and_specks() {
        let volume = volume();
        let occupancy = Occupancy::new(&volume);
        let computed = |speck: f64, least: i16| {
            let cells = occupancy.cells(|_, high| high >= least).without_specks(speck);
            Framing::of_points(&cells.points(volume.grid()))
        };
        // More than are kept, twice: without air, bone and metal, metal alone, nothing.
        for _ in 0..2 {
            for (speck, least) in
                [0.0, 0.01].into_iter().flat_map(|s| [-900, 300, 2000, 3100].map(|l| (s, l)))
            {
                let kept = || occupancy.framing(volume.grid(), speck, |_, high| high >= least);
                assert_eq!(kept().as_deref(), computed(speck, least).as_ref(), "{speck}, {least}");
                assert_eq!(kept(), kept());
            }
            assert_eq!(occupancy.framings.lock().len(), KEPT);
        }
    }

    #[test]
    fn the_outer_bands_have_no_end() {
        for hu in [i16::MIN, -1024, -1, 0, 63, 64, 3071, 3072, i16::MAX] {
            let grid = Grid::axis_aligned([1, 1, 1], [1.0; 3], [0.0; 3]).unwrap();
            let occupancy = Occupancy::new(&Volume::new(grid, vec![hu]).unwrap());
            let is_in = |low, high| (low..=high).contains(&hu);
            assert_eq!(occupancy.cells(is_in).is_in, [true], "{hu}");
            assert_eq!(occupancy.cells(|low, high| !is_in(low, high)).is_in, [false], "{hu}");
        }
    }

    #[test]
    fn cells_that_are_cut_are_left_out() {
        let volume = volume();
        let occupancy = Occupancy::new(&volume);
        let cells = occupancy.cells(|_, high| high >= 300);
        let front = cells.kept(volume.grid(), |[_, end]| end[1] <= 60).points(volume.grid());
        assert_eq!(extent(&front, 1)[1], 78.5);
    }
}
