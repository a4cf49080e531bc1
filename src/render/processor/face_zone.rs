//! Zones behind cut faces on the processor, for several rays at once; see [`faces`](super::faces).
//!
//! Samples are numbered along each ray. Distances are in mm along the ray.

use relief_lanes::{Lanes, Real as _, Triple};

/// The samples that are lit by a cut face: those behind it, as far as its light reaches.
pub(super) struct FaceZone<L: Lanes> {
    /// The last sample behind the entry.
    pub(super) last: L::Real,
    /// The first and the last sample behind the sphere, where there is one.
    pub(super) behind_sphere: Option<[L::Real; 2]>,
    /// The dot product of a voxel index with this vector is a distance along the ray, mm. The
    /// face's own value is subtracted from it.
    pub(super) mm_per_voxel: Triple<L::Real>,
    /// The value of that product where the ray enters the volume.
    pub(super) entry: L::Real,
    /// The value where it leaves the sphere.
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
