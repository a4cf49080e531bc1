//! The samples of rays that lie behind cut faces, no further than the light of a face reaches; see
//! [`faces`](super::faces).

use relief_lanes::{Lanes, Real as _, Triple};

/// The samples that lie behind faces, no further than their light reaches.
pub(super) struct FaceZone<L: Lanes> {
    /// The last sample behind the entry.
    pub(super) last: L::Real,
    /// The first and the last sample behind the sphere, where there is one.
    pub(super) behind_sphere: Option<[L::Real; 2]>,
    /// Distances along the rays, mm, are products of voxel indices with these vectors, from these
    /// numbers on: behind the entry, and behind the sphere.
    pub(super) mm_per_voxel: Triple<L::Real>,
    pub(super) entry: L::Real,
    pub(super) sphere: L::Real,
}

impl<L: Lanes> FaceZone<L> {
    /// Weights of samples k, negative in the zone.
    #[inline(always)]
    pub(super) fn marked(&self, k: L::Real, weight: L::Real) -> L::Real {
        let mut is_near = k.le(self.last);
        if let Some([first, last]) = self.behind_sphere {
            is_near = is_near | (first.le(k) & k.le(last));
        }
        (-weight).or_where_not(is_near, weight)
    }
}
