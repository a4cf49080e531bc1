//! The attributes of a series that objects about it repeat: its patient and study, its frame of
//! reference, its images.
//!
//! A report or a segmentation repeats these values word for word (PS3.3 A.1.2.3, C.17.2.1);
//! otherwise an archive would file it under another patient. `Debug` and messages show none of
//! them. This is not a copy of every attribute.
//!
//! Spaces: patient LPS mm.

use dicom_core::{Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::charset::Charset;
use super::dataset::Retention;
use super::error::{Attribute, Defect};
use super::header::FrameHeader;
use super::object::{put, put_items, uid_of};
use super::part10;
use super::series::SeriesEntry;

/// Attributes of patient and study that are repeated. All but the last two are written even where
/// they are empty.
const REPEATED: [(Tag, VR); 13] = [
    (tags::PATIENT_NAME, VR::PN),
    (tags::PATIENT_ID, VR::LO),
    (tags::PATIENT_BIRTH_DATE, VR::DA),
    (tags::PATIENT_SEX, VR::CS),
    (tags::STUDY_INSTANCE_UID, VR::UI),
    (tags::STUDY_DATE, VR::DA),
    (tags::STUDY_TIME, VR::TM),
    (tags::REFERRING_PHYSICIAN_NAME, VR::PN),
    (tags::STUDY_ID, VR::SH),
    (tags::ACCESSION_NUMBER, VR::SH),
    (tags::STUDY_DESCRIPTION, VR::LO),
    (tags::PATIENT_IDENTITY_REMOVED, VR::CS),
    (tags::DEIDENTIFICATION_METHOD, VR::LO),
];
/// Those of [`REPEATED`] that are left out where they are empty, from this one on.
const OPTIONAL: usize = 10;

/// A CT series as reports and segmentations refer to it.
#[derive(Clone, Serialize, Deserialize)]
pub struct SeriesReference {
    /// Values of [`REPEATED`].
    repeated: Vec<String>,
    study_uid: String,
    series_uid: String,
    frame_of_reference_uid: Option<String>,
    position_reference: String,
    description: String,
    instances: Vec<Instance>,
}

/// Longest description of a series: that of its value representation, LO.
const LONGEST_DESCRIPTION: usize = 64;

/// A text of a file as it may be shown in one line.
fn shown(text: &str) -> String {
    let clean = text.chars().filter(|letter| !letter.is_control());
    clean.take(LONGEST_DESCRIPTION).collect::<String>().trim().to_owned()
}

/// An image object of the series.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct Instance {
    pub(super) sop_class: String,
    pub(super) uid: String,
    pub(super) planes: Vec<Plane>,
}

/// The place of a frame's pixels.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub(super) struct Plane {
    /// The frame's number in its object, from 1.
    pub(super) frame: u32,
    /// Centre of the first pixel.
    #[serde(with = "components")]
    pub(super) position: DVec3,
    /// Unit vectors along a row and along a column.
    #[serde(with = "components")]
    pub(super) row: DVec3,
    #[serde(with = "components")]
    pub(super) column: DVec3,
    /// Between columns and between rows, mm.
    pub(super) pixel_mm: [f64; 2],
}

/// A vector as its three components.
mod components {
    use glam::DVec3;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(super) fn serialize<S: Serializer>(vector: &DVec3, serializer: S) -> Result<S::Ok, S::Error> {
        vector.to_array().serialize(serializer)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<DVec3, D::Error> {
        <[f64; 3]>::deserialize(deserializer).map(DVec3::from)
    }
}

/// UIDs and names lead to a patient.
impl std::fmt::Debug for SeriesReference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "SeriesReference({} instances, withheld)", self.instances.len())
    }
}

fn keep(tag: Tag) -> Retention {
    let is_wanted = REPEATED.iter().any(|(repeated, _)| *repeated == tag)
        || [tags::SPECIFIC_CHARACTER_SET, tags::POSITION_REFERENCE_INDICATOR, tags::SERIES_DESCRIPTION]
            .contains(&tag);
    if is_wanted { Retention::Value } else { Retention::Nothing }
}

