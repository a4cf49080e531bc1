//! Checking the chain of a log.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use super::AuditError;
use super::record::{FIRST, Record, parse};
use super::writer::MOST_LINE_BYTES;

/// The result of checking an audit log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AuditSummary {
    /// Whole records.
    pub records: u64,
    /// Lines that a crash left incomplete.
    pub torn: u64,
    /// Refused requests that are only counted.
    pub refused: u64,
    /// Requests whose records were lost.
    pub lost: u64,
    /// Hash of the newest record.
    pub head: String,
    /// Whether the wanted hash is that of a record.
    pub contains: bool,
}

/// Checks the chain of an audit log from its first record to its newest, and looks for the record
/// of a hash. A log of several files is checked as one: the oldest file first.
///
/// # Errors
/// When a file cannot be read, or the chain is broken; the line says where.
pub fn verify_audit_log(paths: &[PathBuf], wanted: Option<&str>) -> Result<AuditSummary, AuditError> {
    let head = FIRST.to_owned();
    let summary = AuditSummary { records: 0, torn: 0, refused: 0, lost: 0, head, contains: false };
    paths.iter().try_fold(summary, |summary, path| verify_file(path, wanted, summary))
}

fn verify_file(
    path: &Path,
    wanted: Option<&str>,
    mut summary: AuditSummary,
) -> Result<AuditSummary, AuditError> {
    let failure = |source| AuditError::File { path: path.to_owned(), source };
    let mut reader = BufReader::new(File::open(path).map_err(failure)?);
    // The number of an incomplete line, and whether a line break follows it.
    let mut torn_line = None;
    for line in 1.. {
        let mut bytes = Vec::new();
        let read = (&mut reader).take(MOST_LINE_BYTES + 1).read_until(b'\n', &mut bytes).map_err(failure)?;
        if read == 0 {
            break;
        }
        let broken = |what| AuditError::Broken { path: path.to_owned(), line, what };
        let ended = bytes.strip_suffix(b"\n");
        if ended == Some(b"") {
            continue; // a server crashed while it ended an incomplete line
        }
        let Some((hash, record)) = parse(ended.unwrap_or(&bytes)) else {
            if torn_line.is_some() || is_whole(&bytes) {
                return Err(broken("it is no record"));
            }
            torn_line = Some((line, ended.is_some()));
            continue;
        };
        if line == 1 && record.continues && record.previous != summary.head {
            return Err(AuditError::Continued { path: path.to_owned(), previous: record.previous });
        }
        if record.previous != summary.head {
            return Err(broken("it does not follow the record before it"));
        }
        if record.torn != torn_line.is_some() {
            return Err(broken("the line before it is no record"));
        }
        summary.count(&record);
        summary.contains |= wanted == Some(hash.as_str());
        (summary.head, torn_line) = (hash, None);
    }
    match torn_line {
        // The server writes the line break together with the next record, so this line was changed.
        Some((line, true)) => {
            Err(AuditError::Broken { path: path.to_owned(), line, what: "it is no record" })
        }
        cut_off => {
            summary.torn += u64::from(cut_off.is_some());
            Ok(summary)
        }
    }
}

/// Whether an invalid line is complete. A crash leaves incomplete lines, so a complete one was changed.
fn is_whole(line: &[u8]) -> bool {
    let text = String::from_utf8_lossy(line);
    let Some((_, body)) = text.trim_end_matches('\n').split_once(' ') else { return false };
    serde_json::from_str::<serde_json::Value>(body).is_ok()
}

impl AuditSummary {
    fn count(&mut self, record: &Record) {
        self.records += 1;
        self.torn += u64::from(record.torn);
        self.refused += record.refused.unwrap_or(0);
        self.lost += record.lost.unwrap_or(0);
    }
}
