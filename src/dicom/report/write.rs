//! Items as a Comprehensive 3D SR about a series.

use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;

use super::ReportError;
use super::codes::*;
use super::content::{ACQUISITION, CONTEXT, Content, MODIFIER};
use super::groups::UnreportableItem;
use super::groups::{self, LONGEST_EXPLICIT};
use crate::object::{self, LONG_STRING_CHARS, limited, put, put_equipment, put_items, uid_of};
use crate::reference::SeriesReference;
use relief_annotation::{Item, ItemId, Timestamp};

/// Most characters of one component group of a person's name.
const NAME_CHARS: usize = 64;

/// Descriptive values of a report.
#[derive(Clone, Debug)]
pub struct ReportWriteOptions {
    /// Series description; viewers list it. Nothing of the patient belongs here.
    pub description: String,
    /// When it was made.
    pub made: Timestamp,
}

impl Default for ReportWriteOptions {
    fn default() -> Self {
        Self { description: "Relief annotations".to_owned(), made: Timestamp::now() }
    }
}

/// A report as a file, and its losses.
#[derive(Debug)]
pub struct WrittenReport {
    /// The file.
    pub bytes: Vec<u8>,
    /// Items that are not in it.
    pub left_out: Vec<LeftOut>,
    /// Values of items that the report cannot represent, as sentences.
    pub notes: Vec<String>,
}

/// An item that a file cannot hold.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeftOut {
    /// Its id.
    pub item: ItemId,
    /// Its name.
    pub name: String,
    /// The reason for leaving it out, and the form that would hold it.
    pub reason: UnreportableItem,
}

/// Writes items as a report about a series. The same items, series and options make the same bytes. Each item is encoded before the next one is built, because objects in memory take forty times their encoded size.
///
/// # Errors
/// When the series has no frame of reference, or no item can be in a report.
pub fn write_report(
    items: &[Item],
    series: &SeriesReference,
    options: &ReportWriteOptions,
) -> Result<WrittenReport, ReportError> {
    let frame_of_reference = series.frame_of_reference().ok_or(ReportError::NoFrameOfReference)?;
    let authors = authors(items);
    let (mut kept, mut left_out, mut is_long) = (Vec::new(), Vec::new(), false);
    for item in items {
        match groups::points(item, frame_of_reference) {
            Ok(points) => {
                is_long |= points > LONGEST_EXPLICIT;
                kept.push(item);
            }
            Err(reason) => left_out.push(LeftOut { item: item.id, name: item.name.clone(), reason }),
        }
    }
    let mut groups = kept.iter().filter_map(|item| {
        let observer = (authors.len() > 1).then(|| person(&item.author));
        groups::group(item, frame_of_reference, observer).ok()
    });
    let Some(first) = groups.next() else { return Err(ReportError::Nothing(left_out)) };
    let mut report = root(series, frame_of_reference, &authors, [first]).build();
    put_modules(&mut report, series, options, &kept);
    let bytes = object::file_bytes(report, is_long)
        .and_then(|begun| object::with_more_items(begun, groups.map(Content::build), is_long))
        .map_err(ReportError::Encoding)?;
    Ok(WrittenReport { bytes, left_out, notes: notes(&kept) })
}

fn authors(items: &[Item]) -> Vec<&str> {
    let mut authors: Vec<&str> = Vec::new();
    for item in items {
        if !authors.contains(&item.author.as_str()) {
            authors.push(&item.author);
        }
    }
    authors
}

fn person(author: &str) -> Content {
    let name = limited(&author.replace('=', " "), NAME_CHARS);
    Content::person(CONTEXT, PERSON_NAME, &name)
}

