//! Label maps as DICOM segmentation objects about a series: BINARY ones, which everybody reads.
//!
//! A frame is a slice of one segment; slices without the segment are left out (PS3.3 C.8.20, A.51).
//! Frames are packed bit by bit without alignment to bytes. Segments are renumbered from 1, as
//! the standard requires, in the order of their labels. `labelmap_write` writes LABELMAP objects.
//!
//! Space: patient LPS mm. Frames lie on the planes of the map's grid, wherever those of the series
//! are; a frame that lies on a slice of the series names it as its source.

use dicom_core::value::PrimitiveValue;
use dicom_core::{DataElement, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;
use glam::DVec3;

use super::object::{
    self, Code, EncodeError, LONG_STRING_CHARS, code_item, decimal_string, decimals, limited, put,
    put_equipment, put_items, put_many, put_numbers, uid_of,
};
use super::reference::{Instance, Plane, SeriesReference};
use super::segmentation::lab_of_srgb;
use super::warnings::WarningCode;
use relief_annotation::{Concept, ItemId, Timestamp};
use relief_volume::{LabelMap, Segment};

/// The largest deviation of directions from right angles, as a cosine: a thousandth of a voxel over
/// a slice of 1000.
const RIGHT_ANGLE: f64 = 1e-6;
/// The largest distance of a frame from the slice that it is matched with, mm.
const SAME_PLANE_MM: f64 = 1e-3;
/// Most bytes of pixels: an element's length has 32 bits.
pub(super) const MOST_PIXEL_BYTES: u64 = u32::MAX as u64 - 1;

const CATEGORY: Code = Code::new("85756007", "SCT", "Tissue");
const DERIVATION: Code = Code::dcm("113076", "Segmentation");
const PURPOSE: Code = Code::dcm("121322", "Source image for image processing operation");

/// Descriptive values of a segmentation.
#[derive(Clone, Debug)]
pub struct SegmentationOptions {
    /// Series description; viewers list it. Nothing of the patient belongs here.
    pub description: String,
    /// The author.
    pub author: String,
    /// When it was made.
    pub made: Timestamp,
    /// Whether it was drawn only by people; otherwise programs helped.
    pub is_manual: bool,
    /// Values of segments beyond their names and colours.
    pub meanings: Vec<SegmentMeaning>,
    /// Warnings of reading the series: Image Comments (0020,4000).
    pub warnings: Vec<WarningCode>,
}

/// The meaning of a segment, and its item.
#[derive(Clone, Debug)]
pub struct SegmentMeaning {
    /// The label that it has in the map.
    pub label: u16,
    /// Its category and type; tissue by default.
    pub concept: Option<Concept>,
    /// The item, whose id tracks the segment.
    pub item: Option<ItemId>,
}

impl SegmentationOptions {
    /// Those of an author now.
    #[must_use]
    pub fn by(author: &str) -> Self {
        Self {
            description: "Relief segmentation".to_owned(),
            author: author.to_owned(),
            made: Timestamp::now(),
            is_manual: false,
            meanings: Vec::new(),
            warnings: Vec::new(),
        }
    }
}

/// Why a segmentation could not be written. Messages hold neither UIDs nor names.
#[derive(Debug, thiserror::Error)]
pub enum SegmentationError {
    /// Frames must name a frame of reference.
    #[error(
        "the series has no Frame of Reference UID (0020,0052), which frames of a segmentation must name; export to \
         another format"
    )]
    NoFrameOfReference,
    /// Layers lie on different grids.
    #[error("layers of a segmentation lie on different grids, expected one; resample them")]
    Grids,
    /// No voxel belongs to a segment.
    #[error("no voxel belongs to a segment")]
    Nothing,
    /// The grid's axes are not at right angles.
    #[error(
        "the grid's axes are not at right angles (off by {off_deg:.4} degrees), which frames must be; resample the \
         map to a grid whose axes are"
    )]
    Sheared {
        /// The largest difference from a right angle, degrees.
        off_deg: f64,
    },
    /// Too many voxels for the attributes of an image.
    #[error(
        "found a grid of {dims:?} voxels with {frames} frames, expected 65535 columns and rows at most, and 4 GiB of bits"
    )]
    TooLarge {
        /// Voxels along i, j and k.
        dims: [usize; 3],
        /// Slices of all segments.
        frames: usize,
    },
    /// The object could not be put into bytes.
    #[error("the segmentation cannot be encoded: {0}")]
    Encoding(#[source] EncodeError),
}

