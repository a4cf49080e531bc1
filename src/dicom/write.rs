//! Writes a volume as a CT series: one CT Image Storage file per slice, in a folder that appears
//! whole or not at all.
//!
//! Explicit VR little endian; signed 16-bit pixels that are the HU themselves (slope 1, intercept
//! 0), so that no value of a volume is lost. Slice k of the volume is one file, placed by its own
//! ImagePositionPatient; rows run along i, columns along j. Positions are patient LPS mm.
//!
//! The same volume with the same labels makes the same bytes: UIDs are name-based (SHA-256 of the
//! volume's content and the labels, as a UUID under 2.25), and dates are left empty. It is not an
//! archive's exporter: it knows one series of one invented patient.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use dicom_core::value::{C, PrimitiveValue};
use dicom_core::{DataElement, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::{FileDicomObject, InMemDicomObject};
use rayon::prelude::*;

use super::object::{decimal_string, decimals, meta, put, put_many, uid_of};
use relief_volume::Volume;

/// Rows, columns and instances are 16-bit or short decimal strings; this also bounds the number of
/// files.
const MAX_EXTENT: usize = u16::MAX as usize;
/// The name of a replaced folder in the temporary one that holds it meanwhile.
const OLD: &str = "old";

/// Descriptive values of the series. Use invented names only.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct SeriesLabels {
    /// PatientName, for example `PHANTOM^HEAD`.
    pub patient_name: String,
    /// PatientID.
    pub patient_id: String,
    /// StudyDescription and SeriesDescription.
    pub description: String,
    /// BodyPartExamined, for example `HEAD`; empty where none fits.
    pub body_part: String,
    /// WindowCenter and WindowWidth, HU.
    pub window_hu: (i32, i32),
}

/// The treatment of a folder that is not empty.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExistingFolder {
    /// Refuse.
    Keep,
    /// Replace it, provided that it holds nothing but files of this writer.
    Replace,
}

/// Files that may lie beside the slices of a series of this writer.
pub(crate) const BESIDE_SLICES: [&str; 3] = ["truth.json", "labels.seg.nrrd", "landmarks.csv"];

/// Why a series could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The folder is not empty, and [`ExistingFolder::Keep`] was requested.
    #[error("{} is not empty; choose another folder or replace it with --force", .0.display())]
    NotEmpty(PathBuf),
    /// Replacing would delete something that this writer did not make.
    #[error("{} is not replaced: it contains {found:?}, which is not part of a phantom", folder.display())]
    Foreign {
        /// The folder.
        folder: PathBuf,
        /// Name of the first entry that is not ours.
        found: String,
    },
    /// The path is a file.
    #[error("{} is a file, expected a folder", .0.display())]
    NotAFolder(PathBuf),
    /// Too many voxels along an axis for the attributes of a CT image.
    #[error("a CT series holds at most {MAX_EXTENT} rows, columns and slices; the volume has {0:?} voxels")]
    Extent([usize; 3]),
    /// The file system refused.
    #[error("cannot {action} {}", path.display())]
    Io {
        /// The attempted action.
        action: &'static str,
        /// On what.
        path: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// Neither the new folder nor the old one could be put at its place; the old one is kept.
    #[error(
        "cannot write {}, and cannot restore the previous content: it is in {}; move it back manually",
        place.display(), kept.display()
    )]
    Displaced {
        /// The folder in which the series should have appeared.
        place: PathBuf,
        /// The present place of the earlier folder.
        kept: PathBuf,
        /// Why the new folder could not be put there.
        source: io::Error,
    },
    /// A slice could not be encoded or written.
    #[error("cannot write slice {} of the series", index + 1)]
    Slice {
        /// Index k of the slice.
        index: usize,
        /// Why not.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}

/// A folder under construction: nothing is at its place until [`SeriesFolder::finish`].
#[derive(Debug)]
pub struct SeriesFolder {
    place: PathBuf,
    existing: ExistingFolder,
    staging: tempfile::TempDir,
}

impl SeriesFolder {
    /// Starts a folder that will appear at `place`, and refuses at once what
    /// [`SeriesFolder::finish`] would refuse.
    ///
    /// # Errors
    /// When something that may not be replaced is at `place`, or its parent cannot be written.
    pub fn create(place: &Path, existing: ExistingFolder) -> Result<Self, WriteError> {
        check_place(place, existing)?;
        let parent = place.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        fs::create_dir_all(parent).map_err(io_error("create", parent))?;
        let staging = staging_folder(parent).map_err(io_error("create a temporary folder in", parent))?;
        Ok(Self { place: place.to_owned(), existing, staging })
    }

    /// Writes all slices, in parallel; `report` is called with the number of files just finished.
    ///
    /// # Errors
    /// When the volume is too large for a CT series or a file cannot be written.
    pub fn write_slices(
        &self,
        volume: &Volume,
        labels: &SeriesLabels,
        report: &(dyn Fn(usize) + Sync),
    ) -> Result<(), WriteError> {
        let series = Series::new(volume, labels)?;
        (0..volume.grid().dims()[2]).into_par_iter().try_for_each(|index| {
            let failed = |source| WriteError::Slice { index, source };
            let slice = series.slice(index).map_err(failed)?;
            let path = self.staging.path().join(slice_file_name(index));
            slice.write_to_file(path).map_err(|error| failed(error.into()))?;
            report(1);
            Ok(())
        })
    }

    /// Writes a file beside the slices.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write_file(&self, name: &str, bytes: &[u8]) -> Result<(), WriteError> {
        let path = self.staging.path().join(name);
        fs::write(&path, bytes).map_err(io_error("write", &path))
    }

    /// Puts the folder at its place.
    ///
    /// # Errors
    /// When something new at the place may not be replaced, or the file system refuses.
    /// The place is then unchanged, or [`WriteError::Displaced`] names where its earlier content
    /// is.
    pub fn finish(self) -> Result<(), WriteError> {
        check_place(&self.place, self.existing)?;
        let old = self.set_old_aside()?;
        if let Err(error) = fs::rename(self.staging.path(), &self.place) {
            return Err(put_back(old, &self.place, error));
        }
        let _ = self.staging.keep(); // moved away: there is nothing to remove any more
        Ok(())
    }

    /// Moves the content of the place into a temporary folder, which removes it when dropped.
    fn set_old_aside(&self) -> Result<Option<tempfile::TempDir>, WriteError> {
        if !self.place.exists() {
            return Ok(None);
        }
        let parent = self.staging.path().parent().unwrap_or(Path::new("."));
        let aside = tempfile::Builder::new()
            .prefix(".relief-")
            .tempdir_in(parent)
            .map_err(io_error("create a temporary folder in", parent))?;
        fs::rename(&self.place, aside.path().join(OLD)).map_err(io_error("replace", &self.place))?;
        Ok(Some(aside))
    }
}

