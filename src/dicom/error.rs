//! Errors of a path, a file or a stack of slices.
//!
//! [`Error`] ends a call. [`Defect`] is a fault of one file: a warning when other files of the
//! series are good, an error when no file is good or under
//! [`Strictness::Strict`](super::Strictness::Strict). Messages name the place, the found and the
//! expected value. They contain file names and geometry, never the patient's identity.

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use dicom_core::Tag;

use super::causes::{ContainerError, DecodeError};
use relief_base::BudgetError;
use relief_volume::{GridError, VoxelCountError};

/// Why a series could not be found or loaded.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The path itself cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Unreadable {
        /// The path as given.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The path is an archive or index that cannot be used.
    #[error("cannot use {}: {source}", path.display())]
    Container {
        /// The path as given.
        path: PathBuf,
        /// The fault.
        source: ContainerError,
    },
    /// No CT slice was found.
    #[error("no CT slices in {}: looked at {files} file(s){reasons}", path.display())]
    NoSeries {
        /// The path as given.
        path: PathBuf,
        /// The number of files that were examined.
        files: usize,
        /// Why the first of them were not taken, one line each.
        reasons: Reasons,
    },
    /// There are several series, and none was chosen.
    #[error("{count} series found, expected one or the UID of one:{listing}")]
    SeveralSeries {
        /// Their number.
        count: usize,
        /// One line for each.
        listing: Reasons,
    },
    /// The chosen series is not there.
    #[error("no series has the UID {uid:?}; found:{listing}")]
    UnknownSeries {
        /// The requested UID.
        uid: String,
        /// One line for each series found.
        listing: Reasons,
    },
    /// No series has the chosen phase.
    #[error("no series has a phase {number}; found:{listing}")]
    NoPhase {
        /// The requested phase, from 1.
        number: usize,
        /// One line for each series found.
        listing: Reasons,
    },
    /// Strict reading met files that are defective.
    #[error("{count} file(s) cannot be used, and reading is strict:{reasons}")]
    Strict {
        /// Their number.
        count: usize,
        /// The faults of the first of them, one line each.
        reasons: Reasons,
    },
    /// No slice of the series could be decoded.
    #[error("none of the {slices} slices can be decoded:{reasons}")]
    NothingDecoded {
        /// The number of slices that were tried.
        slices: usize,
        /// The faults of the first of them, one line each.
        reasons: Reasons,
    },
    /// Many slices lie at the same positions: several images of one region under one series UID.
    #[error(
        "{duplicates} of {slices} slices share a position with another one (ImagePositionPatient (0020,0032)); \
         expected one slice per position. They may be phases, but no attribute gives each phase one slice per position \
         (TemporalPositionIdentifier (0020,0100), AcquisitionNumber (0020,0012), TriggerTime (0018,1060), AcquisitionTime \
         (0008,0032), ContentTime (0008,0033)). First: {first} and {second}"
    )]
    Ambiguous {
        /// Slices whose position another slice has already.
        duplicates: usize,
        /// All slices.
        slices: usize,
        /// The first slice of a pair.
        first: String,
        /// The second slice of that pair.
        second: String,
    },
    /// A regular grid over the slice positions would be far larger than the slices themselves.
    #[error(
        "the slice positions are too uneven for a regular grid: it would need {needed} voxels for the {given} that \
         were read (limit {limit}); check ImagePositionPatient (0020,0032)"
    )]
    TooUneven {
        /// Voxels of the regular grid.
        needed: u64,
        /// Voxels read.
        given: u64,
        /// Voxels allowed.
        limit: u64,
    },
    /// The volume is larger than [`LoadLimits`](super::LoadLimits) allow.
    #[error(
        "the volume needs {} MiB of memory, and {} MiB are allowed; choose a series of fewer or smaller slices",
        needed.div_ceil(1 << 20), allowed >> 20
    )]
    TooLarge {
        /// Bytes of its voxels, as the headers have it.
        needed: u64,
        /// Bytes allowed.
        allowed: u64,
    },
    /// There is not enough memory.
    #[error("{voxels} voxels need {} MiB of memory, which the system refused", voxels * 2 / (1 << 20))]
    Memory {
        /// Voxels wanted, two bytes each.
        voxels: u64,
    },
    /// The reading took more than it may, or was cancelled.
    #[error(transparent)]
    Budget(#[from] BudgetError),
    /// The geometry does not make a grid.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// The voxels do not fill the grid.
    #[error(transparent)]
    Voxels(#[from] VoxelCountError),
}

impl Error {
    /// The message with `subject` in place of the path.
    #[must_use]
    pub fn about(&self, subject: &str) -> String {
        match self {
            Self::Unreadable { source, .. } => format!("cannot read {subject}: {source}"),
            Self::Container { source, .. } => format!("cannot use {subject}: {source}"),
            Self::NoSeries { files, reasons, .. } => {
                format!("no CT slices in {subject}: looked at {files} file(s){reasons}")
            }
            other => other.to_string(),
        }
    }

    /// The message without paths, file names and UIDs of series, for reports and answers that others
    /// read: these may identify a patient. `subject` stands for the files.
    #[must_use]
    pub fn without_names(&self, subject: &str) -> String {
        match self {
            Self::Container { source: ContainerError::OutsideReference(_), .. } => {
                format!("cannot use {subject}: its DICOMDIR refers to files that are not below it")
            }
            Self::NoSeries { files, reasons, .. } => {
                format!("no CT slices among {files} file(s){}", reasons.without_names())
            }
            Self::SeveralSeries { count, .. } => format!("{count} series found, expected one"),
            Self::UnknownSeries { .. } => "the series is no longer there".to_owned(),
            Self::NoPhase { number, .. } => format!("no series has a phase {number}"),
            Self::Strict { count, reasons } => {
                let reasons = reasons.without_names();
                format!("{count} file(s) cannot be used, and reading is strict{reasons}")
            }
            Self::NothingDecoded { slices, reasons } => {
                format!("none of the {slices} slices can be decoded{}", reasons.without_names())
            }
            Self::Ambiguous { duplicates, slices, .. } => {
                format!("{duplicates} of {slices} slices share a position with another one")
            }
            other => other.about(subject),
        }
    }
}

/// Why files were not used, one line each; a message shows the first few.
#[derive(Clone, Debug, Default)]
pub struct Reasons(Vec<Reason>);

#[derive(Clone, Debug)]
struct Reason {
    /// The file or series that the line is about. It may name a patient.
    name: Option<String>,
    text: String,
}

impl Reasons {
    /// Lines about files or series: the name of each, and a message.
    pub(super) fn about(lines: impl IntoIterator<Item = (String, String)>) -> Self {
        Self(lines.into_iter().map(|(name, text)| Reason { name: Some(name), text }).collect())
    }

    /// Lines that name nothing.
    pub(super) fn plain(lines: impl IntoIterator<Item = String>) -> Self {
        Self(lines.into_iter().map(|text| Reason { name: None, text }).collect())
    }

    /// The first few different lines, without the names before them.
    fn without_names(&self) -> String {
        let mut texts: Vec<&str> = self.0.iter().map(|reason| reason.text.as_str()).collect();
        texts.sort_unstable();
        texts.dedup();
        texts.into_iter().take(SHOWN).map(|text| format!("\n  {text}")).collect()
    }
}

/// Most lines of [`Reasons`] in a message.
const SHOWN: usize = 8;

impl fmt::Display for Reasons {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for line in self.0.iter().take(SHOWN) {
            match &line.name {
                Some(name) => write!(f, "\n  {name}: {}", line.text)?,
                None => write!(f, "\n  {}", line.text)?,
            }
        }
        match self.0.len().saturating_sub(SHOWN) {
            0 => Ok(()),
            more => write!(f, "\n  and {more} more"),
        }
    }
}