impl SeriesReference {
    /// The values of a series' files. The first file is read again for patient and study.
    ///
    /// # Errors
    /// When it cannot be read any more, or when the study, the series or an image has no UID to
    /// refer to.
    pub fn of(entry: &SeriesEntry) -> Result<Self, Defect> {
        let first = &entry.frames[0].file;
        let walked = part10::open(first.source.bytes(&entry.budget)?, &entry.budget)?.walk(keep)?;
        let charset = Charset::of(&walked.data);
        let repeated = REPEATED.map(|(tag, _)| charset.text(&walked.data, tag).unwrap_or_default());
        let needed = |tag, keyword, uid: &str| match uid {
            "" => Err(Defect::Attribute {
                attribute: Attribute { tag, keyword },
                found: "nothing".to_owned(),
                expected: "a UID, by which other objects refer to it",
            }),
            uid => Ok(uid.to_owned()),
        };
        let instances = instances(&entry.frames);
        for instance in &instances {
            needed(tags::SOP_INSTANCE_UID, "SOPInstanceUID", &instance.uid)?;
        }
        Ok(Self {
            repeated: repeated.to_vec(),
            study_uid: needed(tags::STUDY_INSTANCE_UID, "StudyInstanceUID", &first.study_uid)?,
            series_uid: needed(tags::SERIES_INSTANCE_UID, "SeriesInstanceUID", &first.series_uid)?,
            frame_of_reference_uid: entry.frame_of_reference().map(str::to_owned),
            position_reference: charset
                .text(&walked.data, tags::POSITION_REFERENCE_INDICATOR)
                .unwrap_or_default(),
            description: shown(&charset.text(&walked.data, tags::SERIES_DESCRIPTION).unwrap_or_default()),
            instances,
        })
    }

    /// The same series without its patient: names, ids and dates are empty, UIDs are replaced
    /// (PS3.15, Basic Application Level Confidentiality Profile). The same UID gets the same
    /// replacement everywhere, so that objects of one series still belong together.
    #[must_use]
    pub fn deidentified(&self) -> Self {
        let repeated = REPEATED.map(|(tag, _)| match tag {
            tags::PATIENT_IDENTITY_REMOVED => "YES".to_owned(),
            tags::DEIDENTIFICATION_METHOD => "Names, ids and dates removed, UIDs replaced".to_owned(),
            tags::STUDY_INSTANCE_UID => deidentified_uid(&self.study_uid),
            _ => String::new(),
        });
        let instances = self
            .instances
            .iter()
            .map(|instance| Instance { uid: deidentified_uid(&instance.uid), ..instance.clone() });
        Self {
            repeated: repeated.to_vec(),
            study_uid: deidentified_uid(&self.study_uid),
            series_uid: deidentified_uid(&self.series_uid),
            frame_of_reference_uid: self.frame_of_reference_uid.as_deref().map(deidentified_uid),
            position_reference: String::new(),
            description: String::new(),
            instances: instances.collect(),
        }
    }

    /// Series Description (0008,103E), at most 64 characters and none of control; empty when absent. It
    /// is free text and may name the patient.
    #[must_use]
    pub fn description(&self) -> &str {
        &self.description
    }

    /// Study Date (0008,0020) as YYYY-MM-DD, if the files have one. A date can identify a patient.
    #[must_use]
    pub fn study_date(&self) -> Option<String> {
        let at = REPEATED.iter().position(|(tag, _)| *tag == tags::STUDY_DATE)?;
        let text = self.repeated.get(at)?.trim();
        let is_date = text.len() == 8 && text.bytes().all(|digit| digit.is_ascii_digit());
        is_date.then(|| format!("{}-{}-{}", &text[..4], &text[4..6], &text[6..]))
    }

    /// Frame of Reference UID (0020,0052), where all slices have the same one. Not for messages.
    #[must_use]
    pub fn frame_of_reference(&self) -> Option<&str> {
        self.frame_of_reference_uid.as_deref()
    }

