//! Text of a data set in the character set that it names.

use dicom_core::Tag;
use dicom_dictionary_std::tags;
use dicom_encoding::text::{SpecificCharacterSet, TextCodec};

use super::dataset::DataSet;

/// How a data set's text is written: Specific Character Set (0008,0005).
pub(super) struct Charset(SpecificCharacterSet);

impl Charset {
    /// The character set of an object. Of several, the last known one is used: with code extensions
    /// (PS3.5 6.1.2.5) the first is often ASCII, and characters outside the second become
    /// replacement characters. An unknown set is read as UTF-8, which includes ASCII.
    pub(super) fn of(data: &DataSet) -> Self {
        let named = data.text(tags::SPECIFIC_CHARACTER_SET).unwrap_or_default();
        let known = named.split('\\').rev().find_map(|code| match code.trim() {
            "" => None,
            code => SpecificCharacterSet::from_code(code),
        });
        Self(known.unwrap_or(SpecificCharacterSet::ISO_IR_192))
    }

    /// A text value without its padding; `None` when absent.
    pub(super) fn text(&self, data: &DataSet, tag: Tag) -> Option<String> {
        let bytes = data.bytes(tag)?;
        let lossy = || String::from_utf8_lossy(bytes).into_owned();
        // The codec writes bytes that mean nothing in UTF-8 as octal numbers; a mark reads better.
        let text = match self.0 == SpecificCharacterSet::ISO_IR_192 {
            true => lossy(),
            false => self.0.decode(bytes).unwrap_or_else(|_| lossy()),
        };
        // The escape sequence of Korean, which the codec leaves in.
        let text = text.replace("\u{1b}$)C", "");
        Some(text.trim_matches(['\0', ' ', '\t', '\r', '\n']).to_owned())
    }
}
