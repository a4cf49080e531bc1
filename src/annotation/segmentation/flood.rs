//! Flood fill: the candidates that are connected to seeds by faces.
//!
//! Rows of bits are the unit: a row takes in the bits of its four neighbours, and each new bit
//! spreads through its run of candidates by the carry of an addition. Slabs of slices are flooded
//! side by side, each until nothing changes in it; then neighbouring slabs exchange their
//! outermost slices, and slabs that gained bits go on. The result does not depend on their order:
//! it is the smallest set that holds the seeds and is closed.

use rayon::prelude::*;

use relief_volume::Mask;

/// Slices of a slab: small enough for a core's cache at 512² voxels, enough slabs for many cores.
const SLAB: usize = 8;

/// Sizes of a mask in words and rows.
#[derive(Clone, Copy)]
struct MaskSize {
    row_words: usize,
    rows: usize,
}

impl MaskSize {
    fn slice_words(self) -> usize {
        self.row_words * self.rows
    }
}

/// The result of a round of one slab.
struct SlabRound {
    slab: usize,
    taken: u64,
    /// Whether its first and its last slice have something new.
    ends: [bool; 2],
}

/// The part of `candidates` that is connected to its part of `seeds`. After every round, `goes_on`
/// gets the number of voxels; `None` when it returns false.
pub(super) fn flood(candidates: &Mask, seeds: &Mask, goes_on: &mut dyn FnMut(u64) -> bool) -> Option<Mask> {
    let [_, rows, slices] = candidates.grid().dims();
    let shape = MaskSize { row_words: candidates.row_words(), rows };
    let slab_words = SLAB * shape.slice_words();
    let slabs = slices.div_ceil(SLAB);
    let mut region = Mask::empty(candidates.grid().clone());
    // The seeds come in through the same door as what neighbours know, in the first round.
    let mut active: Vec<usize> = (0..slabs)
        .filter(|slab| {
            seeds.words().chunks(slab_words).nth(*slab).is_some_and(|part| part.iter().any(|w| *w != 0))
        })
        .collect();
    let (mut taken, mut is_first) = (0, true);
    while !active.is_empty() {
        let known = region.words();
        let news: Vec<Option<[Vec<u64>; 2]>> = (0..slabs)
            .map(|slab| active.binary_search(&slab).ok().map(|_| ends_beside(known, slab, slab_words, shape)))
            .collect();
        let parts =
            region.words_mut().par_chunks_mut(slab_words).zip(candidates.words().par_chunks(slab_words));
        let parts = parts.zip(seeds.words().par_chunks(slab_words)).zip(news).enumerate();
        let outcomes: Vec<SlabRound> = parts
            .filter_map(|(slab, (((region, candidates), seeds), news))| {
                let mut part = Slab::new(shape, region, candidates);
                part.learn(news?, is_first.then_some(seeds));
                Some(part.settle(slab))
            })
            .collect();
        is_first = false;
        taken += outcomes.iter().map(|outcome| outcome.taken).sum::<u64>();
        active = outcomes
            .iter()
            .flat_map(|SlabRound { slab, ends, .. }| {
                let before = slab.checked_sub(1).filter(|_| ends[0]);
                before.into_iter().chain((ends[1] && slab + 1 < slabs).then_some(slab + 1))
            })
            .collect();
        active.sort_unstable();
        active.dedup();
        if !goes_on(taken) {
            return None;
        }
    }
    Some(region)
}

/// Copies of the slices just before and after a slab; empty at the ends of the grid.
fn ends_beside(words: &[u64], slab: usize, slab_words: usize, shape: MaskSize) -> [Vec<u64>; 2] {
    let slice = shape.slice_words();
    let (start, end) = (slab * slab_words, (slab + 1) * slab_words);
    let before = start.checked_sub(slice).map(|from| words[from..start].to_vec());
    let after = words.get(end..end + slice).map(<[u64]>::to_vec);
    [before.unwrap_or_default(), after.unwrap_or_default()]
}

struct Slab<'a> {
    shape: MaskSize,
    region: &'a mut [u64],
    candidates: &'a [u64],
    /// Rows with a neighbour that changed, one bit each.
    waiting: Vec<u64>,
    scratch: Vec<u64>,
    taken: u64,
    ends: [bool; 2],
}

impl<'a> Slab<'a> {
    fn new(shape: MaskSize, region: &'a mut [u64], candidates: &'a [u64]) -> Self {
        let rows = region.len() / shape.row_words;
        let waiting = vec![0; rows.div_ceil(64)];
        Self {
            shape,
            region,
            candidates,
            waiting,
            scratch: vec![0; shape.row_words],
            taken: 0,
            ends: [false; 2],
        }
    }

    fn row_count(&self) -> usize {
        self.region.len() / self.shape.row_words
    }

    /// Takes in the bits of neighbouring slabs next to it, and seeds.
    fn learn(&mut self, [before, after]: [Vec<u64>; 2], seeds: Option<&[u64]>) {
        let (count, words, rows) = (self.row_count(), self.shape.row_words, self.shape.rows);
        let tell = |slab: &mut Self, first: usize, source: &[u64]| {
            for (n, row) in
                source.chunks(words).enumerate().filter(|(_, row)| row.iter().any(|word| *word != 0))
            {
                slab.scratch.copy_from_slice(row);
                slab.take(first + n);
            }
        };
        tell(self, 0, &before);
        tell(self, count - rows, &after);
        tell(self, 0, seeds.unwrap_or_default());
    }

