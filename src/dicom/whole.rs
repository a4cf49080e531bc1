//! Objects that are no images, read from bytes as a whole: reports, structure sets.
//!
//! The walk keeps the requested elements, within limits; a fault has the path of its items.

use std::path::Path;

use dicom_core::Tag;

use super::dataset::{Bounds, DataSet, KeepOf, LocatedFault};
use super::error::{Attribute, Defect};
use super::file_bytes::Bytes;
use super::part10;
use relief_base::Budget;

/// The reason why an object could not be read. Messages contain neither UIDs nor values about
/// people.
#[derive(Debug, thiserror::Error)]
pub enum ObjectError {
    /// More bytes than any such object has.
    #[error("the file has {found} bytes, allowed: at most {allowed}")]
    TooLarge {
        /// Bytes given.
        found: usize,
        /// The limit.
        allowed: usize,
    },
    /// The data set is damaged, or is no DICOM at all.
    #[error("{}{defect}", separated(.path))]
    Damaged {
        /// The items that lead to the damage, as tags and numbers from 1; empty at the top.
        path: String,
        /// The fault at that place.
        defect: Defect,
    },
    /// Another kind of object, or a value that cannot be used.
    #[error("{path}: found {found}, expected {expected}")]
    Value {
        /// The attribute and the items that lead to it, as tags and numbers from 1.
        path: String,
        /// The value.
        found: String,
        /// The expected content.
        expected: &'static str,
    },
}

fn separated(path: &str) -> String {
    if path.is_empty() { String::new() } else { format!("{path}: ") }
}

/// The kept elements of an object of at most the given number of bytes.
pub(super) fn read(
    bytes: &[u8],
    most_bytes: usize,
    bounds: Bounds,
    keep: KeepOf,
) -> Result<DataSet, ObjectError> {
    if bytes.len() > most_bytes {
        return Err(ObjectError::TooLarge { found: bytes.len(), allowed: most_bytes });
    }
    // Inflated, the object may not be larger than one that is not deflated.
    let budget = Budget::new(0, (most_bytes as u64).max(1 << 20));
    walk(Bytes::Memory(bytes::Bytes::copy_from_slice(bytes)), &budget, bounds, keep)
}

/// The kept elements of a file. Other elements are skipped and take no memory. A deflated file may inflate
/// to `most_inflated` bytes.
pub(super) fn read_file(
    path: &Path,
    most_inflated: u64,
    bounds: Bounds,
    keep: KeepOf,
) -> Result<DataSet, ObjectError> {
    walk(Bytes::Disk(path.to_owned()), &Budget::new(0, most_inflated), bounds, keep)
}

fn walk(bytes: Bytes, budget: &Budget, bounds: Bounds, keep: KeepOf) -> Result<DataSet, ObjectError> {
    let at_top = |defect| ObjectError::Damaged { path: String::new(), defect };
    let object = part10::open(bytes, budget).map_err(at_top)?;
    let damaged = |LocatedFault { trail, defect }: LocatedFault| {
        let steps: Vec<String> = trail.iter().map(|(tag, number)| format!("{tag}[{number}]")).collect();
        ObjectError::Damaged { path: steps.join("/"), defect }
    };
    Ok(object.walk_within(bounds, keep).map_err(damaged)?.data)
}

/// The error of an attribute below a path of items, which may be empty.
pub(super) fn wrong(
    path: &str,
    keyword: &'static str,
    tag: Tag,
    found: String,
    expected: &'static str,
) -> ObjectError {
    let attribute = Attribute { tag, keyword };
    let path = if path.is_empty() { attribute.to_string() } else { format!("{path}/{attribute}") };
    ObjectError::Value { path, found, expected }
}
