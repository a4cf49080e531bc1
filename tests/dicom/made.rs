//! DICOM files made for tests of the reader: a classic CT slice by the library's own writer, and
//! variants of it by dicom-rs. They are what damage is done to; that the writer is right is for
//! `phantom.rs` to show.
#![allow(dead_code, reason = "each test binary uses a part of this")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::fs;
use std::path::Path;

use dicom_core::value::{PixelFragmentSequence, PrimitiveValue};
use dicom_core::{DataElement, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::{DefaultDicomObject, open_file};
use relief_dicom::{ExistingFolder, SeriesFolder, SeriesLabels, slice_file_name};
use relief_volume::{Grid, Volume};

/// Columns and rows of [`slice()`].
pub(crate) const SIZE: usize = 128;
/// RescaleIntercept of [`slice()`].
pub(crate) const INTERCEPT: i16 = -1024;

/// The stored values of [`slice()`], row by row: 128 to 2191.
pub(crate) fn stored() -> Vec<i16> {
    let values = (0..SIZE * SIZE).map(|index| index % SIZE * 7 + index / SIZE * 41);
    values.map(|value| i16::try_from(128 + value % 2064).unwrap()).collect()
}

/// A CT slice of 128 x 128 pixels whose decimal strings have many digits, so that others fit in
/// their place.
pub(crate) fn slice() -> Vec<u8> {
    edited(&written(), |object| put(object, tags::RESCALE_INTERCEPT, VR::DS, INTERCEPT.to_string()))
}

/// The slice at the height `z`, patient mm, as an instance of its own.
pub(crate) fn slice_at(z: f64, instance: usize) -> Vec<u8> {
    edited(&slice(), |object| {
        put(object, tags::IMAGE_POSITION_PATIENT, VR::DS, format!("-158.1\\-179.0\\{z}"));
        put(object, tags::SOP_INSTANCE_UID, VR::UI, format!("1.2.3.{instance}"));
    })
}

/// [`slice_at`] with other texts in these attributes.
pub(crate) fn slice_with(z: f64, instance: usize, texts: &[(Tag, VR, &str)]) -> Vec<u8> {
    edited(&slice_at(z, instance), |object| {
        for (tag, vr, text) in texts {
            put(object, *tag, *vr, *text);
        }
    })
}

/// The slice as RLE Lossless (PS3.5 annex G): high bytes, then low bytes, in runs of literals.
pub(crate) fn rle_slice() -> Vec<u8> {
    let cells: Vec<[u8; 2]> = stored().into_iter().map(i16::to_le_bytes).collect();
    let mut frame = [2u32, 64, 64 + (SIZE * SIZE / 128 * 129) as u32].map(u32::to_le_bytes).concat();
    frame.resize(64, 0);
    for byte in [1, 0] {
        let plane: Vec<u8> = cells.iter().map(|cell| cell[byte]).collect();
        frame.extend(plane.chunks(128).flat_map(|run| [&[127], run].concat()));
    }
    compressed(1, [SIZE as u16; 2], frame)
}

/// The slice's header with other numbers of frames, rows and columns, and one fragment said to be
/// RLE.
pub(crate) fn compressed(frames: u32, [rows, columns]: [u16; 2], fragment: Vec<u8>) -> Vec<u8> {
    edited(&slice(), |object| {
        object.meta_mut().transfer_syntax = uids::RLE_LOSSLESS.to_owned();
        put(object, tags::NUMBER_OF_FRAMES, VR::IS, frames.to_string());
        put(object, tags::ROWS, VR::US, rows);
        put(object, tags::COLUMNS, VR::US, columns);
        let fragments = PixelFragmentSequence::new(vec![0u32], vec![fragment]);
        object.put(DataElement::new(tags::PIXEL_DATA, VR::OB, fragments));
    })
}

fn put(object: &mut DefaultDicomObject, tag: Tag, vr: VR, value: impl Into<PrimitiveValue>) {
    let value: PrimitiveValue = value.into();
    object.put(DataElement::new(tag, vr, value));
}

fn edited(bytes: &[u8], edit: impl FnOnce(&mut DefaultDicomObject)) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("edited.dcm");
    fs::write(&path, bytes).unwrap();
    let mut object = open_file(&path).unwrap();
    edit(&mut object);
    object.write_to_file(&path).unwrap();
    fs::read(&path).unwrap()
}

fn written() -> Vec<u8> {
    let origin = [-158.135_803, -179.035_797, -75.699_997];
    let grid = Grid::axis_aligned([SIZE, SIZE, 1], [0.661_468, 0.661_468, 5.0], origin).unwrap();
    let volume = Volume::new(grid, stored()).unwrap();
    let labels = SeriesLabels {
        patient_name: "PHANTOM^TEST".to_owned(),
        patient_id: "PHANTOM-TEST".to_owned(),
        description: "Test slice".to_owned(),
        body_part: String::new(),
        window_hu: (40, 400),
    };
    let parent = tempfile::tempdir().unwrap();
    let place = parent.path().join("series");
    let folder = SeriesFolder::create(&place, ExistingFolder::Keep).unwrap();
    folder.write_slices(&volume, &labels, &|_| {}).unwrap();
    folder.finish().unwrap();
    read_slice(&place)
}

fn read_slice(folder: &Path) -> Vec<u8> {
    fs::read(folder.join(slice_file_name(0))).unwrap()
}