/// Undoes [`SeriesFolder::set_old_aside`] and returns the error that made that necessary.
fn put_back(aside: Option<tempfile::TempDir>, place: &Path, error: io::Error) -> WriteError {
    let Some(aside) = aside else { return io_error("write", place)(error) };
    match fs::rename(aside.path().join(OLD), place) {
        Ok(()) => io_error("write", place)(error),
        // Dropped, the temporary folder would be removed with the series in it.
        Err(_) => {
            WriteError::Displaced { place: place.to_owned(), kept: aside.keep().join(OLD), source: error }
        }
    }
}

/// A temporary folder that may become the result: unlike others, it is no more private than the
/// umask says.
fn staging_folder(parent: &Path) -> io::Result<tempfile::TempDir> {
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o777));
    }
    builder.prefix(".relief-").tempdir_in(parent)
}

/// The name of slice k's file: names sort like slices.
#[must_use]
pub fn slice_file_name(index: usize) -> String {
    format!("slice-{:05}.dcm", index + 1)
}

fn io_error(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> WriteError {
    let path = path.to_owned();
    move |source| WriteError::Io { action, path, source }
}

/// Whether a series may appear at `place`.
fn check_place(place: &Path, existing: ExistingFolder) -> Result<(), WriteError> {
    let entries = match fs::read_dir(place) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(error) if error.kind() == io::ErrorKind::NotADirectory => {
            return Err(WriteError::NotAFolder(place.to_owned()));
        }
        Err(error) => return Err(io_error("read", place)(error)),
    };
    for entry in entries {
        let entry = entry.map_err(io_error("read", place))?;
        if existing == ExistingFolder::Keep {
            return Err(WriteError::NotEmpty(place.to_owned()));
        }
        let found = entry.file_name().to_string_lossy().into_owned();
        let ours =
            BESIDE_SLICES.contains(&&*found) || (found.starts_with("slice-") && found.ends_with(".dcm"));
        if !ours || !entry.file_type().is_ok_and(|kind| kind.is_file()) {
            return Err(WriteError::Foreign { folder: place.to_owned(), found });
        }
    }
    Ok(())
}

/// The values that all slices of one series share.
struct Series<'a> {
    volume: &'a Volume,
    labels: &'a SeriesLabels,
    columns: u16,
    rows: u16,
}

type Slice = FileDicomObject<InMemDicomObject>;
type SliceError = Box<dyn std::error::Error + Send + Sync>;

