//! Segments that overlap, in layers: label maps of one grid, in each of which no two segments have
//! a voxel in common.

use super::{LabelMap, Segment};
use crate::Grid;

/// Lays segments one after another, each into the first layer where all its voxels are free.
pub struct Layers {
    grid: Grid,
    most_bytes: u64,
    layers: Vec<Layer>,
}

struct Layer {
    labels: Vec<u16>,
    segments: Vec<Segment>,
}

/// More layers than there may be.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "segments overlap so much that they need {layers} layers of {voxels} voxels, two bytes each; allowed are \
     {most} of them and {most_bytes} bytes together: take fewer segments at a time"
)]
pub struct LayersError {
    layers: usize,
    voxels: usize,
    most: usize,
    most_bytes: u64,
}

impl Layers {
    /// Maximum number of layers, also when files are read. Each segment is compared with all layers
    /// before its own.
    pub const MOST: usize = 64;

    /// Starts without layers on a grid. All layers together may use the given number of bytes, two
    /// for each voxel.
    #[must_use]
    pub fn new(grid: Grid, most_bytes: u64) -> Self {
        Self { grid, most_bytes, layers: Vec::new() }
    }

    /// Adds a segment with a new label at these voxel indices, and returns the number of distinct
    /// voxels. An index may occur more than once; an index beyond the grid is ignored. A segment
    /// without voxels is described in the first layer.
    ///
    /// # Errors
    /// When there is no room for another layer.
    pub fn add(
        &mut self,
        segment: Segment,
        voxels: impl Iterator<Item = usize> + Clone,
    ) -> Result<u64, LayersError> {
        let count = self.grid.voxel_count();
        let voxels = voxels.filter(|at| *at < count);
        let is_free = |layer: &Layer| voxels.clone().all(|at| layer.labels[at] == 0);
        let found = self.layers.iter().position(is_free);
        let at = found.map_or_else(|| self.another(), Ok)?;
        let layer = &mut self.layers[at];
        let mut laid = 0;
        for voxel in voxels {
            laid += u64::from(layer.labels[voxel] == 0);
            layer.labels[voxel] = segment.label;
        }
        layer.segments.push(segment);
        Ok(laid)
    }

    /// The layers as maps; none where no segment was laid.
    ///
    /// # Panics
    /// Never: layers have the size of the grid.
    #[must_use]
    pub fn into_maps(self) -> Vec<LabelMap> {
        let Self { grid, layers, .. } = self;
        let map = |Layer { labels, segments }| {
            LabelMap::new(grid.clone(), &labels, segments).expect("a label was made for each voxel")
        };
        layers.into_iter().map(map).collect()
    }

    /// An empty layer, and its place.
    fn another(&mut self) -> Result<usize, LayersError> {
        let (voxels, layers) = (self.grid.voxel_count(), self.layers.len() + 1);
        let refused = LayersError { layers, voxels, most: Self::MOST, most_bytes: self.most_bytes };
        let bytes = (voxels as u64).saturating_mul(2).saturating_mul(layers as u64);
        let mut labels = Vec::new();
        if layers > Self::MOST || bytes > self.most_bytes || labels.try_reserve_exact(voxels).is_err() {
            return Err(refused);
        }
        labels.resize(voxels, 0);
        self.layers.push(Layer { labels, segments: Vec::new() });
        Ok(layers - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(label: u16) -> Segment {
        Segment::new(label, Some(&format!("s{label}")), None)
    }

    #[test]
    fn segments_take_the_first_layer_in_which_they_have_room() {
        let grid = Grid::axis_aligned([6, 1, 1], [1.0; 3], [0.0; 3]).unwrap();
        let mut layers = Layers::new(grid.clone(), 24);
        for (label, voxels) in [(1, 0..3), (2, 2..5), (3, 3..6), (4, 0..0)] {
            assert_eq!(layers.add(segment(label), voxels.clone()).unwrap(), voxels.len() as u64);
        }
        assert_eq!(
            layers.add(segment(5), [0, 0, 1, 99].into_iter()).unwrap(),
            2,
            "each once, within the grid"
        );
        let refused = layers.add(segment(6), 2..3).unwrap_err().to_string();
        assert!(refused.contains("3 layers of 6 voxels") && refused.contains("24 bytes"), "{refused}");
        let maps = layers.into_maps();
        let voxels = |map: &LabelMap| map.counted().map(|(s, n)| (s.label, n)).collect::<Vec<_>>();
        assert_eq!(
            maps.iter().map(voxels).collect::<Vec<_>>(),
            [vec![(1, 3), (3, 3), (4, 0)], vec![(2, 3), (5, 2)]]
        );
        assert!(maps.iter().all(|map| *map.grid() == grid));
        assert!(Layers::new(grid, 0).into_maps().is_empty());
    }

    #[test]
    fn the_number_of_layers_is_bounded() {
        let grid = Grid::axis_aligned([2, 1, 1], [1.0; 3], [0.0; 3]).unwrap();
        let mut layers = Layers::new(grid, u64::MAX);
        for label in 1..=64 {
            layers.add(segment(label), 0..1).unwrap();
        }
        layers.add(segment(65), 1..2).unwrap(); // has room in the first
        let refused = layers.add(segment(66), 0..1).unwrap_err().to_string();
        assert!(refused.contains("65 layers") && refused.contains("allowed are 64"), "{refused}");
    }
}
