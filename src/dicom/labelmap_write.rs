//! Label maps as DICOM Label Map Segmentation objects about a series (PS3.3 A.51, C.8.20, of
//! Supplement 243).
//!
//! A frame is a slice whose pixels are labels, 8 or 16 bits each; slices without a segment are left
//! out. Segments keep their labels as their numbers. Number 0 is the background, which is the padding
//! value and has a description of its own. Few programs read these objects yet; `segmentation_write` writes
//! BINARY ones.
//!
//! Space: patient LPS mm, as in `segmentation_write`.

use dicom_core::value::PrimitiveValue;
use dicom_core::{DataElement, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;

use super::object::{self, Code, put, put_equipment, put_items, put_numbers, uid_of};
use super::reference::SeriesReference;
use super::segmentation_write::{
    MOST_PIXEL_BYTES, POSITION_DIMENSION, Pixels, Planes, SegmentationError, SegmentationOptions,
    check_right_angles, put_dimensions, put_identity, put_image, segment_item,
};
use relief_volume::LabelMap;

/// The category and the type of the background.
const BACKGROUND: Code = Code::dcm("125040", "Background");

/// Writes a label map as a Label Map Segmentation about a series. The same map, series and options
/// make the same bytes. Segments that have no voxels are described.
///
/// # Errors
/// When the series has no frame of reference, no voxel is labelled, or the map's grid is no stack
/// of frames.
pub fn write_label_map(
    map: &LabelMap,
    series: &SeriesReference,
    options: &SegmentationOptions,
) -> Result<Vec<u8>, SegmentationError> {
    check_right_angles(map)?;
    let [nx, ny, nz] = map.grid().dims();
    let area = nx * ny;
    let is_labelled = |slice: &usize| (0..area).any(|at| map.places().at(slice * area + at) > 0);
    let slices: Vec<usize> = (0..nz).filter(is_labelled).collect();
    if slices.is_empty() {
        return Err(SegmentationError::Nothing);
    }
    let largest = map.segments().iter().map(|segment| segment.label).max().unwrap_or(0);
    let bits = if largest > u16::from(u8::MAX) { 16 } else { 8 };
    let bytes = area as u64 * slices.len() as u64 * u64::from(bits / 8);
    let (Ok(columns), Ok(rows), true) = (u16::try_from(nx), u16::try_from(ny), bytes <= MOST_PIXEL_BYTES)
    else {
        return Err(SegmentationError::TooLarge { dims: map.grid().dims(), frames: slices.len() });
    };
    let mut object = InMemDicomObject::new_empty();
    series.put_patient_and_study(&mut object);
    series.put_frame_of_reference(&mut object).ok_or(SegmentationError::NoFrameOfReference)?;
    put_equipment(&mut object);
    let maps = std::slice::from_ref(map);
    put_identity(&mut object, uids::LABEL_MAP_SEGMENTATION_STORAGE, maps, series, options);
    put_image(&mut object, Pixels { kind: "LABELMAP", bits }, [rows, columns], slices.len());
    put(&mut object, tags::SEGMENTS_OVERLAP, VR::CS, "NO");
    put_numbers(&mut object, tags::PIXEL_PADDING_VALUE, &[0]);
    let described = map.segments().iter().map(|segment| segment_item(segment.label, segment, options));
    let segments = std::iter::once(background(options)).chain(described).collect();
    put_items(&mut object, tags::SEGMENT_SEQUENCE, segments);
    let uid = uid_of(b"dimensions of a label map", [map.content_hash().0]);
    put_dimensions(&mut object, &uid, &[POSITION_DIMENSION]);
    let planes = Planes::new(map, series);
    put_items(&mut object, tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE, vec![planes.shared()]);
    let groups = slices.iter().map(|slice| planes.groups(*slice, None)).collect();
    put_items(&mut object, tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE, groups);
    // Only where a frame refers to an image of it (PS3.3 C.12.4).
    if slices.iter().any(|slice| planes.sources[*slice].is_some()) {
        let referenced = series.referenced_series(tags::REFERENCED_INSTANCE_SEQUENCE);
        put_items(&mut object, tags::REFERENCED_SERIES_SEQUENCE, vec![referenced]);
    }
    let voxels = slices.iter().flat_map(|slice| slice * area..(slice + 1) * area);
    object.put_element(pixels(map, voxels, bits));
    object::file_bytes(object, false).map_err(SegmentationError::Encoding)
}

/// The labels of voxels as pixels.
fn pixels(map: &LabelMap, voxels: impl Iterator<Item = usize>, bits: u16) -> DataElement<InMemDicomObject> {
    let labels: Vec<u16> = std::iter::once(0).chain(map.segments().iter().map(|one| one.label)).collect();
    let labels = voxels.map(|at| labels[map.places().at(at)]);
    if bits == 16 {
        return DataElement::new(tags::PIXEL_DATA, VR::OW, PrimitiveValue::U16(labels.collect()));
    }
    // Labels are below 256 here; the length of an element is even.
    let mut bytes: Vec<u8> = labels.map(|label| label as u8).collect();
    bytes.resize(bytes.len().next_multiple_of(2), 0);
    DataElement::new(tags::PIXEL_DATA, VR::OB, PrimitiveValue::from(bytes))
}

/// The description of number 0.
fn background(options: &SegmentationOptions) -> InMemDicomObject {
    let mut item = InMemDicomObject::new_empty();
    put_numbers(&mut item, tags::SEGMENT_NUMBER, &[0]);
    put(&mut item, tags::SEGMENT_LABEL, VR::LO, "Background");
    let kind = if options.is_manual { "MANUAL" } else { "SEMIAUTOMATIC" };
    put(&mut item, tags::SEGMENT_ALGORITHM_TYPE, VR::CS, kind);
    if !options.is_manual {
        put(&mut item, tags::SEGMENT_ALGORITHM_NAME, VR::LO, "Relief");
    }
    put_items(&mut item, tags::SEGMENTED_PROPERTY_CATEGORY_CODE_SEQUENCE, vec![BACKGROUND.item()]);
    put_items(&mut item, tags::SEGMENTED_PROPERTY_TYPE_CODE_SEQUENCE, vec![BACKGROUND.item()]);
    item
}
