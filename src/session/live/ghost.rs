//! Where a point would snap to.

use relief_base::{Patient, Point};
/// Where a point would snap to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ghost {
    /// The unsnapped place.
    pub(super) from: Point<Patient>,
    /// The snapped place.
    pub(super) at: Point<Patient>,
}
