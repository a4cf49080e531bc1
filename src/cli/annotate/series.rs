//! `--series` of import and export: the volume that annotations belong to.

use std::path::PathBuf;

use super::super::source::{self, SeriesOptions};
use crate::annotation::FrameOfReference;
use crate::volume::Grid;

/// The series that items belong to.
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The series that items belong to: a folder, a file, a DICOMDIR or a zip; or a volume as .nii, .nii.gz or .nrrd
    #[arg(long, value_name = "PATH")]
    series: Option<PathBuf>,
    /// Which series, where PATH holds several (`relief inspect PATH` lists them)
    #[arg(long, value_name = "UID", requires = "series")]
    series_uid: Option<String>,
}

/// What annotations need of a series.
pub(super) struct Series {
    /// What its mm are told from.
    pub(super) frame: FrameOfReference,
    /// Its voxels.
    pub(super) grid: Grid,
}

impl Arguments {
    /// Loads the series, if one is given.
    pub(super) fn load(&self) -> anyhow::Result<Option<Series>> {
        let Some(path) = &self.series else { return Ok(None) };
        let options = SeriesOptions { series_uid: self.series_uid.clone(), strict: false, downsample: 1 };
        let loaded = source::load(path, &options)?;
        let uid = loaded.identity.frame_of_reference().map(str::to_owned);
        // Without a UID: what the volume is itself told by.
        let frame = uid.unwrap_or_else(|| format!("volume:{}", loaded.volume.content_hash().short()));
        Ok(Some(Series { frame: FrameOfReference(frame), grid: loaded.volume.grid().clone() }))
    }
}
