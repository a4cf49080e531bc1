//! The folder of copies: inventory, creation, removal.
//!
//! A copy is a folder named after the hash of its listing. It has `files/`, and `contents.json`
//! with their hashes, which readers lock. A copy in the making and one in removal have other names;
//! the next program removes those that a killed program left, except parts of a copy that can be
//! completed: they are kept until their room is needed. A program that makes or removes copies
//! holds the lock of the folder, so that all programs together keep within its size. Reading needs
//! no such lock.

use std::fs::File;
use std::io::{Error, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use parking_lot::Mutex;
use rayon::prelude::*;
use tempfile::TempDir;

use crate::output_file::OutputFile;
use relief_base::read_at_most;
use relief_base::sha256_of_file;

/// Beginning of the names of those that are being made or removed.
const UNDER_WAY: &str = ".relief-copy-";
/// Beginning of the names of those that a later fetch completes.
const INCOMPLETE: &str = ".relief-part-";
/// Bytes by which a growing copy reserves room.
const STEP: u64 = 32 << 20;
/// The lock of the folder.
const KEEPER: &str = ".relief-lock";
/// The lock of a temporary folder, held as long as its program runs.
const ALIVE: &str = ".relief-alive";
const TEMPORARY: &str = "relief-copies-";
const CONTENTS: &str = "contents.json";
const FILES: &str = "files";
/// Largest list of contents that is read, bytes.
const LARGEST: u64 = 64 << 20;

/// A folder of copies.
#[derive(Debug)]
pub(super) struct CopyFolder {
    folder: PathBuf,
    /// Removes it when dropped, and marks it as used until then.
    temporary: Option<(TempDir, File)>,
    /// Held while a copy is made. Two at the same time could exceed the limit of bytes together.
    making: Mutex<()>,
}

/// A copy that is to be made.
#[derive(Debug)]
pub(super) struct WantedCopy<'a> {
    /// The hash of its listing.
    pub(super) name: &'a str,
    /// Number of its files.
    pub(super) files: usize,
    /// Bytes that all copies together may have.
    pub(super) allowed: u64,
    /// Whether a later fetch completes what an interrupted one left.
    pub(super) resumes: bool,
}

/// A copy in the making.
#[derive(Debug)]
pub(super) struct Draft<'a> {
    shelf: &'a CopyFolder,
    wanted: &'a WantedCopy<'a>,
    /// Becomes the copy.
    made: PathBuf,
    /// Of its files.
    folder: PathBuf,
    reserved: Mutex<u64>,
}

/// A copy that could go.
struct KnownCopy {
    folder: PathBuf,
    bytes: u64,
    used: SystemTime,
}

impl CopyFolder {
    pub(super) fn open(folder: Option<&Path>) -> std::io::Result<Self> {
        match folder {
            Some(folder) => {
                std::fs::create_dir_all(folder)?;
                Ok(Self { folder: folder.to_owned(), temporary: None, making: Mutex::default() })
            }
            None => {
                remove_abandoned();
                let temporary = tempfile::Builder::new().prefix(TEMPORARY).tempdir()?;
                let alive = File::create_new(temporary.path().join(ALIVE))?;
                alive.lock()?;
                let folder = temporary.path().to_owned();
                Ok(Self { folder, temporary: Some((temporary, alive)), making: Mutex::default() })
            }
        }
    }

    /// The files of a copy and its lock, if the copy exists and is intact.
    fn find(&self, name: &str, files: usize) -> Option<(PathBuf, File)> {
        let folder = self.folder.join(name);
        let lock = File::open(folder.join(CONTENTS)).ok()?;
        lock.lock_shared().ok()?;
        // While it waited for its lock the copy may have gone and come again.
        let is_its_own = same_file::Handle::from_file(lock.try_clone().ok()?).ok()?
            == same_file::Handle::from_path(folder.join(CONTENTS)).ok()?;
        let written = contents(&folder).filter(|_| is_its_own)?;
        let path = folder.join(FILES);
        let is_sound = |one: &OutputFile| {
            let file = path.join(&one.file);
            std::fs::metadata(&file).is_ok_and(|found| found.len() == one.bytes)
                && sha256_of_file(&file).is_ok_and(|found| found == one.sha256)
        };
        if written.len() == files && written.par_iter().all(is_sound) {
            // Time of the last use; a copy without a known time is removed earlier.
            let _ = lock.set_modified(SystemTime::now());
            return Some((path, lock));
        }
        None
    }

