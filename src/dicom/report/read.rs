//! Reading reports of any program as items: measurement groups with coordinates.
//!
//! A group may be anywhere in a report. It becomes an item for each of its shapes: named by its
//! tracking identifier, or, where that names a tool of Cornerstone, by its finding. Nothing
//! recurses but the bounded walk over the data set.

use std::collections::HashSet;

use dicom_core::Tag;
use dicom_dictionary_std::tags;

use super::ReportError;
use super::codes::{
    COMMENT, CORNERSTONE_TOOLS, FINDING, FINDING_SITE, GROUP, NAMES_ONLY, PERSON_NAME, TRACKING_IDENTIFIER,
    TRACKING_UID,
};
use super::graphics::{self, FramedGeometry};
use crate::attributes::quoted;
use crate::charset::Charset;
use crate::dataset::{Bounds, Retention};
use crate::object::Code;
use crate::reference::SeriesReference;
use crate::report::node::Node;
use crate::report::node::Warnings;
use crate::whole::{self, ObjectError};
use relief_annotation::{FrameOfReference, Item, ItemId, Method, Placement, Timestamp};

/// The largest report that is read: one of ten thousand items has a quarter of it.
const MOST_BYTES: usize = 1 << 26;
/// Content of reports nests about six deep, and a code of it once more; values are texts and
/// coordinates.
const BOUNDS: Bounds = Bounds { deepest: 32, longest_value: 1 << 22, kept_bytes: 256 << 20 };
/// Most items of one report.
const MOST_ITEMS: usize = 100_000;

/// Values that a report does not contain and its reader supplies.
#[derive(Clone, Copy, Debug)]
pub struct ReportReadOptions<'a> {
    /// The author of items that name no observer.
    pub author: &'a str,
    /// The series that coordinates in pixels are of, where it is at hand.
    pub series: Option<&'a SeriesReference>,
}

/// The items of a report.
#[derive(Debug)]
pub struct ReadReport {
    /// In the order of the report; in the default set and in no list.
    pub items: Vec<Item>,
    /// Content that the items do not represent, as sentences.
    pub warnings: Vec<String>,
}

/// Reads the items of a report: Comprehensive 3D SR, or another one with measurement groups (TID
/// 1410 or 1501).
///
/// # Errors
/// When it is not a report, is damaged or too large, or has the wrong number of
/// coordinates for its type.
pub fn read_report(bytes: &[u8], options: &ReportReadOptions<'_>) -> Result<ReadReport, ReportError> {
    let data = whole::read(bytes, MOST_BYTES, BOUNDS, keep)?;
    let charset = Charset::of(&data);
    let root = Node { data: &data, path: String::new(), charset };
    if root.kind() != "CONTAINER" {
        let found = quoted(root.kind());
        let expected = "CONTAINER: the object is no structured report (SR)";
        return Err(root.wrong("ValueType", tags::VALUE_TYPE, found, expected).into());
    }
    let mut reader = Reader { options, root: &root, items: Vec::new(), ids: HashSet::new() };
    let mut warnings = Warnings::default();
    let groups = groups(&root);
    if groups.is_empty() {
        warnings.count("the report has no measurement groups", "it");
    }
    for group in &groups {
        reader.take(group, &mut warnings)?;
    }
    Ok(ReadReport { items: reader.items, warnings: warnings.sentences() })
}

fn keep(tag: Tag) -> Retention {
    match tag {
        tags::CONTENT_SEQUENCE
        | tags::CONCEPT_NAME_CODE_SEQUENCE
        | tags::CONCEPT_CODE_SEQUENCE
        | tags::EQUIVALENT_CODE_SEQUENCE
        | tags::REFERENCED_SOP_SEQUENCE => Retention::Items,
        tags::SPECIFIC_CHARACTER_SET
        | tags::CONTENT_DATE
        | tags::CONTENT_TIME
        | tags::OBSERVATION_DATE_TIME
        | tags::VALUE_TYPE
        | tags::TEXT_VALUE
        | tags::UID
        | tags::PERSON_NAME
        | tags::CODE_VALUE
        | tags::LONG_CODE_VALUE
        | tags::URN_CODE_VALUE
        | tags::CODING_SCHEME_DESIGNATOR
        | tags::CODE_MEANING
        | tags::GRAPHIC_TYPE
        | tags::GRAPHIC_DATA
        | tags::REFERENCED_FRAME_OF_REFERENCE_UID
        | tags::REFERENCED_SOP_INSTANCE_UID
        | tags::REFERENCED_FRAME_NUMBER => Retention::Value,
        _ => Retention::Nothing,
    }
}

