//! The destination of outputs: a folder, or a bucket of an S3 service. Each of them appears whole
//! or not at all.
//!
//! Outputs are named by paths such as `SERIES/VIEW.color.png`, with `/` on every system.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
#[cfg(feature = "buckets")]
use std::sync::Arc;

use bytes::Bytes;

#[cfg(feature = "buckets")]
use super::bucket::Bucket;
use crate::output_file::OutputFile;
use relief_base::sha256_of_file;
use relief_base::{read_at_most, write_whole};

/// The destination of outputs.
#[derive(Clone, Debug)]
pub enum Sink {
    /// A folder, which is made when the first output comes.
    Folder(PathBuf),
    /// A bucket of an S3 service.
    #[cfg(feature = "buckets")]
    Bucket(Arc<Bucket>),
}

impl Sink {
    /// Creates the folder, or checks that the bucket exists and is readable.
    pub(super) fn prepare(&self) -> std::io::Result<()> {
        match self {
            Self::Folder(folder) => std::fs::create_dir_all(folder),
            #[cfg(feature = "buckets")]
            Self::Bucket(bucket) => bucket.check(),
        }
    }

    /// Writes an output, replacing an existing one.
    pub(super) fn put(&self, name: &str, bytes: impl Into<Bytes>) -> std::io::Result<()> {
        let bytes = bytes.into();
        match self {
            Self::Folder(folder) => put_in(folder, name, &bytes),
            #[cfg(feature = "buckets")]
            Self::Bucket(bucket) => bucket.put(name, bytes, None),
        }
    }

    /// As [`Sink::put`], of bytes whose hash is known.
    #[cfg_attr(not(feature = "buckets"), expect(unused_variables, reason = "folders keep no hashes"))]
    #[cfg_attr(
        not(feature = "buckets"),
        expect(clippy::needless_pass_by_value, reason = "buckets keep them")
    )]
    pub(super) fn put_written(
        &self,
        name: &str,
        bytes: Vec<u8>,
        written: &OutputFile,
    ) -> std::io::Result<()> {
        match self {
            Self::Folder(folder) => put_in(folder, name, &bytes),
            #[cfg(feature = "buckets")]
            Self::Bucket(bucket) => bucket.put(name, bytes.into(), Some(&written.sha256)),
        }
    }

    /// Writes an output unless there is one already; whether it did. In a folder the last one to
    /// come wins instead.
    #[cfg_attr(
        not(feature = "buckets"),
        expect(clippy::needless_pass_by_value, reason = "buckets keep them")
    )]
    pub(super) fn put_new(&self, name: &str, bytes: Bytes) -> std::io::Result<bool> {
        match self {
            Self::Folder(folder) => put_in(folder, name, &bytes).map(|()| true),
            #[cfg(feature = "buckets")]
            Self::Bucket(bucket) => bucket.put_new(name, bytes),
        }
    }

    /// Reads an output; `None` if it does not exist or is larger than this many bytes.
    pub fn read(&self, name: &str, largest: u64) -> std::io::Result<Option<Vec<u8>>> {
        match self {
            Self::Folder(folder) => match read_at_most(&folder.join(name), largest) {
                Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
                read => read,
            },
            #[cfg(feature = "buckets")]
            Self::Bucket(bucket) => bucket.read(name, largest),
        }
    }

    /// Whether there is an output of this name.
    #[must_use]
    pub fn has(&self, name: &str) -> bool {
        match self {
            Self::Folder(folder) => folder.join(name).exists(),
            #[cfg(feature = "buckets")]
            Self::Bucket(bucket) => bucket.has(name),
        }
    }

    /// Whether an output exists and has these bytes.
    pub(super) fn holds(&self, name: &str, written: &OutputFile) -> bool {
        match self {
            Self::Folder(folder) => {
                let path = folder.join(name);
                let has_length = std::fs::metadata(&path).is_ok_and(|found| found.len() == written.bytes);
                has_length && sha256_of_file(&path).is_ok_and(|found| found == written.sha256)
            }
            #[cfg(feature = "buckets")]
            Self::Bucket(bucket) => bucket.holds(name, written),
        }
    }

    /// Removes an output if it exists.
    #[cfg(feature = "queue")]
    pub(super) fn remove(&self, name: &str) -> std::io::Result<()> {
        match self {
            Self::Folder(folder) => match std::fs::remove_file(folder.join(name)) {
                Err(error) if error.kind() != ErrorKind::NotFound => Err(error),
                _ => Ok(()),
            },
            #[cfg(feature = "buckets")]
            Self::Bucket(bucket) => bucket.remove(name),
        }
    }
}

fn put_in(folder: &Path, name: &str, bytes: &[u8]) -> std::io::Result<()> {
    let path = folder.join(name);
    path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
    write_whole(&path, bytes)
}
