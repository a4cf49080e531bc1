//! Paths in manifests: relative to the manifest's folder, so that a folder with series and manifest
//! can be moved, and a manifest can be run from any folder.

use std::path::{Component, Path, PathBuf};

use super::location::Location;
use super::manifest::Job;

impl Job {
    /// With paths below `folder`, the manifest's, relative to it, and with all others absolute.
    /// Addresses of buckets and archives stay.
    ///
    /// # Errors
    /// When the current folder is unknown.
    pub fn relative_to(mut self, folder: &Path) -> std::io::Result<Self> {
        let folder = plain(&std::path::absolute(folder)?);
        for path in self.paths().filter(|path| !Location::is_remote(path)) {
            let absolute = plain(&std::path::absolute(&*path)?);
            *path = match absolute.strip_prefix(&folder) {
                Ok(below) if below.as_os_str().is_empty() => PathBuf::from("."),
                Ok(below) => below.to_owned(),
                Err(_) => absolute,
            };
        }
        Ok(self)
    }

    /// With the relative paths that exist in `folder`, the manifest's, made absolute; others belong to
    /// the current folder, as in manifests of earlier versions.
    ///
    /// # Errors
    /// When the current folder is unknown.
    pub fn resolved_in(mut self, folder: &Path) -> std::io::Result<Self> {
        let folder = std::path::absolute(folder)?;
        for path in self.paths().filter(|path| path.is_relative() && !Location::is_remote(path)) {
            let there = folder.join(&*path);
            if there.exists() {
                *path = there;
            }
        }
        Ok(self)
    }

    /// The paths of this machine that do not exist.
    #[must_use]
    pub fn missing_paths(&mut self) -> Vec<PathBuf> {
        self.paths()
            .filter(|path| !Location::is_remote(path) && !path.exists())
            .map(|path| path.clone())
            .collect()
    }

    fn paths(&mut self) -> impl Iterator<Item = &mut PathBuf> {
        let labels = self.series.labels.as_mut().map(|labels| &mut labels.path);
        let annotations = self.annotations.as_mut().map(|kept| &mut kept.path);
        std::iter::once(&mut self.series.path).chain(labels).chain(annotations)
    }
}

/// Without `.` and, where that is certain, without `..`.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir if plain.is_dir() && !plain.is_symlink() => {
                plain.pop();
            }
            part => plain.push(part),
        }
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifest::JobKey;
    use crate::source::SeriesSource;

    fn job(path: &str) -> Job {
        let job = JobKey(String::new());
        let sha256 = "0".repeat(64);
        let series = SeriesSource {
            path: path.into(),
            uid: None,
            name: "a".to_owned(),
            sha256,
            labels: None,
            first_phase: None,
        };
        let (view, group) = ("front".to_owned(), String::new());
        Job {
            job,
            series,
            view,
            group,
            scene: serde_json::json!({}),
            orbit: relief_volume::Orbit::default(),
            products: Vec::new(),
            annotations: None,
        }
    }

    #[test]
    fn a_moved_folder_keeps_its_series() {
        let folder = tempfile::tempdir().unwrap();
        let [old, new] = ["old", "new"].map(|name| folder.path().join(name));
        std::fs::create_dir_all(old.join("archive/head")).unwrap();
        let absolute = old.join("archive/../archive/head");
        let written = job(absolute.to_str().unwrap()).relative_to(&old).unwrap();
        assert_eq!(written.series.path, Path::new("archive/head"));
        std::fs::rename(&old, &new).unwrap();
        let mut found = written.clone().resolved_in(&new).unwrap();
        assert_eq!(found.series.path, new.join("archive/head"));
        assert!(found.missing_paths().is_empty());
        let mut elsewhere = written.resolved_in(folder.path()).unwrap();
        assert_eq!(elsewhere.missing_paths(), [PathBuf::from("archive/head")]);
    }

    #[test]
    fn paths_outside_of_the_folder_are_absolute_and_buckets_stay() {
        let folder = tempfile::tempdir().unwrap();
        let written = job("somewhere/head").relative_to(folder.path()).unwrap();
        assert!(written.series.path.is_absolute() && written.series.path.ends_with("somewhere/head"));
        let place = "s3://bucket/head";
        let kept = job(place).relative_to(folder.path()).unwrap().resolved_in(folder.path()).unwrap();
        assert_eq!(kept.series.path, Path::new(place));
    }
}
