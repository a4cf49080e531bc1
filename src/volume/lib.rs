//! Volumes: HU voxels on a regular grid placed in patient space.
//!
//! It holds the grid and its geometry, the voxels, their range and content hash, min-max bricks for
//! empty-space skipping, label maps, masks, and procedural phantoms with known truth. It reads no
//! files (see `dicom`) and uses no GPU (see `render`).
//!
//! Spaces: voxel index and patient mm. Values: HU as `i16`, x fastest, then y, then z. A
//! volume may have another quantity ([`Volume::quantity`]); names with `hu` then mean its values.

mod anatomy;
mod bricks;
mod camera;
mod cells;
mod content_hash;
mod grid;
mod labels;
mod mask;
mod occupancy;
mod phantom;
mod quantity;
mod table;
mod transfer;

use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

pub use anatomy::{Anatomy, BodyPart};
pub use bricks::{BrickRanges, DistanceMap};
pub use content_hash::{ContentHash, ContentHasher, stack_sha256};
pub use grid::{Bounds, Grid, GridError};
pub use labels::{BrickLabels, LabelCountError, LabelMap, Layers, LayersError, Segment, SegmentIndices};
pub use mask::Mask;
pub use occupancy::{Cells, Occupancy};

pub use camera::{
    Camera, CameraError, CameraFile, EdgeLabels, Framing, NamedPlane, Orbit, PlaneView, Projection,
    ProjectionFile, head_up,
};
pub use phantom::{
    Material, Phantom, PhantomKind, PhantomLandmark, PhantomRecipe, PhantomSizeError, PhantomTruth, Surface,
    SurfaceShape, UnknownPhantom,
};
pub use quantity::Quantity;
pub use table::Table;
pub use transfer::{
    ControlPoint, GradientOpacity, GradientTable, ImportedLight, ImportedTransfer, IntegralTable,
    MAX_IMPORT_BYTES, MediumTable, PRESETS, Preset, PresetGroup, PresetMode, TransferError, TransferFunction,
    TransferImportChoice, TransferImportError, TransferSyntaxError, TransferTable, Window, WindowMap,
    import_transfer, linear_from_srgb, preset,
};

/// A CT volume, in HU unless its [`Quantity`] is another. Cheap to clone: the voxels are shared.
#[derive(Clone)]
pub struct Volume {
    grid: Grid,
    voxels_hu: Arc<Vec<i16>>,
    range_hu: (i16, i16),
    quantity: Quantity,
    derived: Arc<Derived>,
}

/// Values derived from the voxels; computed once for all clones.
#[derive(Default)]
struct Derived {
    hash: OnceLock<ContentHash>,
    occupancy: OnceLock<Arc<Occupancy>>,
    anatomy: OnceLock<Anatomy>,
    table: OnceLock<Option<Arc<Table>>>,
    /// The volume with air in place of the table; `None` where there is no table.
    without_table: OnceLock<Option<Volume>>,
}

impl Derived {
    /// Of a volume that was made of another one and has no table.
    fn without_table(hash: ContentHash) -> Arc<Self> {
        let (hash, table, without_table) = (OnceLock::from(hash), OnceLock::from(None), OnceLock::from(None));
        Arc::new(Self { hash, table, without_table, ..Self::default() })
    }
}

/// Voxels are left out: there are millions.
impl std::fmt::Debug for Volume {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Volume")
            .field("grid", &self.grid)
            .field("range_hu", &self.range_hu)
            .finish_non_exhaustive()
    }
}

/// The voxel count did not match the grid.
#[derive(Clone, Debug, thiserror::Error)]
#[error("a grid of {dims:?} voxels needs {expected} values, found {found}")]
pub struct VoxelCountError {
    dims: [usize; 3],
    expected: usize,
    found: usize,
}

impl Volume {
    /// A volume of `voxels_hu` (x fastest) on `grid`.
    ///
    /// # Errors
    /// When the number of values is not the product of the grid's dimensions.
    pub fn new(grid: Grid, voxels_hu: Vec<i16>) -> Result<Self, VoxelCountError> {
        let expected = grid.voxel_count();
        if voxels_hu.len() != expected {
            return Err(VoxelCountError { dims: grid.dims(), expected, found: voxels_hu.len() });
        }
        let none = (i16::MAX, i16::MIN);
        let wider = |(low, high): (i16, i16), (lower, higher)| (low.min(lower), high.max(higher));
        let range = |voxels: &[i16]| voxels.iter().fold(none, |range, &hu| wider(range, (hu, hu)));
        let range_hu = voxels_hu.par_chunks(1 << 16).map(range).reduce(|| none, wider);
        let quantity = Quantity::Hounsfield;
        Ok(Self { grid, voxels_hu: Arc::new(voxels_hu), range_hu, quantity, derived: Arc::default() })
    }

