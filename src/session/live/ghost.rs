//! The place to which a point would snap.

use relief_base::{Patient, Point};
/// The place to which a point would snap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ghost {
    /// The unsnapped place.
    pub(super) from: Point<Patient>,
    /// The snapped place.
    pub(super) at: Point<Patient>,
}
