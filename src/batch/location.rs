//! The places of series and outputs, as in options and manifests: a path of this machine,
//! `s3://BUCKET/PREFIX`, or for series `dicomweb+https://HOST/ROOT/...`.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use relief_archive::{AddressError, ArchiveAddress, SCHEME as ARCHIVE_SCHEME};

/// Endings of files that are a series each.
pub(super) const SERIES_ENDINGS: [&str; 4] = [".zip", ".nii", ".nii.gz", ".nrrd"];

/// A place on this machine, in a bucket or in an archive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Location {
    /// A file or a folder.
    Local(PathBuf),
    /// A bucket of an S3 service, and the common prefix of its objects' names, which may be empty.
    Bucket {
        /// Its name.
        bucket: String,
        /// Without a slash at its ends.
        prefix: String,
    },
    /// Series of a DICOM archive.
    Archive(ArchiveAddress),
}

/// Why a text is no location.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LocationError {
    /// Nothing was given.
    #[error("allowed: a folder")]
    Empty,
    /// The name cannot be a bucket's.
    #[error("{name:?} is not a valid bucket name; write s3://BUCKET or s3://BUCKET/PREFIX")]
    Bucket {
        /// The name.
        name: String,
    },
    /// The address cannot be an archive's.
    #[error(transparent)]
    Archive(#[from] AddressError),
}

const SCHEME: &str = "s3://";

impl Location {
    /// Parses a path: `s3://` begins the address of a bucket, `dicomweb+` that of an archive.
    ///
    /// # Errors
    /// When it begins so and names no bucket or archive.
    pub fn of(path: &Path) -> Result<Self, LocationError> {
        match path.to_str().filter(|_| Self::is_remote(path)) {
            Some(text) => text.parse(),
            None => Ok(Self::Local(path.to_owned())),
        }
    }

    /// Whether a path says that it is in a bucket or in an archive.
    #[must_use]
    pub fn is_remote(path: &Path) -> bool {
        path.to_str().is_some_and(|text| text.starts_with(SCHEME) || text.starts_with(ARCHIVE_SCHEME))
    }

    /// The name of a path for logs and messages: of an archive no study, series or query.
    #[must_use]
    pub fn public_name(path: &Path) -> String {
        match Self::of(path) {
            Ok(Self::Archive(address)) => address.public_name(),
            Err(LocationError::Archive(_)) => ARCHIVE_SCHEME.to_owned() + "...",
            _ => path.display().to_string(),
        }
    }
}

impl FromStr for Location {
    type Err = LocationError;

    fn from_str(text: &str) -> Result<Self, LocationError> {
        if text.starts_with(ARCHIVE_SCHEME) {
            return Ok(Self::Archive(text.parse()?));
        }
        let Some(rest) = text.strip_prefix(SCHEME) else {
            return if text.is_empty() { Err(LocationError::Empty) } else { Ok(Self::Local(text.into())) };
        };
        let (bucket, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        let is_good =
            |letter: char| letter.is_ascii_lowercase() || letter.is_ascii_digit() || "-.".contains(letter);
        if !(3..=63).contains(&bucket.len()) || !bucket.chars().all(is_good) {
            return Err(LocationError::Bucket { name: bucket.to_owned() });
        }
        Ok(Self::Bucket { bucket: bucket.to_owned(), prefix: prefix.trim_matches('/').to_owned() })
    }
}

impl std::fmt::Display for Location {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Local(path) => path.display().fmt(f),
            Self::Bucket { bucket, prefix } if prefix.is_empty() => write!(f, "{SCHEME}{bucket}"),
            Self::Bucket { bucket, prefix } => write!(f, "{SCHEME}{bucket}/{prefix}"),
            Self::Archive(address) => address.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn locations_are_paths_or_buckets() {
        let bucket =
            |bucket: &str, prefix: &str| Location::Bucket { bucket: bucket.into(), prefix: prefix.into() };
        for (text, expected, again) in [
            ("views", Location::Local("views".into()), "views"),
            ("s3://ct-views", bucket("ct-views", ""), "s3://ct-views"),
            ("s3://ct.views/a/b/", bucket("ct.views", "a/b"), "s3://ct.views/a/b"),
        ] {
            let location: Location = text.parse().unwrap();
            assert_eq!((&location, location.to_string().as_str()), (&expected, again));
            assert_eq!(Location::of(Path::new(text)), Ok(expected));
        }
        let archive = "dicomweb+https://ct/rs/studies/1.2/series/3.4";
        let location = Location::of(Path::new(archive)).unwrap();
        assert!(matches!(location, Location::Archive(_)) && location.to_string() == archive);
        assert_eq!(Location::public_name(Path::new(archive)), "a series of dicomweb+https://ct/rs");
        for text in [
            "",
            "dicomweb+",
            "dicomweb+https://ct/rs/studies/a",
            "s3://",
            "s3:///a",
            "s3://Views/a",
            "s3://user:key@views",
        ] {
            assert!(text.parse::<Location>().is_err(), "{text}");
        }
    }
}
