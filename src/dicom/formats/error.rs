//! Reasons for refusing a file: the fault, its place, and the remedy.

use std::path::PathBuf;

use relief_base::OutOfRange;
use relief_volume::GridError;

/// Why a volume or a label map could not be read.
#[derive(Debug, thiserror::Error)]
pub enum FormatError {
    /// The system does not let it be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// It begins like none of the formats.
    #[error("this is neither NIfTI nor NRRD: it begins with {found}")]
    Unknown {
        /// The first bytes.
        found: String,
    },
    /// The compressed part is damaged.
    #[error("the compressed part is damaged: {0}")]
    Damaged(std::io::Error),
    /// A part of the header is missing or not understood.
    #[error(transparent)]
    Header(#[from] OutOfRange),
    /// The voxels do not span space.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// More voxels than allowed.
    #[error("the file has {needed} voxels, allowed: at most {allowed}")]
    TooLarge {
        /// The size by the header.
        needed: u64,
        /// The limit.
        allowed: u64,
    },
    /// The file ends too early.
    #[error("the voxels are cut short: found {found} bytes, expected {expected}")]
    Cut {
        /// Bytes that the header asks for.
        expected: u64,
        /// The number of existing bytes.
        found: u64,
    },
    /// A value that is no label, or no HU.
    #[error("voxel {index} is {found}, allowed: {allowed}")]
    Value {
        /// The voxel, counted in the file's order.
        index: u64,
        /// Its value.
        found: f64,
        /// The permitted values.
        allowed: &'static str,
    },
    /// Several values in each voxel of a volume.
    #[error("each voxel has {found} values; a volume has one (of a series of volumes, take one out first)")]
    Layers {
        /// The number of values.
        found: usize,
    },
    /// No memory for the voxels.
    #[error("the system refused memory for {0} voxels")]
    Memory(u64),
}

impl FormatError {
    /// The message with `subject` in place of the path.
    #[must_use]
    pub fn about(&self, subject: &str) -> String {
        match self {
            Self::Read { source, .. } => format!("cannot read {subject}: {source}"),
            other => other.to_string(),
        }
    }

    pub(super) fn header(key: &str, found: impl std::fmt::Display, allowed: impl Into<String>) -> Self {
        let found: String = found.to_string().chars().take(80).collect();
        OutOfRange::new(key, found, allowed).into()
    }
}
