//! Data that both back ends derive from a volume and the look of a request before rays are cast:
//! which bricks may show something, and when two requests look alike.
//!
//! Spaces: bricks (brick index), voxel index, HU.

use std::sync::Arc;

use super::classification::Classification;
use super::labels::Labels;
use super::mode::Mode;
use super::request::RenderRequest;
use super::surface::Surface;
use super::tables::{TableSet, Tables};
use super::volume_plan::VolumePlan;
use relief_base::{Patient, Point, Voxel};
use relief_volume::{BrickLabels, BrickRanges, ContentHash, DistanceMap, Grid, TransferFunction, Volume};

/// The parts of a request, and the volume, that decide tables and empty space.
pub(super) struct AppearanceKey {
    pub(super) volume: ContentHash,
    transfer: TransferFunction,
    sample_distance_mm: f64,
    mode: Mode,
    classification: Classification,
    surfaces: Vec<Surface>,
    labels: Option<Arc<Labels>>,
}

impl AppearanceKey {
    pub(super) fn new(volume: ContentHash, request: &RenderRequest) -> Self {
        Self {
            volume,
            transfer: request.transfer.clone(),
            sample_distance_mm: request.sample_distance_mm,
            mode: request.mode,
            classification: request.classification,
            surfaces: request.surfaces.clone(),
            labels: request.labels.clone(),
        }
    }

    /// Whether a request on a volume has this appearance.
    pub(super) fn fits(&self, volume: ContentHash, request: &RenderRequest) -> bool {
        self.volume == volume
            && self.mode == request.mode
            && self.classification == request.classification
            && self.surfaces == request.surfaces
            && self.sample_distance_mm == request.sample_distance_mm
            && self.transfer == request.transfer
            && self.labels == request.labels
    }
}

/// The ranges of a volume's bricks.
pub(super) struct VolumeBricks {
    pub(super) coarse: BrickRanges,
    /// Smaller bricks for a small volume, only for composite pictures of sampled values: other ways
    /// of skipping need bricks that are longer than their steps.
    fine: Option<BrickRanges>,
}

impl VolumeBricks {
    /// The bricks of a volume as planned for its dimensions.
    pub(super) fn new(volume: &Volume, plan: &VolumePlan) -> Self {
        let has_fine = plan.fine_brick_edge != plan.brick_edge;
        let fine = has_fine.then(|| BrickRanges::new(volume, plan.fine_brick_edge));
        Self { coarse: BrickRanges::new(volume, plan.brick_edge), fine }
    }

    /// Bytes of the ranges.
    pub(super) fn bytes(&self) -> u64 {
        let ranges = |bricks: &BrickRanges| size_of_val(bricks.ranges_hu());
        (ranges(&self.coarse) + self.fine.as_ref().map_or(0, ranges)) as u64
    }

    /// Distances to bricks that may change the picture. `segments` is what occurs in the bricks of
    /// the request's label map, if it has one; `stored` the value that rays read for an HU.
    pub(super) fn distance_map(
        &self,
        segments: Option<&BrickLabels>,
        request: &RenderRequest,
        tables: &Tables,
        stored: impl Fn(i16) -> f32 + Sync,
    ) -> DistanceMap {
        let Some(segments) = segments else {
            let shows = |low, high| tables.is_of_interest(request, stored(low), stored(high));
            let is_plain =
                request.mode == Mode::Composite && request.classification == Classification::Sampled;
            let fine = self.fine.as_ref().filter(|_| is_plain);
            return fine.unwrap_or(&self.coarse).distance_map(shows);
        };
        let sets: Vec<TableSet> = segments.sets().iter().map(|places| tables.set_of(places)).collect();
        self.coarse.distance_map_by(|brick, low, high| {
            let set = sets[segments.of_brick()[brick] as usize];
            tables.is_of_interest_in(request, set, stored(low), stored(high))
        })
    }
}

/// The bricks of a volume, ready before a renderer needs them.
pub(super) struct PreparedBricks {
    volume: ContentHash,
    /// Edges of its bricks.
    edges: [usize; 2],
    pub(super) bricks: VolumeBricks,
}

impl PreparedBricks {
    pub(super) fn new(volume: &Volume, plan: &VolumePlan) -> Self {
        let bricks = VolumeBricks::new(volume, plan);
        Self { volume: volume.content_hash(), edges: plan.brick_edges(), bricks }
    }

    /// The bricks, if they are those of a volume as planned.
    pub(super) fn bricks_of(self, volume: ContentHash, plan: &VolumePlan) -> Option<VolumeBricks> {
        (self.volume == volume && self.edges == plan.brick_edges()).then_some(self.bricks)
    }
}

/// How bricks tile a volume, and where those lie that may show something.
#[derive(Clone, Copy, Debug)]
pub(super) struct VisibleBricks {
    /// Edge of a brick in voxels.
    pub(super) edge: usize,
    /// Bricks along i, j, k.
    pub(super) dims: [usize; 3],
    /// The first and the last brick along each axis; none where nothing shows.
    bounds: Option<[[usize; 3]; 2]>,
    /// Bricks beside its own that a sample reaches into: a pre-integrated one's path does.
    reach: usize,
}

impl VisibleBricks {
    pub(super) fn new(map: &DistanceMap, request: &RenderRequest) -> Self {
        let reach = usize::from(request.classification == Classification::PreIntegrated);
        Self { edge: map.edge, dims: map.dims, bounds: map.visible_bounds(), reach }
    }

    /// The corners of a box about all that may be visible; none where nothing is.
    pub(super) fn corners(&self, grid: &Grid) -> Option<[Point<Patient>; 8]> {
        let Self { edge, dims, reach, .. } = *self;
        self.bounds.map(|[first, last]| {
            std::array::from_fn(|corner| {
                let at = |axis: usize| {
                    let (low, high) = (first[axis].saturating_sub(reach), last[axis] + reach + 1);
                    // The outermost bricks take in the outer halves of the outermost voxels.
                    match corner >> axis & 1 {
                        0 if low == 0 => -0.5,
                        0 => (low * edge) as f64,
                        _ if high >= dims[axis] => grid.dims()[axis] as f64 - 0.5,
                        _ => (high * edge) as f64,
                    }
                };
                grid.patient_from_voxel() * Point::<Voxel>::new(at(0), at(1), at(2))
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume_plan::VolumeLimits;

    #[test]
    fn bricks_are_adopted_for_their_own_volume_and_plan_alone() {
        let grid = Grid::axis_aligned([8, 8, 8], [1.0; 3], [0.0; 3]).unwrap();
        let volume = |hu: i16| Volume::new(grid.clone(), vec![hu; 512]).unwrap();
        let (own, other) = (volume(7), volume(8));
        let plan = VolumeLimits::of_processor().plan([8, 8, 8]).unwrap();
        let prepared = || PreparedBricks::new(&own, &plan);
        let bricks = prepared().bricks_of(own.content_hash(), &plan).unwrap();
        assert_eq!(bricks.coarse.ranges_hu(), VolumeBricks::new(&own, &plan).coarse.ranges_hu());
        assert!(prepared().bricks_of(other.content_hash(), &plan).is_none());
        for plan in [VolumePlan { brick_edge: 8, ..plan }, VolumePlan { fine_brick_edge: 2, ..plan }] {
            assert!(prepared().bricks_of(own.content_hash(), &plan).is_none(), "{plan:?}");
        }
    }
}