/// A DICOM attribute as messages name it: keyword and tag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Attribute {
    pub(super) tag: Tag,
    pub(super) keyword: &'static str,
}

impl fmt::Display for Attribute {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.keyword, self.tag)
    }
}

/// Why the frames of a segmentation make no grid that can be held.
#[derive(Clone, Debug, thiserror::Error)]
pub enum FrameGridError {
    /// More voxels than allowed.
    #[error("found a grid of {dims:?} voxels, expected at most {allowed}")]
    TooLarge {
        /// Voxels along each side.
        dims: [usize; 3],
        /// Most voxels in all.
        allowed: u64,
    },
    /// The machine has no memory for it.
    #[error("there is no memory for {voxels} voxels")]
    NoMemory {
        /// Voxels in all.
        voxels: u64,
    },
    /// A tilted stack.
    #[error("frames do not lie straight above each other (a tilted stack), expected a regular grid")]
    Tilted,
    /// One slice, and nothing says how thick.
    #[error("found a single slice without SpacingBetweenSlices or SliceThickness, expected one")]
    NoThickness,
    /// Distances between frames that are no multiples of one.
    #[error("found frames at uneven distances (the least is {least_mm:.4} mm), expected multiples of one")]
    Uneven {
        /// The least distance, mm.
        least_mm: f64,
    },
    /// The grid is not valid.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// Labels of another number of voxels.
    #[error(transparent)]
    Labels(#[from] relief_volume::LabelCountError),
    /// Segments that cannot be laid over each other.
    #[error(transparent)]
    Layers(#[from] relief_volume::LayersError),
}

/// A fault of one file.
#[derive(Clone, Debug, thiserror::Error)]
pub enum Defect {
    /// Not DICOM at all.
    #[error("not a DICOM file: found {found}, expected \"DICM\" at byte 128 or a data set")]
    NotDicom {
        /// The first bytes, or a note that the file is empty.
        found: String,
    },
    /// The file that marks an interrupted transfer.
    #[error(
        "the transfer of this series has not ended or was interrupted, so slices may be missing; if it has ended, send it again"
    )]
    Interrupted,
    /// The system could not read it.
    #[error("cannot be read: {0}")]
    Unreadable(Arc<std::io::Error>),
    /// The file ends inside a header.
    #[error("cut short at byte {position}: found {found} bytes for {what}, expected {expected}")]
    Cut {
        /// The element or structure that was being read.
        what: &'static str,
        /// The place, in bytes from the start.
        position: u64,
        /// Bytes left.
        found: u64,
        /// Bytes needed.
        expected: u64,
    },
    /// The file ends inside a value.
    #[error("element {tag}: found {found} bytes, expected {expected} (the file is cut short)")]
    Short {
        /// The element.
        tag: Tag,
        /// Bytes left.
        found: u64,
        /// Bytes the element says it has.
        expected: u64,
    },
    /// A value is longer than any such attribute is.
    #[error("element {tag}: found {found} bytes, expected at most {limit}")]
    LongValue {
        /// The element.
        tag: Tag,
        /// Its length.
        found: u32,
        /// The longest that is read.
        limit: u32,
    },
    /// Sequences nest too deep.
    #[error("sequences are nested deeper than {limit} levels, expected at most {limit}")]
    Nesting {
        /// The limit.
        limit: u32,
    },
    /// More elements and items than any object has.
    #[error("its elements and items take more than {} MiB of memory", limit >> 20)]
    LargeDataSet {
        /// The limit in bytes.
        limit: u64,
    },
    /// The reading took more than it may, or was cancelled.
    #[error(transparent)]
    Budget(#[from] BudgetError),
    /// Something else where a sequence item belongs.
    #[error("found element {found} where a sequence item (FFFE,E000) is expected")]
    NotAnItem {
        /// The element found.
        found: Tag,
    },
    /// An attribute is missing or has an unusable value.
    #[error("{attribute}: found {found}, expected {expected}")]
    Attribute {
        /// The attribute.
        attribute: Attribute,
        /// The value.
        found: String,
        /// The expected content.
        expected: &'static str,
    },
    /// No Pixel Data.
    #[error("Pixel Data (7FE0,0010): missing, expected {expected}")]
    NoPixels {
        /// The expected content.
        expected: String,
    },
    /// Too few pixels.
    #[error("Pixel Data (7FE0,0010): found {found} bytes, expected {expected}")]
    FewPixels {
        /// Bytes there.
        found: u64,
        /// Bytes the image size asks for.
        expected: u64,
    },
    /// A larger frame than is ever decoded.
    #[error("found a frame of {rows} x {columns} pixels, expected at most {limit} pixels")]
    LargeFrame {
        /// Rows (0028,0010).
        rows: u32,
        /// Columns (0028,0011).
        columns: u32,
        /// The limit.
        limit: u64,
    },
    /// A zip entry that is larger than any that is unpacked.
    #[error("found a zip entry of {} MiB, expected at most {} MiB", found >> 20, limit >> 20)]
    LargeEntry {
        /// Bytes unpacked, as the zip's directory has it.
        found: u64,
        /// The limit in bytes.
        limit: u64,
    },
    /// Deflated data that unpacks to more than is read.
    #[error("the deflated data set unpacks to more than {} MiB", limit >> 20)]
    LargeInflated {
        /// The limit in bytes.
        limit: u64,
    },
    /// Frames that lie on no regular grid.
    #[error(transparent)]
    Frames(#[from] FrameGridError),
    /// A transfer syntax without a decoder.
    #[error("TransferSyntaxUID (0002,0010): found {found}, which {why}")]
    TransferSyntax {
        /// UID and name.
        found: String,
        /// Why it cannot be used.
        why: &'static str,
    },
    /// Compressed frames whose boundaries are unknown.
    #[error("found {fragments} fragments for {frames} frames and no offset table that divides them")]
    Fragments {
        /// Fragments found.
        fragments: usize,
        /// NumberOfFrames (0028,0008).
        frames: u32,
    },
    /// The compressed image says something else than the data set.
    #[error("the compressed image is {found}, but the data set says {expected}")]
    Codestream {
        /// The values of the codestream's own header.
        found: String,
        /// The size by Rows, Columns and SamplesPerPixel.
        expected: String,
    },
    /// The decoder gave up.
    #[error("the {codec} image cannot be decoded: {source}")]
    Codec {
        /// The decoder.
        codec: &'static str,
        /// Its error.
        source: DecodeError,
    },
}

impl From<std::io::Error> for Defect {
    fn from(error: std::io::Error) -> Self {
        Self::Unreadable(Arc::new(error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Invariant: Reasons in batch reports name no file and no UID.
    #[test]
    fn messages_without_names_have_none() {
        const NAME: &str = "DOE^JOHN";
        let (path, text) = (|| PathBuf::from("/archive").join(NAME), || NAME.to_owned());
        let lines = || Reasons::about([(format!("{NAME}/1.dcm"), "cut short".to_owned())]);
        for error in [
            Error::Unreadable { path: path(), source: std::io::ErrorKind::NotFound.into() },
            Error::Container { path: path(), source: ContainerError::OutsideReference(text()) },
            Error::Container { path: path(), source: ContainerError::NotAFile },
            Error::NoSeries { path: path(), files: 3, reasons: lines() },
            Error::SeveralSeries { count: 2, listing: lines() },
            Error::UnknownSeries { uid: text(), listing: lines() },
            Error::NoPhase { number: 3, listing: lines() },
            Error::Strict { count: 1, reasons: lines() },
            Error::NothingDecoded { slices: 4, reasons: lines() },
            Error::Ambiguous { duplicates: 1, slices: 2, first: text(), second: text() },
        ] {
            assert!(error.to_string().contains(NAME), "the message itself has it: {error}");
            let message = error.without_names("its files");
            assert!(!message.contains(NAME) && !message.is_empty(), "{message}");
        }
    }

    #[test]
    fn a_subject_takes_the_place_of_the_path() {
        let path = PathBuf::from("/tmp/relief-upload-1");
        let error = Error::Container { path, source: ContainerError::NoReferences };
        let expected = "cannot use the uploaded file: the DICOMDIR refers to no files";
        assert_eq!(error.about("the uploaded file"), expected);
    }
}
