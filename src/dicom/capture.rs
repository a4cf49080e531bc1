//! Writes pictures of a series as a Secondary Capture, or several as one multi-frame object
//! (PS3.3 A.8.1, A.8.5).
//!
//! The object belongs to the patient and the study of the series, and to a series of its own. The
//! same pictures of the same series give the same bytes: UIDs follow from the content, and dates are
//! left out. It says that the pictures may identify a patient, because a rendered face does.

use dicom_core::value::PrimitiveValue;
use dicom_core::{DataElement, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;

use super::object::{
    EncodeError, LONG_STRING_CHARS, decimal_string, file_bytes, limited, put, put_equipment, put_numbers,
    uid_of,
};
use super::reference::SeriesReference;

/// Most bytes of all pixels of an object.
const MOST_PIXEL_BYTES: u64 = 1 << 30;
/// Number of the series that the objects form; archives list by it.
const SERIES_NUMBER: &str = "9100";

/// A picture: rows of RGB, 8 bits each, from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CapturedPicture {
    /// Width and height, pixels.
    pub size_px: [u32; 2],
    /// `3 * width * height` bytes.
    pub rgb: Vec<u8>,
}

/// An object's description of its pictures.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptureOptions {
    /// Description of the series that the objects form, at most 64 characters.
    pub description: String,
    /// Number of the object within that series, from 1.
    pub number: u32,
    /// Time from one picture to the next, ms.
    pub frame_ms: f64,
}

impl CapturedPicture {
    /// The colours of a picture, without its coverage.
    #[must_use]
    pub fn of_rgba(size_px: [u32; 2], rgba: &[[u8; 4]]) -> Self {
        let rgb = rgba.iter().flat_map(|&[red, green, blue, _]| [red, green, blue]).collect();
        Self { size_px, rgb }
    }
}

impl CaptureOptions {
    /// Those of a single rendered view.
    #[must_use]
    pub fn of_view() -> Self {
        Self { description: Self::DESCRIPTION.to_owned(), number: 1, frame_ms: 0.0 }
    }

    /// The default description.
    pub const DESCRIPTION: &str = "Relief 3D views";
}

/// Why pictures cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// No picture was given.
    #[error("there is no picture")]
    Nothing,
    /// A picture has another size than the first one, or not the bytes of its size.
    #[error("picture {number} is not {} x {} pixels of RGB, which the first one is", first_px[0], first_px[1])]
    Size {
        /// Its number, from 1.
        number: usize,
        /// Width and height of the first one.
        first_px: [u32; 2],
    },
    /// Sides or bytes beyond what an object holds.
    #[error("{count} pictures of {} x {} pixels, allowed: sides to 65535 and 1 GiB together", size_px[0], size_px[1])]
    TooLarge {
        /// Number of the pictures.
        count: usize,
        /// Their width and height.
        size_px: [u32; 2],
    },
    /// The object could not be put into bytes.
    #[error("the pictures cannot be encoded")]
    Encoding(#[source] EncodeError),
    /// A file to join is not a picture that [`write_capture`] wrote.
    #[error("file {number} is not a Secondary Capture of one picture")]
    NoCapture {
        /// Its number, from 1.
        number: usize,
    },
}

/// One multi-frame object with the pictures of several objects that [`write_capture`] wrote, of
/// one picture each and of the same series. `frame_ms` is the time from one picture to the next.
///
/// # Errors
/// When a file is something else, and as for [`write_capture`].
pub fn join_captures(files: &[Vec<u8>], frame_ms: f64) -> Result<Vec<u8>, CaptureError> {
    let mut first = None;
    let mut pictures = Vec::new();
    for (place, file) in files.iter().enumerate() {
        let (object, picture) = read_capture(file).ok_or(CaptureError::NoCapture { number: place + 1 })?;
        first.get_or_insert(object);
        pictures.push(picture);
    }
    let mut object = first.ok_or(CaptureError::Nothing)?;
    checked(&pictures)?;
    let content = pictures.iter().map(|picture| &*picture.rgb);
    let instance = uid_of(b"captures, joined", content.chain([&frame_ms.to_le_bytes()[..]]));
    put(&mut object, tags::SOP_INSTANCE_UID, VR::UI, &instance);
    if pictures.len() > 1 {
        let class = uids::MULTI_FRAME_TRUE_COLOR_SECONDARY_CAPTURE_IMAGE_STORAGE;
        put(&mut object, tags::SOP_CLASS_UID, VR::UI, class);
    }
    put_frames(&mut object, &pictures, frame_ms);
    file_bytes(object, false).map_err(CaptureError::Encoding)
}

/// The attributes and the picture of an object of one picture; `None` for something else.
fn read_capture(file: &[u8]) -> Option<(InMemDicomObject, CapturedPicture)> {
    let object = dicom_object::from_reader(file).ok()?.into_inner();
    let class = object.get(tags::SOP_CLASS_UID)?.to_str().ok()?;
    let [width, height] =
        [tags::COLUMNS, tags::ROWS].map(|tag| object.get(tag).and_then(|side| side.to_int::<u16>().ok()));
    let size_px = [u32::from(width?), u32::from(height?)];
    let bytes = object.get(tags::PIXEL_DATA)?.to_bytes().ok()?;
    let rgb = bytes.get(..3 * size_px[0] as usize * size_px[1] as usize)?.to_vec();
    let is_one = class.trim_end_matches(['\0', ' ']) == uids::SECONDARY_CAPTURE_IMAGE_STORAGE;
    is_one.then_some((object, CapturedPicture { size_px, rgb }))
}

