//! Why a file has no transfer function.

use crate::TransferError;

/// Largest file that is read: a thousand colour maps.
pub const MAX_IMPORT_BYTES: usize = 16 << 20;

/// Why bytes did not become a transfer function.
#[derive(Debug, thiserror::Error)]
pub enum TransferImportError {
    /// None of the formats.
    #[error(
        "unknown file format, expected volume properties of 3D Slicer (XML, .vp, .vp.json), colour maps \
         of VTK and ParaView (JSON)"
    )]
    Unknown,
    /// More than is read.
    #[error("the file has more than {max} bytes", max = MAX_IMPORT_BYTES)]
    TooLarge,
    /// Not as its format has it.
    #[error("{place}: {source}")]
    Syntax {
        /// The place in the file.
        place: String,
        /// The fault at that place.
        source: TransferSyntaxError,
    },
    /// A number that cannot be.
    #[error("{place} is {found}, allowed: {allowed}")]
    Range {
        /// The place in the file.
        place: String,
        /// The value.
        found: String,
        /// The permitted values.
        allowed: String,
    },
    /// A choice is needed.
    #[error("the file contains {count} functions; choose one by name: {names}")]
    Several {
        /// Their number.
        count: usize,
        /// Their names, the first hundred.
        names: String,
    },
    /// A choice that is not there.
    #[error("the file contains no function named {wanted:?}; it contains {names}")]
    NoSuchName {
        /// The requested name.
        wanted: String,
        /// The existing names, the first hundred.
        names: String,
    },
    /// The points do not make a transfer function.
    #[error(transparent)]
    Transfer(#[from] TransferError),
}

/// A fault in the syntax of a file, or a value of another kind than its format has.
#[derive(Debug, thiserror::Error)]
pub enum TransferSyntaxError {
    /// Not JSON.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    /// Not XML.
    #[error(transparent)]
    Xml(#[from] quick_xml::Error),
    /// The bytes are not text.
    #[error(transparent)]
    Utf8(#[from] std::str::Utf8Error),
    /// More properties than are read.
    #[error("more than {0} properties")]
    TooManyProperties(usize),
    /// A file of a fixed number of lines ends early.
    #[error("the line of {0} is missing")]
    MissingLine(&'static str),
    /// A colour map without points.
    #[error("no RGBPoints; maps of categories are not read")]
    NoColorPoints,
    /// A function without points.
    #[error("no list of points")]
    NoPoints,
    /// A value is no list.
    #[error("not a list")]
    NotAList,
    /// A list has no elements.
    #[error("missing, or not a list of one or more")]
    EmptyList,
    /// A list has other elements than numbers.
    #[error("not a flat list of numbers")]
    NotNumbers,
    /// A value is no number.
    #[error("not a number")]
    NotANumber,
    /// A value has another count of numbers.
    #[error("{key} is not {count} number(s)")]
    Count {
        /// The key.
        key: &'static str,
        /// The expected count.
        count: usize,
    },
}

impl TransferImportError {
    pub(super) fn range(place: &str, found: &impl ToString, allowed: &str) -> Self {
        Self::Range { place: place.to_owned(), found: found.to_string(), allowed: allowed.to_owned() }
    }

    pub(super) fn syntax(place: &str, source: impl Into<TransferSyntaxError>) -> Self {
        Self::Syntax { place: place.to_owned(), source: source.into() }
    }
}
