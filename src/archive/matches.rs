//! Matches of a search in DICOM's JSON (PS3.18, annex F), reduced to the attributes that the client needs.
//!
//! An archive may send any attribute, of any size. The parser skips all other attributes without storing
//! them. As a JSON value, a list of numbers would take sixteen times its size.

use std::collections::BTreeMap;
use std::fmt;

use serde::Deserialize;
use serde::de::{DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};

/// The attributes that are kept.
const WANTED: [&str; 11] = [
    "00080018", "00080020", "00080060", "00081030", "0008103E", "00100010", "00100020", "00180015",
    "0020000D", "0020000E", "00201209",
];
/// Longest text of a value, bytes; the longest legal one is a name of three groups of 64 characters.
const LONGEST_TEXT: usize = 1024;
/// Most matches of one answer.
const MOST_MATCHES: usize = 200_000;

/// One match: the first value of each wanted attribute, as text.
#[derive(Debug, Default)]
pub(crate) struct Match(BTreeMap<&'static str, String>);

/// The matches of one answer.
#[derive(Debug)]
pub(crate) struct Matches(pub(crate) Vec<Match>);

impl Match {
    /// The first value of an attribute, or nothing.
    pub(crate) fn text(&self, tag: &str) -> &str {
        self.0.get(tag).map_or("", String::as_str)
    }

    /// A UID that can be part of an address.
    pub(crate) fn uid(&self, tag: &str) -> Option<String> {
        let uid = self.text(tag);
        let is_uid = (1..=64).contains(&uid.len())
            && uid.bytes().all(|letter| letter.is_ascii_digit() || letter == b'.');
        is_uid.then(|| uid.to_owned())
    }
}

impl<'de> Deserialize<'de> for Matches {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct List;
        impl<'de> Visitor<'de> for List {
            type Value = Matches;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a list of matches")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Matches, A::Error> {
                let mut matches = Vec::new();
                while let Some(one) = list.next_element::<Match>()? {
                    if matches.len() == MOST_MATCHES {
                        return Err(A::Error::custom("too many matches"));
                    }
                    matches.push(one);
                }
                Ok(Matches(matches))
            }
        }
        deserializer.deserialize_seq(List)
    }
}

impl<'de> Deserialize<'de> for Match {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Attributes;
        impl<'de> Visitor<'de> for Attributes {
            type Value = Match;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("the attributes of a match")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut attributes: A) -> Result<Match, A::Error> {
                let mut found = Match::default();
                while let Some(wanted) = attributes.next_key_seed(WantedKey)? {
                    match wanted {
                        Some(tag) => {
                            let Attribute { value: FirstText(text) } = attributes.next_value()?;
                            found.0.insert(tag, text);
                        }
                        None => drop(attributes.next_value::<IgnoredAny>()?),
                    }
                }
                Ok(found)
            }
        }
        deserializer.deserialize_map(Attributes)
    }
}

/// Reads a key; `None` for an attribute that is not kept.
struct WantedKey;

impl<'de> DeserializeSeed<'de> for WantedKey {
    type Value = Option<&'static str>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
        struct Key;
        impl Visitor<'_> for Key {
            type Value = Option<&'static str>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a tag")
            }

            fn visit_str<E: Error>(self, key: &str) -> Result<Self::Value, E> {
                Ok(WANTED.into_iter().find(|wanted| *wanted == key))
            }
        }
        deserializer.deserialize_str(Key)
    }
}

#[derive(Deserialize)]
struct Attribute {
    #[serde(rename = "Value", default)]
    value: FirstText,
}

/// The first of a list of values, as text: a text, a number, or the letters of a name.
#[derive(Default)]
struct FirstText(String);

impl<'de> Deserialize<'de> for FirstText {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(First { is_list: true })
    }
}

/// Reads a value. If `is_list`, it is the list of values, and its first element is the result.
#[derive(Clone, Copy)]
struct First {
    is_list: bool,
}

