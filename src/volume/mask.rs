//! Masks: one bit for each voxel of a grid, in rows of whole words, so that 64 voxels are worked on
//! at once.

use rayon::prelude::*;

use super::{Grid, LabelMap, Segment, Volume};

/// Voxels of a grid that are in, and all others. Each row along i begins with a new word; the bits
/// beyond its end are 0.
#[derive(Clone, PartialEq)]
pub struct Mask {
    grid: Grid,
    row_words: usize,
    words: Vec<u64>,
}

/// Voxels are left out: there are millions.
impl std::fmt::Debug for Mask {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let voxels = self.voxels();
        f.debug_struct("Mask").field("grid", &self.grid).field("voxels", &voxels).finish_non_exhaustive()
    }
}

impl Mask {
    /// No voxel of a grid.
    #[must_use]
    pub fn empty(grid: Grid) -> Self {
        let [nx, ny, nz] = grid.dims();
        let row_words = nx.div_ceil(64);
        Self { grid, row_words, words: vec![0; row_words * ny * nz] }
    }

    /// The voxels of a volume with values from `low` to `high` HU, these included.
    #[must_use]
    pub fn of_range(volume: &Volume, [low, high]: [i16; 2]) -> Self {
        let mut mask = Self::empty(volume.grid().clone());
        let nx = mask.grid.dims()[0];
        let rows = mask.words.par_chunks_mut(mask.row_words).zip(volume.voxels_hu().par_chunks(nx));
        rows.for_each(|(words, values)| pack(words, values, |hu| (low <= hu) & (hu <= high)));
        mask
    }

    /// The voxels of a map that belong to the segment with this label: none where there is no such
    /// segment.
    #[must_use]
    pub fn of_label(map: &LabelMap, label: u16) -> Self {
        let mut mask = Self::empty(map.grid().clone());
        let Some(at) = map.segments().iter().position(|segment| segment.label == label) else { return mask };
        let nx = mask.grid.dims()[0];
        let rows = mask.words.par_chunks_mut(mask.row_words);
        match map.places() {
            super::SegmentIndices::Bytes(places) => {
                rows.zip(places.par_chunks(nx))
                    .for_each(|(words, row)| pack(words, row, |place| usize::from(place) == at + 1));
            }
            super::SegmentIndices::Words(places) => {
                rows.zip(places.par_chunks(nx))
                    .for_each(|(words, row)| pack(words, row, |place| usize::from(place) == at + 1));
            }
        }
        mask
    }

    /// The map of one segment, whose voxels these are. A segment's label 0 becomes 1: 0 is for
    /// voxels of none.
    #[must_use]
    pub fn to_labels(&self, segment: Segment) -> LabelMap {
        let [nx, ..] = self.grid.dims();
        let mut places = vec![0u8; self.grid.voxel_count()];
        places.par_chunks_mut(nx).zip(self.words.par_chunks(self.row_words)).for_each(|(out, words)| {
            for (part, &word) in out.chunks_mut(64).zip(words).filter(|(_, word)| **word != 0) {
                part.iter_mut().enumerate().for_each(|(bit, place)| *place = (word >> bit & 1) as u8);
            }
        });
        let segment = Segment { label: segment.label.max(1), ..segment };
        LabelMap::of_one(self.grid.clone(), places, segment, self.voxels())
    }

    /// The grid of the voxels.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Words of a row.
    #[must_use]
    pub fn row_words(&self) -> usize {
        self.row_words
    }

    /// All rows, j rising fastest, then k. Bit i % 64 of word i / 64 of a row is voxel i.
    #[must_use]
    pub fn words(&self) -> &[u64] {
        &self.words
    }

    /// As [`Mask::words`], to be changed. Bits beyond a row's end must stay 0.
    #[must_use]
    pub fn words_mut(&mut self) -> &mut [u64] {
        &mut self.words
    }

    /// The row through voxels (0, j, k); `None` outside of the grid.
    #[must_use]
    pub fn row(&self, j: usize, k: usize) -> Option<&[u64]> {
        let [_, ny, nz] = self.grid.dims();
        (j < ny && k < nz).then(|| {
            let start = (k * ny + j) * self.row_words;
            &self.words[start..start + self.row_words]
        })
    }

    /// Whether a voxel is in; those outside of the grid are not.
    #[must_use]
    pub fn contains(&self, [i, j, k]: [usize; 3]) -> bool {
        i < self.grid.dims()[0] && self.row(j, k).is_some_and(|row| row[i / 64] >> (i % 64) & 1 == 1)
    }

