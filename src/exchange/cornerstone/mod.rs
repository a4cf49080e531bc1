//! Annotations of Cornerstone in JSON, world mm in LPS: an array of them, `{"annotations": [...]}`,
//! a single one, or the state that its manager saves, by frame of reference and tool.
//!
//! | item | tool |
//! |---|---|
//! | point | `Probe`; `ArrowAnnotate` is read too |
//! | line, angle | `Length`, `Angle` |
//! | curve | `PlanarFreehandROI` where it is straight between its points, `SplineROI` where it is smooth; `LivewireContour` and `RectangleROI` are read too |
//!
//! Other tools are left out with a warning. What Cornerstone has no place for is in a property
//! `relief`, see `extra`. A frame of reference that is not the series' is refused; its UID is in no
//! message.

mod read;
mod wire;
mod write;

pub(super) use read::read;
pub(super) use write::write;