impl First {
    /// The result for a text. Values are always in lists, so a text in place of the list is ignored.
    fn of(self, text: &str) -> FirstText {
        let text = if self.is_list { "" } else { text };
        let end = (0..=text.len().min(LONGEST_TEXT)).rev().find(|end| text.is_char_boundary(*end));
        FirstText(text[..end.unwrap_or(0)].to_owned())
    }
}

impl<'de> DeserializeSeed<'de> for First {
    type Value = FirstText;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<FirstText, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for First {
    type Value = FirstText;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value")
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<FirstText, E> {
        Ok(self.of(text))
    }

    fn visit_u64<E: Error>(self, number: u64) -> Result<FirstText, E> {
        Ok(self.of(&number.to_string()))
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<FirstText, E> {
        Ok(self.of(&number.to_string()))
    }

    fn visit_f64<E: Error>(self, number: f64) -> Result<FirstText, E> {
        Ok(self.of(&number.to_string()))
    }

    fn visit_bool<E: Error>(self, _: bool) -> Result<FirstText, E> {
        Ok(FirstText::default())
    }

    fn visit_unit<E: Error>(self) -> Result<FirstText, E> {
        Ok(FirstText::default())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<FirstText, A::Error> {
        let first = match self.is_list {
            true => list.next_element_seed(Self { is_list: false })?.unwrap_or_default(),
            false => FirstText::default(),
        };
        while list.next_element::<IgnoredAny>()?.is_some() {}
        Ok(first)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut name: A) -> Result<FirstText, A::Error> {
        let mut found = FirstText::default();
        while let Some(group) = name.next_key::<NameGroup>()? {
            match group {
                NameGroup::Alphabetic if !self.is_list => found = name.next_value_seed(self)?,
                _ => drop(name.next_value::<IgnoredAny>()?),
            }
        }
        Ok(found)
    }
}

#[derive(Deserialize)]
enum NameGroup {
    Alphabetic,
    #[serde(other)]
    Other,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(json: &str) -> Vec<Match> {
        serde_json::from_str::<Matches>(json).unwrap().0
    }

    #[test]
    fn wanted_attributes_are_kept_and_others_skipped() {
        let found = read(
            r#"[{"0020000E":{"vr":"UI","Value":["1.2.3","4"]},"00100010":{"Value":[{"Ideographic":"x","Alphabetic":"DOE^J"}]},
                "00201209":{"vr":"IS","Value":[16]},"junk":[1,[2,{"a":3}]],"00080060":{"vr":"CS"},"00100020":{"Value":"no list"},
                "00081030":{"Value":[null]},"0008103E":{"Value":[["nested"]]},"00180015":{"Value":[{"Alphabetic":{"Alphabetic":7}}]}},{}]"#,
        );
        assert_eq!(found.len(), 2);
        let text = |tag| found[0].text(tag);
        assert_eq!((text("0020000E"), text("00100010"), text("00201209")), ("1.2.3", "DOE^J", "16"));
        assert_eq!(found[0].uid("0020000E").as_deref(), Some("1.2.3"));
        assert_eq!(["00080060", "00100020", "00081030", "0008103E"].map(text), [""; 4]);
        assert_eq!(found[1].text("0020000E"), "");
        assert!(
            serde_json::from_str::<Matches>(r#"{"a":1}"#).is_err()
                && serde_json::from_str::<Matches>("[1]").is_err()
        );
    }

    #[test]
    fn sizes_have_limits() {
        let long = "ä".repeat(5000);
        let found = read(&format!(r#"[{{"00100010":{{"Value":["{long}"]}}}}]"#));
        assert_eq!(found[0].text("00100010"), "ä".repeat(LONGEST_TEXT / 2));
        let many = format!("[{}{{}}]", "{},".repeat(MOST_MATCHES));
        assert!(serde_json::from_str::<Matches>(&many).is_err());
        // The parser limits the depth, so deep nesting is an error and does not overflow the stack.
        let deep = format!(r#"[{{"x":{}}}]"#, "[".repeat(100_000));
        assert!(serde_json::from_str::<Matches>(&deep).is_err());
    }
}
