//! The folder of received objects: a folder for each study, in it one for each series.
//!
//! Names are hashes, because UIDs may lead to patients. An object is a whole file on the disk before
//! it is acknowledged, and an object of a known UID never replaces the first one.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use data_encoding::HEXLOWER;
use parking_lot::Mutex;
use relief_base::{write_new, write_whole};
use relief_dicom::{CommitmentRequest, CommitmentResult, INTERRUPTED, file_around, read_identity};
use sha2::{Digest, Sha256};

use super::message::Status;

/// Content of the file that marks an interrupted series.
const INTERRUPTED_TEXT: &[u8] =
    b"The transfer of this series has not ended or was interrupted, so slices may be missing. Send it again: a complete transfer removes this file.\n";
/// Disk space of the smallest file or folder, bytes. The quota counts whole blocks and folders, because
/// many small objects would otherwise use more of the disk than it allows.
const BLOCK: u64 = 4096;
/// Hexadecimal digits of the names of folders and files.
const NAME_DIGITS: usize = 16;

/// A folder that objects are put into.
#[derive(Debug)]
pub struct Inbox {
    folder: PathBuf,
    quota_bytes: u64,
    state: Mutex<State>,
    /// Guards the marks in the folders as well.
    open: Mutex<HashMap<PathBuf, OpenSeries>>,
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

/// The series that one association sends. Dropping it ends the transfer, also when a panic does.
#[derive(Debug)]
pub(super) struct Transfer<'a> {
    inbox: &'a Inbox,
    series: HashMap<PathBuf, TransferredSeries>,
    /// How the association ended; interrupted until it is released.
    pub(super) end: TransferEnd,
}

impl Drop for Transfer<'_> {
    fn drop(&mut self) {
        for (folder, series) in std::mem::take(&mut self.series) {
            let is_whole = series.is_stored && self.end == TransferEnd::Released;
            self.inbox.finish(folder, series.repeated, is_whole);
        }
    }
}

#[derive(Debug)]
struct TransferredSeries {
    /// Interruptions of the series before its first object arrived: this transfer repeats them.
    /// Of later ones, each association carried a part of its own.
    repeated: u64,
    /// Whether all its objects were stored.
    is_stored: bool,
}

