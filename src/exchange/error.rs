//! Reasons for refusing or not writing a file: the fault, its place, and the remedy.

use super::Format;
use relief_annotation::{ItemError, MeshFileError};
use relief_dicom::{Defect, ObjectError, ReportError, SegmentationError};

/// Why annotations could not be read from a file, or written to one.
#[derive(Debug, thiserror::Error)]
pub enum ExchangeError {
    /// The file is not of its format at all.
    #[error("{format}: {place}: {message}")]
    Syntax {
        /// The format.
        format: Format,
        /// The line, the byte or the JSON path.
        place: String,
        /// The parser's message.
        message: String,
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
        /// How much there is, as far as it was counted.
        found: u64,
        /// The limit.
        allowed: u64,
    },
    /// The format can represent none of the items.
    #[error("{format}: nothing is left to write: {why}")]
    Nothing {
        /// The format wanted.
        format: Format,
        /// The kinds that the format can represent, and the given ones.
        why: String,
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
    pub(super) fn item(format: Format, place: &str, error: ItemError) -> Self {
        let place = format!("{place} ({})", error.path);
        Self::Value { format, place, found: error.found, allowed: error.allowed }
    }
}
