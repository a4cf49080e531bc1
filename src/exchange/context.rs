//! The inputs of a conversion beside the bytes or items, and its result.

use relief_annotation::{ContentId, FrameOfReference, Item};
use relief_dicom::{SeriesReference, WarningCode};
use relief_volume::Grid;

use crate::LeftOut;

/// Values of items that a file does not contain.
#[derive(Clone, Copy, Debug)]
pub struct ReadContext<'a> {
    /// Author of the items if the file names none.
    pub author: &'a str,
    /// The set that they come into.
    pub set: &'a str,
    /// The list that they are, where the file does not say: the file's name without its extension.
    pub list: &'a str,
    /// The origin and axes of their coordinates.
    pub frame_of_reference: Option<&'a FrameOfReference>,
    /// The volume that they belong to: points outside of it are warned of.
    pub grid: Option<&'a Grid>,
    /// The DICOM series that they belong to: a report may have places in its images.
    pub series: Option<&'a SeriesReference>,
}

impl ReadContext<'_> {
    /// Voxels that the layers of a label map may have together: sixteen for each of the volume's
    /// where there is one, and at least 16 million.
    pub(crate) fn most_voxels(&self) -> u64 {
        const LEAST: u64 = 1 << 24;
        let of_volume = |grid: &Grid| (grid.voxel_count() as u64).saturating_mul(16).max(LEAST);
        self.grid.map_or(1 << 31, of_volume)
    }
}

/// Data that items refer to but do not contain.
#[derive(Clone, Copy)]
pub struct WriteContext<'a> {
    /// The bytes of a content: regions and meshes are these.
    pub contents: &'a dyn Fn(&ContentId) -> Option<Vec<u8>>,
    /// The voxels that a label map is to have; those of the first region otherwise.
    pub grid: Option<&'a Grid>,
    /// The DICOM series that they belong to: reports and segmentations are about one.
    pub series: Option<&'a SeriesReference>,
    /// The phase of the series, from 1: items of other phases are left out.
    pub phase: Option<usize>,
    /// Warnings of reading the series: DICOM segmentations carry them as a comment.
    pub warnings: &'a [WarningCode],
}

/// The content of a file.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The items, valid, with the ids of the file where it has ours.
    pub items: Vec<Item>,
    /// The contents that they refer to: name, media type, bytes.
    pub contents: Vec<(ContentId, String, Vec<u8>)>,
    /// Anomalies and omissions, as sentences.
    pub warnings: Vec<String>,
}

/// A file.
#[derive(Clone, Debug)]
pub struct ExportedFile {
    /// Its bytes.
    pub bytes: Vec<u8>,
    /// The number of its items.
    pub items: usize,
    /// The values that it cannot represent.
    pub left_out: Vec<LeftOut>,
}
