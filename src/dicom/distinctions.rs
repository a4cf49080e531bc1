//! Values in which slices of one series may differ although they lie on one grid: quantity,
//! derivation, kernel, energy, thickness, pass, phase, time.
//!
//! They are texts without padding; numbers have one spelling ("2" for "2.0"). An absent value is
//! empty, but an absent quantity is HU. [`grouping`](super::grouping) decides what a difference means.

use dicom_core::Tag;
use dicom_dictionary_std::tags;

use super::charset::Charset;
use super::dataset::DataSet;
use super::groups::Groups;

/// An attribute that may distinguish slices of one grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Distinction {
    Quantity,
    ImageType,
    Kernel,
    Energy,
    Thickness,
    Stack,
    TemporalPosition,
    Acquisition,
    TriggerTime,
    AcquisitionTime,
    ContentTime,
    Description,
}

/// The quantity of values whose files name none.
pub(super) const HU: &str = "HU";

/// Number of [`Distinction`]s.
const COUNT: usize = 12;

impl Distinction {
    const ALL: [Self; COUNT] = [
        Self::Quantity,
        Self::ImageType,
        Self::Kernel,
        Self::Energy,
        Self::Thickness,
        Self::Stack,
        Self::TemporalPosition,
        Self::Acquisition,
        Self::TriggerTime,
        Self::AcquisitionTime,
        Self::ContentTime,
        Self::Description,
    ];

    /// Keyword and tag, for messages.
    pub(super) const fn attribute(self) -> &'static str {
        match self {
            Self::Quantity => "RescaleType (0028,1054)",
            Self::ImageType => "ImageType (0008,0008)",
            Self::Kernel => "ConvolutionKernel (0018,1210)",
            Self::Energy => "KVP (0018,0060)",
            Self::Thickness => "SliceThickness (0018,0050)",
            Self::Stack => "StackID (0020,9056)",
            Self::TemporalPosition => {
                "TemporalPositionIdentifier (0020,0100) or TemporalPositionIndex (0020,9128)"
            }
            Self::Acquisition => "AcquisitionNumber (0020,0012)",
            Self::TriggerTime => "TriggerTime (0018,1060)",
            Self::AcquisitionTime => "AcquisitionTime (0008,0032)",
            Self::ContentTime => "ContentTime (0008,0033)",
            Self::Description => "SeriesDescription (0008,103E)",
        }
    }

    /// The attribute of classic objects.
    const fn tag(self) -> Tag {
        match self {
            Self::Quantity => tags::RESCALE_TYPE,
            Self::ImageType => tags::IMAGE_TYPE,
            Self::Kernel => tags::CONVOLUTION_KERNEL,
            Self::Energy => tags::KVP,
            Self::Thickness => tags::SLICE_THICKNESS,
            Self::Stack => tags::STACK_ID,
            Self::TemporalPosition => tags::TEMPORAL_POSITION_IDENTIFIER,
            Self::Acquisition => tags::ACQUISITION_NUMBER,
            Self::TriggerTime => tags::TRIGGER_TIME,
            Self::AcquisitionTime => tags::ACQUISITION_TIME,
            Self::ContentTime => tags::CONTENT_TIME,
            Self::Description => tags::SERIES_DESCRIPTION,
        }
    }

    /// Functional group and attribute of a frame of an enhanced object (PS3.3 C.7.6.16, C.8.15).
    const fn of_frame(self) -> Option<(Tag, Tag)> {
        match self {
            Self::Quantity => Some((tags::PIXEL_VALUE_TRANSFORMATION_SEQUENCE, tags::RESCALE_TYPE)),
            Self::ImageType => Some((tags::CT_IMAGE_FRAME_TYPE_SEQUENCE, tags::FRAME_TYPE)),
            Self::Kernel => Some((tags::CT_RECONSTRUCTION_SEQUENCE, tags::CONVOLUTION_KERNEL)),
            Self::Energy => Some((tags::CTX_RAY_DETAILS_SEQUENCE, tags::KVP)),
            Self::Thickness => Some((tags::PIXEL_MEASURES_SEQUENCE, tags::SLICE_THICKNESS)),
            Self::Stack => Some((tags::FRAME_CONTENT_SEQUENCE, tags::STACK_ID)),
            Self::TemporalPosition => Some((tags::FRAME_CONTENT_SEQUENCE, tags::TEMPORAL_POSITION_INDEX)),
            Self::Acquisition => Some((tags::FRAME_CONTENT_SEQUENCE, tags::FRAME_ACQUISITION_NUMBER)),
            Self::TriggerTime | Self::AcquisitionTime | Self::ContentTime | Self::Description => None,
        }
    }

    /// Whether a value is that of a clock, which may differ from slice to slice.
    pub(super) const fn is_time(self) -> bool {
        matches!(self, Self::TriggerTime | Self::AcquisitionTime | Self::ContentTime)
    }
}

/// The values of a frame. `Debug` shows none: a description may name a patient.
#[derive(Clone, Default, PartialEq, Eq)]
pub(super) struct Distinctions([Box<str>; COUNT]);

impl std::fmt::Debug for Distinctions {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Distinctions(withheld)")
    }
}

impl Distinctions {
    /// The values of a frame.
    pub(super) fn of(groups: &Groups<'_>, frame: u32) -> Self {
        Self(Distinction::ALL.map(|distinction| {
            let of_frame = distinction.of_frame().map(|(group, tag)| (groups.find(frame, group, tag), tag));
            let value = of_frame.map(|(data, tag)| value(data, tag)).filter(|value| !value.is_empty());
            let value = value.unwrap_or_else(|| self::value(groups.top, distinction.tag()));
            let is_hu = distinction == Distinction::Quantity && value.is_empty();
            if is_hu { HU.into() } else { value.into_boxed_str() }
        }))
    }

    pub(super) fn get(&self, distinction: Distinction) -> &str {
        &self.0[distinction as usize]
    }

    /// Bytes of memory.
    pub(super) fn bytes(&self) -> u64 {
        (size_of::<Self>() + self.0.iter().map(|text| text.len()).sum::<usize>()) as u64
    }
}

/// A text or an unsigned integer, with one spelling of numbers.
fn value(data: &DataSet, tag: Tag) -> String {
    if let tags::TEMPORAL_POSITION_INDEX | tags::FRAME_ACQUISITION_NUMBER = tag {
        return data.unsigned(tag).ok().flatten().map(|number| number.to_string()).unwrap_or_default();
    }
    let found = Charset::of(data).text(data, tag).unwrap_or_default();
    match found.parse::<f64>() {
        Ok(number) if number.is_finite() => number.to_string(),
        _ => found,
    }
}