/// A segment among those of all layers.
struct NumberedSegment<'a> {
    layer: usize,
    map: &'a LabelMap,
    /// Its place in the map, from 1.
    place: usize,
    segment: &'a Segment,
}

/// A slice of a segment.
#[derive(Clone, Copy)]
struct Frame {
    /// Its segment among those of all layers.
    index: usize,
    slice: usize,
}

/// Writes a label map as a segmentation about a series. The same map, series and options make the
/// same bytes. Segments that have no voxels are described and have no frames.
///
/// # Errors
/// When the series has no frame of reference, no voxel is labelled, or the map's grid is no stack
/// of frames.
pub fn write_segmentation(
    map: &LabelMap,
    series: &SeriesReference,
    options: &SegmentationOptions,
) -> Result<Vec<u8>, SegmentationError> {
    write_segmentation_layers(std::slice::from_ref(map), series, options)
}

/// As [`write_segmentation`], of several maps of one grid, whose segments may overlap: each has
/// frames of its own. Segments are in the order of their labels, which differ.
///
/// # Errors
/// As [`write_segmentation`], and when the maps are of different grids.
pub fn write_segmentation_layers(
    maps: &[LabelMap],
    series: &SeriesReference,
    options: &SegmentationOptions,
) -> Result<Vec<u8>, SegmentationError> {
    let map = maps.first().ok_or(SegmentationError::Nothing)?;
    if maps.iter().any(|other| other.grid() != map.grid()) {
        return Err(SegmentationError::Grids);
    }
    check_right_angles(map)?;
    let numbered = numbered(maps);
    let frames = frames(maps, &numbered);
    if frames.is_empty() {
        return Err(SegmentationError::Nothing);
    }
    let [nx, ny, _] = map.grid().dims();
    let bytes = (nx as u64 * ny as u64 * frames.len() as u64).div_ceil(8);
    let extents = (u16::try_from(nx), u16::try_from(ny));
    let (Ok(columns), Ok(rows), true) = (extents.0, extents.1, bytes <= MOST_PIXEL_BYTES) else {
        return Err(SegmentationError::TooLarge { dims: map.grid().dims(), frames: frames.len() });
    };
    let mut object = InMemDicomObject::new_empty();
    series.put_patient_and_study(&mut object);
    series.put_frame_of_reference(&mut object).ok_or(SegmentationError::NoFrameOfReference)?;
    put_equipment(&mut object);
    put_identity(&mut object, uids::SEGMENTATION_STORAGE, maps, series, options);
    put_image(&mut object, Pixels { kind: "BINARY", bits: 1 }, [rows, columns], frames.len());
    let segments: Vec<InMemDicomObject> =
        (1..).zip(&numbered).map(|(number, one)| segment_item(number, one.segment, options)).collect();
    put_items(&mut object, tags::SEGMENT_SEQUENCE, segments);
    let uid = uid_of(b"dimensions", maps.iter().map(|map| map.content_hash().0));
    put_dimensions(&mut object, &uid, &[SEGMENT_DIMENSION, POSITION_DIMENSION]);
    let planes = Planes::new(map, series);
    put_items(&mut object, tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE, vec![planes.shared()]);
    let groups =
        frames.iter().map(|frame| planes.groups(frame.slice, Some(frame.index as u16 + 1))).collect();
    put_items(&mut object, tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE, groups);
    // Only where a frame refers to an image of it (PS3.3 C.12.4).
    if frames.iter().any(|frame| planes.sources[frame.slice].is_some()) {
        let referenced = series.referenced_series(tags::REFERENCED_INSTANCE_SEQUENCE);
        put_items(&mut object, tags::REFERENCED_SERIES_SEQUENCE, vec![referenced]);
    }
    let bits = PrimitiveValue::from(packed(&numbered, &frames));
    object.put_element(DataElement::new(tags::PIXEL_DATA, VR::OB, bits));
    object::file_bytes(object, false).map_err(SegmentationError::Encoding)
}

