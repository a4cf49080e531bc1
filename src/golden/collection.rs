//! The cases of a folder: `<suite>/<case>/`, found and selected, not yet read.

use std::path::{Path, PathBuf};

use super::case::Case;
use super::case_id::CaseId;
use super::error::GoldenError;

impl From<CaseId> for String {
    fn from(id: CaseId) -> Self {
        id.to_string()
    }
}

/// The cases of a folder, in the order of their names. Never empty.
#[derive(Clone, Debug)]
pub struct Collection {
    dir: PathBuf,
    ids: Vec<CaseId>,
}

impl Collection {
    /// Finds the cases under `dir`. Every folder in a suite counts, whether it has a `case.toml` or
    /// has lost it.
    ///
    /// # Errors
    /// When there are no cases, a folder cannot be read, a name cannot be written in a
    /// command, or a suite contains a loose file.
    pub fn open(dir: &Path) -> Result<Self, GoldenError> {
        let mut ids = Vec::new();
        for suite in entries(dir)?.into_iter().filter(|entry| entry.is_dir()) {
            let suite_name = checked_name(&suite)?;
            for case in entries(&suite)? {
                if !case.is_dir() {
                    return Err(GoldenError::Stray { path: case });
                }
                ids.push(CaseId { suite: suite_name.clone(), name: checked_name(&case)? });
            }
        }
        ids.sort();
        if ids.is_empty() {
            return Err(GoldenError::NoCases { dir: dir.to_owned() });
        }
        Ok(Self { dir: dir.to_owned(), ids })
    }

    /// Keeps the cases and suites of these names; all when no name is given.
    ///
    /// # Errors
    /// When a name fits nothing: a misspelt name must not pass for success.
    pub fn select(self, wanted: &[String]) -> Result<Self, GoldenError> {
        if wanted.is_empty() {
            return Ok(self);
        }
        if let Some(name) = wanted.iter().find(|name| !self.ids.iter().any(|id| id.answers_to(name))) {
            let mut suites: Vec<&str> = self.ids.iter().map(CaseId::suite).collect();
            suites.dedup();
            return Err(GoldenError::UnknownCase { name: name.clone(), suites: suites.join(", ") });
        }
        let is_wanted = |id: &CaseId| wanted.iter().any(|name| id.answers_to(name));
        Ok(Self { ids: self.ids.into_iter().filter(is_wanted).collect(), ..self })
    }

    /// The cases.
    #[must_use]
    pub fn ids(&self) -> &[CaseId] {
        &self.ids
    }

    /// Reads one of the cases.
    ///
    /// # Errors
    /// As [`Case::read`].
    pub fn read(&self, id: &CaseId) -> Result<Case, GoldenError> {
        Case::read(id.clone(), &self.dir.join(&id.suite).join(&id.name))
    }
}

/// The entries of a folder, without hidden files.
fn entries(dir: &Path) -> Result<Vec<PathBuf>, GoldenError> {
    let failed = |source| GoldenError::Read { path: dir.to_owned(), source };
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        if !entry.file_name().to_string_lossy().starts_with('.') {
            paths.push(entry.path());
        }
    }
    Ok(paths)
}

fn checked_name(path: &Path) -> Result<String, GoldenError> {
    let plain = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
    match path.file_name().and_then(|name| name.to_str()) {
        Some(name) if name.bytes().all(plain) => Ok(name.to_owned()),
        _ => Err(GoldenError::Name { path: path.to_owned() }),
    }
}
