//! The folder of received objects: a folder for each study, in it one for each series.
//!
//! Names are hashes, because UIDs may lead to patients. An object is a whole file on the disk before
//! it is acknowledged, and an object of a known UID never replaces the first one.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use data_encoding::HEXLOWER;
use parking_lot::Mutex;
use relief_base::write_whole;
use relief_dicom::{CommitmentRequest, CommitmentResult, INTERRUPTED, file_around, read_identity};
use sha2::{Digest, Sha256};

use super::message::Status;

/// Content of the file that marks an interrupted series.
const INTERRUPTED_TEXT: &[u8] =
    b"The transfer of this series was interrupted, so slices may be missing. Send it again: a complete transfer removes this file.\n";
/// Hexadecimal digits of the names of folders and files.
const NAME_DIGITS: usize = 16;

/// A folder that objects are put into.
#[derive(Debug)]
pub struct Inbox {
    folder: PathBuf,
    quota_bytes: u64,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    bytes: u64,
    growing: HashMap<PathBuf, GrowingSeries>,
}

#[derive(Debug)]
struct GrowingSeries {
    objects: usize,
    last: Instant,
    /// Whether its sender asked whether it is kept: it is complete.
    is_committed: bool,
}

/// The series of one association, by their folders.
#[derive(Debug, Default)]
pub(super) struct Transfer {
    series: HashMap<PathBuf, TransferredSeries>,
}

#[derive(Debug)]
struct TransferredSeries {
    /// Whether the series was marked as interrupted before its first object arrived, so that this
    /// transfer repeats the interrupted one. Otherwise two associations each carry a part.
    repeats: bool,
    /// Whether all its objects were stored.
    is_stored: bool,
}

/// How an association ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TransferEnd {
    /// The sender released it: it has sent everything.
    Released,
    /// It was aborted, or the connection broke.
    Interrupted,
}

/// A series that has received no objects for a while.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CompletedSeries {
    /// Its folder.
    pub folder: PathBuf,
    /// Number of objects that arrived since it was reported last.
    pub objects: usize,
    /// Whether its transfer was interrupted or objects were refused: slices may be missing.
    pub is_interrupted: bool,
}

impl Inbox {
    /// Opens or creates a folder whose files may have so many bytes together.
    ///
    /// # Errors
    /// When it cannot be read or created.
    pub fn open(folder: &Path, quota_bytes: u64) -> std::io::Result<Self> {
        std::fs::create_dir_all(folder)?;
        let bytes = bytes_below(folder)?;
        let state = Mutex::new(State { bytes, growing: HashMap::new() });
        Ok(Self { folder: folder.to_owned(), quota_bytes, state })
    }

    /// Stores an object of a transfer; on success it is durable.
    pub(super) fn store(
        &self,
        transfer: &mut Transfer,
        [sop_class, sop_instance, syntax]: [&str; 3],
        data_set: &[u8],
    ) -> Status {
        let Ok(file) = file_around(sop_class, sop_instance, syntax, data_set) else {
            return Status::CannotUnderstand;
        };
        let identity = match read_identity(&file) {
            Ok(identity) => identity,
            Err(error) => {
                tracing::warn!("an object is refused: {error}");
                return Status::CannotUnderstand;
            }
        };
        if identity.sop_instance != sop_instance || identity.sop_class != sop_class {
            return Status::Mismatch;
        }
        let folder = self.folder.join(name_of(&identity.study)).join(name_of(&identity.series));
        let path = folder.join(name_of(sop_instance) + ".dcm");
        let repeats = || folder.join(INTERRUPTED).exists();
        let series = transfer.series.entry(folder.clone());
        let series = series.or_insert_with(|| TransferredSeries { repeats: repeats(), is_stored: true });
        let status = self.write(&folder, &path, &file).unwrap_or_else(|error| {
            tracing::error!("an object cannot be written: {error}");
            Status::OutOfResources
        });
        // Of a duplicate, the first version is stored.
        let is_stored = matches!(status, Status::Success | Status::Duplicate);
        series.is_stored &= is_stored;
        status
    }

    /// Ends a transfer: marks the series that it left incomplete, and removes the mark of those that
    /// it repeated completely. Both are reported again.
    pub(super) fn finish(&self, transfer: Transfer, end: TransferEnd) {
        for (folder, TransferredSeries { repeats, is_stored }) in transfer.series {
            let is_whole = is_stored && end == TransferEnd::Released;
            let mark = folder.join(INTERRUPTED);
            let marked = match (is_whole, mark.exists()) {
                (true, true) if repeats => std::fs::remove_file(&mark),
                (false, false) if folder.is_dir() => write_whole(&mark, INTERRUPTED_TEXT),
                _ => continue,
            };
            if let Err(error) = marked {
                tracing::error!("a series cannot be marked as interrupted or whole: {error}");
            }
            if !is_whole {
                tracing::warn!("the transfer of a series was interrupted; slices may be missing");
            }
            let growing = GrowingSeries { objects: 0, last: Instant::now(), is_committed: false };
            self.state.lock().growing.entry(folder).or_insert(growing);
        }
    }

