//! Losses: values that a format cannot represent. Every loss is reported.

use super::{ExchangeError, Format, NothingLeft};
use crate::representable::Representable;
use relief_annotation::{Geometry, Item, ItemId, State};
use relief_dicom::WarningCode;

/// Something that is not in a written file.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct LeftOut {
    /// The thing that is missing: whole items, or something of them.
    pub what: String,
    /// The reason, or the value that was written instead.
    pub reason: String,
    /// Of which items.
    pub items: Vec<ItemId>,
}

/// The items of a phase; the others are reported as a loss.
pub(super) fn of_phase(items: &[Item], phase: Option<usize>) -> (Vec<&Item>, Vec<LeftOut>) {
    let (kept, others): (Vec<&Item>, Vec<&Item>) = items.iter().partition(|item| item.is_in_phase(phase));
    let mut lost = Vec::new();
    tell(&mut lost, "items of other phases", "the file is of one phase", others.into_iter());
    (kept, lost)
}

/// The warnings of the series, which most formats cannot hold.
pub(super) fn of_warnings(warnings: &[WarningCode]) -> Option<LeftOut> {
    let reason = WarningCode::summaries(warnings);
    (!reason.is_empty()).then(|| LeftOut {
        what: "warnings of the series".to_owned(),
        reason,
        items: Vec::new(),
    })
}

/// The items that a format of texts can hold, in the order of files: by list, place in it and age;
/// and what gets lost, with the losses so far.
pub(super) fn kept(
    format: Format,
    items: Vec<&Item>,
    mut lost: Vec<LeftOut>,
) -> Result<(Vec<&Item>, Vec<LeftOut>), ExchangeError> {
    if items.is_empty() && !lost.is_empty() {
        return Err(ExchangeError::Nothing { format, reason: NothingLeft::OtherPhases });
    }
    let Some(holds) = format.info().holds else { return Ok((items, lost)) };
    let is_held =
        |item: &Item| item.geometry.as_ref().map_or(holds.undefined, |g| holds.kinds.contains(&g.kind()));
    let mut kept: Vec<&Item> = items.iter().copied().filter(|item| is_held(item)).collect();
    kept.sort_by_key(|item| (&item.list, item.order, item.created, item.id));
    let kinds = ["point", "line", "angle", "curve", "plane", "region", "mesh"];
    for kind in kinds.into_iter().filter(|kind| !holds.kinds.contains(kind)) {
        let reason = format!("{format} has none ({})", advice(kind));
        let is_kind = |item: &Item| item.geometry.as_ref().is_some_and(|geometry| geometry.kind() == kind);
        tell(&mut lost, &plural(kind), &reason, items.iter().copied().filter(|item| is_kind(item)));
    }
    if !holds.undefined {
        let missing = items.iter().copied().filter(|item| item.geometry.is_none());
        tell(&mut lost, "items without a place", &format!("{format} has none"), missing);
    }
    if kept.is_empty() {
        let found: Vec<String> =
            lost.iter().map(|lost| format!("{} {}", lost.items.len(), lost.what)).collect();
        let reason = if found.is_empty() {
            NothingLeft::NoItems
        } else {
            NothingLeft::Kinds { format, holds: holds.kinds, found }
        };
        return Err(ExchangeError::Nothing { format, reason });
    }
    fields(format, holds, &kept, &mut lost);
    Ok((kept, lost))
}

/// The fields that are lost of items that are kept.
fn fields(format: Format, holds: Representable, kept: &[&Item], lost: &mut Vec<LeftOut>) {
    let none = format!("{format} has none");
    type Has = fn(&Item) -> bool;
    let fields: [(bool, &str, &str, Has); 9] = [
        (holds.name, "names", "points are numbered in their order", |_| true),
        (holds.description, "descriptions", &none, |item| !item.description.is_empty()),
        (holds.line_breaks || !holds.description, "line breaks of descriptions", "they are spaces", |item| {
            item.description.contains('\n')
        }),
        (
            holds.quotes,
            "quotation marks",
            "they are ' for 3D Slicer reads none within a quoted text",
            |item| item.name.contains('"') || item.description.contains('"'),
        ),
        (holds.color, "colours", &none, |item| item.rgb.is_some()),
        (holds.concept, "concepts", &none, |item| item.concept.is_some()),
        (holds.locked, "locks", &none, |item| item.locked),
        (holds.visible, "hiding", "all are shown", |item| !item.visible),
        (
            holds.skipped || !holds.undefined,
            "skipping",
            "skipped items are not defined, as missing ones are",
            |item| item.state == State::Skipped,
        ),
    ];
    for (_, what, reason, has) in fields.into_iter().filter(|(is_held, ..)| !is_held) {
        tell(lost, what, reason, kept.iter().copied().filter(|item| has(item)));
    }
    if !holds.lists && kept.iter().any(|item| item.list != kept[0].list) {
        tell(lost, "lists", "the points of all are in one", kept.iter().copied());
    }
    if !holds.history {
        tell(lost, "ids, authors, times and ways of placing", &none, kept.iter().copied());
    }
    let is_straight = |item: &Item| matches!(item.geometry, Some(Geometry::Curve { smooth: false, .. }));
    if format == Format::MrkJson {
        let reason = "3D Slicer draws a smooth curve through their points; Relief does not";
        tell(lost, "straight parts of curves", reason, kept.iter().copied().filter(|item| is_straight(item)));
    }
}

fn tell<'a>(lost: &mut Vec<LeftOut>, what: &str, reason: &str, items: impl Iterator<Item = &'a Item>) {
    let items: Vec<ItemId> = items.map(|item| item.id).collect();
    if !items.is_empty() {
        lost.push(LeftOut { what: what.to_owned(), reason: reason.to_owned(), items });
    }
}

fn plural(kind: &str) -> String {
    if kind == "mesh" { "meshes".to_owned() } else { format!("{kind}s") }
}

/// The formats that hold items of a kind, as the end of a sentence.
fn advice(kind: &str) -> &'static str {
    match kind {
        "region" => "seg.nrrd, nii.gz, seg and labelmap have",
        "mesh" => "ply, stl, obj and glb have",
        _ => "mrk.json has",
    }
}
