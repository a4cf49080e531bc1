//! Storage commitment (PS3.4 annex J): the list of objects that a caller asks about, and the answer.

use dicom_core::{DataElement, PrimitiveValue, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;
use dicom_transfer_syntax_registry::entries::{EXPLICIT_VR_LITTLE_ENDIAN, IMPLICIT_VR_LITTLE_ENDIAN};

use super::dataset::{Bounds, DataSet, Retention};
use super::object::{put, put_items};
use super::stored::file_around;
use super::whole::{self, ObjectError, wrong};

/// Largest data set of a request, bytes: about 100,000 objects.
const MOST_BYTES: usize = 16 << 20;

/// The transfer syntaxes of requests and answers.
pub const COMMITMENT_TRANSFER_SYNTAXES: [&str; 2] =
    [uids::IMPLICIT_VR_LITTLE_ENDIAN, uids::EXPLICIT_VR_LITTLE_ENDIAN];

/// An object by its kind and its own UID. Not for messages.
#[derive(Clone, PartialEq, Eq)]
pub struct ReferencedObject {
    /// Its kind, such as a CT image.
    pub sop_class: String,
    /// The object itself.
    pub sop_instance: String,
}

/// UIDs are withheld.
impl std::fmt::Debug for ReferencedObject {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("ReferencedObject(withheld)")
    }
}

/// A request for commitment to keep objects.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CommitmentRequest {
    /// The UID by which the answer names the request.
    pub transaction: String,
    /// The objects.
    pub objects: Vec<ReferencedObject>,
}

/// The answer: which objects are kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CommitmentResult {
    /// The request's UID.
    pub transaction: String,
    /// Objects that are kept.
    pub committed: Vec<ReferencedObject>,
    /// Objects that are not there.
    pub missing: Vec<ReferencedObject>,
}

/// Failure Reason of an object that is not there (PS3.3 C.14.1.1).
const NO_SUCH_OBJECT: u16 = 0x0112;

fn keep(tag: Tag) -> Retention {
    match tag {
        tags::REFERENCED_SOP_SEQUENCE => Retention::Items,
        tags::TRANSACTION_UID | tags::REFERENCED_SOP_CLASS_UID | tags::REFERENCED_SOP_INSTANCE_UID => {
            Retention::Value
        }
        _ => Retention::Nothing,
    }
}

/// Reads the data set of a request.
///
/// # Errors
/// When it is damaged or too large, or lacks a UID.
pub fn read_commitment_request(
    transfer_syntax: &str,
    data_set: &[u8],
) -> Result<CommitmentRequest, ObjectError> {
    let around = file_around(
        uids::STORAGE_COMMITMENT_PUSH_MODEL,
        uids::STORAGE_COMMITMENT_PUSH_MODEL_INSTANCE,
        transfer_syntax,
        data_set,
    );
    let file = around.map_err(|_| {
        wrong("", "TransferSyntaxUID", tags::TRANSFER_SYNTAX_UID, "something else".to_owned(), "a UID")
    })?;
    let data = whole::read(&file, MOST_BYTES, Bounds::SLICES, keep)?;
    let objects = data.items(tags::REFERENCED_SOP_SEQUENCE).iter().map(|item| {
        Ok(ReferencedObject {
            sop_class: uid(item, tags::REFERENCED_SOP_CLASS_UID, "ReferencedSOPClassUID")?,
            sop_instance: uid(item, tags::REFERENCED_SOP_INSTANCE_UID, "ReferencedSOPInstanceUID")?,
        })
    });
    Ok(CommitmentRequest {
        transaction: uid(&data, tags::TRANSACTION_UID, "TransactionUID")?,
        objects: objects.collect::<Result<_, ObjectError>>()?,
    })
}

