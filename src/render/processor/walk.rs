//! Empty space: from one sample of a ray to the next that may show something; as
//! `shaders/lib/walk.wgsl`.
//!
//! Spaces: bricks, and sample numbers. Whole numbers of samples are skipped, so that those that are
//! taken lie where they would without skipping.

use relief_lanes::{Lanes, Mask as _, Real as _, Triple};

use super::ray::Rays;
use relief_volume::DistanceMap;

/// A ray that moves less than this many voxels a sample along an axis never leaves a brick through
/// that axis' faces.
const STILL: f64 = 1e-7;
/// Skips end this much before the face, in samples, so that rounding never takes them beyond it.
const BEFORE_FACE: f64 = 0.01;
/// Further than any ray has samples.
const NEVER: f64 = 1e6;

/// The bricks of a volume, and which of them may show something.
pub(super) struct Bricks<'a, L: Lanes> {
    lanes: L,
    map: &'a DistanceMap,
    skips: bool,
    per_voxel: L::Real,
    last: Triple<L::Real>,
    /// Bricks of a row and of a layer.
    strides: [L::Real; 2],
    /// Bricks beside its own that a sample reaches into, as the path of a pre-integrated one does.
    reach: L::Real,
}

/// The brick positions of rays, and the samples at which rays leave bricks, as linear functions of
/// the sample's number.
pub(super) struct Walk<L: Lanes> {
    brick: Triple<L::Real>,
    brick_step: Triple<L::Real>,
    /// Rays leave the cube of bricks nearer than d to brick b at sample
    /// `b * per_brick + d * per_distance + constant`.
    per_brick: Triple<L::Real>,
    per_distance: Triple<L::Real>,
    constant: Triple<L::Real>,
}

impl<'a, L: Lanes> Bricks<'a, L> {
    #[inline(always)]
    pub(super) fn new(lanes: L, map: &'a DistanceMap, skips: bool, has_paths: bool) -> Self {
        let [nx, ny, nz] = map.dims;
        Self {
            lanes,
            map,
            skips,
            per_voxel: lanes.splat(1.0 / map.edge as f64),
            last: Triple([nx, ny, nz].map(|side| lanes.splat((side - 1) as f64))),
            strides: [lanes.splat(nx as f64), lanes.splat((nx * ny) as f64)],
            reach: lanes.splat(u8::from(has_paths).into()),
        }
    }

    #[inline(always)]
    pub(super) fn walk(&self, rays: &Rays<L>) -> Walk<L> {
        let (zero, one) = (Triple::of(self.lanes.splat(0.0)), Triple::of(self.lanes.splat(1.0)));
        let [first_voxel, sample_voxels] = rays.line();
        let brick = first_voxel.scaled(self.per_voxel);
        let brick_step = sample_voxels.scaled(self.per_voxel);
        let is_still = sample_voxels.abs().lt(Triple::of(self.lanes.splat(STILL)));
        let per_brick = zero.or_where_not(is_still, one.over(one.or_where_not(is_still, brick_step)));
        let forward = zero.lt(brick_step);
        let per_distance = per_brick.or_where_not(forward, zero.minus(per_brick));
        let face = zero.or_where_not(forward, per_brick);
        let never = Triple::of(self.lanes.splat(NEVER));
        let constant = never
            .or_where_not(is_still, face.minus(brick.times(per_brick)))
            .minus(Triple::of(self.lanes.splat(BEFORE_FACE)));
        Walk { brick, brick_step, per_brick, per_distance, constant }
    }

    /// The first samples from k on that are not certain to be invisible: k where its brick may show
    /// something.
    #[inline(always)]
    pub(super) fn next_sample(&self, walk: &Walk<L>, k: L::Real) -> L::Real {
        if !self.skips {
            return k;
        }
        let (brick, distance) = self.look(walk, k);
        k.or_where_not(distance.lt(self.lanes.splat(0.5)), self.behind(walk, k, brick, distance))
    }

    /// The chosen lanes whose samples k are certain to be invisible, and the first samples behind
    /// those in which that is not certain; `None` where there are no such lanes.
    #[inline(always)]
    pub(super) fn past_empty(
        &self,
        walk: &Walk<L>,
        k: L::Real,
        chosen: L::Mask,
    ) -> Option<(L::Real, L::Mask)> {
        if !self.skips {
            return None;
        }
        let (brick, distance) = self.look(walk, k);
        let is_empty = chosen & !distance.lt(self.lanes.splat(0.5));
        is_empty.any().then(
            #[inline(always)]
            || (self.behind(walk, k, brick, distance), is_empty),
        )
    }

    /// The bricks of samples k, and their distances to bricks that may show something.
    #[inline(always)]
    fn look(&self, walk: &Walk<L>, k: L::Real) -> (Triple<L::Real>, L::Real) {
        let brick = self.within(walk.brick.plus_times(walk.brick_step, k));
        (brick, (self.distance_of(brick) - self.reach).max(self.lanes.splat(0.0)))
    }

    /// The first samples behind k that are as far as `distance` from its brick.
    #[inline(always)]
    fn behind(&self, walk: &Walk<L>, k: L::Real, brick: Triple<L::Real>, distance: L::Real) -> L::Real {
        let leave = brick.times(walk.per_brick).plus_times(walk.per_distance, distance).plus(walk.constant);
        leave.least().min(self.lanes.splat(NEVER)).ceil().max(k + self.lanes.splat(1.0))
    }

    /// Distances, in bricks, from voxel indices to bricks that may show something.
    #[inline(always)]
    pub(super) fn distance(&self, voxel: Triple<L::Real>) -> L::Real {
        self.distance_of(self.within(voxel.scaled(self.per_voxel)))
    }

    #[inline(always)]
    fn within(&self, brick: Triple<L::Real>) -> Triple<L::Real> {
        brick.floor().max(Triple::of(self.lanes.splat(0.0))).min(self.last)
    }

    #[inline(always)]
    fn distance_of(&self, brick: Triple<L::Real>) -> L::Real {
        let (Triple([x, y, z]), [row, layer]) = (brick, self.strides);
        // Exact: there are at most 2^24 bricks.
        self.lanes.bytes(&self.map.distances, self.lanes.place(x + y * row + z * layer))
    }

    /// Whether bricks are longer than the distance between samples along each axis.
    #[inline(always)]
    pub(super) fn are_longer_than_steps(&self, walk: &Walk<L>) -> L::Mask {
        walk.brick_step.abs().largest().lt(self.lanes.splat(0.99))
    }
}
