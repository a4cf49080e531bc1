//! The identity of an object that is to be stored in an archive.

use dicom_core::Tag;
use dicom_dictionary_std::tags;

use super::dataset::{Bounds, Retention};
use super::whole::{self, ObjectError, wrong};

/// Largest object that is sent, bytes.
const MOST_BYTES: usize = 2 << 30;

/// The UIDs by which an archive knows an object. Not for messages.
#[derive(Clone, PartialEq, Eq)]
pub struct ObjectIdentity {
    /// Its kind, such as a segmentation.
    pub sop_class: String,
    /// The object itself.
    pub sop_instance: String,
    /// Its study.
    pub study: String,
    /// Its series.
    pub series: String,
}

/// UIDs are withheld.
impl std::fmt::Debug for ObjectIdentity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("ObjectIdentity(withheld)")
    }
}

const NEEDED: [(Tag, &str); 4] = [
    (tags::SOP_CLASS_UID, "SOPClassUID"),
    (tags::SOP_INSTANCE_UID, "SOPInstanceUID"),
    (tags::STUDY_INSTANCE_UID, "StudyInstanceUID"),
    (tags::SERIES_INSTANCE_UID, "SeriesInstanceUID"),
];

fn keep(tag: Tag) -> Retention {
    if NEEDED.iter().any(|(needed, _)| *needed == tag) { Retention::Value } else { Retention::Nothing }
}

/// Reads the identity of a DICOM file.
///
/// # Errors
/// When the bytes are not a whole DICOM file, or lack a UID that an archive needs.
pub fn read_identity(bytes: &[u8]) -> Result<ObjectIdentity, ObjectError> {
    let data = whole::read(bytes, MOST_BYTES, Bounds::SLICES, keep)?;
    let [sop_class, sop_instance, study, series] = NEEDED.map(|(tag, keyword)| {
        let uid = data.text(tag).unwrap_or_default();
        let uid = uid.trim_matches(['\0', ' ']);
        let is_uid = (1..=64).contains(&uid.len())
            && uid.bytes().all(|letter| letter.is_ascii_digit() || letter == b'.');
        match is_uid {
            true => Ok(uid.to_owned()),
            false => Err(wrong("", keyword, tag, "something else".to_owned(), "a UID")),
        }
    });
    Ok(ObjectIdentity { sop_class: sop_class?, sop_instance: sop_instance?, study: study?, series: series? })
}
