//! Series in a bucket: listing below a prefix, and download into files.
//!
//! Names of objects may be names of patients, so no error contains one.

use std::io::{Error, ErrorKind};
use std::ops::Range;
use std::path::PathBuf;

use data_encoding::HEXLOWER;
use futures_util::{StreamExt, TryStreamExt, stream};
use object_store::path::Path;
use object_store::{GetOptions, GetRange, ObjectMeta, ObjectStore};
use sha2::{Digest, Sha256};
use tokio::io::AsyncWriteExt;

use super::{Bucket, SHA256};

/// An object that was listed: its name, size and tag.
pub(crate) type Object = ObjectMeta;

/// The objects and folders directly below a prefix.
pub(crate) struct PrefixListing {
    /// Longer prefixes.
    pub(crate) folders: Vec<String>,
    /// Those that are not empty.
    pub(crate) objects: Vec<Object>,
}

/// Most objects of one series: as many as a folder may have files.
const MOST_OBJECTS: usize = 200_000;
/// Bytes that one request asks for: no object has to come within a request's time.
const PART: u64 = 8 << 20;
/// Objects that are fetched at a time.
const AT_ONCE: usize = 8;
/// Longest text of an error of the service, characters.
const LONGEST: usize = 200;

impl Bucket {
    /// The objects and folders directly below a prefix, sorted by name.
    pub(crate) fn directly_below(&self, prefix: &str) -> std::io::Result<PrefixListing> {
        let prefix = parse(prefix)?;
        let found = self.runtime.block_on(self.store.list_with_delimiter(Some(&prefix)));
        let found = found.map_err(without_names)?;
        let folders = found.common_prefixes.iter().map(Path::to_string).collect();
        let objects = found.objects.into_iter().filter(|object| object.size > 0).collect();
        Ok(PrefixListing { folders, objects })
    }

    /// All objects below a prefix that are not empty, at any depth, or the one that is called so.
    /// In the order of names.
    pub(crate) fn all_below(&self, prefix: &str) -> std::io::Result<Vec<Object>> {
        let prefix = parse(prefix)?;
        let found: Vec<Object> = self.runtime.block_on(
            self.store.list(Some(&prefix)).take(MOST_OBJECTS + 1).map_err(without_names).try_collect(),
        )?;
        if found.len() > MOST_OBJECTS {
            let reason =
                format!("more than {MOST_OBJECTS} objects; choose a prefix that is nearer to the series");
            return Err(Error::new(ErrorKind::InvalidInput, reason));
        }
        let mut found: Vec<Object> = found.into_iter().filter(|object| object.size > 0).collect();
        if found.is_empty() && !prefix.as_ref().is_empty() {
            match self.head(&prefix) {
                Ok(one) => found.push(one.meta),
                Err(object_store::Error::NotFound { .. }) => {}
                Err(error) => return Err(without_names(error)),
            }
        }
        found.sort_by(|a, b| a.location.cmp(&b.location));
        Ok(found)
    }

    /// The first bytes of an object, at most `bytes`.
    pub(crate) fn beginning(&self, object: &Object, bytes: u64) -> std::io::Result<Vec<u8>> {
        let part = self.part(object, 0..object.size.min(bytes));
        self.runtime.block_on(part).map(|(bytes, _)| bytes)
    }

    /// Fetches objects into new files; the SHA-256 of each. An object that is no longer the one
    /// that was listed is an error.
    pub(crate) fn fetch(&self, objects: &[(Object, PathBuf)]) -> std::io::Result<Vec<String>> {
        let each = stream::iter(objects).map(|(object, path)| self.fetch_one(object, path));
        self.runtime.block_on(each.buffered(AT_ONCE).try_collect())
    }

    async fn fetch_one(&self, object: &Object, path: &std::path::Path) -> std::io::Result<String> {
        let mut file = tokio::fs::File::create_new(path).await?;
        let (mut hasher, mut said, mut at) = (Sha256::new(), None, 0);
        while at < object.size {
            let to = object.size.min(at + PART);
            let (bytes, found) = self.part(object, at..to).await?;
            hasher.update(&bytes);
            file.write_all(&bytes).await?;
            (said, at) = (found, to);
        }
        file.flush().await?;
        let found = HEXLOWER.encode(&hasher.finalize());
        match said {
            Some(said) if said != found => Err(Error::other("an object is not what its metadata says it is")),
            _ => Ok(found),
        }
    }

    /// A part of an object with exactly the requested length, and the hash in its metadata.
    async fn part(&self, object: &Object, range: Range<u64>) -> std::io::Result<(Vec<u8>, Option<String>)> {
        let wanted = usize::try_from(range.end - range.start).map_err(Error::other)?;
        let options = GetOptions {
            if_match: object.e_tag.clone(),
            range: Some(GetRange::Bounded(range)),
            ..GetOptions::default()
        };
        let found = self.store.get_opts(&object.location, options).await.map_err(without_names)?;
        let said = found.attributes.get(&SHA256).map(|sha256| sha256.to_string());
        let (mut bytes, mut chunks) = (Vec::with_capacity(wanted), found.into_stream());
        while let Some(chunk) = chunks.next().await {
            let chunk = chunk.map_err(without_names)?;
            if bytes.len() + chunk.len() > wanted {
                return Err(Error::other("the service sends more of an object than it has"));
            }
            bytes.extend_from_slice(&chunk);
        }
        if bytes.len() < wanted {
            return Err(Error::other("the service sends less of an object than it has"));
        }
        Ok((bytes, said))
    }
}

fn parse(prefix: &str) -> std::io::Result<Path> {
    Path::parse(prefix).map_err(|_| unusable_name())
}

fn unusable_name() -> Error {
    let reason =
        "a part of a name in a bucket is empty, . or .., or has control characters, and such are not read";
    Error::new(ErrorKind::InvalidInput, reason)
}

/// The cause of a failure, without the names of objects.
#[expect(clippy::needless_pass_by_value, reason = "for map_err")]
fn without_names(error: object_store::Error) -> Error {
    use object_store::Error as E;
    let (denied, no_bucket) = ("access is denied", "there is no such bucket");
    let refused = Error::new;
    match &error {
        E::NotFound { .. } if format!("{error:?}").contains("NoSuchBucket") => {
            return refused(ErrorKind::NotFound, no_bucket);
        }
        E::NotFound { .. } => return refused(ErrorKind::NotFound, "an object is gone"),
        E::PermissionDenied { .. } | E::Unauthenticated { .. } => {
            return refused(ErrorKind::PermissionDenied, denied);
        }
        E::Precondition { .. } => return Error::other("an object was altered while it was read"),
        _ => {}
    }
    let mut cause: &(dyn std::error::Error + 'static) = &error;
    while let Some(source) = cause.source() {
        cause = source;
    }
    if cause.is::<object_store::path::Error>() {
        return unusable_name();
    }
    // Listings have no errors of their own kinds.
    let cause = cause.to_string();
    if cause.contains("NoSuchBucket") {
        return refused(ErrorKind::NotFound, no_bucket);
    }
    if ["403 Forbidden", "401 Unauthorized"].iter().any(|status| cause.contains(status)) {
        return refused(ErrorKind::PermissionDenied, denied);
    }
    // Messages of a service may contain names; status codes do not.
    let said: String = cause
        .split(['<', '{', '[', '"', '/', '\n'])
        .next()
        .unwrap_or_default()
        .chars()
        .take(LONGEST)
        .collect();
    Error::other(format!("the service fails: {}", said.trim_end_matches([' ', ':'])))
}
