//! Templates: lists of items that are expected of a patient, in the order of placing.
//!
//! A template is a value: `relief_store` stores it as text. Applying it to a set creates the
//! missing items without a position; only the template states which kind each will be.

use relief_base::OutOfRange;
use std::collections::HashSet;

use serde::{Deserialize, Serialize};

use super::geometry::Geometry;
use super::item::{Concept, FrameOfReference, Item, Set, State};

/// A named list of expected items. As JSON it is what `relief annotate template` reads and the HTTP
/// interface shows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Template {
    /// Its name, written as a set's; the items it makes are of the list of this name.
    pub name: String,
    /// Anything that people want to say of it.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// The expected items, in order, with distinct names.
    pub items: Vec<Expected>,
}

/// One expected item.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expected {
    /// Name of the item.
    pub name: String,
    /// How to find it, for instance.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// Code of its meaning in a coding scheme.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub concept: Option<Concept>,
    /// Display-referred sRGB, 0..1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rgb: Option<[f64; 3]>,
    /// Kind of its geometry.
    #[serde(default)]
    pub kind: ExpectedKind,
}

/// Kind of an expected item: the kinds of [`Geometry`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ExpectedKind {
    /// A landmark.
    #[default]
    Point,
    /// A straight distance.
    Line,
    /// The angle between two arms.
    Angle,
    /// A line through points, open or closed.
    Curve,
    /// A rectangle of a plane.
    Plane,
    /// Voxels of a structure.
    Region,
    /// A surface of triangles.
    Mesh,
}

/// The progress of a set with a template.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Completeness {
    /// The template's name.
    pub template: String,
    /// The number of its items with a place.
    pub defined: usize,
    /// The number of items without a place: [`State::Missing`], or not in the set.
    pub missing: usize,
    /// Number of skipped items.
    pub skipped: usize,
    /// Name of the first item that has no position and is not skipped.
    pub next: Option<String>,
}

/// Why a text is no template.
#[derive(Debug, thiserror::Error)]
pub enum TemplateError {
    /// The text is longer than any template.
    #[error("a template of {bytes} bytes, allowed: up to {}", Template::MOST_BYTES)]
    Long {
        /// Its length.
        bytes: usize,
    },
    /// It is no JSON, or has keys or kinds of values that a template does not have.
    #[error("{path}: {source}")]
    Json {
        /// The key's path.
        path: String,
        /// The error of the JSON parser, with line and column.
        source: serde_json::Error,
    },
    /// A value is out of its range.
    #[error(transparent)]
    Wrong(#[from] OutOfRange),
}

impl ExpectedKind {
    /// The kind of this geometry.
    #[must_use]
    pub const fn of(geometry: &Geometry) -> Self {
        match geometry {
            Geometry::Point { .. } => Self::Point,
            Geometry::Line { .. } => Self::Line,
            Geometry::Angle { .. } => Self::Angle,
            Geometry::Curve { .. } => Self::Curve,
            Geometry::Plane { .. } => Self::Plane,
            Geometry::Region(_) => Self::Region,
            Geometry::Mesh(_) => Self::Mesh,
        }
    }
}

impl Template {
    /// Most items.
    pub const MOST_ITEMS: usize = 2000;
    /// Longest text that is read: as much as `store` keeps.
    pub const MOST_BYTES: usize = 1 << 20;

    /// Reads a template's JSON.
    ///
    /// # Errors
    /// When the text is long, no JSON, has unknown keys, or a value is wrong: with its path.
    pub fn read(json: &[u8]) -> Result<Self, TemplateError> {
        if json.len() > Self::MOST_BYTES {
            return Err(TemplateError::Long { bytes: json.len() });
        }
        let mut reader = serde_json::Deserializer::from_slice(json);
        let read: Self = serde_path_to_error::deserialize(&mut reader).map_err(|error| {
            TemplateError::Json { path: error.path().to_string(), source: error.into_inner() }
        })?;
        reader.end().map_err(|source| TemplateError::Json { path: ".".to_owned(), source })?;
        read.validate()?;
        Ok(read)
    }

    /// The template as JSON, indented for people.
    #[must_use]
    pub fn json(&self) -> String {
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }

    /// A template of these items, in their order, without their positions: templates of other tools
    /// are files of points without positions.
    ///
    /// # Errors
    /// As [`validate`](Self::validate).
    pub fn of_items<'a>(name: &str, items: impl IntoIterator<Item = &'a Item>) -> Result<Self, OutOfRange> {
        let expected = |item: &Item| Expected {
            name: item.name.clone(),
            description: item.description.clone(),
            concept: item.concept.clone(),
            rgb: item.rgb,
            kind: item.geometry.as_ref().map(ExpectedKind::of).unwrap_or_default(),
        };
        let items = items.into_iter().map(expected).collect();
        let template = Self { name: name.to_owned(), description: String::new(), items };
        template.validate()?;
        Ok(template)
    }

