//! Objects of DICOM: reports and segmentations, whose readers and writers are `dicom`'s.

use std::collections::BTreeMap;

use super::reading::Reading;
use super::{ExchangeError, Format, Imported, LeftOut, ReadContext, WriteContext, regions};
use relief_annotation::{FrameOfReference, Item, Timestamp};
use relief_dicom::{LoadLimits, SegmentMeaning, SegmentationOptions, SeriesReference};
use relief_volume::LabelMap;

/// Reads the items of a report.
///
/// # Errors
/// As [`super::read`]; places are tags and numbers of items.
pub(super) fn read_report(bytes: &[u8], context: &ReadContext<'_>) -> Result<Imported, ExchangeError> {
    let options = relief_dicom::ReportReadOptions { author: context.author, series: context.series };
    let found =
        relief_dicom::read_report(bytes, &options).map_err(|error| ExchangeError::Report(Box::new(error)))?;
    let mut reading = Reading::new(Format::Sr, context);
    for warning in found.warnings {
        reading.warn("", &warning);
    }
    for (order, item) in (0..).zip(found.items) {
        let place = format!("group {}", order + 1);
        let frame = frame(Format::Sr, &place, item.frame_of_reference.clone(), context)?;
        let set = context.set.to_owned();
        let item = Item { set, list: context.list.to_owned(), order, frame_of_reference: frame, ..item };
        reading.push(&place, item)?;
    }
    Ok(reading.finish())
}

/// A frame of reference that is the series', or the only one that is known.
fn frame(
    format: Format,
    place: &str,
    own: Option<FrameOfReference>,
    context: &ReadContext<'_>,
) -> Result<Option<FrameOfReference>, ExchangeError> {
    let known = context.frame_of_reference;
    if own.is_some() && known.is_some() && own.as_ref() != known {
        let allowed = "that one; read the file without a series to keep its own";
        let place = format!("the frame of reference of {place}");
        return Err(ExchangeError::value(format, place, "another one than the series'", allowed));
    }
    Ok(own.or_else(|| known.cloned()))
}

/// Reads a structure set: contours are curves, in a list for each structure.
///
/// # Errors
/// As [`super::read`]; places are tags and numbers of items.
pub(super) fn read_structure_set(bytes: &[u8], context: &ReadContext<'_>) -> Result<Imported, ExchangeError> {
    let found = relief_dicom::read_structure_set(bytes)
        .map_err(|error| ExchangeError::StructureSet(Box::new(error)))?;
    let (items, left_out) = found.items(context.author)?;
    let mut reading = Reading::new(Format::RtStruct, context);
    for warning in found.warnings.iter().chain(&left_out) {
        reading.warn("", warning);
    }
    for (number, item) in (1..).zip(items) {
        let place = format!("contour {number}");
        let frame_of_reference = frame(Format::RtStruct, &place, item.frame_of_reference.clone(), context)?;
        let list = item.list.chars().take(Item::LONGEST_NAME).collect();
        let set = context.set.to_owned();
        reading.push(&place, Item { set, list, frame_of_reference, ..item })?;
    }
    Ok(reading.finish())
}

/// Reads a segmentation: its segments are regions.
///
/// # Errors
/// As [`super::read`]; places are tags.
pub(super) fn read_segmentation(
    format: Format,
    bytes: &[u8],
    context: &ReadContext<'_>,
) -> Result<Imported, ExchangeError> {
    let found =
        relief_dicom::read_segmentation_layers(LoadLimits { voxel_bytes: 2 * context.most_voxels() }, bytes);
    let found = found.map_err(|defect| ExchangeError::Object(Box::new(defect)))?;
    regions::of_layers(format, &found.layers, found.warnings, context)
}

/// The series that an object is about.
fn series<'a>(format: Format, context: &WriteContext<'a>) -> Result<&'a SeriesReference, ExchangeError> {
    let what =
        "a DICOM series that it is about, whose study and frame of reference it repeats (--series DIR)";
    context.series.ok_or(ExchangeError::Needs { format, what })
}

/// A report of items, and their number.
///
/// # Errors
/// When there is no series, or none of the items can be in a report.
pub(super) fn write_report(
    items: &[&Item],
    context: &WriteContext<'_>,
    left_out: &mut Vec<LeftOut>,
) -> Result<(Vec<u8>, usize), ExchangeError> {
    let options = relief_dicom::ReportWriteOptions { made: begun(items), ..Default::default() };
    let items: Vec<Item> = items.iter().copied().cloned().collect();
    let written = relief_dicom::write_report(&items, series(Format::Sr, context)?, &options);
    let written = written.map_err(|error| ExchangeError::Report(Box::new(error)))?;
    let count = items.len() - written.left_out.len();
    let mut reasons: BTreeMap<String, Vec<_>> = BTreeMap::new();
    for lost in written.left_out {
        reasons.entry(lost.reason.to_string()).or_default().push(lost.item);
    }
    let lost = reasons.into_iter().map(|(reason, items)| LeftOut { what: "items".to_owned(), reason, items });
    left_out.extend(lost);
    let notes = written.notes.into_iter();
    left_out.extend(notes.map(|reason| LeftOut {
        what: "parts of items".to_owned(),
        reason,
        items: Vec::new(),
    }));
    Ok((written.bytes, count))
}

/// When the first item was made: the date of an object's content is that of its beginning (PS3.3,
/// C.17.2). Thus the same items make the same object whenever they are written.
fn begun(items: &[&Item]) -> Timestamp {
    items.iter().map(|item| item.created).min().unwrap_or_else(Timestamp::now)
}

/// A segmentation of regions in layers, or a label map of a single one.
///
/// # Errors
/// When there is no series, or the map is no stack of frames.
pub(super) fn write_segmentation(
    format: Format,
    maps: &[LabelMap],
    items: &[&Item],
    context: &WriteContext<'_>,
) -> Result<Vec<u8>, ExchangeError> {
    let author = items.first().map_or("", |item| item.author.as_str());
    let meaning = |(label, item): (u16, &&Item)| SegmentMeaning {
        label,
        concept: item.concept.clone(),
        item: Some(item.id),
    };
    let meanings = (1..).zip(items).map(meaning).collect();
    let (made, warnings) = (begun(items), context.warnings.to_vec());
    let options = SegmentationOptions { meanings, made, warnings, ..SegmentationOptions::by(author) };
    let series = series(format, context)?;
    let bytes = match (format, maps) {
        (Format::LabelMap, [map]) => relief_dicom::write_label_map(map, series, &options),
        _ => relief_dicom::write_segmentation_layers(maps, series, &options),
    };
    bytes.map_err(|error| ExchangeError::Segmentation(Box::new(error)))
}
