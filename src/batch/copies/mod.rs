//! Series that lie in buckets and archives, as copies in a folder of this machine: of bounded size,
//! each whole or absent.
//!
//! A copy is identified by its listing: names, sizes and tags of its objects, or the UIDs of its
//! instances. It is verified by the
//! hashes of its files at every use, and fetched again if it has changed; the least recently used
//! copies are removed first. Several programs may share a folder: readers hold a lock on a copy.
//!
//! Files of a copy are numbered: what objects are called may name patients.

#[cfg(feature = "buckets")]
mod fetched;
#[cfg(feature = "archives")]
mod retrieved;
#[cfg(any(feature = "archives", feature = "buckets"))]
mod shelf;
#[cfg(any(feature = "archives", feature = "buckets"))]
mod state;

use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::isolation::IsolatedReader;
use super::location::Location;

/// How copies are kept.
#[derive(Clone, Debug, Default)]
pub struct CopiesOptions {
    /// Where; a temporary folder that goes with the last user of these copies where none is named.
    pub folder: Option<PathBuf>,
    /// Bytes that all copies together may have.
    pub bytes: u64,
    /// Address of the S3 service, before the environment's.
    pub endpoint: Option<String>,
    /// The places below which series may be, for paths that others name; anywhere if empty.
    pub roots: Vec<Location>,
    /// Reads copies in child processes; this process reads them if absent.
    pub isolated: Option<IsolatedReader>,
    /// The credentials for archives.
    #[cfg(feature = "archives")]
    pub archives: relief_archive::ArchiveAccess,
    /// Is notified while a series of an archive is retrieved.
    pub progress: CopyProgress,
}

/// The id of the patient whose series is retrieved, if it is known. `Debug` withholds it.
#[derive(Clone, Default)]
struct PatientId(Option<String>);

impl std::fmt::Debug for PatientId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("PatientId").field(&self.0.is_some()).finish()
    }
}

/// Is notified of the number of files that have arrived, and of all.
#[derive(Clone, Default)]
pub struct CopyProgress(Option<Arc<dyn Fn(usize, usize) + Send + Sync>>);

/// Copies of series in buckets and archives.
#[derive(Clone, Debug)]
pub struct Copies {
    options: CopiesOptions,
    patient_id: PatientId,
    #[cfg(any(feature = "archives", feature = "buckets"))]
    state: Arc<parking_lot::Mutex<state::State>>,
}

/// Files of this machine: a series' own, or a copy that stays while this lives.
#[derive(Clone, Debug)]
pub struct Local {
    path: PathBuf,
    /// The lock of a copy.
    held: Option<Arc<std::fs::File>>,
    isolated: Option<IsolatedReader>,
}

impl CopyProgress {
    /// Calls `notify` with the number of files that have arrived, and of all.
    pub fn new(notify: impl Fn(usize, usize) + Send + Sync + 'static) -> Self {
        Self(Some(Arc::new(notify)))
    }

    #[cfg(feature = "archives")]
    fn report(&self, done: usize, all: usize) {
        self.0.iter().for_each(|notify| notify(done, all));
    }
}

impl std::fmt::Debug for CopyProgress {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("CopyProgress").field(&self.0.is_some()).finish()
    }
}

impl Local {
    /// A folder or a file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The reader of the files if this process must not read them: copies are not trusted.
    pub(crate) fn isolated(&self) -> Option<&IsolatedReader> {
        self.isolated.as_ref().filter(|_| self.held.is_some())
    }
}

impl Copies {
    /// None yet. The first use of a bucket creates it.
    #[must_use]
    pub fn new(options: CopiesOptions) -> Self {
        Self {
            options,
            patient_id: PatientId::default(),
            #[cfg(any(feature = "archives", feature = "buckets"))]
            state: Arc::default(),
        }
    }

    /// The same copies, which notify another one of the progress of retrievals.
    #[must_use]
    pub fn with_progress(&self, progress: CopyProgress) -> Self {
        Self { options: CopiesOptions { progress, ..self.options.clone() }, ..self.clone() }
    }

    /// The same copies, for series of this patient: instances of another patient are refused.
    #[must_use]
    pub fn of_patient(&self, id: &str) -> Self {
        Self { patient_id: PatientId(Some(id.to_owned())), ..self.clone() }
    }