    /// The files of a copy and its lock; it is created if it does not exist.
    pub(super) fn find_or_add(
        &self,
        wanted: &WantedCopy<'_>,
        fetch: impl FnOnce(&Draft<'_>) -> std::io::Result<Vec<OutputFile>>,
    ) -> std::io::Result<(PathBuf, File)> {
        match self.find(wanted.name, wanted.files) {
            Some(found) => Ok(found),
            None => {
                let _making = self.making.lock();
                self.add(wanted, fetch)
            }
        }
    }

    /// Creates a copy, which `fetch` puts into a folder. It appears when it is complete. A copy that
    /// another program has created meanwhile is used; a damaged one is replaced.
    fn add(
        &self,
        wanted: &WantedCopy<'_>,
        fetch: impl FnOnce(&Draft<'_>) -> std::io::Result<Vec<OutputFile>>,
    ) -> std::io::Result<(PathBuf, File)> {
        std::fs::create_dir_all(&self.folder)?; // it may have been cleared away
        let keeper = File::create(self.folder.join(KEEPER))?;
        keeper.lock()?;
        if let Some(found) = self.find(wanted.name, wanted.files) {
            return Ok(found);
        }
        let folder = self.folder.join(wanted.name);
        if self.remove(&folder) {
            tracing::warn!("the copy of a series was altered, and is fetched again");
        }
        let (made, _temporary) = self.draft_folder(wanted)?;
        std::fs::create_dir_all(made.join(FILES))?;
        let draft = Draft {
            shelf: self,
            wanted,
            made: made.clone(),
            folder: made.join(FILES),
            reserved: Mutex::new(0),
        };
        let written = fetch(&draft)?;
        let mut lock = File::create(made.join(CONTENTS))?;
        lock.write_all(&serde_json::to_vec(&written)?)?;
        // No later program uses a temporary copy.
        if self.temporary.is_none() {
            lock.sync_all()?;
        }
        lock.lock_shared()?;
        std::fs::rename(&made, &folder)?;
        Ok((folder.join(FILES), lock))
    }

    /// The folder where a copy is made, removed when dropped. A copy that cannot be completed later
    /// gets a new folder.
    fn draft_folder(&self, wanted: &WantedCopy<'_>) -> std::io::Result<(PathBuf, Option<TempDir>)> {
        if wanted.resumes {
            return Ok((self.folder.join(format!("{INCOMPLETE}{}", wanted.name)), None));
        }
        let made = tempfile::Builder::new().prefix(UNDER_WAY).tempdir_in(&self.folder)?;
        Ok((made.path().to_owned(), Some(made)))
    }

    /// Removes unused copies, least recently used first, until this many bytes are free for the one
    /// that is made in the folder `own`. Needs the folder's lock.
    fn make_room(&self, own: &Path, needed: u64, allowed: u64) -> std::io::Result<()> {
        let mut known = self.known(own)?;
        known.sort_by_key(|copy| copy.used);
        let mut used = known.iter().fold(0u64, |sum, copy| sum.saturating_add(copy.bytes));
        for copy in &known {
            if used.saturating_add(needed) <= allowed {
                return Ok(());
            }
            if self.remove(&copy.folder) {
                used = used.saturating_sub(copy.bytes);
            }
        }
        if used.saturating_add(needed) <= allowed {
            return Ok(());
        }
        let reason = format!(
            "{needed} bytes are wanted, and {used} of the {allowed} that copies of series may have are being read; \
             allow more with --cache-bytes"
        );
        Err(Error::new(ErrorKind::StorageFull, reason))
    }

    /// The copies in the folder but `own`. Removes remnants of killed programs, and copies without a list of
    /// contents.
    fn known(&self, own: &Path) -> std::io::Result<Vec<KnownCopy>> {
        let mut known = Vec::new();
        for entry in std::fs::read_dir(&self.folder)? {
            let folder = entry?.path();
            if folder == own {
                continue;
            }
            let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if name.starts_with(UNDER_WAY) {
                // No other program creates or removes copies now.
                let _ = std::fs::remove_dir_all(&folder);
                continue;
            }
            if name.starts_with(INCOMPLETE) {
                known.push(incomplete(folder));
                continue;
            }
            // Others may keep other things here.
            let is_copy = name.len() == 64 && name.bytes().all(|digit| digit.is_ascii_hexdigit());
            if !is_copy {
                continue;
            }
            let Some(written) = contents(&folder) else {
                self.remove(&folder);
                continue;
            };
            let bytes = written.iter().map(|one| one.bytes).sum();
            let used = std::fs::metadata(folder.join(CONTENTS)).and_then(|found| found.modified());
            known.push(KnownCopy { folder, bytes, used: used.unwrap_or(SystemTime::UNIX_EPOCH) });
        }
        Ok(known)
    }

    /// Removes a copy or its remnants, unless it is in use; returns whether it did. Needs the
    /// folder's lock.
    fn remove(&self, folder: &Path) -> bool {
        let is_in_use = match File::open(folder.join(CONTENTS)) {
            Ok(lock) => lock.try_lock().is_err(),
            Err(error) => error.kind() != ErrorKind::NotFound,
        };
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let gone = self.folder.join(format!("{UNDER_WAY}{}-{}", std::process::id(), since.as_nanos()));
        // It loses its name first; then its files are removed.
        !is_in_use && std::fs::rename(folder, &gone).and_then(|()| std::fs::remove_dir_all(&gone)).is_ok()
    }
}

impl Draft<'_> {
    /// The folder that the files go into.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Makes room for a copy of this size; as the copy grows, it may be called again.
    pub(super) fn reserve(&self, bytes: u64) -> std::io::Result<()> {
        let mut reserved = self.reserved.lock();
        if bytes <= *reserved {
            return Ok(());
        }
        let allowed = self.wanted.allowed;
        if bytes > allowed {
            let reason = format!(
                "it has {bytes} bytes or more, and copies of series may have {allowed}; allow more with --cache-bytes"
            );
            return Err(Error::new(ErrorKind::InvalidInput, reason));
        }
        // In steps, because the folder is read each time.
        let wanted = if *reserved == 0 { bytes } else { allowed.min(bytes + STEP) };
        self.shelf.make_room(&self.made, wanted, allowed)?;
        *reserved = wanted;
        Ok(())
    }
}

/// An incomplete copy that a program left, and that can be completed.
fn incomplete(folder: PathBuf) -> KnownCopy {
    let files = std::fs::read_dir(folder.join(FILES)).into_iter().flatten().flatten();
    let sizes = files.filter_map(|file| file.metadata().ok()).map(|found| found.len());
    let bytes = sizes.fold(0, u64::saturating_add);
    let used = std::fs::metadata(folder.join(FILES)).and_then(|found| found.modified());
    KnownCopy { bytes, used: used.unwrap_or(SystemTime::UNIX_EPOCH), folder }
}

/// Removes temporary folders of programs that were killed.
fn remove_abandoned() {
    let Ok(entries) = std::fs::read_dir(std::env::temp_dir()) else { return };
    for entry in entries.flatten() {
        let folder = entry.path();
        if !entry.file_name().to_string_lossy().starts_with(TEMPORARY) {
            continue;
        }
        // Those of other users cannot be opened, or not be removed.
        if File::open(folder.join(ALIVE)).is_ok_and(|alive| alive.try_lock().is_ok()) {
            let _ = std::fs::remove_dir_all(&folder);
        }
    }
}

/// The files of a copy, by its list.
fn contents(folder: &Path) -> Option<Vec<OutputFile>> {
    let bytes = read_at_most(&folder.join(CONTENTS), LARGEST).ok().flatten()?;
    let written: Vec<OutputFile> = serde_json::from_slice(&bytes).ok()?;
    // Names are this program's own: numbers and endings.
    let is_name = |one: &OutputFile| Path::new(&one.file).file_name() == Some(one.file.as_ref());
    written.iter().all(is_name).then_some(written)
}
