//! Building DICOM objects: elements, codes, UIDs that follow from content, and the file around
//! them.
//!
//! Text is UTF-8, so every object made here declares ISO_IR 192. Values are not validated here;
//! tests do that with dciodvfy and dsrdump.

use dicom_core::value::{C, DataSetSequence, PrimitiveValue};
use dicom_core::{DataElement, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_encoding::text::SpecificCharacterSet;
use dicom_object::{FileMetaTableBuilder, InMemDicomObject};
use dicom_transfer_syntax_registry::entries;
use sha2::{Digest, Sha256};

use relief_annotation::Timestamp;

/// Identifies this writer in the file meta group; derived once from a random UUID.
const IMPLEMENTATION_CLASS_UID: &str = "2.25.125342396745869861420020890032567052334";
const IMPLEMENTATION_VERSION_NAME: &str = "RELIEF";
/// A decimal string (VR DS) holds at most this many characters.
pub(super) const DECIMAL_STRING_CHARS: usize = 16;
/// Most characters of a long string (VR LO): code meanings, labels, descriptions.
pub(super) const LONG_STRING_CHARS: usize = 64;

/// Why an object could not be put into bytes.
pub(super) type EncodeError = Box<dyn std::error::Error + Send + Sync>;

pub(super) fn put(object: &mut InMemDicomObject, tag: Tag, vr: VR, value: &str) {
    object.put_element(DataElement::new(tag, vr, PrimitiveValue::from(value)));
}

pub(super) fn put_many(
    object: &mut InMemDicomObject,
    tag: Tag,
    vr: VR,
    values: impl IntoIterator<Item = String>,
) {
    let values: C<String> = values.into_iter().collect();
    object.put_element(DataElement::new(tag, vr, PrimitiveValue::Strs(values)));
}

pub(super) fn put_numbers(object: &mut InMemDicomObject, tag: Tag, values: &[u16]) {
    let values: C<u16> = values.iter().copied().collect();
    object.put_element(DataElement::new(tag, VR::US, PrimitiveValue::U16(values)));
}

pub(super) fn put_items(object: &mut InMemDicomObject, tag: Tag, items: Vec<InMemDicomObject>) {
    object.put_element(DataElement::new(tag, VR::SQ, DataSetSequence::from(items)));
}

pub(super) fn decimals(values: &[f64]) -> Vec<String> {
    values.iter().map(|&value| decimal_string(value)).collect()
}

/// The shortest decimal that reads back as `value`, or the nearest one of 16 characters.
pub(super) fn decimal_string(value: f64) -> String {
    let exact = value.to_string();
    if exact.len() <= DECIMAL_STRING_CHARS {
        return exact;
    }
    let digits = (0..DECIMAL_STRING_CHARS).rev().map(|digits| format!("{value:.digits$}"));
    match digits.into_iter().find(|text| text.len() <= DECIMAL_STRING_CHARS) {
        Some(text) if text.contains('.') => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        Some(text) => text,
        None => format!("{value:.8e}"),
    }
}

/// The longest prefix of a text that fits a value of the given number of characters, without
/// separators and control characters.
pub(super) fn limited(text: &str, characters: usize) -> String {
    let clean = text.chars().map(|letter| if letter == '\\' { '/' } else { letter });
    let clean: String = clean.filter(|letter| !letter.is_control()).take(characters).collect();
    clean.trim().to_owned()
}

/// A code of a coding scheme.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Code {
    pub(super) value: &'static str,
    pub(super) scheme: &'static str,
    pub(super) meaning: &'static str,
}

impl Code {
    pub(super) const fn new(value: &'static str, scheme: &'static str, meaning: &'static str) -> Self {
        Self { value, scheme, meaning }
    }

    pub(super) const fn dcm(value: &'static str, meaning: &'static str) -> Self {
        Self::new(value, "DCM", meaning)
    }

    pub(super) fn item(self) -> InMemDicomObject {
        code_item(self.value, self.scheme, self.meaning)
    }
}

/// An item of a code sequence (PS3.3 8.8).
pub(super) fn code_item(value: &str, scheme: &str, meaning: &str) -> InMemDicomObject {
    let mut item = InMemDicomObject::new_empty();
    put(&mut item, tags::CODE_VALUE, VR::SH, value);
    put(&mut item, tags::CODING_SCHEME_DESIGNATOR, VR::SH, scheme);
    put(&mut item, tags::CODE_MEANING, VR::LO, &limited(meaning, LONG_STRING_CHARS));
    item
}

/// A UID under 2.25 that depends only on its purpose and these parts (a UUID of version 8, made
/// with SHA-256).
pub(super) fn uid_of<P: AsRef<[u8]>>(purpose: &[u8], parts: impl IntoIterator<Item = P>) -> String {
    let mut hasher = Sha256::new();
    hasher.update(purpose);
    for part in parts {
        let part = part.as_ref();
        hasher.update((part.len() as u64).to_le_bytes());
        hasher.update(part);
    }
    let digest = hasher.finalize();
    let mut uuid = [0; 16];
    uuid.copy_from_slice(&digest[..16]);
    uuid[6] = uuid[6] & 0x0f | 0x80; // version 8 of RFC 9562: vendor-specific
    uuid[8] = uuid[8] & 0x3f | 0x80; // its variant
    format!("2.25.{}", u128::from_be_bytes(uuid))
}