impl<'a> Series<'a> {
    fn new(volume: &'a Volume, labels: &'a SeriesLabels) -> Result<Self, WriteError> {
        let dims @ [nx, ny, nz] = volume.grid().dims();
        let extents = (u16::try_from(nx), u16::try_from(ny), u16::try_from(nz));
        let (Ok(columns), Ok(rows), Ok(_)) = extents else { return Err(WriteError::Extent(dims)) };
        Ok(Self { volume, labels, columns, rows })
    }

    /// Slice k as a DICOM object.
    fn slice(&self, k: usize) -> Result<Slice, SliceError> {
        let mut object = InMemDicomObject::new_empty();
        self.put_patient_and_study(&mut object);
        self.put_series_and_equipment(&mut object);
        self.put_image(&mut object, k);
        self.put_plane(&mut object, k);
        self.put_pixels(&mut object, k);
        Ok(object.with_meta(meta(uids::EXPLICIT_VR_LITTLE_ENDIAN))?)
    }

    fn put_patient_and_study(&self, object: &mut InMemDicomObject) {
        let labels = self.labels;
        put(object, tags::PATIENT_NAME, VR::PN, &labels.patient_name);
        put(object, tags::PATIENT_ID, VR::LO, &labels.patient_id);
        put(object, tags::PATIENT_BIRTH_DATE, VR::DA, "");
        put(object, tags::PATIENT_SEX, VR::CS, "O");
        put(object, tags::STUDY_INSTANCE_UID, VR::UI, &self.uid("study"));
        put(object, tags::STUDY_DATE, VR::DA, "");
        put(object, tags::STUDY_TIME, VR::TM, "");
        put(object, tags::STUDY_ID, VR::SH, "1");
        put(object, tags::ACCESSION_NUMBER, VR::SH, "");
        put(object, tags::REFERRING_PHYSICIAN_NAME, VR::PN, "");
        put(object, tags::STUDY_DESCRIPTION, VR::LO, &labels.description);
    }

    fn put_series_and_equipment(&self, object: &mut InMemDicomObject) {
        put(object, tags::MODALITY, VR::CS, "CT");
        put(object, tags::SERIES_INSTANCE_UID, VR::UI, &self.uid("series"));
        put(object, tags::SERIES_NUMBER, VR::IS, "1");
        put(object, tags::SERIES_DESCRIPTION, VR::LO, &self.labels.description);
        put(object, tags::BODY_PART_EXAMINED, VR::CS, &self.labels.body_part);
        put(object, tags::PATIENT_POSITION, VR::CS, "HFS");
        put(object, tags::FRAME_OF_REFERENCE_UID, VR::UI, &self.uid("frame of reference"));
        put(object, tags::POSITION_REFERENCE_INDICATOR, VR::LO, "");
        put(object, tags::MANUFACTURER, VR::LO, "Relief");
        put(object, tags::MANUFACTURER_MODEL_NAME, VR::LO, "Procedural phantom");
    }

    fn put_image(&self, object: &mut InMemDicomObject, k: usize) {
        put(object, tags::SPECIFIC_CHARACTER_SET, VR::CS, "ISO_IR 192");
        put(object, tags::SOP_CLASS_UID, VR::UI, uids::CT_IMAGE_STORAGE);
        put(object, tags::SOP_INSTANCE_UID, VR::UI, &self.uid(&format!("slice {k}")));
        put(object, tags::INSTANCE_NUMBER, VR::IS, &(k + 1).to_string());
        put(object, tags::ACQUISITION_NUMBER, VR::IS, "1");
        put_many(object, tags::IMAGE_TYPE, VR::CS, ["DERIVED", "PRIMARY", "AXIAL"].map(str::to_owned));
        put(object, tags::CONTENT_DATE, VR::DA, "");
        put(object, tags::CONTENT_TIME, VR::TM, "");
        put(object, tags::KVP, VR::DS, "120");
        put(object, tags::BURNED_IN_ANNOTATION, VR::CS, "NO");
        // The standard's term for an image of a phantom.
        put(object, tags::QUALITY_CONTROL_IMAGE, VR::CS, "YES");
        put(object, tags::LOSSY_IMAGE_COMPRESSION, VR::CS, "00");
        let (center, width) = self.labels.window_hu;
        put(object, tags::WINDOW_CENTER, VR::DS, &center.to_string());
        put(object, tags::WINDOW_WIDTH, VR::DS, &width.to_string());
    }