    /// The same voxels, interpreted as values of this quantity.
    #[must_use]
    pub fn of_quantity(self, quantity: Quantity) -> Self {
        if quantity == self.quantity {
            return self;
        }
        let derived = Derived { hash: self.derived.hash.clone(), ..Derived::default() };
        Self { quantity, derived: Arc::new(derived), ..self }
    }

    /// The quantity of the values.
    #[must_use]
    pub fn quantity(&self) -> Quantity {
        self.quantity
    }

    /// As [`Self::new`], with the content hash of a hasher of the same grid that has had exactly
    /// these voxels.
    ///
    /// # Errors
    /// When the number of values is not the product of the grid's dimensions.
    pub fn hashed(grid: Grid, voxels_hu: Vec<i16>, hasher: ContentHasher) -> Result<Self, VoxelCountError> {
        let volume = Self::new(grid, voxels_hu)?;
        let _ = volume.derived.hash.set(hasher.finish());
        Ok(volume)
    }

    /// The grid of the voxels.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The voxels in HU, x fastest, then y, then z.
    #[must_use]
    pub fn voxels_hu(&self) -> &[i16] {
        &self.voxels_hu
    }

    /// Smallest and largest HU.
    #[must_use]
    pub fn range_hu(&self) -> (i16, i16) {
        self.range_hu
    }

    /// The voxel at an index inside the grid.
    ///
    /// # Panics
    /// When the index is outside the grid.
    #[must_use]
    pub fn hu(&self, [i, j, k]: [usize; 3]) -> i16 {
        let [nx, ny, _] = self.grid.dims();
        self.voxels_hu[(k * ny + j) * nx + i]
    }

    /// Identity by content; computed once, then remembered by all clones.
    #[must_use]
    pub fn content_hash(&self) -> ContentHash {
        *self.derived.hash.get_or_init(|| {
            let mut hasher = ContentHasher::new(&self.grid);
            hasher.update(&self.voxels_hu);
            hasher.finish()
        })
    }

    /// The table on which the patient lies, if there is one; computed once, then remembered by all
    /// clones. The search needs HU, so a volume of another quantity has no table.
    #[must_use]
    pub fn table(&self) -> Option<&Arc<Table>> {
        let find = || self.quantity.is_hu().then(|| Table::find(&self.in_units()).map(Arc::new)).flatten();
        self.derived.table.get_or_init(find).as_ref()
    }

    /// The same volume with this table, which was found in a volume on the same grid: the phases of a
    /// series lie on one table.
    #[must_use]
    pub fn with_table(&self, table: Option<Arc<Table>>) -> Self {
        let derived = Derived { hash: self.derived.hash.clone(), table: table.into(), ..Derived::default() };
        Self { derived: Arc::new(derived), ..self.clone() }
    }

    /// The volume with air in place of its table (see [`Table`]), or the volume itself if it has no
    /// table; computed once, then remembered by all clones. It takes as much memory again.
    #[must_use]
    pub fn without_table(&self) -> &Self {
        let removed = self.derived.without_table.get_or_init(|| {
            let (hash, table) = rayon::join(|| self.content_hash(), || self.table());
            let table = table?;
            let shown =
                Self::new(self.grid.clone(), table.removed_from(self)).ok()?.of_quantity(self.quantity);
            Some(Self { derived: Derived::without_table(hash.without_table()), ..shown })
        });
        removed.as_ref().unwrap_or(self)
    }

    /// Whether [`Volume::without_table`] was made, and has voxels of its own.
    #[must_use]
    pub fn has_copy_without_table(&self) -> bool {
        self.derived.without_table.get().is_some_and(Option::is_some)
    }

    /// The distribution of its values, in coarse cells; computed once, then remembered by all clones.
    #[must_use]
    pub fn occupancy(&self) -> &Arc<Occupancy> {
        self.derived.occupancy.get_or_init(|| Arc::new(Occupancy::new(self)))
    }

    /// The part of a body that it shows; computed once, then remembered by all clones. The table
    /// must be removed: see [`Volume::without_table`].
    #[must_use]
    pub fn anatomy(&self) -> Anatomy {
        *self.derived.anatomy.get_or_init(|| Anatomy::of(&self.in_units()))
    }

    /// The volume as it is judged by lengths that are made for bodies: see [`Grid::unit_mm`].
    fn in_units(&self) -> Self {
        match self.grid.unit_mm() {
            1.0 => self.clone(),
            _ => Self { grid: self.grid.in_units(), derived: Arc::default(), ..self.clone() },
        }
    }

