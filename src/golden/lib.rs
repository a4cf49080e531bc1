//! Golden images: pictures that were looked at once and must come out the same ever after, of
//! procedural volumes or of a project's own series.
//!
//! It reads cases, renders them, compares, and shows differences. It writes no golden:
//! [`Harness::bless`] returns the bytes, and only `relief golden bless` writes them.
//!
//! A case is a folder `golden/<suite>/<case>/`; unknown keys in its files are refused:
//!
//! | file | holds |
//! |---|---|
//! | `case.toml` | purpose, volume, tolerance by name, compared parts |
//! | `scene.json` | the scene, in the JSON that users write |
//! | `color.png` | expected colour and coverage (RGBA, 8 bits) |
//! | `depth.exr` | expected view depth, mm, `+inf` where a ray hits nothing |
//! | `frame.png` | expected frame as a display takes it (RGB, 8 bits) |
//!
//! ```toml
//! purpose = "one sentence: the content of the picture, and faults that would change it"
//! tolerance = "strict"
//! compare = ["color", "depth"]
//!
//! [volume]
//! phantom = "sphere"
//! size = 64
//! ```
//!
//! In place of `phantom` and `size`, `series` is the path of a CT series or a volume file from the
//! case's folder, with `series_uid` where there are several.
//!
//! Pictures are compared on a software adapter: its pictures do not depend on the machine.
//! Everything else is a failure: a golden that is missing, a file that no case asks for, no case at
//! all.

mod artefacts;
mod case;
mod case_id;
mod check;
mod collection;
mod compare;
mod error;
mod html;
mod limits;
mod raster;
mod report;
mod source;
mod starter;

pub use crate::case_id::CaseId;
pub use crate::raster::Aspect;
pub use crate::report::AspectReport;
pub use crate::report::CaseReport;
pub use crate::report::CheckReport;
pub use crate::report::Verdict;
pub use artefacts::Artefacts;
pub use case::Case;
pub use check::{Blessing, Change, Harness};
pub use collection::Collection;
pub use compare::{ColorDifference, Comparison, DepthDifference, Difference, Mismatch, Tolerance, compare};
pub use error::{GoldenError, PictureError};
pub use limits::MAX_FILE_BYTES;
pub use raster::{Raster, Samples};
pub use source::Source;
pub use starter::starter_case;
