//! The description of CT slices in one file: geometry, rescale and pixel layout of every frame.
//!
//! Classic CT objects have one frame and say everything at the top level; enhanced ones say it in
//! functional groups, shared by all frames or per frame (PS3.3 A.38.1, C.7.6.16). Nothing is
//! assumed: an attribute that placement or HU depend on and that is missing or unusable is a
//! [`Defect`]. The one exception is an absent rescale, noted in [`FileHeader::missing_rescale`].
//!
//! Spaces and units: positions and directions in patient LPS, mm; stored values become HU by slope
//! and intercept.

use std::sync::Arc;

use dicom_core::Tag;
use dicom_dictionary_std::{tags, uids};
use glam::DVec3;
use sha2::{Digest, Sha256};

use super::attributes::{
    BETWEEN, BITS_ALLOCATED, BITS_STORED, COLUMNS, FRAMES, HIGH_BIT, INTERCEPT, ORIENTATION, PADDING,
    POSITION, REPRESENTATION, ROWS, SAMPLES, SLOPE, SPACING, THICKNESS, check, numbers, positive, required,
    text, unsigned,
};
use super::charset::Charset;
use super::dataset::{Bounds, DataSet, PixelElement, Retention};
use super::distinctions::Distinctions;
use super::error::Defect;
use super::file_bytes::Bytes;
use super::groups::Groups;
use super::part10::{self, Object, Syntax};
use super::pixels::{PixelLayout, Rescale};
use super::source::FileSource;
use relief_base::Budget;

/// A CT file: what its frames share, and the frames. `Debug` shows no UIDs, which lead to a
/// patient.
pub(super) struct FileHeader {
    pub(super) source: FileSource,
    pub(super) study_uid: String,
    pub(super) series_uid: String,
    pub(super) instance_uid: String,
    /// Empty when absent.
    pub(super) frame_of_reference_uid: String,
    /// Distinguishes patients without naming them.
    pub(super) patient: PatientKey,
    pub(super) modality: String,
    pub(super) sop_class: String,
    pub(super) syntax: Syntax,
    pub(super) layout: PixelLayout,
    pub(super) pixels: PixelElement,
    /// Bytes that stay in memory while the file is open.
    pub(super) memory_bytes: u64,
    /// Extended Offset Table (7FE0,0001), 64-bit little-endian offsets; empty when absent.
    pub(super) extended_offsets: Vec<u8>,
    pub(super) missing_rescale: bool,
    pub(super) lossy: bool,
}

impl std::fmt::Debug for FileHeader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FileHeader").field("source", &self.source).finish_non_exhaustive()
    }
}

/// One frame: one slice of a series.
#[derive(Clone, Debug)]
pub(super) struct FrameHeader {
    pub(super) file: Arc<FileHeader>,
    /// Index in the file, from 0.
    pub(super) index: u32,
    /// Centre of the first voxel, patient mm.
    pub(super) position: DVec3,
    /// Unit vector along a row (to the next column), patient.
    pub(super) row: DVec3,
    /// Unit vector along a column (to the next row), patient.
    pub(super) column: DVec3,
    /// Distance between columns and between rows, mm: voxel steps along i and j.
    pub(super) spacing_mm: [f64; 2],
    /// SliceThickness, or else SpacingBetweenSlices; both optional, mm.
    pub(super) thickness_mm: Option<f64>,
    pub(super) rescale: Rescale,
    pub(super) distinctions: Arc<Distinctions>,
}

/// A digest of the identity of a patient: PatientID (0010,0020) and its issuer, or, without an ID,
/// name and birth date.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct PatientKey([u8; 32]);

impl PatientKey {
    fn of(data: &DataSet) -> Self {
        let charset = Charset::of(data);
        let text = |tag| charset.text(data, tag).unwrap_or_default();
        let id = text(tags::PATIENT_ID);
        let parts = if id.is_empty() {
            [text(tags::PATIENT_NAME), text(tags::PATIENT_BIRTH_DATE)]
        } else {
            [id, text(tags::ISSUER_OF_PATIENT_ID)]
        };
        Self(Sha256::digest(parts.join("\\")).into())
    }
}

