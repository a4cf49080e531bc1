//! The thread that writes records in their order and repeats failed writes.

use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::Receiver;
use std::time::Duration;

use parking_lot::Mutex;

use super::record::{FIRST, Record, parse};
use super::{AuditError, WAITING};
use relief_base::FileId;

/// Longest line.
pub(super) const MOST_LINE_BYTES: u64 = 4096;
/// Pause between two attempts to write.
const PAUSE: Duration = Duration::from_secs(1);

/// Commands for the thread.
#[derive(Debug)]
pub(super) enum Message {
    /// Write a record.
    Record(Box<Record>),
    /// Check that the file is at its path, and create it if it is missing.
    Look,
}

/// State that the thread and the server share.
#[derive(Debug, Default)]
pub(super) struct Health {
    path: PathBuf,
    has_failed: AtomicBool,
    /// Whether the failure was reported.
    is_reported: AtomicBool,
    is_closing: AtomicBool,
    /// Records that did not fit into the queue.
    lost: AtomicU64,
    file: Mutex<Option<FileId>>,
}

impl Health {
    pub(super) fn is_good(&self) -> bool {
        !self.has_failed.load(Ordering::Relaxed)
    }

    pub(super) fn failed(&self) {
        self.has_failed.store(true, Ordering::Relaxed);
    }

    pub(super) fn lost_one(&self) {
        self.lost.fetch_add(1, Ordering::Relaxed);
        self.failed();
    }

    pub(super) fn close(&self) {
        self.is_closing.store(true, Ordering::Relaxed);
    }

    /// Whether the file that is written is at its path.
    pub(super) fn file_is_there(&self) -> bool {
        let there = FileId::at(&self.path);
        there.is_some() && there == *self.file.lock()
    }
}

/// The file, and the end of its chain.
pub(super) struct Writer {
    health: Arc<Health>,
    file: File,
    /// Bytes of the file after the last successful write.
    length: u64,
    /// Hash of the newest record.
    head: String,
    /// Whether the file ends with a line that was cut off.
    torn: bool,
    /// Whether the newest record is in another file.
    continues: bool,
    /// Whether a failed write may have left an incomplete line.
    has_partial: bool,
}

impl Writer {
    /// Opens the file, or creates it.
    pub(super) fn open(path: &Path) -> Result<(Self, Arc<Health>), AuditError> {
        let failure = |source| AuditError::File { path: path.to_owned(), source };
        let mut file = opened(path)?;
        let End { head, torn } = end_of(&mut file, path)?;
        let metadata = file.metadata().map_err(failure)?;
        let health = Arc::new(Health {
            path: path.to_owned(),
            file: Mutex::new(Some(FileId::of(&metadata))),
            ..Health::default()
        });
        let (known, length) = (Arc::clone(&health), metadata.len());
        Ok((Self { health, file, length, head, torn, continues: false, has_partial: false }, known))
    }

    /// Writes until all senders are dropped. Records that wait at the same time are synced together.
    pub(super) fn run(mut self, waiting: &Receiver<Message>) {
        while let Ok(first) = waiting.recv() {
            let rest = std::iter::from_fn(|| waiting.try_recv().ok()).take(WAITING);
            let records = std::iter::once(first).chain(rest).filter_map(|message| match message {
                Message::Record(record) => Some(*record),
                Message::Look => None,
            });
            self.write_until_kept(&records.collect::<Vec<_>>());
        }
    }

    /// Repeats a failed write until it succeeds or the log is closed.
    fn write_until_kept(&mut self, records: &[Record]) {
        let log = self.health.path.clone();
        while let Err(error) = self.write(records) {
            self.health.failed();
            if !self.health.is_reported.swap(true, Ordering::Relaxed) {
                tracing::error!(%error, log = %log.display(), "the audit log cannot be written; requests are refused");
            }
            if self.health.is_closing.load(Ordering::Relaxed) {
                return;
            }
            std::thread::sleep(PAUSE);
        }
        self.health.is_reported.store(false, Ordering::Relaxed);
        if self.health.has_failed.swap(false, Ordering::Relaxed) {
            tracing::warn!(log = %log.display(), "the audit log is written again");
        }
    }

