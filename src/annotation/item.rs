//! One annotation: name, geometry, author and placement.

use serde::{Deserialize, Serialize};

use super::check::{self, line, shortened, text, validate_geometry, within};
use super::geometry::Geometry;
use super::placement::Placement;
use super::time::Timestamp;
use relief_base::{OutOfRange, Patient, Point};

/// An annotation. The HTTP interface, the event log and `relief annotate list --json` use its JSON
/// form.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Item {
    /// Its name for programs; never used again.
    pub id: ItemId,
    /// The set that it is in.
    #[serde(default = "Set::default_name")]
    pub set: String,
    /// The list within the set that it belongs to; empty for none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub list: String,
    /// Position in the list and in the set, ascending; equal positions are sorted by creation.
    #[serde(default)]
    pub order: u32,
    /// The name that people use for it.
    pub name: String,
    /// Anything else that people want to say.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// Display-referred sRGB, 0..1; `None` uses the colour of its kind.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rgb: Option<[f64; 3]>,
    /// Code of its meaning in a coding scheme.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub concept: Option<Concept>,
    /// Whether it has been placed.
    #[serde(default)]
    pub state: State,
    /// Its geometry: there where the state is [`State::Defined`], and only then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub geometry: Option<Geometry>,
    /// A locked item changes in nothing but its lock.
    #[serde(default)]
    pub locked: bool,
    /// Whether it is drawn.
    #[serde(default = "visible")]
    pub visible: bool,
    /// Frame of reference of its positions; `None` if a file did not state it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame_of_reference: Option<FrameOfReference>,
    /// The phase to which its position belongs, from 1, where it was placed in one of the phases of a
    /// series. It is drawn in that phase only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub phase: Option<u32>,
    /// The author.
    pub author: String,
    /// The time of creation.
    pub created: Timestamp,
    /// How it came to its place, last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub placement: Option<Placement>,
}

fn visible() -> bool {
    true
}

/// 128 random bits, written as a UUID (RFC 9562, version 4).
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct ItemId(u128);

/// Whether an item has been placed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// It has a place.
    #[default]
    Defined,
    /// It is expected (by a template, say), and has no place yet, or this patient has none.
    Missing,
    /// An author decided to leave it without a position.
    Skipped,
}

/// A concept of a coding scheme, such as DICOM's or SNOMED CT's.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Concept {
    /// The code value.
    pub code: String,
    /// The scheme's designator, such as `DCM` or `SCT`.
    pub scheme: String,
    /// Meaning of the code, in words.
    pub meaning: String,
}

/// Frame of reference of positions: a DICOM Frame of Reference UID, or `volume:` and the beginning
/// of the content hash for volumes without one. `Debug` shows neither, because a UID leads to a
/// patient.
#[derive(Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct FrameOfReference(pub String);

impl std::fmt::Debug for FrameOfReference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("FrameOfReference(withheld)")
    }
}

impl FrameOfReference {
    /// Frame of reference of a volume: the UID of its series, or else its id, the beginning of its
    /// content hash.
    #[must_use]
    pub fn of(uid: Option<&str>, volume_id: &str) -> Self {
        Self(uid.map_or_else(|| format!("volume:{volume_id}"), str::to_owned))
    }
}

/// A set of items: one reader's, or one purpose's.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Set {
    /// Its name: 1 to 64 letters, digits and `-_.`.
    pub name: String,
    /// The only author who may write into it; `None` allows all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reader: Option<String>,
    /// Whether only its reader sees it, and its reader only it.
    #[serde(default)]
    pub blinded: bool,
    /// Name of the template that its items were expected by.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub template: Option<String>,
}

impl Set {
    /// The set of items that name none.
    pub const DEFAULT: &str = "default";
    /// Most characters of a set's name.
    pub const LONGEST_NAME: usize = 64;

    fn default_name() -> String {
        Self::DEFAULT.to_owned()
    }

    /// Checks a set's name.
    ///
    /// # Errors
    /// When it is empty, long, or has other characters than letters, digits, `-`, `_` and `.`.
    pub fn check_name(name: &str) -> Result<(), OutOfRange> {
        let is_good = |letter: char| letter.is_ascii_alphanumeric() || "-_.".contains(letter);
        let length = name.chars().count();
        if (1..=Self::LONGEST_NAME).contains(&length) && name.chars().all(is_good) {
            return Ok(());
        }
        let allowed = format!("1 to {} letters, digits, - _ and .", Self::LONGEST_NAME);
        Err(OutOfRange::new("set", shortened(name), allowed))
    }
}