    /// Checks every value.
    ///
    /// # Errors
    /// The first that is wrong, with its path.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        Set::check_name(&self.name).map_err(|error| OutOfRange { path: "name".to_owned(), ..error })?;
        let count = self.items.len();
        if !(1..=Self::MOST_ITEMS).contains(&count) {
            let allowed = format!("1 to {}", Self::MOST_ITEMS);
            return Err(OutOfRange::new("items", format!("{count} items"), allowed));
        }
        let characters = self.description.chars().count();
        if characters > Item::LONGEST_DESCRIPTION {
            let allowed = format!("at most {} characters", Item::LONGEST_DESCRIPTION);
            return Err(OutOfRange::new("description", format!("{characters} characters"), allowed));
        }
        let mut known = HashSet::new();
        for (index, expected) in self.items.iter().enumerate() {
            let at = |error: OutOfRange| error.within(&format!("items[{index}]"));
            expected.validate().map_err(at)?;
            if !known.insert(&expected.name) {
                let found = "the name of an item before it";
                return Err(at(OutOfRange::new("name", found, "one item of each name")));
            }
        }
        Ok(())
    }

    /// The items that a set needs to have all that is expected, [`State::Missing`], in the
    /// template's order.
    ///
    /// `present` are the set's items in the same frame of reference. An item with an expected name
    /// counts as present in any list and state, so applying a template twice adds nothing.
    ///
    /// # Errors
    /// When this machine gives no random numbers.
    pub fn missing<'a>(
        &self,
        set: &str,
        author: &str,
        frame_of_reference: Option<&FrameOfReference>,
        present: impl IntoIterator<Item = &'a Item>,
    ) -> Result<Vec<Item>, getrandom::Error> {
        let present: HashSet<&str> = present.into_iter().map(|item| item.name.as_str()).collect();
        let lacking =
            self.items.iter().enumerate().filter(|(_, expected)| !present.contains(expected.name.as_str()));
        let create = |(order, expected): (usize, &Expected)| {
            Ok(Item {
                set: set.to_owned(),
                list: self.name.clone(),
                order: order as u32,
                description: expected.description.clone(),
                rgb: expected.rgb,
                concept: expected.concept.clone(),
                frame_of_reference: frame_of_reference.cloned(),
                ..Item::new(&expected.name, author, None)?
            })
        };
        lacking.map(create).collect()
    }

    /// The progress of a set. Of items of one name the one in the template's list counts, then the
    /// first with a place.
    pub fn completeness<'a>(&self, present: impl IntoIterator<Item = &'a Item>) -> Completeness {
        let mut best: std::collections::HashMap<&str, &Item> = std::collections::HashMap::new();
        let rank = |item: &Item| (item.list == self.name, item.state == State::Defined);
        for item in present {
            let known = best.entry(item.name.as_str()).or_insert(item);
            if rank(item) > rank(known) {
                *known = item;
            }
        }
        let mut found =
            Completeness { template: self.name.clone(), defined: 0, missing: 0, skipped: 0, next: None };
        for expected in &self.items {
            match best.get(expected.name.as_str()).map_or(State::Missing, |item| item.state) {
                State::Defined => found.defined += 1,
                State::Skipped => found.skipped += 1,
                State::Missing => {
                    found.missing += 1;
                    found.next.get_or_insert_with(|| expected.name.clone());
                }
            }
        }
        found
    }
}