    /// The number of its image objects.
    #[must_use]
    pub fn instance_count(&self) -> usize {
        self.instances.len()
    }

    pub(super) fn series_uid(&self) -> &str {
        &self.series_uid
    }

    pub(super) fn study_uid(&self) -> &str {
        &self.study_uid
    }

    pub(super) fn instances(&self) -> &[Instance] {
        &self.instances
    }

    /// The image with this SOP Instance UID, and one of its frames.
    pub(super) fn plane(&self, uid: &str, frame: u32) -> Option<&Plane> {
        let instance = self.instances.iter().find(|instance| instance.uid == uid)?;
        instance.planes.iter().find(|plane| plane.frame == frame)
    }

    /// The patient and general study modules, as the series has them.
    pub(super) fn put_patient_and_study(&self, object: &mut InMemDicomObject) {
        put(object, tags::SPECIFIC_CHARACTER_SET, VR::CS, "ISO_IR 192");
        for (place, ((tag, vr), value)) in REPEATED.into_iter().zip(&self.repeated).enumerate() {
            if place < OPTIONAL || !value.is_empty() {
                put(object, tag, vr, value);
            }
        }
    }

    /// The frame of reference module; `None` where the series has none.
    pub(super) fn put_frame_of_reference(&self, object: &mut InMemDicomObject) -> Option<()> {
        put(object, tags::FRAME_OF_REFERENCE_UID, VR::UI, self.frame_of_reference()?);
        put(object, tags::POSITION_REFERENCE_INDICATOR, VR::LO, &self.position_reference);
        Some(())
    }

    /// An item of Referenced Series Sequence that names all images of the series, under the name
    /// that the using object has for them.
    pub(super) fn referenced_series(&self, instances: Tag) -> InMemDicomObject {
        let mut item = InMemDicomObject::new_empty();
        put(&mut item, tags::SERIES_INSTANCE_UID, VR::UI, &self.series_uid);
        put_items(&mut item, instances, self.instances.iter().map(|i| i.reference(None)).collect());
        item
    }
}

/// The UID that replaces this one in de-identified files. It can be computed from the original; the
/// original cannot be computed from it.
#[must_use]
pub fn deidentified_uid(uid: &str) -> String {
    uid_of(b"deidentified", [uid])
}

impl Instance {
    /// An item that refers to the image, or to one of its frames where it has several.
    pub(super) fn reference(&self, plane: Option<&Plane>) -> InMemDicomObject {
        let mut item = InMemDicomObject::new_empty();
        put(&mut item, tags::REFERENCED_SOP_CLASS_UID, VR::UI, &self.sop_class);
        put(&mut item, tags::REFERENCED_SOP_INSTANCE_UID, VR::UI, &self.uid);
        if let Some(plane) = plane.filter(|_| self.sop_class != uids::CT_IMAGE_STORAGE) {
            put(&mut item, tags::REFERENCED_FRAME_NUMBER, VR::IS, &plane.frame.to_string());
        }
        item
    }
}

/// The image objects, in the order of the slices. Anonymisers empty the class of CT images; then it
/// is theirs.
fn instances(frames: &[FrameHeader]) -> Vec<Instance> {
    let mut instances: Vec<Instance> = Vec::new();
    let mut places = std::collections::HashMap::new();
    for frame in frames {
        let file = &frame.file;
        let place = *places.entry(file.instance_uid.as_str()).or_insert_with(|| {
            let class = file.sop_class.as_str();
            let sop_class = if class.is_empty() { uids::CT_IMAGE_STORAGE } else { class }.to_owned();
            instances.push(Instance { sop_class, uid: file.instance_uid.clone(), planes: Vec::new() });
            instances.len() - 1
        });
        let FrameHeader { index, position, row, column, spacing_mm, .. } = *frame;
        instances[place].planes.push(Plane { frame: index + 1, position, row, column, pixel_mm: spacing_mm });
    }
    instances
}