/// All measurement groups, in the order of the report.
fn groups<'a>(root: &Node<'a>) -> Vec<Node<'a>> {
    let mut groups = Vec::new();
    let mut open: Vec<Node<'a>> = root.children();
    open.reverse();
    while let Some(node) = open.pop() {
        if node.kind() == "CONTAINER" && node.is(GROUP) {
            groups.push(node);
        } else {
            open.extend(node.children().into_iter().rev());
        }
    }
    groups
}

struct Reader<'a> {
    options: &'a ReportReadOptions<'a>,
    root: &'a Node<'a>,
    items: Vec<Item>,
    ids: HashSet<ItemId>,
}

impl Reader<'_> {
    /// The items of a group.
    fn take(&mut self, group: &Node<'_>, warnings: &mut Warnings) -> Result<(), ReportError> {
        let shapes = graphics::shapes(group, self.options.series, warnings)?;
        if shapes.is_empty() {
            warnings
                .count("measurement groups without coordinates that can be read are left out", &group.path);
            return Ok(());
        }
        if self.items.len() + shapes.len() > MOST_ITEMS {
            let found = format!("more than {MOST_ITEMS} shapes");
            return Err(group.wrong("ContentSequence", tags::CONTENT_SEQUENCE, found, "fewer").into());
        }
        let children = group.children();
        let find = |name: Code| children.iter().find(|child| child.is(name));
        let text = |name| find(name).map(|child| child.text(tags::TEXT_VALUE)).unwrap_or_default();
        let finding = find(FINDING).or_else(|| find(FINDING_SITE)).and_then(Node::concept);
        let name = name(&text(TRACKING_IDENTIFIER), finding.as_ref().map(|(_, name)| name.as_str()));
        let uid = find(TRACKING_UID).map(|child| child.text(tags::UID)).unwrap_or_default();
        let id = uid.strip_prefix("2.25.").and_then(|number| number.parse().ok()).map(ItemId::from_number);
        let several = shapes.len() > 1;
        for (index, FramedGeometry { geometry, frame_of_reference }) in shapes.into_iter().enumerate() {
            let name = if several { numbered(&name, index + 1) } else { name.clone() };
            let mut item = Item::new(&name, &self.author(&children), Some(geometry))?;
            // A thing may be tracked through several groups; an item's id is its own.
            if let Some(id) = id.filter(|id| !several && self.ids.insert(*id)) {
                item.id = id;
            }
            item.description = block(&text(COMMENT));
            item.concept = finding.as_ref().map(|(concept, _)| concept.clone());
            item.concept = item.concept.filter(|concept| !NAMES_ONLY.contains(&concept.scheme.as_str()));
            item.frame_of_reference = frame_of_reference.map(FrameOfReference);
            item.created = self.observed(group).unwrap_or(item.created);
            item.placement =
                Some(Placement { method: Method::Import, device: None, camera: None, snapped_mm: None });
            self.push(item, group, warnings)?;
        }
        Ok(())
    }

    /// Adds a sound item; an invalid code is left out.
    fn push(&mut self, mut item: Item, group: &Node<'_>, warnings: &mut Warnings) -> Result<(), ReportError> {
        if item.validate().is_err() && item.concept.take().is_some() {
            warnings
                .count("a finding's code is longer than codes are, or has no scheme: left out", &group.path);
        }
        item.validate().map_err(|error| ObjectError::Value {
            path: group.path.clone(),
            found: error.to_string(),
            expected: "a measurement group that an item can be made of",
        })?;
        self.items.push(item);
        Ok(())
    }

    /// The person of the group, else of the report, else the importing user.
    fn author(&self, children: &[Node<'_>]) -> String {
        let own =
            children.iter().find(|child| child.is(PERSON_NAME)).map(|child| child.text(tags::PERSON_NAME));
        let found = own.or_else(|| {
            let mut all = self.root.children().into_iter();
            all.find(|child| child.is(PERSON_NAME)).map(|child| child.text(tags::PERSON_NAME))
        });
        let found = line(&found.unwrap_or_default());
        if found.is_empty() { self.options.author.to_owned() } else { found }
    }

    /// When the group was observed, else when the report was made.
    fn observed(&self, group: &Node<'_>) -> Option<Timestamp> {
        let of = |node: &Node<'_>| moment(&node.text(tags::OBSERVATION_DATE_TIME));
        let made = || {
            let [date, time] = [tags::CONTENT_DATE, tags::CONTENT_TIME].map(|tag| self.root.text(tag));
            moment(&format!("{date}{time}"))
        };
        of(group).or_else(made)
    }
}

