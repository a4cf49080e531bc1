//! Structures from annotations: growing from a seed, filling between contours, painting.
//!
//! [`grow_region()`] collects voxels that are connected to seeds and have values in a range, within
//! limits against leaks. [`fill_contours()`] fills closed curves on several levels.
//! [`paint_strokes()`] adds and removes balls. [`refine_region()`] smooths a region, fills its holes or
//! keeps its largest part. All of them make or change a
//! [`Mask`](relief_volume::Mask), which `Mask::to_labels` converts to a label map. There is no
//! learning and no automatic threshold for whole organs: users choose the places.
//!
//! Spaces: patient LPS mm in, voxels of the volume's grid out. Values in HU. Voxels are neighbours
//! where they share a face.
//!
//! Equal input gives equal voxels, whatever the number of threads. Memory: bits, one for each voxel
//! and mask, at most four masks at once; of `fill_contours` besides the rasters of its levels (see
//! there).

mod ball;
mod contours;
mod fill;
mod flood;
mod grow;
mod paint;
mod refine;

pub use contours::{Contour, FillError};
pub use fill::fill_contours;
pub use grow::{Grow, GrowError, GrowLimits, GrowProgress, GrowStage, GrownRegion, GrowthEnd, grow_region};
pub use paint::{Stroke, paint_strokes};
pub use refine::{RefineStep, refine_region};