pub(super) fn check_right_angles(map: &LabelMap) -> Result<(), SegmentationError> {
    let [x, y, z] = map.grid().axis_directions();
    let cosine = [x.dot(y), y.dot(z), z.dot(x)].into_iter().map(f64::abs).fold(0.0, f64::max);
    if cosine > RIGHT_ANGLE {
        return Err(SegmentationError::Sheared { off_deg: cosine.asin().to_degrees() });
    }
    Ok(())
}

/// The segments of all layers in the order of their labels.
fn numbered(maps: &[LabelMap]) -> Vec<NumberedSegment<'_>> {
    let mut all = Vec::new();
    for (layer, map) in maps.iter().enumerate() {
        let segments = (1..).zip(map.segments());
        all.extend(segments.map(|(place, segment)| NumberedSegment { layer, map, place, segment }));
    }
    all.sort_by_key(|one| one.segment.label);
    all
}

/// The slices of each segment that have voxels of it, segment by segment.
fn frames(maps: &[LabelMap], numbered: &[NumberedSegment<'_>]) -> Vec<Frame> {
    let occurs: Vec<Vec<Vec<bool>>> = maps.iter().map(occurrences).collect();
    let of = |(index, one): (usize, &NumberedSegment<'_>)| {
        let slices = occurs[one.layer][one.place].iter().enumerate().filter(|(_, occurs)| **occurs);
        slices.map(move |(slice, _)| Frame { index, slice }).collect::<Vec<_>>()
    };
    numbered.iter().enumerate().flat_map(of).collect()
}

/// For each place of a map, 0 among them, and each slice whether it occurs there.
fn occurrences(map: &LabelMap) -> Vec<Vec<bool>> {
    let [nx, ny, nz] = map.grid().dims();
    let mut occurs = vec![vec![false; nz]; map.segments().len() + 1];
    for at in 0..nx * ny * nz {
        occurs[map.places().at(at)][at / (nx * ny)] = true;
    }
    occurs
}

/// A bit for each voxel of each frame, the first in the lowest bit; an even number of bytes.
fn packed(numbered: &[NumberedSegment<'_>], frames: &[Frame]) -> Vec<u8> {
    let area = numbered.first().map_or(0, |one| one.map.grid().dims()[..2].iter().product());
    let mut bytes = vec![0u8; (area * frames.len()).div_ceil(8).next_multiple_of(2)];
    for (index, frame) in frames.iter().enumerate() {
        let NumberedSegment { map, place, .. } = &numbered[frame.index];
        for at in 0..area {
            if map.places().at(frame.slice * area + at) == *place {
                let bit = index * area + at;
                bytes[bit / 8] |= 1 << (bit % 8);
            }
        }
    }
    bytes
}

pub(super) fn put_identity(
    object: &mut InMemDicomObject,
    sop_class: &str,
    maps: &[LabelMap],
    series: &SeriesReference,
    options: &SegmentationOptions,
) {
    let made = options.made.to_string();
    let said = format!("{options:?}");
    let content: Vec<u8> = maps.iter().flat_map(|map| map.content_hash().0).collect();
    let parts = || {
        [
            sop_class.as_bytes(),
            series.series_uid().as_bytes(),
            content.as_slice(),
            made.as_bytes(),
            said.as_bytes(),
        ]
    };
    put(object, tags::SOP_CLASS_UID, VR::UI, sop_class);
    put(object, tags::SOP_INSTANCE_UID, VR::UI, &uid_of(b"segmentation", parts()));
    put(object, tags::SERIES_INSTANCE_UID, VR::UI, &uid_of(b"series of segmentations", parts()));
    put(object, tags::MODALITY, VR::CS, "SEG");
    put(object, tags::SERIES_NUMBER, VR::IS, "1");
    put(object, tags::INSTANCE_NUMBER, VR::IS, "1");
    let description = limited(&options.description, LONG_STRING_CHARS);
    let description = if description.is_empty() { "Relief segmentation" } else { &description };
    put(object, tags::SERIES_DESCRIPTION, VR::LO, description);
    let comments = WarningCode::summaries(&options.warnings);
    if !comments.is_empty() {
        put(object, tags::IMAGE_COMMENTS, VR::LT, format!("The segmented series: {comments}").as_str());
    }
    put(object, tags::CONTENT_LABEL, VR::CS, "SEGMENTATION");
    put(object, tags::CONTENT_DESCRIPTION, VR::LO, description);
    let author = limited(&options.author.replace('=', " "), LONG_STRING_CHARS);
    put(object, tags::CONTENT_CREATOR_NAME, VR::PN, &author);
    let (date, time) = object::date_and_time(options.made);
    put(object, tags::CONTENT_DATE, VR::DA, &date);
    put(object, tags::CONTENT_TIME, VR::TM, &time);
    put(object, tags::SERIES_DATE, VR::DA, &date);
    put(object, tags::SERIES_TIME, VR::TM, &time);
}

/// The pixels of a segmentation.
#[derive(Clone, Copy)]
pub(super) struct Pixels {
    /// SegmentationType (0062,0001).
    pub(super) kind: &'static str,
    /// Bits of a pixel.
    pub(super) bits: u16,
}

pub(super) fn put_image(
    object: &mut InMemDicomObject,
    pixels: Pixels,
    [rows, columns]: [u16; 2],
    frames: usize,
) {
    put_many(object, tags::IMAGE_TYPE, VR::CS, ["DERIVED", "PRIMARY"].map(str::to_owned));
    put(object, tags::PHOTOMETRIC_INTERPRETATION, VR::CS, "MONOCHROME2");
    put(object, tags::LOSSY_IMAGE_COMPRESSION, VR::CS, "00");
    put(object, tags::SEGMENTATION_TYPE, VR::CS, pixels.kind);
    put(object, tags::BURNED_IN_ANNOTATION, VR::CS, "NO");
    put(object, tags::NUMBER_OF_FRAMES, VR::IS, &frames.to_string());
    for (tag, value) in [
        (tags::SAMPLES_PER_PIXEL, 1),
        (tags::ROWS, rows),
        (tags::COLUMNS, columns),
        (tags::BITS_ALLOCATED, pixels.bits),
        (tags::BITS_STORED, pixels.bits),
        (tags::HIGH_BIT, pixels.bits - 1),
        (tags::PIXEL_REPRESENTATION, 0),
    ] {
        put_numbers(object, tag, &[value]);
    }
}

pub(super) fn segment_item(
    number: u16,
    segment: &Segment,
    options: &SegmentationOptions,
) -> InMemDicomObject {
    let mut item = InMemDicomObject::new_empty();
    put_numbers(&mut item, tags::SEGMENT_NUMBER, &[number]);
    let full = segment.name.clone().unwrap_or_else(|| format!("Segment {}", segment.label));
    let label = limited(&full, LONG_STRING_CHARS);
    let label = if label.is_empty() { format!("Segment {}", segment.label) } else { label };
    put(&mut item, tags::SEGMENT_LABEL, VR::LO, &label);
    if full != label {
        put(&mut item, tags::SEGMENT_DESCRIPTION, VR::ST, &full);
    }
    let kind = if options.is_manual { "MANUAL" } else { "SEMIAUTOMATIC" };
    put(&mut item, tags::SEGMENT_ALGORITHM_TYPE, VR::CS, kind);
    if !options.is_manual {
        put(&mut item, tags::SEGMENT_ALGORITHM_NAME, VR::LO, "Relief");
    }
    put_numbers(&mut item, tags::RECOMMENDED_DISPLAY_CIE_LAB_VALUE, &lab_of_srgb(segment.color()));
    put_items(&mut item, tags::SEGMENTED_PROPERTY_CATEGORY_CODE_SEQUENCE, vec![CATEGORY.item()]);
    let meaning = options.meanings.iter().find(|meaning| meaning.label == segment.label);
    let concept = meaning.and_then(|meaning| meaning.concept.as_ref());
    let kind = concept.map_or_else(|| CATEGORY.item(), |c| code_item(&c.code, &c.scheme, &c.meaning));
    put_items(&mut item, tags::SEGMENTED_PROPERTY_TYPE_CODE_SEQUENCE, vec![kind]);
    if let Some(id) = meaning.and_then(|meaning| meaning.item) {
        put(&mut item, tags::TRACKING_ID, VR::UT, &full);
        put(&mut item, tags::TRACKING_UID, VR::UI, &format!("2.25.{}", id.number()));
    }
    item
}

/// An attribute by which frames are indexed: itself, its functional group, and its label.
pub(super) type Dimension = (Tag, Tag, &'static str);
const SEGMENT_DIMENSION: Dimension =
    (tags::REFERENCED_SEGMENT_NUMBER, tags::SEGMENT_IDENTIFICATION_SEQUENCE, "Segment");
pub(super) const POSITION_DIMENSION: Dimension =
    (tags::IMAGE_POSITION_PATIENT, tags::PLANE_POSITION_SEQUENCE, "Position");

pub(super) fn put_dimensions(object: &mut InMemDicomObject, uid: &str, dimensions: &[Dimension]) {
    let mut organization = InMemDicomObject::new_empty();
    put(&mut organization, tags::DIMENSION_ORGANIZATION_UID, VR::UI, uid);
    put_items(object, tags::DIMENSION_ORGANIZATION_SEQUENCE, vec![organization]);
    let items = dimensions.iter().map(|&(pointer, group, label)| {
        let mut item = InMemDicomObject::new_empty();
        put(&mut item, tags::DIMENSION_ORGANIZATION_UID, VR::UI, uid);
        let at = |tag| PrimitiveValue::Tags([tag].into_iter().collect());
        item.put_element(DataElement::new(tags::DIMENSION_INDEX_POINTER, VR::AT, at(pointer)));
        item.put_element(DataElement::new(tags::FUNCTIONAL_GROUP_POINTER, VR::AT, at(group)));
        put(&mut item, tags::DIMENSION_DESCRIPTION_LABEL, VR::LO, label);
        item
    });
    put_items(object, tags::DIMENSION_INDEX_SEQUENCE, items.collect());
}

/// The positions of the frames, and the images that they were derived from.
pub(super) struct Planes<'a> {
    row: DVec3,
    column: DVec3,
    spacing_mm: [f64; 3],
    origin: DVec3,
    step: DVec3,
    /// For each slice of the grid the image of the series that lies on it.
    pub(super) sources: Vec<Option<(&'a Instance, &'a Plane)>>,
}

impl<'a> Planes<'a> {
    pub(super) fn new(map: &LabelMap, series: &'a SeriesReference) -> Self {
        let grid = map.grid();
        let [row, column, _] = grid.axis_directions();
        let affine = grid.patient_from_voxel().affine;
        let (origin, step) = (affine.translation, affine.matrix3.z_axis);
        let spacing_mm = grid.spacing_mm();
        let [dx, dy, _] = spacing_mm;
        let images: Vec<(&Instance, &Plane)> = series
            .instances()
            .iter()
            .flat_map(|instance| instance.planes.iter().map(move |plane| (instance, plane)))
            .filter(|(_, plane)| {
                let near = |a: DVec3, b: DVec3| a.distance(b) < 1e-4;
                let [across, down] = plane.pixel_mm;
                near(plane.row, row)
                    && near(plane.column, column)
                    && (across - dx).abs() < 1e-4
                    && (down - dy).abs() < 1e-4
            })
            .collect();
        let at = |slice: usize| origin + step * slice as f64;
        let source = |slice| {
            images.iter().copied().find(|(_, plane)| plane.position.distance(at(slice)) < SAME_PLANE_MM)
        };
        let sources = (0..grid.dims()[2]).map(source).collect();
        Self { row, column, spacing_mm, origin, step, sources }
    }

    /// The values that all frames share.
    pub(super) fn shared(&self) -> InMemDicomObject {
        let [dx, dy, dz] = self.spacing_mm;
        let mut measures = InMemDicomObject::new_empty();
        put_many(&mut measures, tags::PIXEL_SPACING, VR::DS, decimals(&[dy, dx]));
        put(&mut measures, tags::SLICE_THICKNESS, VR::DS, &decimal_string(dz));
        put(&mut measures, tags::SPACING_BETWEEN_SLICES, VR::DS, &decimal_string(dz));
        let mut orientation = InMemDicomObject::new_empty();
        let directions = [self.row.to_array(), self.column.to_array()].concat();
        put_many(&mut orientation, tags::IMAGE_ORIENTATION_PATIENT, VR::DS, decimals(&directions));
        let mut shared = InMemDicomObject::new_empty();
        put_items(&mut shared, tags::PIXEL_MEASURES_SEQUENCE, vec![measures]);
        put_items(&mut shared, tags::PLANE_ORIENTATION_SEQUENCE, vec![orientation]);
        shared
    }

    /// The attributes of a frame in a slice; of a single segment, where it has one.
    pub(super) fn groups(&self, slice: usize, segment: Option<u16>) -> InMemDicomObject {
        let mut groups = InMemDicomObject::new_empty();
        let position = self.origin + self.step * slice as f64;
        let mut place = InMemDicomObject::new_empty();
        put_many(&mut place, tags::IMAGE_POSITION_PATIENT, VR::DS, decimals(&position.to_array()));
        put_items(&mut groups, tags::PLANE_POSITION_SEQUENCE, vec![place]);
        let mut content = InMemDicomObject::new_empty();
        let indices = segment.map(u32::from).into_iter().chain([slice as u32 + 1]);
        let indices = PrimitiveValue::U32(indices.collect());
        content.put_element(DataElement::new(tags::DIMENSION_INDEX_VALUES, VR::UL, indices));
        put_items(&mut groups, tags::FRAME_CONTENT_SEQUENCE, vec![content]);
        if let Some(number) = segment {
            let mut segment = InMemDicomObject::new_empty();
            put_numbers(&mut segment, tags::REFERENCED_SEGMENT_NUMBER, &[number]);
            put_items(&mut groups, tags::SEGMENT_IDENTIFICATION_SEQUENCE, vec![segment]);
        }
        if let Some((instance, plane)) = self.sources[slice] {
            let mut source = instance.reference(Some(plane));
            put_items(&mut source, tags::PURPOSE_OF_REFERENCE_CODE_SEQUENCE, vec![PURPOSE.item()]);
            put(&mut source, tags::SPATIAL_LOCATIONS_PRESERVED, VR::CS, "YES");
            let mut derivation = InMemDicomObject::new_empty();
            put_items(&mut derivation, tags::SOURCE_IMAGE_SEQUENCE, vec![source]);
            put_items(&mut derivation, tags::DERIVATION_CODE_SEQUENCE, vec![DERIVATION.item()]);
            put_items(&mut groups, tags::DERIVATION_IMAGE_SEQUENCE, vec![derivation]);
        }
        groups
    }
}
