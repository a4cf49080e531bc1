//! Causes of [`Error`](super::Error) and [`Defect`](super::Defect) with values of their own: files
//! that contain files, and compressed images.

use std::error::Error;
use std::sync::Arc;

/// Why a zip archive, a DICOMDIR or a folder cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ContainerError {
    /// A pipe or device: opening it could wait for its writer.
    #[error("it is neither a file nor a folder")]
    NotAFile,
    /// The zip archive is larger than any that is read.
    #[error("found a zip of {found_mib} MiB, expected at most {most_mib}")]
    LargeZip {
        /// Size of the archive, MiB.
        found_mib: u64,
        /// The limit, MiB.
        most_mib: u64,
    },
    /// The zip archive is damaged.
    #[error(transparent)]
    Zip(#[from] zip::result::ZipError),
    /// Two entries of the zip archive share bytes, so it could unpack to any size.
    #[error("its entries overlap at byte {0}")]
    Overlap(u64),
    /// The DICOMDIR has no record of a file.
    #[error("the DICOMDIR refers to no files")]
    NoReferences,
    /// The DICOMDIR refers to a file outside of its folder (forbidden by PS3.10, 8.5).
    #[error("ReferencedFileID (0004,1500): found {0:?}, expected a path below it")]
    OutsideReference(String),
    /// There are more files or folders than are looked at.
    #[error("found more than {most} {what}; choose a folder nearer to the series")]
    TooMany {
        /// The limit.
        most: usize,
        /// `files` or `folders`.
        what: &'static str,
    },
}

/// Why a compressed image or data set cannot be decoded.
#[derive(Clone, Debug, thiserror::Error)]
pub enum DecodeError {
    /// The codestream does not begin with a header.
    #[error("found no image header")]
    NoHeader,
    /// A deflated image has more samples than the data set says.
    #[error("it unpacks to more than the {expected} bytes of the image")]
    TooLong {
        /// Bytes of the image by Rows, Columns and BitsAllocated.
        expected: u64,
    },
    /// The decoder panicked.
    #[error("the decoder gave up on damaged data")]
    Panicked,
    /// The decoder reports an error.
    #[error("{}", with_causes(&**.0))]
    Decoder(Arc<dyn Error + Send + Sync>),
}

impl DecodeError {
    pub(super) fn decoder(error: impl Error + Send + Sync + 'static) -> Self {
        Self::Decoder(Arc::new(error))
    }
}

fn with_causes(error: &(dyn Error + 'static)) -> String {
    let causes = std::iter::successors(error.source(), |cause| Error::source(*cause));
    causes.fold(error.to_string(), |message, cause| format!("{message}: {cause}"))
}