    /// Takes a voxel in or out.
    ///
    /// # Panics
    /// When it is outside of the grid.
    pub fn set(&mut self, [i, j, k]: [usize; 3], is_in: bool) {
        let [nx, ny, nz] = self.grid.dims();
        assert!(i < nx && j < ny && k < nz, "voxel {i} {j} {k} is outside of {:?}", self.grid.dims());
        let word = &mut self.words[(k * ny + j) * self.row_words + i / 64];
        *word = *word & !(1 << (i % 64)) | u64::from(is_in) << (i % 64);
    }

    /// The number of voxels inside.
    #[must_use]
    pub fn voxels(&self) -> u64 {
        self.words.par_iter().with_min_len(1 << 14).map(|word| u64::from(word.count_ones())).sum()
    }

    /// Their volume.
    #[must_use]
    pub fn volume_ml(&self) -> f64 {
        self.voxels() as f64 * self.voxel_ml()
    }

    /// Volume of one voxel, ml.
    #[must_use]
    pub fn voxel_ml(&self) -> f64 {
        self.grid.patient_from_voxel().linear().determinant().abs() / 1000.0
    }

    /// A word with ones for the voxels that a row's word `index` has.
    #[must_use]
    pub fn valid(&self, index: usize) -> u64 {
        let left = self.grid.dims()[0].saturating_sub(index * 64);
        if left >= 64 { u64::MAX } else { (1 << left) - 1 }
    }

    /// Takes in all voxels of another mask of the same grid.
    ///
    /// # Panics
    /// When the dimensions differ.
    pub fn join(&mut self, other: &Self) {
        assert_eq!(self.grid.dims(), other.grid.dims(), "masks of different grids");
        self.words.par_iter_mut().zip(&other.words).for_each(|(own, other)| *own |= other);
    }
}

/// The bits of a row: that of a voxel is 1 where its value is in.
fn pack<T: Copy>(words: &mut [u64], values: &[T], is_in: impl Fn(T) -> bool) {
    // Moves the lowest bits of eight bytes into one byte: the product has bit i of them at 56 + i.
    const GATHER: u64 = 0x0102_0408_1020_4080;
    for (word, part) in words.iter_mut().zip(values.chunks(64)) {
        let mut bytes = [0u8; 64];
        bytes.iter_mut().zip(part).for_each(|(byte, &value)| *byte = u8::from(is_in(value)));
        *word = bytes
            .as_chunks::<8>()
            .0
            .iter()
            .rev()
            .fold(0, |word, &eight| word << 8 | u64::from_le_bytes(eight).wrapping_mul(GATHER) >> 56);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_the_voxels_in_range_whatever_the_rows_length() {
        for nx in [1, 7, 63, 64, 65, 130] {
            let grid = Grid::axis_aligned([nx, 3, 2], [1.0, 2.0, 0.5], [0.0; 3]).unwrap();
            let values: Vec<i16> = (0..nx * 6).map(|n| ((n * 7919) % 1000) as i16 - 500).collect();
            let volume = Volume::new(grid, values).unwrap();
            let mask = Mask::of_range(&volume, [-100, 200]);
            for (n, hu) in volume.voxels_hu().iter().enumerate() {
                let index = [n % nx, n / nx % 3, n / nx / 3];
                assert_eq!(mask.contains(index), (-100..=200).contains(hu), "{index:?} of {nx}");
            }
            let count = volume.voxels_hu().iter().filter(|hu| (-100..=200).contains(*hu)).count();
            assert_eq!(mask.voxels(), count as u64);
            assert!((mask.volume_ml() - count as f64 / 1000.0).abs() < 1e-12);
            assert!(mask.words().iter().enumerate().all(|(n, w)| w & !mask.valid(n % mask.row_words()) == 0));
        }
    }

    #[test]
    fn masks_become_label_maps_and_come_back() {
        let grid = Grid::axis_aligned([70, 5, 4], [1.0; 3], [0.0; 3]).unwrap();
        let mut mask = Mask::empty(grid.clone());
        for n in (0..1400).step_by(3) {
            mask.set([n % 70, n / 70 % 5, n / 350], true);
        }
        mask.set([0; 3], false);
        let map = mask.to_labels(Segment::new(7, Some("aorta"), None));
        assert_eq!(map.counted().map(|(s, n)| (s.label, n)).collect::<Vec<_>>(), [(7, mask.voxels())]);
        assert_eq!(Mask::of_label(&map, 7), mask);
        assert_eq!(Mask::of_label(&map, 8).voxels(), 0);
        let labels: Vec<u16> = (0..1400).map(|n| 7 * u16::from(n % 3 == 0 && n > 0)).collect();
        let same = LabelMap::new(grid, &labels, vec![Segment::new(7, Some("aorta"), None)]).unwrap();
        assert_eq!(map, same);
    }
}
