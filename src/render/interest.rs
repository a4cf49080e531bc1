//! The values of a volume that can change a picture.

use crate::mode::Mode;
use crate::request::RenderRequest;
use relief_volume::TransferTable;

/// Whether a brick with values in this range, in HU, can change the picture.
///
/// For a maximum every value above the lowest visible one counts, even an invisible one: it hides
/// lower values. For a minimum it is the other way round. Every value changes a plain mean.
pub(super) fn is_of_interest(
    request: &RenderRequest,
    table: &TransferTable,
    low_hu: f32,
    high_hu: f32,
) -> bool {
    match request.mode {
        Mode::Composite | Mode::PathTraced | Mode::Average | Mode::Additive => {
            table.is_visible(low_hu, high_hu)
        }
        Mode::Mip => table.is_visible(f32::MIN, high_hu),
        Mode::Minip => table.is_visible(low_hu, f32::MAX),
        // A slice takes every sample.
        Mode::Mean | Mode::Slice(_) => true,
        Mode::Isosurface => request.surfaces.iter().any(|surface| surface.may_lie_within(low_hu, high_hu)),
    }
}