impl std::fmt::Display for FrameHeader {
    /// The file, and the frame's number from 1 where there are several.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.file.layout.frames {
            1 => write!(f, "{}", self.file.source),
            _ => write!(f, "{} frame {}", self.file.source, self.index + 1),
        }
    }
}

/// Bytes of memory for a frame: its header, its place in lists that group frames, and its key among
/// those that were seen.
const FRAME_BYTES: u64 = 3 * size_of::<FrameHeader>() as u64;

/// Why a file gives no slices.
#[derive(Debug)]
pub(super) enum Rejection {
    /// A sound file that is no CT slice.
    Unwanted(Unwanted),
    /// A file that something is wrong with.
    Defective(Defect),
}

/// A sound file that is no CT slice.
#[derive(Debug, thiserror::Error)]
pub(super) enum Unwanted {
    #[error("a DICOMDIR beside the images")]
    Directory,
    #[error("a CT localizer (scout)")]
    Localizer,
    #[error("a CT localizer (scout) frame")]
    LocalizerFrame,
    #[error("not CT: {}, SOP class {}", or(.modality, "no Modality"), or(.class, "absent"))]
    NotCt { modality: String, class: String },
    #[error("Modality is CT, but the SOP class is {}", or(.0, "absent"))]
    Class(String),
    #[error("a colour image ({0})")]
    Color(String),
}

impl From<Defect> for Rejection {
    fn from(defect: Defect) -> Self {
        Self::Defective(defect)
    }
}

fn keep(tag: Tag) -> Retention {
    match tag {
        tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE
        | tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE
        | tags::PLANE_POSITION_SEQUENCE
        | tags::PLANE_ORIENTATION_SEQUENCE
        | tags::PIXEL_MEASURES_SEQUENCE
        | tags::PIXEL_VALUE_TRANSFORMATION_SEQUENCE
        | tags::CT_IMAGE_FRAME_TYPE_SEQUENCE
        | tags::CT_RECONSTRUCTION_SEQUENCE
        | tags::CTX_RAY_DETAILS_SEQUENCE
        | tags::FRAME_CONTENT_SEQUENCE => Retention::Items,
        tags::SPECIFIC_CHARACTER_SET
        | tags::IMAGE_TYPE
        | tags::FRAME_TYPE
        | tags::SOP_CLASS_UID
        | tags::SOP_INSTANCE_UID
        | tags::STUDY_INSTANCE_UID
        | tags::SERIES_INSTANCE_UID
        | tags::FRAME_OF_REFERENCE_UID
        | tags::MODALITY
        | tags::PATIENT_ID
        | tags::ISSUER_OF_PATIENT_ID
        | tags::PATIENT_NAME
        | tags::PATIENT_BIRTH_DATE
        | tags::CONVOLUTION_KERNEL
        | tags::KVP
        | tags::STACK_ID
        | tags::TEMPORAL_POSITION_IDENTIFIER
        | tags::TEMPORAL_POSITION_INDEX
        | tags::ACQUISITION_NUMBER
        | tags::FRAME_ACQUISITION_NUMBER
        | tags::TRIGGER_TIME
        | tags::ACQUISITION_TIME
        | tags::CONTENT_TIME
        | tags::SERIES_DESCRIPTION
        | tags::SLICE_THICKNESS
        | tags::SPACING_BETWEEN_SLICES
        | tags::IMAGE_POSITION_PATIENT
        | tags::IMAGE_ORIENTATION_PATIENT
        | tags::SAMPLES_PER_PIXEL
        | tags::PHOTOMETRIC_INTERPRETATION
        | tags::NUMBER_OF_FRAMES
        | tags::ROWS
        | tags::COLUMNS
        | tags::PIXEL_SPACING
        | tags::BITS_ALLOCATED
        | tags::BITS_STORED
        | tags::HIGH_BIT
        | tags::PIXEL_REPRESENTATION
        | tags::PIXEL_PADDING_VALUE
        | tags::RESCALE_INTERCEPT
        | tags::RESCALE_SLOPE
        | tags::RESCALE_TYPE
        | tags::LOSSY_IMAGE_COMPRESSION
        | tags::EXTENDED_OFFSET_TABLE => Retention::Value,
        _ => Retention::Nothing,
    }
}

