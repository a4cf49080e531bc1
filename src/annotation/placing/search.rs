//! The place, direction and radius of a search for a feature. Space: patient LPS, mm.

use glam::DVec3;

/// The region of a search.
#[derive(Clone, Copy, Debug)]
pub(super) struct Search {
    /// Around this place, patient mm.
    pub(super) at: DVec3,
    /// Search along this unit direction, both ways; `None` searches the ball.
    pub(super) ray: Option<DVec3>,
    /// Largest distance, mm.
    pub(super) radius_mm: f64,
}
