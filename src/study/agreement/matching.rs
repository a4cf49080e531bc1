//! The items of several readings that are the same target: those of one name in one case.

use std::collections::{BTreeSet, HashMap};

use serde::Serialize;

use relief_annotation::{FrameOfReference, Item, State};

/// The thing to be placed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Target<'a> {
    /// The patient: from 0, in the order in which the readings have them.
    pub(super) case: usize,
    /// Its list, where the name alone is ambiguous.
    pub(super) list: &'a str,
    pub(super) name: &'a str,
    /// The item of each reading.
    pub(super) found: Vec<Result<&'a Item, Absence>>,
}

/// Why a reading has no place of a target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Absence {
    /// It has no item of this name.
    Absent,
    /// Its item has no place yet.
    Missing,
    /// Its reader went on without it.
    Skipped,
    /// The set has several items of this name in one list, so the match is ambiguous.
    Ambiguous,
    /// Its item is of another kind than the others', a line for a point for instance.
    OtherKind,
}

impl Absence {
    /// In words, after "it is ...".
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Absent => "not in the set",
            Self::Missing => "without a place",
            Self::Skipped => "skipped",
            Self::Ambiguous => "there more than once",
            Self::OtherKind => "of another kind",
        }
    }
}

/// The targets of readings in the order in which the readings have them.
///
/// Items are matched by name; also by list, where a reading has a name in several lists. Readings
/// are of as many cases as there are frames of reference; items that do not know theirs are of the
/// only case, if there is only one.
pub(super) fn targets<'a>(readings: &[&[&'a Item]]) -> Vec<Target<'a>> {
    let case_of = cases(readings);
    let mut named: HashMap<(usize, &str), Vec<Vec<&Item>>> = HashMap::new();
    let mut order = Vec::new();
    for (reading, items) in readings.iter().enumerate() {
        for item in *items {
            let key = (case_of[&item.frame_of_reference.as_ref()], item.name.as_str());
            let found = named.entry(key).or_insert_with(|| {
                order.push(key);
                vec![Vec::new(); readings.len()]
            });
            found[reading].push(item);
        }
    }
    let mut targets = Vec::new();
    for (case, name) in order {
        let readings = &named[&(case, name)];
        if readings.iter().all(|items| items.len() <= 1) {
            let found = readings.iter().map(|items| only(items)).collect();
            targets.push(Target { case, list: "", name, found });
            continue;
        }
        let lists: BTreeSet<&str> = readings.iter().flatten().map(|item| item.list.as_str()).collect();
        for list in lists {
            let of_list = |items: &Vec<&'a Item>| {
                only(&items.iter().copied().filter(|item| item.list == list).collect::<Vec<_>>())
            };
            targets.push(Target { case, list, name, found: readings.iter().map(of_list).collect() });
        }
    }
    targets.iter_mut().for_each(same_kind);
    targets.sort_by_key(|target| target.case);
    targets
}

/// A number for each frame of reference.
fn cases<'a>(readings: &[&[&'a Item]]) -> HashMap<Option<&'a FrameOfReference>, usize> {
    let mut cases = HashMap::new();
    let frames =
        || readings.iter().flat_map(|items| items.iter()).map(|item| item.frame_of_reference.as_ref());
    let known: std::collections::HashSet<_> = frames().flatten().collect();
    for frame in frames() {
        let next = if known.len() <= 1 { 0 } else { cases.len() };
        cases.entry(frame).or_insert(next);
    }
    cases
}

/// The only item of these, if it has a place.
fn only<'a>(items: &[&'a Item]) -> Result<&'a Item, Absence> {
    match items {
        [] => Err(Absence::Absent),
        [item] => match item.state {
            State::Defined if item.geometry.is_some() => Ok(item),
            State::Defined | State::Missing => Err(Absence::Missing),
            State::Skipped => Err(Absence::Skipped),
        },
        _ => Err(Absence::Ambiguous),
    }
}

