//! The audit log: caller, request, time and outcome.
//!
//! One line a record: the SHA-256 of the record, a space, and the record as JSON. Each record names
//! the hash of the one before it, so that a changed, missing or moved line breaks the chain
//! ([`verify_audit_log`]). A program that may write the file could rewrite the whole chain; keep the newest
//! hash elsewhere, or let the file system allow appending only (`chattr +a`).
//!
//! A record has the route and the id of a volume, which is a hash; no path, query or UID.
//! A thread writes records in their order and syncs them at least once a second. When writing
//! fails, the server refuses requests until it is restarted.

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use axum::http::{Method, Uri};
use serde::{Deserialize, Serialize};

use super::identity::Caller;
use relief_annotation::Timestamp;
use relief_base::sha256_of;

/// Records that may wait for the disk.
const WAITING: usize = 8192;
/// Longest line.
const MOST_LINE_BYTES: u64 = 4096;
/// The predecessor of the first record.
const FIRST: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// Why an audit log cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum AuditError {
    /// The file system refuses.
    #[error("cannot use the audit log {}", path.display())]
    File {
        /// The log.
        path: PathBuf,
        /// The reason.
        #[source]
        source: std::io::Error,
    },
    /// Another server has the log open.
    #[error("another server writes the audit log {}; give each its own", .0.display())]
    InUse(PathBuf),
    /// A line was changed, or lines are missing before it.
    #[error("line {line} of {}: {what}; the log was changed, or lines are missing", path.display())]
    Broken {
        /// The log.
        path: PathBuf,
        /// Counted from 1.
        line: u64,
        /// The violated rule.
        what: &'static str,
    },
}

/// The result of checking an audit log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AuditSummary {
    /// Whole records.
    pub records: u64,
    /// Lines that a crash cut off, each followed by a record that says so.
    pub torn: u64,
    /// Hash of the newest record.
    pub head: String,
    /// Whether the wanted hash is that of a record.
    pub contains: bool,
}

/// The subject of a request, as a record names it.
pub(super) struct Subject {
    method: String,
    route: String,
    volume: Option<String>,
}

impl Subject {
    /// Of a request to a route.
    pub(super) fn of(method: &Method, route: &str, uri: &Uri) -> Self {
        let rest = uri.path().strip_prefix("/v1/volumes/").unwrap_or_default();
        let id = rest.split('/').next().unwrap_or_default();
        let is_id = (1..=64).contains(&id.len()) && id.bytes().all(|byte| byte.is_ascii_hexdigit());
        let method = method.as_str().chars().take(16).collect();
        Self { method, route: route.to_owned(), volume: is_id.then(|| id.to_owned()) }
    }
}

#[derive(Serialize, Deserialize)]
struct Record {
    previous: String,
    time: Timestamp,
    /// The line before this record was cut off by a crash.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    torn: bool,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    who: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    from: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    method: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    route: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    volume: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    status: Option<u16>,
}

