//! 3D Slicer's markups, `.mrk.json`: read in any version 1, written in 1.0.3 and LPS.
//!
//! A markup of type `Fiducial` is a list of points; any other markup is one item. Values without a
//! field in the format are in a property `relief` (see `extra`). Slicer drops it on saving, but
//! keeps the control points' ids, which are the items' ids.
//!
//! Checked beyond the schema: numbers are finite, ids are unique, a defined point has a position,
//! and each type has the required number of control points. Boxes (`ROI`) are left out with a
//! warning. Slicer's orientations of points, glyph sizes and similar display settings do not
//! describe the patient and are not kept.

mod plane;
mod read;
mod wire;
mod write;

pub(super) use read::read;
pub(super) use write::write;
