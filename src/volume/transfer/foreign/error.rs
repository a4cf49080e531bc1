//! Why a file has no transfer function.

use crate::TransferError;

/// Largest file that is read: a thousand colour maps.
pub const MAX_IMPORT_BYTES: usize = 16 << 20;

/// Why bytes did not become a transfer function.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
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
    #[error("{place}: {reason}")]
    Syntax {
        /// Where in the file.
        place: String,
        /// The fault at that place.
        reason: String,
    },
    /// A number that cannot be.
    #[error("{place} is {found}, allowed: {allowed}")]
    Range {
        /// Where in the file.
        place: String,
        /// The value.
        found: String,
        /// The permitted values.
        allowed: String,
    },
    /// A choice is needed.
    #[error("the file contains {count} functions; choose one by name: {names}")]
    Several {
        /// How many.
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

impl TransferImportError {
    pub(super) fn range(place: &str, found: &impl ToString, allowed: &str) -> Self {
        Self::Range { place: place.to_owned(), found: found.to_string(), allowed: allowed.to_owned() }
    }

    pub(super) fn syntax(place: &str, reason: &impl ToString) -> Self {
        Self::Syntax { place: place.to_owned(), reason: reason.to_string() }
    }
}
