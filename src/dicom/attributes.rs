//! Values of single attributes, or their defects.
//!
//! Every error names the attribute, the found and the expected value. No function has a default.

use dicom_core::Tag;
use dicom_dictionary_std::tags;

use super::dataset::DataSet;
use super::error::{Attribute, Defect};

const fn attribute(tag: Tag, keyword: &'static str) -> Attribute {
    Attribute { tag, keyword }
}

pub(super) const ROWS: Attribute = attribute(tags::ROWS, "Rows");
pub(super) const COLUMNS: Attribute = attribute(tags::COLUMNS, "Columns");
pub(super) const FRAMES: Attribute = attribute(tags::NUMBER_OF_FRAMES, "NumberOfFrames");
pub(super) const SAMPLES: Attribute = attribute(tags::SAMPLES_PER_PIXEL, "SamplesPerPixel");
pub(super) const BITS_ALLOCATED: Attribute = attribute(tags::BITS_ALLOCATED, "BitsAllocated");
pub(super) const BITS_STORED: Attribute = attribute(tags::BITS_STORED, "BitsStored");
pub(super) const HIGH_BIT: Attribute = attribute(tags::HIGH_BIT, "HighBit");
pub(super) const REPRESENTATION: Attribute = attribute(tags::PIXEL_REPRESENTATION, "PixelRepresentation");
pub(super) const PADDING: Attribute = attribute(tags::PIXEL_PADDING_VALUE, "PixelPaddingValue");
pub(super) const POSITION: Attribute = attribute(tags::IMAGE_POSITION_PATIENT, "ImagePositionPatient");
pub(super) const ORIENTATION: Attribute =
    attribute(tags::IMAGE_ORIENTATION_PATIENT, "ImageOrientationPatient");
pub(super) const SPACING: Attribute = attribute(tags::PIXEL_SPACING, "PixelSpacing");
pub(super) const THICKNESS: Attribute = attribute(tags::SLICE_THICKNESS, "SliceThickness");
pub(super) const BETWEEN: Attribute = attribute(tags::SPACING_BETWEEN_SLICES, "SpacingBetweenSlices");
pub(super) const SLOPE: Attribute = attribute(tags::RESCALE_SLOPE, "RescaleSlope");
pub(super) const INTERCEPT: Attribute = attribute(tags::RESCALE_INTERCEPT, "RescaleIntercept");
pub(super) const PER_FRAME: Attribute =
    attribute(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE, "PerFrameFunctionalGroupsSequence");

pub(super) const SEGMENTATION: Attribute = attribute(tags::SEGMENTATION_TYPE, "SegmentationType");
pub(super) const SEGMENT: Attribute = attribute(tags::SEGMENT_NUMBER, "SegmentNumber");
pub(super) const REFERENCED_SEGMENT: Attribute =
    attribute(tags::REFERENCED_SEGMENT_NUMBER, "ReferencedSegmentNumber");

/// A positive number in mm; `None` when absent or unusable, for attributes that nothing depends on.
pub(super) fn positive(data: &DataSet, attribute: Attribute) -> Option<f64> {
    let [mm] = numbers(data, attribute, "a positive number in mm").ok()?;
    (1e-4..1e4).contains(&mm).then_some(mm)
}

/// A text value; empty when absent.
pub(super) fn text(data: &DataSet, tag: Tag) -> String {
    data.text(tag).unwrap_or_default()
}

/// A value of a file for a message: its first 80 characters in quotes. (`{:.80?}` does not cut texts.)
pub(super) fn quoted(text: &str) -> String {
    format!("{:?}", text.chars().take(80).collect::<String>())
}

/// `N` finite decimal numbers.
pub(super) fn numbers<const N: usize>(
    data: &DataSet,
    attribute: Attribute,
    expected: &'static str,
) -> Result<[f64; N], Defect> {
    let Some(text) = data.text(attribute.tag) else {
        return Err(Defect::Attribute { attribute, found: "nothing".to_owned(), expected });
    };
    let parsed: Option<Vec<f64>> = text
        .split('\\')
        .map(|part| part.trim().parse().ok().filter(|value: &f64| value.abs() < 1e9))
        .collect();
    let parsed = parsed.and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
    parsed.ok_or_else(|| Defect::Attribute { attribute, found: quoted(&text), expected })
}

/// An unsigned integer; `None` when absent.
pub(super) fn unsigned(data: &DataSet, attribute: Attribute) -> Result<Option<u32>, Defect> {
    data.unsigned(attribute.tag).map_err(|bytes| Defect::Attribute {
        attribute,
        found: format!("{bytes} bytes"),
        expected: "an unsigned integer",
    })
}

/// An unsigned integer that must be there.
pub(super) fn required(data: &DataSet, attribute: Attribute, expected: &'static str) -> Result<u32, Defect> {
    unsigned(data, attribute)?.ok_or_else(|| Defect::Attribute {
        attribute,
        found: "nothing".to_owned(),
        expected,
    })
}

/// A defect of the attribute unless `holds`.
pub(super) fn check<T: std::fmt::Display + ?Sized>(
    holds: bool,
    attribute: Attribute,
    found: &T,
    expected: &'static str,
) -> Result<(), Defect> {
    if holds { Ok(()) } else { Err(Defect::Attribute { attribute, found: found.to_string(), expected }) }
}