/// An object with the pictures, which are frames of it where there are several.
///
/// # Errors
/// When no picture is given, when the sizes of pictures differ, or when they are too large.
pub fn write_capture(
    pictures: &[CapturedPicture],
    series: &SeriesReference,
    options: &CaptureOptions,
) -> Result<Vec<u8>, CaptureError> {
    let size_px = checked(pictures)?;
    let mut object = InMemDicomObject::new_empty();
    series.put_patient_and_study(&mut object);
    put_equipment(&mut object);
    put_identity(&mut object, pictures, series, options);
    put_numbers(&mut object, tags::COLUMNS, &[size_px[0]]);
    put_numbers(&mut object, tags::ROWS, &[size_px[1]]);
    put(&mut object, tags::PHOTOMETRIC_INTERPRETATION, VR::CS, "RGB");
    let numbers = [
        (tags::SAMPLES_PER_PIXEL, 3),
        (tags::PLANAR_CONFIGURATION, 0),
        (tags::BITS_ALLOCATED, 8),
        (tags::BITS_STORED, 8),
        (tags::HIGH_BIT, 7),
        (tags::PIXEL_REPRESENTATION, 0),
    ];
    numbers.into_iter().for_each(|(tag, number)| put_numbers(&mut object, tag, &[number]));
    put_frames(&mut object, pictures, options.frame_ms);
    file_bytes(object, false).map_err(CaptureError::Encoding)
}

/// The pixels, and how several pictures follow one another.
fn put_frames(object: &mut InMemDicomObject, pictures: &[CapturedPicture], frame_ms: f64) {
    if pictures.len() > 1 {
        put(object, tags::NUMBER_OF_FRAMES, VR::IS, &pictures.len().to_string());
        put(object, tags::FRAME_TIME, VR::DS, &decimal_string(frame_ms));
        let pointer = PrimitiveValue::Tags(dicom_core::smallvec::smallvec![tags::FRAME_TIME]);
        object.put_element(DataElement::new(tags::FRAME_INCREMENT_POINTER, VR::AT, pointer));
    }
    let mut bytes = pictures.iter().map(|picture| &*picture.rgb).collect::<Vec<_>>().concat();
    bytes.resize(bytes.len().next_multiple_of(2), 0);
    object.put_element(DataElement::new(tags::PIXEL_DATA, VR::OB, PrimitiveValue::from(bytes)));
}

/// The size of all pictures, as attributes hold it.
fn checked(pictures: &[CapturedPicture]) -> Result<[u16; 2], CaptureError> {
    let size_px = pictures.first().ok_or(CaptureError::Nothing)?.size_px;
    let area = u64::from(size_px[0]) * u64::from(size_px[1]);
    let is_other =
        |picture: &CapturedPicture| picture.size_px != size_px || picture.rgb.len() as u64 != 3 * area;
    if let Some(place) = pictures.iter().position(is_other) {
        return Err(CaptureError::Size { number: place + 1, first_px: size_px });
    }
    let [Ok(width), Ok(height)] = size_px.map(u16::try_from) else {
        return Err(CaptureError::TooLarge { count: pictures.len(), size_px });
    };
    if area == 0 || (3 * area).saturating_mul(pictures.len() as u64) > MOST_PIXEL_BYTES {
        return Err(CaptureError::TooLarge { count: pictures.len(), size_px });
    }
    Ok([width, height])
}

/// General series, general image, SC equipment, SC multi-frame image and SOP common modules.
fn put_identity(
    object: &mut InMemDicomObject,
    pictures: &[CapturedPicture],
    series: &SeriesReference,
    options: &CaptureOptions,
) {
    let description = limited(&options.description, LONG_STRING_CHARS);
    let class = match pictures.len() {
        1 => uids::SECONDARY_CAPTURE_IMAGE_STORAGE,
        _ => uids::MULTI_FRAME_TRUE_COLOR_SECONDARY_CAPTURE_IMAGE_STORAGE,
    };
    let study = series.study_uid().as_bytes();
    let about = [study, series.series_uid().as_bytes(), description.as_bytes()];
    let number = options.number.to_string();
    let sides = pictures[0].size_px.map(u32::to_le_bytes).concat();
    let frame_ms = options.frame_ms.to_le_bytes();
    let content = [&*sides, number.as_bytes(), &frame_ms];
    let content = about.into_iter().chain(content).chain(pictures.iter().map(|picture| &*picture.rgb));
    put(object, tags::SOP_CLASS_UID, VR::UI, class);
    put(object, tags::SOP_INSTANCE_UID, VR::UI, &uid_of(b"capture", content));
    put(object, tags::SERIES_INSTANCE_UID, VR::UI, &uid_of(b"captures of a series", about));
    put(object, tags::MODALITY, VR::CS, "OT");
    put(object, tags::SERIES_NUMBER, VR::IS, SERIES_NUMBER);
    put(object, tags::SERIES_DESCRIPTION, VR::LO, &description);
    put(object, tags::INSTANCE_NUMBER, VR::IS, &number);
    put(object, tags::CONVERSION_TYPE, VR::CS, "WSD");
    put(object, tags::LATERALITY, VR::CS, "");
    put(object, tags::PATIENT_ORIENTATION, VR::CS, "");
    put(object, tags::BURNED_IN_ANNOTATION, VR::CS, "YES");
    put(object, tags::RECOGNIZABLE_VISUAL_FEATURES, VR::CS, "YES");
}