/// The name of a group's item.
fn name(tracking: &str, finding: Option<&str>) -> String {
    let is_tool = CORNERSTONE_TOOLS.iter().any(|tool| tracking.starts_with(tool));
    let candidates = if is_tool { [finding, None] } else { [Some(tracking), finding] };
    let names = candidates.into_iter().flatten().map(line);
    names.into_iter().find(|name| !name.is_empty()).unwrap_or_else(|| "unnamed".to_owned())
}

/// The name of one of several items.
fn numbered(name: &str, number: usize) -> String {
    let number = format!(" {number}");
    let start: String = name.chars().take(Item::LONGEST_NAME - number.len()).collect();
    start + &number
}

/// One line, as long as a name may be.
fn line(text: &str) -> String {
    let clean: String = text.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect();
    clean.trim().chars().take(Item::LONGEST_NAME).collect()
}

/// Lines, as long as a description may be.
fn block(text: &str) -> String {
    let lines = text.replace("\r\n", "\n");
    let is_good = |letter: &char| !letter.is_control() || matches!(letter, '\n' | '\t');
    lines.chars().filter(is_good).take(Item::LONGEST_DESCRIPTION).collect()
}

/// `YYYYMMDDHHMMSS.FFFFFF+ZZZZ`, of which all after the date may be missing; without an offset
/// taken as UTC.
fn moment(text: &str) -> Option<Timestamp> {
    let (stamp, offset) = match text.find(['+', '-']) {
        Some(at) => text.split_at(at),
        None => (text, "+0000"),
    };
    let (whole, fraction) = stamp.split_once('.').unwrap_or((stamp, "0"));
    if !text.is_ascii() || !(8..=14).contains(&whole.len()) || offset.len() != 5 {
        return None;
    }
    let whole = format!("{whole:0<14}");
    let at = |from: usize, to: usize| &whole[from..to];
    let (day, time) =
        ([at(0, 4), at(4, 6), at(6, 8)].join("-"), [at(8, 10), at(10, 12), at(12, 14)].join(":"));
    format!("{day}T{time}.{fraction}{}:{}", &offset[..3], &offset[3..]).parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_read_with_as_much_as_they_have() {
        for (text, expected) in [
            ("20260131120000.123+0130", "2026-01-31T10:30:00.123Z"),
            ("20260131", "2026-01-31T00:00:00.000Z"),
            ("202601311200-0500", "2026-01-31T17:00:00.000Z"),
        ] {
            assert_eq!(moment(text).unwrap().to_string(), expected);
        }
        for wrong in ["", "2026", "2026013199", "2026013112000ü", "20260131+1", "+0000", "20260131.+0000x"] {
            assert!(moment(wrong).is_none(), "{wrong}");
        }
    }

    #[test]
    fn a_tool_of_cornerstone_is_no_name() {
        assert_eq!(name("nasion", Some("x")), "nasion");
        assert_eq!(name("Cornerstone3DTools@^0.1.0:Length", Some("width")), "width");
        assert_eq!(name("cornerstoneTools@^4.0.0:Length", None), "unnamed");
        assert_eq!(name(" ", Some("a\nb")), "a b");
    }
}
