//! `--series` of import and export: the volume that annotations belong to.

use std::path::PathBuf;

use super::super::bucket::CopiesArguments;
use super::super::series as any_series;
use super::super::source::SeriesOptions;
use relief_annotation::FrameOfReference;
use relief_dicom::{Loaded, SeriesReference, WarningCode};
use relief_volume::Grid;

/// The series that items belong to.
#[derive(Debug, clap::Args)]
pub(super) struct SeriesArguments {
    /// The series that items belong to: a folder, a file, a DICOMDIR or a zip; a volume as .nii,
    /// .nii.gz or .nrrd; or the address of one in a bucket or a DICOM archive
    #[arg(long, value_name = "PATH")]
    series: Option<PathBuf>,
    /// The series, where PATH holds several (`relief inspect PATH` lists them)
    #[arg(long, value_name = "UID", requires = "series")]
    series_uid: Option<String>,
    /// The phase of a series that shows one region several times, from 1
    #[arg(long, value_name = "N", requires = "series", value_parser = clap::value_parser!(u32).range(1..))]
    phase: Option<u32>,
    #[command(flatten)]
    copies: CopiesArguments,
}

/// The part of a series that annotations need.
pub(super) struct Series {
    /// The frame of reference of its positions.
    pub(super) frame: FrameOfReference,
    /// Its voxels.
    pub(super) grid: Grid,
    /// The series' DICOM attributes; none for a volume in a single file, or for files without
    /// UIDs.
    pub(super) reference: Option<SeriesReference>,
    /// The number of its phase, from 1, if the series has phases.
    pub(super) phase: Option<usize>,
    /// Warnings of reading it.
    pub(super) warnings: Vec<WarningCode>,
}

impl SeriesArguments {
    /// Loads the series, if one is given.
    pub(super) fn load(&self) -> anyhow::Result<Option<Series>> {
        let Some(path) = &self.series else { return Ok(None) };
        let (series_uid, phase) = (self.series_uid.clone(), self.phase);
        let options = SeriesOptions { series_uid, phase, strict: false, downsample: 1 };
        let (loaded, ()) = any_series::load_after(path, &self.copies, &options, |_| Ok(()))?;
        let reference = loaded.reference.clone().map(std::sync::Arc::unwrap_or_clone);
        Ok(Some(Series::of(&loaded, reference)))
    }
}

impl Series {
    fn of(loaded: &Loaded, reference: Option<SeriesReference>) -> Self {
        let uid = loaded.identity.frame_of_reference().map(str::to_owned);
        // Without a UID: derived from the content of the volume.
        let frame = uid.unwrap_or_else(|| format!("volume:{}", loaded.volume.content_hash().short()));
        let phase = loaded.identity.phase().map(|phase| phase.number);
        let warnings = loaded.warnings.iter().map(|warning| warning.code).collect();
        Self {
            frame: FrameOfReference(frame),
            grid: loaded.volume.grid().clone(),
            reference,
            phase,
            warnings,
        }
    }
}