/// Reads a file's header, up to its pixels. Kept parts of it count in the budget.
///
/// # Errors
/// [`Rejection::Unwanted`] for sound objects other than CT slices, else the defect of the
/// file.
pub(super) fn read(source: &FileSource, budget: &Budget) -> Result<Vec<FrameHeader>, Rejection> {
    let beginning = source.beginning(budget)?;
    let is_whole = !matches!(beginning, Bytes::Beginning(..));
    match read_from(source, beginning, budget) {
        // Its header is longer, or it is damaged.
        Err(Rejection::Defective(defect)) if !is_whole && !matches!(defect, Defect::Budget(_)) => {
            read_from(source, source.bytes(budget)?, budget)
        }
        outcome => outcome,
    }
}

fn read_from(source: &FileSource, bytes: Bytes, budget: &Budget) -> Result<Vec<FrameHeader>, Rejection> {
    let object = part10::open(bytes, budget)?;
    if object.is_directory() {
        return Err(Rejection::Unwanted(Unwanted::Directory));
    }
    let walked = object.walk_within(Bounds::SLICES, keep).map_err(|located| located.defect)?;
    check_wanted(&walked.data)?;
    let frames = frame_count(&walked.data)?;
    let layout = layout(&walked.data, frames)?;
    let groups = Groups::new(&walked.data, frames)?;
    let pixels = pixels(walked.pixels, &object, &layout)?; // bounds the number of frames by the file's size
    budget.keep(u64::from(frames) * FRAME_BYTES).map_err(Defect::from)?;
    let rescales =
        (0..frames).map(|index| rescale(&groups, index, &layout)).collect::<Result<Vec<_>, _>>()?;
    let file = FileHeader {
        source: source.clone(),
        study_uid: text(&walked.data, tags::STUDY_INSTANCE_UID),
        series_uid: text(&walked.data, tags::SERIES_INSTANCE_UID),
        instance_uid: text(&walked.data, tags::SOP_INSTANCE_UID),
        frame_of_reference_uid: text(&walked.data, tags::FRAME_OF_REFERENCE_UID),
        patient: PatientKey::of(&walked.data),
        modality: text(&walked.data, tags::MODALITY),
        sop_class: text(&walked.data, tags::SOP_CLASS_UID),
        pixels,
        memory_bytes: source.memory_bytes() + object.inflated_bytes(),
        extended_offsets: extended_offsets(&walked.data, frames),
        missing_rescale: rescales.iter().any(Option::is_none),
        lossy: text(&walked.data, tags::LOSSY_IMAGE_COMPRESSION) == "01",
        syntax: object.syntax,
        layout,
    };
    budget.keep(file.kept_bytes()).map_err(Defect::from)?;
    let file = Arc::new(file);
    let mut found = Vec::with_capacity(frames as usize);
    for (index, rescale) in (0..frames).zip(rescales) {
        let distinctions = Distinctions::of(&groups, index);
        budget.keep(distinctions.bytes()).map_err(Defect::from)?;
        found.push(frame(&file, &groups, index, rescale, distinctions)?);
    }
    Ok(found)
}

/// The Extended Offset Table, of one frame nothing: it has an entry of eight bytes for each.
fn extended_offsets(data: &DataSet, frames: u32) -> Vec<u8> {
    let table = data.bytes(tags::EXTENDED_OFFSET_TABLE).unwrap_or_default();
    let length = if frames > 1 { frames as usize * 8 } else { 0 };
    table.get(..length).unwrap_or_default().to_vec()
}

impl FileHeader {
    /// Bytes of memory that the header takes as long as its series is known.
    fn kept_bytes(&self) -> u64 {
        let texts = [
            &self.study_uid,
            &self.series_uid,
            &self.instance_uid,
            &self.frame_of_reference_uid,
            &self.modality,
            &self.sop_class,
        ];
        let texts: usize = texts.into_iter().map(String::len).sum();
        (size_of::<Self>() + texts + self.extended_offsets.len()) as u64
    }
}

