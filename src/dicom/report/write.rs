//! Items as a Comprehensive 3D SR about a series.

use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;

use super::ReportError;
use super::codes::*;
use super::content::{ACQUISITION, CONTEXT, Content, MODIFIER};
use super::groups::UnreportableItem;
use super::groups::{self, Group, LONGEST_EXPLICIT};
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

/// Writes items as a report about a series. The same items, series and options make the same bytes.
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
    let (mut groups, mut kept, mut left_out) = (Vec::new(), Vec::new(), Vec::new());
    for item in items {
        let observer = (authors.len() > 1).then(|| person(&item.author));
        match groups::group(item, frame_of_reference, observer) {
            Ok(group) => {
                groups.push(group);
                kept.push(item);
            }
            Err(reason) => left_out.push(LeftOut { item: item.id, name: item.name.clone(), reason }),
        }
    }
    if groups.is_empty() {
        return Err(ReportError::Nothing(left_out));
    }
    let is_long = groups.iter().any(|group| group.points > LONGEST_EXPLICIT);
    let mut report = root(series, frame_of_reference, &authors, groups).build();
    put_modules(&mut report, series, options, &kept);
    let bytes = object::file_bytes(report, is_long).map_err(ReportError::Encoding)?;
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
fn root(series: &SeriesReference, frame_of_reference: &str, authors: &[&str], groups: Vec<Group>) -> Content {
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
            Content::container(MEASUREMENTS).with(groups.into_iter().map(|group| group.content)),
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