/// The content: language, observers, procedure, image library, and the groups.
fn root(
    series: &SeriesReference,
    frame_of_reference: &str,
    authors: &[&str],
    groups: impl IntoIterator<Item = Content>,
) -> Content {
    let observer = |kind: object::Code| Content::code(CONTEXT, OBSERVER_TYPE, kind.item());
    let people = authors.iter().flat_map(|author| [observer(PERSON), person(author)]);
    let library = Content::container(IMAGE_LIBRARY_GROUP)
        .with([
            Content::code(ACQUISITION, MODALITY, CT.item()),
            Content::uid(ACQUISITION, FRAME_OF_REFERENCE, frame_of_reference),
        ])
        .with(series.instances().iter().map(Content::image));
    Content::root(REPORT, "1500").with([Content::code(MODIFIER, LANGUAGE, ENGLISH.item())]).with(people).with(
        [
            observer(DEVICE),
            Content::uid(CONTEXT, DEVICE_UID, OWN_UID),
            Content::text(CONTEXT, DEVICE_NAME, "Relief"),
            Content::code(MODIFIER, PROCEDURE_REPORTED, CT_OF_ANYTHING.item()),
            Content::container(IMAGE_LIBRARY).with([library]),
            Content::container(MEASUREMENTS).with(groups),
        ],
    )
}

/// Everything except the content: patient, kind of object, and the referenced series.
fn put_modules(
    report: &mut InMemDicomObject,
    series: &SeriesReference,
    options: &ReportWriteOptions,
    items: &[&Item],
) {
    series.put_patient_and_study(report);
    put_equipment(report);
    put(report, tags::SOP_CLASS_UID, VR::UI, uids::COMPREHENSIVE3_DSR_STORAGE);
    // Equal content gives the same object UID; any difference gives another one.
    let made = options.made.to_string();
    let content = serde_json::to_string(items).unwrap_or_default();
    let parts = [series.series_uid(), &options.description, &made, &content];
    put(report, tags::SOP_INSTANCE_UID, VR::UI, &uid_of(b"report", parts));
    put(report, tags::SERIES_INSTANCE_UID, VR::UI, &uid_of(b"series of reports", parts));
    put(report, tags::MODALITY, VR::CS, "SR");
    put(report, tags::SERIES_NUMBER, VR::IS, "1");
    put(report, tags::INSTANCE_NUMBER, VR::IS, "1");
    let description = limited(&options.description, LONG_STRING_CHARS);
    let description = if description.is_empty() { "Relief annotations" } else { &description };
    put(report, tags::SERIES_DESCRIPTION, VR::LO, description);
    let (date, time) = object::date_and_time(options.made);
    put(report, tags::CONTENT_DATE, VR::DA, &date);
    put(report, tags::CONTENT_TIME, VR::TM, &time);
    put(report, tags::COMPLETION_FLAG, VR::CS, "COMPLETE");
    put(report, tags::VERIFICATION_FLAG, VR::CS, "UNVERIFIED");
    put_items(report, tags::REFERENCED_PERFORMED_PROCEDURE_STEP_SEQUENCE, Vec::new());
    put_items(report, tags::PERFORMED_PROCEDURE_CODE_SEQUENCE, Vec::new());
    let mut evidence = InMemDicomObject::new_empty();
    put(&mut evidence, tags::STUDY_INSTANCE_UID, VR::UI, series.study_uid());
    let images = series.referenced_series(tags::REFERENCED_SOP_SEQUENCE);
    put_items(&mut evidence, tags::REFERENCED_SERIES_SEQUENCE, vec![images]);
    put_items(report, tags::CURRENT_REQUESTED_PROCEDURE_EVIDENCE_SEQUENCE, vec![evidence]);
    let schemes = [
        (NAMES, "Names of annotations", "Relief"),
        (CORNERSTONE, "Cornerstone3D", "Open Health Imaging Foundation"),
    ];
    let scheme = |(designator, name, organization)| {
        let mut item = InMemDicomObject::new_empty();
        put(&mut item, tags::CODING_SCHEME_DESIGNATOR, VR::SH, designator);
        put(&mut item, tags::CODING_SCHEME_NAME, VR::ST, name);
        put(&mut item, tags::CODING_SCHEME_RESPONSIBLE_ORGANIZATION, VR::ST, organization);
        item
    };
    put_items(report, tags::CODING_SCHEME_IDENTIFICATION_SEQUENCE, schemes.map(scheme).to_vec());
}

