//! Fetches a listing of a bucket into a copy; for archives see `retrieved`.

use std::io::{Error, ErrorKind};
use std::path::PathBuf;
use std::sync::Arc;

use data_encoding::HEXLOWER;
use sha2::{Digest, Sha256};

use super::shelf::{Draft, WantedCopy};
use super::state::of_this_machine;
use super::{Copies, Local};
use crate::bucket::{Bucket, Object};
use crate::location::{Location, SERIES_ENDINGS};
use crate::output_file::OutputFile;

/// Endings that no slice has.
const OTHER_ENDINGS: [&str; 8] = [".json", ".csv", ".txt", ".md", ".html", ".xml", ".png", ".jpg"];
/// Objects that are looked into for the mark of DICOM files.
const MOST_LOOKED_INTO: usize = 16;
/// Bytes up to the end of that mark.
const PREAMBLE: u64 = 132;

impl Copies {
    pub(super) fn places_in(&self, bucket: &str, prefix: &str) -> std::io::Result<Vec<PathBuf>> {
        let opened = self.bucket(bucket)?;
        let of = |key: &str| {
            let location = Location::Bucket { bucket: bucket.to_owned(), prefix: key.to_owned() };
            PathBuf::from(location.to_string())
        };
        let below = opened.directly_below(prefix)?;
        if below.folders.is_empty() && below.objects.is_empty() {
            // An object of this very name, or nothing.
            return match opened.all_below(prefix)?.is_empty() {
                true => Err(nothing()),
                false => Ok(vec![of(prefix)]),
            };
        }
        let has_ending = |object: &Object, endings: &[&str]| {
            let name = object.location.as_ref().to_ascii_lowercase();
            endings.iter().any(|ending| name.ends_with(ending))
        };
        let (volumes, loose): (Vec<&Object>, Vec<&Object>) =
            below.objects.iter().partition(|object| has_ending(object, &SERIES_ENDINGS));
        let slices = loose.into_iter().filter(|object| !has_ending(object, &OTHER_ENDINGS));
        for object in slices.take(MOST_LOOKED_INTO) {
            if opened.beginning(object, PREAMBLE)?.get(128..) == Some(b"DICM") {
                return Ok(vec![of(prefix)]);
            }
        }
        let volumes = volumes.into_iter().map(|object| object.location.as_ref());
        let mut places: Vec<PathBuf> =
            below.folders.iter().map(String::as_str).chain(volumes).map(of).collect();
        if places.is_empty() {
            return Err(nothing());
        }
        places.sort();
        Ok(places)
    }

    pub(super) fn copy(&self, bucket: &str, key: &str) -> std::io::Result<Local> {
        let opened = self.bucket(bucket)?;
        let objects = opened.all_below(key)?;
        if objects.is_empty() {
            return Err(nothing());
        }
        let needed = objects.iter().fold(0, |sum: u64, object| sum.saturating_add(object.size));
        let allowed = self.options.bytes;
        if needed > allowed {
            let reason = format!(
                "its objects have {needed} bytes, and copies of series may have {allowed}; allow more with --cache-bytes"
            );
            return Err(Error::new(ErrorKind::InvalidInput, reason));
        }
        let name = self.name_of(bucket, key, &objects);
        let is_one = matches!(&*objects, [one] if one.location.as_ref() == key);
        // The lock is released before the transfer, so that other calls do not wait for it.
        let shelf = self.state.lock().shelf(self.options.folder.as_deref()).map_err(of_this_machine)?;
        let fetch = |draft: &Draft<'_>| {
            draft.reserve(needed)?;
            let place = |(number, object): (usize, &Object)| {
                (object.clone(), draft.folder().join(file_name(number, object)))
            };
            let wanted: Vec<(Object, PathBuf)> = objects.iter().enumerate().map(place).collect();
            let hashes = opened.fetch(&wanted)?;
            let written = wanted.iter().zip(hashes).map(|((object, path), sha256)| OutputFile {
                file: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
                sha256,
                bytes: object.size,
            });
            Ok(written.collect())
        };
        let wanted = WantedCopy { name: &name, files: objects.len(), allowed, resumes: false };
        let (folder, held) = shelf.find_or_add(&wanted, fetch).map_err(of_this_machine)?;
        let path = if is_one { folder.join(file_name(0, &objects[0])) } else { folder };
        Ok(Local { path, held: Some(Arc::new(held)), isolated: self.options.isolated.clone() })
    }

    /// By everything that distinguishes one state of it from another.
    fn name_of(&self, bucket: &str, key: &str, objects: &[Object]) -> String {
        let mut hasher = Sha256::new();
        let endpoint = self.options.endpoint.as_deref().unwrap_or_default();
        hasher.update(format!("{endpoint}\n{bucket}\n{key}\n"));
        for Object { location, size, e_tag, last_modified, .. } in objects {
            let tag = e_tag.as_deref().unwrap_or_default();
            hasher.update(format!("{location}\n{size}\n{tag}\n{}\n", last_modified.timestamp_millis()));
        }
        HEXLOWER.encode(&hasher.finalize())
    }

    fn bucket(&self, name: &str) -> std::io::Result<Arc<Bucket>> {
        let mut state = self.state.lock();
        if let Some(known) = state.buckets.get(name) {
            return Ok(Arc::clone(known));
        }
        let opened = Arc::new(Bucket::open(name, "", self.options.endpoint.as_deref())?);
        state.buckets.insert(name.to_owned(), Arc::clone(&opened));
        Ok(opened)
    }
}

/// A number, and the ending: files beside slices that are known by theirs are no defects.
fn file_name(number: usize, object: &Object) -> String {
    let name = object.location.filename().unwrap_or_default().to_ascii_lowercase();
    let known = [&SERIES_ENDINGS[..], &OTHER_ENDINGS, &[".dcm"]]
        .concat()
        .into_iter()
        .find(|ending| name.ends_with(ending));
    format!("{number:06}{}", known.unwrap_or_default())
}

fn nothing() -> Error {
    Error::new(ErrorKind::NotFound, "there is nothing to read below this prefix")
}
