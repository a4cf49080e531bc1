//! The segments in each brick. Together with a brick's range of values they decide whether the
//! brick can be visible.

use std::collections::HashMap;

use rayon::prelude::*;

use super::{LabelMap, SegmentIndices};

/// For every brick of a label map the places of the segments that occur in it, 0 for voxels without
/// one.
///
/// Bricks are those of [`BrickRanges`](crate::BrickRanges): `edge`³ cells between voxel centres
/// with the voxels on their far faces, so whatever voxel is nearest to a position in the brick, or
/// around it, is among them.
#[derive(Clone, Debug)]
pub struct BrickLabels {
    sets: Vec<Vec<u16>>,
    of_brick: Vec<u32>,
}

/// The sets of one layer of bricks, each named once.
#[derive(Default)]
struct Layer {
    sets: Vec<Vec<u16>>,
    number: HashMap<Vec<u16>, u32>,
    of_brick: Vec<u32>,
}

impl Layer {
    /// The number of a set, a new one for a new set.
    fn number_of(&mut self, set: Vec<u16>) -> u32 {
        let next = self.sets.len() as u32;
        *self.number.entry(set).or_insert_with_key(|set| {
            self.sets.push(set.clone());
            next
        })
    }
}

impl BrickLabels {
    /// The sets of bricks of `edge` voxels.
    ///
    /// # Panics
    /// When `edge` is 0.
    #[must_use]
    pub fn new(map: &LabelMap, edge: usize) -> Self {
        assert!(edge > 0, "a brick has at least one voxel");
        let layers = map.grid().dims()[2].div_ceil(edge);
        let layers: Vec<Layer> = match map.places() {
            SegmentIndices::Bytes(places) => {
                (0..layers).into_par_iter().map(|c| layer(map, places, edge, c)).collect()
            }
            SegmentIndices::Words(places) => {
                (0..layers).into_par_iter().map(|c| layer(map, places, edge, c)).collect()
            }
        };
        let mut whole = Layer::default();
        for Layer { sets, of_brick, .. } in layers {
            let numbers: Vec<u32> = sets.into_iter().map(|set| whole.number_of(set)).collect();
            whole.of_brick.extend(of_brick.into_iter().map(|number| numbers[number as usize]));
        }
        Self { sets: whole.sets, of_brick: whole.of_brick }
    }

    /// The different sets, each ascending.
    #[must_use]
    pub fn sets(&self) -> &[Vec<u16>] {
        &self.sets
    }

    /// The set of each brick, x fastest.
    #[must_use]
    pub fn of_brick(&self) -> &[u32] {
        &self.of_brick
    }
}

fn layer<T: Copy + PartialEq + Into<u16>>(map: &LabelMap, places: &[T], edge: usize, c: usize) -> Layer {
    let [nx, ny, nz] = map.grid().dims();
    let mut layer = Layer::default();
    let reach = |brick: usize, n: usize| brick * edge..((brick + 1) * edge + 1).min(n);
    for (b, a) in (0..ny.div_ceil(edge)).flat_map(|b| (0..nx.div_ceil(edge)).map(move |a| (b, a))) {
        let (mut set, mut last) = (Vec::new(), None);
        for row in reach(c, nz).flat_map(|k| reach(b, ny).map(move |j| (k * ny + j) * nx)) {
            for &place in &places[row..][reach(a, nx)] {
                if last != Some(place) {
                    last = Some(place);
                    if !set.contains(&place.into()) {
                        set.push(place.into());
                    }
                }
            }
        }
        set.sort_unstable();
        let number = layer.number_of(set);
        layer.of_brick.push(number);
    }
    layer
}

#[cfg(test)]
mod tests {
    use super::super::super::Grid;
    use super::*;

    #[test]
    fn a_brick_has_what_occurs_in_it_and_on_its_far_faces() {
        let (dims, edge) = ([11, 9, 10], 4);
        let label = |at: usize| {
            [0, 7, 7, 3, 0, 0, 0, 0, 0, 9][(at * 7919 / 13) % 10] * u16::from(at.is_multiple_of(5))
        };
        let labels: Vec<u16> = (0..dims.iter().product()).map(label).collect();
        let grid = Grid::axis_aligned(dims, [1.0; 3], [0.0; 3]).unwrap();
        let map = LabelMap::new(grid, &labels, vec![]).unwrap();
        let bricks = BrickLabels::new(&map, edge);
        assert_eq!(bricks.of_brick().len(), 3 * 3 * 3);
        for (n, &set) in bricks.of_brick().iter().enumerate() {
            let low = [n % 3, n / 3 % 3, n / 9].map(|brick| brick * edge);
            let mut expected = std::collections::BTreeSet::new();
            for k in low[2]..(low[2] + edge + 1).min(dims[2]) {
                for j in low[1]..(low[1] + edge + 1).min(dims[1]) {
                    for i in low[0]..(low[0] + edge + 1).min(dims[0]) {
                        expected.insert(map.places().at((k * dims[1] + j) * dims[0] + i) as u16);
                    }
                }
            }
            assert_eq!(bricks.sets()[set as usize], expected.into_iter().collect::<Vec<_>>(), "brick {n}");
        }
        assert!(bricks.sets().len() < 27, "equal sets are one");
    }
}
