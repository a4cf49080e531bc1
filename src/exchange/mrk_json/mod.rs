//! 3D Slicer's markups, `.mrk.json`: read in any version 1, written in 1.0.3 and LPS.
//!
//! A markup of type `Fiducial` is a list of points; any other one is an item. What the format has no place for is in a property
//! `relief`, see `extra`; Slicer drops it when it saves, but keeps the control points' ids, which are the items'.
//!
//! Besides the schema: numbers are finite, ids are there once, a defined point has a position, and each type has as many control
//! points as its name says. Boxes (`ROI`) are left out with a warning. Slicer's orientations of points, sizes of glyphs and the
//! like say nothing about the patient, and are not kept.

mod plane;
mod read;
mod wire;
mod write;

pub(super) use read::read;
pub(super) use write::write;