fn uid(data: &DataSet, tag: Tag, keyword: &'static str) -> Result<String, ObjectError> {
    let text = data.text(tag).unwrap_or_default();
    let is_uid = (1..=64).contains(&text.len())
        && text.bytes().all(|letter| letter.is_ascii_digit() || letter == b'.');
    match is_uid {
        true => Ok(text),
        false => Err(wrong("", keyword, tag, "something else".to_owned(), "a UID")),
    }
}

/// The data set of the answer, in one of the [`COMMITMENT_TRANSFER_SYNTAXES`]; `None` for another.
#[must_use]
pub fn write_commitment_result(transfer_syntax: &str, result: &CommitmentResult) -> Option<Vec<u8>> {
    let syntax = match transfer_syntax {
        uids::IMPLICIT_VR_LITTLE_ENDIAN => IMPLICIT_VR_LITTLE_ENDIAN.erased(),
        uids::EXPLICIT_VR_LITTLE_ENDIAN => EXPLICIT_VR_LITTLE_ENDIAN.erased(),
        _ => return None,
    };
    let item = |object: &ReferencedObject| {
        let mut item = InMemDicomObject::new_empty();
        put(&mut item, tags::REFERENCED_SOP_CLASS_UID, VR::UI, &object.sop_class);
        put(&mut item, tags::REFERENCED_SOP_INSTANCE_UID, VR::UI, &object.sop_instance);
        item
    };
    let failed = |object: &ReferencedObject| {
        let mut item = item(object);
        item.put_element(DataElement::new(
            tags::FAILURE_REASON,
            VR::US,
            PrimitiveValue::from(NO_SUCH_OBJECT),
        ));
        item
    };
    let mut data = InMemDicomObject::new_empty();
    put(&mut data, tags::TRANSACTION_UID, VR::UI, &result.transaction);
    let lists: [(Tag, Vec<InMemDicomObject>); 2] = [
        (tags::REFERENCED_SOP_SEQUENCE, result.committed.iter().map(item).collect()),
        (tags::FAILED_SOP_SEQUENCE, result.missing.iter().map(failed).collect()),
    ];
    for (tag, items) in lists {
        if !items.is_empty() {
            put_items(&mut data, tag, items);
        }
    }
    let mut bytes = Vec::new();
    data.write_dataset_with_ts(&mut bytes, &syntax).ok()?;
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn object(number: u32) -> ReferencedObject {
        ReferencedObject {
            sop_class: uids::CT_IMAGE_STORAGE.to_owned(),
            sop_instance: format!("1.2.3.{number}"),
        }
    }

    /// An answer has the form of a request, and more.
    #[test]
    fn a_request_is_read_in_both_transfer_syntaxes() {
        let result = CommitmentResult {
            transaction: "1.2.9".to_owned(),
            committed: vec![object(1), object(22)],
            missing: vec![object(4)],
        };
        for syntax in COMMITMENT_TRANSFER_SYNTAXES {
            let bytes = write_commitment_result(syntax, &result).unwrap();
            let request = read_commitment_request(syntax, &bytes).unwrap();
            assert_eq!(
                (request.transaction, request.objects),
                ("1.2.9".to_owned(), result.committed.clone())
            );
            assert!(bytes.windows(2).any(|pair| pair == NO_SUCH_OBJECT.to_le_bytes()));
        }
        assert_eq!(write_commitment_result(uids::JPEG2000, &result), None);
    }

    #[test]
    fn damaged_requests_are_refused() {
        let result = CommitmentResult {
            transaction: "1.2.9".to_owned(),
            committed: vec![object(1)],
            missing: Vec::new(),
        };
        let syntax = uids::IMPLICIT_VR_LITTLE_ENDIAN;
        let bytes = write_commitment_result(syntax, &result).unwrap();
        let is_refused = |bytes: &[u8]| read_commitment_request(syntax, bytes).is_err();
        assert!(is_refused(&bytes[..bytes.len() - 3]) && is_refused(&[]));
        let wrong = bytes.iter().map(|byte| if *byte == b'.' { b'/' } else { *byte });
        assert!(is_refused(&wrong.collect::<Vec<_>>()));
    }
}