/// Values of the file meta group besides the object's own UIDs.
pub(super) fn meta(transfer_syntax: &str) -> FileMetaTableBuilder {
    FileMetaTableBuilder::new()
        .transfer_syntax(transfer_syntax)
        .implementation_class_uid(IMPLEMENTATION_CLASS_UID)
        .implementation_version_name(IMPLEMENTATION_VERSION_NAME)
}

/// A whole file: preamble, meta group, data set. Implicit VR where a value is too long for the
/// 16-bit lengths of explicit VR, which is the case of floats beyond 64 KiB.
pub(super) fn file_bytes(object: InMemDicomObject, is_long: bool) -> Result<Vec<u8>, EncodeError> {
    let syntax = if is_long { uids::IMPLICIT_VR_LITTLE_ENDIAN } else { uids::EXPLICIT_VR_LITTLE_ENDIAN };
    let mut bytes = Vec::new();
    object.with_meta(meta(syntax))?.write_all(&mut bytes)?;
    Ok(bytes)
}

/// The last bytes of a file that ends with a sequence within an item of another sequence, all of undefined
/// length: the delimiters of the inner sequence, of the item and of the outer sequence.
const OPEN_END: [u8; 24] = [
    0xfe, 0xff, 0xdd, 0xe0, 0, 0, 0, 0, 0xfe, 0xff, 0x0d, 0xe0, 0, 0, 0, 0, 0xfe, 0xff, 0xdd, 0xe0, 0, 0, 0,
    0,
];
const ITEM: [u8; 8] = [0xfe, 0xff, 0x00, 0xe0, 0xff, 0xff, 0xff, 0xff];
const ITEM_END: [u8; 8] = [0xfe, 0xff, 0x0d, 0xe0, 0, 0, 0, 0];

/// The file does not end with [`OPEN_END`].
#[derive(Debug, thiserror::Error)]
#[error("the file does not end with a sequence of undefined length")]
struct NoOpenEnd;

/// Adds items to the inner sequence at the end of a file (see [`OPEN_END`]) that [`file_bytes`] made. Each
/// item is encoded before the iterator makes the next one.
pub(super) fn with_more_items(
    mut file: Vec<u8>,
    items: impl Iterator<Item = InMemDicomObject>,
    is_long: bool,
) -> Result<Vec<u8>, EncodeError> {
    let syntax = if is_long {
        entries::IMPLICIT_VR_LITTLE_ENDIAN.erased()
    } else {
        entries::EXPLICIT_VR_LITTLE_ENDIAN.erased()
    };
    let end = file.len().checked_sub(OPEN_END.len()).filter(|end| file[*end..] == OPEN_END);
    file.truncate(end.ok_or(NoOpenEnd)?);
    for item in items {
        file.extend(ITEM);
        item.write_dataset_with_ts_cs(&mut file, &syntax, SpecificCharacterSet::ISO_IR_192)?;
        file.extend(ITEM_END);
    }
    file.extend(OPEN_END);
    Ok(file)
}

/// The equipment that made the object: the general and the enhanced general equipment modules
/// (PS3.3 C.7.5.1, C.7.5.2).
pub(super) fn put_equipment(object: &mut InMemDicomObject) {
    put(object, tags::MANUFACTURER, VR::LO, "Relief");
    put(object, tags::MANUFACTURER_MODEL_NAME, VR::LO, "Relief");
    put(object, tags::DEVICE_SERIAL_NUMBER, VR::LO, "0");
    put(object, tags::SOFTWARE_VERSIONS, VR::LO, env!("CARGO_PKG_VERSION"));
}

/// Date and time in UTC as DICOM writes them; the beginning of 1970 for years that four digits do
/// not hold.
pub(super) fn date_and_time(moment: Timestamp) -> (String, String) {
    let text = moment.to_string();
    match text.split_once('T').filter(|(date, _)| date.len() == 10) {
        Some((date, time)) => (date.replace('-', ""), time.replace(':', "").trim_end_matches('Z').to_owned()),
        None => ("19700101".to_owned(), "000000".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimal_strings_fit_and_read_back() {
        for value in [0.0, 1.0, -127.5, 0.9375, 1.0 / 3.0, -2.0 / 3.0e3, 123_456.789_012_345, 1e-17, -1e300] {
            let text = decimal_string(value);
            assert!(text.len() <= DECIMAL_STRING_CHARS, "{text}");
            let back: f64 = text.parse().unwrap();
            assert!((back - value).abs() <= 1e-9 * value.abs().max(1e-3), "{value} became {text}");
        }
    }

    #[test]
    fn uids_follow_from_their_parts_and_from_where_these_end() {
        let uid = uid_of(b"x", ["ab", "c"]);
        assert_eq!(uid, uid_of(b"x", ["ab", "c"]));
        assert_ne!(uid, uid_of(b"x", ["a", "bc"]));
        assert!(uid.len() <= 64 && uid.starts_with("2.25."), "{uid}");
    }

    #[test]
    fn a_text_is_cut_by_characters_and_never_divided() {
        assert_eq!(limited("äöü\\x\n", 4), "äöü/");
    }
}
