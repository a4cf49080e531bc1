//! Light behind cut faces: the normal of a face in place of gradients; see [`faces`](super::faces).
//!
//! Directions along the patient axes.

use relief_lanes::{Lanes, Real as _, Triple};

use super::color::NO_GRADIENT;

/// The faces before waiting samples.
pub(super) struct FaceLight<L: Lanes> {
    pub(super) lanes: L,
    /// The gradient's share of the light, 0..1.
    pub(super) share: L::Real,
    pub(super) normal: Triple<L::Real>,
    /// Whether any share is below 1.
    pub(super) shows: bool,
}

impl<L: Lanes> FaceLight<L> {
    /// The gradients, or what takes their place behind a face. Their lengths have no meaning.
    #[inline(always)]
    pub(super) fn turned(&self, gradient: Triple<L::Real>, direction: Triple<L::Real>) -> Triple<L::Real> {
        if !self.shows {
            return gradient;
        }
        let (zero, one) = (self.lanes.splat(0.0), self.lanes.splat(1.0));
        let length = gradient.dot(gradient).max(self.lanes.splat(NO_GRADIENT)).sqrt();
        let slope = gradient.over(Triple::of(length));
        // Towards the eye, as normals are.
        let is_averted = zero.lt(slope.dot(direction));
        let toward = Triple::of(zero).minus(slope).or_where_not([is_averted; 3], slope);
        // Slowly at first: opaque bodies show little of the noise behind.
        let share = self.share.max(zero);
        let blended = self.normal.plus_times(toward.minus(self.normal), share * share);
        gradient.or_where_not([one.le(self.share); 3], blended)
    }
}