impl Expected {
    /// The same ranges as an item's.
    fn validate(&self) -> Result<(), OutOfRange> {
        // The fields are those of an item that has no place yet, whose check they therefore pass.
        Item {
            id: super::item::ItemId::from_number(0),
            set: Set::DEFAULT.to_owned(),
            list: String::new(),
            order: 0,
            name: self.name.clone(),
            description: self.description.clone(),
            rgb: self.rgb,
            concept: self.concept.clone(),
            state: State::Missing,
            geometry: None,
            locked: false,
            visible: true,
            frame_of_reference: None,
            phase: None,
            author: "template".to_owned(),
            created: super::time::Timestamp::now(),
            placement: None,
        }
        .validate()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relief_base::Point;

    const SKULL: &str = r#"{"name":"skull","items":[
        {"name":"nasion","description":"Where both nasal bones meet the frontal bone","rgb":[1,0.5,0],
         "concept":{"code":"T-1","scheme":"99REL","meaning":"Nasion"}},
        {"name":"width","kind":"line"},
        {"name":"menton"}]}"#;

    fn skull() -> Template {
        Template::read(SKULL.as_bytes()).unwrap()
    }

    #[test]
    fn a_template_is_written_and_read_alike() {
        let skull = skull();
        assert_eq!(skull.items[1].kind, ExpectedKind::Line);
        assert_eq!(Template::read(skull.json().as_bytes()).unwrap(), skull);
    }

    #[test]
    fn invalid_fields_are_named_with_their_path() {
        let refused = |from: &str, to: &str| {
            assert!(SKULL.contains(from), "{from}");
            Template::read(SKULL.replacen(from, to, 1).as_bytes()).unwrap_err().to_string()
        };
        assert!(refused("\"line\"", "\"lines\"").starts_with("items[1].kind: unknown variant `lines`"));
        assert!(refused("\"rgb\"", "\"color\"").starts_with("items[0].color: unknown field `color`"));
        assert!(refused("0.5", "5").starts_with("items[0].rgb[1] is 5, allowed: 0 to 1"));
        assert!(refused("menton", "nasion").starts_with("items[2].name is the name of an item before it"));
        assert!(refused("T-1", "").starts_with("items[0].concept.code is 0 characters"));
        assert!(refused("menton", "").starts_with("items[2].name is 0 characters"));
        assert!(refused("\"skull\"", "\"a b\"").starts_with("name is \"a b\""));
        assert!(refused("]}", "]} x").contains("trailing characters at line 5"));
        assert!(
            Template::read(br#"{"name":"none","items":[]}"#).unwrap_err().to_string().contains("0 items")
        );
        assert!(Template::read(b"").unwrap_err().to_string().contains("EOF"));
        let long = vec![b' '; Template::MOST_BYTES + 1];
        let read = Template::read(&long);
        assert!(matches!(read, Err(TemplateError::Long { bytes }) if bytes == long.len()), "{read:?}");
    }

    #[test]
    fn a_second_application_adds_only_what_is_not_there() {
        let frame = FrameOfReference("1.2.3".to_owned());
        let mut made = skull().missing("reader-a", "anna", Some(&frame), []).unwrap();
        let names: Vec<_> = made.iter().map(|item| (item.name.as_str(), item.order)).collect();
        assert_eq!(names, [("nasion", 0), ("width", 1), ("menton", 2)]);
        for item in &made {
            item.validate().unwrap();
            assert_eq!((item.state, &*item.list, &*item.set), (State::Missing, "skull", "reader-a"));
            assert_eq!(item.frame_of_reference.as_ref(), Some(&frame));
        }
        assert_eq!(made[0].concept.as_ref().unwrap().meaning, "Nasion");
        assert!(skull().missing("reader-a", "anna", None, &made).unwrap().is_empty());
        made.remove(1);
        let again = skull().missing("reader-a", "anna", None, &made).unwrap();
        assert_eq!(again.iter().map(|item| (&*item.name, item.order)).collect::<Vec<_>>(), [("width", 1)]);
    }

    #[test]
    fn completeness_counts_and_says_what_comes_next() {
        let mut items = skull().missing("a", "anna", None, []).unwrap();
        let of = |items: &[Item]| {
            let Completeness { defined, missing, skipped, next, .. } = skull().completeness(items);
            (defined, missing, skipped, next)
        };
        assert_eq!(of(&items), (0, 3, 0, Some("nasion".to_owned())));
        items[0].state = State::Skipped;
        items[2].state = State::Defined;
        assert_eq!(of(&items), (1, 1, 1, Some("width".to_owned())));
        // A point of another list does not hide the template's own.
        items.push(
            Item::new("width", "anna", Some(Geometry::Point { at_mm: Point::new(0.0, 0.0, 0.0) })).unwrap(),
        );
        assert_eq!(of(&items).1, 1);
        items.remove(1);
        assert_eq!(of(&items), (2, 0, 1, None));
        assert_eq!(of(&[]), (0, 3, 0, Some("nasion".to_owned())));
    }

    #[test]
    fn items_of_a_file_become_a_template_without_their_places() {
        let placed =
            Item::new("a", "anna", Some(Geometry::Point { at_mm: Point::new(1.0, 2.0, 3.0) })).unwrap();
        let line = Geometry::Line { ends_mm: [Point::new(0.0, 0.0, 0.0), Point::new(1.0, 0.0, 0.0)] };
        let items =
            [placed, Item::new("b", "anna", None).unwrap(), Item::new("c", "anna", Some(line)).unwrap()];
        let template = Template::of_items("t", &items).unwrap();
        let kinds: Vec<_> = template.items.iter().map(|expected| expected.kind).collect();
        assert_eq!(kinds, [ExpectedKind::Point, ExpectedKind::Point, ExpectedKind::Line]);
        let twice = [items[0].clone(), items[0].clone()];
        assert_eq!(Template::of_items("t", &twice).unwrap_err().path, "items[1].name");
    }
}
