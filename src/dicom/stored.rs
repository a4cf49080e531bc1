//! Objects on their way from and to archives: their identity, the transfer syntaxes that are read,
//! and the file around a data set that came over the DICOM network.

use std::path::Path;

use dicom_core::Tag;
use dicom_dictionary_std::{tags, uids};

use super::dataset::{Bounds, DataSet, Retention};
use super::object::{EncodeError, meta};
use super::whole::{self, ObjectError, wrong};

/// Largest object that is sent, bytes.
const MOST_BYTES: usize = 2 << 30;
/// Largest size to which a file is inflated for its identity, bytes.
const MOST_INFLATED_BYTES: u64 = 256 << 20;

/// The UIDs of an object and the id of its patient. They must not appear in messages.
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
    /// The id of its patient, without spaces around it; empty if the object has none.
    pub patient_id: String,
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
    let is_kept = tag == tags::PATIENT_ID || NEEDED.iter().any(|(needed, _)| *needed == tag);
    if is_kept { Retention::Value } else { Retention::Nothing }
}

/// Reads the identity of a DICOM file.
///
/// # Errors
/// When the bytes are not a whole DICOM file, or lack a UID that an archive needs.
pub fn read_identity(bytes: &[u8]) -> Result<ObjectIdentity, ObjectError> {
    identity(&whole::read(bytes, MOST_BYTES, Bounds::SLICES, keep)?)
}

/// Reads the identity of a DICOM file on the disk, of any size. Pixels are skipped.
///
/// # Errors
/// As for [`read_identity`], and when the file cannot be read, or is deflated and larger than 256 MiB.
pub fn read_identity_of_file(path: &Path) -> Result<ObjectIdentity, ObjectError> {
    identity(&whole::read_file(path, MOST_INFLATED_BYTES, Bounds::SLICES, keep)?)
}

fn identity(data: &DataSet) -> Result<ObjectIdentity, ObjectError> {
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
    let patient_id = data.text(tags::PATIENT_ID).unwrap_or_default();
    Ok(ObjectIdentity {
        sop_class: sop_class?,
        sop_instance: sop_instance?,
        study: study?,
        series: series?,
        patient_id: patient_id.trim_matches(['\0', ' ']).to_owned(),
    })
}

/// A DICOM file in the parts that the DICOM network sends.
#[derive(Clone, Debug)]
pub struct ObjectParts<'a> {
    /// Its UIDs.
    pub identity: ObjectIdentity,
    /// The transfer syntax of the data set.
    pub transfer_syntax: String,
    /// The data set, as it is.
    pub data_set: &'a [u8],
}

/// Divides a DICOM file.
///
/// # Errors
/// As for [`read_identity`], and when it has no file meta group.
pub fn parts_of(file: &[u8]) -> Result<ObjectParts<'_>, ObjectError> {
    let identity = read_identity(file)?;
    let no_meta = || {
        wrong(
            "",
            "FileMetaInformationGroupLength",
            tags::FILE_META_INFORMATION_GROUP_LENGTH,
            "nothing".to_owned(),
            "a file meta group",
        )
    };
    let meta = file.get(PREAMBLE..).ok_or_else(no_meta)?;
    let table = dicom_object::FileMetaTable::from_reader(meta).map_err(|_| no_meta())?;
    // The mark, and the element with the length of the rest of the group.
    let begin = PREAMBLE + 4 + 12 + table.information_group_length as usize;
    let data_set = file.get(begin..).ok_or_else(no_meta)?;
    Ok(ObjectParts { identity, transfer_syntax: table.transfer_syntax().to_owned(), data_set })
}

/// Bytes before the mark of a DICOM file.
const PREAMBLE: usize = 128;

/// The transfer syntaxes of CT images that are read.
pub const READ_TRANSFER_SYNTAXES: &[&str] = &[
    uids::EXPLICIT_VR_LITTLE_ENDIAN,
    uids::IMPLICIT_VR_LITTLE_ENDIAN,
    uids::DEFLATED_EXPLICIT_VR_LITTLE_ENDIAN,
    "1.2.840.10008.1.2.2", // explicit VR big endian, retired
    uids::RLE_LOSSLESS,
    uids::JPEG_LOSSLESS_SV1,
    uids::JPEG_LOSSLESS,
    #[cfg(feature = "jpeg-ls")]
    uids::JPEGLS_LOSSLESS,
    #[cfg(feature = "jpeg-ls")]
    uids::JPEGLS_NEAR_LOSSLESS,
    uids::JPEG2000_LOSSLESS,
    uids::JPEG2000,
    uids::HTJ2K_LOSSLESS,
    uids::HTJ2K_LOSSLESS_RPCL,
    uids::HTJ2K,
    uids::JPEG_BASELINE8_BIT,
    uids::JPEG_EXTENDED12_BIT,
    uids::DEFLATED_IMAGE_FRAME_COMPRESSION,
    uids::ENCAPSULATED_UNCOMPRESSED_EXPLICIT_VR_LITTLE_ENDIAN,
];

/// The kinds of CT images that are read.
pub const READ_SOP_CLASSES: &[&str] = &[
    uids::CT_IMAGE_STORAGE,
    uids::ENHANCED_CT_IMAGE_STORAGE,
    uids::LEGACY_CONVERTED_ENHANCED_CT_IMAGE_STORAGE,
];

/// A DICOM file (PS3.10) around a data set in a transfer syntax.
///
/// # Errors
/// When the values are not UIDs.
pub fn file_around(
    sop_class: &str,
    sop_instance: &str,
    transfer_syntax: &str,
    data_set: &[u8],
) -> Result<Vec<u8>, FileAroundError> {
    let meta = meta(transfer_syntax)
        .media_storage_sop_class_uid(sop_class)
        .media_storage_sop_instance_uid(sop_instance);
    let meta = meta.build().map_err(|error| FileAroundError(error.into()))?;
    let mut file = [&[0; 128][..], b"DICM"].concat();
    meta.write(&mut file).map_err(|error| FileAroundError(error.into()))?;
    file.extend_from_slice(data_set);
    Ok(file)
}

/// The head of a file cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("the head of the file cannot be written")]
pub struct FileAroundError(#[source] EncodeError);
