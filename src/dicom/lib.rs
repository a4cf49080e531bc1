//! DICOM: from files of a CT series to a [`Volume`](relief_volume::Volume) in HU and patient LPS.
//!
//! [`discover()`] reads the headers of all files of a path (folder, file, DICOMDIR, zip) and groups
//! CT slices into series; [`load()`] decodes one of them. Slices are ordered and placed by
//! ImagePositionPatient and ImageOrientationPatient only. Sheared (gantry-tilted) and unevenly
//! spaced stacks are resampled on their true positions, with a warning. Nothing is assumed
//! silently: a missing or unreadable value is an error or a [`Warning`]. Nothing panics on any
//! bytes, and memory is bounded by file sizes or by documented limits.
//!
//! ```no_run
//! use relief_dicom::{Error, Strictness, discover, load};
//! # fn main() -> Result<(), Error> {
//! let found = discover("study".as_ref(), Strictness::Lenient, &|_| ())?;
//! let loaded = load(found.select(None)?, Strictness::Lenient, &|_| ())?;
//! println!("{:?} voxels, {:?} HU", loaded.volume.grid().dims(), loaded.volume.range_hu());
//! # Ok(()) }
//! ```
//!
//! The data set is walked by a reader of our own (`dataset`), since the pixels of 300 slices should
//! be read once, and a parser that recurses can be made to overflow the stack; codecs, dictionary
//! and transfer syntaxes are dicom-rs's.
//!
//! This crate is not a DICOM toolkit. Objects other than CT images are listed as skipped;
//! segmentation objects are read as label maps on request.

mod attributes;
mod batches;
mod capture;
mod causes;
mod charset;
mod codec;
mod codestream;
mod commitment;
mod dataset;
mod discover;
mod distinctions;
mod entropy;
mod error;
mod file_bytes;
mod fingerprint;
mod formats;
mod grouping;
mod groups;
mod header;
mod identity;
mod jpeg_dct;
mod labelmap_write;
mod load;
mod object;
mod part10;
mod pixels;
mod progress;
mod reference;
mod report;
mod resample;
mod rle;
mod segmentation;
mod segmentation_write;
mod series;
mod source;
mod stack;
mod stored;
mod structure_set;
mod vr;
mod warnings;
mod whole;
mod write;

pub use crate::progress::Progress;
pub use crate::progress::Stage;
pub use capture::{CaptureError, CaptureOptions, CapturedPicture, join_captures, write_capture};
pub use causes::{ContainerError, DecodeError};
pub use commitment::{
    COMMITMENT_TRANSFER_SYNTAXES, CommitmentRequest, CommitmentResult, ReferencedObject,
    read_commitment_request, write_commitment_result,
};
pub use discover::{Discovery, INTERRUPTED, Skipped, Strictness, discover, discover_within};
pub use error::{Attribute, Defect, Error, FrameGridError, Reasons};
pub use identity::SeriesIdentity;
pub use labelmap_write::write_label_map;
pub use load::{LoadLimits, Loaded, load, load_within};
pub use reference::{SeriesReference, deidentified_uid};
pub use segmentation::{
    LoadedLayers, LoadedSegmentation, load_segmentation, read_segmentation, read_segmentation_layers,
};
pub use segmentation_write::{
    SegmentMeaning, SegmentationError, SegmentationOptions, write_segmentation, write_segmentation_layers,
};
pub use series::{Phase, SeriesEntry};
pub use warnings::{Warning, WarningCode};
pub use whole::ObjectError;

pub use formats::{
    FormatError, FormatLimits, ReadLabels, ReadLayers, ReadVolume, is_volume_file, read_grid,
    read_label_layers_of_bytes, read_labels, read_labels_of_bytes, read_labels_within, read_volume,
    read_volume_within, write_nifti_labels, write_seg_nrrd, write_seg_nrrd_layers,
};
pub use report::{
    LeftOut, ReadReport, ReportError, ReportReadOptions, ReportWriteOptions, UnreportableItem, WrittenReport,
    read_report, write_report,
};
pub use stored::{
    FileAroundError, ObjectIdentity, ObjectParts, READ_SOP_CLASSES, READ_TRANSFER_SYNTAXES, file_around,
    parts_of, read_identity, read_identity_of_file,
};
pub use structure_set::{Contour, ContourShape, Structure, StructureSet, read_structure_set};
pub use write::{ExistingFolder, SeriesFolder, SeriesLabels, WriteError, slice_file_name};
