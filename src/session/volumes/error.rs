//! Errors of the registry of volumes.

use std::error::Error;

use crate::JobError;

/// Voxels or a label map do not fit into memory, even after evicting everything that can be read again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{needed} bytes of voxels or labels are needed, and {available} are available beside those that stay; \
     allow more with --memory"
)]
pub struct MemoryFull {
    /// Bytes of the voxels or the label map.
    pub needed: u64,
    /// Bytes that are free after evicting everything that can be read again.
    pub available: u64,
}

/// An uploaded volume exceeds a limit.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum UploadRefused {
    /// The number of uploaded volumes has reached its limit.
    #[error("the limit of {0} uploaded volumes is reached; remove one with DELETE")]
    Count(usize),
    /// The voxels of all uploads would exceed their limit.
    #[error(
        "the volume has {needed} bytes of voxels, and {free} of {allowed} are free; remove one with DELETE"
    )]
    Bytes {
        /// Bytes of the new volume.
        needed: u64,
        /// Free bytes.
        free: u64,
        /// The limit.
        allowed: u64,
    },
    /// The voxels of all volumes would exceed the memory.
    #[error(transparent)]
    MemoryFull(#[from] MemoryFull),
}

/// A volume that a request names cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum VolumeError {
    /// No volume has this id.
    #[error("no volume has this id; GET /v1/volumes lists them")]
    UnknownId,
    /// No volume has been added yet.
    #[error("no volume is loaded")]
    NoVolume,
    /// No volume has this study and series UID.
    #[error("no volume of this study and series is served")]
    UnknownSeries,
    /// The operator added the volume.
    #[error("this volume was loaded at the start of the server; only uploaded volumes can be removed")]
    NotRemovable,
    /// The label map came with the volume, from the operator.
    #[error("the label map of this volume was loaded at the start of the server; uploads do not replace it")]
    OwnLabels,
    /// There is no room for a label map.
    #[error(transparent)]
    MemoryFull(#[from] MemoryFull),
}

/// The voxels of a volume could not be read again after their eviction.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// There is no room for them.
    #[error(transparent)]
    MemoryFull(#[from] MemoryFull),
    /// The files have other voxels than before.
    #[error("the files of this series have changed since the server was started")]
    Changed,
    /// The volume has no reader. Its voxels should never have left memory.
    #[error("the voxels were evicted, but the volume has no reader")]
    NoReader,
    /// The reader failed.
    #[error("reading the series again failed: {0}")]
    Reader(#[source] Box<dyn Error + Send + Sync>),
    /// The reader did not run.
    #[error(transparent)]
    Job(#[from] JobError),
}