/// An audit log that is being written.
#[derive(Debug)]
pub struct AuditLog {
    records: Option<SyncSender<Record>>,
    failed: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl AuditLog {
    /// Opens a log, or creates it, and continues its chain.
    ///
    /// # Errors
    /// When the file cannot be read or written, another server writes it, or its end is not a
    /// record.
    pub fn open(path: &Path) -> Result<Self, AuditError> {
        let failure = |source| AuditError::File { path: path.to_owned(), source };
        let mut file = private().read(true).append(true).create(true).open(path).map_err(failure)?;
        file.try_lock().map_err(|error| match error {
            std::fs::TryLockError::WouldBlock => AuditError::InUse(path.to_owned()),
            std::fs::TryLockError::Error(source) => failure(source),
        })?;
        let End { head, torn } = end_of(&mut file, path)?;
        if torn {
            file.write_all(b"\n").map_err(failure)?;
        }
        let (records, waiting) = sync_channel(WAITING);
        let failed = Arc::new(AtomicBool::new(false));
        let (name, writer) = (path.to_owned(), Arc::clone(&failed));
        let thread = std::thread::Builder::new().name("relief-audit".to_owned());
        let thread = thread
            .spawn(move || {
                if let Err(error) = write(&mut file, &waiting, head, torn) {
                    writer.store(true, Ordering::Relaxed);
                    tracing::error!(%error, log = %name.display(), "the audit log cannot be written; requests are refused");
                }
            })
            .map_err(failure)?;
        Ok(Self { records: Some(records), failed, thread: Some(thread) })
    }

    /// Whether records were lost.
    pub(super) fn has_failed(&self) -> bool {
        self.failed.load(Ordering::Relaxed)
    }

    /// Begins the record of a request. It is written when the result is dropped: after the answer,
    /// or when the client leaves before it.
    pub(super) fn begin(self: Arc<Self>, caller: Caller, subject: Subject) -> PendingRecord {
        PendingRecord { log: self, caller, subject: Some(subject), status: None }
    }

    /// Adds the record of a request; it has no status if the client left before the answer.
    fn record(&self, caller: &Caller, subject: Subject, status: Option<u16>) {
        let record = Record {
            previous: String::new(),
            time: Timestamp::now(),
            torn: false,
            who: caller.identity.as_ref().map(|identity| identity.name.clone()),
            from: caller.address.map(|address| address.to_string()),
            method: Some(subject.method),
            route: Some(subject.route),
            volume: subject.volume,
            status,
        };
        let is_lost = self.records.as_ref().is_some_and(|records| records.try_send(record).is_err());
        if is_lost {
            // The disk cannot keep up: no record is left out in silence.
            self.failed.store(true, Ordering::Relaxed);
        }
    }
}

/// The record of a request that is being answered.
pub(super) struct PendingRecord {
    log: Arc<AuditLog>,
    caller: Caller,
    /// `None` once it is written.
    subject: Option<Subject>,
    status: Option<u16>,
}

impl PendingRecord {
    /// The request was answered with this status.
    pub(super) fn answered(&mut self, status: u16) {
        self.status = Some(status);
    }
}

impl Drop for PendingRecord {
    fn drop(&mut self) {
        if let Some(subject) = self.subject.take() {
            self.log.record(&self.caller, subject, self.status);
        }
    }
}

impl Drop for AuditLog {
    fn drop(&mut self) {
        drop(self.records.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Writes records until their senders are gone. What waits together is synced together.
fn write(file: &mut File, waiting: &Receiver<Record>, head: String, torn: bool) -> std::io::Result<()> {
    let mut head = head;
    if torn {
        append(file, &mut head, Record { torn: true, ..empty() })?;
    }
    while let Ok(record) = waiting.recv() {
        append(file, &mut head, record)?;
        while let Ok(record) = waiting.try_recv() {
            append(file, &mut head, record)?;
        }
        file.sync_data()?;
    }
    Ok(())
}

fn append(file: &mut File, head: &mut String, record: Record) -> std::io::Result<()> {
    let record = Record { previous: head.clone(), ..record };
    let body = serde_json::to_string(&record)?;
    *head = sha256_of(body.as_bytes());
    file.write_all(format!("{head} {body}\n").as_bytes())
}

fn empty() -> Record {
    Record {
        previous: String::new(),
        time: Timestamp::now(),
        torn: false,
        who: None,
        from: None,
        method: None,
        route: None,
        volume: None,
        status: None,
    }
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
    let whole = tail.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
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

/// A line whose hash is that of its record.
fn parse(line: &[u8]) -> Option<(String, Record)> {
    let text = std::str::from_utf8(line).ok()?;
    let (hash, body) = text.split_once(' ')?;
    let record = serde_json::from_str(body).ok()?;
    (sha256_of(body.as_bytes()) == hash).then(|| (hash.to_owned(), record))
}

/// Checks the chain of an audit log from its first record to its newest, and looks for the record
/// of a hash.
///
/// # Errors
/// When the file cannot be read, or the chain is broken; the line says where.
pub fn verify_audit_log(path: &Path, wanted: Option<&str>) -> Result<AuditSummary, AuditError> {
    let failure = |source| AuditError::File { path: path.to_owned(), source };
    let mut reader = BufReader::new(File::open(path).map_err(failure)?);
    let mut summary = AuditSummary { records: 0, torn: 0, head: FIRST.to_owned(), contains: false };
    let mut pending_torn = false;
    for line in 1.. {
        let mut bytes = Vec::new();
        let read = (&mut reader).take(MOST_LINE_BYTES + 1).read_until(b'\n', &mut bytes).map_err(failure)?;
        if read == 0 {
            break;
        }
        let broken = |what| AuditError::Broken { path: path.to_owned(), line, what };
        let ended = bytes.strip_suffix(b"\n");
        match ended.and_then(parse) {
            Some((hash, record)) => {
                if record.previous != summary.head {
                    return Err(broken("it does not follow the record before it"));
                }
                if record.torn != pending_torn {
                    return Err(broken("the line before it is no record"));
                }
                summary.records += 1;
                summary.torn += u64::from(pending_torn);
                summary.contains |= wanted == Some(hash.as_str());
                (summary.head, pending_torn) = (hash, false);
            }
            // Cut off by a crash, if the next record says so; the last line may be cut off, too.
            None if !pending_torn => pending_torn = true,
            None => return Err(broken("it is no record")),
        }
    }
    if pending_torn {
        summary.torn += 1;
    }
    Ok(summary)
}

/// The file is for the operator only: it names callers and volumes.
fn private() -> OpenOptions {
    #[allow(unused_mut, reason = "changed on Unix alone")]
    let mut options = OpenOptions::new();
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options
}

#[cfg(test)]
mod tests {
    use super::*;

    fn log_three(path: &Path) {
        let log = Arc::new(AuditLog::open(path).unwrap());
        for status in [200, 403, 200] {
            let uri: Uri = "/v1/volumes/0a1b/frame?preset=bone".parse().unwrap();
            let subject = Subject::of(&Method::GET, "/v1/volumes/{id}/frame", &uri);
            Arc::clone(&log).begin(Caller::default(), subject).answered(status);
        }
    }

    #[test]
    fn a_chain_goes_on_after_a_restart_and_breaks_where_a_line_was_changed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("audit.log");
        log_three(&path);
        log_three(&path);
        let summary = verify_audit_log(&path, None).unwrap();
        assert_eq!((summary.records, summary.torn), (6, 0));
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains("\"volume\":\"0a1b\"") && !text.contains("bone"));
        assert!(text.lines().last().unwrap().starts_with(&summary.head));
        let lines: Vec<&str> = text.lines().collect();
        let rest = |range: &[usize]| range.iter().map(|at| lines[*at].to_owned() + "\n").collect::<String>();
        for (changed, line) in [
            (text.replacen("\"status\":403", "\"status\":200", 1), 3), // one line may be cut off; the next does not say so
            (rest(&[0, 2, 3]), 2),
            (rest(&[1, 2]), 1),
            (rest(&[0, 2, 1]), 2),
        ] {
            std::fs::write(&path, changed).unwrap();
            let error = verify_audit_log(&path, None).unwrap_err();
            assert!(matches!(error, AuditError::Broken { line: at, .. } if at == line), "{error}");
        }
    }

    #[test]
    fn a_request_whose_client_leaves_is_recorded_without_a_status() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("audit.log");
        let log = Arc::new(AuditLog::open(&path).unwrap());
        let uri: Uri = "/v1/volumes/0a1b/annotations".parse().unwrap();
        let subject = Subject::of(&Method::POST, "/v1/volumes/{id}/annotations", &uri);
        drop(Arc::clone(&log).begin(Caller::default(), subject));
        drop(log);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains("\"POST\"") && !text.contains("status"), "{text}");
        assert_eq!(verify_audit_log(&path, None).unwrap().records, 1);
    }

    #[test]
    fn a_line_cut_off_by_a_crash_is_kept_and_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("audit.log");
        log_three(&path);
        let mut file = OpenOptions::new().append(true).open(&path).unwrap();
        file.write_all(b"0123 {\"previ").unwrap();
        log_three(&path);
        let summary = verify_audit_log(&path, None).unwrap();
        assert_eq!((summary.records, summary.torn), (7, 1));
        let open = AuditLog::open(&path).unwrap();
        assert!(matches!(AuditLog::open(&path), Err(AuditError::InUse(_))));
        drop(open);
    }
}