    /// Until nothing changes: rows that wait, from the first to the last and back.
    fn settle(mut self, slab: usize) -> SlabRound {
        while self.waiting.iter().any(|word| *word != 0) {
            for block in 0..self.waiting.len() {
                while self.waiting[block] != 0 {
                    self.visit(block * 64 + self.waiting[block].trailing_zeros() as usize);
                }
            }
            for block in (0..self.waiting.len()).rev() {
                while self.waiting[block] != 0 {
                    self.visit(block * 64 + 63 - self.waiting[block].leading_zeros() as usize);
                }
            }
        }
        SlabRound { slab, taken: self.taken, ends: self.ends }
    }

    /// A row that waits asks its neighbours.
    fn visit(&mut self, row: usize) {
        self.waiting[row / 64] &= !(1 << (row % 64));
        self.scratch.fill(0);
        for neighbour in self.neighbours(row).into_iter().flatten() {
            let start = neighbour * self.shape.row_words;
            let words = &self.region[start..start + self.shape.row_words];
            self.scratch.iter_mut().zip(words).for_each(|(scratch, word)| *scratch |= word);
        }
        self.take(row);
    }

    fn neighbours(&self, row: usize) -> [Option<usize>; 4] {
        let (rows, count) = (self.shape.rows, self.row_count());
        let j = row % rows;
        [
            (j > 0).then(|| row - 1),
            (j + 1 < rows).then(|| row + 1),
            row.checked_sub(rows),
            Some(row + rows).filter(|&next| next < count),
        ]
    }

    /// Spreads the bits of `scratch` through the row's candidates; if that adds any, its neighbours
    /// are queued.
    fn take(&mut self, row: usize) {
        let words = self.shape.row_words;
        let range = row * words..(row + 1) * words;
        let (candidates, region) = (&self.candidates[range.clone()], &mut self.region[range]);
        let mut is_new = 0;
        for ((scratch, candidate), known) in self.scratch.iter_mut().zip(candidates).zip(&*region) {
            *scratch &= candidate & !known;
            is_new |= *scratch;
        }
        if is_new == 0 {
            return;
        }
        spread(&mut self.scratch, candidates);
        for (known, new) in region.iter_mut().zip(&self.scratch) {
            self.taken += u64::from((new & !*known).count_ones());
            *known |= new;
        }
        self.ends[0] |= row < self.shape.rows;
        self.ends[1] |= row + self.shape.rows >= self.row_count();
        for neighbour in self.neighbours(row).into_iter().flatten() {
            self.waiting[neighbour / 64] |= 1 << (neighbour % 64);
        }
    }
}

/// Bits of `found` grow to the whole runs of candidates that they are in.
///
/// Adding a bit to a run of ones clears the run from there up and carries into the 0 above it; the
/// cleared bits are those that it reaches. Downwards the same, mirrored.
fn spread(found: &mut [u64], candidates: &[u64]) {
    let mut carry = false;
    for (found, &run) in found.iter_mut().zip(candidates) {
        let (sum, over) = run.overflowing_add(*found);
        let (sum, over_again) = sum.overflowing_add(u64::from(carry));
        carry = over | over_again;
        *found |= run & !sum;
    }
    let mut carry = false;
    for (found, &run) in found.iter_mut().zip(candidates).rev() {
        let (bits, run) = (found.reverse_bits(), run.reverse_bits());
        let (sum, over) = run.overflowing_add(bits);
        let (sum, over_again) = sum.overflowing_add(u64::from(carry));
        carry = over | over_again;
        *found |= (run & !sum).reverse_bits();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relief_volume::Grid;

    /// The same, voxel by voxel.
    fn plainly(candidates: &Mask, seeds: &Mask) -> Mask {
        let dims = candidates.grid().dims();
        let mut region = Mask::empty(candidates.grid().clone());
        let mut open: Vec<[usize; 3]> = (0..candidates.grid().voxel_count())
            .map(|n| [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]])
            .filter(|index| seeds.contains(*index) && candidates.contains(*index))
            .collect();
        open.iter().for_each(|index| region.set(*index, true));
        while let Some(index) = open.pop() {
            for (axis, up) in (0..3).flat_map(|axis| [(axis, true), (axis, false)]) {
                let mut next = index;
                let Some(moved) = next[axis].checked_add_signed(if up { 1 } else { -1 }) else { continue };
                next[axis] = moved;
                if candidates.contains(next) && !region.contains(next) {
                    region.set(next, true);
                    open.push(next);
                }
            }
        }
        region
    }

    #[test]
    fn noise_near_percolation_floods_as_voxel_by_voxel() {
        // At 0.3116 of voxels a cluster of face neighbours becomes endless: there it is most
        // winding.
        for (dims, share) in [([70, 30, 40], 32), ([129, 17, 9], 35), ([3, 50, 41], 50), ([64, 5, 1], 80)] {
            let grid = Grid::axis_aligned(dims, [1.0; 3], [0.0; 3]).unwrap();
            let (mut candidates, mut seeds) = (Mask::empty(grid.clone()), Mask::empty(grid));
            let mut state = 99u64;
            for n in 0..dims.iter().product() {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let index = [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]];
                candidates.set(index, (state >> 33) % 100 < share);
                seeds.set(index, n % 977 == 5);
            }
            let mut last = 0;
            let found = flood(&candidates, &seeds, &mut |voxels| {
                last = voxels;
                true
            })
            .unwrap();
            let expected = plainly(&candidates, &seeds);
            assert!(expected.voxels() > seeds.voxels() / 4, "{dims:?} has something to grow");
            assert_eq!(found, expected, "{dims:?}");
            assert_eq!(last, found.voxels());
            assert!(flood(&candidates, &seeds, &mut |_| false).is_none());
        }
    }
}
