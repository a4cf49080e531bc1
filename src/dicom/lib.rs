//! DICOM: from files of a CT series to a [`Volume`](relief_volume::Volume) in HU and patient LPS.
//!
//! [`discover()`] reads the headers of everything a path leads to (folder, file, DICOMDIR, zip) and groups CT slices
//! into series; [`load()`] decodes one of them. Slices are ordered and placed by ImagePositionPatient and
//! ImageOrientationPatient alone. Sheared (gantry-tilted) and unevenly spaced stacks are resampled on their true
//! positions, with a warning. Nothing is assumed silently: what is missing or unreadable is an error or a
//! [`Warning`]. Nothing panics on any bytes, and memory is bounded by file sizes or by limits stated where they apply.
//!
//! ```no_run
//! use relief::dicom::{self, Strictness};
//! # fn main() -> Result<(), dicom::Error> {
//! let found = dicom::discover("study".as_ref(), Strictness::Lenient, &|_| ())?;
//! let loaded = dicom::load(found.select(None)?, Strictness::Lenient, &|_| ())?;
//! println!("{:?} voxels, {:?} HU", loaded.volume.grid().dims(), loaded.volume.range_hu());
//! # Ok(()) }
//! ```
//!
//! The data set is walked by a reader of our own (`dataset`), since the pixels of 300 slices should be read once, and
//! a parser that recurses can be made to overflow the stack; codecs, dictionary and transfer syntaxes are dicom-rs's.
//!
//! What it is not: a DICOM toolkit. Objects other than CT images are listed as skipped;
//! segmentation objects become label maps when they are asked for.

mod attributes;
mod batches;
mod charset;
mod codec;
mod codestream;
mod dataset;
mod discover;
mod entropy;
mod error;
mod fingerprint;
pub mod formats;
mod groups;
mod header;
mod identity;
mod jpeg_dct;
mod load;
mod object;
mod part10;
mod pixels;
mod reference;
pub mod report;
mod resample;
mod segmentation;
mod segmentation_write;
mod series;
mod source;
mod stack;
pub mod structure_set;
mod warnings;
mod whole;
pub mod write;

pub use discover::{Discovery, Skipped, Strictness, discover};
pub use error::{Attribute, Defect, Error, Reasons};
pub use identity::SeriesIdentity;
pub use load::{LoadLimits, Loaded, Progress, Stage, load, load_within};
pub use reference::SeriesReference;
pub use segmentation::{
    LoadedLayers, LoadedSegmentation, load_segmentation, read_segmentation, read_segmentation_layers,
};
pub use segmentation_write::{
    SegmentMeaning, SegmentationError, SegmentationOptions, write_segmentation, write_segmentation_layers,
};
pub use series::SeriesEntry;
pub use warnings::{Warning, WarningCode};
pub use whole::ObjectError;
