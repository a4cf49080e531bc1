//! The volume of a case: a procedural one, or a series of the project that has the case.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::error::GoldenError;
use relief_base::OutOfRange;
use relief_dicom::{Strictness, discover, is_volume_file, load, read_volume};
use relief_volume::{PhantomRecipe, Volume};

/// Voxels across: goldens are many and quick.
const MAX_PHANTOM_SIZE: usize = 128;

/// The source of a case's voxels.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Source {
    /// A procedural volume.
    Phantom(PhantomRecipe),
    /// A CT series (folder, file or zip), or a volume file.
    Series {
        /// Its place.
        path: PathBuf,
        /// The series, where the place has several.
        uid: Option<String>,
    },
}

/// The table `volume` of `case.toml`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct VolumeFile {
    phantom: Option<String>,
    size: Option<usize>,
    #[serde(default)]
    seed: u64,
    /// Whether the phantom's organs are labelled.
    #[serde(default)]
    pub(super) labels: bool,
    /// A path from the case's folder.
    series: Option<PathBuf>,
    series_uid: Option<String>,
}

impl Source {
    /// Makes or loads the volume. Any defect of a series is an error: its pictures would change
    /// when the defect is repaired.
    ///
    /// # Errors
    /// When the series cannot be read.
    pub fn volume(&self) -> Result<Volume, GoldenError> {
        match self {
            Self::Phantom(recipe) => Ok(recipe.make().volume),
            Self::Series { path, uid } => {
                let failed = |source| GoldenError::Series { path: path.clone(), source: Box::new(source) };
                if is_volume_file(path) {
                    let found = read_volume(path);
                    let failed = |source| GoldenError::VolumeFile { path: path.clone(), source };
                    return Ok(found.map_err(failed)?.volume);
                }
                let found = discover(path, Strictness::Strict, &|_| ()).map_err(failed)?;
                let entry = found.select(uid.as_deref()).map_err(failed)?;
                Ok(load(entry, Strictness::Strict, &|_| ()).map_err(failed)?.volume)
            }
        }
    }

    /// The recipe of a procedural volume.
    #[must_use]
    pub const fn recipe(&self) -> Option<PhantomRecipe> {
        match self {
            Self::Phantom(recipe) => Some(*recipe),
            Self::Series { .. } => None,
        }
    }
}

impl VolumeFile {
    /// The source that the table of the file at `case_file` describes.
    pub(super) fn source(self, case_file: &Path) -> Result<Source, GoldenError> {
        let refused = |key, found: &dyn std::fmt::Display, allowed: &str| GoldenError::Range {
            path: case_file.to_owned(),
            source: OutOfRange::new(key, found, allowed),
        };
        match (self.phantom, self.series) {
            (Some(phantom), None) => {
                if self.series_uid.is_some() {
                    return Err(refused("volume.series_uid", &"set", "nothing beside phantom"));
                }
                let size = self.size.ok_or_else(|| refused("volume.size", &"missing", "16 to 128"))?;
                if size > MAX_PHANTOM_SIZE {
                    return Err(refused("volume.size", &size, &format!("at most {MAX_PHANTOM_SIZE}")));
                }
                Ok(Source::Phantom(
                    PhantomRecipe::new(phantom.parse()?).with_size(size)?.with_seed(self.seed),
                ))
            }
            (None, Some(series)) => {
                if self.size.is_some() || self.seed != 0 || self.labels {
                    return Err(refused(
                        "volume",
                        &"a series with size, seed or labels",
                        "these beside phantom",
                    ));
                }
                let folder = case_file.parent().unwrap_or(Path::new("."));
                Ok(Source::Series { path: folder.join(series), uid: self.series_uid })
            }
            _ => Err(refused("volume", &"neither or both of phantom and series", "one of them")),
        }
    }
}