/// Properties of items that a report lacks.
fn notes(items: &[&Item]) -> Vec<String> {
    let count = |has: &dyn Fn(&Item) -> bool| items.iter().filter(|item| has(item)).count();
    let is_long = |item: &Item| {
        let is_point = item.point().is_some();
        !is_point && item.name.chars().count() > LONG_STRING_CHARS
    };
    let lost = [
        (count(&|item| item.rgb.is_some()), "the colour"),
        (count(&|item| item.locked), "the lock"),
        (count(&|item| !item.visible), "the hidden state"),
        (count(&|item| !item.list.is_empty()), "the list"),
        (count(&|item| item.placement.is_some()), "the record of placing"),
    ];
    let lost = lost.into_iter().filter(|(count, _)| *count > 0);
    let lost = lost.map(|(count, what)| format!("{what} of {count} item(s) is not in the report"));
    let cut = count(&is_long);
    let cut =
        (cut > 0).then(|| format!("the names of {cut} item(s) are cut to {LONG_STRING_CHARS} characters"));
    lost.chain(cut).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ExistingFolder, SeriesFolder, SeriesLabels, Strictness};
    use relief_annotation::Geometry;
    use relief_base::Point;
    use relief_volume::{Grid, Volume};

    /// A series of eight voxels that is written into a folder.
    fn series_in(folder: &std::path::Path) -> SeriesReference {
        let grid = Grid::axis_aligned([2; 3], [1.0; 3], [0.0; 3]).unwrap();
        let labels = SeriesLabels {
            patient_name: "PHANTOM".to_owned(),
            patient_id: "P".to_owned(),
            description: "D".to_owned(),
            body_part: String::new(),
            window_hu: (40, 400),
        };
        let place = folder.join("ct");
        let series = SeriesFolder::create(&place, ExistingFolder::Keep).unwrap();
        series.write_slices(&Volume::new(grid, vec![0; 8]).unwrap(), &labels, &|_| ()).unwrap();
        series.finish().unwrap();
        let found = crate::discover(&place, Strictness::Strict, &|_| ()).unwrap();
        SeriesReference::of(found.select(None).unwrap()).unwrap()
    }

    /// A report whose items are encoded one by one is equal to a report that is encoded as a whole.
    #[test]
    fn a_report_in_parts_has_the_bytes_of_a_whole_one() {
        let folder = tempfile::tempdir().unwrap();
        let series = series_in(folder.path());
        let frame = series.frame_of_reference().unwrap();
        for (count, length) in [(1, 2), (2, 2), (7, 3), (3, LONGEST_EXPLICIT + 1)] {
            let item = |number: usize| {
                let at = |k: usize| Point::new(number as f64, k as f64, 0.5);
                let points_mm = (0..length).map(at).collect();
                let geometry = Geometry::Curve { points_mm, closed: false, smooth: false };
                let author = ["anna", "Ren\u{e9}e"][number % 2];
                Item::new(&format!("\u{e4} {number}"), author, Some(geometry)).unwrap()
            };
            let items: Vec<Item> = (0..count).map(item).collect();
            let options = ReportWriteOptions::default();
            let written = write_report(&items, &series, &options).unwrap();
            let authors = authors(&items);
            let groups = items.iter().map(|item| {
                let observer = (authors.len() > 1).then(|| person(&item.author));
                groups::group(item, frame, observer).unwrap()
            });
            let mut whole = root(&series, frame, &authors, groups).build();
            put_modules(&mut whole, &series, &options, &items.iter().collect::<Vec<_>>());
            let whole = object::file_bytes(whole, length > LONGEST_EXPLICIT).unwrap();
            assert!(written.bytes == whole, "{count} curves of {length} points");
        }
    }
}
