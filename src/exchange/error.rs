//! Reasons for refusing or not writing a file: the fault, its place, and the remedy.

use super::Format;
use relief_annotation::MeshFileError;
use relief_base::OutOfRange;
use relief_dicom::{Defect, ObjectError, ReportError, SegmentationError};

/// Why annotations could not be read from a file, or written to one.
#[derive(Debug, thiserror::Error)]
pub enum ExchangeError {
    /// The file is not of its format at all.
    #[error("{format}: {place}: {source}")]
    Syntax {
        /// The format.
        format: Format,
        /// The line, the byte or the JSON path.
        place: String,
        /// The fault at that place.
        source: SyntaxError,
    },
    /// A value is missing or not permitted.
    #[error("{format}: {place} is {found}, allowed: {allowed}")]
    Value {
        /// The format.
        format: Format,
        /// The line and column, or the JSON path.
        place: String,
        /// The value.
        found: String,
        /// The permitted values.
        allowed: String,
    },
    /// More than is taken.
    #[error("{format}: the file has {found} {what}, allowed: at most {allowed}")]
    TooLarge {
        /// The format.
        format: Format,
        /// The things that are too many or too large.
        what: &'static str,
        /// The number or size, as far as it was counted.
        found: u64,
        /// The limit.
        allowed: u64,
    },
    /// The format can represent none of the items.
    #[error("{format}: nothing is left to write: {reason}")]
    Nothing {
        /// The format wanted.
        format: Format,
        /// Why no item can be written.
        reason: NothingLeft,
    },
    /// The format is only for the other direction.
    #[error("{format} cannot be {action} (can be: {possible})")]
    OneWay {
        /// The format wanted.
        format: Format,
        /// `read` or `written`.
        action: &'static str,
        /// Formats that can.
        possible: String,
    },
    /// Something that the format needs was not given.
    #[error("{format} needs {what}")]
    Needs {
        /// The format wanted.
        format: Format,
        /// The missing input.
        what: &'static str,
    },
    /// A report that `dicom` refuses.
    #[error("sr: {0}")]
    Report(#[source] Box<ReportError>),
    /// An object that `dicom` does not read.
    #[error("seg: {0}")]
    Object(#[source] Box<Defect>),
    /// A segmentation that `dicom` does not write.
    #[error("seg: {0}")]
    Segmentation(#[source] Box<SegmentationError>),
    /// A structure set that `dicom` refuses.
    #[error("rtstruct: {0}")]
    StructureSet(#[source] Box<ObjectError>),
    /// A mesh that `mesh` does not read; the format is in its message.
    #[error("{0}")]
    Mesh(#[source] Box<MeshFileError>),
    /// The system gives no random numbers, and so no ids.
    #[error("cannot make ids: {0}")]
    Random(#[from] getrandom::Error),
}

impl ExchangeError {
    pub(super) fn value(
        format: Format,
        place: impl Into<String>,
        found: impl std::fmt::Display,
        allowed: impl Into<String>,
    ) -> Self {
        let found: String = found.to_string().chars().take(80).collect();
        Self::Value { format, place: place.into(), found, allowed: allowed.into() }
    }

    /// An item that a file describes is not as items are.
    pub(super) fn item(format: Format, place: &str, error: OutOfRange) -> Self {
        let place = format!("{place} ({})", error.path);
        Self::Value { format, place, found: error.found, allowed: error.allowed }
    }
}

/// A fault in the syntax of a file.
#[derive(Debug, thiserror::Error)]
pub enum SyntaxError {
    /// The bytes are not text.
    #[error("this is no text in UTF-8")]
    Utf8,
    /// Not JSON, or a value of another kind than the format has. serde quotes long values whole,
    /// so that this is no source.
    #[error("{}", shortened(.0))]
    Json(serde_json::Error),
    /// A row cannot be read or written.
    #[error(transparent)]
    Csv(#[from] csv::Error),
    /// Not XML.
    #[error(transparent)]
    Xml(#[from] quick_xml::Error),
    /// A character reference or a section of characters in place of a number.
    #[error("a number of a point is no plain text")]
    MarkedNumber,
    /// The file ends within an element.
    #[error("the file ends without </{0}>")]
    Unclosed(String),
    /// More elements within each other than are read.
    #[error("more than {0} elements within each other")]
    TooDeep(usize),
    /// A label map or mesh is invalid.
    #[error(transparent)]
    Content(Box<dyn std::error::Error + Send + Sync>),
}

impl From<serde_json::Error> for SyntaxError {
    fn from(error: serde_json::Error) -> Self {
        Self::Json(error)
    }
}

/// The first 300 characters of an error.
fn shortened(error: &serde_json::Error) -> String {
    error.to_string().chars().take(300).collect()
}

/// Why no item can be written.
#[derive(Debug, thiserror::Error)]
pub enum NothingLeft {
    /// There are no items.
    #[error("no items are there")]
    NoItems,
    /// All items belong to other phases of the series.
    #[error("all items belong to other phases of the series")]
    OtherPhases,
    /// The items are of other kinds than the format can represent.
    #[error("{format} holds {}; there are {}", holds.join(", "), found.join(", "))]
    Kinds {
        /// The format.
        format: Format,
        /// The kinds that it can represent.
        holds: &'static [&'static str],
        /// The kinds of the items, with their counts.
        found: Vec<String>,
    },
    /// There are no regions.
    #[error("there are no regions")]
    NoRegions,
    /// The regions lie beside the map.
    #[error("no region lies on the voxels of the map")]
    NoVoxels,
}