    /// Writes records and syncs them. After an error, the next attempt removes incomplete lines.
    fn write(&mut self, records: &[Record]) -> std::io::Result<()> {
        self.find_file()?;
        let (mut head, mut text) = (self.head.clone(), String::new());
        let lost = self.health.lost.load(Ordering::Relaxed);
        if self.torn {
            text.push('\n'); // ends the cut-off line
        }
        if self.torn || self.continues || lost > 0 {
            let lost = Some(lost).filter(|lost| *lost > 0);
            let event = Record { torn: self.torn, continues: self.continues, lost, ..Record::now() };
            text += &event.line_after(&mut head)?;
        }
        for record in records {
            text += &record.clone().line_after(&mut head)?;
        }
        self.has_partial = true;
        self.file.write_all(text.as_bytes())?;
        self.file.sync_data()?;
        self.health.lost.fetch_sub(lost, Ordering::Relaxed);
        self.length += text.len() as u64;
        (self.head, self.torn, self.continues, self.has_partial) = (head, false, false, false);
        Ok(())
    }

    /// Makes sure that the file is at its path and ends where the last write ended.
    fn find_file(&mut self) -> std::io::Result<()> {
        if !self.health.file_is_there() {
            let mut file = opened(&self.health.path).map_err(std::io::Error::other)?;
            let End { head, torn } = end_of(&mut file, &self.health.path).map_err(std::io::Error::other)?;
            let metadata = file.metadata()?;
            *self.health.file.lock() = Some(FileId::of(&metadata));
            self.continues = head != self.head;
            (self.file, self.length, self.torn, self.has_partial) = (file, metadata.len(), torn, false);
        }
        let length = self.file.metadata()?.len();
        if self.has_partial && length > self.length {
            // A file that only allows appending cannot be shortened: the incomplete line stays.
            self.torn |= self.file.set_len(self.length).is_err();
        } else if length < self.length {
            self.continues = true;
        }
        self.length = self.file.metadata()?.len();
        self.has_partial = false;
        Ok(())
    }
}

/// Opens or creates the file, and keeps other servers from it.
fn opened(path: &Path) -> Result<File, AuditError> {
    let failure = |source| AuditError::File { path: path.to_owned(), source };
    let file = private().read(true).append(true).create(true).open(path).map_err(failure)?;
    file.try_lock().map_err(|error| match error {
        std::fs::TryLockError::WouldBlock => AuditError::InUse(path.to_owned()),
        std::fs::TryLockError::Error(source) => failure(source),
    })?;
    Ok(file)
}

/// The end of a log: the hash of its newest whole record, and whether a cut-off line follows.
struct End {
    head: String,
    torn: bool,
}

/// Reads the end of a log without reading all of it.
fn end_of(file: &mut File, path: &Path) -> Result<End, AuditError> {
    let failure = |source| AuditError::File { path: path.to_owned(), source };
    let length = file.seek(SeekFrom::End(0)).map_err(failure)?;
    let from = length.saturating_sub(3 * MOST_LINE_BYTES);
    file.seek(SeekFrom::Start(from)).map_err(failure)?;
    let mut tail = Vec::new();
    file.read_to_end(&mut tail).map_err(failure)?;
    let mut whole = tail.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
    if parse(&tail[whole..]).is_some() {
        // A complete record without its line break.
        file.write_all(b"\n").map_err(failure)?;
        whole = tail.len();
    }
    let torn = whole < tail.len();
    let newest = tail[..whole].split(|byte| *byte == b'\n').rev().find(|line| !line.is_empty());
    match newest {
        None if from == 0 => Ok(End { head: FIRST.to_owned(), torn }),
        newest => match newest.and_then(parse) {
            Some((hash, _)) => Ok(End { head: hash, torn }),
            None => {
                Err(AuditError::Broken { path: path.to_owned(), line: 0, what: "the last line is no record" })
            }
        },
    }
}

/// The file is for the operator only: it names callers and volumes.
fn private() -> OpenOptions {
    #[allow(unused_mut, reason = "changed on Unix alone")]
    let mut options = OpenOptions::new();
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options
}
