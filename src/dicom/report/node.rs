//! Content items of a report that is read, and the warnings about it.

use std::collections::BTreeMap;

use dicom_core::Tag;
use dicom_dictionary_std::tags;

use crate::ObjectError;
use crate::charset::Charset;
use crate::dataset::DataSet;
use crate::object::Code;
use crate::whole;
use relief_annotation::Concept;
/// A content item and its place.
pub(super) struct Node<'a> {
    pub(super) data: &'a DataSet,
    pub(super) path: String,
    pub(super) charset: Charset,
}

/// Warnings by their text, with their count and first place.
#[derive(Default)]
pub(super) struct Warnings(BTreeMap<&'static str, (usize, String)>);

impl<'a> Node<'a> {
    pub(super) fn children(&self) -> Vec<Self> {
        let separator = if self.path.is_empty() { "" } else { "/" };
        let child = |(index, data)| Node {
            data,
            path: format!("{}{separator}{}[{}]", self.path, tags::CONTENT_SEQUENCE, index + 1),
            charset: self.charset.within(data),
        };
        self.data.items(tags::CONTENT_SEQUENCE).iter().enumerate().map(child).collect()
    }

    /// Its value type; a word of no meaning where that is not text.
    pub(super) fn kind(&self) -> &'a str {
        let bytes = self.data.bytes(tags::VALUE_TYPE).unwrap_or_default();
        std::str::from_utf8(bytes).unwrap_or_default().trim_matches(['\0', ' '])
    }

    /// A text value; empty when absent.
    pub(super) fn text(&self, tag: Tag) -> String {
        self.charset.text(self.data, tag).unwrap_or_default()
    }

    pub(super) fn is(&self, name: Code) -> bool {
        self.has_name(name.value, name.scheme)
    }

    pub(super) fn has_name(&self, value: &str, scheme: &str) -> bool {
        let name = self.data.items(tags::CONCEPT_NAME_CODE_SEQUENCE).first();
        let is =
            |tag, wanted: &str| name.and_then(|name| name.text(tag)).is_some_and(|found| found == wanted);
        is(tags::CODE_VALUE, value) && is(tags::CODING_SCHEME_DESIGNATOR, scheme)
    }

    /// The code of a content item of type CODE. With an equivalent of the same code, that one's
    /// meaning is the concept's and its own a name.
    pub(super) fn concept(&self) -> Option<(Concept, String)> {
        let item = self.data.items(tags::CONCEPT_CODE_SEQUENCE).first()?;
        let text = |item: &DataSet, tag| self.charset.text(item, tag).filter(|text| !text.is_empty());
        let code = |item| {
            [tags::CODE_VALUE, tags::LONG_CODE_VALUE, tags::URN_CODE_VALUE]
                .iter()
                .find_map(|tag| text(item, *tag))
        };
        let scheme = |item| text(item, tags::CODING_SCHEME_DESIGNATOR);
        let name = text(item, tags::CODE_MEANING)?;
        let (value, designator) = (code(item)?, scheme(item).unwrap_or_default());
        let same = item.items(tags::EQUIVALENT_CODE_SEQUENCE).iter().find(|other| {
            code(other).as_deref() == Some(&value) && scheme(other).as_deref() == Some(&designator)
        });
        let meaning = same.and_then(|other| text(other, tags::CODE_MEANING));
        let meaning = meaning.unwrap_or_else(|| name.clone());
        Some((Concept { code: value, scheme: designator, meaning }, name))
    }

    /// The error of an attribute here.
    pub(super) fn wrong(
        &self,
        keyword: &'static str,
        tag: Tag,
        found: String,
        expected: &'static str,
    ) -> ObjectError {
        whole::wrong(&self.path, keyword, tag, found, expected)
    }
}

impl Warnings {
    /// One more of these, at a place.
    pub(super) fn count(&mut self, what: &'static str, path: &str) {
        self.0.entry(what).or_insert_with(|| (0, path.to_owned())).0 += 1;
    }

    pub(super) fn sentences(self) -> Vec<String> {
        let sentence = |(what, (count, first)): (&str, (usize, String))| match count {
            1 => format!("{what}: {first}"),
            _ => format!("{what}: {count} times, first at {first}"),
        };
        self.0.into_iter().map(sentence).collect()
    }
}
