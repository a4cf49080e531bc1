//! Series that lie in buckets, as copies in a folder of this machine: of bounded size, each whole
//! or absent.
//!
//! A copy is identified by its listing: names, sizes and tags of its objects. It is verified by the
//! hashes of its files at every use, and fetched again if it has changed; the least recently used
//! copies are removed first. Several programs may share a folder: readers hold a lock on a copy.
//!
//! Files of a copy are numbered: what objects are called may name patients.

#[cfg(feature = "cluster")]
mod fetched;
#[cfg(feature = "cluster")]
mod shelf;

use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::location::Location;

/// How copies are kept.
#[derive(Clone, Debug)]
pub struct CopiesOptions {
    /// Where; a temporary folder that goes with the last user of these copies where none is named.
    pub folder: Option<PathBuf>,
    /// Bytes that all copies together may have.
    pub bytes: u64,
    /// Address of the S3 service, before the environment's.
    pub endpoint: Option<String>,
}

/// Copies of series in buckets.
#[derive(Clone, Debug)]
pub struct Copies {
    #[cfg_attr(not(feature = "cluster"), expect(dead_code, reason = "there are no buckets"))]
    options: CopiesOptions,
    #[cfg(feature = "cluster")]
    state: Arc<std::sync::Mutex<fetched::State>>,
}

/// Files of this machine: a series' own, or a copy that stays while this lives.
#[derive(Clone, Debug)]
pub struct Local {
    path: PathBuf,
    /// The lock of a copy.
    _held: Option<Arc<std::fs::File>>,
}

impl Local {
    /// A folder or a file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Copies {
    /// None yet. The first use of a bucket creates it.
    #[must_use]
    pub fn new(options: CopiesOptions) -> Self {
        Self {
            options,
            #[cfg(feature = "cluster")]
            state: Arc::default(),
        }
    }

    /// The files that a path leads to: itself, or where it is `s3://BUCKET/KEY`, a copy of the
    /// object or of all that lies below. Must not be called inside an executor.
    ///
    /// # Errors
    /// When there is nothing, or more than copies may have; the service does not answer or refuses;
    /// the folder cannot be written.
    pub fn local(&self, path: &Path) -> std::io::Result<Local> {
        match location(path)? {
            Location::Local(path) => Ok(Local { path, _held: None }),
            #[cfg(feature = "cluster")]
            Location::Bucket { bucket, prefix } => self.copy(&bucket, &prefix),
            #[cfg(not(feature = "cluster"))]
            Location::Bucket { .. } => Err(no_buckets()),
        }
    }

    /// The places below a prefix of a bucket that may contain series: every folder, zip and volume
    /// file directly below it; or the prefix itself, if it is one object or contains slices
    /// directly. Sorted by name.
    ///
    /// # Errors
    /// When there is nothing, or the service does not answer or refuses.
    pub fn places(&self, root: &Path) -> std::io::Result<Vec<PathBuf>> {
        match location(root)? {
            Location::Local(path) => Ok(vec![path]),
            #[cfg(feature = "cluster")]
            Location::Bucket { bucket, prefix } => self.places_in(&bucket, &prefix),
            #[cfg(not(feature = "cluster"))]
            Location::Bucket { .. } => Err(no_buckets()),
        }
    }
}

fn location(path: &Path) -> std::io::Result<Location> {
    Location::of(path).map_err(|reason| Error::new(ErrorKind::InvalidInput, reason))
}

#[cfg(not(feature = "cluster"))]
fn no_buckets() -> Error {
    Error::new(
        ErrorKind::InvalidInput,
        "this program was built without the feature `cluster`: it reads no buckets",
    )
}