impl Item {
    /// Most characters of a name.
    pub const LONGEST_NAME: usize = check::LONGEST_NAME;
    /// Most characters of a description.
    pub const LONGEST_DESCRIPTION: usize = check::LONGEST_DESCRIPTION;
    /// Most points of a curve.
    pub const MOST_POINTS: usize = check::MOST_POINTS;
    /// Coordinates, mm either way: those of cameras and overlays.
    pub const FARTHEST_MM: f64 = check::FARTHEST_MM;

    /// A new item of the default set, defined, visible and not locked.
    ///
    /// # Errors
    /// When this machine gives no random numbers.
    pub fn new(name: &str, author: &str, geometry: Option<Geometry>) -> Result<Self, getrandom::Error> {
        Ok(Self {
            id: ItemId::random()?,
            set: Set::default_name(),
            list: String::new(),
            order: 0,
            name: name.to_owned(),
            description: String::new(),
            rgb: None,
            concept: None,
            state: if geometry.is_some() { State::Defined } else { State::Missing },
            geometry,
            locked: false,
            visible: true,
            frame_of_reference: None,
            phase: None,
            author: author.to_owned(),
            created: Timestamp::now(),
            placement: None,
        })
    }

    /// The landmark's place, of a defined point.
    #[must_use]
    pub fn point(&self) -> Option<Point<Patient>> {
        match self.geometry {
            Some(Geometry::Point { at_mm }) => Some(at_mm),
            _ => None,
        }
    }

    /// Whether it belongs to this phase of a series, from 1. An item without a phase belongs to all
    /// phases, and every item belongs to a volume without phases.
    #[must_use]
    pub fn is_in_phase(&self, shown: Option<usize>) -> bool {
        let (Some(own), Some(shown)) = (self.phase, shown) else { return true };
        usize::try_from(own) == Ok(shown)
    }

    /// Checks every range, and that state and geometry agree.
    ///
    /// # Errors
    /// The first value that is wrong, with its key's path.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        Set::check_name(&self.set)?;
        line("name", &self.name, 1)?;
        line("list", &self.list, 0)?;
        line("author", &self.author, 1)?;
        text("description", &self.description)?;
        self.concept.as_ref().map_or(Ok(()), Concept::validate)?;
        let frame = self.frame_of_reference.as_ref().map(|frame| frame.0.as_str());
        // Its value is in no message.
        if frame.is_some_and(|frame| frame.is_empty() || frame.len() > 96 || frame.contains(char::is_control))
        {
            return Err(OutOfRange::new("frame_of_reference", "no UID", "a UID, or volume: and digits"));
        }
        for (index, channel) in self.rgb.iter().flatten().enumerate() {
            within(&format!("rgb[{index}]"), *channel, [0.0, 1.0])?;
        }
        match (self.state, &self.geometry) {
            (State::Defined, Some(geometry)) => validate_geometry(geometry),
            (State::Missing | State::Skipped, None) => Ok(()),
            (State::Defined, None) => {
                Err(OutOfRange::new("state", "defined, without a geometry", "missing or skipped without one"))
            }
            (state, Some(_)) => {
                let found = format!("{state:?}, with a geometry").to_lowercase();
                Err(OutOfRange::new("state", found, "defined with one"))
            }
        }?;
        self.placement.as_ref().map_or(Ok(()), Placement::validate)
    }
}

impl Concept {
    fn validate(&self) -> Result<(), OutOfRange> {
        // Bounds of DICOM's SH and LO: a concept goes into its files.
        for (key, value, most) in
            [("code", &self.code, 16), ("scheme", &self.scheme, 16), ("meaning", &self.meaning, 64)]
        {
            line(&format!("concept.{key}"), value, 1)?;
            if value.chars().count() > most {
                let found = format!("{} characters", value.chars().count());
                return Err(OutOfRange::new(format!("concept.{key}"), found, format!("1 to {most}")));
            }
        }
        Ok(())
    }
}

impl ItemId {
    /// A new one.
    ///
    /// # Errors
    /// When this machine gives no random numbers.
    pub fn random() -> Result<Self, getrandom::Error> {
        let mut bytes = [0; 16];
        getrandom::fill(&mut bytes)?;
        bytes[6] = bytes[6] & 0x0f | 0x40; // version 4
        bytes[8] = bytes[8] & 0x3f | 0x80; // the variant of RFC 9562
        Ok(Self(u128::from_be_bytes(bytes)))
    }

    /// The id as a number: `2.25.` before it makes a DICOM UID.
    #[must_use]
    pub const fn number(self) -> u128 {
        self.0
    }

    /// The id of a number.
    #[must_use]
    pub const fn from_number(number: u128) -> Self {
        Self(number)
    }
}

impl std::fmt::Display for ItemId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let hex = format!("{:032x}", self.0);
        write!(f, "{}-{}-{}-{}-{}", &hex[..8], &hex[8..12], &hex[12..16], &hex[16..20], &hex[20..])
    }
}