    /// The objects that are kept: whole files, which stay. Series of them are complete.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub(super) fn commit(&self, request: CommitmentRequest) -> std::io::Result<CommitmentResult> {
        let wanted: HashSet<String> =
            request.objects.iter().map(|object| name_of(&object.sop_instance) + ".dcm").collect();
        let (mut kept, mut folders) = (HashSet::new(), HashSet::new());
        for study in folders_in(&self.folder)? {
            for series in folders_in(&study)? {
                for entry in std::fs::read_dir(&series)? {
                    let name = entry?.file_name().to_string_lossy().into_owned();
                    if wanted.contains(&name) {
                        kept.insert(name);
                        folders.insert(series.clone());
                    }
                }
            }
        }
        let is_kept = |sop_instance: &str| kept.contains(&(name_of(sop_instance) + ".dcm"));
        let (committed, missing) =
            request.objects.into_iter().partition(|object| is_kept(&object.sop_instance));
        let mut state = self.state.lock();
        for (_, series) in state.growing.iter_mut().filter(|(folder, _)| folders.contains(*folder)) {
            series.is_committed = true;
        }
        Ok(CommitmentResult { transaction: request.transaction, committed, missing })
    }

    fn write(&self, folder: &Path, path: &Path, file: &[u8]) -> std::io::Result<Status> {
        if let Ok(known) = std::fs::read(path) {
            return Ok(if known == file { Status::Success } else { Status::Duplicate });
        }
        if !self.reserve(file.len() as u64) {
            tracing::warn!("an object is refused: the quota of {} bytes is used up", self.quota_bytes);
            return Ok(Status::OutOfResources);
        }
        let is_new = !folder.is_dir();
        let written = std::fs::create_dir_all(folder).and_then(|()| write_whole(path, file));
        let written = written.and_then(|()| sync_folders(folder, if is_new { &self.folder } else { folder }));
        let mut state = self.state.lock();
        if let Err(error) = written {
            state.bytes = state.bytes.saturating_sub(file.len() as u64);
            return Err(error);
        }
        let series = state.growing.entry(folder.to_owned());
        let series =
            series.or_insert(GrowingSeries { objects: 0, last: Instant::now(), is_committed: false });
        series.objects += 1;
        series.last = Instant::now();
        series.is_committed = false;
        Ok(Status::Success)
    }

    fn reserve(&self, bytes: u64) -> bool {
        let mut state = self.state.lock();
        let has_room = state.bytes.saturating_add(bytes) <= self.quota_bytes;
        state.bytes += if has_room { bytes } else { 0 };
        has_room
    }

    /// The series of which nothing has arrived for so long, or which were committed; each is reported
    /// once until more arrives.
    pub fn completed(&self, quiet: Duration) -> Vec<CompletedSeries> {
        let mut state = self.state.lock();
        let mut completed = Vec::new();
        state.growing.retain(|folder, series| {
            let is_quiet = series.is_committed || series.last.elapsed() >= quiet;
            if is_quiet {
                completed.push((folder.clone(), series.objects));
            }
            !is_quiet
        });
        drop(state); // no file is looked at under the lock
        completed.sort();
        let described = |(folder, objects): (PathBuf, usize)| {
            let is_interrupted = folder.join(INTERRUPTED).exists();
            CompletedSeries { folder, objects, is_interrupted }
        };
        completed.into_iter().map(described).collect()
    }
}

fn name_of(uid: &str) -> String {
    let mut name = HEXLOWER.encode(&Sha256::digest(uid));
    name.truncate(NAME_DIGITS);
    name
}

/// A file is durable when its folder is, and where that is new those above, up to `last`.
fn sync_folders(folder: &Path, last: &Path) -> std::io::Result<()> {
    for folder in folder.ancestors().take_while(|folder| folder.starts_with(last)) {
        std::fs::File::open(folder)?.sync_all()?;
    }
    Ok(())
}

fn folders_in(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut folders = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            folders.push(entry.path());
        }
    }
    Ok(folders)
}

fn bytes_below(folder: &Path) -> std::io::Result<u64> {
    let mut bytes = 0;
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let found = entry.file_type()?;
        if found.is_dir() {
            bytes += bytes_below(&entry.path())?;
        } else if found.is_file() {
            bytes += entry.metadata()?.len();
        }
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// If one of two parallel associations is interrupted, the end of the other one does not remove the
    /// mark: each carries a part of the series.
    #[test]
    fn only_a_repetition_removes_the_mark_of_an_interrupted_transfer() {
        let folder = tempfile::tempdir().unwrap();
        let inbox = Inbox::open(folder.path(), 1 << 20).unwrap();
        let series = folder.path().join("study").join("series");
        std::fs::create_dir_all(&series).unwrap();
        let is_marked_after = |repeats: bool, is_stored: bool, end: TransferEnd| {
            let known = TransferredSeries { repeats, is_stored };
            inbox.finish(Transfer { series: HashMap::from([(series.clone(), known)]) }, end);
            let completed = inbox.completed(Duration::ZERO);
            let is_marked = series.join(INTERRUPTED).exists();
            assert!(completed.iter().all(|series| series.is_interrupted == is_marked));
            is_marked
        };
        assert!(!is_marked_after(false, true, TransferEnd::Released));
        assert!(is_marked_after(false, true, TransferEnd::Interrupted));
        assert!(is_marked_after(false, true, TransferEnd::Released), "it began before the interruption");
        assert!(is_marked_after(true, true, TransferEnd::Interrupted));
        assert!(is_marked_after(true, false, TransferEnd::Released), "an object was refused");
        assert!(!is_marked_after(true, true, TransferEnd::Released));
    }
}
