//! Values and gradients of a volume; as `shaders/lib/volume.wgsl`.
//!
//! Spaces: voxel index in; HU out, and HU/mm along the patient axes. Values are trilinear between
//! voxel centres and clamp outside the outermost ones. Nothing is prepared: voxels are read where
//! the volume has them.

use relief_lanes::{Lanes, Mask as _, Real as _, Triple};

use crate::gradients::patient_from_voxel_gradient;
use relief_volume::Volume;

/// The voxels of a volume.
pub(super) struct Field<'a, L: Lanes> {
    lanes: L,
    voxels_hu: &'a [i16],
    strides: [i32; 2],
    /// The last voxel along each axis.
    last: Triple<L::Real>,
    /// The last voxel that has one behind it.
    last_base: Triple<L::Real>,
    patient_from_voxel_gradient: [Triple<L::Real>; 3],
}

/// A cell of eight voxels, and where in it a point lies, 0..1.
struct Cell<L: Lanes> {
    base: Triple<L::Real>,
    share: Triple<L::Real>,
    at: L::Index,
}

/// Whether a volume can be read: rows have two voxels, and places 31 bits.
pub(super) fn can_read(dims: [usize; 3]) -> bool {
    let voxels = dims.iter().try_fold(1usize, |product, &side| product.checked_mul(side));
    dims[0] >= 2 && voxels.is_some_and(|voxels| i32::try_from(voxels).is_ok())
}

impl<'a, L: Lanes> Field<'a, L> {
    #[inline(always)]
    pub(super) fn new(lanes: L, volume: &'a Volume) -> Self {
        let [nx, ny, nz] = volume.grid().dims();
        let behind =
            |voxels: usize| Triple([nx, ny, nz].map(|side| lanes.splat(side.saturating_sub(voxels) as f64)));
        // A single row or layer has itself as its neighbour.
        let stride = |side: usize, voxels: usize| if side > 1 { voxels as i32 } else { 0 };
        let columns = patient_from_voxel_gradient(volume.grid()).to_cols_array_2d();
        Self {
            lanes,
            voxels_hu: volume.voxels_hu(),
            strides: [stride(ny, nx), stride(nz, nx * ny)],
            last: behind(1),
            last_base: behind(2),
            patient_from_voxel_gradient: columns.map(|column| Triple(column.map(|x| lanes.splat(x)))),
        }
    }

    /// The middle of the volume.
    #[inline(always)]
    pub(super) fn middle(&self) -> Triple<L::Real> {
        self.last.scaled(self.lanes.splat(0.5))
    }

    #[inline(always)]
    fn cell(&self, p: Triple<L::Real>) -> Cell<L> {
        let p = p.max(Triple::of(self.lanes.splat(0.0))).min(self.last);
        let base = p.floor().min(self.last_base);
        Cell { base, share: p.minus(base), at: self.lanes.places(base, self.strides) }
    }

    /// HU at these positions.
    #[inline(always)]
    pub(super) fn hu(&self, p: Triple<L::Real>) -> L::Real {
        let Cell { share: Triple([x, y, z]), at, .. } = self.cell(p);
        let [row, layer] = self.strides;
        let rows = [0, row, layer, layer + row];
        let [near_low, near_high, far_low, far_high] = self.lanes.short_pairs(self.voxels_hu, at, rows);
        let near = between(near_low, x).lerp(between(near_high, x), y);
        near.lerp(between(far_low, x).lerp(between(far_high, x), y), z)
    }

    /// Gradients at these positions: central differences over one voxel to both sides, HU/mm along
    /// the patient axes.
    #[inline(always)]
    pub(super) fn gradient(&self, p: Triple<L::Real>) -> Triple<L::Real> {
        let cell = self.cell(p);
        let one = self.lanes.splat(1.0);
        let (least, room) = (cell.base.least(), self.last_base.minus(cell.base).least());
        let differences = if least.min(room).lt(one).any() {
            self.differences_at_edge(&cell)
        } else {
            self.differences(&cell)
        };
        Triple::of_columns(self.patient_from_voxel_gradient, differences)
    }

    /// HU per two voxels along each axis in cells that have neighbours on all sides: twelve rows of
    /// voxels.
    #[inline(always)]
    fn differences(&self, &Cell { share, at, .. }: &Cell<L>) -> Triple<L::Real> {
        let [row, layer] = self.strides;
        let rows = [-1, row - 1, layer - 1, layer + row - 1];
        let [near_low, near_high, far_low, far_high] = self.lanes.short_quads(self.voxels_hu, at, rows);
        let rows = [-row, 2 * row, layer - row, layer + 2 * row];
        let beside_y = self.lanes.short_quads(self.voxels_hu, at, rows).map(first_pair);
        let rows = [-layer, row - layer, 2 * layer, 2 * layer + row];
        let beside_z = self.lanes.short_quads(self.voxels_hu, at, rows).map(first_pair);
        let inner = [[near_low, near_high], [far_low, far_high]];
        let [[p, q, r, s], [t, u, v, w]] = [beside_y, beside_z];
        blended(share, inner, [[p, q], [r, s]], [[t, u], [v, w]])
    }

