//! The folder of copies: which are there, which go.
//!
//! A copy is a folder that is called after the hash of what was listed: `files/`, and `contents.json`, which has their hashes and
//! its lock. One that is being made or removed is called otherwise; what a program that was killed left is removed by the next.

use std::fs::File;
use std::io::{Error, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use rayon::prelude::*;

use crate::batch::files::read_at_most;
use crate::batch::record::Written;
use crate::batch::source::file_sha256;

/// Beginning of the names of those that are being made or removed.
const UNDER_WAY: &str = ".relief-copy-";
const CONTENTS: &str = "contents.json";
const FILES: &str = "files";
/// Largest list of contents that is read, bytes.
const LARGEST: u64 = 64 << 20;

/// A folder of copies.
#[derive(Debug)]
pub(super) struct Shelf {
    folder: PathBuf,
    /// Removes it with this value.
    _temporary: Option<tempfile::TempDir>,
}

/// A copy that could go.
struct Known {
    folder: PathBuf,
    bytes: u64,
    used: SystemTime,
}

impl Shelf {
    pub(super) fn open(folder: Option<&Path>) -> std::io::Result<Self> {
        match folder {
            Some(folder) => {
                std::fs::create_dir_all(folder)?;
                Ok(Self { folder: folder.to_owned(), _temporary: None })
            }
            None => {
                let temporary = tempfile::Builder::new().prefix("relief-copies-").tempdir()?;
                Ok(Self { folder: temporary.path().to_owned(), _temporary: Some(temporary) })
            }
        }
    }

    /// The files of a copy and its lock, if it is there and all that it was; one that is not is removed.
    pub(super) fn find(&self, name: &str, files: usize) -> Option<(PathBuf, File)> {
        let folder = self.folder.join(name);
        let lock = File::open(folder.join(CONTENTS)).ok()?;
        lock.lock_shared().ok()?;
        let written = contents(&folder)?;
        let path = folder.join(FILES);
        let is_sound = |one: &Written| {
            let file = path.join(&one.file);
            std::fs::metadata(&file).is_ok_and(|found| found.len() == one.bytes)
                && file_sha256(&file).is_ok_and(|found| found == one.sha256)
        };
        if written.len() == files && written.par_iter().all(is_sound) {
            // When it was last used; where that cannot be said it goes earlier.
            let _ = lock.set_modified(SystemTime::now());
            return Some((path, lock));
        }
        tracing::warn!("a copy of a series in a bucket was altered, and is fetched again");
        drop(lock);
        self.remove(&folder);
        None
    }

    /// Makes a copy of what `fetch` puts into a folder. It is there when all of it is.
    pub(super) fn add(
        &self,
        name: &str,
        fetch: impl FnOnce(&Path) -> std::io::Result<Vec<Written>>,
    ) -> std::io::Result<(PathBuf, File)> {
        let made = tempfile::Builder::new().prefix(UNDER_WAY).tempdir_in(&self.folder)?;
        let mut lock = File::create_new(made.path().join(CONTENTS))?;
        lock.lock()?; // nobody takes it for a remnant
        std::fs::create_dir(made.path().join(FILES))?;
        let written = fetch(&made.path().join(FILES))?;
        lock.write_all(&serde_json::to_vec(&written)?)?;
        let folder = self.folder.join(name);
        match std::fs::rename(made.path(), &folder) {
            Ok(()) => drop(made.keep()),
            // Another program has made it meanwhile.
            Err(error) => {
                return self.find(name, written.len()).ok_or(error);
            }
        }
        lock.lock_shared()?;
        Ok((folder.join(FILES), lock))
    }

    /// Lets copies go that nobody reads until so many bytes have room, those not used for the longest first.
    pub(super) fn make_room(&self, needed: u64, allowed: u64) -> std::io::Result<()> {
        let mut known = self.known()?;
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

    /// What is there; remnants of programs that were killed are removed.
    fn known(&self) -> std::io::Result<Vec<Known>> {
        let mut known = Vec::new();
        for entry in std::fs::read_dir(&self.folder)? {
            let folder = entry?.path();
            let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if name.starts_with(UNDER_WAY) {
                self.remove(&folder);
                continue;
            }
            // Others may keep other things here.
            let is_copy = name.len() == 64 && name.bytes().all(|digit| digit.is_ascii_hexdigit());
            if let Some(written) = is_copy.then(|| contents(&folder)).flatten() {
                let bytes = written.iter().map(|one| one.bytes).sum();
                let used = std::fs::metadata(folder.join(CONTENTS)).and_then(|found| found.modified());
                known.push(Known { folder, bytes, used: used.unwrap_or(SystemTime::UNIX_EPOCH) });
            }
        }
        Ok(known)
    }

    /// Removes a copy, or what is left of one, unless it is in use; whether it did.
    fn remove(&self, folder: &Path) -> bool {
        let Ok(lock) = File::open(folder.join(CONTENTS)) else { return false };
        if lock.try_lock().is_err() {
            return false;
        }
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let gone = self.folder.join(format!("{UNDER_WAY}{}-{}", std::process::id(), since.as_nanos()));
        // First it is no copy any more, then it is gone.
        std::fs::rename(folder, &gone).and_then(|()| std::fs::remove_dir_all(&gone)).is_ok()
    }
}

/// The files of a copy, by its list.
fn contents(folder: &Path) -> Option<Vec<Written>> {
    let bytes = read_at_most(&folder.join(CONTENTS), LARGEST).ok().flatten()?;
    let written: Vec<Written> = serde_json::from_slice(&bytes).ok()?;
    // Names are this program's own: numbers and endings.
    let is_name = |one: &Written| Path::new(&one.file).file_name() == Some(one.file.as_ref());
    written.iter().all(is_name).then_some(written)
}
