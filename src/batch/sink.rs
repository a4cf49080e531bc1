//! Where outputs go: a folder, or a bucket of an S3 service. Each of them appears whole or not at all.
//!
//! Outputs are named by paths such as `SERIES/VIEW.color.png`, with `/` on every system.

use std::path::{Path, PathBuf};
use std::str::FromStr;
#[cfg(feature = "cluster")]
use std::sync::Arc;

#[cfg(feature = "cluster")]
use super::bucket::Bucket;
use super::files::{read_at_most, write_whole};
use super::record::Written;
use super::source::file_sha256;

/// Where outputs go.
#[derive(Clone, Debug)]
pub enum Sink {
    /// A folder, which is made when the first output comes.
    Folder(PathBuf),
    /// A bucket of an S3 service.
    #[cfg(feature = "cluster")]
    Bucket(Arc<Bucket>),
}

/// Where outputs are to go, as an option says it: a folder's path, or `s3://BUCKET/PREFIX`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SinkName {
    /// A folder.
    Folder(PathBuf),
    /// A bucket and what the names of all outputs in it begin with; that may be empty.
    Bucket {
        /// Its name.
        bucket: String,
        /// Without a slash at its ends.
        prefix: String,
    },
}

impl FromStr for SinkName {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let Some(rest) = text.strip_prefix("s3://") else {
            return if text.is_empty() {
                Err("allowed: a folder".to_owned())
            } else {
                Ok(Self::Folder(text.into()))
            };
        };
        let (bucket, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        let is_good =
            |letter: char| letter.is_ascii_lowercase() || letter.is_ascii_digit() || "-.".contains(letter);
        if !(3..=63).contains(&bucket.len()) || !bucket.chars().all(is_good) {
            return Err(format!(
                "{bucket:?} is no name of a bucket; write s3://BUCKET or s3://BUCKET/PREFIX"
            ));
        }
        Ok(Self::Bucket { bucket: bucket.to_owned(), prefix: prefix.trim_matches('/').to_owned() })
    }
}

impl std::fmt::Display for SinkName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Folder(folder) => folder.display().fmt(f),
            Self::Bucket { bucket, prefix } if prefix.is_empty() => write!(f, "s3://{bucket}"),
            Self::Bucket { bucket, prefix } => write!(f, "s3://{bucket}/{prefix}"),
        }
    }
}

impl Sink {
    /// The folder that it is, if it is one.
    #[must_use]
    pub fn folder(&self) -> Option<&Path> {
        match self {
            Self::Folder(folder) => Some(folder),
            #[cfg(feature = "cluster")]
            Self::Bucket(_) => None,
        }
    }

    /// Makes the folder, or sees that the bucket is there and may be read.
    pub(super) fn prepare(&self) -> std::io::Result<()> {
        match self {
            Self::Folder(folder) => std::fs::create_dir_all(folder),
            #[cfg(feature = "cluster")]
            Self::Bucket(bucket) => bucket.check(),
        }
    }

    /// Writes an output over one that is there.
    pub(super) fn put(&self, name: &str, bytes: &[u8]) -> std::io::Result<()> {
        match self {
            Self::Folder(folder) => {
                let path = folder.join(name);
                path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
                write_whole(&path, bytes)
            }
            #[cfg(feature = "cluster")]
            Self::Bucket(bucket) => bucket.put(name, bytes),
        }
    }

    /// Writes an output unless there is one already; whether it did. In a folder the last one to come wins instead.
    pub(super) fn put_new(&self, name: &str, bytes: &[u8]) -> std::io::Result<bool> {
        match self {
            Self::Folder(_) => self.put(name, bytes).map(|()| true),
            #[cfg(feature = "cluster")]
            Self::Bucket(bucket) => bucket.put_new(name, bytes),
        }
    }

    /// Reads an output; `None` where there is none, or one larger than this many bytes.
    pub(super) fn read(&self, name: &str, largest: u64) -> Option<Vec<u8>> {
        match self {
            Self::Folder(folder) => read_at_most(&folder.join(name), largest).ok().flatten(),
            #[cfg(feature = "cluster")]
            Self::Bucket(bucket) => bucket.read(name, largest),
        }
    }

    /// Whether an output is there and has these bytes.
    pub(super) fn holds(&self, name: &str, written: &Written) -> bool {
        match self {
            Self::Folder(folder) => {
                let path = folder.join(name);
                let has_length = std::fs::metadata(&path).is_ok_and(|found| found.len() == written.bytes);
                has_length && file_sha256(&path).is_ok_and(|found| found == written.sha256)
            }
            #[cfg(feature = "cluster")]
            Self::Bucket(bucket) => bucket.holds(name, written),
        }
    }

    /// Removes an output, if it is there.
    #[cfg(feature = "cluster")]
    pub(super) fn remove(&self, name: &str) -> std::io::Result<()> {
        match self {
            Self::Folder(folder) => match std::fs::remove_file(folder.join(name)) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error),
                _ => Ok(()),
            },
            Self::Bucket(bucket) => bucket.remove(name),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_sinks_are_folders_or_buckets() {
        let bucket =
            |bucket: &str, prefix: &str| SinkName::Bucket { bucket: bucket.into(), prefix: prefix.into() };
        for (text, expected, again) in [
            ("views", SinkName::Folder("views".into()), "views"),
            ("s3://ct-views", bucket("ct-views", ""), "s3://ct-views"),
            ("s3://ct.views/a/b/", bucket("ct.views", "a/b"), "s3://ct.views/a/b"),
        ] {
            let name: SinkName = text.parse().unwrap();
            assert_eq!((&name, name.to_string().as_str()), (&expected, again));
        }
        for text in ["", "s3://", "s3:///a", "s3://Views/a", "s3://user:key@views"] {
            assert!(text.parse::<SinkName>().is_err(), "{text}");
        }
    }
}