fn frame(
    file: &Arc<FileHeader>,
    groups: &Groups<'_>,
    index: u32,
    rescale: Option<Rescale>,
    distinctions: Distinctions,
) -> Result<FrameHeader, Rejection> {
    let frame_type =
        text(groups.find(index, tags::CT_IMAGE_FRAME_TYPE_SEQUENCE, tags::FRAME_TYPE), tags::FRAME_TYPE);
    if is_localizer(&frame_type) {
        return Err(Rejection::Unwanted(Unwanted::LocalizerFrame));
    }
    let [x, y, z] = numbers(groups.plane_position(index), POSITION, "three numbers in mm")?;
    let [row, column] = orientation(groups.plane_orientation(index))?;
    let measures = groups.measures(index);
    let [between_rows, between_columns] = spacing(measures)?;
    Ok(FrameHeader {
        file: Arc::clone(file),
        index,
        position: DVec3::new(x, y, z),
        row,
        column,
        spacing_mm: [between_columns, between_rows],
        thickness_mm: positive(measures, THICKNESS).or_else(|| positive(measures, BETWEEN)),
        rescale: rescale.unwrap_or_default(),
        distinctions: Arc::new(distinctions),
    })
}

/// Only images of the CT classes, or with Modality CT where the class is empty (anonymisers do
/// that).
fn check_wanted(data: &DataSet) -> Result<(), Rejection> {
    let unwanted = |reason: Unwanted| Err(Rejection::Unwanted(reason));
    let (modality, class) = (text(data, tags::MODALITY), text(data, tags::SOP_CLASS_UID));
    let ct_class = [
        uids::CT_IMAGE_STORAGE,
        uids::ENHANCED_CT_IMAGE_STORAGE,
        uids::LEGACY_CONVERTED_ENHANCED_CT_IMAGE_STORAGE,
    ]
    .contains(&class.as_str());
    if !ct_class && modality != "CT" {
        return unwanted(Unwanted::NotCt { modality, class });
    }
    if !ct_class && !class.is_empty() {
        return unwanted(Unwanted::Class(class));
    }
    if is_localizer(&text(data, tags::IMAGE_TYPE)) {
        return unwanted(Unwanted::Localizer);
    }
    let photometric = text(data, tags::PHOTOMETRIC_INTERPRETATION);
    if !photometric.is_empty() && !photometric.starts_with("MONOCHROME") {
        return unwanted(Unwanted::Color(photometric));
    }
    Ok(())
}

fn or<'a>(text: &'a str, otherwise: &'a str) -> &'a str {
    if text.is_empty() { otherwise } else { text }
}

/// Value 3 of Image Type and Frame Type (PS3.3 C.8.2.1.1.1).
fn is_localizer(image_type: &str) -> bool {
    image_type.split('\\').any(|value| value.trim() == "LOCALIZER")
}

fn frame_count(data: &DataSet) -> Result<u32, Defect> {
    let found = text(data, tags::NUMBER_OF_FRAMES);
    if found.is_empty() {
        return Ok(1);
    }
    let expected = "a whole number, 1 to 65536";
    match found.parse() {
        Ok(frames @ 1..=65536) => Ok(frames),
        _ => Err(Defect::Attribute { attribute: FRAMES, found: format!("{found:?}"), expected }),
    }
}

fn layout(data: &DataSet, frames: u32) -> Result<PixelLayout, Defect> {
    let samples = unsigned(data, SAMPLES)?.unwrap_or(1);
    check(samples == 1, SAMPLES, &samples, "1")?;
    let [rows, columns] = [required(data, ROWS, "1 to 65535")?, required(data, COLUMNS, "1 to 65535")?];
    check((1..=65535).contains(&rows), ROWS, &rows, "1 to 65535")?;
    check((1..=65535).contains(&columns), COLUMNS, &columns, "1 to 65535")?;
    let allocated = required(data, BITS_ALLOCATED, "8 or 16")?;
    check(matches!(allocated, 8 | 16), BITS_ALLOCATED, &allocated, "8 or 16")?;
    let stored = unsigned(data, BITS_STORED)?.unwrap_or(allocated);
    check((1..=allocated).contains(&stored), BITS_STORED, &stored, "1 to BitsAllocated")?;
    let high_bit = unsigned(data, HIGH_BIT)?.unwrap_or(stored - 1);
    check(
        (stored - 1..allocated).contains(&high_bit),
        HIGH_BIT,
        &high_bit,
        "BitsStored - 1 to BitsAllocated - 1",
    )?;
    let representation = unsigned(data, REPRESENTATION)?.unwrap_or(0);
    check(representation <= 1, REPRESENTATION, &representation, "0 (unsigned) or 1 (signed)")?;
    PixelLayout::new(frames, [rows, columns], [allocated, stored, high_bit], representation == 1)
}