    fn put_plane(&self, object: &mut InMemDicomObject, k: usize) {
        let grid = self.volume.grid();
        let affine = grid.patient_from_voxel().affine;
        let [row_direction, column_direction, _] = grid.axis_directions();
        let normal = row_direction.cross(column_direction).normalize_or_zero();
        let step = affine.matrix3.z_axis.dot(normal).abs();
        let [column_spacing, row_spacing, _] = grid.spacing_mm();
        let position = affine.translation + affine.matrix3.z_axis * k as f64;
        put_many(object, tags::IMAGE_POSITION_PATIENT, VR::DS, decimals(&position.to_array()));
        let orientation = [row_direction.to_array(), column_direction.to_array()].concat();
        put_many(object, tags::IMAGE_ORIENTATION_PATIENT, VR::DS, decimals(&orientation));
        put_many(object, tags::PIXEL_SPACING, VR::DS, decimals(&[row_spacing, column_spacing]));
        put(object, tags::SLICE_THICKNESS, VR::DS, &decimal_string(step));
        put(object, tags::SPACING_BETWEEN_SLICES, VR::DS, &decimal_string(step));
        put(object, tags::SLICE_LOCATION, VR::DS, &decimal_string(position.dot(normal)));
    }

    fn put_pixels(&self, object: &mut InMemDicomObject, k: usize) {
        put(object, tags::PHOTOMETRIC_INTERPRETATION, VR::CS, "MONOCHROME2");
        put(object, tags::RESCALE_INTERCEPT, VR::DS, "0");
        put(object, tags::RESCALE_SLOPE, VR::DS, "1");
        put(object, tags::RESCALE_TYPE, VR::LO, "HU");
        let numbers = [
            (tags::SAMPLES_PER_PIXEL, 1),
            (tags::ROWS, self.rows),
            (tags::COLUMNS, self.columns),
            (tags::BITS_ALLOCATED, 16),
            (tags::BITS_STORED, 16),
            (tags::HIGH_BIT, 15),
            (tags::PIXEL_REPRESENTATION, 1),
        ];
        for (tag, value) in numbers {
            object.put_element(DataElement::new(tag, VR::US, PrimitiveValue::from(value)));
        }
        let size = usize::from(self.rows) * usize::from(self.columns);
        let words: C<u16> =
            self.volume.voxels_hu()[k * size..(k + 1) * size].iter().map(|&hu| hu as u16).collect();
        object.put_element(DataElement::new(tags::PIXEL_DATA, VR::OW, PrimitiveValue::U16(words)));
    }

    /// A UID for `role` that depends on nothing but the volume and its labels.
    fn uid(&self, role: &str) -> String {
        let SeriesLabels { patient_name, patient_id, description, .. } = self.labels;
        uid_of(&self.volume.content_hash().0, [patient_name, patient_id, description, role])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_with_other_files_is_never_replaced() {
        let parent = tempfile::tempdir().unwrap();
        let place = parent.path().join("series");
        fs::create_dir(&place).unwrap();
        fs::write(place.join("slice-00001.dcm"), b"old").unwrap();
        assert!(matches!(SeriesFolder::create(&place, ExistingFolder::Keep), Err(WriteError::NotEmpty(_))));
        assert!(SeriesFolder::create(&place, ExistingFolder::Replace).is_ok());
        fs::write(place.join("thesis.txt"), b"precious").unwrap();
        let refused = SeriesFolder::create(&place, ExistingFolder::Replace);
        assert!(matches!(refused, Err(WriteError::Foreign { found, .. }) if found == "thesis.txt"));
    }

    #[test]
    fn a_replaced_folder_that_cannot_be_put_back_is_kept_and_named() {
        let parent = tempfile::tempdir().unwrap();
        let aside = tempfile::tempdir_in(parent.path()).unwrap();
        fs::create_dir(aside.path().join(OLD)).unwrap();
        fs::write(aside.path().join(OLD).join("slice-00001.dcm"), b"old").unwrap();
        let refused = || io::Error::from(io::ErrorKind::PermissionDenied);
        let error = put_back(Some(aside), &parent.path().join("gone").join("series"), refused());
        let WriteError::Displaced { kept, .. } = &error else { panic!("{error}") };
        assert_eq!(fs::read(kept.join("slice-00001.dcm")).unwrap(), b"old");
        assert!(error.to_string().contains(&kept.display().to_string()), "{error}");
    }

    #[test]
    fn an_unfinished_folder_leaves_nothing_behind() {
        let parent = tempfile::tempdir().unwrap();
        let folder = SeriesFolder::create(&parent.path().join("series"), ExistingFolder::Keep).unwrap();
        folder.write_file("truth.json", b"{}").unwrap();
        drop(folder);
        assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 0);
    }
}