/// Leaves the items that are of the kind that most readings have; of as many, the kind that came
/// first.
fn same_kind(target: &mut Target<'_>) {
    let kind = |item: &Item| item.geometry.as_ref().map(relief_annotation::Geometry::kind);
    let placed = || target.found.iter().filter_map(|found| found.ok()).filter_map(kind);
    let count = |wanted: &str| placed().filter(|kind| *kind == wanted).count();
    let Some(common) = placed().reduce(|best, kind| if count(kind) > count(best) { kind } else { best })
    else {
        return;
    };
    for found in &mut target.found {
        if found.is_ok_and(|item| kind(item) != Some(common)) {
            *found = Err(Absence::OtherKind);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{named, point};
    use super::*;
    use relief_annotation::Geometry;
    use relief_base::Point;

    fn matched<'a>(readings: &[&'a [Item]]) -> Vec<Target<'a>> {
        let readings: Vec<Vec<&Item>> = readings.iter().map(|items| items.iter().collect()).collect();
        targets(&readings.iter().map(Vec::as_slice).collect::<Vec<_>>())
    }

    fn summary(targets: &[Target<'_>]) -> Vec<(String, Vec<Option<Absence>>)> {
        let name = |target: &Target<'_>| format!("{}/{}/{}", target.case, target.list, target.name);
        targets.iter().map(|t| (name(t), t.found.iter().map(|found| found.err()).collect())).collect()
    }

    #[test]
    fn items_are_matched_by_name_and_missing_ones_are_listed() {
        let a = [point("nasion", 1.0), point("menton", 2.0), point("sella", 3.0)];
        let mut skipped = named("menton", None);
        skipped.state = State::Skipped;
        // Lists are file names, and differ between readers.
        let b = [Item { list: "b.mrk".to_owned(), ..point("nasion", 1.5) }, skipped, named("sella", None)];
        use Absence::{Absent, Missing, Skipped};
        assert_eq!(
            summary(&matched(&[&a, &b, &[]])),
            [
                ("0//nasion".to_owned(), vec![None, None, Some(Absent)]),
                ("0//menton".to_owned(), vec![None, Some(Skipped), Some(Absent)]),
                ("0//sella".to_owned(), vec![None, Some(Missing), Some(Absent)]),
            ]
        );
    }

    #[test]
    fn lists_tell_apart_what_names_do_not() {
        let of = |list: &str, x| Item { list: list.to_owned(), ..point("tip", x) };
        let (a, b) = ([of("left", 1.0), of("right", 2.0)], [of("right", 2.1), of("left", 1.1)]);
        let found = matched(&[&a, &b]);
        assert_eq!(
            summary(&found),
            [("0/left/tip".to_owned(), vec![None; 2]), ("0/right/tip".to_owned(), vec![None; 2])]
        );
        assert_eq!(found[0].found[1].unwrap().point().unwrap().xyz.x, 1.1);
        let twice = [of("left", 1.0), of("left", 2.0)];
        let found = matched(&[&twice, &b]);
        assert_eq!(found[0].found[0], Err(Absence::Ambiguous));
    }

    #[test]
    fn patients_are_kept_apart_by_their_frames() {
        let of = |frame: &str, x| Item {
            frame_of_reference: Some(FrameOfReference(frame.to_owned())),
            ..point("nasion", x)
        };
        let (a, b) = ([of("1.1", 1.0), of("1.2", 50.0)], [of("1.2", 50.1), of("1.1", 1.1)]);
        let found = matched(&[&a, &b]);
        let pairs: Vec<_> = found
            .iter()
            .map(|target| {
                (target.case, target.found.iter().map(|f| f.unwrap().point().unwrap().xyz.x).collect())
            })
            .collect::<Vec<(_, Vec<_>)>>();
        assert_eq!(pairs, [(0, vec![1.0, 1.1]), (1, vec![50.0, 50.1])]);
        // A file that does not say its frame is of the only patient there is.
        let unsaid = [point("nasion", 1.2)];
        assert_eq!(matched(&[&a[..1], &unsaid]).len(), 1);
        assert_eq!(matched(&[&a, &unsaid]).len(), 3);
    }

    #[test]
    fn a_line_is_no_point() {
        let line = Geometry::Line { ends_mm: [Point::new(0.0, 0.0, 0.0), Point::new(1.0, 0.0, 0.0)] };
        let (a, b, c) = ([named("x", Some(line))], [point("x", 1.0)], [point("x", 2.0)]);
        assert_eq!(
            summary(&matched(&[&a, &b, &c])),
            [("0//x".to_owned(), vec![Some(Absence::OtherKind), None, None])]
        );
    }
}
