//! One case: `case.toml` and `scene.json`, checked.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Deserialize;

use super::case_id::CaseId;
use super::compare::Tolerance;
use super::error::GoldenError;
use super::raster::{Raster, read_bounded};
use crate::raster::Aspect;
use crate::source::{Source, VolumeFile};
use relief_base::OutOfRange;
use relief_render::{Scene, SceneFile, Subject};
use relief_volume::{Orbit, Volume};

const CASE_FILE: &str = "case.toml";
const SCENE_FILE: &str = "scene.json";

/// A picture to render, and the parts of it to compare.
#[derive(Clone, Debug)]
pub struct Case {
    id: CaseId,
    folder: PathBuf,
    purpose: String,
    source: Source,
    is_labelled: bool,
    tolerance: Tolerance,
    aspects: Vec<Aspect>,
    scene: SceneFile,
}

/// `case.toml` as written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CaseFile {
    purpose: String,
    tolerance: ToleranceName,
    compare: Vec<Aspect>,
    volume: VolumeFile,
}

/// Tolerances have names, so that none is loosened for one case in passing.
#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum ToleranceName {
    Exact,
    Strict,
}

impl Case {
    /// Reads the case in `folder`.
    ///
    /// # Errors
    /// When a file is missing or refused, a value is out of range, or the folder holds a file that
    /// nothing compares.
    pub fn read(id: CaseId, folder: &Path) -> Result<Self, GoldenError> {
        let path = folder.join(CASE_FILE);
        let file: CaseFile = toml::from_slice(&read_required(&path)?)
            .map_err(|source| GoldenError::Syntax { path: path.clone(), source: Box::new(source) })?;
        let is_labelled = file.volume.labels;
        let source = file.volume.source(&path)?;
        let scene = folder.join(SCENE_FILE);
        let parsed = SceneFile::parse(&read_required(&scene)?);
        let case = Self {
            id,
            folder: folder.to_owned(),
            purpose: file.purpose,
            source,
            is_labelled,
            tolerance: file.tolerance.tolerance(),
            aspects: checked_aspects(&path, file.compare)?,
            scene: parsed.map_err(|source| GoldenError::Scene { path: scene, source })?,
        };
        case.refuse_strays()?;
        Ok(case)
    }

    /// Suite and name.
    #[must_use]
    pub fn id(&self) -> &CaseId {
        &self.id
    }

    /// The folder of its files.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The purpose of the case, one sentence.
    #[must_use]
    pub fn purpose(&self) -> &str {
        &self.purpose
    }

    /// The source of the voxels.
    #[must_use]
    pub const fn source(&self) -> &Source {
        &self.source
    }

    /// Largest permitted difference of pictures.
    #[must_use]
    pub fn tolerance(&self) -> Tolerance {
        self.tolerance
    }

    /// The products to compare, without repetition.
    #[must_use]
    pub fn aspects(&self) -> &[Aspect] {
        &self.aspects
    }

    /// The complete scene for the volume, with the phantom's organs where the case asks for
    /// them.
    ///
    /// # Errors
    /// When a value is out of range, or the tolerance would let a depth pass that is off by one
    /// sample.
    pub fn scene(&self, volume: &Volume) -> Result<Scene, GoldenError> {
        let recipe = self.source.recipe().filter(|_| self.is_labelled);
        let organs = recipe.and_then(|recipe| recipe.label_map()).map(Arc::new);
        let resolved =
            self.scene.clone().resolve_for(&Subject::of(volume, organs.as_ref()), &Orbit::default());
        let path = || self.folder.join(SCENE_FILE);
        let scene = resolved.and_then(|scene| scene.expect_no_annotations().map(|()| scene));
        let scene = scene.map_err(|source| GoldenError::Scene { path: path(), source })?;
        let least_mm = 4.0 * self.tolerance.depth_mm;
        if scene.request.sample_distance_mm < least_mm {
            let allowed = format!("at least {least_mm}, four times the tolerance {}", self.tolerance.name);
            let source = OutOfRange::new("sample_distance_mm", scene.request.sample_distance_mm, allowed);
            return Err(GoldenError::Range { path: path(), source });
        }
        Ok(scene)
    }

    /// The golden of one of its aspects; `None` when it is missing.
    ///
    /// # Errors
    /// When the file is too large, or no picture of the aspect's kind.
    pub fn expected(&self, aspect: Aspect) -> Result<Option<Raster>, GoldenError> {
        Raster::read(&self.folder, aspect)
    }

    /// A golden that is no longer compared would look as if it were.
    fn refuse_strays(&self) -> Result<(), GoldenError> {
        let failed = |source| GoldenError::Read { path: self.folder.clone(), source };
        for entry in std::fs::read_dir(&self.folder).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let name = entry.file_name();
            let is_golden = |aspect: &Aspect| name == aspect.file_name();
            if name != CASE_FILE && name != SCENE_FILE && !self.aspects.iter().any(is_golden) {
                return Err(GoldenError::Stray { path: entry.path() });
            }
        }
        Ok(())
    }
}

impl ToleranceName {
    const fn tolerance(self) -> Tolerance {
        match self {
            Self::Exact => Tolerance::EXACT,
            Self::Strict => Tolerance::STRICT,
        }
    }
}

fn checked_aspects(path: &Path, mut aspects: Vec<Aspect>) -> Result<Vec<Aspect>, GoldenError> {
    aspects.sort();
    aspects.dedup();
    if aspects.is_empty() {
        let allowed = format!("one or more of {}", Aspect::ALL.map(Aspect::name).join(", "));
        let source = OutOfRange::new("compare", "[]", allowed);
        return Err(GoldenError::Range { path: path.to_owned(), source });
    }
    Ok(aspects)
}

fn read_required(path: &Path) -> Result<Vec<u8>, GoldenError> {
    let missing = || GoldenError::Read { path: path.to_owned(), source: std::io::ErrorKind::NotFound.into() };
    read_bounded(path)?.ok_or_else(missing)
}