    /// The same in any cell: neighbours that are missing are the outermost voxels themselves.
    #[inline(always)]
    fn differences_at_edge(&self, &Cell { base, share, .. }: &Cell<L>) -> Triple<L::Real> {
        let [row, layer] = self.strides;
        let (zero, one, two) = (self.lanes.splat(0.0), self.lanes.splat(1.0), self.lanes.splat(2.0));
        let Triple([x, y, z]) = base;
        let (Triple([_, last_y, last_z]), Triple([last_x, ..])) = (self.last, self.last_base);
        let rows = [0, row, layer, layer + row];
        let inner = self.pairs([x, y, z], rows);
        let before = self.pairs([(x - one).max(zero), y, z], rows);
        let after = self.pairs([(x + one).min(last_x), y, z], rows);
        let [p, r] = self.pairs([x, (y - one).max(zero), z], [0, layer]);
        let [q, s] = self.pairs([x, (y + two).min(last_y), z], [0, layer]);
        let [t, u] = self.pairs([x, y, (z - one).max(zero)], [0, row]);
        let [v, w] = self.pairs([x, y, (z + two).min(last_z)], [0, row]);
        let [[before_0, _], [before_1, _], [before_2, _], [before_3, _]] = before;
        let [[low_0, high_0], [low_1, high_1], [low_2, high_2], [low_3, high_3]] = inner;
        let [[_, after_0], [_, after_1], [_, after_2], [_, after_3]] = after;
        let near = [[before_0, low_0, high_0, after_0], [before_1, low_1, high_1, after_1]];
        let far = [[before_2, low_2, high_2, after_2], [before_3, low_3, high_3, after_3]];
        blended(share, [near, far], [[p, q], [r, s]], [[t, u], [v, w]])
    }

    /// Two voxels along a row from each of some voxels on, at these distances.
    #[inline(always)]
    fn pairs<const N: usize>(&self, voxel: [L::Real; 3], distances: [i32; N]) -> [[L::Real; 2]; N] {
        let at = self.lanes.places(Triple(voxel), self.strides);
        self.lanes.short_pairs(self.voxels_hu, at, distances)
    }
}

#[inline(always)]
fn first_pair<R: Copy>([low, high, ..]: [R; 4]) -> [R; 2] {
    [low, high]
}

#[inline(always)]
fn between<R: relief_lanes::Real>([low, high]: [R; 2], share: R) -> R {
    low.lerp(high, share)
}

/// The middle of a row of four, and the difference over one voxel to both sides along it.
#[inline(always)]
fn middle_and_difference<R: relief_lanes::Real>([before, low, high, after]: [R; 4], x: R) -> [R; 2] {
    [low.lerp(high, x), (high - before).lerp(after - low, x)]
}

/// Differences of voxels, trilinear within a cell. `inner` has the cell's four rows with a voxel more
/// at both ends, by z and y; `y_outer` the rows beside them along y, by z; `z_outer` those along z, by
/// y within.
#[inline(always)]
fn blended<R: relief_lanes::Real>(
    Triple([x, y, z]): Triple<R>,
    [[near_low, near_high], [far_low, far_high]]: [[[R; 4]; 2]; 2],
    [[near_before, near_after], [far_before, far_after]]: [[[R; 2]; 2]; 2],
    [[before_low, before_high], [after_low, after_high]]: [[[R; 2]; 2]; 2],
) -> Triple<R> {
    let [near_low, near_low_x] = middle_and_difference(near_low, x);
    let [near_high, near_high_x] = middle_and_difference(near_high, x);
    let [far_low, far_low_x] = middle_and_difference(far_low, x);
    let [far_high, far_high_x] = middle_and_difference(far_high, x);
    let along_x = near_low_x.lerp(near_high_x, y).lerp(far_low_x.lerp(far_high_x, y), z);
    let near_y = (near_high - between(near_before, x)).lerp(between(near_after, x) - near_low, y);
    let far_y = (far_high - between(far_before, x)).lerp(between(far_after, x) - far_low, y);
    let (near, far) = (near_low.lerp(near_high, y), far_low.lerp(far_high, y));
    let before = between(before_low, x).lerp(between(before_high, x), y);
    let after = between(after_low, x).lerp(between(after_high, x), y);
    Triple([along_x, near_y.lerp(far_y, z), (far - before).lerp(after - near, z)])
}