impl std::fmt::Debug for ItemId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "ItemId({self})")
    }
}

impl std::str::FromStr for ItemId {
    type Err = OutOfRange;

    fn from_str(text: &str) -> Result<Self, OutOfRange> {
        let is_dash = |at: usize| [8, 13, 18, 23].contains(&at);
        let is_good =
            |(at, byte): (usize, u8)| if is_dash(at) { byte == b'-' } else { byte.is_ascii_hexdigit() };
        let digits =
            (text.len() == 36 && text.bytes().enumerate().all(is_good)).then(|| text.replace('-', ""));
        digits.and_then(|digits| u128::from_str_radix(&digits, 16).ok()).map(Self).ok_or_else(|| {
            OutOfRange::new("id", shortened(text), "a UUID, such as 0b51f4c4-95e2-4a4f-9e3b-1c1c5d8a7f10")
        })
    }
}

impl TryFrom<String> for ItemId {
    type Error = OutOfRange;

    fn try_from(text: String) -> Result<Self, OutOfRange> {
        text.parse()
    }
}

impl From<ItemId> for String {
    fn from(id: ItemId) -> Self {
        id.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x: f64) -> Item {
        Item::new("nasion", "anna", Some(Geometry::Point { at_mm: Point::new(x, 2.0, 3.0) })).unwrap()
    }

    #[test]
    fn an_item_is_written_and_read_alike() {
        let mut item = point(1.0);
        item.concept = Some(Concept {
            code: "T-1".to_owned(),
            scheme: "99REL".to_owned(),
            meaning: "Nasion".to_owned(),
        });
        item.frame_of_reference = Some(FrameOfReference("1.2.3".to_owned()));
        let json = serde_json::to_string(&item).unwrap();
        assert!(json.contains(r#""geometry":{"kind":"point","at_mm":[1.0,2.0,3.0]}"#), "{json}");
        assert_eq!(serde_json::from_str::<Item>(&json).unwrap(), item);
        let misspelt = json.replace("\"locked\"", "\"loked\"");
        assert!(serde_json::from_str::<Item>(&misspelt).unwrap_err().to_string().contains("loked"));
        assert!(!format!("{item:?}").contains("1.2.3"), "a UID leads to a patient");
    }

    #[test]
    fn ids_are_uuids_and_differ() {
        let [a, b] = [ItemId::random().unwrap(), ItemId::random().unwrap()];
        assert_ne!(a, b);
        let text = a.to_string();
        assert_eq!((text.len(), text.as_bytes()[14]), (36, b'4'), "{text}");
        assert_eq!(text.parse::<ItemId>(), Ok(a));
        for bad in ["", "x", "0b51f4c495e24a4f9e3b1c1c5d8a7f10", "0b51f4c4-95e2-4a4f-9e3b-1c1c5d8a7fZ0"] {
            assert!(bad.parse::<ItemId>().is_err(), "{bad}");
        }
    }

    #[test]
    fn invalid_fields_are_named_with_their_path() {
        let wrong = |change: &dyn Fn(&mut Item), says: &str| {
            let mut item = point(1.0);
            change(&mut item);
            let refused = item.validate().unwrap_err().to_string();
            assert!(refused.starts_with(says), "{refused}");
        };
        point(1.0).validate().unwrap();
        wrong(&|item| item.name = String::new(), "name is 0 characters");
        wrong(&|item| item.name = "a\nb".to_owned(), "name is a text with '\\n'");
        wrong(&|item| item.set = "a b".to_owned(), "set is \"a b\"");
        wrong(&|item| item.state = State::Skipped, "state is skipped, with a geometry, allowed: defined");
        wrong(&|item| item.geometry = None, "state is defined, without a geometry");
        wrong(&|item| item.rgb = Some([0.0, 2.0, 0.0]), "rgb[1] is 2, allowed: 0 to 1");
        wrong(&|item| *item = point(f64::NAN), "geometry.at_mm is NaN");
        let curve = |count: u32, closed| {
            let points_mm = (0..count).map(|x| Point::new(f64::from(x), 0.0, 0.0)).collect();
            Some(Geometry::Curve { points_mm, closed, smooth: false })
        };
        wrong(&|item| item.geometry = curve(2, true), "geometry.points_mm is 2 points, allowed: 3 to");
        let plane = |axis| Geometry::Plane {
            center_mm: Point::new(0.0, 0.0, 0.0),
            normal: [0.0, 0.0, 1.0],
            axis,
            size_mm: [10.0, 10.0],
        };
        wrong(&|item| item.geometry = Some(plane([0.0, 0.0, 1.0])), "geometry.axis is not across");
        wrong(&|item| item.geometry = Some(plane([0.0, 2.0, 0.0])), "geometry.axis is [0.0, 2.0, 0.0]");
    }
}
