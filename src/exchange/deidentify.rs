//! Items without people: for files that leave the institution.
//!
//! Replaced are authors, frames of reference, times and descriptions. Names of items, sets and lists
//! stay, because they name anatomy. An item named after a patient has to be renamed by hand.

use std::collections::HashMap;

use relief_annotation::{FrameOfReference, Item, Timestamp};
use relief_dicom::deidentified_uid;

/// The same items without authors, times, descriptions and the frame of reference of the archive.
/// Authors are called `reader 1`, `reader 2` and so on, in the order of the items.
#[must_use]
pub fn deidentified(items: Vec<Item>) -> Vec<Item> {
    let mut readers: HashMap<String, usize> = HashMap::new();
    let replaced = items.into_iter().map(|mut item| {
        let next = readers.len() + 1;
        let number = *readers.entry(std::mem::take(&mut item.author)).or_insert(next);
        item.author = format!("reader {number}");
        item.created = Timestamp::from_millis(0).unwrap_or(item.created);
        item.description.clear();
        item.frame_of_reference =
            item.frame_of_reference.map(|frame| match frame.0.strip_prefix("volume:") {
                Some(_) => frame, // a hash of the content, not of a person
                None => FrameOfReference(deidentified_uid(&frame.0)),
            });
        item
    });
    replaced.collect()
}
