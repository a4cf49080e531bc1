//! Annotations as DICOM structured reports: Comprehensive 3D SR, TID 1500, written and read.
//!
//! The report contains values that other programs need beyond the standard. 3D Slicer requires
//! planar groups (TID 1410) with a Finding and a series description. Cornerstone and OHIF read
//! English code meanings, tracking identifiers of their own, and an image library. So a landmark's
//! name is both its Tracking Identifier and the meaning of its Finding; lines, angles and curves
//! have Cornerstone's tracking identifiers, and their names only in the Finding.
//!
//! | item | group | coordinates |
//! |---|---|---|
//! | point | TID 1410 | `POINT`, Image Region |
//! | line | TID 1501 | `POLYLINE` that a NUM Length is inferred from |
//! | angle | TID 1501 | `POLYLINE` of four points, the corner twice as Cornerstone has it, below a NUM Angle |
//! | curve, closed within a plane | TID 1410 | `POLYGON`, Image Region, and again below a NUM Area |
//! | curve, open or out of plane | TID 1501 | `POLYLINE`, closed where it ends as it began, below a NUM Length |
//! | smooth curve | as these | the curve in short straight parts, and its points as Cornerstone's Control Points |
//!
//! Coordinates are 32-bit floats (VR FL), with a rounding error of about 1e-5 mm at 200 mm. Every
//! loss is reported: planes, regions and meshes, items without a place, colours, locks.
//! Measurements whose voxels are in another object (TID 1411) are not read; a warning names them.
//!
//! Space: patient LPS mm of the frame of reference that each coordinate names.

mod codes;
mod content;
mod graphics;
mod groups;
mod node;
mod read;
mod write;

pub use groups::UnreportableItem;
pub use read::{ReadReport, ReportReadOptions, read_report};
pub use write::{LeftOut, ReportWriteOptions, WrittenReport, write_report};

use super::whole::ObjectError;

/// The reason why a report could not be written or read. Messages contain neither UIDs nor content
/// of the report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// Coordinates must name a frame of reference.
    #[error(
        "the series has no Frame of Reference UID (0020,0052), which coordinates of a report must name; export to \
         another format"
    )]
    NoFrameOfReference,
    /// None of the items can be in a report.
    #[error("none of the {} items can be in a report{}", .0.len(), first_reason(.0))]
    Nothing(Vec<LeftOut>),
    /// The object could not be put into bytes.
    #[error("the report cannot be encoded: {0}")]
    Encoding(Box<dyn std::error::Error + Send + Sync>),
    /// It cannot be read.
    #[error(transparent)]
    Object(#[from] ObjectError),
    /// This machine gives no random numbers, which items are named by.
    #[error("the system gave no random numbers: {0}")]
    Random(#[from] getrandom::Error),
}

fn first_reason(left_out: &[LeftOut]) -> String {
    left_out.first().map_or(String::new(), |first| format!("; the first: {}", first.reason))
}