/// Pixel Data, checked against the image size as far as that is possible without decoding.
fn pixels(
    element: Option<PixelElement>,
    object: &Object,
    layout: &PixelLayout,
) -> Result<PixelElement, Defect> {
    let Some(element) = element else {
        return Err(Defect::NoPixels { expected: layout.to_string() });
    };
    let left = object.bytes.open()?.1.saturating_sub(element.position);
    match (element.length, object.syntax.is_native()) {
        (Some(length), true) => {
            let (found, expected) = (length.min(left), layout.native_bytes());
            if found < expected { Err(Defect::FewPixels { found, expected }) } else { Ok(element) }
        }
        (None, true) => Err(Defect::TransferSyntax {
            found: format!("{} ({})", object.syntax.uid, object.syntax.name()),
            why: "is uncompressed, but Pixel Data is divided into fragments as compressed data are",
        }),
        // Each frame has a fragment of at least a header.
        (_, false) if left < u64::from(layout.frames) * 8 => {
            Err(Defect::FewPixels { found: left, expected: u64::from(layout.frames) * 8 })
        }
        (_, false) => Ok(element),
    }
}

/// Slope and intercept of a frame; `None` when both are absent. Only one of them, or an unreadable
/// value, is a defect: CT images require them (PS3.3 C.8.2.1), and a wrong guess would shift every
/// HU.
fn rescale(groups: &Groups<'_>, frame: u32, layout: &PixelLayout) -> Result<Option<Rescale>, Defect> {
    let intercepts = groups.transformation(frame, tags::RESCALE_INTERCEPT);
    let slopes = groups.transformation(frame, tags::RESCALE_SLOPE);
    let is_absent = |data: &DataSet, tag| data.bytes(tag).is_none();
    let padding_hu = |rescale: Rescale| Rescale { padding: padding(groups.top, layout), ..rescale };
    if is_absent(intercepts, tags::RESCALE_INTERCEPT) && is_absent(slopes, tags::RESCALE_SLOPE) {
        return Ok(None);
    }
    let [slope] = numbers(slopes, SLOPE, "a number other than 0")?;
    let [intercept] = numbers(intercepts, INTERCEPT, "a number")?;
    check(slope != 0.0, SLOPE, &slope, "a number other than 0")?;
    Ok(Some(padding_hu(Rescale { slope, intercept, padding: None })))
}

/// PixelPaddingValue as a stored value; its sign follows PixelRepresentation.
fn padding(data: &DataSet, layout: &PixelLayout) -> Option<i32> {
    let raw = unsigned(data, PADDING).ok()??;
    let raw = u16::try_from(raw).ok()?;
    Some(layout.stored_value(raw))
}

fn orientation(data: &DataSet) -> Result<[DVec3; 2], Defect> {
    let expected = "six numbers: two perpendicular unit vectors";
    let v = numbers::<6>(data, ORIENTATION, expected)?;
    let (row, column) = (DVec3::new(v[0], v[1], v[2]), DVec3::new(v[3], v[4], v[5]));
    // Directions written with few digits have errors up to this. Normalising a larger one would move voxels.
    let wrong = (row.length() - 1.0).abs().max((column.length() - 1.0).abs()).max(row.dot(column).abs());
    check(wrong < 0.01, ORIENTATION, &format!("{v:?}"), expected)?;
    // Rows keep their direction; columns are made exactly perpendicular, so that the grid is.
    let row = row.normalize();
    Ok([row, (column - row * row.dot(column)).normalize()])
}

fn spacing(data: &DataSet) -> Result<[f64; 2], Defect> {
    let expected = "two positive numbers in mm";
    let spacing = numbers::<2>(data, SPACING, expected)?;
    let usable = spacing.iter().all(|&mm| (1e-4..1e4).contains(&mm));
    check(usable, SPACING, &format!("{spacing:?}"), expected)?;
    Ok(spacing)
}