    /// The files that a path leads to: itself; where it is `s3://BUCKET/KEY`, a copy of the object
    /// or of all that lies below; where it is the address of an archive, a copy of its series. Must
    /// not be called inside an executor.
    ///
    /// # Errors
    /// When there is nothing, or more than copies may have; the service does not answer or refuses;
    /// the folder cannot be written.
    pub fn local(&self, path: &Path) -> std::io::Result<Local> {
        let location = location(path)?;
        if !self.options.roots.is_empty() && !is_below(&location, &self.options.roots)? {
            let reason = "it is not below a --root of this worker";
            return Err(Error::new(ErrorKind::InvalidInput, reason));
        }
        match location {
            Location::Local(path) => Ok(Local { path, held: None, isolated: None }),
            #[cfg(feature = "buckets")]
            Location::Bucket { bucket, prefix } => self.copy(&bucket, &prefix),
            #[cfg(not(feature = "buckets"))]
            Location::Bucket { .. } => Err(lacks("buckets")),
            #[cfg(feature = "archives")]
            Location::Archive(address) => self.retrieve(&address),
            #[cfg(not(feature = "archives"))]
            Location::Archive(_) => Err(lacks("archives")),
        }
    }

    /// The places below a prefix of a bucket that may contain series: every folder, zip and volume
    /// file directly below it; or the prefix itself, if it is one object or contains slices
    /// directly. Sorted by name. Of an archive, the addresses of the series that match.
    ///
    /// # Errors
    /// When there is nothing, or the service does not answer or refuses.
    pub fn places(&self, root: &Path) -> std::io::Result<Vec<PathBuf>> {
        match location(root)? {
            Location::Local(path) => Ok(vec![path]),
            #[cfg(feature = "buckets")]
            Location::Bucket { bucket, prefix } => self.places_in(&bucket, &prefix),
            #[cfg(not(feature = "buckets"))]
            Location::Bucket { .. } => Err(lacks("buckets")),
            #[cfg(feature = "archives")]
            Location::Archive(address) => self.places_in_archive(&address),
            #[cfg(not(feature = "archives"))]
            Location::Archive(_) => Err(lacks("archives")),
        }
    }
}

/// Whether a location is one of the roots or below one. Links are followed: what they lead to
/// counts.
fn is_below(location: &Location, roots: &[Location]) -> std::io::Result<bool> {
    match location {
        Location::Local(path) => {
            let path = path.canonicalize()?;
            let is_in = |root: &Location| match root {
                Location::Local(root) => root.canonicalize().is_ok_and(|root| path.starts_with(root)),
                Location::Bucket { .. } | Location::Archive(_) => false,
            };
            Ok(roots.iter().any(is_in))
        }
        Location::Bucket { bucket, prefix } => {
            let is_in = |root: &Location| match root {
                Location::Bucket { bucket: name, prefix: root } => {
                    let rest = prefix.strip_prefix(root.as_str());
                    let is_whole =
                        root.is_empty() || rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('/'));
                    name == bucket && rest.is_some() && is_whole
                }
                Location::Local(_) | Location::Archive(_) => false,
            };
            Ok(roots.iter().any(is_in))
        }
        Location::Archive(address) => {
            let is_in = |root: &Location| matches!(root, Location::Archive(root) if root.contains(address));
            Ok(roots.iter().any(is_in))
        }
    }
}

fn location(path: &Path) -> std::io::Result<Location> {
    Location::of(path).map_err(|reason| Error::new(ErrorKind::InvalidInput, reason))
}

#[cfg(not(all(feature = "archives", feature = "buckets")))]
fn lacks(feature: &str) -> Error {
    let reason = format!("this build does not read {feature}: build relief with --features {feature}");
    Error::new(ErrorKind::InvalidInput, reason)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_that_leaves_its_root_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let [root, other] = ["root", "other"].map(|name| folder.path().join(name));
        for made in [&root, &other, &root.join("series")] {
            std::fs::create_dir(made).unwrap();
        }
        std::os::unix::fs::symlink(&other, root.join("link")).unwrap();
        let roots = [Location::Local(root.clone()), "s3://archive/ct".parse().unwrap()];
        let is_in = |path: &Path| is_below(&Location::of(path).unwrap(), &roots).unwrap();
        assert!(is_in(&root) && is_in(&root.join("series")));
        assert!(!is_in(&other) && !is_in(&root.join("link")) && !is_in(&root.join("../other")));
        assert!(is_in(Path::new("s3://archive/ct/one")) && is_in(Path::new("s3://archive/ct")));
        assert!(!is_in(Path::new("s3://archive/ctx")) && !is_in(Path::new("s3://other/ct/one")));
        let options = CopiesOptions { roots: roots.to_vec(), ..CopiesOptions::default() };
        let refused = Copies::new(options).local(&other).unwrap_err();
        assert_eq!(refused.kind(), ErrorKind::InvalidInput);
    }
}
