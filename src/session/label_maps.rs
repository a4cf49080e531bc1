//! Label maps from files, resampled to the grid of their volume.
//!
//! What it is: the function by which `relief render`, servers and batches read a label map. The
//! beginning of the file selects the format: NIfTI, NRRD, or else DICOM segmentation. Errors
//! contain no path, because they may be shown to others.

use std::path::Path;
use std::sync::Arc;

use relief_dicom::{FormatError, FormatLimits, LoadLimits};
use relief_volume::{Grid, LabelMap};

/// A label map on the grid of a volume.
#[derive(Clone, Debug)]
pub struct PlacedLabels {
    /// Its hash is known: requests are compared by it.
    pub map: Arc<LabelMap>,
    /// Warnings, in sentences.
    pub warnings: Vec<String>,
}

/// Why a label map cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LabelsError {
    /// The file cannot be opened.
    #[error("cannot read it: {0}")]
    Unreadable(#[from] std::io::Error),
    /// There is a folder.
    #[error("it is a folder, expected a file")]
    Folder,
    /// A NIfTI or NRRD file that is not a label map.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// Neither of these, and no segmentation.
    #[error("neither NIfTI nor NRRD nor a usable DICOM segmentation: {0}")]
    Segmentation(#[from] relief_dicom::Defect),
    /// Nothing of it lies in the volume.
    #[error(
        "the label map and the volume do not overlap: the map spans {map}, the volume {volume} (patient LPS); do they belong to the same scan?"
    )]
    Elsewhere {
        /// From and to, mm.
        map: String,
        /// From and to, mm.
        volume: String,
    },
}

impl LabelsError {
    /// The message with `subject` in place of the path.
    #[must_use]
    pub fn about(&self, subject: &str) -> String {
        match self {
            Self::Format(error) => error.about(subject),
            other => other.to_string(),
        }
    }
}

/// Share of the labelled space that lies in the volume below which a map may well be of another
/// series.
const DOUBTFUL_SHARE: f64 = 0.5;

/// Voxels that a label map for a volume may have: four for each of the volume's, and at least 16
/// million, so that maps of finer grids and of several layers fit.
#[must_use]
pub fn most_label_voxels(grid: &Grid) -> u64 {
    (grid.voxel_count() as u64).saturating_mul(4).max(1 << 24)
}

/// Reads a label map of at most `most_voxels` voxels onto the grid of a volume.
///
/// # Errors
/// When the file cannot be read or used, or no label of it lies in the volume.
pub fn load_labels(path: &Path, most_voxels: u64, grid: &Grid) -> Result<PlacedLabels, LabelsError> {
    let (map, mut warnings) = read(path, most_voxels)?;
    let map = if map.grid() == grid { map } else { placed(&map, grid, &mut warnings)? };
    let _ = map.content_hash(); // not when the first request waits
    Ok(PlacedLabels { map: Arc::new(map), warnings })
}

fn read(path: &Path, most_voxels: u64) -> Result<(LabelMap, Vec<String>), LabelsError> {
    std::fs::File::open(path)?;
    if path.is_dir() {
        return Err(LabelsError::Folder);
    }
    if relief_dicom::is_volume_file(path) {
        let found = relief_dicom::read_labels_within(FormatLimits { voxels: most_voxels }, path)?;
        return Ok((found.map, found.warnings));
    }
    let limits = LoadLimits { voxel_bytes: most_voxels.saturating_mul(size_of::<u16>() as u64) };
    let found = relief_dicom::load_segmentation(limits, path)?;
    Ok((found.map, found.warnings))
}

fn placed(map: &LabelMap, grid: &Grid, warnings: &mut Vec<String>) -> Result<LabelMap, LabelsError> {
    let placed = map.resampled(grid);
    let space = |map: &LabelMap| map.labelled_voxels() as f64 * map.voxel_mm3();
    let share = space(&placed) / space(map).max(f64::MIN_POSITIVE);
    if map.labelled_voxels() > 0 && placed.labelled_voxels() == 0 {
        let span = |grid: &Grid| {
            let bounds = grid.bounds();
            format!("{:.0} to {:.0} mm", bounds.min.xyz, bounds.max.xyz)
        };
        return Err(LabelsError::Elsewhere { map: span(map.grid()), volume: span(grid) });
    }
    if share < DOUBTFUL_SHARE {
        warnings.push(format!(
            "only {:.0} % of the labelled space lies in the volume; is the label map of this scan?",
            100.0 * share
        ));
    }
    Ok(placed)
}