    /// The mean of each block of 2³ voxels, for pictures that have to be quick; its table is left out.
    /// It takes an eighth of the memory, and is not kept.
    #[must_use]
    pub fn coarse(&self) -> Self {
        let shown = self.without_table();
        let derived = Derived::without_table(shown.content_hash().coarse());
        Self { derived, ..shown.downsampled(2) }
    }

    /// The mean of each block of `factor`³ voxels, for adapters whose limits a volume exceeds.
    ///
    /// Blocks at the far faces may be smaller; the grid keeps covering the same box to within one
    /// voxel.
    #[must_use]
    pub fn downsampled(&self, factor: usize) -> Self {
        let factor = factor.max(1);
        if factor == 1 {
            return self.clone();
        }
        let [nx, ny, nz] = self.grid.dims();
        let grid = self.grid.downsampled(factor);
        let [mx, my, mz] = grid.dims();
        let mean = |[a, b, c]: [usize; 3]| {
            let (mut sum, mut count) = (0i64, 0i64);
            for k in c * factor..((c + 1) * factor).min(nz) {
                for j in b * factor..((b + 1) * factor).min(ny) {
                    let row = (k * ny + j) * nx;
                    let run = row + a * factor..row + ((a + 1) * factor).min(nx);
                    count += run.len() as i64;
                    sum += self.voxels_hu[run].iter().map(|&hu| i64::from(hu)).sum::<i64>();
                }
            }
            (sum as f64 / count as f64).round() as i16
        };
        let mut voxels = vec![0; mx * my * mz];
        voxels.par_chunks_mut(mx * my).enumerate().for_each(|(c, layer)| {
            for (at, voxel) in layer.iter_mut().enumerate() {
                *voxel = mean([at % mx, at / mx, c]);
            }
        });
        let range_hu = voxels.iter().fold((i16::MAX, i16::MIN), |(lo, hi), &v| (lo.min(v), hi.max(v)));
        Self { grid, voxels_hu: Arc::new(voxels), range_hu, quantity: self.quantity, derived: Arc::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> Volume {
        let grid = Grid::axis_aligned([5, 3, 2], [1.0, 1.0, 2.0], [0.0; 3]).unwrap();
        Volume::new(grid, (0..30).collect()).unwrap()
    }

    #[test]
    fn a_wrong_voxel_count_is_refused_with_both_numbers() {
        let grid = Grid::axis_aligned([2, 2, 2], [1.0; 3], [0.0; 3]).unwrap();
        let error = Volume::new(grid, vec![0; 7]).unwrap_err();
        assert_eq!(error.to_string(), "a grid of [2, 2, 2] voxels needs 8 values, found 7");
    }

    #[test]
    fn the_content_hash_depends_on_voxels_and_placement() {
        let moved = Grid::axis_aligned([5, 3, 2], [1.0, 1.0, 2.0], [1.0, 0.0, 0.0]).unwrap();
        let moved = Volume::new(moved, (0..30).collect()).unwrap();
        let mut changed = ramp().voxels_hu().to_vec();
        changed[7] += 1;
        let changed = Volume::new(ramp().grid().clone(), changed).unwrap();
        assert_eq!(ramp().content_hash(), ramp().content_hash());
        assert_ne!(ramp().content_hash(), moved.content_hash());
        assert_ne!(ramp().content_hash(), changed.content_hash());
    }

    #[test]
    fn the_coarse_form_has_an_identity_of_its_own_and_no_table() {
        let volume = ramp();
        let coarse = volume.coarse();
        assert_eq!(coarse.voxels_hu(), volume.downsampled(2).voxels_hu());
        assert_eq!(coarse.content_hash(), volume.without_table().content_hash().coarse());
        assert_ne!(coarse.content_hash(), volume.content_hash());
        assert_eq!(coarse.without_table().content_hash(), coarse.content_hash());
    }

    #[test]
    fn downsampling_averages_blocks_and_smaller_rests() {
        let small = ramp().downsampled(2);
        assert_eq!(small.grid().dims(), [3, 2, 1]);
        // The block at the origin holds 0 1 5 6 15 16 20 21; the one at the far corner 14 29.
        assert_eq!(small.hu([0, 0, 0]), 11);
        assert_eq!(small.hu([2, 1, 0]), 22);
        let centre = small.grid().patient_from_voxel() * relief_base::Point::new(0.0, 0.0, 0.0);
        assert_eq!(centre.xyz, glam::DVec3::new(0.5, 0.5, 1.0));
    }
}
