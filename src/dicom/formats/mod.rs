//! Volumes and label maps in the files of research: NIfTI and NRRD (with 3D Slicer's
//! segmentations).
//!
//! Bounded readers of `.nii`, `.nii.gz`, `.nrrd` and `.seg.nrrd`, recognised by their first bytes,
//! and writers of label maps as `.seg.nrrd` and `.nii.gz`. DICOM segmentation objects become the
//! same [`LabelMap`](relief_volume::LabelMap) elsewhere in this crate. Images with detached headers
//! are not read, because such a header could name any file of the machine.
//!
//! Spaces: patient LPS mm. NIfTI is RAS; NRRD declares its space. Voxels: HU as `i16` of a volume,
//! `u16` labels of a map. Memory grows with the bytes of the file, never with the sizes in its
//! header, and is limited by [`FormatLimits`].

mod bytes;
mod error;
mod header;
mod limits;
mod nifti;
mod nifti_write;
mod nrrd;
mod segmentation;
mod values;
mod write;

use std::path::Path;

pub use error::FormatError;
pub use limits::FormatLimits;
pub use nifti_write::write_nifti_labels;
pub use segmentation::{ReadLabels, ReadLayers};
pub use write::{write_seg_nrrd, write_seg_nrrd_layers};

use super::warnings::{Warning, WarningCode};
use bytes::{Source, VolumeFormat};
use header::{Described, Header};
use relief_volume::{Grid, Volume};

/// A volume and the anomalies of its file.
#[derive(Clone, Debug)]
pub struct ReadVolume {
    /// The volume in HU and patient LPS.
    pub volume: Volume,
    /// Anomalies, and how each was handled.
    pub warnings: Vec<Warning>,
}

/// Whether a file begins as one of these formats does. A file that cannot be read does not.
#[must_use]
pub fn is_volume_file(path: &Path) -> bool {
    // Opening a pipe would wait for its writer.
    path.is_file() && Source::open(path).and_then(|mut source| source.kind()).is_ok()
}

/// Reads a label map within the default [`FormatLimits`].
///
/// # Errors
/// As [`read_labels_within`].
pub fn read_labels(path: &Path) -> Result<ReadLabels, FormatError> {
    read_labels_within(FormatLimits::default(), path)
}

/// Reads a label map: whole numbers from 0 to 65535, 0 for no segment.
///
/// # Errors
/// When the file cannot be read, is of no known format, cut short or larger than allowed, does not
/// say where its voxels lie, or holds values that are no labels.
pub fn read_labels_within(limits: FormatLimits, path: &Path) -> Result<ReadLabels, FormatError> {
    read_labels_from(limits, Source::open(path)?)
}

/// Reads a label map that is in memory, as [`read_labels`] reads a file.
///
/// # Errors
/// As [`read_labels_within`].
pub fn read_labels_of_bytes(bytes: &[u8]) -> Result<ReadLabels, FormatError> {
    read_labels_from(FormatLimits::default(), Source::of_bytes(bytes)?)
}

fn read_labels_from(limits: FormatLimits, mut source: Source<'_>) -> Result<ReadLabels, FormatError> {
    let Described { header, segments } = read_header(&mut source)?;
    header.check(limits)?;
    segmentation::read(&mut source, &header, segments)
}

/// Reads where the voxels of a volume lie, and none of them.
///
/// # Errors
/// When the file cannot be read, is of no known format or larger than allowed, or does not say
/// where its voxels lie.
pub fn read_grid(path: &Path) -> Result<Grid, FormatError> {
    let Described { header, .. } = read_header(&mut Source::open(path)?)?;
    header.check(FormatLimits::default())?;
    Ok(header.grid)
}

/// Reads every layer of a label map that is in memory: overlapping segments stay whole. Voxels of
/// all layers count.
///
/// # Errors
/// As [`read_labels_within`].
pub fn read_label_layers_of_bytes(limits: FormatLimits, bytes: &[u8]) -> Result<ReadLayers, FormatError> {
    let mut source = Source::of_bytes(bytes)?;
    let Described { header, segments } = read_header(&mut source)?;
    header.check(limits)?;
    segmentation::read_layers(&mut source, &header, &segments)
}

/// Reads a volume in HU, within the default [`FormatLimits`].
///
/// # Errors
/// As [`read_volume_within`].
pub fn read_volume(path: &Path) -> Result<ReadVolume, FormatError> {
    read_volume_within(FormatLimits::default(), path)
}

/// Reads a volume in HU; values are rounded to whole HU and kept within -32768..=32767.
///
/// # Errors
/// As [`read_labels_within`], but for the values: these are refused when they are not finite.
pub fn read_volume_within(limits: FormatLimits, path: &Path) -> Result<ReadVolume, FormatError> {
    let mut source = Source::open(path)?;
    let Described { header, .. } = read_header(&mut source)?;
    header.check(limits)?;
    if header.layers > 1 {
        return Err(FormatError::Layers { found: header.layers });
    }
    let Header { voxel, scale, grid, .. } = &header;
    let mut clamped = 0u64;
    let voxels = values::read(&mut source, *voxel, grid.voxel_count(), |value| {
        let hu = (scale.slope * value + scale.intercept).round();
        if !hu.is_finite() {
            return Err(value);
        }
        clamped += u64::from(hu < f64::from(i16::MIN) || hu > f64::from(i16::MAX));
        Ok(hu as i16)
    })?;
    let clipped = (clamped > 0).then(|| {
        let message = format!("{clamped} voxels beyond -32768..32767 HU have the nearer of the two");
        Warning::new(WarningCode::ClippedValues, message)
    });
    let warnings = clipped.into_iter().collect();
    let volume = Volume::new(grid.clone(), voxels).map_err(|_| FormatError::Cut { expected: 0, found: 0 })?;
    Ok(ReadVolume { volume, warnings })
}

/// Reads as far as the voxels.
fn read_header(source: &mut Source<'_>) -> Result<Described, FormatError> {
    match source.kind()? {
        VolumeFormat::Nifti => nifti::read(source),
        VolumeFormat::Nrrd => nrrd::read(source),
    }
}