/// A series of which at least one transfer has not ended. Its folder has the mark, so that it stays
/// marked when the program is killed.
#[derive(Debug)]
struct OpenSeries {
    transfers: usize,
    /// Transfers that were not whole.
    interruptions: u64,
    /// How many of them a whole transfer has repeated.
    repeated: u64,
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
        Ok(Self { folder: folder.to_owned(), quota_bytes, state, open: Mutex::default() })
    }

    /// Begins the transfer of an association.
    pub(super) fn transfer(&self) -> Transfer<'_> {
        Transfer { inbox: self, series: HashMap::new(), end: TransferEnd::Interrupted }
    }

    /// Stores an object of a transfer; on success it is durable.
    pub(super) fn store(
        &self,
        transfer: &mut Transfer<'_>,
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
        let series = transfer.series.entry(folder.clone());
        let series =
            series.or_insert_with(|| TransferredSeries { repeated: self.begin(&folder), is_stored: true });
        let status = self.write(&folder, &path, &file).unwrap_or_else(|error| {
            tracing::error!("an object cannot be written: {error}");
            Status::OutOfResources
        });
        // Of a duplicate, the first version is stored.
        let is_stored = matches!(status, Status::Success | Status::Duplicate);
        series.is_stored &= is_stored;
        status
    }

    /// Notes a transfer of the series of this folder; returns the interruptions before it.
    fn begin(&self, folder: &Path) -> u64 {
        let mut open = self.open.lock();
        let series = open.entry(folder.to_owned()).or_insert_with(|| OpenSeries {
            transfers: 0,
            interruptions: u64::from(folder.join(INTERRUPTED).exists()),
            repeated: 0,
        });
        series.transfers += 1;
        series.interruptions
    }

    /// Ends a transfer of a series. The mark is removed with the last transfer, unless one was not
    /// whole and none has repeated it since. The series is reported again.
    fn finish(&self, folder: PathBuf, repeated: u64, is_whole: bool) {
        let mut open = self.open.lock();
        let Some(series) = open.get_mut(&folder) else { return };
        series.transfers -= 1;
        if is_whole {
            series.repeated = series.repeated.max(repeated);
        } else {
            series.interruptions += 1;
        }
        let is_incomplete = series.interruptions > series.repeated;
        if series.transfers == 0 {
            open.remove(&folder);
        }
        let is_marked = is_incomplete || open.contains_key(&folder);
        if let Err(error) = mark(&folder, is_marked) {
            tracing::error!("a series cannot be marked as interrupted or whole: {error}");
        }
        drop(open);
        if !is_whole {
            tracing::warn!("the transfer of a series was interrupted; slices may be missing");
        }
        let growing = GrowingSeries { objects: 0, last: Instant::now(), is_committed: false };
        self.state.lock().growing.entry(folder).or_insert(growing);
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
        if let Some(status) = self.compared(path, file)? {
            return Ok(status);
        }
        let is_new = !folder.is_dir();
        // For a new series: its mark, its folder and the folder of the study.
        let needed = on_disk(file.len()) + if is_new { 3 * BLOCK } else { 0 };
        if !self.reserve(needed) {
            tracing::warn!("an object is refused: the quota of {} bytes is used up", self.quota_bytes);
            return Ok(Status::OutOfResources);
        }
        let written = self.prepare(folder).and_then(|()| write_new(path, file));
        let written = written.and_then(|()| sync_folders(folder, if is_new { &self.folder } else { folder }));
        if let Err(error) = written {
            self.release(needed);
            // Another association has stored an object of this UID in the meantime.
            let is_there = error.kind() == std::io::ErrorKind::AlreadyExists;
            return self.compared(path, file)?.filter(|_| is_there).ok_or(error);
        }
        let mut state = self.state.lock();
        let series = state.growing.entry(folder.to_owned());
        let series =
            series.or_insert(GrowingSeries { objects: 0, last: Instant::now(), is_committed: false });
        series.objects += 1;
        series.last = Instant::now();
        series.is_committed = false;
        Ok(Status::Success)
    }

    /// Creates and marks the folder of a series that is being received.
    fn prepare(&self, folder: &Path) -> std::io::Result<()> {
        std::fs::create_dir_all(folder)?;
        let _open = self.open.lock();
        mark(folder, true)
    }

    /// The status of an object whose file exists: success if the bytes are equal. Another association may have
    /// written the file a moment ago, so its folders are synced before it is acknowledged again.
    fn compared(&self, path: &Path, file: &[u8]) -> std::io::Result<Option<Status>> {
        match std::fs::read(path) {
            Ok(known) if known == file => {
                let folder = path.parent().unwrap_or(&self.folder);
                sync_folders(folder, &self.folder).map(|()| Some(Status::Success))
            }
            Ok(_) => Ok(Some(Status::Duplicate)),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }

    fn release(&self, bytes: u64) {
        let mut state = self.state.lock();
        state.bytes = state.bytes.saturating_sub(bytes);
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

/// Sets or removes the mark of a folder. A folder that is missing stays missing.
fn mark(folder: &Path, is_marked: bool) -> std::io::Result<()> {
    let path = folder.join(INTERRUPTED);
    match (is_marked, path.exists()) {
        (true, false) if folder.is_dir() => write_whole(&path, INTERRUPTED_TEXT),
        (false, true) => std::fs::remove_file(&path),
        _ => Ok(()),
    }
}

/// Disk space of a file of this size, bytes.
fn on_disk(bytes: usize) -> u64 {
    (bytes as u64).next_multiple_of(BLOCK)
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
            bytes += BLOCK + bytes_below(&entry.path())?;
        } else if found.is_file() {
            bytes += entry.metadata()?.len().next_multiple_of(BLOCK);
        }
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Invariant: If different objects with the same UID arrive at the same time, one is stored and
    /// acknowledged, and the others are refused as duplicates. Equal objects are all acknowledged and
    /// stored once.
    #[test]
    fn of_objects_of_one_uid_at_once_one_is_acknowledged() {
        let folder = tempfile::tempdir().unwrap();
        let inbox = Inbox::open(folder.path(), 1 << 30).unwrap();
        let series = folder.path().join("study").join("series");
        for round in 0..200 {
            let path = series.join(format!("{round}.dcm"));
            let start = std::sync::Barrier::new(4);
            let statuses: Vec<Status> = std::thread::scope(|scope| {
                // Two associations send equal objects, two send different ones.
                let objects = [0_u8, 0, 1, 2].map(|content| vec![content; 3000]);
                let writers = objects.map(|object| {
                    let (inbox, series, path, start) = (&inbox, &series, &path, &start);
                    scope.spawn(move || {
                        start.wait();
                        inbox.write(series, path, &object).unwrap()
                    })
                });
                writers.into_iter().map(|writer| writer.join().unwrap()).collect()
            });
            let kept = std::fs::read(&path).unwrap()[0];
            let expected =
                [0, 0, 1, 2].map(|content| if content == kept { Status::Success } else { Status::Duplicate });
            assert_eq!(statuses, expected, "round {round}: {kept} is kept");
        }
        // Refused objects do not count against the quota. Folders count for the association that found
        // none, which in the first round may be one that was refused.
        let bytes = inbox.state.lock().bytes;
        assert!((200 * BLOCK..=203 * BLOCK).contains(&bytes), "{bytes}");
    }

    /// A series is marked while it is received, so that a killed program leaves the mark. Of two
    /// parallel associations each carries a part: the end of one does not remove the mark of the other.
    #[test]
    fn only_whole_transfers_and_repetitions_remove_the_mark() {
        let folder = tempfile::tempdir().unwrap();
        let inbox = Inbox::open(folder.path(), 1 << 20).unwrap();
        let series = folder.path().join("study").join("series");
        let is_marked = || series.join(INTERRUPTED).exists();
        let begun = |is_stored: bool| {
            let mut transfer = inbox.transfer();
            let repeated = inbox.begin(&series);
            inbox.prepare(&series).unwrap();
            assert!(is_marked(), "while it is received");
            transfer.series.insert(series.clone(), TransferredSeries { repeated, is_stored });
            transfer
        };
        let is_marked_after = |mut transfer: Transfer<'_>, end: TransferEnd| {
            transfer.end = end;
            drop(transfer);
            let completed = inbox.completed(Duration::ZERO);
            assert!(completed.iter().all(|series| series.is_interrupted == is_marked()));
            is_marked()
        };
        assert!(!is_marked_after(begun(true), TransferEnd::Released));
        let (first, second) = (begun(true), begun(true));
        assert!(is_marked_after(first, TransferEnd::Released), "the other one is still open");
        assert!(!is_marked_after(second, TransferEnd::Released));
        let (first, second) = (begun(true), begun(true));
        assert!(is_marked_after(first, TransferEnd::Interrupted));
        let repetition = begun(true);
        assert!(is_marked_after(second, TransferEnd::Released), "it began before the interruption");
        assert!(is_marked_after(begun(true), TransferEnd::Interrupted));
        assert!(is_marked_after(repetition, TransferEnd::Released), "the later one is not repeated");
        assert!(is_marked_after(begun(false), TransferEnd::Released), "an object was refused");
        let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            let _transfer = begun(true);
            panic!("of the protocol library");
        }));
        assert!(panicked.is_err() && is_marked());
        assert!(!is_marked_after(begun(true), TransferEnd::Released));
    }
}
