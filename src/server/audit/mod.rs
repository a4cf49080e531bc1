//! The audit log: caller, request, time and outcome.
//!
//! One line a record: the SHA-256 of the record, a space, and the record as JSON. Each record names
//! the hash of the one before it, so that a changed, missing or moved line breaks the chain
//! ([`verify_audit_log`]). A program that may write the file could rewrite the whole chain; keep the newest
//! hash elsewhere, or let the file system allow appending only (`chattr +a`).
//!
//! A record has the route and the id of a volume, which is a hash; no path, query or UID.
//! A thread writes records in their order and syncs them at least once a second. While it cannot write, or the file was moved or removed, the server refuses requests. The thread tries again every second and creates a missing file.
//!
//! Refused requests cannot fill the disk: at most [`Refusals::PER_MINUTE`] of them are recorded in a
//! minute. The next record contains the number of the others.

mod record;
mod refusals;
mod verify;
mod writer;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::JoinHandle;

use axum::http::{Method, Uri};
use parking_lot::Mutex;

use super::identity::Caller;
use record::Record;
use refusals::Refusals;
use writer::{Health, Message, Writer};

pub use verify::{AuditSummary, verify_audit_log};

/// Records that may wait for the disk.
const WAITING: usize = 8192;

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
    /// The file begins in the middle of a chain.
    #[error(
        "{} continues a log whose newest record is {previous}: the file was moved, emptied or removed while a server wrote \
         it; check both files together, the older one first", path.display()
    )]
    Continued {
        /// The log.
        path: PathBuf,
        /// The hash of the newest record of the older file.
        previous: String,
    },
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

/// An audit log that is being written.
#[derive(Debug)]
pub struct AuditLog {
    messages: Option<SyncSender<Message>>,
    health: Arc<Health>,
    refusals: Mutex<Refusals>,
    thread: Option<JoinHandle<()>>,
}

impl AuditLog {
    /// Opens a log, or creates it, and continues its chain.
    ///
    /// # Errors
    /// When the file cannot be read or written, another server writes it, or its end is not a
    /// record.
    pub fn open(path: &Path) -> Result<Self, AuditError> {
        let (writer, health) = Writer::open(path)?;
        let (messages, waiting) = sync_channel(WAITING);
        let thread = std::thread::Builder::new().name("relief-audit".to_owned());
        let thread = thread
            .spawn(move || writer.run(&waiting))
            .map_err(|source| AuditError::File { path: path.to_owned(), source })?;
        Ok(Self { messages: Some(messages), health, refusals: Mutex::default(), thread: Some(thread) })
    }

    /// Whether records can be written: the last attempt succeeded, and the file is at its path.
    pub(super) fn is_kept(&self) -> bool {
        if self.health.file_is_there() {
            return self.health.is_good();
        }
        // The thread creates a new file and then clears the failure.
        self.health.failed();
        self.send(Message::Look);
        false
    }

    /// Counts a request that is refused because no record can be written.
    pub(super) fn count_refused(&self) {
        self.refusals.lock().count();
    }

    /// Begins the record of a request. It is written when the result is dropped: after the answer,
    /// or when the client leaves before it.
    pub(super) fn begin(self: Arc<Self>, caller: Caller, subject: Subject) -> PendingRecord {
        PendingRecord { log: self, caller, subject: Some(subject), status: None }
    }

    /// Adds the record of a request; it has no status if the client left before the answer.
    fn record(&self, caller: &Caller, subject: Subject, status: Option<u16>) {
        let Some(refused) = self.refusals.lock().before(status) else { return };
        let record = Record {
            refused,
            who: caller.identity.as_ref().map(|identity| identity.name.clone()),
            from: caller.address.map(|address| address.to_string()),
            method: Some(subject.method),
            route: Some(subject.route),
            volume: subject.volume,
            status,
            ..Record::now()
        };
        self.send(Message::Record(Box::new(record)));
    }

    fn send(&self, message: Message) {
        let is_record = matches!(message, Message::Record(_));
        let is_lost = self.messages.as_ref().is_some_and(|messages| messages.try_send(message).is_err());
        if is_lost && is_record {
            self.health.lost_one();
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
    /// The request was answered with this status. It proved the identity of its caller.
    pub(super) fn answered_to(&mut self, caller: Caller, status: u16) {
        self.caller = caller;
        self.answered(status);
    }

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
        if let Some(refused) = self.refusals.lock().rest() {
            self.send(Message::Record(Box::new(Record { refused: Some(refused), ..Record::now() })));
        }
        self.health.close();
        drop(self.messages.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests;
